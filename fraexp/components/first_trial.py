"""The first trial of a local friction law in a process of its own, so that a call that never returns can be ended."""

import faulthandler
import json
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import redirect_stdout
from numbers import Real
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.components.kinds import FrictionModel
from fraexp.components.law_step import law_place
from fraexp.components.registry import LOCAL, Registry, create, discover, reason_of
from fraexp.data.findings import Quantity
from fraexp.data.identity import file_hash
from fraexp.data.sweep import components_by_port
from fraexp.errors import FraexpError, PluginError
from fraexp.kernels.watchdog import LAW_TIME_LIMIT_S, OverdueError, dumped_location, time_limit

AMPLITUDES_M = (1e-7, 1e-6, 1e-5, 1e-4)
FREQUENCIES_HZ = (1.0, 50.0)
"""Sines along which a law is moved."""
PERIODS = 4
"""Periods of each; the energy is that of the last one."""
STEPS, FINE_STEPS = 48, 480
"""Steps of a period, and of one by which a suspicion is confirmed."""
MAX_RELEASED = 0.02
"""Greatest energy that a period may release, relative to the work along it: the error of the steps."""
TIME_LIMIT_S = 5.0
"""Time limit [s]; a law that is slower in plain Python is not looked at."""

Law = Callable[..., float]


class _ClosedPath(NamedTuple):
    """A sine along which a law is moved, and the energy that its last period releases."""

    amplitude: float
    """Amplitude [m]."""
    frequency: float
    """Frequency [Hz]."""
    released: float
    """Energy released in a period [J]; negative if it is dissipated."""
    effort: float
    """Work along the path, regardless of its sign [J]."""

    @property
    def is_active(self) -> bool:
        """Whether it releases more than the steps explain."""
        return self.released > MAX_RELEASED * self.effort


def check_passivity(name: str, law: Law, arguments: tuple[object, ...], states: int, viscous: float) -> None:
    """Raise PluginError for a law that gives energy along a closed path; a slow law is left to `fraexp check`."""

    def move(amplitude: float, frequency: float, steps: int) -> _ClosedPath:
        return _travel(law, arguments, np.zeros(states), viscous, amplitude, frequency, steps)

    try:
        with time_limit(TIME_LIMIT_S), np.errstate(all="ignore"):
            for amplitude in AMPLITUDES_M:
                for frequency in FREQUENCIES_HZ:
                    if move(amplitude, frequency, STEPS).is_active:
                        path = move(amplitude, frequency, FINE_STEPS)
                        if path.is_active:
                            raise PluginError(_active_text(name, path))
    except OverdueError:
        return


def _active_text(name: str, path: _ClosedPath) -> str:
    sine = f"a sine of {path.amplitude:g} m at {path.frequency:g} Hz"
    found = f"the law of {name} gives energy: {sine} releases {path.released:.3g} J a period"
    return (
        f"{found}, with {path.effort:.3g} J of work along it (check 'energy'); expected a law that takes energy, or "
        "expected_failures = {'energy': REASON} in its class"
    )


def _travel(
    law: Law,
    arguments: tuple[object, ...],
    z: NDArray[np.float64],
    viscous: float,
    amplitude: float,
    frequency: float,
    steps: int,
) -> _ClosedPath:
    displacement = amplitude * np.sin(2 * np.pi * np.arange(1, PERIODS * steps + 1) / steps)
    dy, dt = np.diff(displacement, prepend=0.0), 1 / (frequency * steps)
    forces = np.zeros(dy.size + 1)
    for k, step in enumerate(dy.tolist()):
        z_next = np.full(z.size, np.nan)
        forces[k + 1] = law(z, step, dt, z_next, *arguments)
        z = z_next
    mean, last = (forces[-steps - 1 : -1] + forces[-steps:]) / 2, dy[-steps:]
    work, lost = mean * last, viscous * float(np.sum(last**2)) / dt
    return _ClosedPath(amplitude, frequency, -(float(np.sum(work)) + lost), float(np.sum(np.abs(work))) + lost)


GRACE_S = 2.0
"""Time after the limit in which a law that can be interrupted is interrupted."""
NO_RATE_S = 1e30
"""Time of a step [s] in which no rate matters."""
SLOPE_TOLERANCE = 1e-6
"""Share by which rounding may make a slope exceed the greatest one."""
EXIT_LAW_IS_WRONG = 3
"""Exit code of the trial process for a wrong law; its last line on stderr gives the reason."""
PASSED = "passed"
"""What the trial process prints at its end."""
_passed: set[tuple[str, str]] = set()
"""Laws that have passed, by name and source."""
_failed: dict[tuple[str, str, str], str] = {}
"""What is wrong with laws that have not, by name, source and parameters."""


