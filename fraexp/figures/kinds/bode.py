"""The Bode plot: magnitude and phase of frequency responses over frequency, with 95 % bands."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.confidence import confidence_limits
from fraexp.data.results import Curve, FrequencyResponse
from fraexp.errors import FraexpError
from fraexp.figures.elements.asymptotes import Spring, spring_line
from fraexp.figures.elements.branches import continuous_phases
from fraexp.figures.elements.bundles import Bundle, stack_padded
from fraexp.figures.elements.frequency_lines import with_gaps
from fraexp.figures.elements.grouping import CurvePlace, point_indices
from fraexp.figures.elements.scales import (
    continuous_phase,
    decibel,
    decibel_limits,
    degree_limits,
    degrees,
    readable_unit,
)
from fraexp.figures.elements.view import wrap_phase

Reference = tuple[str, NDArray[np.float64], NDArray[np.complex128]]
"""Label, frequency [Hz] and complex response, both of shape (n,), in the unit of the curves."""


@dataclass(frozen=True)
class BodeCurve:
    """A response as it is drawn in a Bode plot, in ascending frequency."""

    label: str
    frequency: NDArray[np.float64]
    """Frequency [Hz], shape (n,)."""
    magnitude: NDArray[np.float64]
    """Magnitude [dB], shape (n,)."""
    phase: NDArray[np.float64]
    """Continuous phase [deg], shape (n,)."""
    settled: NDArray[np.bool_]
    """Whether the point had settled, shape (n,); lines join settled points only."""
    magnitude_band: NDArray[np.float64]
    """Lower and upper 95 % limit of the magnitude [dB], shape (2, n); NaN where unknown; may be infinite."""
    phase_band: NDArray[np.float64]
    """Lower and upper 95 % limit of the phase [deg], shape (2, n); NaN where unknown."""
    model: "BodeModel | None" = None
    """The plant that was fitted to it; None without a fit."""

    def with_gaps(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return values of shape (..., n) with NaN, a gap in the line, where the response was not settled."""
        return with_gaps(values, self.settled)


@dataclass(frozen=True)
class BodeModel:
    """A fitted plant as it is drawn in a Bode plot, over the frequency range of the fit."""

    frequency: NDArray[np.float64]
    """Frequency [Hz], shape (n,)."""
    magnitude: NDArray[np.float64]
    """Magnitude [dB], shape (n,)."""
    phase: NDArray[np.float64]
    """Phase [deg] on the branch of the response, shape (n,); NaN if only the magnitude was fitted."""
    extremum: NDArray[np.float64]
    """1 at a resonance, -1 at an antiresonance, otherwise 0, shape (n,)."""
    rigid_body: NDArray[np.float64]
    """Magnitude of the rigid body alone [dB], the line of its apparent mass, shape (n,); NaN if it is unknown."""
    rigid_body_gain: float = np.nan
    """Its gain k0 = 1/M [unit of the response/s²]; NaN if it is unknown."""
    spring: Spring | None = None
    """The stiffness that the response shows below; None if it shows none."""
    spring_level: float = np.nan
    """Magnitude of that spring [dB]."""

    @property
    def has_phase(self) -> bool:
        """Whether the phase was fitted too."""
        return not np.isnan(self.phase).all()


@dataclass(frozen=True)
class BodeSample:
    """Random draws at one point of the grid as they are drawn in a Bode plot, each a row, all of shape (m, n).

    The frequencies ascend; the rows of responses with fewer points than others end in NaN.
    """

    label: str
    """Name of its group; empty if there is one."""
    noun: str
    """What its rows are, such as a draw."""
    frequency: NDArray[np.float64]
    """Frequency [Hz]."""
    magnitude: NDArray[np.float64]
    """Magnitude [dB]."""
    phase: NDArray[np.float64]
    """Continuous phase [deg]."""
    settled: NDArray[np.bool_]
    """Whether the point had settled; lines join settled points only."""

    def bundle(self, values: NDArray[np.float64]) -> Bundle:
        """Return values of shape (m, n) as a bundle with gaps where the responses were not settled."""
        return Bundle(self.label, self.frequency, np.where(self.settled, values, np.nan), self.noun)


