"""The proposed FRA method for machines with friction at several contacts, or away from the measured position."""

from collections.abc import Iterable, Mapping, Sequence
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
from fraexp_plugins.estimators._shared.effective_input_observer import EFFECTIVE_INPUT
from fraexp_plugins.estimators._shared.friction_consistency import (
    STATED_STDS,
    ContactFriction,
    StatedDeviation,
    model_error,
)
from fraexp_plugins.estimators._shared.further_thrusts import further_thrusts, record_omega, refer_thrusts
from fraexp_plugins.estimators._shared.model_covariance import inverse_response, outer_parts, with_model_covariance
from fraexp_plugins.estimators._shared.parameter_uncertainty import Deviation, check_deviations, perturbations
from fraexp_plugins.estimators._shared.response_doubts import (
    check_contact_standstill,
    check_friction_models,
    check_unbanded_encoder,
)
from fraexp_plugins.estimators._shared.standstill import HiddenForce, hidden_forces
from fraexp_plugins.estimators.effective_input import DIFFERENCE_STEP_STDS, EffectiveInput


class _Compensation(NamedTuple):
    """A record with the displacements of its contacts, and the friction force at each."""

    signals: Signals
    contacts: tuple[ContactFriction, ...]


class MultiContactEffectiveInput(DelayedEstimator, name="multi_contact_effective_input", version=4):
    """P̂ = y'/û_e with û_e = G_di G_do u - Σ R_c f̂_c: eqs (2)-(5), with a friction model for each contact c.

    A friction model is driven by the displacement of its contact, as far as measured positions give it: one of them, or
    a difference such as motor less link. Channel `y` is the position that is fed back, `y.motor` another one. R_c is
    the thrust that moves the output as a unit of the contact's force does: P_yc/P_yu of the nominal plant. Where
    friction acts at the thrust itself, as at a motor, it is 1 whatever the plant is.

    The displacement of one contact may be unknown. It is then reconstructed from the position that is fed back, by the
    nominal plant. Both uses of the nominal plant cost what it is wrong. With standard deviations of its parameters,
    `plant_deviations`, the confidence band contains that: they move the nominal plant, and with it 1/P̂.

    The band does not contain noise and rounding of the encoder, which act on P̂ through the friction models. A message
    states how far they may move the response where that is more than 1 % and than the band, from the greatest stiffness
    of the models; more than 10 % is not ok.

    At harmonics of a sine friction alone moves the plant. Where they lie within the measured frequencies and contradict
    the friction models by more than encoder and plant explain, the sweep is not ok, and says how wrong they are. What
    is wrong at one contact counts by its share of the friction force, and a wrong nominal plant counts too.

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
        return self.model_copy(update={**known, **certain})

    def model_post_init(self, context: object) -> None:
        """Check that the nominal plant has the parameters that deviate."""
        try:
            check_deviations(self.nominal_plant, self.plant_deviations, ())
        except ParameterError as error:
            raise ParameterError(f"{self.name}.plant_{error}") from None

    def estimate(self, signals: Signals) -> Result:
        """Return y'/û_e at each frequency, with a band that contains the stated deviations of the nominal plant."""
        if not signals.segments:
            return Result(signals.outcome, signals.message)
        compensation = self._compensation(signals)
        found = self._estimate_along(compensation)
        if found.response is None:
            return found
        others = self._neighbours(signals)
        if others:
            covariance = np.zeros((found.response.frequency.size, 2, 2))
            for above, below, steps in others:
                inverses = [inverse_response(self._estimate_along(each)) for each in (above, below)]
                covariance += outer_parts((inverses[0] - inverses[1]) / (2 * steps))
            found = replace(found, response=with_model_covariance(found.response, covariance))
        if found.response is not None and (self.noise or self.resolution):
            found = check_unbanded_encoder(found, self._encoder_error(compensation, found.response))
        return self._check_models(found, compensation, others)

    def _encoder_error(self, compensation: _Compensation, response: FrequencyResponse) -> NDArray[np.float64]:
        """Return by how much noise and rounding may move the response, relative to it, shape (n,): two deviations.

        An error of a displacement changes the force by no more than the friction model's greatest stiffness.
        """
        segments, contacts = compensation
        position, force = [], []
        for segment in segments.segments:
            encoder = Encoder(self.noise / np.sqrt(len(segment.channels[self.output])), self.resolution)
            deviation, omega = float(np.sqrt(phasor_variance(segment, encoder)[0])), 2 * np.pi * segment.frequency
            position.append(np.full(omega.size, deviation))
            force.append(
                np.add.reduce([np.zeros(omega.size), *(c.force_deviation(omega, deviation) for c in contacts)])
            )
        with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
            return np.asarray(
                STATED_STDS
                * (
                    np.concatenate(position) / response.output_amplitude
                    + np.concatenate(force) / response.input_amplitude
                )
            )

    def _neighbours(self, signals: Signals) -> list[tuple[_Compensation, _Compensation, float]]:
        """Return, for each stated deviation of the nominal plant, the compensation above and below, and its steps."""
        found = []
        for above, below, steps in perturbations(self.nominal_plant, self.plant_deviations, (), DIFFERENCE_STEP_STDS):
            upper, lower = (self.model_copy(update={"nominal_plant": plant}) for plant in (above, below))
            found.append((upper._compensation(signals), lower._compensation(signals), steps))
        return found

    def _check_models(
        self,
        found: Result,
        compensation: _Compensation,
        others: Sequence[tuple[_Compensation, _Compensation, float]],
    ) -> Result:
        """Return a result that is not ok where the harmonics of the motion contradict the friction models."""
        segments, contacts = compensation.signals.segments, compensation.contacts
        if found.response is None:
            return found
        hidden = [hidden_forces(each.observer, segments) for each in contacts]
        if any(map(any, hidden)):
            return _check_standstill(found, compensation, hidden)  # what it hides is no error of a model
        encoder = Encoder(self.noise, self.resolution)
        stated = [StatedDeviation(above.contacts, below.contacts, steps) for above, below, steps in others]
        return check_friction_models(found, model_error(self, encoder, segments, contacts, found.response, stated))

    def _compensation(self, signals: Signals) -> _Compensation:
        """Return the displacement of each contact that has friction, and the force of its friction model."""
        ports = self.nominal_plant.ports().closed_by(self.thrust, self.position)
        models, target = self._models(ports), self._position_of(self.output, ports)
        weights = self._displacement_weights(signals, ports, models)
        signals = self._with_displacements(signals, ports, models, weights)
        signals = refer_thrusts(signals, self.input, ports, target)
        contacts = [self._contact(name, model, ports, signals, target, weights[name]) for name, model in models.items()]
        return _Compensation(signals, tuple(contacts))

    def _contact(
        self,
        name: str,
        model: FrictionModel,
        ports: Ports,
        signals: Signals,
        target: str,
        weights: Mapping[str, float] | None,
    ) -> ContactFriction:
        """Return the friction force of a contact whose displacement is a channel of the signals."""
        observer = self._observer(name, model, ports, signals.segments)

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
        self, contact: str, model: FrictionModel, ports: Ports, segments: Sequence[Segment]
    ) -> EffectiveInput:
        """Return the observer of one contact, which is driven by its displacement."""
        shared = {name: getattr(self, name) for name in DelayedEstimator.model_fields if name != "output"}
        observer = EffectiveInput(
            friction=model,
            output=contact_channel(contact),
            resolution=self.resolution,
            noise=self.noise,
            interpolation_tolerance=self.interpolation_tolerance,
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
