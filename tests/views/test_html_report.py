"""Reports as HTML, with published values beside computed ones."""

import json
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.errors import FraexpError
from fraexp.reports.stored_figures import StoredFigures
from fraexp.store import Store
from fraexp.study.study_file import packaged_studies
from fraexp.views.html_report import gather_chapter, render_report, report_runs
from fraexp.views.report_tables import Method
from fraexp.workspace.workspace_service import WorkspaceService

EVIL = "<script>alert('&')</script>"
STUDY = f"""
title = "Loops of one element {EVIL}"
question = "Does it take 4 F_m (A - Y) of energy per cycle?"

[friction]
name = "rolling"
stiffness = [1e5]
limit_force = [10]

[loop]
sample_time = "0.1 ms"

[excitation]
name = "displacement_sine"
frequency = 1

[estimator]
name = "hysteresis"

[grid]
"excitation.amplitude" = ["0.5 mm", "1 mm"]

[[published]]
what = "energy {EVIL}"
source = "the paper's Table \\"1\\""
value = 16
unit = "mJ"
tolerance = "0.1 %"
metric = "energy per cycle"
where = {{ "excitation.amplitude" = 0.5e-3 }}
origin = "predicted"
note = "4 F_m (A - Y) {EVIL}"

[[published]]
what = "energy at another amplitude"
value = 16
unit = "mJ"
compare = "above"
metric = "energy per cycle"
where = {{ "excitation.amplitude" = "1 mm" }}

[[published]]
what = "nobody's"
value = 1
compare = "below"
metric = "energy per stroke"
"""


