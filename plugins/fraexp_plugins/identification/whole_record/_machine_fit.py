"""The fit of plant and friction to all records of an experiment, from starts along the measured motion."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Signals
from fraexp_plugins.identification.whole_record._fitted_records import (
    LAST_GAIN,
    MAX_PLANT_RATIO,
    Fitted,
    along_directions,
    evidence,
    replay_error,
    with_own_responses,
    without_plant,
)
from fraexp_plugins.identification.whole_record._free_parameters import FreeParameters, nonzero_numbers
from fraexp_plugins.identification.whole_record._machine_problem import MachineProblem, replayed_record
from fraexp_plugins.identification.whole_record._motion_fit import FRICTION_ERRORS, MotionFit, fits_along_motion
from fraexp_plugins.identification.whole_record._observed_response import ObservedStart
from fraexp_plugins.identification.whole_record._record_fit import MAX_STEPS, RecordFit, State
from fraexp_plugins.plants.modal import Modal

HOPELESS_RATIO, FIRST_STEPS = 10.0, 4
"""Residual over what noise and rounding explain, from which a start is given up after its first steps."""
NEAR_STEPS = 2 * MAX_STEPS
"""Steps from a start that is near: elements that share a force in ways that hardly differ take many."""
MAX_MODE_STD = 0.1
"""Relative standard deviation of a mode's numbers from which the plant may have one too many."""
MAX_START_RATIO = 1.3
"""Geometric mean of the residuals over what noise and rounding explain, up to which no other start is tried."""
MAX_PARAMETER_STD = 0.5
"""Relative standard deviation from which records do not tell a parameter."""
MAX_REFINEMENTS, REFINEMENT = 2, 3
"""How often the replay's steps are refined if they matter, and by which factor."""


def fit_machine(problem: MachineProblem, known: Fitted | None = None) -> tuple[Fitted, int]:
    """Return the fit to all records, and from how many starts it was tried.

    The response of each record is first that of the plant, whose numbers are estimated with those of friction. At last
    each record has a response of its own, unless friction acts at several contacts. `known` is a joint fit to other
    records of the same machine, from which it starts without a search.
    """
    joint, starts = joint_fit(problem) if known is None else (known, 1)
    every = replace(joint.fit, records=problem.records)
    every = every.with_needed_drifts(State(joint.state.shared, tuple(np.zeros(r.count) for r in every.records)))
    whole = _whole(problem, every, joint)
    for _ in range(MAX_REFINEMENTS):
        if whole.is_exact or whole.mean_ratio > MAX_PLANT_RATIO:
            break
        every = replace(every, start=whole.fit.start).with_more_steps(REFINEMENT)
        whole = _whole(problem, every, whole)
    return whole, starts


def joint_fit(problem: MachineProblem) -> tuple[Fitted, int]:
    """Return the fit in which the response of every record is that of the plant, and from how many starts."""
    if problem.contacts is not None:
        fit = problem.fit_around(problem.contacts.plant)
        return _converged(problem, fit, np.zeros(len(problem.free.names))), 1
    found: list[Fitted] = []
    for start in fits_along_motion(problem):
        found.append(joint_fit_from(problem, start))
        if found[-1].mean_ratio < MAX_START_RATIO:
            break
    return min(found, key=lambda each: each.mean_ratio), len(found)


def joint_fit_from(problem: MachineProblem, start: MotionFit) -> Fitted:
    """Return the joint fit from a fit along the motion."""
    fit = problem.fit_around(start.plant)
    first = _converged(problem, fit, start.shared, FIRST_STEPS)
    return first if first.mean_ratio > HOPELESS_RATIO else _converged(problem, fit, first.state.shared, NEAR_STEPS)


def predicted_ratios(problem: MachineProblem, found: Fitted, signals: Signals) -> NDArray[np.float64]:
    """Return what a joint fit leaves of other records, over what noise and rounding explain, shape (records,)."""
    records = [replayed_record(segment, problem.observer) for segment in signals.segments]
    return replace(found.fit, records=records).predicted_ratios(found.state.shared)


def least_told(found: Fitted) -> str:
    """Return which parameter the records tell least, of friction's or of several contacts'; empty if they tell all."""
    free = found.fit.free
    names = free.friction if found.models.has_one_contact else free.names
    if found.mean_ratio > MAX_START_RATIO or not names:
        return ""
    std = np.sqrt(np.diag(found.covariances[0])[: len(names)])
    place = int(np.argmax(std))
    return names[place] if std[place] > MAX_PARAMETER_STD else ""


def _whole(problem: MachineProblem, fit: RecordFit, before: Fitted) -> Fitted:
    """Return the fit of all records with a response for each, from a joint one."""
    steps = MAX_STEPS if before.mean_ratio < HOPELESS_RATIO else FIRST_STEPS
    joint = along_directions(_without_untold_modes(problem, _converged(problem, fit, before.state.shared, steps)))
    if problem.contacts is not None:
        return replace(joint, error=replay_error(joint.fit, joint.state, joint.linear))
    whole = with_own_responses(joint, steps)
    if whole.mean_ratio < MAX_PLANT_RATIO:
        return whole
    logs = before.state.shared[: len(problem.free.names)]
    effective = ObservedStart.of(problem.observer_at(logs), problem.signals).effective
    alone = without_plant(replace(fit, free=problem.free), logs, effective, steps)
    if alone.mean_ratio > whole.mean_ratio:
        return whole
    return replace(alone, error=replay_error(alone.fit, alone.state, alone.linear))


def _without_untold_modes(problem: MachineProblem, joint: Fitted) -> Fitted:
    """Return the joint fit without modes that the records do not tell.

    Noise looks like a mode to the observer where friction hides the plant. It then takes part of the rigid body's
    motion, so that friction's scales and the plant are known several times worse.
    """
    plant = joint.models.plant
    if not isinstance(plant, Modal) or problem.modes is not None or not joint.fit.free.plant:
        return joint
    count, std = len(plant.frequencies), np.sqrt(np.diag(joint.covariances[0])[len(problem.free.names) :])
    if not count or joint.mean_ratio > MAX_PLANT_RATIO or std.max(initial=0.0) < MAX_MODE_STD:
        return joint
    logs = joint.state.shared[: len(problem.free.names)]
    observed = ObservedStart.of(problem.observer_at(logs), problem.signals)
    plant, _ = observed.plant(problem.signals, problem.observer_at(logs), count - 1, FRICTION_ERRORS[0])
    simpler = _converged(problem, replace(joint.fit, start=joint.fit.start.with_plant(plant)), logs)
    return _without_untold_modes(problem, simpler) if evidence(simpler, joint) > 0 else joint


def _converged(
    problem: MachineProblem, fit: RecordFit, shared: NDArray[np.float64], max_steps: int = MAX_STEPS
) -> Fitted:
    """Return the fit in which every response is that of the plant."""
    free = problem.free
    if problem.contacts is None and problem.nominal_plant is None:
        free = FreeParameters(free.friction, nonzero_numbers(fit.start.plant))
    joint = replace(fit, free=free, has_own_forces=False)
    missing = np.zeros(len(free.names) - shared.size)
    state = State(np.append(shared, missing), tuple(np.zeros(record.count) for record in fit.records))
    return Fitted(joint, *joint.converge(state, LAST_GAIN, max_steps))
