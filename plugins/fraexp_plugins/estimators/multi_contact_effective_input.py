"""The proposed FRA method for machines with friction at several contacts, or away from the measured position."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    Encoder,
    FrequencyResponse,
    FrictionModel,
    ParameterError,
    Plant,
    Ports,
    PositionDependentFriction,
    Result,
    Segment,
    Signals,
    param,
    phasor_variance,
    phasors,
    record_spectrum,
    response_result,
)
from fraexp_plugins.estimators._shared.contact_displacement import (
    contact_channel,
    position_weights,
    with_displacement,
)
from fraexp_plugins.estimators._shared.delayed_estimator import DelayedEstimator
from fraexp_plugins.estimators._shared.effective_input_observer import EFFECTIVE_INPUT, ObserverEstimator
from fraexp_plugins.estimators._shared.friction_posterior import SineRecord, harmonic_lines, line_omega, record_terms
from fraexp_plugins.estimators._shared.further_thrusts import further_thrusts, record_omega, refer_thrusts
from fraexp_plugins.estimators._shared.model_covariance import inverse_response
from fraexp_plugins.estimators._shared.parameter_uncertainty import (
    Deviation,
    check_deviations,
    covariance_root,
    moved_within_bounds,
)
from fraexp_plugins.estimators._shared.response_doubts import (
    check_contact_standstill,
    check_unbanded_encoder,
    judge_band,
)
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
from fraexp_plugins.estimators.effective_input import EffectiveInput

ENCODER_STDS = 2.0
"""Standard deviations of an error by the encoder that count as its greatest."""
Scales = Mapping[str, tuple[float, float]]
"""Factors on force and deflections of the friction model of each contact."""


class ContactFriction(NamedTuple):
    """The friction model's force at a contact along a record, and how it acts on the measured position."""

    observer: ObserverEstimator
    """Its `output` is the channel of the contact's displacement."""
    segments: Sequence[Segment]
    """The record with that channel."""
    forces: Sequence[NDArray[np.float64]]
    """The model's force along each segment, as the observer gives it."""
    thrust_ratio: Callable[[NDArray[np.float64]], NDArray[np.complex128]]
    """Returns the thrust that moves the output as a unit of the force does, at ω [rad/s]."""
    error_ratio: Callable[[NDArray[np.float64]], NDArray[np.float64]]
    """Returns the error of the displacement over that of a measured position, at ω [rad/s]."""

    def terms(self, number: int) -> NDArray[np.complex128]:
        """Return all its friction as thrust [N] at the excited line of a segment and at its multiples."""
        observer, segment, force = self.observer, self.segments[number], self.forces[number]
        lines, mean = harmonic_lines(segment), np.add.reduce(force, axis=0) / len(force)
        omega = line_omega(segment, lines)
        found = np.fft.rfft(mean)[lines] * (2 / mean.size) * observer.force_factor(omega)
        found += 1j * omega * observer.friction.viscous * record_terms(segment, observer.output, lines)
        return np.asarray(self.thrust_ratio(omega) * found)

    def stiffness(self, omega: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the greatest change of that thrust by an error of a measured position [N/m], at ω [rad/s]."""
        observer = self.observer
        greatest = observer.friction.max_stiffness * observer.force_scale / observer.displacement_scale
        return np.asarray(np.abs(self.thrust_ratio(omega)) * greatest * self.error_ratio(omega))


class _Compensation(NamedTuple):
    """A record with the displacements of its contacts, and the friction force at each."""

    signals: Signals
    contacts: tuple[ContactFriction, ...]

    def stiffness(self, omega: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the greatest change of all friction by an error of a measured position [N/m], at ω [rad/s]."""
        return np.add.reduce([np.zeros(omega.size), *(contact.stiffness(omega) for contact in self.contacts)])

    def force_terms(self) -> list[NDArray[np.complex128]]:
        """Return the terms of all friction as thrust [N] in each segment, at the excited line and its multiples."""
        none = [np.zeros(harmonic_lines(segment).size, dtype=complex) for segment in self.signals.segments]
        return [
            np.add.reduce([nothing, *(contact.terms(number) for contact in self.contacts)])
            for number, nothing in enumerate(none)
        ]


class MultiContactEffectiveInput(DelayedEstimator, name="multi_contact_effective_input", version=4):
    """P̂ = y'/û_e with û_e = G_di G_do u - Σ R_c f̂_c: eqs (2)-(5), with a friction model for each contact c.

    A friction model is driven by the displacement of its contact, as far as measured positions give it: one of them, or
    a difference such as motor less link. Channel `y` is the position that is fed back, `y.motor` another one. R_c is
    the thrust that moves the output as a unit of the contact's force does: P_yc/P_yu of the nominal plant. Where
    friction acts at the thrust itself, as at a motor, it is 1 whatever the plant is.

    The displacement of one contact may be unknown. It is then reconstructed from the position that is fed back, by the
    nominal plant. Both uses of the nominal plant cost what it is wrong. With standard deviations of its parameters,
    `plant_deviations`, the confidence band contains that, as it contains the errors of the friction models. Harmonics
    narrow both, and move the response to the most probable ones, as with effective_input.

    The band does not contain noise and rounding of the encoder, which act on P̂ through the friction models. A message
    states how far they may move the response where that is more than 1 % and than the band, from the greatest stiffness
    of the models; more than 10 % is not ok.

    `output` chooses the position of the response: `y.load` for the one called load. Control inputs of further thrusts,
    such as `u.right`, count as friction does: as the thrust that moves the output so, by the nominal plant. The
    response is then that of the plant, not of one whose other thrusts hold their positions.
    """

    frictions: dict[str, FrictionModel] = param("", "friction model of each contact", inherit="friction")
    nominal_plant: Plant = param("", "plant by which friction acts at a distance", inherit="plant")
    thrust: str = param("", "thrust that is excited, as in the loop", "", inherit="loop.thrust")
    position: str = param("", "position that is fed back, as in the loop", "", inherit="loop.position")
    resolution: float = param("m", "quantisation step of the encoder", 0.0, at_least=0, inherit="loop.resolution")
    noise: float = param("m", "standard deviation of the encoder's noise", 0.0, at_least=0, inherit="loop.noise")
    force_std: float | None = param(
        "1", f"relative standard deviation of ΣF_m of each contact; {UNSTATED}", None, at_least=0, below=1
    )
    displacement_std: float | None = param(
        "1", f"relative standard deviation of the deflections Y_m of each; {UNSTATED}", None, at_least=0, below=1
    )
    plant_deviations: tuple[Deviation, ...] = param(
        "",
        "standard deviations of the nominal plant's parameters, such as { parameter = 'stiffness', std = 4000.0 }",
        (),
    )
    interpolation_tolerance: float = param(
        "1", "relative error of y'/u that is tolerated", 1e-4, at_least=1e-5, at_most=0.1, inherit="numerics.tolerance"
    )

    def matched(self, machine: Mapping[str, object]) -> Self:
        """Return the estimator of the machine itself, with an ideal encoder."""
        frictions, fields = machine["friction"], type(self).model_fields
        known = {name: value for name, value in machine.items() if name in fields}
        if isinstance(frictions, Mapping):
            known["frictions"] = dict(frictions)
        certain: dict[str, object] = {"resolution": 0.0, "noise": 0.0, "plant_deviations": ()}
        certain |= {"force_std": 0.0, "displacement_std": 0.0}
        return self.model_copy(update={**known, **certain})

    def model_post_init(self, context: object) -> None:
        """Check that the nominal plant has the parameters that deviate."""
        try:
            check_deviations(self.nominal_plant, self.plant_deviations, ())
        except ParameterError as error:
            raise ParameterError(f"{self.name}.plant_{error}") from None

    def estimate(self, signals: Signals) -> Result:
        """Return y'/û_e at each frequency, with a band that contains errors of the friction models and of the plant."""
        if not signals.segments:
            return Result(signals.outcome, signals.message)
        compensation = self._compensation(signals)
        found = self._estimate_along(compensation)
        if found.response is None:
            return found
        if self.noise or self.resolution:
            found = check_unbanded_encoder(found, self._encoder_error(compensation, found.response))
        segments = compensation.signals.segments
        hidden = [hidden_forces(each.observer, segments) for each in compensation.contacts]
        errors = self._errors(signals, compensation)
        record = None
        if any(map(any, hidden)):  # what it hides is no error of a model
            found = _check_standstill(found, compensation, hidden)
        elif found.response is not None:
            record = SineRecord(self, segments, Encoder(self.noise, self.resolution), found.response)
        return judge_band(with_model_errors(found, record, errors))

    def _errors(self, signals: Signals, compensation: _Compensation) -> ModelErrors:
        """Return what is uncertain of the friction models, contact by contact, and of the nominal plant."""
        is_known, stated = knows_machine(self, self.frictions, signals), (self.force_std, self.displacement_std)
        stds: dict[str, float] = {}
        for contact in compensation.contacts:
            name = contact.observer.output.removeprefix(contact_channel(""))
            for scale, std in zip(SCALES, stated, strict=True):
                model = self.frictions[name]
                is_positioned = scale == SCALES[1] and isinstance(model, PositionDependentFriction)
                stds[f"{name}: {scale}"] = prior_std(std, model, is_known=is_known or is_positioned)
        scales = {name: (1.0, std) for name, std in stds.items() if std}
        columns = covariance_root(self.nominal_plant, self.plant_deviations, ())

        def applied(sizes: NDArray[np.float64]) -> _Compensation:
            factors = dict(zip(scales, scale_factors([std for _, std in scales.values()], sizes), strict=True))
            plant = moved_within_bounds(self.nominal_plant, self.plant_deviations, columns @ sizes[len(scales) :])
            return self.model_copy(update={"nominal_plant": plant})._compensation(signals, factors)

        return ModelErrors(
            scales,
            columns.shape[1],
            lambda sizes: applied(sizes).force_terms(),
            lambda sizes: inverse_response(self._estimate_along(applied(sizes))),
            compensation.stiffness,
        )

    def _encoder_error(self, compensation: _Compensation, response: FrequencyResponse) -> NDArray[np.float64]:
        """Return by how much noise and rounding may move the response, relative to it, shape (n,): two deviations.

        An error of a displacement changes the force by no more than the friction model's greatest stiffness.
        """
        position, force = [], []
        for segment in compensation.signals.segments:
            encoder = Encoder(self.noise / np.sqrt(len(segment.channels[self.output])), self.resolution)
            deviation, omega = (
                float(np.sqrt(phasor_variance(segment, encoder, self.output)[0])),
                2 * np.pi * segment.frequency,
            )
            position.append(np.full(omega.size, deviation))
            force.append(deviation * compensation.stiffness(omega))
        with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
            moved = np.concatenate(position) / response.output_amplitude
            return np.asarray(ENCODER_STDS * (moved + np.concatenate(force) / response.input_amplitude))

    def _compensation(self, signals: Signals, factors: Mapping[str, float] | None = None) -> _Compensation:
        """Return the displacement of each contact that has friction, and the force of its friction model.

        `factors` change scales of the models, by their names such as `motor: force_scale`.
        """
        ports = self.nominal_plant.ports().closed_by(self.thrust, self.position)
        models, target = self._models(ports), self._position_of(self.output, ports)
        weights = self._displacement_weights(signals, ports, models)
        signals = self._with_displacements(signals, ports, models, weights)
        signals = refer_thrusts(signals, self.input, ports, target)
        scales = {name: [(factors or {}).get(f"{name}: {scale}", 1.0) for scale in SCALES] for name in models}
        contacts = [
            self._contact(name, model, ports, signals, target, weights[name], scales[name])
            for name, model in models.items()
        ]
        return _Compensation(signals, tuple(contacts))

    def _contact(
        self,
        name: str,
        model: FrictionModel,
        ports: Ports,
        signals: Signals,
        target: str,
        weights: Mapping[str, float] | None,
        scales: Sequence[float],
    ) -> ContactFriction:
        """Return the friction force of a contact whose displacement is a channel of the signals."""
        observer = self._observer(name, model, ports, signals.segments, scales)

        def thrust_ratio(omega: NDArray[np.float64]) -> NDArray[np.complex128]:
            share = ports.share(ports.contacts[name].force, omega, target)
            return np.broadcast_to(np.asarray(share, dtype=complex), omega.shape)

        def error_ratio(omega: NDArray[np.float64]) -> NDArray[np.float64]:
            if weights is None:
                return np.abs(_reconstruction_ratio(ports, name, omega))
            return np.full(omega.size, np.abs(list(weights.values())).sum())

        forces = observer._forces(signals.segments)
        return ContactFriction(observer, signals.segments, forces, thrust_ratio, error_ratio)

    def _estimate_along(self, compensation: _Compensation) -> Result:
        """Return y'/û_e with these friction forces."""
        signals, contacts = compensation
        units = (signals.unit(self.input), signals.unit(self.output))
        inputs = self._effective_phasors(signals.segments, contacts)
        outputs = [phasors(segment, self.output) for segment in signals.segments]
        return response_result(signals, inputs, outputs, names=(EFFECTIVE_INPUT, self.output), units=units)

    def _models(self, ports: Ports) -> dict[str, FrictionModel]:
        """Return the models of the contacts that have friction; ParameterError for one that the plant does not have."""
        for contact in self.frictions:
            if contact not in ports.contacts:
                known = ", ".join(ports.contacts)
                raise ParameterError(
                    f"{self.name}.frictions: the nominal plant has no contact '{contact}'; known: {known}"
                )
        return {name: model for name, model in self.frictions.items() if model.state_size or model.viscous}

    def _observer(
        self,
        contact: str,
        model: FrictionModel,
        ports: Ports,
        segments: Sequence[Segment],
        scales: Sequence[float] = (1.0, 1.0),
    ) -> EffectiveInput:
        """Return the observer of one contact, which is driven by its displacement."""
        shared = {name: getattr(self, name) for name in DelayedEstimator.model_fields if name != "output"}
        observer = EffectiveInput(
            friction=model,
            output=contact_channel(contact),
            resolution=self.resolution,
            noise=self.noise,
            interpolation_tolerance=self.interpolation_tolerance,
            **dict(zip(SCALES, scales, strict=True)),
            **shared,
        )
        return observer.resolve_oversampling(segments)

    def _effective_phasors(
        self, segments: Sequence[Segment], contacts: Sequence[ContactFriction]
    ) -> list[NDArray[np.complex128]]:
        """Return the phasors of û_e [N] per segment, each of shape (periods, lines)."""
        omegas = [2 * np.pi * segment.frequency for segment in segments]
        found = [
            self.input_path(omega, segment.sample_time) * self.output_path(omega) * phasors(segment, self.input)
            for omega, segment in zip(omegas, segments, strict=True)
        ]
        for contact in contacts:
            forces = contact.observer.friction_phasors(segments, contact.forces)
            for number, (omega, force) in enumerate(zip(omegas, forces, strict=True)):
                found[number] = found[number] - contact.thrust_ratio(omega) * force
        return found

    def _position_of(self, channel: str, ports: Ports) -> str:
        """Return the name of the position that a channel measures."""
        names = _position_channels(ports)
        if channel not in names:
            known = ", ".join(names)
            raise ParameterError(f"{self.name}.output is '{channel}'; expected the channel of a position: {known}")
        return names[channel]

    def _displacement_weights(
        self, signals: Signals, ports: Ports, contacts: Iterable[str]
    ) -> dict[str, dict[str, float] | None]:
        """Return the weights by which channels add up to each contact's displacement; None if they do not."""
        measured = {channel: name for channel, name in _position_channels(ports).items() if channel in signals.units}
        rows = np.array([ports.positions[name] for name in measured.values()]).reshape(-1, ports.a.shape[0])
        found: dict[str, dict[str, float] | None] = {}
        for contact in contacts:
            weights = position_weights(rows, ports.contacts[contact].displacement)
            found[contact] = None if weights is None else dict(zip(measured, weights.tolist(), strict=True))
        return found

    def _with_displacements(
        self,
        signals: Signals,
        ports: Ports,
        models: Mapping[str, FrictionModel],
        weights: Mapping[str, Mapping[str, float] | None],
    ) -> Signals:
        """Return the signals with a channel for the displacement of each contact that has friction."""
        for contact, own in weights.items():
            if own is not None:
                signals = with_displacement(signals, contact, own)
        hidden = [contact for contact, own in weights.items() if own is None]
        return self._with_reconstruction(signals, ports, models, hidden) if hidden else signals

    def _with_reconstruction(
        self, signals: Signals, ports: Ports, models: Mapping[str, FrictionModel], hidden: Sequence[str]
    ) -> Signals:
        """Return the signals with the displacement of the contact that no encoder sees."""
        if len(hidden) > 1:
            raise ParameterError(
                f"{self.name}: measured positions do not give the displacements of the contacts "
                f"{' and '.join(hidden)}, and only one can be reconstructed; record another position, as channel y.NAME"
            )
        if isinstance(models[hidden[0]], PositionDependentFriction):
            raise ParameterError(
                f"{self.name}: the displacement of contact '{hidden[0]}' is reconstructed without its mean, and its "
                "friction depends on the position; record a position there, as channel y.NAME, or leave out "
                f"position_dependence in {self.name}.frictions.{hidden[0]}"
            )
        spectra = {
            name: self._observer(name, model, ports, signals.segments).force_spectra(signals.segments)
            for name, model in models.items()
            if name not in hidden
        }
        segments = [
            self._reconstruct(segment, hidden[0], ports, {name: each[number] for name, each in spectra.items()})
            for number, segment in enumerate(signals.segments)
        ]
        return replace(signals, segments=tuple(segments))

    def _reconstruct(
        self,
        segment: Segment,
        contact: str,
        ports: Ports,
        forces: Mapping[str, NDArray[np.complex128]],
    ) -> Segment:
        """Return a segment with the displacement of a contact, from the position that is fed back.

        With f_m = (P_yu u - Σ P_yk f_k - y)/P_ym the contact moves by x_m = P_mu u - Σ P_mk f_k - P_mm f_m.
        """
        samples = segment.channels["y"]
        omega = record_omega(segment, samples.size)
        own, fed_back = ports.contacts[contact], ports.measured[0]
        ratio = _reconstruction_ratio(ports, contact, omega)

        def part(column: NDArray[np.float64]) -> NDArray[np.complex128]:
            """Return how a force moves the contact while the position stays where it was measured."""
            direct = ports.transfer(column, own.displacement, omega)
            return direct - ratio * ports.transfer(column, fed_back, omega)

        path = self.input_path(omega, segment.sample_time) * self.output_path(omega)
        bins = ratio * record_spectrum(segment, "y")[1:]
        for channel, column in {self.input: ports.drive, **further_thrusts(segment.channels, ports)}.items():
            bins = bins + part(column) * path * record_spectrum(segment, channel)[1:]
        for name, spectrum in forces.items():
            bins = bins - part(ports.contacts[name].force) * spectrum[1:]
        displacement = np.fft.irfft(np.concatenate([[0.0], bins]), samples.size).reshape(samples.shape)
        return replace(segment, channels={**segment.channels, contact_channel(contact): displacement})


def _check_standstill(
    found: Result, compensation: _Compensation, hidden: Sequence[Sequence[HiddenForce | None]]
) -> Result:
    """Return a result that is not ok where standstill hides friction, and that says how far it may be off."""
    if found.response is None:
        return found
    segments, names, shares = compensation.signals.segments, [], [0.0]
    error = np.zeros(found.response.frequency.size)
    for contact, own in zip(compensation.contacts, hidden, strict=True):
        force = [
            np.abs(contact.thrust_ratio(2 * np.pi * segment.frequency))
            * (each.greatest_amplitude(segment) if each else 0.0)
            for segment, each in zip(segments, own, strict=True)
        ]
        error += np.concatenate(force) / found.response.input_amplitude
        names += [contact.observer.output.removeprefix(contact_channel(""))] if any(own) else []
        shares += [each.share for each in own if each]
    return check_contact_standstill(found, error, names, max(shares))


def _position_channels(ports: Ports) -> dict[str, str]:
    """Return the positions' names by their channels."""
    fed_back, *others = ports.positions
    return {"y": fed_back, **{f"y.{name}": name for name in others}}


def _reconstruction_ratio(ports: Ports, contact: str, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Return P_mm/P_ym: how far the contact moves if its force alone moves the position that is fed back."""
    own, fed_back = ports.contacts[contact], ports.measured[0]
    return ports.transfer(own.force, own.displacement, omega) / ports.transfer(own.force, fed_back, omega)
