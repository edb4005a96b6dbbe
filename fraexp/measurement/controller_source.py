"""An excitation as source code that plays it: C99, and IEC 61131-3 Structured Text as TwinCAT takes it."""

from collections.abc import Iterable, Iterator

import numpy as np

from fraexp.measurement.excitation_table import ExcitationTable, TableEntry

NUMBERS_PER_LINE = 6
COUNTS = ("first", "samples", "periods", "ramp_out")
"""Whole numbers of a point: where its wave begins, samples and number of its periods, samples of its ramp out."""

C_TEMPLATE = """\
/* An excitation written by fraexp: {points} points, {samples} samples of {sample_time:g} s, in {unit}.
 *
 * fraexp_player player = {{0, 0}};
 * every {sample_time:g} s: control_input = feedback + fraexp_next(&player);
 */
#ifndef FRAEXP_EXCITATION_H
#define FRAEXP_EXCITATION_H

#define FRAEXP_SAMPLE_TIME {sample_time!r}
#define FRAEXP_POINTS {points}
#define FRAEXP_PAUSE {pause}L

static const double fraexp_wave[{size}] = {{
{wave}
}};
{counts}
static const double fraexp_rise[{points}] = {{
{rise}
}};

typedef struct {{
    int point;   /* the point that is played, from 0; FRAEXP_POINTS at the end */
    long sample; /* the next sample of it */
}} fraexp_player;

/* Return the next sample; 0 after the last one. */
static double fraexp_next(fraexp_player *player)
{{
    double amplitude, force;
    long last, k = player->sample;
    const int p = player->point;
    if (p >= FRAEXP_POINTS) return 0.0;
    last = fraexp_periods[p] * fraexp_samples[p];
    amplitude = 1.0;
    if (fraexp_rise[p] > 0.0 && fraexp_rise[p] * (double)k < 1.0) amplitude = fraexp_rise[p] * (double)k;
    if (k >= last) {{
        const double falling = 1.0 - (double)(k - last + 1) / (double)fraexp_ramp_out[p];
        amplitude = falling > 0.0 ? amplitude * falling : 0.0;
    }}
    force = fraexp_wave[fraexp_first[p] + k % fraexp_samples[p]] * amplitude;
    player->sample = k + 1;
    if (player->sample == last + fraexp_ramp_out[p] + FRAEXP_PAUSE) {{
        player->point = p + 1;
        player->sample = 0;
    }}
    return force;
}}

#endif
"""

ST_TEMPLATE = """\
(* An excitation written by fraexp: {points} points, {samples} samples of {sample_time:g} s, in {unit}.
   Call it every {sample_time:g} s while Enable is TRUE, and add Force to the control input.
   Enable = FALSE ends it within the ramp out of its point, and lets it begin anew. *)
FUNCTION_BLOCK FB_FraexpExcitation
VAR_INPUT
    Enable : BOOL;
END_VAR
VAR_OUTPUT
    Force : LREAL;
    Point : DINT;
    Done : BOOL;
END_VAR
VAR
    Sample : DINT;
    Last : DINT;
    Stopped : DINT := 0;
    AtRest : BOOL := TRUE;
    Amplitude : LREAL;
    Falling : LREAL;
END_VAR
VAR CONSTANT
    POINTS : DINT := {points};
    PAUSE : DINT := {pause};
    WAVE : ARRAY[0..{last}] OF LREAL := [
{wave}
    ];
{counts}
    RISE : ARRAY[0..{last_point}] OF LREAL := [
{rise}
    ];
END_VAR
IF NOT Enable THEN
    IF Stopped < 0 THEN
        Stopped := Sample;
    END_IF
ELSIF Stopped >= 0 AND AtRest THEN
    Stopped := -1;
    AtRest := FALSE;
    Point := 0;
    Sample := 0;
END_IF
Force := 0.0;
Done := Point >= POINTS;
IF Done THEN
    AtRest := TRUE;
ELSE
    Last := PERIODS[Point] * SAMPLES[Point];
    IF Stopped >= 0 AND Stopped < Last THEN
        Last := Stopped;
    END_IF
    IF Stopped >= 0 AND Sample >= Last + RAMP_OUT[Point] THEN
        AtRest := TRUE;
    END_IF
END_IF
IF NOT AtRest THEN
    Amplitude := 1.0;
    IF RISE[Point] > 0.0 AND RISE[Point] * DINT_TO_LREAL(Sample) < 1.0 THEN
        Amplitude := RISE[Point] * DINT_TO_LREAL(Sample);
    END_IF
    IF Sample >= Last THEN
        Falling := 1.0 - DINT_TO_LREAL(Sample - Last + 1) / DINT_TO_LREAL(RAMP_OUT[Point]);
        IF Falling > 0.0 THEN
            Amplitude := Amplitude * Falling;
        ELSE
            Amplitude := 0.0;
        END_IF
    END_IF
    Force := WAVE[FIRST[Point] + Sample MOD SAMPLES[Point]] * Amplitude;
    Sample := Sample + 1;
    IF Stopped < 0 AND Sample = Last + RAMP_OUT[Point] + PAUSE THEN
        Point := Point + 1;
        Sample := 0;
    END_IF
END_IF
END_FUNCTION_BLOCK
"""


def write_c(table: ExcitationTable) -> str:
    """Return a header file that plays the excitation, sample by sample and without memory of its own."""
    arrays = [
        f"static const long fraexp_{name}[{len(table.entries)}] = {{{', '.join(f'{n}L' for n in numbers)}}};"
        for name, numbers in _counts(table).items()
    ]
    return C_TEMPLATE.format(counts="\n".join(arrays), **_common(table))


def write_structured_text(table: ExcitationTable) -> str:
    """Return a function block that plays the excitation, sample by sample."""
    last_point = len(table.entries) - 1
    arrays = [
        f"    {name.upper()} : ARRAY[0..{last_point}] OF DINT := [{', '.join(map(str, numbers))}];"
        for name, numbers in _counts(table).items()
    ]
    common = _common(table)
    return ST_TEMPLATE.format(counts="\n".join(arrays), last_point=last_point, last=int(common["size"]) - 1, **common)


def _common(table: ExcitationTable) -> dict[str, int | float | str]:
    """Return what both languages say alike."""
    wave = np.concatenate([entry.request.waveform for entry in table.entries])
    return {
        "points": len(table.entries),
        "samples": table.samples,
        "sample_time": table.sample_time,
        "unit": table.unit,
        "pause": table.pause,
        "size": wave.size,
        "wave": _lines(wave.tolist()),
        "rise": _lines([entry.request.amplitude_rise for entry in table.entries]),
    }


def _counts(table: ExcitationTable) -> dict[str, list[int]]:
    """Return the whole numbers of all points, by name."""
    rows = list(zip(*_point_counts(table.entries), strict=True))
    return {name: list(row) for name, row in zip(COUNTS, rows, strict=True)}


def _point_counts(entries: Iterable[TableEntry]) -> Iterator[tuple[int, int, int, int]]:
    first = 0
    for entry in entries:
        request = entry.request
        yield first, request.waveform.size, request.repetitions, request.ramp_out
        first += request.waveform.size


def _lines(numbers: list[float]) -> str:
    """Return numbers, each with all of its digits, several a line."""
    texts = [repr(float(number)) for number in numbers]
    rows = [texts[k : k + NUMBERS_PER_LINE] for k in range(0, len(texts), NUMBERS_PER_LINE)]
    return ",\n".join("        " + ", ".join(row) for row in rows)
