"""Selection of the excited harmonics, and checks of the harmonics that the study states."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fraexp.errors import RecordError
from fraexp.records.cutting import Cut
from fraexp.records.excited import (
    NEGLIGIBLE_RATIO,
    ROUNDING_RATIO,
    SIGNIFICANCE_RATIO,
    ExcitedLines,
    find_excited_lines,
    find_injected_lines,
    line_power,
    line_spectrum,
)
from fraexp.records.record_settings import RecordSettings

MAX_LINE_DIFFERENCE = 0.2
"""Share of lines in which realisations of one multisine may differ by noise."""
MIN_POWER_SHARE = 0.5
"""Share of the input's power at the lines of the reference below which something else excites the machine."""


def select_lines(settings: RecordSettings, cut: Cut, values: Mapping[str, NDArray[np.float64]], place: str) -> Cut:
    """Return the cut with its excited harmonics: those stated, otherwise those that are found in the injected signal.

    `harmonics`, or `harmonic_step` from `min_frequency` to `max_frequency`, state them; RecordError if nothing is
    injected there. Without a channel for the injected signal they are found in the input, where they must be stronger
    than the lines of friction.
    """
    _check_statement(settings, cut, place)
    last = (cut.samples - 1) // 2
    base = cut.periods / (cut.samples * cut.sample_time)
    lowest = max(math.ceil((settings.min_frequency or 0.0) / base - 1e-6), 1)
    highest = math.floor(settings.max_frequency / base + 1e-6) if settings.max_frequency else last // cut.periods
    stated = sorted(
        set(
            settings.harmonics or (range(lowest, highest + 1, settings.harmonic_step) if settings.harmonic_step else ())
        )
    )
    lines = [line * cut.periods for line in stated]
    band = (lowest * cut.periods, highest * cut.periods)
    found = ExcitedLines(lines) if stated else _find_lines(settings, cut, values, band, place)
    lines = list(found.lines)
    if not lines or lines[0] < 1 or lines[-1] > last:
        found_text = f"{lines[0] // cut.periods} to {lines[-1] // cut.periods}" if lines else "none"
        raise RecordError(
            f"{place}: the excited harmonics are {found_text}; expected some from 1 to {last // cut.periods} "
            f"({base:.4g} to {0.5 / cut.sample_time:.4g} Hz): correct min_frequency and max_frequency, or harmonics"
        )
    if stated:
        blocks = cut.blocks_of(values[settings.injected])
        _check_excited(lines, blocks, base / cut.periods, cut.periods, f"{place}: '{settings.injected}'")
    return replace(cut, lines=tuple(lines), left_out=found.left_out, doubtful=found.doubtful)


def _find_lines(
    settings: RecordSettings, cut: Cut, values: Mapping[str, NDArray[np.float64]], band: tuple[int, int], place: str
) -> ExcitedLines:
    """Return the excited lines within a frequency range, with the doubtful ones."""
    name, blocks = settings.injected, cut.blocks_of(values[settings.injected])
    if name == settings.reference:
        found = find_excited_lines(blocks, band, stated=bool(settings.min_frequency and settings.max_frequency))
    else:
        found = find_injected_lines(blocks, band)
        if name == "reference":
            _check_share(found.anywhere, cut.blocks_of(values[settings.reference]), settings.reference, place)
    if found.anywhere and not found.lines:
        spacing = 1 / (cut.samples * cut.sample_time)
        low, high = (line * spacing for line in (found.anywhere[0], found.anywhere[-1]))
        raise RecordError(
            f"{place}: none of the excited lines, {low:.4g} to {high:.4g} Hz, is between min_frequency and "
            "max_frequency; correct both, or give harmonics"
        )
    return found


def _check_share(lines: Sequence[int], blocks: NDArray[np.float64], name: str, place: str) -> None:
    """Raise RecordError if the input has most of its power at other lines than those of the reference."""
    power = line_power(blocks)
    share = float(power[np.array(lines, dtype=int) - 1].sum() / power.sum()) if power.any() else 1.0
    if share < MIN_POWER_SHARE:
        raise RecordError(
            f"{place}: '{name}' has {share:.0%} of its power at the {len(lines)} lines of 'reference': something else "
            f"excites the machine; give that as channel 'excitation', or line_channel = '{name}' (--input {name}) to "
            "look for lines there"
        )


