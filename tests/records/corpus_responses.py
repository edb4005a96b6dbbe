"""The part of the corpus that was measured as responses over frequency."""

import numpy as np

from tests.records.corpus_writers import (
    BODE,
    COLUMNS,
    FORCE,
    FORCE_AND_POSITION,
    FREQUENCY,
    LVM_HEAD,
    MAGNITUDE_DB,
    PERIODIC,
    PHASE_DEG,
    POSITION,
    PROPOSED,
    RATE_HZ,
    RESPONSE,
    SWEEP_HEAD,
    TIME,
    Layout,
    hdf5,
    hdf5_matrix,
    jittered,
    joined,
    lines_of,
    mcap,
    mdf,
    padded_side_by_side,
    parquet,
    plant,
    rate_in_a_column,
    scope,
    sinumerik_measurement,
    sinumerik_trace,
    tdms,
    text_and_flags,
    text_file,
    uff_response,
    uff_time,
)  # fmt: skip

__all__ = ["LAYOUTS", "Layout", "plant"]

LAYOUTS = {
    "comma": Layout(
        "logger",
        ["a.csv"],
        text_file("a.csv", "time [s],force [N],position [um]\n", COLUMNS),
        [*FORCE_AND_POSITION, *PERIODIC],
        PROPOSED,
    ),
    "decimal comma": Layout(
        "spreadsheet",
        ["a.csv"],
        text_file(
            "a.csv",
            "Zeit [s];Kraft [N];Weg [um]\n",
            lines_of("%.10g", TIME, FORCE, POSITION, separator=";", comma=True),
        ),
        ["--channel", "u=Kraft", "--channel", "y=Weg", *PERIODIC],
        ("u=Kraft", "y=Weg", "--time Zeit"),
    ),
    "tab": Layout(
        "spreadsheet",
        ["a.tsv"],
        text_file(
            "a.tsv", "time [s]\tforce [N]\tposition [um]\n", lines_of("%.10g", TIME, FORCE, POSITION, separator="\t")

RESPONSE_LAYOUTS = {
    "Bode in dB and degrees": Layout(
        "spectrum analyser",
        ["a.csv"],
        text_file(
            "a.csv",
            "Frequency [Hz],Magnitude [dB],Phase [deg]\n",
            lines_of("%.10g", FREQUENCY, MAGNITUDE_DB, PHASE_DEG),
        ),
        BODE,
        ("frequency=Frequency", "magnitude=Magnitude", "phase=Phase"),
        "replace OUTPUT/INPUT",
    ),
    "Bode in real and imaginary part": Layout(
        "spectrum analyser",
        ["a.csv"],
        text_file(
            "a.csv",
            "freq [Hz];re;im;coherence\n",
            lines_of("%.10g", FREQUENCY, RESPONSE.real, RESPONSE.imag, np.full(40, 0.99), separator=";"),
        ),
        [
            "--channel",
            "frequency=freq",
            "--channel",
            "real=re",
            "--channel",
            "imaginary=im",
            "--channel",
            "coherence=coherence",
            "--averages",
            "16",
            "--unit",
            "um/N",
        ],
        ("frequency=freq", "real=re", "imaginary=im", "coherence=coherence"),
        "replace OUTPUT/INPUT",
    ),
    "response in NumPy": Layout(
        "python-control",
        ["a.npz"],
        lambda folder: np.savez(
            folder / "a.npz", omega=2 * np.pi * FREQUENCY, mag=np.abs(RESPONSE), phase=np.radians(PHASE_DEG)
        ),
        [
            "--channel",
            "frequency=omega [rad/s]",
            "--channel",
            "magnitude=mag",
            "--channel",
            "phase=phase [rad]",
            "--unit",
            "um/N",
        ],
        ("frequency=", "magnitude=mag"),
        "replace OUTPUT/INPUT",
    ),
}
