"""What the encoder's errors do to the force of a law: how much each record counts."""

import numpy as np
import pytest
from fraexp_plugins.friction.none import Frictionless
from fraexp_plugins.identification.autonomous._shared import law_choice
from fraexp_plugins.identification.autonomous._shared.autonomous_lines import ElementObserver
from fraexp_plugins.identification.autonomous._shared.law_choice import LawFit
from fraexp_plugins.identification.autonomous._shared.law_elements import (
    BristleElements,
    LawElements,
    WeakeningElements,
)
from fraexp_plugins.identification.autonomous._shared.law_profile import LawProfile
from fraexp_plugins.identification.autonomous._shared.law_records import LawRecords

from fraexp.components.kinds import Motion
from fraexp.data.signals import Signals
from tests.identification.test_law_elements import LAWS, record_of


@pytest.mark.parametrize("silent", [slice(0), slice(1), slice(None)], ids=["all act", "one does not", "none acts"])
@pytest.mark.parametrize(("elements", "sizes"), LAWS, ids=lambda each: getattr(each, "name", ""))
def test_elements_that_act_have_the_force_of_all(elements: LawElements, sizes: list[float], silent: slice) -> None:
    wave, given = np.sin(2 * np.pi * np.arange(400) / 400), np.array(sizes)
    given[silent] = 0.0
    motions = [Motion(amplitude * wave, 1e-3, True) for amplitude in (2e-6, 3e-4)]
    law, acting = elements.acting(given)
    for few, every in zip(law.forces(motions), elements.forces(motions), strict=True):
        np.testing.assert_allclose(few @ acting, every @ given, atol=1e-12)


def test_no_record_counts_far_more_than_the_encoder_lets_it() -> None:
    """By four errors of the encoder, 1 in 20 records counted four times as much as by many, and some fifteen times."""
    law = WeakeningElements(np.log([0.2, 8e-4, 8.0]), np.array([2e-7, 3e-7, 5.5e-6, 6e-6, 1.5e-5]), 2.0)
    sizes, frequencies = np.array([1.7, 3.2, 3.5, 2.3, 2.3]), np.geomspace(2.0, 8.0, 6)
    speeds = (1e-4, 8e-3, 3.7e-2, 7.5e-2)
    segments = tuple(
        record_of(law.model(sizes, 0.0), f, speed / (2 * np.pi * f), 3.6) for f in frequencies for speed in speeds
    )
    observer = ElementObserver(friction=Frictionless(), oversampling=2, resolution=1e-7, noise=5e-8)
    known = np.array([0.5, 100.0])
    records = LawRecords.from_signals(
        Signals(segments, {"u": "N", "y": "m"}), observer, (known, -3.6 * (2 * np.pi * known) ** 2 + 0j)
    )
    force = records.deflection(law) @ sizes
    many = np.mean(
        [np.abs(records.deflection(law, records.shaken_motions(seed)) @ sizes - force) ** 2 for seed in range(50, 98)],
        axis=0,
    )
    ratio = (records.friction_noise(law, sizes) / np.where(many > 0, many, 1.0))[records.lines.known]
    assert ratio.min() > 0.2
    assert 0.8 < np.median(ratio) < 1.2


def test_finer_steps_follow_where_coarse_ones_do_not_lead_to_a_good_law() -> None:
    """Coarse steps led stiff bristles to another shape, and elements that weaken left less."""
    truth, known = BristleElements(np.log([5e-6, 0.12, 6e-4])), np.array([0.5, 200.0])
    model, speeds = truth.model(np.array([26.0, 2.0]), 0.0), (2e-3, 6e-3, 0.02)
    segments = tuple(record_of(model, f, v / (2 * np.pi * f)) for f in (10.0, 60.0, 150.0) for v in speeds)
    signals, inverse = Signals(segments, {"u": "N", "y": "m"}), (known, -5.0 * (2 * np.pi * known) ** 2 + 0j)
    coarse, fine = (
        LawRecords.from_signals(signals, ElementObserver(friction=Frictionless(), oversampling=steps), inverse)
        for steps in (1, 8)
    )
    shaped = LawProfile(truth, 0.0, coarse).elements
    _, left, _ = fine.solve(fine.deflection(shaped), 0.0)
    assert np.sqrt(np.sum(left**2) / fine.equations) > law_choice.GOOD
    found, profile = law_choice._shape_law(LawFit(shaped, np.empty(0), np.inf, 0.0, 0.0), coarse, coarse, fine)
    assert found.residual < 0.2
    np.testing.assert_allclose(np.exp(found.elements.shape), np.exp(truth.shape), rtol=3e-3)
    np.testing.assert_array_equal(profile.elements.shape, found.elements.shape)
