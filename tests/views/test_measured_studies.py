"""Studies that are measured, not run: what lists and plans say of them."""

from pathlib import Path

from fraexp.views.study import study_fields, study_row, survey_study
from fraexp.workspace.workspace_service import WorkspaceService

AUTONOMOUS = """
title = "An axis"
machine = "linear_motor_table"

[limits]
stroke = "40 mm"
velocity = "1 m/s"
force = 150

[measurement]
machine = { name = "simulated" }
"""


def test_a_study_for_an_autonomous_measurement_names_its_command(tmp_path: Path) -> None:
    (tmp_path / "studies").mkdir()
    (tmp_path / "studies" / "axis.toml").write_text(AUTONOMOUS, encoding="utf-8")
    workspace = WorkspaceService.open(tmp_path)
    entry = next(one for one in workspace.catalogue() if one.name == "axis")
    found = survey_study(workspace, entry)
    assert study_row(entry, found, None) == ["axis", "An axis", "measure", "", ""]
    fields = dict(study_fields(entry, found, None))
    assert (fields["error"], fields["plan"]) == ("", "fraexp measure --autonomous axis")
