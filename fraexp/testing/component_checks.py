"""Checks of every component, what it says about itself and that it is plain data, and of the parts of a loop."""

import inspect
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import get_args

import numpy as np
from pydantic.fields import FieldInfo

from fraexp.components.kinds import Component, Controller, Excitation, Plant, nested_kind
from fraexp.components.parameters import TYPICAL, Parameters, unit_of
from fraexp.components.periods import Period
from fraexp.components.registry import Provider, Providers, Registry
from fraexp.data import units as unit_texts
from fraexp.errors import FraexpError
from fraexp.testing.conformance_check import NotApplicableError, require
from fraexp.testing.examples import installed_components

SUPERSCRIPTS = {1: "", 2: "²", 3: "³"}
"""Powers of A as they are written."""
OMEGA = 2 * np.pi * np.geomspace(0.1, 900.0, 60)
"""Angular frequencies at which responses are compared [rad/s]."""
SAMPLE_TIMES = (500e-6, 100e-6, 2e-3)
"""Sample times [s] that are tried."""
MIN_ENERGY_SHARE = 0.95
"""Share of an excitation's energy that its lines must carry."""


def realisation(plant: Plant) -> None:
    """The state space and the response are the same P(jω)."""
    model = plant.state_space()
    identity = np.eye(model.b.size)
    realised = np.array([model.c @ np.linalg.solve(1j * omega * identity - model.a, model.b) for omega in OMEGA])
    stated = plant.response(OMEGA)
    require(np.shape(stated) == OMEGA.shape, f"response has shape {np.shape(stated)} for omega of shape {OMEGA.shape}")
    error = np.abs(realised - stated) / np.max([np.abs(stated), np.abs(realised)], axis=0)
    worst = int(np.argmax(error))
    require(error[worst] < 1e-6, f"they differ by {error[worst]:.1e} at {OMEGA[worst] / (2 * np.pi):.3g} Hz")


def relative_degree(plant: Plant) -> None:
    """A thrust moves the table by its acceleration or later (relative degree of 2 or more), and forwards."""
    model = plant.state_space()
    jump = float(model.c @ model.b)
    require(abs(jump) <= 1e-9 * np.linalg.norm(model.c) * np.linalg.norm(model.b), f"c·b is {jump:.4g}, not 0")
    reached = model.b
    for power in range(1, model.b.size + 1):  # a later one is zero only if all are
        reached = model.a @ reached
        push = float(model.c @ reached)
        if abs(push) > 1e-9 * np.linalg.norm(model.c) * np.linalg.norm(reached):
            name = f"c·A{SUPERSCRIPTS.get(power, f'^{power}')}·b"
            require(push > 0, f"{name} is {push:.4g}; a positive thrust must move the table forwards")
            return
    require(False, "no thrust moves the table: c·Aᵏ·b is 0 for all k")


def shapes(plant: Plant) -> None:
    """A has shape (n, n), b and c have shape (n,), all of them real and finite."""
    model = plant.state_space()
    n = np.shape(model.a)[0]
    found = (np.shape(model.a), np.shape(model.b), np.shape(model.c))
    require(found == ((n, n), (n,), (n,)), f"shapes of a, b, c are {found}")
    require(all(np.isrealobj(part) and np.isfinite(part).all() for part in (model.a, model.b, model.c)), "not finite")


def causal(controller: Controller) -> None:
    """Numerator and denominator are finite, in powers of z⁻¹, and the denominator starts with 1."""
    for sample_time in SAMPLE_TIMES:
        numerator, denominator = controller.transfer_function(sample_time)
        for part in (numerator, denominator):
            require(np.ndim(part) == 1 and np.size(part), f"a part has shape {np.shape(part)}; expected (p,)")
            require(np.isrealobj(part) and np.isfinite(part).all(), f"it has {part} among its coefficients")
        require(denominator[0] == 1, f"the denominator starts with {denominator[0]:.4g}")


def coefficients(controller: Controller) -> None:
    """The response is that of the coefficients."""
    for sample_time in SAMPLE_TIMES:
        numerator, denominator = controller.transfer_function(sample_time)
        omega = OMEGA[OMEGA * sample_time < np.pi]
        delay = np.exp(-1j * omega * sample_time)
        expected = sum(b * delay**i for i, b in enumerate(numerator)) / sum(
            a * delay**i for i, a in enumerate(denominator)
        )
        stated = controller.response(omega, sample_time)
        require(np.allclose(stated, expected, rtol=1e-9, atol=0), f"they differ at a sample time of {sample_time:g} s")


def whole_periods(excitation: Excitation) -> None:
    """A period consists of finite samples, and the declared lines carry its energy."""
    for period in _allowed_periods(excitation):
        wave, lines = np.asarray(period.waveform), np.asarray(period.lines)
        require(
            wave.ndim == 1 and wave.size > 1 and np.isfinite(wave).all(), "a waveform is not a row of finite samples"
        )
        require(
            lines.size and lines.dtype.kind == "i" and (np.diff(lines) > 0).all(), "lines are not ascending integers"
        )
        require(lines[0] > 0 and 2 * lines[-1] < wave.size, f"lines {lines[0]}…{lines[-1]} of {wave.size} samples")
        energy = np.abs(np.fft.rfft(wave)) ** 2
        total = float(np.sum(energy[1:]))
        require(total > 0, "a waveform is constant")
        share = float(np.sum(energy[lines])) / total
        require(
            share >= MIN_ENERGY_SHARE,
            f"{share:.0%} of a waveform's energy are at its lines; expected {MIN_ENERGY_SHARE:.0%}",
        )
        weakest = float(np.min(energy[lines])) / total
        require(weakest > 1e-12, "a line is not excited at all")