def friction_specs(value: object) -> Iterator[Mapping[str, object]]:
    """Yield all friction models in plain data."""
    if isinstance(value, Mapping):
        for key, part in value.items():
            if key in ("friction", "frictions") and isinstance(part, Mapping):
                models = components_by_port(part).values() or [part]
                yield from (model for model in models if "name" in model)
            yield from friction_specs(part)
    elif isinstance(value, list | tuple):
        for part in value:
            yield from friction_specs(part)


def first_trial(spec: Mapping[str, object], registry: Registry) -> None:
    """Try a local law in another process until it has passed once; PluginError states what is wrong with it.

    That includes a law that never returns, or that ends its process. Laws of installed packages are trusted.
    """
    provider = registry.provider(FrictionModel.kind, str(spec["name"]))
    if provider.distribution != LOCAL:
        return
    tried, given = (str(spec["name"]), file_hash(provider.file)), json.dumps(dict(spec))
    if tried in _passed:
        return
    if (*tried, given) in _failed:
        raise PluginError(_failed[*tried, given])
    command = [sys.executable, "-m", __name__, str(provider.file.parent), given]
    done = subprocess.run(
        command, stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace", check=False
    )
    if done.returncode or not done.stdout.endswith(PASSED):  # a law may end its process without an error
        _failed[*tried, given] = _failure_text(done, tried[0], provider.file)
        raise PluginError(_failed[*tried, given])
    _passed.add(tried)


def _failure_text(done: "subprocess.CompletedProcess[str]", name: str, file: Path) -> str:
    """Return why the trial process failed: its own message, or where the law was when its time was up."""
    place = dumped_location(done.stderr.splitlines(), str(file))
    if place:
        found = f"the law of {name} ({place}) has not returned after {LAW_TIME_LIMIT_S + GRACE_S:g} s"
        return f"{found}; expected a force at once: fix what it calls"
    message = done.stderr.strip().splitlines()[-1:] if done.returncode == EXIT_LAW_IS_WRONG else []
    return (
        message[0] if message else f"the law of {name} ({file.name}) ended the process that tried it; expected a force"
    )


def main() -> None:
    """Try the law that the second argument describes as JSON; the first argument is its folder."""
    folder, spec = sys.argv[1:]
    with redirect_stdout(sys.stderr):  # what a plugin prints is no answer
        registry = discover(Path(folder))
        faulthandler.dump_traceback_later(LAW_TIME_LIMIT_S + GRACE_S, exit=True)
        try:
            _try_model(create(registry, FrictionModel, json.loads(spec)))
        except FraexpError as error:
            print(error, file=sys.stderr)
            sys.exit(EXIT_LAW_IS_WRONG)
        except Exception as error:
            print(f"the law of {json.loads(spec)['name']} fails: {reason_of(error)}", file=sys.stderr)
            sys.exit(EXIT_LAW_IS_WRONG)
    print(PASSED, end="")


def _try_model(model: FrictionModel) -> None:
    """Raise an error for what is wrong with a model: with its law, its properties, or the energy that it gives."""
    model.check_law()
    _check_arguments(model)
    _check_properties(model)
    faulthandler.dump_traceback_later(LAW_TIME_LIMIT_S + GRACE_S, exit=True)
    if "energy" not in model.expected_failures and isinstance(model.viscous, float | int):
        check_passivity(model.name, model.law, model.law_arguments(), model.state_size, float(model.viscous))


def _check_properties(model: FrictionModel) -> None:
    """Raise PluginError for a property that is no finite number, and for a stiffness that the law exceeds at rest."""
    subject = f"the law of {model.name} ({law_place(model.law)})"
    for name in ("viscous", "force_bound", "has_unique_periodic_force", "max_stiffness"):
        value = getattr(model, name)
        if value is not None and not (isinstance(value, Real | np.bool_) and np.isfinite(float(value))):
            raise PluginError(f"{subject} has a {name} of {value!r:.60}; expected a finite number")
        if getattr(model, name) != value:
            raise PluginError(f"{subject} has another {name} each time; expected one that follows from the parameters")
    slope = model.stiffness_in_step(NO_RATE_S)
    if "stiffness" not in model.expected_failures and slope > model.max_stiffness * (1 + SLOPE_TOLERANCE):
        found = (Quantity(slope, "N/m"), " at rest, and a max_stiffness of ", Quantity(model.max_stiffness, "N/m"))
        remedy = "; expected that no slope exceeds it (check 'stiffness')"
        raise PluginError(f"{subject} has a slope of ", *found, remedy)


def _check_arguments(model: FrictionModel) -> None:
    """Raise PluginError if the law's arguments are others when they are asked for again."""
    first, second = (repr(model.law_arguments()) for _ in range(2))
    if first != second:
        raise PluginError(
            f"the law of {model.name} gets other arguments each time: {first:.60}, then {second:.60}; expected "
            "attributes that follow from the parameters alone"
        )


if __name__ == "__main__":
    main()
