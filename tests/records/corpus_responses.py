"""The part of the corpus that was measured as responses over frequency."""

import numpy as np

from tests.records.corpus_writers import BODE, FREQUENCY, MAGNITUDE_DB, PHASE_DEG, RESPONSE, Layout, lines_of, text_file

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
