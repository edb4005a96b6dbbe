"""References to fits: a parameter that another sweep of the study identifies, such as the design model of a controller.

In a study ``{ fit = "plant", case = "proposed" }`` stands for a component; in a sweep ``{"fit": "plant", "of": KEY}``.
The key of the sweep that identifies it decides what it is, so that it can be part of another sweep's key before any
of the two is computed.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from fraexp.data.sweep import DRAW, Plain, Sweep
from fraexp.errors import StudyError, did_you_mean

WORD, CASE, OF = "fit", "case", "of"
KINDS = ("plant", "friction")
"""What can be identified."""


def is_reference(value: Any) -> bool:
    """Say whether a value of a study or of a sweep refers to a fit."""
    return isinstance(value, Mapping) and WORD in value and "name" not in value


def found_in(data: Any) -> Iterator[Plain]:
    """Yield all references within plain data."""
    if is_reference(data):
        yield data
    elif isinstance(data, Mapping):
        for value in data.values():
            yield from found_in(value)
    elif isinstance(data, list | tuple):
        for value in data:
            yield from found_in(value)


def within(sections: Plain, grid: Plain) -> bool:
    """Say whether sections, or what a grid lays over them, may refer to a fit."""
    return any(found_in([sections, *grid.values()])) or any(WORD in path.split(".") for path in grid)


def replaced(data: Any, by: Callable[[Plain], Any]) -> Any:
    """Return plain data in which each reference is replaced."""
    if is_reference(data):
        return by(data)
    if isinstance(data, Mapping):
        return {key: replaced(value, by) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [replaced(value, by) for value in data]
    return data


def put_back(spec: Any, written: Any) -> Any:
    """Return a component's plain data with the references of what was `written` in the places of their stand-ins."""
    if is_reference(written):
        return dict(written)
    if isinstance(written, Mapping) and isinstance(spec, Mapping):
        return {key: put_back(value, written[key]) if key in written else value for key, value in spec.items()}
    if isinstance(written, list | tuple) and isinstance(spec, list) and len(written) == len(spec):
        return [put_back(value, part) for value, part in zip(spec, written, strict=True)]
    return spec


def stood_in(sections: Plain, place: str) -> dict[str, Any]:
    """Return sections in which the machine's own components stand in for fits, to be checked in their places."""

    def by(reference: Plain) -> Any:
        unknown = sorted(set(reference) - {WORD, CASE})
        if unknown:
            raise StudyError(f"{place}: a fit has no '{unknown[0]}'{did_you_mean(unknown[0], (WORD, CASE))}")
        kind = reference[WORD]
        if not isinstance(kind, str) or not isinstance(sections.get(kind), Mapping):
            kinds = ", ".join(key for key in KINDS if key in sections)
            raise StudyError(f"{place}: {WORD} is {kind!r}; expected a kind of component that the study has: {kinds}")
        return sections[kind]

    for key, section in sections.items():
        if is_reference(section):
            raise StudyError(
                f"{place}, [{key}]: a fit can stand for a parameter, such as excitation.plant or estimator.friction, "
                "not for the section: what it stands for would be unknown until it is computed"
            )
    return {key: replaced(section, by) if any(found_in(section)) else section for key, section in sections.items()}


def laid_in(every: Sequence[tuple[str, Sweep, Plain | None]]) -> list[Sweep]:
    """Return sweeps with their fits in place of what stood in for them.

    Given are place, sweep and what was written, which is None if it is known not to refer to a fit.
    """
    refers = {id(written): any(found_in(written)) for written in {id(of): of for _, _, of in every}.values()}
    earlier: dict[str, list[Sweep]] = {}
    for _, sweep, written in every:
        if not refers[id(written)]:
            earlier.setdefault(str(sweep.labels.get(CASE)), []).append(sweep)
    return [
        _with_keys(place, sweep, written, earlier) if written is not None and refers[id(written)] else sweep
        for place, sweep, written in every  # draws share a text
    ]


def _with_keys(place: str, sweep: Sweep, written: Plain, earlier: Mapping[str, list[Sweep]]) -> Sweep:
    _check_drawn(place, sweep, written)
    known = {
        key: replaced(section, lambda reference: resolved(reference, sweep.labels, earlier, place))
        for key, section in written.items()
    }
    experiment = {key: put_back(section, known.get(key)) for key, section in sweep.experiment.items()}
    return replace(sweep, experiment=experiment, estimator=put_back(sweep.estimator, known["estimator"]))


def _check_drawn(place: str, sweep: Sweep, written: Plain) -> None:
    """Raise StudyError if a number was drawn at random within what stood in for a fit: the fit does not know of it."""
    paths = list(sweep.labels)
    for path in paths[paths.index(DRAW) + 1 :] if DRAW in paths else ():
        value: Any = written
        for part in path.split("."):
            if is_reference(value):
                raise StudyError(
                    f"{place}, [random]: '{path}' lies in what {{ {WORD} = '{value[WORD]}' }} stands for, which is "
                    "identified and cannot be drawn; draw it in the machine, or write the component out"
                )
            if isinstance(value, list):
                value = value[int(part)]
            else:
                value = value.get(part) if isinstance(value, Mapping) else None


def resolved(reference: Plain, case: Plain, earlier: Mapping[str, list[Sweep]], place: str) -> Plain:
    """Return the reference with the key of the sweep that identifies it.

    `earlier` are the sweeps of the cases that have none themselves; of several in a case it is the one whose other
    labels are those of `case`.
    """
    if CASE not in reference:
        raise StudyError(
            f"{place}: {WORD} needs the {CASE} that identifies it, as in {{ fit = 'plant', case = 'LABEL' }}"
        )
    name = str(reference[CASE])
    if name not in earlier:
        known = did_you_mean(name, earlier) if earlier else "; there is no case without a reference of its own"
        raise StudyError(f"{place}: {WORD} needs the {CASE} that identifies it, and there is no '{name}'{known}")
    candidates = earlier[name]
    alike = [
        sweep for sweep in candidates if all(case.get(key, value) == value for key, value in _others(sweep).items())
    ]
    if len(alike) != 1:
        raise StudyError(
            f"{place}: case '{name}' has {len(candidates)} sweeps, {len(alike)} of them at this point of the grid; "
            "expected one"
        )
    return {WORD: reference[WORD], OF: alike[0].key}


def _others(sweep: Sweep) -> Plain:
    return {key: value for key, value in sweep.labels.items() if key != CASE}


def sources(sweep: Sweep) -> set[str]:
    """Return the keys of the sweeps whose fits a sweep needs."""
    return {reference[OF] for reference in found_in([sweep.experiment, sweep.estimator])}


def in_turn(sweeps: list[Sweep]) -> Iterator[list[Sweep]]:
    """Yield sweeps in turns: those of a turn need fits of earlier turns only, or of sweeps that are not among them."""
    left, keys = sweeps, {sweep.key for sweep in sweeps}
    while left:
        ready = [sweep for sweep in left if not sources(sweep) & keys]
        yield ready
        keys -= {sweep.key for sweep in ready}
        left = [sweep for sweep in left if sweep.key in keys]