class Page(HTMLParser):
    """What of a page could reach outside of it, and its tables, headings and anchors."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.sources: list[str] = []
        self.links: list[str] = []
        self.anchors: list[str] = []
        self.rows: list[list[str]] = []
        self.open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.tags.append(tag)
        self.sources += [given["src"]] if "src" in given else []
        self.links += [given["href"]] if "href" in given else []
        self.anchors += [f"#{given['id']}"] if "id" in given else []
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if {"td", "th"} & set(self.open):
            self.rows[-1][-1] += data


def page(path: Path) -> Page:
    found = Page(path.read_text("utf-8"))
    assert found.open == []
    return found


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "studies/loops").mkdir(parents=True)
    (tmp_path / "studies/loops/a.toml").write_text(STUDY, "utf-8")
    second = STUDY.partition("[[published]]")[0].replace("1e5", "2e5")
    (tmp_path / "studies/loops/b.toml").write_text(second, "utf-8")
    return tmp_path


def test_the_report_of_a_folder_needs_nothing_else(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "loops", "--executor=serial"]) == 0
    capsys.readouterr()
    assert main(["report", "loops", "-o", "loops.html"]) == ExitCode.INCOMPLETE
    said = capsys.readouterr()
    assert said.out.splitlines() == ["report loops.html"]
    assert said.err.splitlines() == [
        "published value 'nobody's': no sweep has a metric 'energy per stroke'",
        "2 of 3 published numbers met: predicted 1 of 1, unstated 1 of 2",
    ]
    found = page(folder / "loops.html")
    assert "script" not in found.tags
    assert len(found.sources) == 2
    assert all(source.startswith("data:image/png;base64,iVBOR") for source in found.sources)
    assert set(found.links) == set(found.anchors) == {"#run-1", "#run-2"}
    numbers = [row for row in found.rows if row[0].startswith(f"energy {EVIL}")]
    assert numbers[0][0] == f"energy {EVIL}4 F_m (A - Y) {EVIL}"
    assert [row[1] for row in numbers] == ['the paper\'s Table "1"'] * 2  # at the top, and in its chapter
    assert numbers[0][2:5] == ["loops/a", "mJ", "16"]
    assert numbers[1][2:5] == ["predicted", "mJ", "16"]
    assert float(numbers[0][5]) == pytest.approx(16, rel=1e-3)
    assert numbers[0][-2:] == ["± 0.1 %", "yes"]
    bound = next(row for row in found.rows if row[0] == "energy at another amplitude")  # without source and difference
    assert bound[1:] == ["loops/a", "mJ", "> 16", bound[4], "above 16", "yes"]
    missed = [row for row in found.rows if row[0] == "nobody's"]
    assert missed[0][-1] == "no sweep has a metric 'energy per stroke'"
    energies = next(row for row in found.rows if row[0] == "energy per cycle [mJ]")  # as it is printed
    assert [float(cell) for cell in energies[1:]] == pytest.approx([16, 36], rel=1e-3)
    assert next(row for row in found.rows if row[0].startswith("displacement"))[1:] == ["0.5", "1"]  # mm
    text = (folder / "loops.html").read_text("utf-8")
    assert text.count("All 2 sweeps are sound.") >= 2, "in the summary, and in the chapter"
    assert [row[1:] for row in found.rows if row[0] == "friction.stiffness"] == [
        ["[100000]", "N/m"],
        ["[200000]", "N/m"],
    ]
    assert "<h3>Hysteresis</h3>" in text
    assert "fraexp run loops/a" in text
    assert "Does it take 4 F_m (A - Y)" in text


def test_show_and_export_have_the_published_numbers(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "loops/a", "--executor=serial"]) == 0
    capsys.readouterr()
    assert main(["show", "loops/a"]) == 0
    said = capsys.readouterr()
    assert said.err.splitlines()[-1] == "2 of 3 published numbers met: predicted 1 of 1, unstated 1 of 2"
    row = next(line for line in said.out.splitlines() if line.startswith("energy at another amplitude"))
    assert row.split()[4:] == ["unstated", "mJ", ">", "16", row.split()[8], "above", "16", "yes"]
    assert main(["show", "loops/a", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    first, second, third = document["published"]
    assert (first["origin"], first["met"], first["compare"]) == ("predicted", True, "about")
    assert (second["compare"], second["value"], second["ours"]) == ("above", 16, pytest.approx(36, rel=1e-3))
    assert (third["ours"], third["met"]) == (None, False)
    keys = [sweep["key"] for sweep in document["sweeps"]]
    assert main(["export", keys[1], "-o", "x.json"]) == 0
    header = json.loads(Path("x.json").read_text("utf-8"))["header"]
    assert [number["what"] for number in header["published"]] == ["energy at another amplitude", "nobody's"]


@pytest.mark.thorough
def test_the_same_runs_make_the_same_report_again(folder: Path) -> None:
    assert main(["run", "loops", "--executor=serial"]) == 0
    assert main(["report", "loops", "-o", "loops.html", "--title", "Report: loops"]) == ExitCode.INCOMPLETE
    first = (folder / "loops.html").read_bytes()
    for identifiers in (["loops/a", "loops/b"], ["1", "2", "1"]):
        # a printed number has no counterpart
        assert main(["report", *identifiers, "-o", "x.html", "--title", "Report: loops"]) == ExitCode.INCOMPLETE
        assert (folder / "x.html").read_bytes() == first
    assert not list(folder.glob(".*"))


@pytest.mark.thorough
def test_an_older_run_leaves_the_figures_of_the_newest(folder: Path) -> None:
    assert main(["run", "loops/a", "--executor=serial", "--set", "friction.stiffness=[3e5]"]) == 0
    assert main(["run", "loops/a", "--executor=serial"]) == 0
    newest = (folder / "figures/loops/a.png").read_bytes()
    assert main(["report", "1", "-o", "old.html"]) == ExitCode.INCOMPLETE
    assert (folder / "figures/loops/a.png").read_bytes() == newest
    text = (folder / "old.html").read_text("utf-8")
    assert "fraexp run loops/a &#39;--set=friction.stiffness=[3e5]&#39;" in text
    assert len(page(folder / "old.html").sources) == 1


@pytest.mark.thorough
def test_a_report_does_without_the_study_and_without_a_figure(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert main(["run", "loops", "--executor=serial"]) == 0
    shutil.rmtree(folder / "studies")
    assert main(["report", "loops/a", "-o", "x.html"]) == 0
    text = (folder / "x.html").read_text("utf-8")
    assert "title, question and published numbers are left out: there is no study" in text
    assert len(page(folder / "x.html").sources) == 1

    def refuse(*_: object) -> dict[Path, bool]:
        raise FraexpError("nothing to draw")

    monkeypatch.setattr(StoredFigures, "draw", refuse)
    assert main(["report", "1", "-o", "x.html"]) == 0
    assert "no figure: nothing to draw" in (folder / "x.html").read_text("utf-8")
    assert page(folder / "x.html").sources == []


@pytest.mark.thorough
def test_a_report_of_one_run_is_titled_like_its_study_and_replaces_no_other_file(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "loops/a", "--executor=serial"]) == 0
    Path("x.html").write_text("<!DOCTYPE html><p>mine</p>", "utf-8")
    assert main(["report", "1", "-o", "x.html"]) == ExitCode.USAGE
    assert "x.html: the file exists and is not a report; give --force" in capsys.readouterr().err
    assert "mine" in Path("x.html").read_text("utf-8")
    for more in (["--force"], []):  # afterwards it is one
        assert main(["report", "1", "-o", "x.html", *more]) == ExitCode.INCOMPLETE
    text = (folder / "x.html").read_text("utf-8")
    title = "Loops of one element &lt;script&gt;alert(&#39;&amp;&#39;)&lt;/script&gt;"
    assert f"<h1>{title}</h1>" in text
    assert f"<h2>{title}</h2>" not in text
    assert "Summary" not in text
    workspace = WorkspaceService.open(".")
    with workspace.open_store() as store:
        chapter = gather_chapter(workspace, store, 1, folder / "figures")
    method = Method("estimator", "mine", ("the `method<b>` is <i>", "twice"))
    text = render_report("", [replace(chapter, methods=[method])])
    assert "<p>the <code>method&lt;b&gt;</code> is &lt;i&gt;</p>\n<p>twice</p>" in text


@pytest.mark.thorough
def test_many_sweeps_are_shown_in_part(folder: Path) -> None:
    values = ", ".join(f"{n}e-4" for n in range(2, 62))
    text = STUDY.partition("[[published]]")[0].replace('["0.5 mm", "1 mm"]', f"[{values}]")
    (folder / "studies/loops/a.toml").write_text(text, "utf-8")
    assert main(["run", "loops/a", "--executor=serial"]) == 0
    assert main(["report", "1", "-o", "x.html"]) == 0
    rows = page(folder / "x.html").rows
    head = next(place for place, row in enumerate(rows) if row[:2] == ["sweep", "amplitude [mm]"])
    assert [row[1] for row in rows[head + 1 : head + 4]] == ["0.2", "0.3", "0.4"]
    assert [row[1] for row in rows[head + 50 : head + 51]] == ["5.1"]
    assert "10 more sweeps" in (folder / "x.html").read_text("utf-8")


def test_a_wrong_wish_is_one_line(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "loops/a", "--executor=serial"]) == 0
    capsys.readouterr()
    for arguments, code, complaint in (
        (["1", "-o", "x.doc"], ExitCode.USAGE, "a report cannot be written as '.doc'"),
        (["9", "-o", "x.html"], ExitCode.STORE, "there is no run 9"),
        (["loop", "-o", "x.html"], ExitCode.USAGE, "no run of 'loop'"),
        (["1", "-o", "studies/loops/a.toml/x.html"], ExitCode.USAGE, "cannot be written"),
        (["1", "-o", "nowhere/x.html"], ExitCode.USAGE, "cannot be written"),
    ):
        assert main(["report", *arguments]) == code
        (said,) = capsys.readouterr().err.strip().splitlines()
        assert complaint in said
    assert not Path("nowhere").exists()


@pytest.mark.thorough
def test_what_was_fitted_later_is_no_study_of_the_folder(folder: Path) -> None:
    text = 'machine = "linear_motor_table"\nexcitation = { name = "stepped_sine", amplitude = 75.0, points = 30 }\n'
    text += 'estimator = { name = "effective_input" }\n'
    (folder / "studies/loops/a.toml").write_text(text, "utf-8")
    assert main(["run", "loops", "--executor=serial"]) == 0
    assert main(["fit", "loops/a", "--set", "modes=2"]) == 0
    assert main(["report", "loops", "-o", "x.html"]) == 0
    assert page(folder / "x.html").anchors == ["#run-1", "#run-2"]
    assert "loops/a-fit" not in (folder / "x.html").read_text("utf-8")
    assert main(["report", "loops/a-fit", "-o", "fit.html"]) == 0
    gain = next(row for row in page(folder / "fit.html").rows if row[0] == "k0 [m/(N s²)]")
    value, half = map(float, gain[1].split(" ± "))
    assert value == pytest.approx(0.132, rel=1e-3)
    assert 0 < half < 1e-4


def test_a_study_with_a_printed_number_of_no_sweep_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = STUDY.replace('"excitation.amplitude" = "1 mm"', '"excitation.amplitude" = 7')
    (folder / "studies/loops/a.toml").write_text(text, "utf-8")
    assert main(["run", "loops", "--dry-run"]) == ExitCode.USAGE
    assert "number 2: no sweep has excitation.amplitude = 7; known: 0.5 mm, 1 mm" in capsys.readouterr().err
    assert main(["run", "loops/a", "--set", "excitation.amplitude=1e-3", "--dry-run"]) == 0  # asked for


@pytest.mark.thorough
def test_the_paper_comes_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All studies of the paper but those by maximum likelihood, which have tests of their own."""
    monkeypatch.chdir(tmp_path)
    studies = sorted(path.stem for path in (packaged_studies() / "paper").glob("*.toml"))
    assert main(["run", *(f"paper/{name}" for name in studies if not name.endswith("_likelihood"))]) == 0
    figures = {path.stem for path in Path("figures/paper").glob("*.png")}
    assert figures >= {"fig02", "fig06", "fig08", "fig12", "fig13", "fig14", "fig15"}
    with Store.open("results.db", read_only=True) as store:
        runs = [run.number for run in store.runs()]
        compared = report_runs(WorkspaceService.open(tmp_path), store, runs, tmp_path / "x.html", "paper")
    assert len(compared) >= 8
    assert [one for one in compared if not one.agrees] == []
    assert len(page(tmp_path / "x.html").sources) == len(figures)
