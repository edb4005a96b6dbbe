"""One point of a study's grid as plain data: an experiment and an estimator, identified by content."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

from fraexp.data.identity import TAG, canonical, digest_of, hash_bytes

Plain = Mapping[str, Any]
DRAW = "draw"
"""Label of a sweep that was drawn at random: the number of its draw. The labels behind it are what was drawn."""


class Section(dict[str, Any]):
    """A section of an experiment, or an estimator, as plain data that knows its hash; it is not changed once made.

    Sweeps of a grid share their sections, so that each is hashed once.
    """

    @cached_property
    def digest(self) -> bytes:
        """Hash of the content, 20 bytes."""
        return digest_of(self)

    @cached_property
    def has_tables(self) -> bool:
        """Whether it holds tables of its own, which may be components."""
        values = [value[0] if isinstance(value, list) and value else value for value in self.values()]
        return any(isinstance(value, Mapping) for value in values)


def as_section(value: Any) -> Any:
    """Return a table as a section; other values as they are."""
    return Section(value) if isinstance(value, Mapping) and not isinstance(value, Section) else value


def section_digest(data: Any) -> bytes:
    """Return the hash of a section, 20 bytes, or of what was not made one."""
    return data.digest if isinstance(data, Section) else digest_of(data)


@dataclass(slots=True)
class Sweep:
    """An experiment and an estimator, fully resolved: the unit of reuse and storage; it is not changed once made."""

    experiment: Plain
    """What is simulated or read. `source` is ``loop``, ``drive`` or ``record``; the rest are its sections."""
    estimator: Plain
    """Name, version and parameters of the estimator."""
    labels: Plain = field(default_factory=dict)
    """The grid's values at this point, for people: not part of the identity."""
    files: Mapping[str, str] = field(default_factory=dict)
    """Where the files are whose hashes the experiment names: not part of the identity."""

    experiment_key: str = field(init=False, repr=False)
    """Key shared by all sweeps that use the same signals."""
    key: str = field(init=False, repr=False)
    """Key of this sweep, independent of names, paths, labels and executors."""

    def __post_init__(self) -> None:
        digest = _experiment_digest(self.experiment)
        self.experiment_key = f"{TAG}-{digest.hex()}"
        self.key = f"{TAG}-{hash_bytes(digest + section_digest(self.estimator)).hex()}"

    @property
    def sections(self) -> dict[str, Any]:
        """Experiment and estimator as one table."""
        return {**self.experiment, "estimator": self.estimator}


def experiment_key(experiment: Plain) -> str:
    """Return the key of an experiment: the hash of its sections' names and hashes."""
    return f"{TAG}-{_experiment_digest(experiment).hex()}"


def _experiment_digest(experiment: Plain) -> bytes:
    names, header = _hashed_order(tuple(experiment), experiment.get("source"))
    try:
        hashes = [experiment[name].digest for name in names]
    except AttributeError:  # read from elsewhere: tables that were not made sections
        hashes = [section_digest(experiment[name]) for name in names]
    return hash_bytes(b"".join([header, *hashes]))


@lru_cache
def _hashed_order(names: tuple[str, ...], source: str | None) -> tuple[list[str], bytes]:
    """Return the sections of an experiment in the order in which they are hashed, and what is hashed before them."""
    sections = sorted(set(names) - {"source"})
    return sections, canonical([source, sections]).encode()


def components_by_port(section: Any) -> Mapping[str, Any]:
    """Return the components of several ports in plain data, by port; none if the section is one component.

    They are friction models by contact, or controllers by thrust.
    """
    if not isinstance(section, Mapping) or "name" in section or not section:
        return {}
    return section if all(isinstance(model, Mapping) for model in section.values()) else {}


def component_names(spec: Any) -> Iterator[str]:
    """Yield the names of a component in plain data and of those that it holds."""
    if isinstance(spec, Mapping):
        if isinstance(spec.get("name"), str):
            yield spec["name"]
        for value in spec.values():
            yield from component_names(value)
    elif isinstance(spec, list | tuple) and spec and isinstance(spec[0], Mapping):  # not a long list of numbers
        for value in spec:
            yield from component_names(value)
