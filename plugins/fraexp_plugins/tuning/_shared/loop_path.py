"""Sample time, dead times and lags of the loop around an identified plant."""

from typing import NamedTuple

from fraexp.api import Estimator, Fit, RecordError, Result, Signals

IDENTIFIED_DEAD_TIME = "input_dead_time"
"""Metric by which a method says the dead time that it has identified: all of it."""
DELAYS = ("input_dead_time", "input_time_constants", "output_dead_time", "output_time_constants")


class LoopPath(NamedTuple):
    """What lies between the controller and the plant, and back."""

    sample_time: float
    """Sample time of the controller [s]."""
    dead_time: float
    """Dead time of both directions [s]."""
    input_time_constants: tuple[float, ...]
    """Of the lags before the plant [s]."""
    output_time_constants: tuple[float, ...]
    """Of the lags behind it [s]."""

    @classmethod
    def of_loop(cls, stated: Estimator, signals: Signals, found: Result, fit: Fit) -> "LoopPath":
        """Return the path that a tuning estimator states, and what it leaves open as its method knows or found it.

        Of the dead time that is stated and the one that is known the greater counts. Raises RecordError if no sample
        time is stated for a response that has none.
        """
        given = {name: getattr(stated, name) for name in ("sample_time", *DELAYS)}
        if given["sample_time"] is None:
            if signals.are_stated:
                raise RecordError(
                    f"{stated.name}: the response has no sample time; expected {stated.name}.sample_time, that of the "
                    "controller: --set sample_time=0.001"
                )
            given["sample_time"] = signals.segments[0].sample_time
        method = innermost_method(stated)
        known = {name: getattr(method, name, None) for name in DELAYS}
        late = dict(zip(fit.parameters, fit.values.tolist(), strict=True)).get("dead_time", 0.0)
        identified = {metric.name: metric.value for metric in found.metrics}.get(IDENTIFIED_DEAD_TIME)
        before = known["input_dead_time"] or 0.0 if identified is None else identified
        lags = [given[name] if given[name] is not None else known[name] or () for name in DELAYS[1::2]]
        return cls(
            given["sample_time"],
            max(
                (given["input_dead_time"] or 0.0) + (given["output_dead_time"] or 0.0),
                before + (known["output_dead_time"] or 0.0) + max(late, 0.0),
            ),
            *lags,
        )


def innermost_method(estimator: Estimator) -> Estimator:
    """Return the estimator of the response that others fit."""
    while isinstance(method := getattr(estimator, "method", None), Estimator):
        estimator = method
    return estimator