@dataclass(frozen=True)
class BodeInfo:
    """Contents of a Bode plot: a curve for each response, and a sample where random draws share a point of the grid."""

    curves: tuple[BodeCurve, ...]
    samples: tuple[BodeSample, ...]
    reference: BodeCurve | None
    unit: str
    """Unit that is 0 dB, such as ``mm/N``."""
    title: str
    source_unit: str = ""
    """Unit of the responses, such as ``m/N``."""


class PhaseBranch(NamedTuple):
    """The continuous phase of a response."""

    frequency: NDArray[np.float64]
    """Ascending frequency [Hz], shape (n,)."""
    phase: NDArray[np.float64]
    """Phase [deg], shape (n,)."""
    settled: NDArray[np.bool_]
    """Whether the point had settled, shape (n,)."""


PhaseAnchor = BodeCurve | PhaseBranch
"""What has the phase on whose branch others lie."""


def bode_info(
    curves: Sequence[tuple[str, FrequencyResponse]],
    reference: Reference | None = None,
    title: str = "",
    places: Sequence[CurvePlace] = (),
    fitted: Sequence[Curve | None] = (),
    wrapped: bool = False,
) -> BodeInfo:
    """Return the numbers of a Bode plot of labelled responses; FraexpError if their units differ.

    The phases lie on the branch nearest to the reference, or without one to the first curve. Responses with the same
    point in their `places` are a sample; without places each is a curve. `fitted` are the plants that were fitted to
    the responses (see `ShownResult.fitted`), which are drawn with curves. `wrapped` phases lie within ±180°.
    """
    unit = _common_unit(curves)
    factor, shown = readable_unit(unit)
    drawn_reference = _reference_curve(reference, factor) if reference else None
    heading = title or _default_title(curves)
    known = [index for index, (_, of) in enumerate(curves) if len(of.frequency)]
    points = point_indices([places[index] for index in known]) if places else {}
    indices = [[known[at] for at in of] for of in points.values()] or [[index] for index in range(len(curves))]
    models = fitted or [None] * len(curves)
    singles = [of[0] for of in indices if len(of) == 1]
    anchor, drawn = drawn_reference or _first_branch(curves), []
    for (label, response), model in ((curves[index], models[index]) for index in singles):
        curve = _bode_curve(label, response, factor, anchor)
        drawn.append(replace(curve, model=_bode_model(model, factor, curve, response)) if model else curve)
    samples = tuple(
        _bode_sample([curves[index][1] for index in of], places[of[0]], factor, anchor) for of in indices if len(of) > 1
    )
    return _wrap_phase(BodeInfo(tuple(drawn), samples, drawn_reference, shown, heading, unit), wrapped)


def _first_branch(curves: Sequence[tuple[str, FrequencyResponse]]) -> PhaseBranch | None:
    """Return the phase of the first response, on whose branch those of the others lie."""
    first = next((of for _, of in curves if of.settled.any()), None)
    return _phase_branch(first, None) if first is not None else None


def _phase_branch(source: FrequencyResponse, anchor: PhaseAnchor | None) -> PhaseBranch:
    order = np.argsort(source.frequency, kind="stable")
    frequency, settled = source.frequency[order], source.settled[order]
    target = _phase_at(anchor, frequency) if anchor else None
    return PhaseBranch(frequency, continuous_phase(degrees(source.response[order]), settled, target), settled)


def _wrap_phase(info: BodeInfo, wanted: bool) -> BodeInfo:
    if not wanted:
        return info
    samples = tuple(replace(of, phase=wrap_phase(of.phase)) for of in info.samples)
    reference = _wrapped_curve(info.reference) if info.reference else None
    return replace(info, curves=tuple(map(_wrapped_curve, info.curves)), samples=samples, reference=reference)


