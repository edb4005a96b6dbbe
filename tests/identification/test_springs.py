"""Elements that slip in few records are springs in the others: they are left out unless the records need them."""

import numpy as np
import pytest
from fraexp_plugins.friction.none import Frictionless
from fraexp_plugins.identification.autonomous._shared.autonomous_lines import ElementObserver
from fraexp_plugins.identification.autonomous._shared.law_choice import LawFit, _judged, _without_springs
from fraexp_plugins.identification.autonomous._shared.law_elements import RollingElements, WeakeningElements
from fraexp_plugins.identification.autonomous._shared.law_interval import law_uncertainty
from fraexp_plugins.identification.autonomous._shared.law_records import LawRecords

from fraexp.data.signals import Signals
from tests.identification.test_law_elements import record_of

FREQUENCIES, SPEEDS = np.geomspace(3.0, 20.0, 4), (1e-3, 8e-3, 0.06)
LARGEST = 0.06 / (2 * np.pi * FREQUENCIES[0])
KNOWN = np.array([0.5, 100.0])
INVERSE = KNOWN, -5.0 * (2 * np.pi * KNOWN) ** 2 + 0j
SHAPES = {RollingElements: np.log([1e-12]), WeakeningElements: np.log([1e-9, 1e-3, 60.0])}


@pytest.mark.parametrize(
    ("kind", "width", "kept"),
    [
        (RollingElements, 4e-6, 0.05),
        (RollingElements, 0.4 * LARGEST, 0.7),
        (WeakeningElements, 0.1 * LARGEST, 0.2),
    ],
)
def test_elements_are_as_wide_as_the_records_need(
    kind: type[RollingElements] | type[WeakeningElements], width: float, kept: float
) -> None:
    """A force of 4 N slips within 1 µm, and one of 6 N within a given width: 10 N in gross sliding."""
    model = RollingElements(SHAPES[RollingElements], np.array([1e-6, width])).model(
        np.array([4.0, 6.0, 0, 0, 0, 0]), 0.0
    )
    segments = tuple(record_of(model, f, v / (2 * np.pi * f), 5.0) for f in FREQUENCIES for v in SPEEDS)
    observer = ElementObserver(friction=Frictionless(), oversampling=4)
    records = LawRecords.from_signals(Signals(segments, {"u": "N", "y": "m"}), observer, INVERSE)
    grid = np.unique([*np.geomspace(3e-7, 0.7 * LARGEST, 20), 1e-6, width])
    fit = _judged(LawFit(kind(SHAPES[kind], grid), np.empty(0), np.inf, 0.0, 0.0), records, records)
    found, doubt = _without_springs(fit, law_uncertainty(fit.elements, 0.0, records), records, records)
    assert found.coulomb == pytest.approx(10.0, rel=3e-3)
    assert found.elements.thresholds.max() <= kept * LARGEST * (1 + 1e-9)
    assert found.elements.thresholds.max() >= width
    assert doubt.covariance.shape[0] == found.elements.shape.size + found.sizes.size
