"""The comparison of friction laws: what predicts records best, by one significance, and the simplest of equals."""

from collections.abc import Callable, Iterable
from typing import NamedTuple, TypeVar

from fraexp.api import Finding, FraexpError
from fraexp_plugins.identification._likelihood import greatest_chance_gain


class Prediction(NamedTuple):
    """How well a fit predicts records, for a comparison with other fits."""

    error: float
    """Root mean square of what it leaves of the records that judge it: those that are held out, if there are any."""
    freedom: float
    """How many of these values are independent."""
    parameters: int
    """How many parameters were fitted."""

    def equals(self, other: "Prediction") -> bool:
        """Return whether it leaves no more than another one, but for what further parameters explain by chance.

        An F test: both predict the same values, so that what noise does to them is the same.
        """
        added = max(other.parameters - self.parameters, 1)
        return self.error**2 <= greatest_chance_gain(added, self.freedom) * other.error**2


Candidate = TypeVar("Candidate")
Fit = TypeVar("Fit")


def fit_each(
    candidates: Iterable[Candidate],
    fit: Callable[[Candidate], Fit],
    name: Callable[[Candidate], str] = lambda _: "",
    is_last: Callable[[Fit], bool] = lambda _: False,
) -> tuple[list[Fit], list[Finding]]:
    """Return the fits of all candidates but those that fail, and a remark on each of these; the failure if all fail.

    None is tried after one that `is_last`.
    """
    fits, left_out, failures = list[Fit](), list[Finding](), list[FraexpError]()
    for candidate in candidates:
        try:
            fits.append(fit(candidate))
        except FraexpError as error:
            failures.append(error)
            text = f"left out, as it cannot be computed: {error}"
            left_out.append(Finding("remark", place=name(candidate), text=text))
        else:
            if is_last(fits[-1]):
                break
    if not fits and failures:
        raise failures[0]
    return fits, left_out


def equals_of_best(fits: Iterable[Fit], prediction: Callable[[Fit], Prediction]) -> list[tuple[Prediction, Fit]]:
    """Return the fits that leave as little as the best one, which is the first, and how well they predict."""
    ordered = sorted(((prediction(each), each) for each in fits), key=lambda pair: pair[0].error)
    return [pair for pair in ordered if pair is ordered[0] or pair[0].equals(ordered[0][0])]


def best_of(fits: Iterable[Fit], prediction: Callable[[Fit], Prediction]) -> Fit:
    """Return the simplest of the fits that leave as little as the best one."""
    return min(equals_of_best(fits, prediction), key=lambda pair: pair[0].parameters)[1]
