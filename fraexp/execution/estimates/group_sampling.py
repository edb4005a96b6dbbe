"""Few sweeps that stand for many: of a large study some experiments are drawn, with all sweeps that share them."""

import random
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from fraexp.data.sweep import Sweep, component_names

MAX_EXPERIMENTS = 64
"""Experiments that are drawn of a study."""
MAX_GROUPED = 20_000
"""Sweeps that are put into groups one by one; of more, the groups of a few are looked for."""
SAMPLED_SWEEPS = 32
"""Experiments that are drawn of such a study."""
SEED = 0
"""Of the draws: a plan that is made twice is the same."""


class SweepGroup(NamedTuple):
    """Sweeps that share an experiment."""

    sweeps: Sequence[Sweep]
    weight: float
    """Groups of the study for which it stands."""


def sampled_groups(sweeps: Sequence[Sweep]) -> list[SweepGroup]:
    """Return sweeps by the experiment that they share: of each kind of sweep some groups, drawn at random.

    What is common and what is rare are drawn apart, for a few slow sweeps may take longer than all others.
    """
    if len(sweeps) > MAX_GROUPED:
        return _groups_of_few(sweeps)
    groups: dict[str, list[Sweep]] = {}
    for sweep in sweeps:
        groups.setdefault(sweep.experiment_key, []).append(sweep)
    if len(groups) <= MAX_EXPERIMENTS:
        return [SweepGroup(group, 1.0) for group in groups.values()]
    kinds: dict[tuple[str, ...], list[list[Sweep]]] = {}
    for group in groups.values():
        kinds.setdefault(_kind(group), []).append(group)
    return [drawn for alike in kinds.values() for drawn in _sample_groups(alike, len(groups))]


def _sample_groups(alike: Sequence[list[Sweep]], total: int) -> list[SweepGroup]:
    """Return some groups of a kind, of which a large number has a larger share."""
    count = min(max(round(MAX_EXPERIMENTS * len(alike) / total), 2), len(alike))
    return [SweepGroup(group, len(alike) / count) for group in random.Random(SEED).sample(alike, count)]


def _kind(group: Sequence[Sweep]) -> tuple[str, ...]:
    """Return the names of all components of a group, by which its work differs most."""
    first = group[0]
    excitation, friction = (first.experiment.get(section) for section in ("excitation", "friction"))
    return (*component_names(excitation), *component_names(friction), *(str(one.estimator["name"]) for one in group))


def _groups_of_few(sweeps: Sequence[Sweep]) -> list[SweepGroup]:
    """Return the groups of a few sweeps out of very many."""
    few = random.Random(SEED).sample(sweeps, SAMPLED_SWEEPS)
    wanted = Counter(sweep.experiment_key for sweep in few)
    groups: dict[str, list[Sweep]] = {}
    for sweep in sweeps:
        if sweep.experiment_key in wanted:
            groups.setdefault(sweep.experiment_key, []).append(sweep)
    return [
        SweepGroup(group, wanted[key] * len(sweeps) / (SAMPLED_SWEEPS * len(group))) for key, group in groups.items()
    ]
