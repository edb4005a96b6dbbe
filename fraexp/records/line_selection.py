"""Which harmonics are excited, and whether the input is where the study says."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fraexp.errors import RecordError
from fraexp.records.cutting import Cut
from fraexp.records.excited import (
    NEGLIGIBLE,
    NOTHING,
    SIGNIFICANT,
    ExcitedLines,
    detected_lines,
    injected_lines,
    line_spectrum,
    power_of_lines,
)
from fraexp.records.record_settings import RecordSettings

FEW = 0.2
"""Share of lines by which realisations of one multisine may seem to differ."""
SHARE = 0.5
"""Share of the input's power at the lines of the reference, below which something else excites the machine."""


def with_lines(settings: RecordSettings, cut: Cut, values: Mapping[str, np.ndarray], place: str) -> Cut:
    """Return the cut with its excited harmonics: those stated, else those that stand out of what was injected.

    `lines`, or `every` from `lowest` to `highest`, state them; RecordError if nothing is injected there. If no channel
    holds what was injected, they are looked for in the input, where they must stand out of friction's as well.
    """
    _check_statement(settings, cut, place)
    last = (cut.samples - 1) // 2
    base = cut.periods / (cut.samples * cut.sample_time)
    lowest = max(math.ceil((settings.lowest or 0.0) / base - 1e-6), 1)
    highest = math.floor(settings.highest / base + 1e-6) if settings.highest else last // cut.periods
    stated = sorted(set(settings.lines or (range(lowest, highest + 1, settings.every) if settings.every else ())))
    lines = [line * cut.periods for line in stated]
    band = (lowest * cut.periods, highest * cut.periods)
    found = ExcitedLines(lines) if stated else _found(settings, cut, values, band, place)
    lines = list(found.lines)
    if not lines or lines[0] < 1 or lines[-1] > last:
        found_text = f"{lines[0] // cut.periods} to {lines[-1] // cut.periods}" if lines else "none"
        raise RecordError(
            f"{place}: the excited harmonics are {found_text}; expected some from 1 to {last // cut.periods} "
            f"({base:.4g} to {0.5 / cut.sample_time:.4g} Hz): correct lowest and highest, or lines"
        )
    if stated:
        blocks = cut.blocks_of(values[settings.injected])
        _check_excited(lines, blocks, base / cut.periods, cut.periods, f"{place}: '{settings.injected}'")
    return replace(cut, lines=tuple(lines), left_out=found.left_out, doubtful=found.doubtful)


def _found(
    settings: RecordSettings, cut: Cut, values: Mapping[str, np.ndarray], band: tuple[int, int], place: str
) -> ExcitedLines:
    """Return the lines that are excited within a band, and how sure that is."""
    name, blocks = settings.injected, cut.blocks_of(values[settings.injected])
    if name == settings.reference:
        found = detected_lines(blocks, band, stated=bool(settings.lowest and settings.highest))
    else:
        found = injected_lines(blocks, band)
        if name == "reference":
            _check_share(found.anywhere, cut.blocks_of(values[settings.reference]), settings.reference, place)
    if found.anywhere and not found.lines:
        spacing = 1 / (cut.samples * cut.sample_time)
        low, high = (line * spacing for line in (found.anywhere[0], found.anywhere[-1]))
        raise RecordError(
            f"{place}: none of the excited lines, {low:.4g} to {high:.4g} Hz, is between lowest and highest; "
            "correct them, or state lines"
        )
    return found


def _check_share(lines: Sequence[int], blocks: np.ndarray, name: str, place: str) -> None:
    """Raise RecordError if the input has most of its power at other lines than those of the reference."""
    power = power_of_lines(blocks)
    share = float(power[np.array(lines, dtype=int) - 1].sum() / power.sum()) if power.any() else 1.0
    if share < SHARE:
        raise RecordError(
            f"{place}: '{name}' has {share:.0%} of its power at the {len(lines)} lines of 'reference': something else "
            f"excites the machine; give that as channel 'excitation', or input = '{name}' (--input {name}) to look for "
            "lines there"
        )


