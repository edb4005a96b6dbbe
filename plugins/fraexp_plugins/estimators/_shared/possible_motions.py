"""Which motions could have given the samples of a periodic record, and what each of them makes of the response.

Motions are drawn from the posterior of the measured one, and pushed through friction. The force along them, less that
along the motion that the observer took, is the error of its force: the mean moves the response, the scatter is its
band. Where friction and plant make terms likely that noise hides, they are part of that posterior.
"""

import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrequencyResponse, Motion, Segment, Signals, fourier_sums, path_response, phasors
from fraexp_plugins.estimators._shared.contacts import ContactForces, ContactFriction
from fraexp_plugins.estimators._shared.effective_input_observer import RUNS_AT_ONCE, ObserverEstimator
from fraexp_plugins.estimators._shared.friction_posterior import ForceErrors, MotionErrors, harmonic_lines
from fraexp_plugins.estimators._shared.measured_motion import MeasuredMotion
from fraexp_plugins.estimators._shared.plant_above_modes import Harmonics, PlantAboveModes, fit_above_modes

DRAWS = 32
"""Motions that are drawn of each measured position. Half of them, 15 degrees of freedom, make bands 5 % wider."""
MAX_POINTS = 1024
"""Points of a period at which a friction model is driven along drawn motions: most of their own errors cancel."""
FINER = 8
"""Factor by which the motion that the observer took is interpolated more finely."""


def likely_motions(
    observer: ObserverEstimator, segments: Sequence[Segment], guess: PlantAboveModes
) -> tuple[PlantAboveModes, list[MeasuredMotion]]:
    """Return the plant above its modes, and the motion in each segment with what it and friction make likely of it.

    Where nothing is excited, and not at rest, the friction force alone causes the motion.
    """
    measured = [MeasuredMotion.of(segment, observer.output, observer.encoder) for segment in segments]
    driving = [
        motions_of(observer, segment, np.where(each.is_clear, each.terms, 0)[None], each.duration)[0]
        for segment, each in zip(segments, measured, strict=True)
    ]
    caused = []
    for force, each in zip(observer.forces_along(driving), measured, strict=True):
        own = np.fft.rfft(force)[: each.terms.size] / force.size * observer.force_factor(each.omega)
        own[each.lines], own[0] = 0, 0
        caused.append(own)
    plant = fit_above_modes([Harmonics.of(*pair) for pair in zip(measured, caused, strict=True)], guess)
    likely = [plant.likely_terms(each.omega, force) for each, force in zip(measured, caused, strict=True)]
    pairs = zip(segments, likely, strict=True)
    return plant, [MeasuredMotion.of(segment, observer.output, observer.encoder, own) for segment, own in pairs]


def draw_motions(motion: MeasuredMotion, seed: int) -> NDArray[np.complex128]:
    """Return motions that could have been, shape (draws, terms).

    The first number of each draw, of the term that is constant, is the error of the plant: what it predicts errs alike
    at all terms.
    """
    normal = np.random.default_rng(seed).standard_normal((DRAWS, 2 * motion.terms.size)).view(complex) * np.sqrt(0.5)
    normal -= np.add.reduce(normal) / DRAWS  # their mean is then free of the noise that merely passes through
    spread, predicted = np.sqrt(motion.share * motion.variance) * normal, ~np.isnan(motion.likely.deviation)
    mean, size, share = motion.likely.mean[predicted], motion.likely.deviation[predicted], motion.share[predicted]
    common = (1 - share) * size * mean / np.abs(mean) * normal[:, :1]
    spread[:, predicted] = common + share * np.sqrt(motion.variance) * normal[:, predicted]
    spread[:, 0] = 0
    return np.asarray(motion.posterior + spread)


