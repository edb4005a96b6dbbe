"""Limit cycles that the describing function predicts are those of a loop that is simulated in time."""

import numpy as np
import pytest
from fraexp_plugins.tuning.loop_tuning import LimitCycle, limit_cycles

from tests.tuning.loops import SAMPLE_TIME_S, amplitude_and_frequency, family, lead, simulate


def predicted(late_samples: int, proportional: float) -> list[LimitCycle]:
    loops, friction = family(late_samples * SAMPLE_TIME_S)
    return limit_cycles(loops, friction, loops.control(lead(proportional)))


@pytest.mark.thorough
def test_a_stable_limit_cycle_is_reached_from_below_and_from_above() -> None:
    (cycle,) = predicted(16, 6000.0)
    assert cycle.is_stable
    for factor in (0.5, 2.0):
        position = simulate(lead(6000.0), 16, factor * cycle.amplitude, 2.0)
        amplitude, frequency = amplitude_and_frequency(position[-1600:])
        assert amplitude == pytest.approx(cycle.amplitude, rel=0.05)
        assert frequency == pytest.approx(cycle.frequency, rel=0.01)


def test_a_loop_with_less_delay_has_none_and_comes_to_rest() -> None:
    assert predicted(2, 6000.0) == []
    position = simulate(lead(6000.0), 2, 1e-5, 1.0)
    assert np.ptp(position[-200:]) < 0.05 * np.ptp(position[:200])


@pytest.mark.thorough
def test_an_unstable_limit_cycle_divides_what_decays_from_what_grows() -> None:
    """Above the greater one the body leaves the guide's friction behind, and the loop diverges."""
    cycles = predicted(12, 20_000.0)
    assert [cycle.is_stable for cycle in cycles] == [False, True]
    unstable, stable = cycles
    below = simulate(lead(20_000.0), 12, 0.5 * unstable.amplitude, 3.0)
    above = simulate(lead(20_000.0), 12, 4.0 * unstable.amplitude, 3.0)
    assert amplitude_and_frequency(below[-1600:])[0] == pytest.approx(stable.amplitude, rel=0.1)
    assert abs(above[-1600:]).max() > 2 * abs(above[:1600]).max()
