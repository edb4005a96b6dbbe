"""Where a fit to whole records starts: effective inputs that the observer finds, and the plant in its response."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrequencyResponse, RecordError, Signals, phasors
from fraexp_plugins.estimators._shared.effective_input_observer import EFFECTIVE_INPUT
from fraexp_plugins.estimators._shared.realisations import Part, circular_covariance, combine_parts
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.identification.plant.modal_fit import ModalFit
from fraexp_plugins.plants.modal import Modal

PLANT_MODEL_ERROR = 1e-3
"""Relative error of the plant model that a fit allows for."""
MAX_FRICTION_RATIO, MIN_POINTS = 3.0, 8
"""Friction over effective input up to which a response is taken for the plant's, if that leaves as many points."""
MAX_RESPONSE_ERROR = 0.5
"""Relative error by friction up to which it is otherwise."""


@dataclass(frozen=True)
class ObservedStart:
    """What the observer finds with one friction model."""

    effective: tuple[NDArray[np.complex128], ...]
    """Effective input of each segment [N], mean over periods, shape (lines,) each."""
    friction: tuple[NDArray[np.complex128], ...]
    """Friction force likewise [N]."""

    @classmethod
    def of(cls, observer: EffectiveInput, signals: Signals) -> "ObservedStart":
        """Return what an observer finds along signals."""
        effective = tuple(each.mean(axis=0) for each in observer.effective_phasors(signals.segments))
        friction = tuple(each.mean(axis=0) for each in observer.friction_phasors(signals.segments))
        return cls(effective, friction)

    @property
    def friction_ratios(self) -> NDArray[np.float64]:
        """Friction force over effective input at all lines, shape (n,)."""
        return np.abs(np.concatenate(self.friction)) / np.maximum(np.abs(np.concatenate(self.effective)), 1e-300)

    def places_by_friction(self) -> list[int]:
        """Return the places of the segments, those with the least friction first."""
        ends = np.cumsum([each.size for each in self.effective])[:-1]
        ratios = [float(each.mean()) for each in np.split(self.friction_ratios, ends)]
        return [int(place) for place in np.argsort(ratios, kind="stable")]

    def plant(
        self,
        signals: Signals,
        observer: EffectiveInput,
        modes: int | None,
        friction_error: float,
        has_dead_time: bool = False,
    ) -> tuple[Modal, float]:
        """Return the modal plant in the observer's response, if friction may be wrong by this share, and a dead time.

        Where the response supports no modes it is a rigid body. The dead time [s] is 0 unless it may have one.
        """
        found = self._response(signals, observer)
        error = friction_error * self.friction_ratios
        covariance = circular_covariance(np.abs(found.response) ** 2 * (error**2 + PLANT_MODEL_ERROR**2))
        settled = found.settled & (self.friction_ratios < MAX_FRICTION_RATIO)
        if settled.sum() < MIN_POINTS:
            settled = found.settled & (error < MAX_RESPONSE_ERROR)
        if settled.sum() < 2:
            settled = found.settled
        return plant_in(replace(found, covariance=covariance, settled=settled), modes, has_dead_time)

    def _response(self, signals: Signals, observer: EffectiveInput) -> FrequencyResponse:
        """Return y'/û_e, each segment for itself: their amplitudes may differ."""
        parts = []
        for segment, effective in zip(signals.segments, self.effective, strict=True):
            output = phasors(segment, observer.output).mean(axis=0)
            unknown = np.full((output.size, 2, 2), np.nan)
            amplitudes = np.abs(effective), np.abs(output)
            parts.append(Part((segment,), segment.frequency, output / effective, unknown, np.inf, *amplitudes))
        units = signals.unit(observer.input), signals.unit(observer.output)
        found = combine_parts(signals, parts, names=(EFFECTIVE_INPUT, observer.output), units=units)
        assert found.response is not None
        return found.response


def plant_in(response: FrequencyResponse, modes: int | None, has_dead_time: bool) -> tuple[Modal, float]:
    """Return the modal plant in a response with a band, and its dead time [s]; where it supports none, a rigid body."""
    dead_time = None if has_dead_time else 0.0
    modal = ModalFit(method=Conventional(), modes=modes, dead_time=dead_time, model_error=PLANT_MODEL_ERROR)
    try:
        with np.errstate(all="ignore"):  # of a wrong friction model
            (fit,) = modal.fit_response(response).fits
    except RecordError:
        gains = np.abs(response.response) * (2 * np.pi * response.frequency) ** 2
        return Modal(rigid_body_gain=float(np.median(gains[response.settled]))), 0.0
    spec = {key: value for key, value in fit.component.items() if key not in ("name", "version")}
    return Modal.parse(spec, "plant"), float(fit.values[fit.parameters.index("dead_time")])


def spread_places(count: int, chosen: int) -> list[int]:
    """Return `chosen` places, or all if there are fewer, spread over `count`."""
    return sorted({round(place) for place in np.linspace(0, count - 1, min(chosen, count))})


def union_of(places: Sequence[int], others: Sequence[int]) -> list[int]:
    """Return all places of both, ascending."""
    return sorted({*places, *others})
