"""What the encoder's errors do to the force of a law: how much each record counts."""

import numpy as np
from fraexp_plugins.friction.none import Frictionless
from fraexp_plugins.identification.autonomous._shared.autonomous_lines import ElementObserver
from fraexp_plugins.identification.autonomous._shared.law_elements import (
    WeakeningElements,
)
from fraexp_plugins.identification.autonomous._shared.law_records import LawRecords

from fraexp.data.signals import Signals
from tests.identification.test_law_elements import record_of


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
