"""The base of the local polynomial and the local rational method."""

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    SIGNIFICANCE,
    Finding,
    ParameterError,
    RecordError,
    Segment,
    Signals,
    param,
    phasors,
    record_spectrum,
)
from fraexp_plugins.estimators._shared.local_models import (
    LocalEstimate,
    LocalModel,
    all_windows,
    drive_smoothness,
    free_windows,
)
from fraexp_plugins.estimators._shared.realisations import (
    BroadbandEstimator,
    Group,
    Part,
    circular_covariance,
    mean,
    sum_of_squares,
)

DEFAULT_EXCITATION_CHANNEL = "excitation"
"""Channel of the excitation, which every simulated loop has and a measured record may lack."""


class LocalEstimator(BroadbandEstimator, ABC):
    """An estimator that separates response and transient by their smoothness over the bins around each line."""

    removes_motion: ClassVar[bool] = True

    expected_failures = dict.fromkeys(
        ("linear-plant", "result-units", "covariance", "outcome"), "one period of a sine has no bins around its line"
    )
    variant: Literal["auto", "periodic", "arbitrary"] = param(
        "",
        "periodic: transient and noise from the bins between the lines of two periods or more; arbitrary: all bins "
        "of one record; auto: periodic from two periods on",
        "auto",
    )
    order: int = param("1", "order R of the polynomials", 4, at_least=0, at_most=10)
    min_degrees_of_freedom: int = param(
        "1", "smallest number of complex degrees of freedom for the noise", 4, at_least=1, at_most=1000
    )
    half_width: int = param(
        "1", "bins n on either side of a line; 0 for as many as order and degrees of freedom need", 0, at_least=0
    )
    integrators: int = param("1", "poles of the plant at s = 0, 2 for position over force", 2, at_least=0, at_most=4)
    excitation_channel: str = param("", "channel of the excitation, if the signals have it", DEFAULT_EXCITATION_CHANNEL)

    @abstractmethod
    def model(self, feedback: bool) -> LocalModel:
        """Return the model around a line, for the response to the excitation of a closed loop, or to an input."""

    def part(self, signals: Signals, group: Group) -> Part:
        """Return output over input at the lines of one experiment, averaged over its realisations before dividing."""
        reference = self._reference(signals, group)
        found = [self._realisation(segment, reference) for segment in group]
        outputs, inputs = np.stack([one.output for one in found]), np.stack([one.input for one in found])
        count, u_mean, path = len(group), mean(inputs), self.path(group[0].frequency, group[0].sample_time)
        ratio, size = mean(outputs) / u_mean, np.abs(u_mean * path) ** 2
        noise = mean(np.stack([one.variance for one in found])) / count / size
        variance, freedom, nonlinear = noise, 2 * found[0].freedom, None
        if count > 1:
            variance = sum_of_squares(outputs - ratio * inputs) / (count * (count - 1)) / size
            freedom, nonlinear = np.full_like(noise, 2.0 * (count - 1)), count * np.maximum(variance - noise, 0.0)
        is_smooth = self._has_smooth_drive(group, reference)
        variance = np.where(is_smooth, np.nan, variance)
        return Part(
            segments=group,
            frequency=group[0].frequency,
            response=ratio / path,
            covariance=circular_covariance(variance),
            freedom=freedom,
            input_amplitude=_amplitude(group, self.input),
            output_amplitude=_amplitude(group, self.output),
            noise_variance=noise,
            nonlinear_variance=nonlinear,
            remarks=_undetermined(group[0].frequency, is_smooth),
        )

    def _has_smooth_drive(self, group: Group, reference: str) -> NDArray[np.bool_]:
        """Return where a drive is as smooth over frequency as response and transient are, shape (lines,).

        Such as that of a chirp it does not tell one from the other. Periods that repeat do. Of noise, the share of its
        power that a polynomial follows has a beta distribution.
        """
        from scipy.special import betaincinv  # slow to import: listing plugins must stay fast

        if not self._is_one_record(group[0]):
            return np.zeros(group[0].lines.size, dtype=bool)
        unknowns = self.model(feedback=reference != self.input).unknowns + self.order
        windows = all_windows(group[0], self._half_width(unknowns))
        smoothness = np.min([drive_smoothness(segment, reference, windows, self.order) for segment in group], axis=0)
        (lines, width), followed = windows.bins.shape, self.order + 1
        return np.asarray(smoothness > betaincinv(followed, width - followed, 1 - SIGNIFICANCE / lines))

    def _reference(self, signals: Signals, group: Group) -> str:
        """Return the channel to which spectra are related: the excitation, or the input if no feedback acts on it."""
        name = self.excitation_channel
        if not name or (name == DEFAULT_EXCITATION_CHANNEL and name not in signals.units):
            return self.input
        signals.unit(name)  # raises an error with the nearest name if the channel is missing
        is_open_loop = all(np.array_equal(segment.channels[name], segment.channels[self.input]) for segment in group)
        return self.input if is_open_loop else name

    def _realisation(self, segment: Segment, reference: str) -> LocalEstimate:
        """Return the local estimates of output and input of one realisation, relative to the reference."""
        periods = len(segment.channels[self.input])
        names = (self.output, self.input)
        if self.variant == "periodic" and periods < 2:
            raise RecordError(
                f"{self.name}: the record has one period; expected two or more for variant 'periodic': record more "
                "periods, or choose variant 'arbitrary'"
            )
        if self._is_one_record(segment):
            model = self.model(feedback=reference != self.input)
            half_width = self._half_width(model.unknowns + self.order)
            return model.fit(segment, names, reference, all_windows(segment, half_width))
        model = self.model(feedback=False)
        found = model.fit(segment, names, None, free_windows(segment, self._half_width(model.unknowns)))
        given = found.input if reference == self.input else record_spectrum(segment, reference)[segment.lines * periods]
        return _relative_to(given, found)

    def _is_one_record(self, segment: Segment) -> bool:
        """Return whether the excitation of the record is taken as it is, periods or not."""
        return self.variant == "arbitrary" or len(segment.channels[self.input]) < 2

    def _half_width(self, unknowns: int) -> int:
        """Return n, such that 2n equations suffice for the unknowns and the noise."""
        if self.half_width and 2 * self.half_width <= unknowns:
            raise ParameterError(
                f"{self.name}.half_width is {self.half_width}, but {unknowns} numbers are unknown around a line; "
                f"expected {unknowns // 2 + 1} or more, or 0 to choose it automatically"
            )
        return self.half_width or -(-(self.min_degrees_of_freedom + unknowns) // 2)


def _relative_to(reference: NDArray[np.complex128], found: LocalEstimate) -> LocalEstimate:
    """Return local estimates divided by the reference at the lines."""
    leverage = found.leverage / np.abs(reference) ** 2
    return replace(found, output=found.output / reference, input=found.input / reference, leverage=leverage)


def _undetermined(frequency: NDArray[np.float64], is_smooth: NDArray[np.bool_]) -> tuple[Finding, ...]:
    """Return where the drive does not determine the response; empty if nowhere."""
    if not is_smooth.any():
        return ()
    remedy = (
        "the excitation is as smooth over frequency as that of a chirp, which does not tell response from transient: "
        "take h1_h2_hv with a 'window' of a tenth of the record, or excite with noise or periods that repeat"
    )
    return (Finding("undetermined", (), tuple(map(float, frequency[is_smooth])), is_smooth.size, remedy=remedy),)


def _amplitude(group: Group, channel: str) -> NDArray[np.float64]:
    """Return the mean amplitude at the lines over realisations, shape (lines,)."""
    return mean(np.stack([np.abs(mean(phasors(segment, channel))) for segment in group]))
