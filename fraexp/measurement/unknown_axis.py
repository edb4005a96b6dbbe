"""An axis of which only units, sample time and limits are known: what can be played on it, and how carefully."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fraexp.components.kinds import Excitation
from fraexp.components.measurement_settings import MeasurementSettings, ramp_out_samples
from fraexp.components.periods import Period, Schedule
from fraexp.components.ports import Ports, StateSpace
from fraexp.components.registry import Registry, create
from fraexp.data.identity import digest_of
from fraexp.measurement.measurement_plan import MeasurementPlan, PlannedPoint, joint_limits
from fraexp.measurement.tasks import MeasurementTask
from fraexp.simulation.discretisation import SignalPath, discretise
from fraexp.simulation.experiments import Experiment, ExperimentPlan, Setup
from fraexp.simulation.motion_limits import NO_DEMAND, MotionLimits

LATENCY_S = 0.02
"""Time in which any change of the control input shows in the position."""
SETTLING_TOLERANCE, SETTLING_TIMEOUT_S = 1e-3, 8.0
"""Relative change over a period from which a motion is periodic, and time after which the record begins anyway."""
RAMP_S, RAMP_PERIODS = 0.5, 2.0
"""Time over which an excitation rises, at least, and its periods: the guard then stops it in time."""
MIN_RECORD_S, RECORDED_PERIODS = 0.3, 2
"""Time and periods of a record."""
ATTEMPTS = 8
"""How often a point is played at most, each time with a lower amplitude."""
TOP_RATIO, PLANT_TOP_RATIO, TOP_HZ, LOWEST_HZ = 0.1, 0.25, 250.0, 1.0
"""Highest frequency over the sampling rate at which friction shows, that at which the plant does, highest and lowest
frequency [Hz]."""


@dataclass(frozen=True)
class UnknownAxis:
    """What a study says of an axis of which nothing else is known."""

    study: str
    """Name of the study."""
    title: str
    sample_time: float
    """Sample time [s]."""
    is_rotary: bool
    limits: MotionLimits
    """Limits of study and machine together."""
    settings: MeasurementSettings
    noise: float = 0.0
    """Standard deviation of the position at rest [m], which includes rounding."""

    @classmethod
    def from_sections(
        cls,
        study: str,
        title: str,
        loop: Mapping[str, Any],
        limits: MotionLimits,
        machine_limits: Mapping[str, float],
        settings: MeasurementSettings,
    ) -> "UnknownAxis":
        """Return the axis of a study's sections; StudyError if a limit is missing without which nothing is played."""
        careful = settings.model_copy(update={"band": None, "adapt_amplitude": True, "attempts": ATTEMPTS})
        joint = joint_limits(limits, machine_limits)
        return cls(study, title, float(loop["sample_time"]), bool(loop.get("rotary", False)), joint, careful)

    @property
    def top(self) -> float:
        """Highest frequency at which records show friction [Hz]: ten samples a period."""
        return min(TOP_RATIO / self.sample_time, TOP_HZ)

    @property
    def plant_top(self) -> float:
        """Highest frequency that is excited [Hz]."""
        return min(PLANT_TOP_RATIO / self.sample_time, TOP_HZ)

    @property
    def share(self) -> float:
        """Part of each limit that may be reached."""
        return 1 - self.settings.margin

    @property
    def ramp_out(self) -> int:
        """Samples in which an excitation falls to 0."""
        return ramp_out_samples(self.settings.ramp_out, self.sample_time)

    def task(self, estimators: Sequence[Mapping[str, Any]]) -> MeasurementTask:
        """Return the task of measuring it, whose records these estimators analyse."""
        loop = {"sample_time": self.sample_time, **({"rotary": True} if self.is_rotary else {})}
        experiment = {"source": "loop", "loop": loop}
        key = digest_of([experiment, self.limits.plain()]).hex()
        return MeasurementTask(
            self.study, self.title, "", experiment, key, self.limits, self.settings, tuple(map(dict, estimators))
        )

    def sines(self, frequencies: Sequence[float], registry: Registry) -> list[Period]:
        """Return a period of a sine of amplitude 1 at each frequency [Hz]."""
        spec = {"name": "stepped_sine", "amplitude": 1.0, "frequencies": [round(f, 4) for f in frequencies]}
        return list(create(registry, Excitation, spec).periods(self.sample_time))

    def multisine(self, lowest: float, highest: float, seed: int, registry: Registry) -> Period:
        """Return a period of a multisine of 1 N rms with random phases between two frequencies [Hz]."""
        spec = {
            "name": "multisine", "rms": 1.0, "min_frequency": lowest, "max_frequency": highest, "line_spacing": 1.0,
            "points": 12, "detection_group_size": 0, "seed": seed,
        }  # fmt: skip
        return create(registry, Excitation, spec).periods(self.sample_time)[0]

    def point(self, number: int, period: Period, amplitude: float) -> PlannedPoint:
        """Return a point of an amplitude [N] of which no motion is predicted."""
        cycle = period.waveform.size / int(period.lines[0]) * self.sample_time
        ramp = max(RAMP_S, RAMP_PERIODS * cycle)
        schedule = Schedule(ramp, SETTLING_TOLERANCE, ramp + SETTLING_TIMEOUT_S, RECORDED_PERIODS, MIN_RECORD_S)
        counts = ExperimentPlan.from_experiment(Experiment(self._setup(), period, schedule, number))
        settling = counts.ramp + 4 * counts.window
        return PlannedPoint(number, counts, settling, self.ramp_out, NO_DEMAND, amplitude, may_drift=True)

    def plan(self, task: MeasurementTask, points: Sequence[PlannedPoint]) -> MeasurementPlan:
        """Return the plan of points in their order."""
        return MeasurementPlan(task, tuple(points), self.limits, self.share)

    def _setup(self) -> Setup:
        """Return a free mass in place of the axis: settling is judged by sample time, latency and noise alone."""
        mass = StateSpace(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([0.0, 1.0]), np.array([1.0, 0.0]))
        path = SignalPath(0.0, ())
        discrete = discretise(
            Ports.from_state_space(mass),
            {"table": 0.0},
            [(np.zeros(1), np.ones(1))],
            sample_time=self.sample_time,
            steps=1,
            is_force_held=(False,),
            input_path=path,
            output_path=path,
        )
        return Setup(
            frictions={},
            positions=("y",),
            discrete=discrete,
            sample_time=self.sample_time,
            input_delay=0,
            output_delay=0,
            delay=LATENCY_S,
            noise_std=self.noise,
            divergence_limit=np.inf,
            is_vectorised=False,
        )
