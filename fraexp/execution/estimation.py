"""One estimator applied to the signals of one experiment, with the numerical certificate of its result."""

from fraexp.components.kinds import Estimator
from fraexp.data.results import UNUSABLE_OUTCOMES, Result
from fraexp.data.rotary_axes import are_rotary, as_linear, rotary_result, rotary_text
from fraexp.data.signals import Signals
from fraexp.errors import FraexpError, PluginError, RecordError
from fraexp.execution.certificate import certify


def apply_estimator(estimator: Estimator, signals: Signals, tolerance: float) -> Result:
    """Return what an estimator learns from signals, certified to a numerical error; PluginError if it is no Result.

    Estimators know straight axes only: what they get and return is translated if the signals are those of a rotary one.
    """
    if not are_rotary(signals.units.values()):
        return _estimate(estimator, signals, tolerance)
    try:
        return rotary_result(_estimate(estimator, as_linear(signals), tolerance))
    except FraexpError as error:
        raise type(error)(rotary_text(str(error))) from error


def _estimate(estimator: Estimator, signals: Signals, tolerance: float) -> Result:
    if signals.are_stated and not estimator.takes_responses:
        raise RecordError(
            f"{estimator.name} needs samples over time, and the record is a response that was measured elsewhere; use "
            "an estimator of responses to sines, such as the one that fraexp import takes by itself"
        )
    if signals.outcome not in UNUSABLE_OUTCOMES:
        signals.check_values()
    estimator = estimator.resolve_for(signals)
    result = estimator.estimate(signals)
    if not isinstance(result, Result):
        raise PluginError(f"{estimator.name} returns {result!r:.60}; expected a Result")
    return certify(estimator, signals, result, tolerance)
