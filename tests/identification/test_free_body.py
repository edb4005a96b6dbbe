"""Far below the first mode an axis is a free body: elements that are a spring in most records are seen there."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from fraexp_plugins.friction.none import Frictionless
from fraexp_plugins.identification.autonomous._shared import law_choice
from fraexp_plugins.identification.autonomous._shared.autonomous_lines import ElementObserver
from fraexp_plugins.identification.autonomous._shared.law_choice import LawChoice, choose_law
from fraexp_plugins.identification.autonomous._shared.law_elements import RollingElements

from fraexp.data.signals import Signals
from tests.identification.test_law_elements import record_of

FREQUENCIES, SPEEDS = np.geomspace(2.0, 20.0, 10), (1e-3, 8e-3, 0.06)
LAW = RollingElements(np.log([1e-12]), np.array([1e-6, 4e-6, 0.1]))
OBSERVER = ElementObserver(friction=Frictionless(), oversampling=4)
KNOWN = np.array([0.5, 100.0])
INVERSE = KNOWN, -5.0 * (2 * np.pi * KNOWN) ** 2 + 0j


def signals_of(mode: float = np.inf) -> Signals:
    """Return records of a mass and two elements, which a mode at some frequency [Hz] makes appear larger."""
    model = replace(LAW, thresholds=LAW.thresholds[:2]).model(np.array([4.0, 6.0, 0, 0, 0, 0]), 0.0)
    segments = [
        record_of(model, f, speed / (2 * np.pi * f), 5.0 / (1 - (f / mode) ** 2))
        for f in FREQUENCIES
        for speed in SPEEDS
    ]
    return Signals(tuple(segments), {"u": "N", "y": "m"})


@pytest.mark.parametrize(("mode", "is_free"), [(60.0, True), (3.5, False)])
def test_a_mode_near_the_lowest_frequencies_is_not_taken_for_a_free_body(
    mode: float, is_free: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    families = law_choice._families
    monkeypatch.setattr(law_choice, "_families", lambda *given: islice(families(*given), 1))
    choice: LawChoice = choose_law(signals_of(mode), OBSERVER, INVERSE, False)
    assert (choice.records.free_lines.size > 0) == is_free
    assert choice.best.coulomb == pytest.approx(10.0, rel=2e-3)
