"""Controllers as exported code computes them: in delta form, with a reference of its own and an integral that can wait.

The delta form keeps the digits that coefficients of z⁻¹ lose where poles are near 1.
"""

from collections.abc import Iterable
from fractions import Fraction
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from fraexp.components.kinds import Controller
from fraexp.components.translation.blocks import FeedbackForm

RELATIVE_ROUNDING = 1e-12
"""Value of a polynomial at z = 1, over the sum of its coefficients' magnitudes, that is 0 but for rounding."""

Polynomial = list[Fraction]
"""Coefficients in ascending powers of z⁻¹."""


def feedback_form(controller: Controller, sample_time: float) -> FeedbackForm:
    """Return a controller u = N/D (r - y) - (N - T)/D r, of which T/D acts on the reference.

    N - T vanishes at z = 1, hence (N - T)/D r is a filter of the movements of r. With D = (1 - z⁻¹) D1 the integral of
    N/D is N(1)/D1(1) z⁻¹/(1 - z⁻¹); it waits for a sample if its growth is taken off by z⁻¹ D1/D.
    """
    fractions = *controller.transfer_function(sample_time), controller.reference_numerator(sample_time)
    size = max(part.size for part in fractions)
    n, d, t = (_padded(map(Fraction, part.tolist()), size) for part in fractions)
    derivative = _padded(_divided([a - b for a, b in zip(n, t, strict=True)]), size)
    rest = d
    while any(rest[1:]) and abs(float(sum(rest))) <= RELATIVE_ROUNDING * float(sum(map(abs, rest))):
        rest = _divided(rest)
    has_integral = len(rest) < size
    integral = _padded([Fraction(0), *rest] if has_integral else [], size)
    centres = delta_centres(fractions[1], size)
    parts = [delta_form(part, centres) for part in (n, derivative, d, integral)]
    gain = float(sum(n) / sum(rest)) if has_integral else 0.0
    return parts[0], parts[1], parts[2], parts[3], np.concatenate([[0.0], centres]), gain


def _padded(coefficients: Iterable[Fraction], size: int) -> Polynomial:
    found = list(coefficients)
    return found + [Fraction(0)] * (size - len(found))


def _divided(polynomial: Polynomial) -> Polynomial:
    """Return a polynomial that is 0 at z = 1, but for rounding, divided by 1 - z⁻¹."""
    return list(accumulate(polynomial))[:-1]


def delta_centres(denominator: NDArray[np.float64], size: int) -> NDArray[np.float64]:
    """Return the numbers of -1, 0 and 1 that are nearest to the poles, in ascending order, shape (size - 1,)."""
    poles = np.roots(denominator).real
    centres = np.zeros(size - 1)
    centres[: poles.size] = np.clip(np.rint(poles), -1, 1)
    centres.sort()
    return centres


def delta_form(polynomial: Polynomial, centres: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a polynomial as coefficients of 1, 1/(z - c1), 1/((z - c1)(z - c2)), … with the centres c.

    An integrator, which adds up its input, is the innermost. With all centres 1 this is the form in the delta operator
    (R. Middleton and G. Goodwin, Digital Control and Estimation, 1990), with all of them 0 that in z⁻¹. The division by
    each z - c is exact.
    """
    quotient, found = list(polynomial), Polynomial()
    for centre in reversed(centres.tolist()):
        for i in range(1, len(quotient)):
            quotient[i] += Fraction(centre) * quotient[i - 1]
        found.append(quotient.pop())
    return np.array([*quotient, *reversed(found)], dtype=float)
