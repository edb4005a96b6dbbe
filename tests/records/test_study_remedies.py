"""Each refusal that only the section [record] of a study can cause: the remedy, taken from the message, works."""

import re
from copy import deepcopy
from pathlib import Path

import pytest
import tomlkit

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from tests.records.study_refusals import CASES, QUICK, RefusedSection, Section


def run(folder: Path, section: Section, study: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    """Run a study with a section [record]; return exit code, output and messages."""
    path = folder / f"{study}.toml"
    text = tomlkit.dumps({"record": section, "estimator": {"name": "conventional", "input": "u", "output": "y"}})
    path.write_text(text, encoding="utf-8")
    code = main(["run", str(path), "--workspace", str(folder)])
    printed = capsys.readouterr()
    return code, printed.out, printed.err


@pytest.mark.parametrize(
    "case",
    [pytest.param(case, id=case.name, marks=() if case.name in QUICK else pytest.mark.thorough) for case in CASES],
)
def test_the_remedy_of_a_refused_section_works(
    case: RefusedSection, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    case.write(tmp_path)
    code, _, said = run(tmp_path, case.section, "refused", capsys)
    assert code == ExitCode.USAGE
    assert said.count("\n") == 1
    found = re.search(case.message, said)
    assert found, said
    section = deepcopy(case.section)
    case.mend(section, found)
    code, printed, said = run(tmp_path, section, "mended", capsys)
    assert code == ExitCode.OK, (section, said)
    assert "1 computed" in printed
    assert " 0 failed" in printed
