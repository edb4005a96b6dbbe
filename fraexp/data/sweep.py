"""One point of a study's grid as plain data: an experiment and an estimator, identified by content."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from hashlib import blake2b
from typing import Any, Self

from fraexp.data.identity import SIZE, TAG, canonical, key_of

Plain = Mapping[str, Any]
DRAW = "draw"
"""Label of a sweep that was drawn at random: the number of its draw. The labels behind it are what was drawn."""


@dataclass(frozen=True, slots=True)
class Sweep:
    """An experiment and an estimator, fully resolved: the unit of reuse and storage."""

    experiment: Plain
    """What is simulated or read. `source` is ``loop``, ``drive`` or ``record``; the rest are its sections."""
    estimator: Plain
    """Name, version and parameters of the estimator."""
    labels: Plain = field(default_factory=dict)
    """The grid's values at this point, for people: not part of the identity."""
    files: Mapping[str, str] = field(default_factory=dict)
    """Where the files are whose hashes the experiment names: not part of the identity."""
    _key: str = field(default="", init=False, repr=False, compare=False)
    _experiment_key: str = field(default="", init=False, repr=False, compare=False)

    @classmethod
    def with_key(cls, key: str, experiment: Plain, estimator: Plain, labels: Plain, files: Mapping[str, str]) -> Self:
        """Return the sweep of which the key is known."""
        sweep, put = object.__new__(cls), object.__setattr__  # a million of them: twice as fast as by the constructor
        put(sweep, "experiment", experiment)
        put(sweep, "estimator", estimator)
        put(sweep, "labels", labels)
        put(sweep, "files", files)
        put(sweep, "_key", key)
        put(sweep, "_experiment_key", "")
        return sweep

    @property
    def experiment_key(self) -> str:
        """Key shared by all sweeps that use the same signals."""
        if not self._experiment_key:
            object.__setattr__(self, "_experiment_key", key_of(self.experiment))
        return self._experiment_key

    @property
    def key(self) -> str:
        """Key of this sweep, independent of names, paths, labels and executors."""
        if not self._key:
            object.__setattr__(self, "_key", key_of({"experiment": self.experiment, "estimator": self.estimator}))
        return self._key


Written = dict[int, tuple[Any, bytes]]
"""Canonical JSON of values, with what stands before it, by their identity; they are kept, so that it stays theirs."""


class Keys:
    """The keys of many sweeps that have sections in common, which must not change meanwhile.

    The canonical JSON of each section is written once, and hashed on from the first one in which a sweep differs
    from the one before.
    """

    def __init__(self) -> None:
        self._estimators: Written = {}
        self._sections: dict[tuple[str, ...], list[tuple[str, str, Written]]] = {}
        self._now: list[tuple[str, str, Written]] = []
        self._places: dict[str, int] = {}
        """Numbers of the sections' texts."""
        self._open, self._rest = -1, b""
        """Number of the text that is other from sweep to sweep, and all texts behind it."""
        self._last: list[bytes] = []
        self._same = 0
        """How many of the last sweep's texts are hashed in `_begun`."""
        self._begun = blake2b(digest_size=SIZE)

    def of(self, experiment: Plain, estimator: Plain) -> str:
        """Return the key of a sweep."""
        names = tuple(experiment)
        sections = self._sections.get(names) or self._begin(names)
        found = self._estimators.get(id(estimator))
        texts = [found[1] if found else _written(self._estimators, '{"estimator":', estimator)]
        for name, before, written in sections:
            value = experiment[name]
            found = written.get(id(value))
            texts.append(found[1] if found else _written(written, before, value))
        texts.append(b"}}")
        self._now, self._places = sections, {section[0]: at for at, section in enumerate(sections, start=1)}
        return f"{TAG}-{self._hashed(texts)}"

    def beside(self, section: str, value: Any) -> str:
        """Return the key of the sweep that differs from the last one in a section of the experiment."""
        at = self._places[section]
        _, before, written = self._now[at - 1]
        found = written.get(id(value))
        text = self._last[at] = found[1] if found else _written(written, before, value)
        if at != self._open:
            self._begin_with(at)
            self._open, self._rest = at, b"".join(self._last[at + 1 :])
        whole = self._begun.copy()
        whole.update(text)
        whole.update(self._rest)
        return f"{TAG}-{whole.hexdigest()}"

    def _begin(self, names: tuple[str, ...]) -> list[tuple[str, str, Written]]:
        ordered = sorted(names)
        befores = [f',"experiment":{{{canonical(ordered[0])}:', *(f",{canonical(name)}:" for name in ordered[1:])]
        self._sections[names] = [(name, before, {}) for name, before in zip(ordered, befores, strict=True)]
        return self._sections[names]

    def _hashed(self, texts: list[bytes]) -> str:
        same = 0
        for one, other in zip(texts, self._last, strict=False):
            if one is not other:
                break
            same += 1
        self._last, self._open = texts, -1
        self._begin_with(same)
        whole = self._begun.copy()
        whole.update(b"".join(texts[same:]))
        return whole.hexdigest()

    def _begin_with(self, count: int) -> None:
        """Have so many of the last sweep's texts hashed in `_begun`."""
        if count < self._same:
            self._begun, self._same = blake2b(digest_size=SIZE), 0
        self._begun.update(b"".join(self._last[self._same : count]))
        self._same = count


def _written(known: Written, before: str, value: Any) -> bytes:
    text = f"{before}{canonical(value)}".encode()
    known[id(value)] = (value, text)
    return text


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
