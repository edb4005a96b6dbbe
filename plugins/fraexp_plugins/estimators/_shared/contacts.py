"""The contacts of a machine along a record: how far each moves, and how its friction acts on the response."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import ROUNDING, ParameterError, Ports, Segment, Signals, record_spectrum
from fraexp_plugins.estimators._shared.effective_input_observer import EFFECTIVE_INPUT, ObserverEstimator, at_lines
from fraexp_plugins.estimators._shared.friction_posterior import harmonic_lines, line_omega, record_terms

Ratio = Callable[[NDArray[np.float64]], NDArray[np.complex128]]
"""Returns a ratio, shape (n,), at ω [rad/s]."""


class ContactFriction(NamedTuple):
    """The friction model's force at a contact along a record, and how it acts on the measured position."""

    name: str
    """Empty if it is the only one."""
    observer: ObserverEstimator
    """Its `output` is the channel of the contact's displacement."""
    forces: Sequence[NDArray[np.float64]]
    """The model's force along each segment, as the observer gives it."""
    thrust_ratio: Ratio
    """Returns the thrust that moves the output as a unit of the force does."""
    position_ratios: Mapping[str, Ratio]
    """By the channels of measured positions, how far the contact moves as each of them does."""

    def terms(self, segment: Segment, force: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return all its friction as thrust [N] at the excited line of a segment and at its multiples."""
        lines, mean = harmonic_lines(segment), np.add.reduce(force, axis=0) / len(force)
        omega = line_omega(segment, lines)
        found = np.fft.rfft(mean)[lines] * (2 / mean.size) * self.observer.force_factor(omega)
        found += 1j * omega * self.observer.law.viscous * record_terms(segment, self.observer.output, lines)
        return np.asarray(self.thrust_ratio(omega) * found)

    def stiffness(self, omega: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the greatest change of that thrust by an error of a measured position [N/m], at ω [rad/s]."""
        greatest = self.observer.law.max_stiffness * self.observer.force_scale / self.observer.displacement_scale
        moved = np.add.reduce([np.abs(ratio(omega)) for ratio in self.position_ratios.values()])
        return np.asarray(np.abs(self.thrust_ratio(omega)) * greatest * moved)


@dataclass(frozen=True, eq=False)
class ContactForces:
    """A record with the displacements of its contacts, and the friction force at each."""

    signals: Signals
    contacts: tuple[ContactFriction, ...]

    @cached_property
    def friction_phasors(self) -> list[NDArray[np.complex128]]:
        """Phasors of all friction as thrust [N] per segment, each of shape (periods, lines)."""
        segments = self.signals.segments
        found = [np.zeros((len(next(iter(s.channels.values()))), s.lines.size), dtype=complex) for s in segments]
        for contact in self.contacts:
            forces = contact.observer.friction_phasors(segments, contact.forces)
            given = zip(found, at_lines(segments, contact.thrust_ratio), forces, strict=True)
            found = [others + ratio * force for others, ratio, force in given]
        return found

    def friction_spectrum(self, number: int) -> NDArray[np.complex128]:
        """Return the spectrum of all friction as thrust [N] over the whole record of a segment, shape (n // 2 + 1,)."""
        segment = self.signals.segments[number]
        size = next(iter(segment.channels.values())).size
        omega, found = record_omega(segment, size), np.zeros(size // 2 + 1, dtype=complex)
        for contact in self.contacts:
            own = contact.observer.force_spectrum(segment, contact.forces[number])
            found += np.concatenate([own[:1], contact.thrust_ratio(omega) * own[1:]])
        return found

    def force_terms(self) -> list[NDArray[np.complex128]]:
        """Return the terms of all friction as thrust [N] in each segment, at the excited line and its multiples."""
        return [
            sum(
                (contact.terms(segment, contact.forces[number]) for contact in self.contacts),
                start=np.zeros(harmonic_lines(segment).size, dtype=complex),
            )
            for number, segment in enumerate(self.signals.segments)
        ]

    def stiffness(self, omega: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the greatest change of all friction by an error of a measured position [N/m], at ω [rad/s]."""
        return sum((contact.stiffness(omega) for contact in self.contacts), start=np.zeros(omega.size))

    def with_effective_input(self, estimator: ObserverEstimator) -> Signals:
        """Return the signals with û_e [N] as one more channel, at the samples and limited to their band.

        Delays, hold and friction act on the spectrum of the whole record. If the record is not periodic they use its
        end as the past of its beginning. The error is as smooth over frequency as the transient itself, so that
        estimators that remove the transient remove this error too.
        """
        signals, found = self.signals, []
        for number, segment in enumerate(signals.segments):
            thrust = estimator.thrust_spectrum(segment)
            shape = segment.channels[estimator.input].shape
            effective = np.fft.irfft(thrust - self.friction_spectrum(number), shape[0] * shape[1]).reshape(shape)
            extended = replace(segment, channels={**segment.channels, EFFECTIVE_INPUT: effective})
            extended.cache.update(segment.cache)
            found.append(extended)
        units = {**signals.units, EFFECTIVE_INPUT: signals.unit(estimator.input)}
        return replace(signals, segments=tuple(found), units=units)


def only_contact(observer: ObserverEstimator, signals: Signals) -> ContactForces:
    """Return the friction of a machine whose one contact moves as the output does, and is at its thrust."""
    unity = partial(_constant, 1.0)
    contact = ContactFriction("", observer, observer._forces(signals.segments), unity, {observer.output: unity})
    return ContactForces(signals, (contact,))


class ContactPlant(NamedTuple):
    """A nominal plant by which friction at a distance acts, and hidden displacements follow from measured ones."""

    ports: Ports
    """Those of the loop are the first."""
    position: str
    """The position of the response."""
    place: str
    """What messages begin with."""

    @classmethod
    def of(cls, ports: Ports, output: str, contacts: Sequence[str], place: str) -> "ContactPlant":
        """Return the plant for a channel of the response, and the contacts that have friction models."""
        for contact in contacts:
            if contact not in ports.contacts:
                known = ", ".join(ports.contacts)
                raise ParameterError(f"{place}.frictions: the nominal plant has no contact '{contact}'; known: {known}")
        names = _position_channels(ports)
        if output not in names:
            known = ", ".join(names)
            raise ParameterError(f"{place}.output is '{output}'; expected the channel of a position: {known}")
        return cls(ports, names[output], place)

    def contact(
        self, name: str, observer: ObserverEstimator, signals: Signals, weights: Mapping[str, float] | None
    ) -> ContactFriction:
        """Return the friction of a contact whose displacement is a channel of the signals."""

        def thrust_ratio(omega: NDArray[np.float64]) -> NDArray[np.complex128]:
            share = self.ports.share(self.ports.contacts[name].force, omega, self.position)
            return np.broadcast_to(np.asarray(share, dtype=complex), omega.shape)

        ratios: dict[str, Ratio] = {"y": partial(self._reconstruction_ratio, name)}
        if weights is not None:
            ratios = {channel: partial(_constant, weight) for channel, weight in weights.items()}
        return ContactFriction(name, observer, observer._forces(signals.segments), thrust_ratio, ratios)

    def displacement_weights(self, signals: Signals, contact: str) -> dict[str, float] | None:
        """Return the weights by which measured positions add up to a contact's displacement; None if they do not."""
        measured = {name: of for name, of in _position_channels(self.ports).items() if name in signals.units}
        rows = np.array([self.ports.positions[of] for of in measured.values()]).reshape(-1, self.ports.a.shape[0])
        row = self.ports.contacts[contact].displacement
        solved = np.linalg.lstsq(rows.T, row, rcond=None)[0]
        weights = np.where(np.abs(solved) > ROUNDING, solved, 0.0).astype(float)
        if not np.allclose(weights @ rows, row, rtol=0.0, atol=ROUNDING * np.abs(row).max()):
            return None
        return {channel: weight for channel, weight in zip(measured, weights.tolist(), strict=True) if weight}

    def with_reconstruction(
        self, signals: Signals, hidden: str, observer: ObserverEstimator, others: ContactForces
    ) -> Signals:
        """Return the signals with the displacement of a contact, from the position that is fed back.

        With f_m = (P_yu u - Σ P_yk f_k - y)/P_ym the contact moves by x_m = P_mu u - Σ P_mk f_k - P_mm f_m.
        """
        ports = self.ports
        own, fed_back = ports.contacts[hidden], ports.measured[0]

        def reconstruct(number: int, segment: Segment) -> Segment:
            samples = segment.channels["y"]
            omega = record_omega(segment, samples.size)
            ratio = self._reconstruction_ratio(hidden, omega)

            def part(column: NDArray[np.float64]) -> NDArray[np.complex128]:
                """Return how a force moves the contact while the position stays where it was measured."""
                direct = ports.transfer(column, own.displacement, omega)
                return direct - ratio * ports.transfer(column, fed_back, omega)

            path = observer.input_path(omega, segment.sample_time) * observer.output_path(omega)
            bins = ratio * record_spectrum(segment, "y")[1:]
            for channel, column in {observer.input: ports.drive, **self._further_thrusts(segment.channels)}.items():
                bins = bins + part(column) * path * record_spectrum(segment, channel)[1:]
            for contact in others.contacts:
                spectrum = contact.observer.force_spectrum(segment, contact.forces[number])
                bins = bins - part(ports.contacts[contact.name].force) * spectrum[1:]
            displacement = np.fft.irfft(np.concatenate([[0.0], bins]), samples.size).reshape(samples.shape)
            return replace(segment, channels={**segment.channels, contact_channel(hidden): displacement})

        return replace(signals, segments=tuple(reconstruct(*each) for each in enumerate(signals.segments)))

    def refer_thrusts(self, signals: Signals, control_input: str) -> Signals:
        """Return signals whose control input counts further thrusts, as the first one that moves the position so.

        Dead time, lags and hold are the same for all thrusts.
        """
        further = self._further_thrusts(signals.units)
        if not further:
            return signals

        def refer(segment: Segment) -> Segment:
            samples, bins = segment.channels[control_input], record_spectrum(segment, control_input).copy()
            omega = record_omega(segment, samples.size)
            for channel, column in further.items():
                bins[1:] += self.ports.share(column, omega, self.position) * record_spectrum(segment, channel)[1:]
            referred = np.fft.irfft(bins, samples.size).reshape(samples.shape)
            return replace(segment, channels={**segment.channels, control_input: referred})

        return replace(signals, segments=tuple(map(refer, signals.segments)))

    def _further_thrusts(self, channels: Mapping[str, object]) -> dict[str, NDArray[np.float64]]:
        """Return the columns of thrusts whose control inputs, such as `u.right`, are among the channels, by channel."""
        return {f"u.{name}": column for name, column in self.ports.thrusts.items() if f"u.{name}" in channels}

    def _reconstruction_ratio(self, contact: str, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return P_mm/P_ym: how far the contact moves if its force alone moves the position that is fed back."""
        own, fed_back = self.ports.contacts[contact], self.ports.measured[0]
        return self.ports.transfer(own.force, own.displacement, omega) / self.ports.transfer(own.force, fed_back, omega)


def _constant(value: float, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
    return np.full(omega.size, value, dtype=complex)


def contact_channel(contact: str) -> str:
    """Return the channel of a contact's displacement."""
    return f"displacement by {contact}"


def with_displacement(signals: Signals, contact: str, weights: Mapping[str, float]) -> Signals:
    """Return the signals with the displacement of a contact, which is a combination of measured positions."""

    def combine(parts: Mapping[str, NDArray[np.float64]]) -> dict[str, NDArray[np.float64]]:
        if not weights.keys() <= parts.keys():
            return {}
        return {contact_channel(contact): sum((w * parts[name] for name, w in weights.items()), start=np.zeros(1))}

    segments = [
        replace(
            segment,
            channels={**segment.channels, **combine(segment.channels)},
            lead_in={**segment.lead_in, **combine(segment.lead_in)},
        )
        for segment in signals.segments
    ]
    return replace(signals, segments=tuple(segments))


def record_omega(segment: Segment, samples: int) -> NDArray[np.float64]:
    """Return the angular frequencies of the spectrum of a record [rad/s], without 0."""
    return np.asarray(2 * np.pi * np.fft.rfftfreq(samples, segment.sample_time)[1:], dtype=float)


def _position_channels(ports: Ports) -> dict[str, str]:
    """Return the positions' names by their channels."""
    fed_back, *others = ports.positions
    return {"y": fed_back, **{f"y.{name}": name for name in others}}
