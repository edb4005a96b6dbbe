"""The fit of plant and friction to records of a machine with friction at several contacts, from one start."""

from collections.abc import Mapping, Sequence

import numpy as np

from fraexp.api import FrictionModel, ParameterError, Plant, ReplayModel, Signals
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.friction.none import Frictionless
from fraexp_plugins.identification.whole_record._fit_report import FitReport
from fraexp_plugins.identification.whole_record._fitted_records import LAST_GAIN, Fitted, replay_error
from fraexp_plugins.identification.whole_record._free_parameters import FreeParameters, Models, parameters_of_contacts
from fraexp_plugins.identification.whole_record._record_fit import RecordFit, State
from fraexp_plugins.identification.whole_record._staged_fit import (
    MAX_PARAMETER_STD,
    MAX_START_RATIO,
    REPLAY_TOLERANCE_RATIO,
    replayed_record,
)


def fit_contacts(signals: Signals, start: Models, chosen: Sequence[str], observer: EffectiveInput) -> FitReport:
    """Return the fit of the chosen parameters, or of all by default, without those that the records do not tell."""
    free, held = parameters_of_contacts(start, chosen), list[str]()
    found = _fit(signals, start, free, observer)
    while least_told := _least_told(found):  # one at a time: of two that only their sum is told, one remains
        held.append(least_told)
        free = free.leave_out(least_told)
        found = _fit(signals, start, free, observer)
    return FitReport(signals, found, 1, held)


def machine_of_contacts(
    plant: Plant,
    frictions: Mapping[str, FrictionModel],
    ports: tuple[str, str],
    observer: EffectiveInput,
    sample_time: float,
) -> Models:
    """Return a machine with friction at its contacts, excited by a thrust, whose position [m] is compared."""
    closed = plant.ports().closed_by(*ports)
    for contact in frictions:
        if contact not in closed.contacts:
            raise ParameterError(
                f"maximum_likelihood.frictions: the nominal plant has no contact '{contact}'; known: "
                f"{', '.join(closed.contacts)}"
            )
    replay = ReplayModel(
        closed,
        {name: frictions.get(name, Frictionless()) for name in closed.contacts},
        sample_time,
        (observer.input_dead_time, observer.input_time_constants),
        (observer.output_dead_time, observer.output_time_constants),
        REPLAY_TOLERANCE_RATIO * observer.interpolation_tolerance,
    )
    return Models(plant, replay, thrust=ports[0], position=ports[1])


def _fit(signals: Signals, start: Models, free: FreeParameters, observer: EffectiveInput) -> Fitted:
    records = [replayed_record(segment, observer) for segment in signals.segments]
    fit = RecordFit(records, start, free, observer.resolution, observer.noise, has_own_forces=False)
    state, linear = fit.converge(_unmoved(fit), LAST_GAIN)
    fit = fit.with_needed_drifts(state)
    state, linear = fit.converge(State(state.shared, _unmoved(fit).own), LAST_GAIN)
    return Fitted(fit, state, linear, replay_error(fit, state, linear))


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