class _DrawnMotion(NamedTuple):
    """What could have been measured in a segment, by the channels of positions."""

    segment: Segment
    lines: NDArray[np.int64]
    """Terms that are excited, and of a sine their multiples, shape (lines,)."""
    measured: Mapping[str, MeasuredMotion]
    changes: Mapping[str, NDArray[np.complex128]]
    """Drawn motions, and the clear terms, less the motion that the observer took [m], shape (draws + 1, terms)."""

    def of_contact(self, contact: ContactFriction) -> tuple[MeasuredMotion, NDArray[np.complex128]]:
        """Return the measured motion of a contact, and its changes [m], shape (draws + 1, terms)."""
        observer = contact.observer
        own = self.measured.get(observer.output) or MeasuredMotion.of(self.segment, observer.output, observer.encoder)
        change = np.zeros((DRAWS + 1, own.terms.size), dtype=complex)
        for channel, ratio in contact.position_ratios.items():
            change[:, 1:] += ratio(own.omega[1:]) * self.changes[channel][:, 1:]
        return own, change


def draw_errors(forces: ContactForces, output: str, known: Sequence[MeasuredMotion] | None) -> Iterator[MotionErrors]:
    """Yield the errors by the motions that each segment could have made, at its lines; of a sine also at its harmonics.

    How much of the terms that noise partly hides is motion is a guess: what they change of the force is one more
    deviation. The motions of the output may be known already. Those of several segments are run side by side.
    """
    everything = range(len(forces.signals.segments))
    for begin in everything[::RUNS_AT_ONCE]:
        numbers = everything[begin : begin + RUNS_AT_ONCE]
        drawn = [_drawn_motion(forces, number, output, known[number] if known else None) for number in numbers]
        thrusts = [_force_errors(contact, numbers, drawn) for contact in forces.contacts]
        for each, *force in zip(drawn, *thrusts, strict=True):
            moved, pushed = 2 * each.changes[output][:, each.lines], np.add.reduce(force)
            mean = ForceErrors(*(np.add.reduce(part[:DRAWS]) / DRAWS for part in (moved, pushed)))
            own, other = (
                (part[:DRAWS] - of) / np.sqrt(DRAWS - 1) for part, of in zip((moved, pushed), mean, strict=True)
            )
            guess = mean.force - pushed[DRAWS:]
            motion = 2 * each.measured[output].taken[each.lines] + mean.output
            yield MotionErrors(motion, mean, ForceErrors(np.vstack([own, 0 * guess]), np.vstack([other, guess])))


