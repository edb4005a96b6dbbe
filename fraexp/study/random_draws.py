"""Numbers of an experiment that are drawn at random around what the study says: tolerances of a machine."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from hashlib import blake2b
from statistics import NormalDist
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fraexp.components.kinds import KINDS, Excitation
from fraexp.components.parameters import Parameters, param
from fraexp.components.registry import Registry, create
from fraexp.data import toml, units
from fraexp.data.sweep import DRAW, Sweep, as_section
from fraexp.errors import FraexpError, ParameterError, StudyError, did_you_mean
from fraexp.study.paths import SETTINGS, replace_at, unit_at, value_at

COMPONENT_KINDS = tuple(kind.kind for kind in KINDS)
KEYS = ("count", "seed", "draw")
EXAMPLE = '{ paths = ["plant.gain"], relative = 0.05 }'


class Draw(Parameters):
    """Numbers that are drawn together: all are moved by the same share, or by the same amount."""

    paths: tuple[str, ...] = param("", "paths to the numbers")
    relative: float | None = param("1", "standard deviation or half width, as a fraction of each number", None, above=0)
    std: float | str | None = param("", "standard deviation of a normal distribution, in SI or with a unit", None)
    half_width: float | str | None = param("", "half width of a uniform distribution, in SI or with a unit", None)
    distribution: Literal["normal", "uniform"] = param("", "distribution", "normal")

    @property
    def amount_name(self) -> str:
        """Name of the parameter that gives the width of the distribution as an amount."""
        return "half_width" if self.distribution == "uniform" else "std"

    def model_post_init(self, context: object) -> None:
        """Check that the numbers and one width of the distribution are given."""
        if not self.paths:
            raise ParameterError("paths is empty; expected one path at least, such as 'plant.rigid_body_gain'")
        amount = self.amount_name
        other = "std" if amount == "half_width" else "half_width"
        if getattr(self, other) is not None:
            raise ParameterError(f"a {self.distribution} distribution has no '{other}'; expected '{amount}'")
        if (self.relative is None) == (getattr(self, amount) is None):
            raise ParameterError(f"expected either 'relative', a fraction, or '{amount}', an amount")

    def variates(self, seed: int, count: int) -> NDArray[np.float64]:
        """Return `count` numbers with a standard deviation, or half width, of 1, shape (count,).

        The stream belongs to the paths, so that entries do not change each other's numbers and a greater count goes on
        where a smaller one ended. Its bits are those that numpy promises to keep; the distribution is made from them
        here, as numpy may change its own.
        """
        name = blake2b("\n".join(sorted(self.paths)).encode(), digest_size=8).digest()
        bits = np.random.PCG64(np.random.SeedSequence([seed, int.from_bytes(name)])).random_raw(count)
        uniform = ((bits >> np.uint64(11)).astype(float) + 0.5) * 2.0**-53  # within 0…1, without either
        if self.distribution == "uniform":
            return 2 * uniform - 1
        normal = NormalDist()
        return np.array([normal.inv_cdf(share) for share in uniform.tolist()])

    def amount(self, unit: str) -> float:
        """Return the standard deviation, or the half width, of a number in this unit."""
        name = self.amount_name
        given = getattr(self, name)
        amount = units.number(given, unit or "1") if isinstance(given, str) else given
        if amount is None or not amount > 0:
            raise ParameterError(f"{name} is {given!r}; expected a number above 0")
        return amount


@dataclass(frozen=True)
class Draws:
    """The section [monte_carlo] of a study."""

    count: int
    seed: int
    entries: tuple[Draw, ...]

    @classmethod
    def parse(cls, data: Any) -> "Draws":
        """Build from the section; FraexpError says in one line what does not fit."""
        if not isinstance(data, Mapping):
            raise StudyError(f"[monte_carlo] is {data!r}; expected a table")
        unknown = sorted(set(data) - set(KEYS))
        if unknown:
            raise StudyError(f"[monte_carlo] has no '{unknown[0]}'{did_you_mean(unknown[0], KEYS)}")
        tables = data.get("draw")
        if not isinstance(tables, list) or not tables or not all(isinstance(table, Mapping) for table in tables):
            raise StudyError(f"[monte_carlo]: draw is {tables!r}; expected tables such as draw = [{EXAMPLE}]")
        entries = tuple(
            Draw.parse(_with_path_list(table), f"[monte_carlo] draw {n}") for n, table in enumerate(tables, start=1)
        )
        paths = [path for entry in entries for path in entry.paths]
        twice = next((path for path in paths if paths.count(path) > 1), None)
        if twice:
            raise StudyError(f"[monte_carlo]: '{twice}' is drawn twice; expected each path once")
        return cls(_whole_number(data, "count", None, 1), _whole_number(data, "seed", 0, 0), entries)

    @property
    def paths(self) -> tuple[str, ...]:
        """All that is drawn."""
        return tuple(path for entry in self.entries for path in entry.paths)

    def values(self, sections: Mapping[str, Any], registry: Registry) -> dict[str, list[float]]:
        """Return the numbers that are drawn around those of an experiment's sections: by path, `count` of each."""
        found = {}
        for entry in self.entries:
            variates = entry.variates(self.seed, self.count)
            for path in entry.paths:
                try:
                    found[path] = _sample_around(sections, path, entry, variates, registry)
                except FraexpError as error:
                    raise error.at("[monte_carlo]: ", "monte_carlo") from None
        return found


