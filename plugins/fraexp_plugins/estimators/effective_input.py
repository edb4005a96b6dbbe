"""The paper's proposed FRA method: measured position over the effective control input."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    Curve,
    Encoder,
    Estimator,
    FrequencyResponse,
    ParameterError,
    PositionDependentFriction,
    RecordError,
    Result,
    Segment,
    Signals,
    param,
    phasors,
    response_result,
)
from fraexp_plugins.estimators._shared.effective_input_observer import EFFECTIVE_INPUT, ObserverEstimator, is_from_rest
from fraexp_plugins.estimators._shared.encoder_aware_observer import EncoderAwareObserver
from fraexp_plugins.estimators._shared.encoder_errors import EncoderErrors, with_error_vectors
from fraexp_plugins.estimators._shared.friction_posterior import SineRecord, harmonic_lines, line_omega, record_terms
from fraexp_plugins.estimators._shared.hold_images import HoldImages, gain_above_modes, hold_images
from fraexp_plugins.estimators._shared.model_covariance import inverse_response
from fraexp_plugins.estimators._shared.motion_above_nyquist import UnsampledErrors
from fraexp_plugins.estimators._shared.parameter_uncertainty import (
    Deviation,
    check_deviations,
    covariance_root,
    moved_within_bounds,
)
from fraexp_plugins.estimators._shared.plant_above_modes import MAX_ERROR, PlantAboveModes
from fraexp_plugins.estimators._shared.response_doubts import (
    MAX_STANDSTILL_ERROR,
    join_messages,
    judge_band,
    standstill_text,
    weak_terms_text,
    with_doubt,
)
from fraexp_plugins.estimators._shared.rounding_band import with_rounding
from fraexp_plugins.estimators._shared.single_periods import as_single_periods
from fraexp_plugins.estimators._shared.standstill import HiddenForce, hidden_forces
from fraexp_plugins.estimators._shared.uncertain_friction import (
    SCALES,
    UNSTATED,
    ModelErrors,
    knows_machine,
    prior_std,
    scale_factors,
    with_model_errors,
)

NO_RATE_S = 1e9
"""A step so long that nothing moves fast in it [s]."""
MIN_STIFFENING = 1.001
"""Stiffness of a friction model in a sample, over that at rest, from which its elements damp."""


class EffectiveInput(EncoderAwareObserver, name="effective_input", version=7):
    """P̂ = y'/û_e with û_e = G_di G_do u - f̂: the effective control input observer, eqs (2)-(5).

    y' drives the friction model in the time domain; the delays act at each frequency. With the right friction model P̂
    is P at any amplitude. A wrong one causes the error 1/P̂ - 1/P = N - N̂, which is largest where 1/P is small. Do not
    use it with a guessed friction model, unless the uncertainty of the guess is stated.

    `method` is the estimator from û_e to y': Fourier sums over whole periods if it is not given. A best linear
    approximation removes noise, a local polynomial a transient. Both leave the error of the friction model; with the
    moving axis there is none, because f̂ is a constant there for every model.

    A friction model is uncertain: unless it is the simulated machine's own, or deviations are stated, its force and its
    deflections have a standard deviation of 10 %. At harmonics of a sine friction alone moves the plant. Where they lie
    within the measured frequencies they narrow these errors, and the response is that of the most probable ones. With
    `corrects_friction = false` it stays that of the stated model, and the band reaches to the plant.

    Where friction holds the machine still, its force is not in y', and no observer sees it. The response is compared
    with the one that follows if friction balances the input there; a difference above 1 % is stated, and is not ok.

    The errors of the friction model give the covariance of 1/P̂ by the error law, with central differences of N̂ along
    each column of a square root of their covariance, over two standard deviations on either side. The confidence band
    includes friction. The curve `friction sensitivity` says what 1 % of friction costs over frequency.

    Noise and rounding of the encoder act on P̂ through the friction model too: they move its reversals, and hide terms
    of the motion in all periods alike. Where noise or resolution is stated and the record has several periods, 32
    simulated repetitions of each measurement give the mean of these errors, which is taken off, and their covariance;
    the band also contains the mean error itself and that of the interpolation. It is never narrower than the scatter
    of the periods. Terms that noise hides, and motion above the Nyquist frequency, follow from the friction force and
    from the plant at its harmonics. If few of those are clear, and hidden terms matter more than the band is wide, a
    message says that it may cover less. A best linear approximation or another `method` has the band of that method.
    For a record of one period motions are drawn that could have given it; nothing is taken off. A
    frequency is ok if its whole band lies within 0.5 dB and 3°.

    The images of the held input are taken off the measured position where they falsify the response by more than the
    tolerance. Their size follows from the motion at harmonics, if noise or resolution is stated and enough of them are
    clear; else from the response at the highest frequencies, which should lie above the modes.
    """

    takes_responses: ClassVar[bool] = True

    method: Estimator | None = param("", "estimator from û_e to y'; Fourier sums if it is not given", None)
    force_std: float | None = param("1", f"relative standard deviation of ΣF_m; {UNSTATED}", None, at_least=0, below=1)
    displacement_std: float | None = param(
        "1",
        f"relative standard deviation of the deflections Y_m, at the same ΣF_m; {UNSTATED}",
        None,
        at_least=0,
        below=1,
    )
    deviations: tuple[Deviation, ...] = param(
        "", "standard deviations of single parameters, such as { parameter = 'curve.coulomb_force', std = 0.5 }", ()
    )
    correlation: tuple[tuple[float, ...], ...] = param(
        "1",
        "correlation matrix of `deviations`, row by row, as identification gives it; empty if they are independent",
        (),
    )
    corrects_friction: bool = param("", "whether errors of the model that harmonics show move the response", True)

    def model_post_init(self, context: object) -> None:
        """Check that the method accepts û_e, and that the friction model has the parameters that deviate."""
        super().model_post_init(context)
        if self.method is not None and getattr(
            self.method, "compensates_friction", isinstance(self.method, ObserverEstimator)
        ):
            raise ParameterError(
                f"effective_input.method is {self.method.name}, which compensates friction itself: use it without "
                "effective_input"
            )
        if self.method is not None and "input" not in type(self.method).model_fields:
            raise ParameterError(
                f"effective_input.method is {self.method.name}, which has no parameter 'input' for û_e; choose another"
            )
        try:
            check_deviations(self.friction, self.deviations, self.correlation)
        except ParameterError as error:
            raise ParameterError(f"effective_input.{error}") from None

    def matched(self, machine: Mapping[str, object]) -> Self:
        """Return the observer of the machine itself, about which nothing is uncertain."""
        certain = {"force_std": 0.0, "displacement_std": 0.0, "deviations": (), "correlation": ()}
        return super().matched(machine).model_copy(update=certain)

    def estimate(self, signals: Signals) -> Result:
        """Return y'/û_e at each frequency."""
        if not signals.segments:
            return Result(signals.outcome, signals.message)
        if any(segment.stated and not segment.stated.has_amplitude for segment in signals.segments):
            raise RecordError(
                "friction depends on the amplitude, which the response does not state; give record.input_amplitude "
                "(--input-amplitude)"
            )
        if not getattr(self.method, "motion_repeats", True):
            signals = as_single_periods(signals)
        observer = self.fitted_to(signals).resolve_oversampling(signals.segments)
        forces = observer._forces(signals.segments)
        found = observer._estimate_along(signals, forces)
        images = observer._images_that_matter(signals, found)
        if images:
            moved = images.removed_from(signals.segments, self.output)
            observer, signals = observer.model_copy(update={"relative_degree": 0}), replace(signals, segments=moved)
            forces = observer._forces(signals.segments)
            found = observer._estimate_along(signals, forces)
        found = observer._completed(signals, found, self.relative_degree)
        return replace(found, curves=(*found.curves, *observer._sensitivity(signals, forces, found)))

    def _sensitivity(self, signals: Signals, forces: Sequence[NDArray[np.float64]], found: Result) -> tuple[Curve, ...]:
        """Return |N̂ P̂|, the friction force over û_e, and by how much a model 1 % too weak lowers the response.

        An error e of the force makes P̂ = P/(1 + e N P).
        """
        if found.response is None or self.method or not self.friction.state_size:
            return ()
        force = np.abs(np.concatenate([each.mean(axis=0) for each in self.friction_phasors(signals.segments, forces)]))
        with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
            ratio = force / found.response.input_amplitude
            cost = 20 * np.log10(1 + ratio / 100)
        names = ("frequency", "|N P|", "1 % of friction")
        columns = dict(zip(names, (found.response.frequency, ratio, cost), strict=True))
        return (Curve("friction sensitivity", columns, dict(zip(names, ("Hz", "1", "dB"), strict=True))),)

    def _images_that_matter(self, signals: Signals, found: Result) -> HoldImages | None:
        """Return the images of the hold in the sampled position, if they are more than the tolerance."""
        if found.response is None or not (self.zero_order_hold and self.relative_degree):
            return None
        if any(is_from_rest(segment) or not segment.periodic for segment in signals.segments):
            return None
        guess = gain_above_modes(found.response, self.relative_degree)
        images = hold_images(self, signals.segments, found.response, guess)
        if images.error.max(initial=0.0) <= self.interpolation_tolerance:
            return None
        gain = self._gain_by_harmonics(signals, guess)
        return images if gain == guess else hold_images(self, signals.segments, found.response, gain)

    def _gain_by_harmonics(self, signals: Signals, guess: float) -> float:
        """Return c of the plant above its modes, as the motion at harmonics shows it; the guess if it does not.

        The highest frequencies of a response may lie below a mode, where its c is another one.
        """
        is_single = any(len(segment.channels[self.output]) == 1 for segment in signals.segments)
        if is_single or not (self.friction.state_size and self._encoder_matters(signals)):
            return guess
        plant, _ = self.likely_motions(signals.segments, PlantAboveModes.of_gain(guess, self.relative_degree))
        sample_time = min(segment.sample_time for segment in signals.segments)
        return plant.limit if plant.error(np.pi / sample_time) < MAX_ERROR else guess

    def _completed(self, signals: Signals, found: Result, relative_degree: int) -> Result:
        """Return a result with its uncertainty by encoder and friction model, and with all that makes it doubtful."""
        if found.response is None:
            return found
        if self._encoder_matters(signals):
            plant = PlantAboveModes.of_gain(gain_above_modes(found.response, relative_degree), relative_degree)
            response, weak = self._with_encoder_errors(signals, found.response, plant)
            message = join_messages(found.message, weak_terms_text(response, weak))
            found = replace(found, response=response, message=message)
        hidden = self._hidden(signals)
        found, record = self._check_standstill(signals, hidden, found), None
        if found.response is not None and not any(hidden):  # what standstill hides is no error of the model
            record = SineRecord(self, signals.segments, Encoder(self.noise, self.resolution), found.response)
        return judge_band(with_model_errors(found, record, self._errors(signals), corrects=self.corrects_friction))

    def _errors(self, signals: Signals) -> ModelErrors | None:
        """Return what is uncertain of the friction model: its scales, and the columns of its deviations.

        None where it is the simulated machine's own, unless something is stated of its deviations.
        """
        is_known = knows_machine(self, self.friction, signals)
        segments, scales = signals.segments, self._uncertain_scales(is_known=is_known or bool(self.deviations))
        columns = covariance_root(self.friction, self.deviations, self.correlation)
        if is_known and not (scales or columns.size):
            return None
        motions = [self.mean_motion(segment) for segment in segments]

        def applied(sizes: NDArray[np.float64]) -> EffectiveInput:
            factors = zip(scales.items(), scale_factors([std for _, std in scales.values()], sizes), strict=True)
            changes: dict[str, object] = {name: value * factor for (name, (value, _)), factor in factors}
            changes["friction"] = moved_within_bounds(self.friction, self.deviations, columns @ sizes[len(scales) :])
            return self.model_copy(update=changes)

        def force_terms(sizes: NDArray[np.float64]) -> list[NDArray[np.complex128]]:
            observer = applied(sizes)
            scale = self.displacement_scale / observer.displacement_scale
            driving = [
                each._replace(displacement=scale * each.displacement, lead_in=scale * each.lead_in) for each in motions
            ]
            forces = zip(segments, observer.friction.forces(driving), strict=True)
            return [observer.force_at(segment, force, harmonic_lines(segment)) for segment, force in forces]

        def inverse_with(sizes: NDArray[np.float64]) -> NDArray[np.complex128]:
            observer = applied(sizes)
            return inverse_response(observer._estimate_along(signals, observer._forces(segments)))

        return ModelErrors(scales, columns.shape[1], force_terms, inverse_with, self.stiffness)

    def _uncertain_scales(self, *, is_known: bool) -> dict[str, tuple[float, float]]:
        """Return value and relative standard deviation of each scale of the model that is uncertain."""
        is_positioned = isinstance(self.friction, PositionDependentFriction)
        stated = zip(SCALES, (self.force_std, 0.0 if is_positioned else self.displacement_std), strict=True)
        stds = {scale: prior_std(std, self.friction, is_known=is_known) for scale, std in stated}
        return {scale: (getattr(self, scale), std) for scale, std in stds.items() if std}

    def force_at(
        self, segment: Segment, force: NDArray[np.float64], lines: NDArray[np.int64]
    ) -> NDArray[np.complex128]:
        """Return the terms of all friction [N] at lines, from the model's force along the mean period, shape (k,)."""
        omega = line_omega(segment, lines)
        terms = np.fft.rfft(force)[lines] * (2 / force.size) * self.force_factor(omega)
        return np.asarray(terms + 1j * omega * self.friction.viscous * record_terms(segment, self.output, lines))

    def stiffness(self, omega: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the greatest change of the friction force by an error of the output [N/m], at ω [rad/s]."""
        greatest = self.friction.max_stiffness * self.force_scale / self.displacement_scale
        return np.full(omega.size, greatest)

    def _estimate_along(self, signals: Signals, forces: Sequence[NDArray[np.float64]]) -> Result:
        """Return the response to û_e with the friction model's forces along the segments."""
        if self.method is not None:
            return self._estimate_by_method(self.method, self.with_effective_input(signals, forces))
        units = (signals.unit(self.input), signals.unit(self.output))
        inputs = self.effective_phasors(signals.segments, forces)
        outputs = [phasors(segment, self.output) for segment in signals.segments]
        return response_result(signals, inputs, outputs, names=(EFFECTIVE_INPUT, self.output), units=units)

    def _estimate_by_method(self, method: Estimator, signals: Signals) -> Result:
        """Return the response that the method finds from û_e to y'."""
        given = {"input": EFFECTIVE_INPUT, "output": self.output, "refer_to_plant": False}
        fields = type(method).model_fields
        method = method.model_copy(update={key: value for key, value in given.items() if key in fields})
        return method.estimate(signals)

    def _check_standstill(self, signals: Signals, hidden: Sequence[HiddenForce | None], found: Result) -> Result:
        """Return a result that is not ok where standstill hides friction, and that says how far it may be off."""
        if found.response is None or not any(hidden):
            return found
        with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
            error = self._response_with(signals, hidden, found.response) / found.response.response - 1
        error = np.where(np.isfinite(error), error, 0.0)
        if np.abs(error).max() <= MAX_STANDSTILL_ERROR:
            return found
        share = max(each.share for each in hidden if each)
        message = standstill_text(found.response.frequency, error, share)
        return with_doubt(found, message)

    def _hidden(self, signals: Signals) -> list[HiddenForce | None]:
        return hidden_forces(self, signals.segments)

    def _response_with(
        self, signals: Signals, hidden: Sequence[HiddenForce | None], found: FrequencyResponse
    ) -> NDArray[np.complex128]:
        """Return the response, shape (n,), with the friction force that standstill hides."""
        pairs = list(zip(signals.segments, hidden, strict=True))
        if self.method is None:
            change = [each.phasors(segment) if each else 0.0 * segment.lines for segment, each in pairs]
            y = [phasors(segment, self.output).mean(axis=0) for segment in signals.segments]
            return found.response / (1 + found.response * np.concatenate(change) / np.concatenate(y))
        extended = self.with_effective_input(signals)
        segments = [_add_force(*pair) for pair in zip(extended.segments, hidden, strict=True)]
        other = self._estimate_by_method(self.method, replace(extended, segments=tuple(segments))).response
        return found.response if other is None else other.response

    def _encoder_matters(self, signals: Signals) -> bool:
        """Return whether noise or rounding acts through friction on a band, and is known or shows over periods."""
        if self.method is not None or not (self.noise or self.resolution):
            return False
        if any(is_from_rest(segment) for segment in signals.segments):
            return False
        is_single = any(len(segment.channels[self.output]) == 1 for segment in signals.segments)
        return not is_single or bool(self.noise) or signals.encoder is not None

    def _with_encoder_errors(
        self, signals: Signals, response: FrequencyResponse, plant: PlantAboveModes
    ) -> tuple[FrequencyResponse, NDArray[np.float64]]:
        """Return the response with a band that contains the errors of the encoder, and of what lies between samples.

        Of several periods their mean is taken off. The second value is by how much terms of the motion that noise
        partly hides change the response, shape (n,).
        """
        unknown = np.zeros(response.frequency.size)
        if not self.friction.state_size:
            return with_rounding(response, signals.segments, self.output, self.resolution), unknown
        if any(len(segment.channels[self.output]) == 1 for segment in signals.segments):
            return self._with_errors_of_single_periods(signals.segments, response, plant), unknown
        plant, likely = self.likely_motions(signals.segments, plant)
        linear = self.linear_phasors(signals.segments)
        unsampled = self.unsampled_motion_errors(signals.segments, plant)
        errors = self.encoder_errors(signals.segments, likely)
        each = zip(signals.segments, errors, linear, unsampled, strict=True)
        parts = [self._response_with_encoder_errors(*part, plant) for part in each]
        ratio, vectors, weak = (np.concatenate(part, axis=-1) for part in zip(*parts, strict=True))
        return with_error_vectors(response, ratio, vectors), weak

    def _with_errors_of_single_periods(
        self, segments: Sequence[Segment], response: FrequencyResponse, plant: PlantAboveModes
    ) -> FrequencyResponse:
        errors = self.single_period_errors(segments)
        ratio = response.response
        output = 1 + ratio * 2j * np.pi * response.frequency * self.friction.viscous
        with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
            variance = errors.variance(output, ratio) / response.input_amplitude**2
        if self._is_damped(segments[0].sample_time):
            unsampled = self.unsampled_motion_errors(segments, plant)
            moved, force = (np.concatenate(each) for each in zip(*unsampled, strict=True))
            weak = np.concatenate(self.weak_term_errors(segments))
            measured = np.concatenate([phasors(segment, self.output)[0] for segment in segments])
            with np.errstate(divide="ignore", invalid="ignore"):
                hidden = ratio * (output * moved + ratio * (force + weak)) / measured
            ratio, variance = ratio - hidden, variance + np.abs(hidden) ** 2
        covariance = variance[:, None, None] * (np.eye(2) / 2)
        return replace(response, response=ratio, covariance=covariance, freedom=errors.freedom)

    def _is_damped(self, sample_time: float) -> bool:
        """Return whether elements of the friction model damp: their force has steps, which move the plant unseen."""
        slow, fast = (self.friction.stiffness_in_step(step) for step in (NO_RATE_S, sample_time))
        return fast > MIN_STIFFENING * slow

    def _response_with_encoder_errors(
        self,
        segment: Segment,
        errors: EncoderErrors,
        linear: NDArray[np.complex128],
        unsampled: UnsampledErrors,
        plant: PlantAboveModes,
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128], NDArray[np.float64]]:
        """Return P̂, shape (lines,), and vectors whose squares add up to its variance, shape (vectors, lines).

        The third value is by how much terms of the motion that noise partly hides change P̂, shape (lines,).
        """
        damping = 2j * np.pi * segment.frequency * self.friction.viscous
        corrected = np.add.reduce(linear, axis=0) / len(linear) + damping * errors.output_correction
        effective = corrected - errors.force
        ratio = errors.output / effective

        def error_of_ratio(output: NDArray[np.complex128], force: NDArray[np.complex128]) -> NDArray[np.complex128]:
            return (output + ratio * (damping * output + force)) / effective

        scatter = error_of_ratio(errors.output_errors, errors.force_errors) / np.sqrt(len(errors.force_errors) - 1)
        correction = ratio * errors.force_correction / effective
        interpolation = ratio * errors.interpolation_error / effective
        hidden = error_of_ratio(unsampled.output, unsampled.force)
        weak = np.abs(ratio * errors.weak_term_force / effective)
        return (
            ratio - hidden,
            np.vstack([scatter, correction, interpolation, float(plant.error(np.pi / segment.sample_time)) * hidden]),
            weak,
        )


def _add_force(segment: Segment, hidden: HiddenForce | None) -> Segment:
    """Return a segment whose û_e contains the friction force that standstill hides."""
    if hidden is None:
        return segment
    effective = segment.channels[EFFECTIVE_INPUT]
    changed = effective + np.fft.irfft(hidden.spectrum, effective.size).reshape(effective.shape)
    return replace(segment, channels={**segment.channels, EFFECTIVE_INPUT: changed})