def _drawn_motion(forces: ContactForces, number: int, output: str, known: MeasuredMotion | None) -> _DrawnMotion:
    segment, encoder = forces.signals.segments[number], forces.contacts[0].observer.encoder
    channels = {output} | {channel for contact in forces.contacts for channel in contact.position_ratios}
    measured = {channel: MeasuredMotion.of(segment, channel, encoder) for channel in sorted(channels - {output})}
    measured[output] = known or MeasuredMotion.of(segment, output, encoder)
    changes = {}
    for channel, motion in measured.items():
        drawn = draw_motions(motion, zlib.crc32(segment.channels[channel].tobytes()))
        changes[channel] = np.vstack([drawn, np.where(motion.is_clear, motion.terms, 0)]) - motion.taken
    lines = harmonic_lines(segment) if segment.lines.size == 1 else segment.lines
    return _DrawnMotion(segment, lines // np.gcd.reduce(segment.lines), measured, changes)


def _force_errors(
    contact: ContactFriction, numbers: Sequence[int], drawn: Sequence[_DrawnMotion]
) -> list[NDArray[np.complex128]]:
    """Return the errors of a contact's friction as thrust [N] along the motions that are possible, (draws + 1, lines).

    The force along the motion that the observer took is found more finely, too.
    """
    observer, found, driving = contact.observer, [], []
    moved = [each.of_contact(contact) for each in drawn]
    for (segment, *_), (own, change) in zip(drawn, moved, strict=True):
        driving += motions_of(observer, segment, np.vstack([own.taken, own.taken + change]), own.duration)
        driving += motions_of(observer, segment, own.taken[None], own.duration, FINER)
    forces = iter(observer.forces_along(driving))
    for number, (segment, lines, *_), (own, change) in zip(numbers, drawn, moved, strict=True):
        at_lines, recorded = own.omega[lines], lines * np.gcd.reduce(segment.lines)
        sums = fourier_sums(np.stack([next(forces) for _ in range(DRAWS + 2)]), lines)
        coarse = np.add.reduce(contact.forces[number]) / len(contact.forces[number])
        sums[1:] += fourier_sums(next(forces)[None], lines) - fourier_sums(coarse[None], recorded)
        error = (sums[1:] - sums[0]) * observer.force_factor(at_lines)
        error += 2j * at_lines * observer.law.viscous * change[:, lines]
        found.append(np.asarray(contact.thrust_ratio(at_lines) * error))
    return found


def motions_of(
    observer: ObserverEstimator, segment: Segment, terms: NDArray[np.complex128], duration: float, finer: int = 1
) -> list[Motion]:
    """Return motions of such Fourier coefficients, shape (motions, terms), and period [s].

    A single one is as exact as the observer's own, or finer. Several are there to be compared with each other.
    """
    points, before = int(np.ceil(finer * observer.points(segment) * duration / segment.sample_time)), np.empty(0)
    if len(terms) > 1:
        points = min(points, max(MAX_POINTS, 2 * terms.shape[1]))
    else:
        before = observer.lead_in(segment)
    bins = terms / path_response(2 * np.pi / duration * np.arange(terms.shape[1]), 0.0, observer.output_time_constants)
    motions = np.fft.irfft(bins, points) * (points / observer.displacement_scale)
    return [Motion(x, duration / points, True, before, segment.sample_time) for x in motions]


def with_possible_motions(
    response: FrequencyResponse,
    signals: Signals,
    output: str,
    errors: Sequence[MotionErrors],
    unsampled: Sequence[ForceErrors] | None,
) -> FrequencyResponse:
    """Return a response that is moved by the mean error of all motions that are possible, with their scatter as band.

    What lies between the samples in each segment, `unsampled`, is part of the band. Where the periods scatter more than
    noise and rounding explain, the band is as wide as their scatter: something else disturbs the machine.
    """
    ratios, vectors, begin = [], [], 0
    for number, (segment, own) in enumerate(zip(signals.segments, errors, strict=True)):
        measured, count = phasors(segment, output), segment.lines.size
        y, (_, mean, deviations) = np.add.reduce(measured) / len(measured), own
        with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
            effective = y / response.response[begin : begin + count] - mean.force[:count]
            ratio = (y + mean.output[:count]) / effective
            rows = (deviations.output[:, :count] + ratio * deviations.force[:, :count]) / effective
            if unsampled is not None:
                hidden = (unsampled[number].output + ratio * unsampled[number].force) / effective
                ratio, rows = ratio - hidden, np.vstack([rows, hidden])
        begin += count
        ratios.append(ratio)
        vectors.append(rows)
    return _with_error_vectors(response, np.concatenate(ratios), np.concatenate(vectors, axis=1))


def _with_error_vectors(
    response: FrequencyResponse, ratio: NDArray[np.complex128], errors: NDArray[np.complex128]
) -> FrequencyResponse:
    """Return a response with another value and the covariance of its errors, complex, shape (vectors, n).

    The degrees of freedom are those of the greater one of this part and the scatter of the periods.
    """
    parts = np.stack([errors.real, errors.imag])
    covariance = np.moveaxis(np.add.reduce(parts[:, None] * parts[None, :], axis=2), -1, 0)
    explained, shown = (np.trace(each, axis1=1, axis2=2) for each in (covariance, response.covariance))
    with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
        excess = np.fmax(shown / explained, 1.0)
    known = np.inf if response.freedom is None else response.freedom
    return replace(
        response,
        response=np.where(np.isfinite(response.response), ratio, np.nan),
        covariance=covariance * excess[:, None, None],
        freedom=np.where(excess > 1, known, DRAWS - 1.0),
    )
