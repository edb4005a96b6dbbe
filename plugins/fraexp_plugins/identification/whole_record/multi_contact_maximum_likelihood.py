"""Plant and friction of greatest likelihood for a machine with friction at several contacts."""

import numpy as np

from fraexp.api import (
    FrictionModel,
    ParameterError,
    Plant,
    PositionDependentFriction,
    ReplayModel,
    Result,
    Segment,
    Signals,
    param,
)
from fraexp_plugins.estimators._shared.delayed_estimator import DelayedEstimator
from fraexp_plugins.friction.none import Frictionless
from fraexp_plugins.identification._shared.usable_records import check_one_thrust, check_segments, usable_signals
from fraexp_plugins.identification.whole_record._fit_report import FitReport
from fraexp_plugins.identification.whole_record._fitted_records import LAST_GAIN, Fitted, replay_error
from fraexp_plugins.identification.whole_record._free_parameters import (
    FreeParameters,
    Models,
    parameters_of_contacts,
)
from fraexp_plugins.identification.whole_record._joint_fit import noise_in_records
from fraexp_plugins.identification.whole_record._record_fit import RecordFit, State
from fraexp_plugins.identification.whole_record._replayed_record import ReplayedRecord
from fraexp_plugins.identification.whole_record._staged_fit import (
    MAX_PARAMETER_STD,
    MAX_START_RATIO,
    REPLAY_TOLERANCE_RATIO,
)


class MultiContactMaximumLikelihood(DelayedEstimator, name="multi_contact_maximum_likelihood", version=3):
    """The plant's numbers, and the scales of friction at each contact, with which a simulation repeats all samples.

    It is `maximum_likelihood` for a machine with friction at several contacts. The response between one thrust and one
    position does not say how friction at another contact moves the machine. So the plant is one with ports whose
    numbers are estimated, `nominal_plant` being the start, and P̂ is its response: a mode that it lacks is not found,
    but shows in the residual. The one position that is fed back tells the scales of all contacts if the records have
    frequencies below and above the modes; below them all contacts move alike.

    The start must be near: friction, its viscous part included, and plant within some ten percent. There is one start;
    the verdict says if it did not lead to what the records say. Metrics are the factors on each contact's force and
    deflections, its viscous coefficient, and the numbers of the plant, with 95 % intervals; a parameter that the
    records do not tell is held at its start and named. A number that is 0 at the start stays 0. The band is that of the
    information in the likelihood, which is that of intervals (F. Gustafsson and R. Karlsson, Automatica 45(12), 2009).
    """

    frictions: dict[str, FrictionModel] = param("", "friction model of each contact at the start", inherit="friction")
    nominal_plant: Plant = param("", "plant at the start, whose numbers are estimated", inherit="plant")
    free: tuple[str, ...] = param(
        "",
        "what is estimated, such as motor.force_scale, motor.static_force or stiffness; scales and viscous coefficient "
        "of each contact and all numbers of the plant if not given",
        (),
    )
    thrust: str = param("", "thrust that is excited, as in the loop", "", inherit="loop.thrust")
    position: str = param("", "position that is fed back, as in the loop", "", inherit="loop.position")
    resolution: float = param("m", "quantisation step of the encoder", 0.0, at_least=0, inherit="loop.resolution")
    noise: float | None = param(
        "m",
        "standard deviation of the encoder's noise; from scatter or spectrum of the periods if it is not given",
        None,
        at_least=0,
        inherit="loop.noise",
    )
    interpolation_tolerance: float = param(
        "1", "relative error of y'/u that is tolerated", 1e-4, at_least=1e-5, at_most=0.1, inherit="numerics.tolerance"
    )

    def model_post_init(self, context: object) -> None:
        """Check that friction can be replayed."""
        for contact, model in self.frictions.items():
            if isinstance(model, PositionDependentFriction):
                raise ParameterError(
                    f"{self.name}.frictions.{contact} has a position_dependence, and a replay does not know where on "
                    "the stroke the record was; leave it out, or use multi_contact_effective_input"
                )

    def estimate(self, signals: Signals) -> Result:
        """Return P̂ with its band, the parameters of plant and friction, and how well they repeat the records."""
        signals.unit(self.input), signals.unit(self.output)
        if not signals.segments:
            return Result(signals.outcome, signals.message)
        check_one_thrust(signals, self.name)
        used = usable_signals(signals, self.output, self.name)
        check_segments(used, self.name)
        noise = noise_in_records(used, self.output, self.resolution) if self.noise is None else self.noise
        start = self._start(used.segments[0].sample_time)
        free, held = parameters_of_contacts(start, self.free), []
        found = self._fit(used, start, free, noise)
        while least_told := _least_told(found):  # one at a time: of two that only their sum is told, one remains
            held.append(least_told)
            free = free.leave_out(least_told)
            found = self._fit(used, start, free, noise)
        return FitReport(used, found, 1, held).result()

    def _start(self, sample_time: float) -> Models:
        """Return the machine at the start."""
        ports = self.nominal_plant.ports().closed_by(self.thrust, self.position)
        for contact in self.frictions:
            if contact not in ports.contacts:
                raise ParameterError(
                    f"{self.name}.frictions: the nominal plant has no contact '{contact}'; known: "
                    f"{', '.join(ports.contacts)}"
                )
        replay = ReplayModel(
            ports,
            {name: self.frictions.get(name, Frictionless()) for name in ports.contacts},
            sample_time,
            (self.input_dead_time, self.input_time_constants),
            (self.output_dead_time, self.output_time_constants),
            REPLAY_TOLERANCE_RATIO * self.interpolation_tolerance,
        )
        return Models(self.nominal_plant, replay, thrust=self.thrust, position=self.position)

    def _fit(self, signals: Signals, start: Models, free: FreeParameters, noise: float) -> Fitted:
        records = [self._record(segment) for segment in signals.segments]
        fit = RecordFit(records, start, free, self.resolution, noise, has_own_forces=False)
        state, linear = fit.converge(_unmoved(fit), LAST_GAIN)
        fit = fit.with_needed_drifts(state)
        state, linear = fit.converge(State(state.shared, _unmoved(fit).own), LAST_GAIN)
        return Fitted(fit, state, linear, replay_error(fit, state, linear))

    def _record(self, segment: Segment) -> ReplayedRecord:
        omega = 2 * np.pi * segment.frequency
        path = self.input_path(omega, segment.sample_time) * self.output_path(omega)
        return ReplayedRecord(segment, self.input, self.output, path)


def _unmoved(fit: RecordFit) -> State:
    """Return the state of a fit at its start."""
    return State(np.zeros(len(fit.free.names)), tuple(np.zeros(record.count) for record in fit.records))


def _least_told(found: Fitted) -> str:
    """Return the parameter that the records tell least, if they do not tell it and the model is right; else nothing."""
    count = len(found.fit.free.names)
    if found.mean_ratio > MAX_START_RATIO or not count:
        return ""
    std = np.sqrt(np.diag(found.covariances[0])[:count])
    place = int(np.argmax(std))
    return found.fit.free.names[place] if std[place] > MAX_PARAMETER_STD else ""
