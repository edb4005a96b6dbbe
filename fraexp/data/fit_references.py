"""References to fits: a parameter that another sweep of the study identifies, such as the design model of a controller.

In a study ``{ fit = "plant", case = "proposed" }`` stands for a component; in a sweep ``{"fit": "plant", "of": KEY}``.
The key of the sweep that identifies it decides what it is, so that it can be part of another sweep's key before any
of the two is computed.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from fraexp.data.sweep import DRAW, Plain, Sweep, as_section
from fraexp.errors import StudyError, did_you_mean

FIT, CASE, OF = "fit", "case", "of"
KINDS = ("plant", "friction")
"""What can be identified."""


def is_reference(value: Any) -> bool:
    """Say whether a value of a study or of a sweep refers to a fit."""
    return isinstance(value, Mapping) and FIT in value and "name" not in value


def references_in(data: Any) -> Iterator[Plain]:
    """Yield all references within plain data."""
    if is_reference(data):
        yield data
    elif isinstance(data, Mapping):
        for value in data.values():
            yield from references_in(value)
    elif isinstance(data, list | tuple):
        for value in data:
            yield from references_in(value)


def mentions_fit(sections: Plain, grid: Plain) -> bool:
    """Say whether sections, or what a grid lays over them, may refer to a fit."""
    return any(references_in([sections, *grid.values()])) or any(FIT in path.split(".") for path in grid)


def replace_references(data: Any, by: Callable[[Plain], Any]) -> Any:
    """Return plain data in which each reference is replaced."""
    if is_reference(data):
        return by(data)
    if isinstance(data, Mapping):
        return {key: replace_references(value, by) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [replace_references(value, by) for value in data]
    return data


def restore_references(spec: Any, written: Any) -> Any:
    """Return a component's plain data with the references of what was `written` in the places of their stand-ins."""
    if is_reference(written):
        return dict(written)
    if isinstance(written, Mapping) and isinstance(spec, Mapping):
        return {
            key: restore_references(value, written[key]) if key in written else value for key, value in spec.items()
        }
    if isinstance(written, list | tuple) and isinstance(spec, list) and len(written) == len(spec):
        return [restore_references(value, part) for value, part in zip(spec, written, strict=True)]
    return spec


def substitute_fits(sections: Plain, place: str) -> dict[str, Any]:
    """Return sections in which the machine's own components stand in for fits, to be checked in their places."""

    def substitute(reference: Plain) -> Any:
        unknown = sorted(set(reference) - {FIT, CASE})
        if unknown:
            raise StudyError(f"{place}: a fit has no '{unknown[0]}'{did_you_mean(unknown[0], (FIT, CASE))}")
        kind = reference[FIT]
        if not isinstance(kind, str) or not isinstance(sections.get(kind), Mapping):
            kinds = ", ".join(key for key in KINDS if key in sections)
            raise StudyError(f"{place}: {FIT} is {kind!r}; expected a kind of component that the study has: {kinds}")
        return sections[kind]

    for key, section in sections.items():
        if is_reference(section):
            raise StudyError(
                f"{place}, [{key}]: a fit can stand for a parameter, such as excitation.plant or estimator.friction, "
                "not for the section: what it stands for would be unknown until it is computed"
            )
    return {
        key: replace_references(section, substitute) if any(references_in(section)) else section
        for key, section in sections.items()
    }


def insert_fits(every: Sequence[tuple[str, Sweep, Plain | None]]) -> list[Sweep]:
    """Return sweeps with their fits in place of what stood in for them.

    Given are place, sweep and what was written, which is None if it is known not to refer to a fit.
    """
    refers = [written is not None and any(references_in(written)) for _, _, written in every]
    earlier: dict[str, list[Sweep]] = {}
    for (_, sweep, _), does in zip(every, refers, strict=True):
        if not does:
            earlier.setdefault(str(sweep.labels.get(CASE)), []).append(sweep)
    return [
        _insert_keys(place, sweep, written, earlier) if written is not None and does else sweep
        for (place, sweep, written), does in zip(every, refers, strict=True)
    ]


def _insert_keys(place: str, sweep: Sweep, written: Plain, earlier: Mapping[str, list[Sweep]]) -> Sweep:
    _check_drawn(place, sweep, written)
    known = {
        key: replace_references(section, lambda reference: resolve_reference(reference, sweep.labels, earlier, place))
        for key, section in written.items()
    }
    experiment = {
        key: as_section(restore_references(section, known.get(key))) for key, section in sweep.experiment.items()
    }
    return replace(
        sweep, experiment=experiment, estimator=as_section(restore_references(sweep.estimator, known["estimator"]))
    )


def _check_drawn(place: str, sweep: Sweep, written: Plain) -> None:
    """Raise StudyError if a number was drawn at random within what stood in for a fit: the fit does not know of it."""
    paths = list(sweep.labels)
    for path in paths[paths.index(DRAW) + 1 :] if DRAW in paths else ():
        value: Any = written
        for part in path.split("."):
            if is_reference(value):
                raise StudyError(
                    f"{place}, [monte_carlo]: '{path}' lies in what {{ {FIT} = '{value[FIT]}' }} stands for, which "
                    "is identified and cannot be drawn; draw it in the machine, or write the component out"
                )
            if isinstance(value, list):
                value = value[int(part)]
            else:
                value = value.get(part) if isinstance(value, Mapping) else None


def resolve_reference(reference: Plain, case: Plain, earlier: Mapping[str, list[Sweep]], place: str) -> Plain:
    """Return the reference with the key of the sweep that identifies it.

    `earlier` are the sweeps of the cases that have none themselves; of several in a case it is the one whose other
    labels are those of `case`.
    """
    if CASE not in reference:
        raise StudyError(
            f"{place}: {FIT} needs the {CASE} that identifies it, as in {{ fit = 'plant', case = 'LABEL' }}"
        )
    name = str(reference[CASE])
    if name not in earlier:
        known = did_you_mean(name, earlier) if earlier else "; there is no case without a reference of its own"
        raise StudyError(f"{place}: {FIT} needs the {CASE} that identifies it, and there is no '{name}'{known}")
    candidates = earlier[name]
    alike = [
        sweep
        for sweep in candidates
        if all(case.get(key, value) == value for key, value in sweep.labels.items() if key != CASE)
    ]
    if len(alike) != 1:
        raise StudyError(
            f"{place}: case '{name}' has {len(candidates)} sweeps, {len(alike)} of them at this point of the grid; "
            "expected one"
        )
    return {FIT: reference[FIT], OF: alike[0].key}


def source_keys(sweep: Sweep) -> set[str]:
    """Return the keys of the sweeps whose fits a sweep needs."""
    return {reference[OF] for reference in references_in([sweep.experiment, sweep.estimator])}


def topological_batches(sweeps: list[Sweep]) -> Iterator[list[Sweep]]:
    """Yield sweeps in turns: those of a turn need fits of earlier turns only, or of sweeps that are not among them."""
    left, keys = sweeps, {sweep.key for sweep in sweeps}
    while left:
        ready = [sweep for sweep in left if not source_keys(sweep) & keys]
        yield ready
        keys -= {sweep.key for sweep in ready}
        left = [sweep for sweep in left if sweep.key in keys]
