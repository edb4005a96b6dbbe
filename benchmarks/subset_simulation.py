"""Probabilities of rare events by subset simulation (Au and Beck 2001), which also climbs to the worst cases.

What is drawn is a function of independent standard normal coordinates, and has a score. The highest tenth of a level's
samples start Markov chains above the least score among them, which are the next level. A chain moves by conditional
sampling (Papaioannou, Betz, Zwirglmaier and Straub 2015); it stays where it is if the score would fall below its level.

OpenTURNS and UQpy have the method, with many packages for these few lines, and neither moves some coordinates while
others keep what is expensive to compute.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SHARE = 0.1
"""Part of a level's samples that lie in the next one."""
ACCEPTED_SHARE = 0.44
"""Part of the moves that shall be accepted: their size adapts to it."""
ADAPTATION = 10
"""Moves over which a size adapts."""
Score = Callable[[NDArray[np.float64]], float]
"""Takes coordinates, shape (d,); NaN if nothing can be drawn with them: others are drawn instead."""


@dataclass(frozen=True)
class Level:
    """Samples whose scores all exceed a threshold."""

    threshold: float
    probability: float
    """Estimated probability of exceeding the threshold."""
    samples: NDArray[np.float64]
    """Coordinates, shape (n, d)."""
    scores: NDArray[np.float64]
    """Their scores, shape (n,)."""


def exceedance(levels: Sequence[Level], score: float) -> float:
    """Return the estimated probability of exceeding a score; 0 if no sample of the last level does."""
    level = [level for level in levels if level.threshold <= score][-1]
    return level.probability * float(np.mean(level.scores > score))


def climb(
    score: Score, random: np.random.Generator, size: int, moves: NDArray[np.bool_], levels: int
) -> Iterator[Level]:
    """Yield levels of `size` samples, each a tenth as probable as the one before, as long as a sample lies higher.

    Each row of `moves`, shape (m, d), marks coordinates that a move changes together; one of them is drawn each time.
    """
    samples = np.empty((size, moves.shape[1]))
    scores = np.array([_draw(score, random, sample) for sample in samples])
    level = Level(-np.inf, 1.0, samples, scores)
    steps = np.full(len(moves), 0.6)
    yield level
    for _ in range(levels):
        threshold = float(np.sort(level.scores)[-round(SHARE * size) - 1])
        greatest = level.scores.max()
        if greatest <= threshold:  # more than a tenth of the samples share it
            threshold = float(np.max(level.scores, initial=-np.inf, where=level.scores < greatest))
        above = level.scores > threshold
        if above.all():
            return
        samples, scores = level.samples[above], level.scores[above]
        chain = [(samples, scores)]
        while sum(part.size for _, part in chain) < size:
            samples, scores = _move(score, random, samples, scores, threshold, moves, steps)
            chain.append((samples, scores))
        samples, scores = (np.concatenate(parts)[:size] for parts in zip(*chain, strict=True))
        level = Level(threshold, level.probability * float(np.mean(above)), samples, scores)
        yield level


def _draw(score: Score, random: np.random.Generator, sample: NDArray[np.float64]) -> float:
    """Fill a sample with coordinates that draw something, and return its score."""
    found = np.nan
    while np.isnan(found):
        sample[:] = random.standard_normal(sample.size)
        found = score(sample)
    return found


def _move(
    score: Score,
    random: np.random.Generator,
    samples: NDArray[np.float64],
    scores: NDArray[np.float64],
    threshold: float,
    moves: NDArray[np.bool_],
    steps: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return each chain's next sample and score; the size of each kind of move adapts in `steps`."""
    samples, scores = samples.copy(), scores.copy()
    for k, sample in enumerate(samples):
        kind = random.integers(len(moves))
        step = steps[kind]
        moved = np.sqrt(1 - step**2) * sample + step * random.standard_normal(sample.size)
        moved = np.where(moves[kind], moved, sample)
        found = score(moved)
        is_accepted = found > threshold  # not so if it is NaN
        if is_accepted:
            samples[k], scores[k] = moved, found
        steps[kind] = min(step * np.exp((is_accepted - ACCEPTED_SHARE) / ADAPTATION), 1.0)
    return samples, scores
