"""The kinds of figure by name; importing this costs nothing."""

from fraexp.errors import FraexpError, did_you_mean

FIGURES = {
    "bode": "magnitude and phase over frequency, with 95 % bands",
    "errors": "error of each response against P(jω) over frequency",
    "amplitude_map": "error against P(jω), or the response, in colours over frequency and excitation amplitude",
    "difference": "how magnitude and phase differ from those of the first response, over frequency",
    "nyquist": "responses in the complex plane",
    "coherence": "coherence and harmonic distortion over frequency, as far as they are known",
    "levels": "magnitude over the standard deviations by noise and by nonlinear distortions",
    "hysteresis": "friction force over displacement",
    "positioning": "position less target over time within a few bands, and the thrust",
    "distribution": "metrics over random draws: share of the draws, with median and 95 %",
    "curves": "other curves, a panel for each column",
}
"""What each kind shows."""
AGAINST_PLANT = ("errors", "amplitude_map")
"""Kinds that compare with P(jω) at the frequencies of each response."""
OF_METRICS = ("distribution",)
"""Kinds for which neither response nor curve is needed."""


def check_kind(name: str, place: str) -> str:
    """Return the name of a kind of figure, or the empty one for what fits the results; FraexpError names the nearest.

    `place` begins the error's sentence.
    """
    if name and name not in FIGURES:
        raise FraexpError(f"{place} '{name}' is no kind of figure{did_you_mean(name, FIGURES)}")
    return name
