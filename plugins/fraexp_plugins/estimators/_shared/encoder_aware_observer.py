"""The effective control input observer with an encoder: what noise and rounding do to its friction force."""

import itertools
from abc import ABC
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Encoder, Motion, Segment, fourier_sums, path_response, phasor_variance
from fraexp_plugins.estimators._shared.effective_input_observer import ObserverEstimator
from fraexp_plugins.estimators._shared.encoder_errors import (
    DrawnMotions,
    EncoderErrors,
    draw_motions,
    simulated_encoder_errors,
)
from fraexp_plugins.estimators._shared.likely_motions import likely_motions
from fraexp_plugins.estimators._shared.measured_terms import measured_terms, motion_terms
from fraexp_plugins.estimators._shared.motion_above_nyquist import UnsampledErrors, mean_phasors, motion_above_nyquist
from fraexp_plugins.estimators._shared.plant_above_modes import PlantAboveModes
from fraexp_plugins.estimators._shared.possible_motions import (
    EncoderErrorSamples,
    ErrorMoments,
    draws_per_segment,
    error_moments,
    examined_segments,
    possible_motions,
)
from fraexp_plugins.estimators._shared.weak_terms import LikelyTerms

MAX_POINTS_OF_DRAWS = 1024
"""Points of a motion at which a friction model is driven to find the errors that the encoder causes."""
REFINEMENT_FACTORS = (4, 8)
"""Factors by which a motion is interpolated more finely, to find the error by interpolation."""
SINGLE_MOTIONS = 2 + len(REFINEMENT_FACTORS)
"""Motions of a segment that are driven once each."""
POINTS_MULTIPLE = 16
"""Numbers of points of which a Fourier transform is fast are multiples of it."""