def common_lines(cuts: Sequence[Cut]) -> list[Cut]:
    """Return cuts whose lines are those that most of them have, where noise alone makes them differ.

    Realisations are told to be such by equal lines. Where more than a few differ, as with random grids, all is left.
    """
    found = list(cuts)
    for shape in {(cut.samples, cut.sample_time) for cut in cuts}:
        places = [place for place, cut in enumerate(cuts) if (cut.samples, cut.sample_time) == shape]
        counts = Counter(line for place in places for line in cuts[place].lines)
        most = {line for line, count in counts.items() if count > len(places) / 2}
        if all(len(most.symmetric_difference(cuts[place].lines)) <= FEW * len(most) for place in places):
            for place in places:
                found[place] = replace(cuts[place], lines=tuple(sorted(most)))
    return found


def _check_statement(settings: RecordSettings, cut: Cut, place: str) -> None:
    if settings.lines and (settings.every or settings.lowest or settings.highest):
        raise RecordError(f"{place}: lines are given, and lowest, highest or every as well; expected one way")
    if settings.every and not (settings.lowest and settings.highest):
        raise RecordError(f"{place}: every is given without lowest and highest; give both, or lines")
    if settings.highest and settings.highest > 0.5 / cut.sample_time:
        raise RecordError(
            f"{place}: highest is {settings.highest:.4g} Hz; expected at most half the sample rate, "
            f"{0.5 / cut.sample_time:.4g} Hz"
        )
    if settings.lowest and settings.highest and settings.lowest > settings.highest:
        raise RecordError(
            f"{place}: lowest is {settings.lowest:g} Hz and highest {settings.highest:g} Hz; expected lowest below"
        )


def _check_excited(lines: list[int], blocks: np.ndarray, spacing: float, periods: int, place: str) -> None:
    """Raise RecordError if a stated line cannot be told from the noise; `spacing` of the block's lines in Hz."""
    amplitude, scatter = line_spectrum(blocks)
    stated = np.array(lines) - 1
    others = np.delete(amplitude, stated)
    floor = np.maximum(scatter, np.median(others**2) if others.size else 0.0)[stated]
    share = amplitude[stated] / amplitude.max() if amplitude.any() else amplitude[stated]
    lost = (share < NEGLIGIBLE) & (amplitude[stated] ** 2 <= SIGNIFICANT * floor) | (share < NOTHING)
    if lost.any():
        first = int(np.argmax(lost))
        more = f", nor at {int(lost.sum()) - 1} more of the {len(lines)} stated lines" if lost.sum() > 1 else ""
        raise RecordError(
            f"{place} does not excite {lines[first] * spacing:.6g} Hz (harmonic "
            f"{lines[first] // periods}), with {share[first]:.1e} of the strongest line{more}; "
            "correct lines, or leave out every"
        )


def check_steps(cuts: list[Cut], channel: np.ndarray, rate: float, name: str, place: str) -> None:
    """Raise RecordError if in most steps the input is strongest at another frequency than the stated one."""
    wrong = []
    for cut in cuts:
        spectrum = np.abs(np.fft.rfft(cut.blocks_of(channel).mean(axis=0)))
        strongest = int(np.argmax(spectrum[1:])) + 1
        if spectrum[strongest] > 2 * spectrum[cut.lines[0]]:
            wrong.append((cut, strongest))
    if len(wrong) > len(cuts) / 2:
        cut, strongest = wrong[0]
        stated, found = (line * rate / cut.samples for line in (cut.lines[0], strongest))
        raise RecordError(
            f"{place}: '{name}' is strongest at {found:.4g} Hz where {stated:.4g} Hz is stated, and so in "
            f"{len(wrong)} of {len(cuts)} steps; check sample_rate and the steps"
        )