def _with_path_list(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table in which a single path needs no brackets."""
    paths = table.get("paths")
    return {**table, "paths": [paths]} if isinstance(paths, str) else dict(table)


def _whole_number(data: Mapping[str, Any], key: str, default: int | None, least: int) -> int:
    value = data.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise StudyError(f"[monte_carlo]: {key} is {value!r}; expected a whole number, {least} at least")
    return value


def _sample_around(
    sections: Mapping[str, Any], path: str, entry: Draw, variates: NDArray[np.float64], registry: Registry
) -> list[float]:
    nominal = value_at(sections, path)
    if not isinstance(nominal, float):
        inside = {str(at): value for at, value in enumerate(nominal)} if isinstance(nominal, list) else nominal
        remedy = "vary it in [grid]" if nominal is not None else "give it a value in the study"
        if isinstance(inside, Mapping):
            number = next((key for key, value in inside.items() if isinstance(value, float)), "…")
            remedy = f"name one of its numbers, such as '{path}.{number}'"
        raise StudyError(f"'{path}' is {toml.as_text(nominal):.60}, around which no number can be drawn: {remedy}")
    if entry.relative is None:
        try:
            amount = entry.amount(unit_at(sections, path, registry))
        except ParameterError as error:
            raise ParameterError(f"'{path}': {error}") from None
        values = nominal + amount * variates
    elif nominal:
        values = nominal * (1 + entry.relative * variates)
    else:
        raise StudyError(
            f"'{path}' is 0, and so is any fraction of it; expected '{entry.amount_name}' in place of 'relative'"
        )
    return list(values.tolist())


def sample_sweeps(place: str, nominal: Sweep, draws: Draws, registry: Registry) -> Iterator[Sweep]:
    """Yield the sweeps that are drawn around one; `place` begins the sentence about what does not fit.

    What was inherited from a section keeps the number that was not drawn: a machine differs from what is known of it.
    """
    sections = nominal.sections
    drawable = [key for key in sections if key in COMPONENT_KINDS or key in SETTINGS]
    concerned = tuple(dict.fromkeys(path.partition(".")[0] for path in draws.paths))
    strange = next((key for key in concerned if key not in drawable), None)
    if strange:
        near = did_you_mean(strange, drawable)
        raise StudyError(f"{place}, [monte_carlo]: there is no section '{strange}' to draw in{near}")
    try:
        values = draws.values(sections, registry)
    except FraexpError as error:
        raise error.at(f"{place}, ") from None
    for index in range(draws.count):
        numbers = {path: column[index] for path, column in values.items()}
        changed: dict[str, Any] = sections
        for path, number in numbers.items():
            changed = replace_at(changed, path.split("."), number)
        try:
            _check(changed, concerned, registry)
        except FraexpError as error:
            raise _bound_error(error, index + 1, numbers, place) from None
        changed = {key: as_section(value) for key, value in changed.items()}
        experiment = {key: value for key, value in changed.items() if key != "estimator"}
        labels = {**nominal.labels, DRAW: index + 1, **numbers}
        yield Sweep(experiment, changed["estimator"], labels, nominal.files)


def _check(sections: Mapping[str, Any], concerned: Sequence[str], registry: Registry) -> None:
    """Raise FraexpError if a section does not take what was drawn."""
    for key in concerned:
        if key in COMPONENT_KINDS:
            registry.create(key, sections[key])
        else:
            SETTINGS[key].parse(registry.fill_inherited(SETTINGS[key], sections[key], {}), key)
    if "excitation" in sections and {"excitation", "loop"} & set(concerned):
        excitation = create(registry, Excitation, sections["excitation"])
        excitation.check(sections["loop"]["sample_time"])


def _bound_error(error: FraexpError, number: int, numbers: Mapping[str, float], place: str) -> FraexpError:
    """Return the error of a draw that does not fit, with its number and what was drawn."""
    told = ", ".join(f"{path} = {value:.6g}" for path, value in numbers.items())
    remedy = 'lower the width of the distribution, or take distribution = "uniform"'
    return type(error)(f"{place}, draw {number} ({told}): {error}; {remedy}")