class EncoderAwareObserver(ObserverEstimator, ABC):
    """An observer that knows what the encoder's noise and rounding do to the force along the motion."""

    def likely_motions(
        self, segments: Sequence[Segment], guess: PlantAboveModes
    ) -> tuple[PlantAboveModes, list[LikelyTerms]]:
        """Return the plant above its modes, and what it and friction make likely of the motion in each segment."""
        measured = [measured_terms(segment, self.output, self.resolution, self.noise) for segment in segments]

        def force_terms(motions: Sequence[NDArray[np.complex128]]) -> list[NDArray[np.complex128]]:
            driving = [
                self._motions_of_terms(segment, terms[None, :], each.duration)[0]
                for segment, each, terms in zip(segments, measured, motions, strict=True)
            ]
            pairs = zip(measured, self.law.forces(driving), strict=True)
            return [motion_terms(force, 1)[: each.terms.size] * self.force_factor(each.omega) for each, force in pairs]

        return likely_motions(measured, force_terms, guess)

    def encoder_errors(self, segments: Sequence[Segment], likely: Sequence[LikelyTerms]) -> list[EncoderErrors]:
        """Return what noise and rounding of the encoder do to displacement [m] and friction force [N] in û_e."""
        motions = [
            draw_motions(
                measured_terms(segment, self.output, self.resolution, self.noise), self.resolution, self.noise, own
            )
            for segment, own in zip(segments, likely, strict=True)
        ]
        pairs = zip(segments, motions, strict=True)
        singles = self.law.forces([motion for pair in pairs for motion in self._single_motions(*pair)])
        errors = []
        for number, (segment, each) in enumerate(zip(segments, motions, strict=True)):
            several = self._motions_of_terms(segment, np.concatenate([each.drawn, each.found]), each.duration)
            sums = fourier_sums(np.stack(self.law.forces(several)), each.lines)
            own = singles[number * SINGLE_MOTIONS : (number + 1) * SINGLE_MOTIONS]
            forces = [fourier_sums(force[None, :], each.lines)[0] for force in own]
            found = simulated_encoder_errors(each, sums[: len(each.drawn)], sums[len(each.drawn) :], forces)
            errors.append(found.scaled(self.force_factor(2 * np.pi * segment.frequency)))
        return errors

    def _single_motions(self, segment: Segment, motions: DrawnMotions) -> list[Motion]:
        """Return the motions that are driven once each: all of them together, so that they fill the lanes."""
        alike = self._motions_of_terms(segment, np.stack([motions.estimated, motions.known]), motions.duration)
        exact = [
            self._motions_of_terms(segment, motions.estimated[None, :], motions.duration, finer)[0]
            for finer in REFINEMENT_FACTORS
        ]
        return [*alike, *exact]

    def unsampled_motion_errors(self, segments: Sequence[Segment], plant: PlantAboveModes) -> list[UnsampledErrors]:
        """Return the errors by the motion above the Nyquist frequency, of the mean over the periods, per segment."""
        motions = [self.mean_motion(segment) for segment in segments]
        segments = [_mean_period(segment, self.output) for segment in segments]
        forces = self.law.forces(motions)
        unsampled = [
            motion_above_nyquist(segment, force, plant, self.output_time_constants)
            for segment, force in zip(segments, forces, strict=True)
        ]
        moved = [
            motion._replace(displacement=motion.displacement + found.interpolation_error / self.displacement_scale)
            for motion, found in zip(motions, unsampled, strict=True)
        ]
        changes = zip(segments, forces, self.law.forces(moved), strict=True)
        lacking = [
            mean_phasors(segment, along - true) * self.force_factor(2 * np.pi * segment.frequency)
            for segment, along, true in changes
        ]
        return [UnsampledErrors(found.aliases, force) for found, force in zip(unsampled, lacking, strict=True)]

    def mean_motion(self, segment: Segment) -> Motion:
        """Return the motion of the mean over the periods, in which noise hides fewer terms."""
        quieter = self.noise / np.sqrt(len(segment.channels[self.output]))
        return self.model_copy(update={"noise": quieter}).motion(_mean_period(segment, self.output))

    def weak_term_errors(self, segments: Sequence[Segment]) -> list[NDArray[np.complex128]]:
        """Return the error of the force in û_e [N] by weak terms of the motion, which the observer leaves out.

        Each has the shape (lines,). Records of one period; all terms of a motion err in the same direction.
        """
        errors = []
        for segment in segments:
            found = possible_motions(segment, self.output, self.resolution, self.noise, 0)
            pair = np.stack([found.terms[0], found.likely])
            taken, likely = self.law.forces(self._motions_of_terms(segment, pair, found.duration))
            sums = fourier_sums(np.stack([taken, likely]), found.lines)
            errors.append((sums[0] - sums[1]) * self.force_factor(2 * np.pi * segment.frequency))
        return errors

    def single_period_errors(self, segments: Sequence[Segment]) -> ErrorMoments:
        """Return the moments of the same errors for records of one period, at the lines of all segments."""
        examined = examined_segments(segments)
        draws = draws_per_segment(examined)
        possible = [possible_motions(each, self.output, self.resolution, self.noise, draws) for each in examined]
        motions = [
            self._motions_of_terms(segment, found.terms, found.duration)
            for segment, found in zip(examined, possible, strict=True)
        ]
        forces = iter(self.law.forces(list(itertools.chain.from_iterable(motions))))
        force_errors = []
        for segment, found in zip(examined, possible, strict=True):
            sums = fourier_sums(np.stack([next(forces) for _ in found.terms]), found.lines)
            force_errors.append((sums[0] - sums[1:]) * self.force_factor(2 * np.pi * segment.frequency))
        samples = EncoderErrorSamples(
            np.concatenate([segment.frequency for segment in examined]),
            np.concatenate([found.output_errors for found in possible], axis=1),
            np.concatenate(force_errors, axis=1),
            self._output_deviation(examined),
        )
        frequency = np.concatenate([segment.frequency for segment in segments])
        return error_moments(samples, frequency, self._output_deviation(segments))

    def _output_deviation(self, segments: Sequence[Segment]) -> NDArray[np.float64]:
        """Return the standard deviation of the output's phasors by noise and rounding [m], at all lines."""
        encoder = Encoder(self.noise, self.resolution)
        return np.sqrt(np.concatenate([phasor_variance(segment, encoder, self.output) for segment in segments]))

    def _motions_of_terms(
        self, segment: Segment, terms: NDArray[np.complex128], duration: float, finer: int = 1
    ) -> list[Motion]:
        """Return motions of such Fourier coefficients, shape (motions, terms), and period [s].

        A single one is as exact as the observer's own. Several are there to be compared with each other: most of their
        own errors cancel.
        """
        points = int(np.ceil(finer * self.oversampling * duration / segment.sample_time))
        before = self.lead_in(segment)
        if len(terms) > 1:
            points = min(points, max(MAX_POINTS_OF_DRAWS, 2 * terms.shape[1]))
            before = np.empty(0)
        omega = 2 * np.pi / duration * np.arange(terms.shape[1])
        bins = terms / path_response(omega, 0.0, self.output_time_constants)
        points += -points % POINTS_MULTIPLE
        motions = np.fft.irfft(bins, points) * (points / self.displacement_scale)
        return [Motion(x, duration / points, True, before, segment.sample_time) for x in motions]


def _mean_period(segment: Segment, channel: str) -> Segment:
    """Return a segment of one period, the mean of all, with this channel alone."""
    periods = segment.channels[channel]
    return replace(segment, channels={channel: np.add.reduce(periods, axis=0)[None] / len(periods)})
