"""``fraexp excite``: the excitation of a study as a file that a machine can play, and the study of its record."""

import os
from argparse import Namespace
from pathlib import Path

from fraexp.cli.exits import ExitCode
from fraexp.cli.measurement_meter import MeasurementMeter
from fraexp.cli.output import print_path, say
from fraexp.cli.plan_output import print_plan
from fraexp.cli.sweep_lookup import location_options
from fraexp.errors import StudyError
from fraexp.measurement.excitation_files import excitation_table, write_excitation
from fraexp.records.study_writer import write_study
from fraexp.workspace.measurement_service import MeasurementService
from fraexp.workspace.workspace_service import WorkspaceService


def execute(arguments: Namespace) -> ExitCode:
    """Check the excitation against the limits, write it, and print its plan."""
    workspace = WorkspaceService.open(arguments.workspace, arguments.db)
    meter = MeasurementMeter()
    service = MeasurementService(workspace, arguments.study, arguments.overrides, meter.show_planning)
    output: Path = arguments.output
    if os.path.lexists(output) and not arguments.force:
        raise StudyError(f"{output}: already exists; overwrite it with --force, or choose another file")
    with meter.bar:
        plans = service.plans()
    if len(plans) > 1:
        raise StudyError(f"{arguments.study}: it has {len(plans)} experiments; write one at a time, with --set")
    record = arguments.record or output.with_name(f"{output.stem}-record.csv")
    table = excitation_table(plans[0])
    study, content = service.record_study(record, table, arguments.force)
    note = write_excitation(output, table)
    write_study(study, content)
    position = "rad" if table.unit == "N m" else "m"
    print_plan(plans[0])
    print(f"{table.samples:,} samples, {table.samples * table.sample_time:.1f} s with pauses; {note}")
    print_path(output)
    print_path(study, "study of the record ")
    say(
        f"next: play it, and record y [{position}] and u [{table.unit}] from its first sample on, as columns of "
        f"{record}; then: "
        f"fraexp import {record}{location_options(arguments)}"
    )
    return ExitCode.OK