def _wrapped_curve(of: BodeCurve) -> BodeCurve:
    phase = wrap_phase(of.phase)
    model = replace(of.model, phase=wrap_phase(of.model.phase)) if of.model else None
    return replace(of, phase=phase, phase_band=of.phase_band + (phase - of.phase), model=model)


def _common_unit(curves: Sequence[tuple[str, FrequencyResponse]]) -> str:
    units = sorted({response.unit for _, response in curves})
    if len(units) != 1:
        found = " and ".join(units) or "nothing"
        raise FraexpError(f"Bode plot: found responses in {found}; curves of one plot share a unit")
    return units[0]


def _default_title(curves: Sequence[tuple[str, FrequencyResponse]]) -> str:
    paths = list(dict.fromkeys(f"{response.output}/{response.input}" for _, response in curves))
    return f"Frequency response {' and '.join(paths)}"


def _reference_curve(reference: Reference, factor: float) -> BodeCurve:
    label, frequency, response = reference
    order = np.argsort(frequency)
    everywhere, unknown = np.ones(len(order), dtype=bool), np.full((2, len(order)), np.nan)
    phase = continuous_phase(degrees(response[order]), everywhere)
    return BodeCurve(label, frequency[order], decibel(factor * response[order]), phase, everywhere, unknown, unknown)


def _bode_curve(label: str, source: FrequencyResponse, factor: float, anchor: PhaseAnchor | None) -> BodeCurve:
    order = np.argsort(source.frequency, kind="stable")
    frequency, phase, settled = _phase_branch(source, anchor)
    band, turn = (each[:, order] for each in confidence_limits(source))
    magnitude = decibel(factor * source.response[order])
    return BodeCurve(
        label, frequency, magnitude, phase, settled, magnitude + decibel_limits(band), phase + degree_limits(turn)
    )  # fmt: skip


def _bode_model(of: Curve, factor: float, anchor: BodeCurve, source: FrequencyResponse) -> BodeModel:
    frequency = of.columns["frequency"]
    phase = of.columns.get("phase", np.full(len(frequency), np.nan))
    phase = continuous_phase(phase, np.ones(len(frequency), dtype=bool), _phase_at(anchor, frequency))
    rigid_body = of.columns.get("rigid body", np.full(len(frequency), np.nan))
    extremum = of.columns.get("extremum", np.zeros(len(frequency)))
    gain = float(rigid_body[0] * (2 * np.pi * frequency[0]) ** 2)
    spring = spring_line(source, gain)
    return BodeModel(
        frequency,
        decibel(factor * of.columns["magnitude"]),
        phase,
        extremum,
        decibel(factor * rigid_body),
        gain,
        spring,
        float(decibel(np.array([factor * spring.magnitude]))[0]) if spring else np.nan,
    )


def _bode_sample(
    responses: Sequence[FrequencyResponse], place: CurvePlace, factor: float, anchor: PhaseAnchor | None
) -> BodeSample:
    orders = [np.argsort(of.frequency, kind="stable") for of in responses]
    pairs = list(zip(responses, orders, strict=True))
    frequency = stack_padded([of.frequency[order] for of, order in pairs])
    response = stack_padded([of.response[order] for of, order in pairs])
    settled = stack_padded([of.settled[order] for of, order in pairs], missing=False)
    target = _phase_at(anchor, frequency) if anchor else None
    phase = continuous_phases(degrees(response), settled, target)
    return BodeSample(place.group, place.sample, frequency, decibel(factor * response), phase, settled)


def _phase_at(anchor: PhaseAnchor, frequency: NDArray[np.float64]) -> NDArray[np.float64] | None:
    usable = anchor.settled & np.isfinite(anchor.phase)
    if not usable.any():
        return None
    phase: NDArray[np.float64] = np.interp(np.log(frequency), np.log(anchor.frequency[usable]), anchor.phase[usable])
    return phase
