"""What the local polynomial and the local rational method have in common."""

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Literal

import numpy as np

from fraexp.api import ParameterError, RecordError, Segment, Signals, param, phasors, spectrum_of
from fraexp_plugins.estimators.local_models import Local, LocalModel, all_windows, free_windows
from fraexp_plugins.estimators.realisations import BroadbandEstimator, Group, Part, circular, mean, power

EXCITATION = "excitation"
"""Channel of the injected signal, which every simulated loop has and a measured record may lack."""


class LocalEstimator(BroadbandEstimator, ABC):
    """An estimator that tells response and transient apart by their smoothness over the bins around each line."""

    expected_failures = dict.fromkeys(
        ("linear-plant", "result-units", "covariance", "outcome"), "one period of a sine has no bins around its line"
    )
    variant: Literal["auto", "periodic", "arbitrary"] = param(
        "",
        "periodic: transient and noise from the bins between the lines of two periods or more; arbitrary: all bins "
        "of one record; auto: periodic if there are two periods",
        "auto",
    )
    order: int = param("1", "order R of the polynomials", 4, at_least=0, at_most=10)
    freedom: int = param("1", "complex degrees of freedom left for the noise, at least", 4, at_least=1, at_most=1000)
    half_width: int = param("1", "bins n on either side of a line; 0 for what order and freedom need", 0, at_least=0)
    integrators: int = param("1", "poles of the plant at s = 0, 2 for position over force", 2, at_least=0, at_most=4)
    reference_channel: str = param("", "channel of the injected signal, if the signals have it", EXCITATION)

    @abstractmethod
    def model(self, feedback: bool) -> LocalModel:
        """Return the model around a line, for the response to an injected signal within a loop or to an input."""

    def part(self, signals: Signals, group: Group) -> Part:
        """Return output over input at the lines of one experiment, averaged over its realisations before dividing."""
        reference = self._reference(signals, group)
        found = [self._realisation(segment, reference) for segment in group]
        outputs, inputs = np.stack([one.output for one in found]), np.stack([one.input for one in found])
        count, given, path = len(group), mean(inputs), self.path(group[0].frequency, group[0].sample_time)
        ratio, size = mean(outputs) / given, np.abs(given * path) ** 2
        noise = mean(np.stack([one.variance for one in found])) / count / size
        variance, freedom, nonlinear = noise, 2 * found[0].freedom, None
        if count > 1:
            variance = power(outputs - ratio * inputs) / (count * (count - 1)) / size
            freedom, nonlinear = np.full_like(noise, 2.0 * (count - 1)), count * np.maximum(variance - noise, 0.0)
        return Part(
            segments=group,
            frequency=group[0].frequency,
            response=ratio / path,
            covariance=circular(variance),
            freedom=freedom,
            input_amplitude=_amplitude(group, self.input),
            output_amplitude=_amplitude(group, self.output),
            noise_variance=noise,
            nonlinear_variance=nonlinear,
        )

    def _reference(self, signals: Signals, group: Group) -> str:
        """Return the channel to which all is related: the injected signal, or the input where no loop acts on that."""
        name = self.reference_channel
        if not name or (name == EXCITATION and name not in signals.units):
            return self.input
        signals.unit(name)  # an error that names the nearest channel, if there is none
        same = all(np.array_equal(segment.channels[name], segment.channels[self.input]) for segment in group)
        return self.input if same else name

    def _realisation(self, segment: Segment, reference: str) -> Local:
        """Return what is known of output and input of one realisation, relative to the reference."""
        periods = len(segment.channels[self.input])
        names = (self.output, self.input)
        if self.variant == "periodic" and periods < 2:
            raise RecordError(
                f"{self.name} has one period; the periodic variant needs two at least: record more periods, or choose "
                "variant 'arbitrary'"
            )
        if self.variant == "arbitrary" or periods < 2:
            model = self.model(feedback=reference != self.input)
            half_width = self._bins(model.unknowns + self.order)
            return model.fit(segment, names, reference, all_windows(segment, half_width))
        model = self.model(feedback=False)
        found = model.fit(segment, names, None, free_windows(segment, self._bins(model.unknowns)))
        given = found.input if reference == self.input else spectrum_of(segment, reference)[segment.lines * periods]
        return _relative_to(given, found)

    def _bins(self, spent: int) -> int:
        """Return n, of which 2n equations are left for `spent` unknowns and the noise."""
        if self.half_width and 2 * self.half_width <= spent:
            raise ParameterError(
                f"{self.name}.half_width is {self.half_width}; around a line {spent} numbers are unknown: expected "
                f"{spent // 2 + 1} at least, or 0 to let fraexp choose"
            )
        return self.half_width or -(-(self.freedom + spent) // 2)


def _relative_to(reference: np.ndarray, found: Local) -> Local:
    """Return what is known, divided by what the reference is at the lines."""
    leverage = found.leverage / np.abs(reference) ** 2
    return replace(found, output=found.output / reference, input=found.input / reference, leverage=leverage)


def _amplitude(group: Group, channel: str) -> np.ndarray:
    """Return the mean amplitude at the lines over realisations, shape (lines,)."""
    return mean(np.stack([np.abs(mean(phasors(segment, channel))) for segment in group]))
