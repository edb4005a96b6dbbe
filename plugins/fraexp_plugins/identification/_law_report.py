"""The law that explains the records as a model, P̂ and the plant beside it, and how far to believe them.

Amplitude invariance does not separate a force that is linear in the motion from the plant. The assumption that a rigid
body is neither damped nor held by a spring does.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    CURVE_POINTS,
    DIFFERENCE,
    NORMAL_QUANTILE,
    Curve,
    Finding,
    Fit,
    FrequencyResponse,
    FrictionModel,
    Metric,
    Quantity,
    Result,
    Signals,
    significant_deviation,
)
from fraexp_plugins.estimators._shared.effective_input_observer import EFFECTIVE_INPUT
from fraexp_plugins.estimators._shared.realisations import Part, circular_covariance, combine_parts
from fraexp_plugins.friction.none import Frictionless
from fraexp_plugins.identification._law_comparison import Prediction
from fraexp_plugins.identification._law_forces import GridElements, LawForces, virgin_curve
from fraexp_plugins.identification._law_numbers import numbers_of
from fraexp_plugins.identification._least_squares import derivatives
from fraexp_plugins.identification._line_records import LawSolution, LineRecords
from fraexp_plugins.identification._modal_model import GROUND
from fraexp_plugins.identification._modal_solver import Solution
from fraexp_plugins.identification._usable_records import FORCE_FLOOR
from fraexp_plugins.identification.modal_fit import ModalFit

MAX_RELATIVE_STD = 0.2
"""Relative standard deviation of P̂ above which its logarithm has no normal errors, and is not fitted."""


@dataclass(frozen=True)
class InverseResponse:
    """1/P̂ and its errors."""

    frequency: NDArray[np.float64]
    """Frequency [Hz], shape (L,)."""
    values: NDArray[np.complex128]
    """1/P̂ [N/m], complex, shape (L,)."""
    noise: NDArray[np.float64]
    """E|d(1/P̂)|² by noise [N²/m²], shape (L,)."""
    columns: NDArray[np.complex128]
    """The effect of one standard deviation of the friction model, in uncorrelated directions, complex, shape (L, N)."""

    def friction_covariance(self) -> NDArray[np.float64]:
        """Return the covariance of (real, imaginary) part by friction, shape (L, 2, 2)."""
        parts = np.stack([self.columns.real, self.columns.imag], axis=1)
        return np.asarray(parts @ parts.transpose(0, 2, 1))

    def without(
        self, ground: NDArray[np.complex128], columns: NDArray[np.complex128], errors: NDArray[np.float64]
    ) -> "InverseResponse":
        """Return 1/P̂ without forces of ground [N/m], shape (L,), whose errors are some of such columns."""
        return replace(self, values=self.values - ground, columns=np.concatenate([self.columns, columns @ errors], 1))

    def response(self, like: FrequencyResponse) -> FrequencyResponse:
        """Return P̂ with its covariance by noise; points that friction leaves uncertain count as not settled."""
        values, common = 1 / self.values, self.relative_columns
        variance = np.abs(values) ** 2 * self.noise + np.sum(np.abs(common) ** 2, axis=1)
        noise = np.abs(values) ** 4 * self.noise
        return replace(
            like,
            response=values,
            covariance=noise[:, None, None] * np.eye(2) / 2,
            settled=like.settled & (np.sqrt(variance) <= MAX_RELATIVE_STD),
            freedom=None,
            model_covariance=self.friction_covariance(),
        )

    @property
    def relative_columns(self) -> NDArray[np.complex128]:
        """The effect of the errors of friction on ln P̂, complex, shape (L, N)."""
        return -self.columns / self.values[:, None]


@dataclass(frozen=True)
class IdentifiedPlant:
    """The plant, and the linear forces beside it."""

    fit: Result
    """Response and plant as from `modal_fit`, with the friction model in the covariance."""
    viscous: float
    viscous_std: float
    """D [N s/m] and its standard deviation."""
    spring: float
    """K [N/m]; 0 if it is not significant."""
    dead_time: float
    """Dead time that is left in P̂ [s]; 0 unless it was free."""
    lag: float
    """Time constant of a lag that is left in P̂ [s]; 0 unless one was looked for."""
    fall: float
    """How many standard deviations D was below 0 before it was fixed at 0."""
    errors: NDArray[np.float64]
    """Half width of the 95 % band of the plant at the frequencies of `fitted`, relative to it, shape (n,)."""
    fitted: NDArray[np.float64]
    """Frequencies that were fitted [Hz], shape (n,)."""


def identify_plant(
    inverse: InverseResponse, response: FrequencyResponse, modal: ModalFit, may_lag: bool = False
) -> IdentifiedPlant:
    """Return the plant in 1/P̂, behind a lag if it `may_lag` and shows one; RecordError if there is none.

    Its response is `response` with other values.

    The error of the friction model is common to all frequencies, not independent at each. If the plant leaves less than
    the model error of `modal`, that is taken for its error.
    """
    held = modal.model_copy(update={"fit_ground": True})
    found = held.solve(inverse.response(response), inverse.relative_columns, may_lag)
    solution = _with_smaller_error(found.solution, modal.model_error)
    model, covariance = solution.model, solution.model.slopes(solution.p) @ square_root(solution.covariance)
    own = slice(model.ground_place, model.ground_place + len(model.ground))
    s = np.complex128(2j * np.pi) * inverse.frequency
    columns, forces = model.ground_columns(s), model.ground_forces(solution.p)
    free = inverse.without(columns @ forces, columns, covariance[own])
    kept = np.delete(np.arange(model.size), np.arange(model.size)[own])
    bare = modal.log_data(free.response(response), free.relative_columns)
    plant = Solution(replace(model, ground=()), bare, solution.p[kept])
    fit = modal.report(plant, found.causes, replace(free.response(response), settled=response.settled))
    own_covariance = covariance[kept] @ covariance[kept].T
    missing = fit.fits[0].values.size - len(own_covariance)  # a dead time that is fixed has none
    fit = replace(fit, fits=tuple(replace(each, covariance=np.pad(own_covariance, (0, missing))) for each in fit.fits))
    known = dict(zip(model.ground, zip(forces, np.linalg.norm(covariance[own], axis=1), strict=True), strict=True))
    (viscous, viscous_std), (spring, _) = (known.get(name, (0.0, 0.0)) for name in GROUND)
    delay = model.delay(solution.p) if model.dead_time is None else 0.0
    moved = plant.model.jacobian(plant.p, bare.s) @ square_root(solution.covariance)[kept]
    errors = NORMAL_QUANTILE * np.linalg.norm([moved.real, moved.imag], axis=2).max(axis=0)
    ground = float(viscous), float(viscous_std), float(spring)
    return IdentifiedPlant(fit, *ground, delay, model.lag(solution.p), found.fall, errors, bare.frequency)


def _with_smaller_error(solution: Solution, model_error: float) -> Solution:
    """Return a fit with the model error that its residuals show, if that is less than what was allowed for."""
    data = solution.data
    if data.covariance is None:
        return solution
    smaller = max(model_error * np.sqrt(min(solution.excess, 1.0)), min(FORCE_FLOOR, model_error))
    return replace(solution, data=replace(data, covariance=data.covariance - (model_error**2 - smaller**2) * np.eye(2)))


def square_root(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a matrix whose product with its transpose is the covariance."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


WIDTH_FORCE_RATIO = 1 - np.exp(-1)
"""Part of the Coulomb force at the width of a virgin curve."""
MIN_FORCE_SHARE = 0.03
"""Part of the thrust to which a friction has to be known that is less: half of it asks for twice as much of a machine
without friction."""
MAX_MASS_RATIO = 1.25
"""Mass over that of the data sheet, or below it, from which one of both is wrong: motor constants scatter by 10 %."""


GOOD, ACCEPTABLE = 1.5, 2.0
"""Residual over its allowance from which on no other law is tried, and up to which a law explains the records; and in a
search over that of the best law, up to which all records are tried."""
NOISE_ALLOWANCE = 6.0
"""Factor on the part of the residual that noise explains by way of friction."""
ELEMENT_RANGE = (1e-5, 0.9)
"""Range of thresholds over the largest motion, and that of a virgin curve."""


@dataclass(frozen=True, eq=False)
class LawFit:
    """A law that was fitted to records."""

    law: LawForces
    dead_time: float
    """Dead time that goes with it, in addition to that of the observer [s]."""
    residual: float
    """Root mean square of the residuals of all records over what is allowed for."""
    sizes: NDArray[np.float64]
    """Force of each column [N], shape (N,); empty for a hopeless law, which only the search has seen."""
    allowance: float = 0.0
    """The residual that noise explains by way of friction."""
    equations: int = 1
    """How many residuals there are."""

    @property
    def prediction(self) -> Prediction:
        """How well it explains the records: what is allowed for tells no law from another.

        Each equation that says that the axis is a free body is a parameter less.
        """
        return Prediction(max(self.residual, 1.0), self.equations, self.law.shape.size - self.equations)

    @property
    def coulomb(self) -> float:
        """Force in gross sliding [N]."""
        return float(self.sizes[self.law.is_coulomb].sum())

    @property
    def is_good(self) -> bool:
        """Whether no other law can do better."""
        return self.residual**2 <= GOOD**2 + self.allowance**2

    @property
    def explains(self) -> bool:
        """Whether noise and rounding explain what the law leaves."""
        return self.residual**2 <= ACCEPTABLE**2 + NOISE_ALLOWANCE * self.allowance**2


@dataclass(frozen=True)
class LawChoice:
    """The law that explains the records best, with a dead time, and 1/P̂ beside its forces at each excited line."""

    best: LawFit
    covariance: NDArray[np.float64]
    """Covariance of its shape and then of its sizes, shape (S + N, S + N)."""
    interval: tuple[float, float]
    """95 % interval of the Coulomb force [N]: that of all laws that are as good."""
    records: LineRecords
    residuals: dict[str, float]
    """Residual of each law that was tried."""
    dead_time: float
    """Dead time in addition to that of the observer [s]."""
    left_out: tuple[Finding, ...] = ()
    """Which laws are left out, and why."""

    @property
    def _deflection(self) -> NDArray[np.complex128]:
        """Phasors of each column [N/N], complex, shape (L, M, N)."""
        return self.records.deflection(self.best.law)

    def doubt(self) -> Finding | None:
        """Return why no law is to be believed, nor P̂ beside it: nothing bounds what it leaves; None if there is one."""
        if self.best.explains:
            return None
        left = ", ".join(f"{name} {residual:.3g}" for name, residual in self.residuals.items())
        residual = f"residual over what is allowed for: {left}, expected {ACCEPTABLE:g}"
        remedy = (
            "record a third amplitude between the others; check delays, gains, and that friction was the same in all "
            "records; else friction depends on the position, or is of another kind"
        )
        at = tuple(map(float, self.inverse.frequency))
        return Finding(
            "undetermined",
            frequencies=at,
            examined=len(at),
            text=f"no friction law explains the records ({residual})",
            remedy=remedy,
        )

    @cached_property
    def _solution(self) -> LawSolution:
        return self.records.solve(self.best.law, self._deflection, self.dead_time)

    @property
    def forces(self) -> NDArray[np.float64]:
        """Force of each column [N], shape (N,)."""
        return self._solution.sizes

    @property
    def amplitude_ratio(self) -> float:
        """Greatest over least thrust of the records at an excited line, in the median over the lines."""
        records, at = self.records, self.records.is_excited
        known, thrust = records.known[at], np.abs(records.thrust[at])
        least = np.where(known, thrust, np.inf).min(axis=1)
        return float(np.median(np.where(known, thrust, 0.0).max(axis=1) / least))

    @property
    def coulomb(self) -> float:
        """Force in gross sliding [N]."""
        return float(self.forces[self.best.law.is_coulomb].sum())

    @property
    def coulomb_error(self) -> float:
        """Distance from the force in gross sliding to the farther end of its 95 % interval [N]."""
        low, high = self.interval
        return max(high - self.coulomb, self.coulomb - low)

    @cached_property
    def inverse(self) -> InverseResponse:
        """1/P̂ with its errors, at the excited lines."""
        records, problem, law = self.records, self._solution.problem, self.best.law
        excess = max(float(np.sum(self._solution.residual**2)) / records.equations, 1.0)
        errors = square_root(self.covariance[law.shape.size :, law.shape.size :])
        at = records.is_excited
        noise = excess / problem.power[at]
        return InverseResponse(records.frequency[at], self._solution.inverse[at], noise, problem.slopes[at] @ errors)

    @cached_property
    def effective(self) -> NDArray[np.complex128]:
        """Thrust without friction [N], complex, shape (L, M)."""
        return self.records.delayed(self.dead_time) - self._deflection @ self.forces

    def scatter(self, thrust: NDArray[np.complex128]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return how far the records of each excited line differ in P̂ by a thrust [N], and what noise explains.

        Both are relative and weighted as P̂ is, shape (L,): a record in which friction balances nearly all of the thrust
        shows little of the plant, and counts as little. Of one record it is what noise explains.
        """
        records, at = self.records, self.records.is_excited
        weight = np.where(records.known, 1 / records.variance, 0.0)[at]
        u, y, count = thrust[at], records.motion[at], records.known[at].sum(axis=1)
        power = np.sum(weight * np.abs(y) ** 2, axis=1)
        inverse = np.sum(weight * np.conj(y) * u, axis=1) / power
        left = np.sum(weight * np.abs(u - inverse[:, None] * y) ** 2, axis=1) / np.maximum(count - 1, 1)
        floor = np.sqrt(count / (power * np.abs(inverse) ** 2))
        return np.where(count > 1, np.sqrt(left), 1.0) * floor, floor

    def response(self, signals: Signals, channels: tuple[str, str]) -> Result:
        """Return P̂ between control input and position [m/N], before linear forces are removed."""
        records = self.records
        values, noise = 1 / self.inverse.values, self.inverse.noise
        band, count = circular_covariance(np.abs(values) ** 4 * noise), records.known.sum(axis=1)
        at, known = records.is_excited, records.known
        inputs, outputs = (np.where(known, np.abs(each), 0.0).sum(axis=1) for each in (self.effective, records.motion))
        sizes = inputs[at] / count[at], outputs[at] / count[at]
        parts, begin = [], 0
        for group in records.groups:
            segments = tuple(signals.segments[place] for place in group)
            rows = slice(begin, begin + segments[0].lines.size)
            begin = rows.stop
            parts.append(
                Part(
                    segments, self.inverse.frequency[rows], values[rows], band[rows], np.inf, *(s[rows] for s in sizes)
                )
            )
        units = signals.unit(channels[0]), signals.unit(channels[1])
        found = combine_parts(signals, parts, names=(EFFECTIVE_INPUT, channels[1]), units=units)
        assert found.response is not None
        model = self.inverse.friction_covariance()
        return replace(found, response=replace(found.response, model_covariance=model))

    def virgin_curve(self, x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the force [N] of a first slow displacement x [m] and its standard deviation, shape (n,) each."""
        return self.best.law.virgin_band(x, self.forces, self.covariance)

    def friction(self, viscous: float, viscous_std: float, spring: float) -> Fit:
        """Return the friction model with a viscous coefficient [N s/m] and its standard deviation.

        A spring [N/m] is an element that slips beyond the largest motion: its force is fixed, not known.
        The covariance follows from that of shape and sizes by finite differences. It is as much wider as the interval
        of the Coulomb force is than the one that follows so: errors of a law, as those by the encoder's steps, are not
        independent, and the covariance of records that are says too little of all parameters.
        """
        law, whole = self.best.law, np.concatenate([self.best.law.shape, self.forces])

        def model_at(point: NDArray[np.float64]) -> FrictionModel:
            shape, sizes = np.split(point, [law.shape.size])
            moved = replace(law, shape=shape)
            if spring and isinstance(moved, GridElements):
                moved, sizes = moved.beside_spring(sizes, spring, self.records.swing)
            return moved.model(sizes, viscous)

        if not (self.forces.any() or spring):
            frictionless = Frictionless(viscous_coefficient=viscous).spec()
            variance, value = np.array([[viscous_std**2]]), np.array([viscous])
            return Fit("friction", frictionless, ("viscous_coefficient",), ("N s/m",), value, variance)
        model = model_at(whole)
        names, values, units, *_ = zip(*numbers_of(model), strict=True)
        steps = DIFFERENCE * np.where(np.arange(whole.size) < law.shape.size, 1.0, whole)
        slopes = derivatives(lambda at: np.array([each.value for each in numbers_of(model_at(at))]), whole, steps)
        covariance = slopes @ self.covariance @ slopes.T
        if "coulomb_force" in names:  # a sum of elements has none of its own
            own = names.index("coulomb_force")
            whole_variance = (self.coulomb_error / NORMAL_QUANTILE) ** 2
            covariance *= max(whole_variance / max(covariance[own, own], 1e-300), 1.0) if covariance.any() else 1.0
        own = names.index("viscous_coefficient")
        covariance[own], covariance[:, own] = 0.0, 0.0
        covariance[own, own] = viscous_std**2
        return Fit("friction", model.spec(), names, units, np.array(values), covariance)


@dataclass(frozen=True)
class LawReport:
    """What a fit says of friction and plant, and how far it is to be believed."""

    found: LawChoice
    plant: IdentifiedPlant | None
    known_dead_time: float
    """Dead time before the plant that was known [s], beside the one that was found."""
    stated_mass: float | None = None
    """Moving mass of the data sheet [kg]; None if it is not known."""
    lag: float = 0.0
    """Time constant of the lag that was found before the plant [s]; 0 if none was."""

    @property
    def _viscous(self) -> tuple[float, float]:
        """Viscous coefficient [N s/m] and its standard deviation."""
        return (self.plant.viscous, self.plant.viscous_std) if self.plant else (0.0, 0.0)

    @cached_property
    def scatters(self) -> dict[str, NDArray[np.float64]]:
        """Relative scatter of P̂ over the records with and without friction, and what noise explains, shape (L,)."""
        before, _ = self.found.scatter(self.found.records.delayed(self.found.dead_time))
        after, floor = self.found.scatter(self.found.effective)
        return {"scatter before": before, "scatter after": after, "noise floor": floor}

    def metrics(self) -> Iterator[Metric]:
        """Yield the numbers of friction and of the agreement of the records."""
        found, best = self.found, self.found.best
        yield Metric("friction law", float(best.explains), "1")
        yield Metric("Coulomb force", found.coulomb, "N")
        yield Metric("Coulomb force, 95 %", found.coulomb_error, "N")
        yield Metric("width at 63 %", self._width(), "m")
        yield Metric("greatest velocity", found.records.speed, "m/s")
        yield Metric("viscous coefficient", self._viscous[0], "N s/m")
        yield Metric("viscous coefficient, 95 %", NORMAL_QUANTILE * self._viscous[1], "N s/m")
        yield Metric("input_dead_time", self.known_dead_time + found.dead_time, "s")
        if self.lag:
            yield Metric("input_time_constant", self.lag, "s")
        yield Metric("Stribeck force", best.law.static_excess, "1")
        yield from (Metric(name, float(np.median(values)), "1") for name, values in self.scatters.items())
        yield Metric("ratio", best.residual, "1")

    def curves(self) -> tuple[Curve, Curve]:
        """Return the virgin curve, and the agreement of the records over frequency."""
        frequency = self.found.inverse.frequency
        order = np.argsort(frequency, kind="stable")
        columns = {"frequency": frequency[order], **{name: each[order] for name, each in self.scatters.items()}}
        agreement = Curve("agreement of the records", columns, dict.fromkeys(columns, "1") | {"frequency": "Hz"})
        x = self.found.records.swing * np.geomspace(*ELEMENT_RANGE, CURVE_POINTS)
        return virgin_curve(x, *self.found.virgin_curve(x)), agreement

    def friction(self) -> Fit:
        """Return the friction model, with the covariance of its parameters."""
        return self.found.friction(*self._viscous, self.plant.spring if self.plant else 0.0)

    def summary(self) -> Finding:
        """Return the law."""
        speed = Quantity(self.found.records.speed, "m/s", "velocities up to")
        text = "there is no friction but perhaps a viscous one"
        if self.found.forces.any():
            text = f"friction is that of {self.found.best.law.name}"
        return Finding("remark", (speed,), text=text)

    def errors(self) -> Iterator[Finding]:
        """Yield how far plant and friction may be off, for an accuracy to judge."""
        scatter = float(np.median(self.scatters["scatter after"]))
        left = Quantity(100 * scatter, "%", "scatter of the plant over the amplitudes, without friction")
        yield Finding("misfit", (left,), remedy="record longer", error=scatter)
        if self.plant:
            worst, remedy = int(np.argmax(self.plant.errors)), "record longer, and more frequencies near the modes"
            known = Quantity(100 * float(self.plant.errors[worst]), "%", "known to", float(self.plant.fitted[worst]))
            yield Finding("not identifiable", (known,), place="plant", remedy=remedy, error=known.value / 100)
        force, error = self.found.coulomb, self.found.coulomb_error
        # a friction that is little of the thrust has to be known as a part of it: it may be none
        least = MIN_FORCE_SHARE * float(np.abs(self.found.records.thrust).max())
        low, high = self.found.interval
        yield Finding(
            "not identifiable",
            (Quantity(force, "N", "found"), Quantity(low, "N", "may be any from"), Quantity(high, "N", "to")),
            place="Coulomb force",
            text="friction that weakens in sliding, or that the motion hardly overcomes, may be a part of it",
            remedy="raise the amplitude at low frequencies, or let a softer controller move the axis faster",
            error=error / max(force, least),
        )

    def contradictions(self) -> Iterator[Finding | str]:
        """Yield what the records contradict."""
        if self.plant and self.plant.fall > significant_deviation():
            yield (
                "the friction force falls with velocity, hence the Coulomb force is lower beyond the velocities of the "
                "records: do not use it for faster motion"
            )
        if self.plant and self.plant.spring:
            stiffness = Quantity(self.plant.spring, "N/m", "stiffness that never slips")
            yield Finding("not identifiable", (stiffness,), place="Coulomb force", remedy="raise the amplitude")
        if self.plant and self.stated_mass:
            (fit,) = self.plant.fit.fits
            yield from self._mass_doubts(1 / float(fit.values[0]), self.stated_mass)

    def _mass_doubts(self, found: float, stated: float) -> Iterator[Finding]:
        """Yield what scales the mass so: records that are wrong by a factor contradict nothing but the data sheet."""
        ratio = found / stated
        if not 1 / MAX_MASS_RATIO < ratio < MAX_MASS_RATIO:
            masses = (Quantity(found, "kg", "found"), Quantity(stated, "kg", "stated"))
            yield Finding(
                "implausible unit",
                masses,
                place="mass",
                text=f"{ratio:.3g} times the stated one",
                remedy=f"it is right if the true sample time is {ratio**-0.5:.3g} times the stated one, u "
                f"{1 / ratio:.3g} times the recorded one (motor constant), or y {ratio:.3g} times (unit, encoder)",
            )

    def _width(self) -> float:
        """Return the displacement [m] at which the virgin curve reaches 1 - 1/e of its force."""
        x = np.append(0.0, self.found.records.swing * np.geomspace(*ELEMENT_RANGE, CURVE_POINTS))
        force = np.append(0.0, self.found.virgin_curve(x[1:])[0])
        return float(np.interp(WIDTH_FORCE_RATIO * force[-1], force, x))