def schedule(excitation: Excitation) -> None:
    """The schedule has no negative time, a tolerance above 0, and one period or more."""
    plan = excitation.schedule
    times = (plan.ramp, plan.settling_timeout, plan.min_record_time)
    require(all(np.isfinite(time) and time >= 0 for time in times), f"its times are {times} s")
    require(0 < plan.settling_tolerance < 1, f"its settling tolerance is {plan.settling_tolerance}")
    require(plan.recorded_periods >= 1, f"it records {plan.recorded_periods} periods")
    require(excitation.quantity in ("force", "displacement"), f"its quantity is '{excitation.quantity}'")


def refuses(excitation: Excitation) -> None:
    """`check` refuses what cannot be sampled, before anything is run."""
    for sample_time in (*SAMPLE_TIMES, 0.05, 10.0):
        try:
            excitation.check(sample_time)
        except FraexpError:
            continue
        try:
            periods = excitation.periods(sample_time)
        except Exception as error:  # whatever it is, check should have said it
            reason = (
                f"check({sample_time:g}) accepts a sample time at which periods fails: {type(error).__name__}: {error}"
            )
            require(False, reason)
        lines = [int(period.lines[-1]) * 2 < period.waveform.size for period in periods]
        require(all(lines) and lines, f"check({sample_time:g}) accepts lines beyond the Nyquist frequency")


def repeatable(excitation: Excitation) -> None:
    """Two calls give the same samples: random ones come from a seed."""
    first, second = _allowed_periods(excitation), _allowed_periods(excitation)
    same = [np.array_equal(a.waveform, b.waveform) for a, b in zip(first, second, strict=True)]
    require(all(same), "the second call gives another waveform")


def _allowed_periods(excitation: Excitation) -> tuple[Period, ...]:
    for sample_time in sorted(SAMPLE_TIMES, reverse=True):
        try:
            excitation.check(sample_time)
        except FraexpError:
            continue
        return excitation.periods(sample_time)
    raise NotApplicableError(f"it is refused at sample times of {min(SAMPLE_TIMES):g} to {max(SAMPLE_TIMES):g} s")


SOURCE = re.compile(
    r"10\.\d{4,9}/\S"  # a DOI
    r"|\beqs?\.? ?\(?\d"  # an equation
    r"|\bpaper(,|'s) (eqs?|Fig|Table|section)\b"
    r"|\b(1[5-9]|20)\d\d\b"  # a name in the literature with its year
)


def units(component: type[Component]) -> None:
    """Every parameter has a description, and every number a known unit ("1" for a pure number)."""
    for place, info in _parameter_fields(component, component.name):
        require(info.description, f"{place} has no description")
        if nested_kind(info) is None and {float, int} & set(_nested_annotations(info.annotation)):
            require(unit_of(info), f"{place} has no unit")
            if unit_of(info) not in ("1", *TYPICAL):  # the others are looked up among all units that there are
                scale, name = unit_texts.si(unit_of(info))
                require(scale == 1, f"{place} is in {unit_of(info)}; expected an SI unit, such as {name}")


def source(component: type[Component]) -> None:
    """The docstring cites the source of the component: a DOI, an equation, or a name with its year."""
    texts = (component.__dict__.get("__doc__"), inspect.getmodule(component).__doc__)
    require(texts[0], f"{component.__name__} has no docstring")
    found = any(SOURCE.search(text or "") for text in texts)
    require(found, "no DOI (10.1109/...), no equation (eq 7), no name with its year (Dahl 1968)")


def presets(component: type[Component]) -> None:
    """Every preset is a complete set of parameters."""
    for name in component.presets:
        try:
            registry_with(component).create(component.kind, {"name": component.name, "preset": name})
        except FraexpError as error:
            require(False, f"preset {name}: {error}")


def plain_data(model: Component) -> None:
    """Name, version and parameters recreate an equal component, also through JSON."""
    spec = model.spec()
    again = registry_with(type(model)).create(model.kind, json.loads(json.dumps(spec)))
    require(dict(again) == dict(model), f"{_difference_text(spec, again.spec())} after a round trip through plain data")
    require(again.spec() == spec, f"{_difference_text(spec, again.spec())} after a round trip through plain data")


def registry_with(component: type[Component]) -> Registry:
    """Return all installed components and this one, which need not be installed."""
    provider = Provider(component, Path(inspect.getfile(component)), "under test")
    return Registry(Providers({**installed_components().providers, (component.kind, component.name): provider}))


def _difference_text(first: Mapping[str, object], second: Mapping[str, object]) -> str:
    for key, value in first.items():
        if value != second.get(key):
            return f"{key} is {second.get(key)!r}, was {value!r}"
    return "something other than a parameter differs"


def _parameter_fields(owner: type[Parameters], path: str) -> Iterator[tuple[str, FieldInfo]]:
    """Yield all parameters with their place, those of nested groups included."""
    for name, info in owner.model_fields.items():
        yield f"{path}.{name}", info
        for part in _nested_annotations(info.annotation):
            if inspect.isclass(part) and issubclass(part, Parameters) and not issubclass(part, Component):
                yield from _parameter_fields(part, f"{path}.{name}")


def _nested_annotations(annotation: object) -> list[object]:
    """Return an annotation and all that it is made of."""
    return [annotation, *(inner for part in get_args(annotation) for inner in _nested_annotations(part))]
