"""Controllers in delta form, which keeps the digits that coefficients of z⁻¹ lose where poles are near 1."""

from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from fraexp.components.translation.blocks import DeltaForm


def delta_form(numerator: NDArray[np.float64], denominator: NDArray[np.float64]) -> DeltaForm:
    """Return C(z) = N/D as coefficients of 1, 1/(z - c1), 1/((z - c1)(z - c2)), … of N and D, and 0, c1, c2, ….

    The centres c are the numbers of -1, 0 and 1 that are nearest to the poles, in ascending order: an integrator, which
    adds up its input, is the innermost. With all of them 1 this is the form in the delta operator (R. Middleton and
    G. Goodwin, Digital Control and Estimation, 1990), with all of them 0 that in z⁻¹.

    Args:
        numerator: coefficients of N in ascending powers of z⁻¹, shape (m,).
        denominator: those of D, shape (n,), from 1.

    """
    size = max(numerator.size, denominator.size)
    poles = np.roots(denominator).real
    centres = np.zeros(size - 1)
    centres[: poles.size] = np.clip(np.rint(poles), -1, 1)
    centres.sort()
    parts = [_expand(np.pad(part, (0, size - part.size)), centres) for part in (numerator, denominator)]
    return np.array(parts[0]), np.array(parts[1]), np.concatenate([[0.0], centres])


def _expand(coefficients: NDArray[np.float64], centres: NDArray[np.float64]) -> list[float]:
    """Return a polynomial in descending powers of z by products of z - c: divided by each, exactly."""
    quotient, found = list(map(Fraction, coefficients.tolist())), list[Fraction]()
    for centre in reversed(centres.tolist()):
        for i in range(1, len(quotient)):
            quotient[i] += Fraction(centre) * quotient[i - 1]
        found.append(quotient.pop())
    return list(map(float, [*quotient, *reversed(found)]))
