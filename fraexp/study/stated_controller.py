"""The controller and the sampled loop that a study or a machine states."""

from pathlib import Path
from typing import Any

from fraexp.components.kinds import Controller
from fraexp.components.registry import Registry
from fraexp.data.rotary_axes import is_rotary
from fraexp.data.sweep import components_by_port
from fraexp.errors import StudyError
from fraexp.simulation.machine import ControlLoop
from fraexp.study.sections import overlay
from fraexp.study.study_file import find_studies, machine_of, read

NEEDED = (Controller.kind, "loop")


def stated_controller(name: str, folder: Path, registry: Registry) -> dict[str, Any]:
    """Return the resolved sections ``controller`` and ``loop`` of a study or machine, looked up as a study is.

    StudyError if it is none, or lacks one of them.
    """
    ((_, file),) = find_studies(name, folder)[:1]
    data = read(file)
    machine = machine_of(data, file, folder)
    sections = {key: overlay(machine.get(key, {}), data.get(key, {})) for key in NEEDED}
    missing = next((key for key in NEEDED if not sections[key]), None)
    if missing:
        raise StudyError(f"{file}: lacks the section [{missing}]; expected [controller] and [loop], or a machine")
    if thrusts := components_by_port(sections[Controller.kind]):
        raise StudyError(f"{file}: has a controller for each of several thrusts ({', '.join(thrusts)}); expected one")
    loop = ControlLoop.parse(sections["loop"], "loop", rotary=is_rotary(sections))
    controller = registry.create(Controller.kind, sections[Controller.kind], sections, str(file))
    return {Controller.kind: controller.spec(), "loop": loop.plain()}
