"""The part of the corpus that was measured as responses over frequency."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.io import savemat

from tests.records.corpus_writers import BODE, FREQUENCY, MAGNITUDE_DB, PHASE_DEG, RESPONSE, Layout, lines_of, text_file
from tests.records.strangers import write_hdf5


def response(frequency: str, **parts: str) -> list[str]:
    """Return the options that import a response [um/N]."""
    named = {"frequency": frequency, **parts}
    return [*(word for name, column in named.items() for word in ("--channel", f"{name}={column}")), "--unit", "um/N"]


def complex_text(head: str, row: str) -> Callable[[Path], None]:
    """Return a writer of rows with frequency f [Hz] or w [rad/s], and the response z or its parts with their sign."""
    rows = [
        row.format(f=f, w=2 * np.pi * f, z=z, s="-" if z.imag < 0 else "+", a=abs(z.imag))
        for f, z in zip(FREQUENCY, RESPONSE, strict=True)
    ]
    return text_file("a.csv", head, "".join(rows))


def frd_in_hdf5(folder: Path) -> None:
    """MATLAB 7.3 stores a complex array as pairs, transposed."""
    pairs = np.empty((FREQUENCY.size, 1, 1), dtype=[("real", "f8"), ("imag", "f8")])
    pairs["real"], pairs["imag"] = RESPONSE.real[:, None, None], RESPONSE.imag[:, None, None]
    write_hdf5(folder / "a.mat", {"freq": FREQUENCY[:, None], "resp": pairs.T})


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
            "freq [Hz];re;im;coherence [%]\n",
            lines_of("%.10g", FREQUENCY, RESPONSE.real, RESPONSE.imag, np.full(40, 99.0), separator=";"),
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
        ("'frequency=omega [rad/s]'", "magnitude=mag", "'phase=phase [rad]'"),
        "replace OUTPUT/INPUT",
    ),
    "names of traces": Layout(
        "network analyser",
        ["a.csv"],
        text_file(
            "a.csv",
            "Frequency in Hz;Trace 1: Gain: Magnitude in dB;Trace 1: Gain: Phase in °\n",
            lines_of("%.10g", FREQUENCY, MAGNITUDE_DB, PHASE_DEG, separator=";", comma=True),
        ),
        response("Frequency", magnitude="Trace 1: Gain: Magnitude", phase="Trace 1: Gain: Phase"),
        ("frequency=Frequency", "magnitude=Trace 1: Gain: Magnitude", "phase=Trace 1: Gain: Phase"),
        "replace OUTPUT/INPUT",
    ),
    "complex numbers of Python": Layout(
        "Python",
        ["a.csv"],
        complex_text("frequency_hz,response\n", "{f:.10g},({z.real:.10g}{z.imag:+.10g}j)\n"),
        response("frequency_hz [Hz]", real="response.real", imaginary="response.imaginary"),
        ("'frequency=frequency_hz [Hz]'", "real=response.real", "imaginary=response.imaginary"),
        "replace OUTPUT/INPUT",
    ),
    "complex numbers of MATLAB": Layout(
        "MATLAB",
        ["a.csv"],
        complex_text("omega [rad/s];G\n", "{w:.10g};{z.real:.10g} {s} {a:.10g}i\n"),
        response("omega", real="G.real", imaginary="G.imaginary"),
        ("frequency=omega ", "real=G.real", "imaginary=G.imaginary"),
        "replace OUTPUT/INPUT",
    ),
    "magnitude and phase in MATLAB": Layout(
        "MATLAB",
        ["a.mat"],
        lambda folder: savemat(
            folder / "a.mat",
            {"mag": np.abs(RESPONSE)[None, None], "phase": PHASE_DEG[None, None], "w": 2 * np.pi * FREQUENCY[:, None]},
        ),
        response("w [rad/s]", magnitude="mag", phase="phase [deg]"),
        ("'frequency=w [rad/s]'", "magnitude=mag", "'phase=phase [deg]'"),
        "replace OUTPUT/INPUT",
    ),
    "frd in MATLAB": Layout(
        "MATLAB",
        ["a.mat"],
        lambda folder: savemat(folder / "a.mat", {"G": {"resp": RESPONSE[None, None], "freq": FREQUENCY[:, None]}}),
        response("G.freq [Hz]", real="G.resp.real", imaginary="G.resp.imaginary"),
        ("'frequency=G.freq [UNIT]'", "real=G.resp.real", "imaginary=G.resp.imaginary"),
        "the unit of 'G.freq' is unknown",
    ),
    "frd in MATLAB 7.3": Layout(
        "MATLAB",
        ["a.mat"],
        frd_in_hdf5,
        response("freq [Hz]", real="resp.real", imaginary="resp.imaginary"),
        ("'frequency=freq [UNIT]'", "real=resp.real", "imaginary=resp.imaginary"),
        "the unit of 'freq' is unknown",
    ),
    "frd in python-control": Layout(
        "python-control",
        ["a.npz"],
        lambda folder: np.savez(folder / "a.npz", omega=2 * np.pi * FREQUENCY, frdata=RESPONSE[None, None]),
        response("omega [rad/s]", real="frdata.real", imaginary="frdata.imaginary"),
        ("'frequency=omega [rad/s]'", "real=frdata.real", "imaginary=frdata.imaginary"),
        "replace OUTPUT/INPUT",
    ),
}