def common_lines(cuts: Sequence[Cut]) -> list[Cut]:
    """Return cuts whose lines are those that most of them have, where noise alone makes them differ.

    Realisations are recognised by equal lines. If more than a few differ, as with random grids, all cuts are kept.
    """
    found = list(cuts)
    for shape in {(cut.samples, cut.sample_time) for cut in cuts}:
        places = [place for place, cut in enumerate(cuts) if (cut.samples, cut.sample_time) == shape]
        counts = Counter(line for place in places for line in cuts[place].lines)
        most = {line for line, count in counts.items() if count > len(places) / 2}
        if all(
            len(most.symmetric_difference(cuts[place].lines)) <= MAX_LINE_DIFFERENCE * len(most) for place in places
        ):
            for place in places:
                found[place] = replace(cuts[place], lines=tuple(sorted(most)))
    return found


def _check_statement(settings: RecordSettings, cut: Cut, place: str) -> None:
    if settings.harmonics and (settings.harmonic_step or settings.min_frequency or settings.max_frequency):
        raise RecordError(f"{place}: expected either harmonics, or min_frequency, max_frequency and harmonic_step")
    if settings.harmonic_step and not (settings.min_frequency and settings.max_frequency):
        raise RecordError(
            f"{place}: harmonic_step is given without min_frequency and max_frequency; give both, or harmonics"
        )
    if settings.max_frequency and settings.max_frequency > 0.5 / cut.sample_time:
        raise RecordError(
            f"{place}: max_frequency is {settings.max_frequency:.4g} Hz; expected at most half the sample rate, "
            f"{0.5 / cut.sample_time:.4g} Hz"
        )
    if settings.min_frequency and settings.max_frequency and settings.min_frequency > settings.max_frequency:
        raise RecordError(
            f"{place}: min_frequency is {settings.min_frequency:g} Hz and max_frequency {settings.max_frequency:g} Hz; "
            "expected the first below"
        )


def _check_excited(lines: list[int], blocks: NDArray[np.float64], spacing: float, periods: int, place: str) -> None:
    """Raise RecordError if a stated line is lost in noise; `spacing` is that of the block's lines [Hz]."""
    amplitude, scatter = line_spectrum(blocks)
    stated = np.array(lines) - 1
    others = np.delete(amplitude, stated)
    floor = np.maximum(scatter, np.median(others**2) if others.size else 0.0)[stated]
    share = amplitude[stated] / amplitude.max() if amplitude.any() else amplitude[stated]
    lost = (share < NEGLIGIBLE_RATIO) & (amplitude[stated] ** 2 <= SIGNIFICANCE_RATIO * floor) | (
        share < ROUNDING_RATIO
    )
    if lost.any():
        first = int(np.argmax(lost))
        more = f", nor at {int(lost.sum()) - 1} more of the {len(lines)} stated lines" if lost.sum() > 1 else ""
        raise RecordError(
            f"{place} does not excite {lines[first] * spacing:.6g} Hz (harmonic "
            f"{lines[first] // periods}), with {share[first]:.1e} of the strongest line{more}; "
            "correct harmonics, or leave out harmonic_step"
        )


def check_step_frequencies(
    cuts: Sequence[Cut], channel: NDArray[np.float64], rate: float, name: str, place: str
) -> None:
    """Raise RecordError if in most steps the input is strongest at another frequency than the stated one."""
    wrong = []
    for cut in cuts:
        samples = cut.blocks_of(channel).ravel()  # not the mean block, in which half of the stated frequency cancels
        spectrum = np.abs(np.fft.rfft(samples - np.linspace(samples[0], samples[-1], samples.size)))
        strongest = int(np.argmax(spectrum[1:])) + 1
        if spectrum[strongest] > 2 * spectrum[cut.lines[0] * cut.blocks]:
            wrong.append((cut, strongest / cut.blocks))
    if len(wrong) > len(cuts) / 2:
        cut, strongest_line = wrong[0]
        stated, found = (line * rate / cut.samples for line in (cut.lines[0], strongest_line))
        raise RecordError(
            f"{place}: '{name}' is strongest at {found:.4g} Hz where {stated:.4g} Hz is stated, and so in "
            f"{len(wrong)} of {len(cuts)} steps; check sample_rate and the steps"
        )
