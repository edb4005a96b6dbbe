"""The paper's proposed FRA method, with one contact or several: measured position over the effective control input."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    Curve,
    Estimator,
    FrequencyResponse,
    FrictionModel,
    ParameterError,
    Plant,
    PositionDependentFriction,
    RecordError,
    Result,
    Segment,
    Settling,
    Signals,
    param,
    phasors,
    response_result,
)
from fraexp_plugins.estimators._shared.contacts import (
    ContactForces,
    ContactPlant,
    contact_channel,
    only_contact,
    with_displacement,
)
from fraexp_plugins.estimators._shared.effective_input_observer import EFFECTIVE_INPUT, ObserverEstimator, is_from_rest
from fraexp_plugins.estimators._shared.friction_band import (
    MIN_FACTOR,
    SCALES,
    UNSTATED,
    ModelErrors,
    UncertainNumber,
    inverse_response,
    knows_delays,
    knows_friction,
    prior_std,
    scale_factors,
    with_model_errors,
    with_standstill,
)
from fraexp_plugins.estimators._shared.friction_posterior import MotionErrors, SineRecord, thrust_terms
from fraexp_plugins.estimators._shared.measured_motion import with_rounding
from fraexp_plugins.estimators._shared.motion_above_nyquist import HoldImages, hold_images, unsampled_errors
from fraexp_plugins.estimators._shared.parameter_uncertainty import (
    Deviation,
    check_deviations,
    covariance_root,
    moved_within_bounds,
)
from fraexp_plugins.estimators._shared.plant_above_modes import PlantAboveModes, gain_above_modes
from fraexp_plugins.estimators._shared.possible_motions import draw_errors, likely_motions, with_possible_motions
from fraexp_plugins.estimators._shared.standstill import HiddenForce, hidden_forces


class EffectiveInput(ObserverEstimator, name="effective_input", version=16):
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
    `corrects_friction = false` it stays that of the stated model, and the band reaches to the plant. The dead time is
    one more such error, known to a sample unless `dead_time_std` states more: it turns the input at the harmonics.
    Errors that are too great for what is stated, by a χ² test, say that the model is of another kind: it is not ok.

    Where friction holds the machine still, its force is not in y', and no observer sees it. The response is compared
    with the one that follows if friction balances the input there, and the difference is in the band.

    The errors of the friction model give the covariance of 1/P̂ by the error law, with central differences of N̂ along
    each column of a square root of their covariance, over two standard deviations on either side. The confidence band
    includes friction. The curve `friction sensitivity` says what 1 % of friction costs over frequency.

    Noise and rounding of the encoder act on P̂ through the friction model too: they move its reversals, and hide terms
    of the motion in all periods alike. Where noise or resolution is stated, 32 motions are drawn that could have given
    the record, of one period or several, and pushed through friction: their mean moves the response, their scatter is
    its band, with what weak terms change. It is never narrower than the scatter of the periods. Terms that noise hides,
    and motion above the Nyquist frequency, follow from the friction force and from the plant at its harmonics; with a
    `relative_degree` of 0 they do not. A best linear approximation or another `method` has the band of that method.

    With friction at several contacts c, û_e = G_di G_do u - Σ R_c f̂_c. Each model of `frictions` is driven by the
    displacement of its contact, as far as measured positions give it: one of them, or a difference such as motor less
    link. Channel `y` is the position that is fed back, `y.motor` another one; `output` chooses that of the response.
    R_c is the thrust that moves the output as a unit of the contact's force does, P_yc/P_yu of the nominal plant. Where
    friction acts at the thrust itself, as at a motor, it is 1 whatever the plant is. One contact may have an unknown
    displacement: the nominal plant then reconstructs it from the position that is fed back. Control inputs of further
    thrusts, such as `u.right`, count as friction does. What the nominal plant is wrong, both uses cost; with
    `plant_deviations` the band contains it.

    The images of the held input are taken off the measured position where they falsify the response by more than the
    tolerance. Their size follows from the motion at harmonics, if noise or resolution is stated and enough of them are
    clear; else from the response at the highest frequencies, which should lie above the modes.
    """

    takes_responses: ClassVar[bool] = True

    frictions: dict[str, FrictionModel] = param(
        "", "friction model of each contact, of a machine with several", {}, inherit="friction"
    )
    nominal_plant: Plant | None = param(
        "", "plant by which friction at several contacts acts at a distance", None, inherit="plant", beside="frictions"
    )
    thrust: str = param("", "thrust that is excited, as in the loop", "", inherit="loop.thrust")
    position: str = param("", "position that is fed back, as in the loop", "", inherit="loop.position")
    method: Estimator | None = param("", "estimator from û_e to y'; Fourier sums if it is not given", None)
    force_std: float | None = param(
        "1", f"relative standard deviation of ΣF_m, of each contact; {UNSTATED}", None, at_least=0, below=1
    )
    displacement_std: float | None = param(
        "1",
        f"relative standard deviation of the deflections Y_m, at the same ΣF_m; {UNSTATED}",
        None,
        at_least=0,
        below=1,
    )
    dead_time_std: float | None = param(
        "s",
        "standard deviation of the dead times together; if not given they are known to a sample, and exactly where "
        "the delays are the simulated machine's own",
        None,
        at_least=0,
    )
    deviations: tuple[Deviation, ...] = param(
        "", "standard deviations of single parameters, such as { parameter = 'curve.coulomb_force', std = 0.5 }", ()
    )
    correlation: tuple[tuple[float, ...], ...] = param(
        "1",
        "correlation matrix of `deviations`, row by row, as identification gives it; empty if they are independent",
        (),
    )
    plant_deviations: tuple[Deviation, ...] = param(
        "",
        "standard deviations of the nominal plant's parameters, such as { parameter = 'stiffness', std = 4000.0 }",
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
        if self.frictions and self.nominal_plant is None:
            raise ParameterError("effective_input.nominal_plant is missing; expected the plant of all contacts")
        if self.nominal_plant is not None and not self.frictions:
            raise ParameterError(
                "effective_input.nominal_plant is that of several contacts, and there is one; leave it out, or give "
                "the friction model of each contact in frictions"
            )
        if self.frictions and self.deviations:
            raise ParameterError(
                "effective_input.deviations name parameters of one friction model, and there is one for each of "
                f"{', '.join(self.frictions)}; state force_std and displacement_std, or plant_deviations"
            )
        for place, model, deviations, correlation in (
            ("", self.friction, self.deviations, self.correlation),
            ("plant_", self.nominal_plant, self.plant_deviations, ()),
        ):
            try:
                check_deviations(model, deviations, correlation) if model else None
            except ParameterError as error:
                raise ParameterError(f"effective_input.{place}{error}") from None

    def matched(self, machine: Mapping[str, object]) -> Self:
        """Return the observer of the machine itself, about which nothing is uncertain: the same one if it is that."""
        stds = dict.fromkeys(("force_std", "displacement_std", "dead_time_std"), 0.0)
        certain: dict[str, object] = {**stds, "deviations": (), "correlation": ()}
        frictions = machine["friction"]
        if isinstance(frictions, Mapping):
            certain |= {"friction": None, "frictions": dict(frictions)}
        else:
            certain |= {"nominal_plant": None}
        exact = super().matched(machine).model_copy(update={**certain, "plant_deviations": ()})
        unstated = {name: 0.0 for name in stds if getattr(self, name) is None}
        return self if self.model_copy(update=unstated).spec() == exact.spec() else exact

    def estimate(self, signals: Signals) -> Result:
        """Return y'/û_e at each frequency."""
        if not signals.segments:
            return Result(signals.outcome, signals.findings)
        if any(segment.stated and not segment.stated.has_amplitude for segment in signals.segments):
            raise RecordError(
                "friction depends on the amplitude, which the response does not state; give record.input_amplitude "
                "(--input-amplitude)"
            )
        if not getattr(self.method, "motion_repeats", True):
            signals = _as_single_periods(signals)
        observer = self.fitted_to(signals)._resolved(signals)
        forces = observer._contact_forces(signals)
        found = observer._estimate_along(forces)
        images = None if self.frictions else observer._images_that_matter(signals, found)
        if images:
            moved = images.removed_from(signals.segments, self.output)
            observer, signals = observer.model_copy(update={"relative_degree": 0}), replace(signals, segments=moved)
            forces = observer._contact_forces(signals)
            found = observer._estimate_along(forces)
        found = observer._completed(signals, forces, found, self.relative_degree)
        return replace(found, curves=(*found.curves, *observer._sensitivity(forces, found)))

    def resolve_for(self, signals: Signals) -> Self:
        """Return the estimator with the points per sample that it takes: its certificate is that of the same points."""
        return self._resolved(signals) if signals.segments and not signals.are_stated else self

    def _resolved(self, signals: Signals) -> Self:
        """Return the estimator with the points per sample that the contact needs that needs most, in each segment."""
        if self.oversampling or self._points or not self.frictions:
            return self.resolve_oversampling(signals.segments)
        needed: dict[float, int] = {}
        for contact in self._contact_forces(signals).contacts:
            needed |= {of: max(points, needed.get(of, 1)) for of, points in contact.observer._points.items()}
        return self._with_points(needed)

    def _contact_forces(self, signals: Signals, factors: Mapping[str, float] | None = None) -> ContactForces:
        """Return the displacement of each contact that has friction, and the force of its friction model.

        `factors` change scales of the models, by their names such as `motor: force_scale`.
        """
        if not self.frictions:
            return only_contact(self._observer("", self.law, signals, factors), signals)
        assert self.nominal_plant is not None
        models = {name: model for name, model in self.frictions.items() if model.state_size or model.viscous}
        ports = self.nominal_plant.ports().closed_by(self.thrust, self.position)
        plant = ContactPlant.of(ports, self.output, list(self.frictions), self.name)
        weights = {name: plant.displacement_weights(signals, name) for name in models}
        for name, own in weights.items():
            signals = signals if own is None else with_displacement(signals, name, own)
        hidden = [name for name, own in weights.items() if own is None]
        self._check_hidden(hidden)
        observers = {
            name: self._observer(name, models[name], signals, factors) for name in models if name not in hidden
        }
        contacts = {name: plant.contact(name, each, signals, weights[name]) for name, each in observers.items()}
        for name in hidden:
            others = ContactForces(signals, tuple(contacts.values()))
            signals = plant.with_reconstruction(signals, name, self, others)
            observer = self._observer(name, models[name], signals, factors)
            contacts[name] = plant.contact(name, observer, signals, None)
        return ContactForces(plant.refer_thrusts(signals, self.input), tuple(contacts[name] for name in models))

    def _check_hidden(self, hidden: Sequence[str]) -> None:
        """Raise ParameterError for contacts whose displacements cannot be reconstructed."""
        if len(hidden) > 1:
            raise ParameterError(
                f"{self.name}: measured positions do not give the displacements of the contacts "
                f"{' and '.join(hidden)}, and only one can be reconstructed; record another position, as channel y.NAME"
            )
        if hidden and isinstance(self.frictions[hidden[0]], PositionDependentFriction):
            raise ParameterError(
                f"{self.name}: the displacement of contact '{hidden[0]}' is reconstructed without its mean, and its "
                "friction depends on the position; record a position there, as channel y.NAME, or leave out "
                f"position_dependence in {self.name}.frictions.{hidden[0]}"
            )

    def _observer(self, name: str, model: FrictionModel, signals: Signals, factors: Mapping[str, float] | None) -> Self:
        """Return the observer of one contact, which is driven by its displacement."""
        changes: dict[str, object] = {
            scale: getattr(self, scale) * (factors or {}).get(_scale_name(name, scale), 1.0) for scale in SCALES
        }
        if name:
            changes |= {"friction": model, "frictions": {}, "output": contact_channel(name)}
        return self.model_copy(update=changes).resolve_oversampling(signals.segments)

    def _sensitivity(self, forces: ContactForces, found: Result) -> tuple[Curve, ...]:
        """Return |N̂ P̂|, the friction force over û_e, and by how much a model 1 % too weak lowers the response.

        An error e of the force makes P̂ = P/(1 + e N P).
        """
        if found.response is None or self.method or not any(c.observer.law.state_size for c in forces.contacts):
            return ()
        force = np.abs(np.concatenate([each.mean(axis=0) for each in forces.friction_phasors]))
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
        plant = PlantAboveModes.of_gain(guess, self.relative_degree)
        if self.law.state_size and self._encoder_matters(signals):
            plant, _ = likely_motions(self, signals.segments, plant)
        is_known = plant.error(np.pi / min(segment.sample_time for segment in signals.segments)) < 1
        return hold_images(self, signals.segments, found.response, plant.limit) if is_known else images

    def _completed(self, signals: Signals, forces: ContactForces, found: Result, relative_degree: int) -> Result:
        """Return a result with its uncertainty by encoder and friction model, and with all that makes it doubtful."""
        if found.response is None:
            return found
        found, by_encoder = self._with_encoder_errors(signals, forces, found, relative_degree)
        segments = forces.signals.segments
        hidden = [hidden_forces(each.observer, segments) for each in forces.contacts]
        assert found.response is not None
        unseen = self._hidden_amplitudes(forces, hidden)
        record = SineRecord(self, segments, self.encoder, found.response, unseen, by_encoder)
        errors = self._errors(signals, forces)
        found = with_model_errors(found, record, errors, corrects=self.corrects_friction)
        return self._with_standstill(forces, hidden, found) if unseen.any() else found

    def _errors(self, signals: Signals, forces: ContactForces) -> ModelErrors | None:
        """Return what is uncertain: scales contact by contact, the columns of stated deviations, and the dead time.

        None where friction is the simulated machine's own at its only contact, unless something is stated of it.
        """
        is_known = knows_friction(self, self.frictions or self.friction, signals)
        dead_time_std = self._dead_time_std(signals)
        stds = self._uncertain_scales(forces, is_known=is_known or bool(self.deviations))
        model, deviations = (
            (self.nominal_plant, self.plant_deviations) if self.frictions else (self.law, self.deviations)
        )
        assert model is not None
        columns = covariance_root(model, deviations, () if self.frictions else self.correlation)
        if is_known and not (self.frictions or stds or columns.size or dead_time_std):
            return None
        observer, alike, outputs = self._of_mean_periods(signals)
        scales = {name: getattr(self, name.split(": ")[-1]) for name in stds}
        numbers = {
            name: UncertainNumber(value, value * stds[name], "1", MIN_FACTOR * value) for name, value in scales.items()
        }
        if dead_time_std:
            numbers["input_dead_time"] = UncertainNumber(self.input_dead_time, dead_time_std, "s")

        def applied(sizes: NDArray[np.float64]) -> ContactForces:
            factors = dict(zip(stds, scale_factors(list(stds.values()), sizes), strict=True))
            moved = moved_within_bounds(model, deviations, columns @ sizes[len(numbers) :])
            changed = observer.model_copy(update={"nominal_plant" if self.frictions else "friction": moved})
            return changed._contact_forces(alike, factors)

        def delayed(sizes: NDArray[np.float64]) -> EffectiveInput:
            late = dead_time_std * float(sizes[len(stds)]) if dead_time_std else 0.0
            return self.model_copy(update={"input_dead_time": self.input_dead_time + late})

        def inverse_with(sizes: NDArray[np.float64]) -> NDArray[np.complex128]:
            return inverse_response(delayed(sizes)._estimate_along(applied(sizes), outputs))

        def force_terms(sizes: NDArray[np.float64]) -> list[NDArray[np.complex128]]:
            terms = applied(sizes).force_terms()
            if not dead_time_std:
                return terms
            lost = [thrust_terms(self, each) - thrust_terms(delayed(sizes), each) for each in alike.segments]
            return [force + missing for force, missing in zip(terms, lost, strict=True)]

        return ModelErrors(numbers, columns.shape[1], force_terms, inverse_with, forces.stiffness)

    def _dead_time_std(self, signals: Signals) -> float:
        """Return the standard deviation of the dead times together [s]."""
        if self.dead_time_std is not None or signals.are_stated or knows_delays(self, signals):
            return self.dead_time_std or 0.0
        # if nothing is stated it is known to a sample, and anywhere in it
        return 12**-0.5 * max(segment.sample_time for segment in signals.segments)

    def _of_mean_periods(self, signals: Signals) -> tuple[Self, Signals, list[NDArray[np.complex128]] | None]:
        """Return signals of one period that noise no longer disturbs, their observer, and the phasors of the output.

        Nothing changes where a method needs the whole record, or it does not repeat.
        """
        if self.method or any(is_from_rest(segment) or not segment.periodic for segment in signals.segments):
            return self, signals, None
        inputs = [name for name in signals.units if name == self.input or name.startswith("u.")]
        positions = [name for name in signals.units if name in ("y", self.output) or name.startswith("y.")]
        segments = tuple(
            replace(
                segment,
                channels={
                    **{name: segment.channels[name].mean(axis=0, keepdims=True) for name in inputs},
                    **{name: self.clear_period(segment, name) for name in positions},
                },
            )
            for segment in signals.segments
        )
        outputs = [phasors(segment, self.output).mean(axis=0, keepdims=True) for segment in signals.segments]
        exact = self.model_copy(update={"noise": 0.0, "resolution": 0.0})
        return exact, replace(signals, segments=segments), outputs

    def _uncertain_scales(self, forces: ContactForces, *, is_known: bool) -> dict[str, float]:
        """Return the relative standard deviation of each scale of the models that is uncertain."""
        stds: dict[str, float] = {}
        for contact in forces.contacts:
            law = contact.observer.law
            is_positioned = isinstance(law, PositionDependentFriction)
            for scale, std in zip(
                SCALES, (self.force_std, 0.0 if is_positioned else self.displacement_std), strict=True
            ):
                stds[_scale_name(contact.name, scale)] = prior_std(std, law, is_known=is_known)
        return {name: std for name, std in stds.items() if std}

    def _estimate_along(self, forces: ContactForces, outputs: Sequence[NDArray[np.complex128]] | None = None) -> Result:
        """Return the response to û_e with these friction forces, of the phasors of the output or of others."""
        signals = forces.signals
        if self.method is not None:
            return self._estimate_by_method(self.method, forces.with_effective_input(self))
        units = (signals.unit(self.input), signals.unit(self.output))
        pairs = zip(self.thrust_phasors(signals.segments), forces.friction_phasors, strict=True)
        inputs = [thrust - friction for thrust, friction in pairs]
        if outputs is None:
            outputs = [phasors(segment, self.output) for segment in signals.segments]
        return response_result(signals, inputs, outputs, names=(EFFECTIVE_INPUT, self.output), units=units)

    def _estimate_by_method(self, method: Estimator, signals: Signals) -> Result:
        """Return the response that the method finds from û_e to y'."""
        given = {"input": EFFECTIVE_INPUT, "output": self.output, "refer_to_plant": False}
        fields = type(method).model_fields
        method = method.model_copy(update={key: value for key, value in given.items() if key in fields})
        return method.estimate(signals)

    def _with_standstill(
        self, forces: ContactForces, hidden: Sequence[Sequence[HiddenForce | None]], found: Result
    ) -> Result:
        """Return a result with the friction that standstill hides in its band; of several contacts a bound of it."""
        response, share = found.response, max(each.share for own in hidden for each in own if each)
        if response is None:
            return found
        if not self.frictions:
            with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
                error = self._response_with(forces, hidden[0], response) / response.response - 1
            return with_standstill(found, error, share)
        bound = self._hidden_amplitudes(forces, hidden) / response.input_amplitude
        names = [contact.name for contact, own in zip(forces.contacts, hidden, strict=True) if any(own)]
        return with_standstill(found, bound, share, names)

    def _hidden_amplitudes(
        self, forces: ContactForces, hidden: Sequence[Sequence[HiddenForce | None]]
    ) -> NDArray[np.float64]:
        """Return the greatest amplitude at each excited line, as thrust [N], of what standstill hides, shape (n,)."""
        segments, total = forces.signals.segments, np.zeros(())
        for contact, own in zip(forces.contacts, hidden, strict=True):
            pairs = zip(segments, own, strict=True)
            force = [each.greatest_amplitude(segment) if each else 0.0 * segment.lines for segment, each in pairs]
            frequency = np.concatenate([segment.frequency for segment in segments])
            ratio = np.abs(contact.thrust_ratio(2 * np.pi * frequency)) if self.frictions else 1.0
            total = total + ratio * np.concatenate(force)
        return np.asarray(total)

    def _response_with(
        self, forces: ContactForces, hidden: Sequence[HiddenForce | None], found: FrequencyResponse
    ) -> NDArray[np.complex128]:
        """Return the response, shape (n,), with the friction force that standstill hides."""
        signals = forces.signals
        pairs = list(zip(signals.segments, hidden, strict=True))
        if self.method is None:
            change = [each.phasors(segment) if each else 0.0 * segment.lines for segment, each in pairs]
            y = [phasors(segment, self.output).mean(axis=0) for segment in signals.segments]
            return found.response / (1 + found.response * np.concatenate(change) / np.concatenate(y))
        extended = forces.with_effective_input(self)
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
        self, signals: Signals, forces: ContactForces, found: Result, relative_degree: int
    ) -> tuple[Result, list[MotionErrors] | None]:
        """Return the result with a band that contains the errors of the encoder, and of what lies between samples.

        With them, if friction makes them, as drawn for each segment.
        """
        if found.response is None or not self._encoder_matters(signals):
            return found, None
        if not any(contact.observer.law.state_size for contact in forces.contacts):
            return with_rounding(found, signals.segments, self.output, self.resolution, self.encoder), None
        motions, unsampled = None, None
        if not self.frictions:
            plant = PlantAboveModes.of_gain(gain_above_modes(found.response, relative_degree), relative_degree)
            plant, motions = likely_motions(self, signals.segments, plant)
            unsampled = unsampled_errors(self, signals.segments, plant)
        errors = list(draw_errors(forces, self.output, motions))
        response = with_possible_motions(found.response, signals, self.output, errors, unsampled)
        return replace(found, response=response), errors


def _scale_name(contact: str, scale: str) -> str:
    """Return the name of a scale of the friction model of a contact, or of the only one."""
    return f"{contact}: {scale}" if contact else scale


def _add_force(segment: Segment, hidden: HiddenForce | None) -> Segment:
    """Return a segment whose û_e contains the friction force that standstill hides."""
    if hidden is None:
        return segment
    effective = segment.channels[EFFECTIVE_INPUT]
    changed = effective + np.fft.irfft(hidden.spectrum, effective.size).reshape(effective.shape)
    return replace(segment, channels={**segment.channels, EFFECTIVE_INPUT: changed})


def _as_single_periods(signals: Signals) -> Signals:
    """Return signals in which each segment is one long period at the same frequencies, whose end is not its past."""
    from_rest = Settling(time=0.0, residual=float("nan"), settled=True)
    segments = [
        replace(
            segment,
            channels={name: values.reshape(1, -1) for name, values in segment.channels.items()},
            lines=segment.lines * len(next(iter(segment.channels.values()))),
            settling=from_rest,
        )
        for segment in signals.segments
    ]
    return replace(signals, segments=tuple(segments))
