"""A friction model that is wrong shows as distortion between random phases, without the plant, on a noisy scale."""

import numpy as np
import pytest
from fraexp_plugins.estimators.best_linear_approximation import BestLinearApproximation
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.excitations.multisine import Multisine

from tests.machines import excited, guide
from tests.responses import judged

SCALE = {"resolution": 0.1e-6, "noise": 30e-9}


@pytest.fixture(scope="module")
def signals():
    excitation = Multisine(
        rms=12.0, min_frequency=1, max_frequency=100, line_spacing=0.5, points=50, detection_group_size=0,
        realisations=6, recorded_periods=4,
    )  # fmt: skip
    return excited(excitation, guide(), **SCALE)


@pytest.mark.parametrize("scale", ["force_scale", "displacement_scale"])
def test_distortion_grows_with_the_error_of_the_model_and_only_the_right_one_is_ok(signals, scale):
    shares = []
    for factor in (1.0, 1.01, 1.03, 1.1):
        known = {"friction": guide(), "input_dead_time": 1e-3, "force_std": 0.0, "displacement_std": 0.0}
        method = EffectiveInput(method=BestLinearApproximation(), **known, **SCALE, **{scale: factor})
        found = judged(method, signals)
        response, kinds = found.response, [each.kind for each in found.findings]
        assert kinds == ([] if factor == 1 else ["band by distortion"])
        inside = (response.frequency > 5) & (response.frequency < 20)
        relative = np.sqrt(response.nonlinear_variance) / np.abs(response.response)
        shares.append(np.median(relative[inside]))
    assert shares == sorted(shares)
