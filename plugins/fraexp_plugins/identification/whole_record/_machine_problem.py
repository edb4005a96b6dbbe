"""What a fit of plant and friction to records is given: the records, the machine at the start, and what is free."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrictionModel, ParameterError, Plant, ReplayModel, Segment, Signals
from fraexp_plugins.estimators._shared.parameter_uncertainty import parameter_value, with_parameter
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.friction.none import Frictionless
from fraexp_plugins.identification.whole_record._free_parameters import (
    DEAD_TIME,
    DISPLACEMENT_SCALE,
    FORCE_SCALE,
    SCALES,
    FreeParameters,
    Models,
)
from fraexp_plugins.identification.whole_record._record_fit import RecordFit
from fraexp_plugins.identification.whole_record._replayed_record import ReplayedRecord

REPLAY_TOLERANCE_RATIO = 0.1
"""Tolerance of the replay over that of y'/u: û_e may be a small part of the input."""


@dataclass(frozen=True)
class MachineProblem:
    """Records of a machine with friction at one contact, whose plant may be unknown, or at several."""

    signals: Signals
    observer: EffectiveInput
    """The friction model at the start, the delays and the encoder."""
    free: FreeParameters
    nominal_plant: Plant | None
    modes: int | None
    contacts: Models | None = None
    """The machine at the start if friction acts at several contacts."""

    @property
    def sample_time(self) -> float:
        """Sample time of all records [s]."""
        return self.signals.segments[0].sample_time

    @property
    def records(self) -> list[ReplayedRecord]:
        """The records."""
        return [replayed_record(segment, self.observer) for segment in self.signals.segments]

    def fit_around(self, plant: Plant) -> RecordFit:
        """Return the fit of all records to a machine with this plant and the friction at the start."""
        start = self.contacts or machine(plant, {}, ("", ""), self.observer, self.sample_time)
        return RecordFit(self.records, start, self.free, self.observer.resolution, self.observer.noise)

    def observer_at(self, logs: NDArray[np.float64]) -> EffectiveInput:
        """Return the observer with these parameters of friction."""
        force, displacement = self.free.scales(logs)
        friction = self.observer.law
        for name, factor in zip(self.free.friction, np.exp(logs), strict=False):
            if name not in (*SCALES, DEAD_TIME):
                friction = with_parameter(friction, name, parameter_value(friction, name) * float(factor))
        dead_time = max(self.observer.input_dead_time + self.free.dead_time(logs, self.sample_time), 0.0)
        changed = {
            "friction": friction, FORCE_SCALE: force, DISPLACEMENT_SCALE: displacement, DEAD_TIME: dead_time
        }  # fmt: skip
        return self.observer.model_copy(update=changed).resolve_oversampling(self.signals.segments)

    def leave_out(self, name: str) -> "MachineProblem":
        """Return the problem in which a parameter stays as it is at the start."""
        return replace(self, free=self.free.leave_out(name))


def machine(
    plant: Plant,
    frictions: Mapping[str, FrictionModel],
    ports: tuple[str, str],
    observer: EffectiveInput,
    sample_time: float,
) -> Models:
    """Return a machine with friction at its contacts, excited by a thrust, whose position [m] is compared.

    Without friction of its own the one contact has that of the observer.
    """
    closed = plant.ports().closed_by(*ports) if frictions else plant.ports()
    for contact in frictions:
        if contact not in closed.contacts:
            raise ParameterError(
                f"maximum_likelihood.frictions: the nominal plant has no contact '{contact}'; known: "
                f"{', '.join(closed.contacts)}"
            )
    default = Frictionless() if frictions else observer.law
    replay = ReplayModel(
        closed,
        {name: frictions.get(name, default) for name in closed.contacts},
        sample_time,
        (observer.input_dead_time, observer.input_time_constants),
        (observer.output_dead_time, observer.output_time_constants),
        REPLAY_TOLERANCE_RATIO * observer.interpolation_tolerance,
    )
    return Models(plant, replay, thrust=ports[0], position=ports[1])


def replayed_record(segment: Segment, observer: EffectiveInput) -> ReplayedRecord:
    """Return a record with the delays around the plant that an observer has."""
    omega = 2 * np.pi * segment.frequency
    path = observer.input_path(omega, segment.sample_time) * observer.output_path(omega)
    return ReplayedRecord(segment, observer.input, observer.output, path)
