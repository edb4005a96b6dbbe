"""Where the study of an import is written."""

from contextlib import closing
from pathlib import Path

from fraexp.execution.events import Noticed
from fraexp.records.study_writer import ImportRequest
from fraexp.workspace.workspace_service import WorkspaceService

RECORD = Path(__file__).parents[2] / "studies/records/table_stepped_sine.csv"


def test_a_study_outside_of_the_workspace_is_said_to_be_run_by_its_path(tmp_path: Path) -> None:
    (tmp_path / "inside").mkdir()
    service = WorkspaceService.open(tmp_path / "inside")
    request = ImportRequest(
        files=[RECORD],
        channels={"u": "thrust [N]", "y": "position [um]"},
        options={"sample_rate": 2000.0, "frequency_column": "frequency [Hz]"},
    )
    target = tmp_path / "elsewhere" / "bench.toml"
    with closing(service.import_record(request, target)) as events:
        first = next(events)
    assert isinstance(first, Noticed)
    assert first.what == f"the study is written outside the workspace, and is run by its path: {target}"
    assert target.is_file()
