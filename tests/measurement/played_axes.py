"""Records of excitations as machines play them, right ones and wrong ones, for tests of what is said of them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from fraexp import records
from fraexp.components.registry import Registry
from fraexp.data.results import Outcome
from fraexp.data.signals import Signals
from fraexp.measurement.excitation_files import ExcitationTable
from fraexp.records.record_settings import RecordSettings
from fraexp.study.accuracy import Accuracy

Array = NDArray[np.float64]


def late(samples: Array, count: int) -> Array:
    """Return samples that are recorded so many samples late, or early."""
    return np.roll(np.concatenate([samples, np.zeros(abs(count))]), count)[: samples.size]


def lost(samples: Array, count: int) -> Array:
    """Return samples of which so many are missing in the middle."""
    middle = samples.size // 2
    return np.concatenate([samples[:middle], samples[middle + count :], np.zeros(count)])


def few(samples: Array) -> Array:
    """Return samples of which one of 200 is missing, at random."""
    kept = np.random.default_rng(3).random(samples.size) > 1 / 200
    return np.pad(samples[kept], (0, samples.size - np.count_nonzero(kept)))


def slow(samples: Array) -> Array:
    """Return samples that are recorded by a clock that is 0.5 % slow."""
    return np.interp(np.arange(samples.size) * 1.005, np.arange(samples.size), samples)


CORRUPTIONS: dict[str, tuple[Callable[[Array, Array, Array], tuple[Array, Array]], str]] = {
    "excitation as u": (lambda w, u, y: (w, y), "^'u' is the excitation alone"),
    "u without excitation": (lambda w, u, y: (u - w, y), "^'u' is what the controller makes of 'y', without"),
    "u halved": (lambda w, u, y: (u / 2, y), r"^'u' is 0\.5 times the excitation minus .*channels\.u = \"u \* 2 \[N\]"),
    "u in percent": (lambda w, u, y: (u / 0.8, y), r"^'u' is 1\.25 times .*channels\.u = \"u \* 0\.8 \[N\]"),
    "u in kN": (lambda w, u, y: (u / 1e3, y), r"^'u' is 0\.001 times .* in kN; state .*\"u \[kN\]\""),
    "u negated": (lambda w, u, y: (-u, y), "^'u' has the opposite sign of the excitation minus"),
    "y negated": (lambda w, u, y: (u, -y), "^'y' has the opposite sign of the position that the controller answers"),
    "y / 1000": (lambda w, u, y: (u, y / 1e3), r"^'y' is 0\.001 times .*channels\.y = \"y \* 1000 \[m\]"),
    "y in mm": (lambda w, u, y: (u, 1e3 * y), r"^'y' is 1,000 times .* in mm; state .*\"y \[mm\]\""),
    "y * 3": (lambda w, u, y: (u, 3 * y), r"^'y' is 3 times the position that the controller answers in 'u'"),
    "y in counts": (lambda w, u, y: (u, y / 2e-8), r"^'y' is 5e\+07 times .*\"y \* 2e-08 \[m\]\""),
    "y late": (lambda w, u, y: (u, late(y, 1)), "'y' is recorded 1 sample late; record 'y' as the controller reads"),
    "y early": (lambda w, u, y: (u, late(y, -1)), "'y' is recorded 1 sample early; .* a delay of the controller"),
    "u late": (lambda w, u, y: (late(u, 10), y), "^'u' is recorded 10 samples late"),
    "u filtered": (lambda w, u, y: (lfilter([0.25], [1, -0.75], u), y), "^'u' lags .* time constant of 3 samples"),
    "lost rows": (lambda w, u, y: (lost(u, 9), lost(y, 9)), "^within the record rows are lost .* 9 samples before"),
    "clock": (lambda w, u, y: (slow(u), slow(y)), r"takes 1\.00[45]\d* times as long|its clock changes"),
    "few rows": (lambda w, u, y: (few(u), few(y)), "^the record shows the whole excitation, and not in time"),
    "compensation": (
        lambda w, u, y: (u + 0.3 * np.abs(w).max() * np.sign(np.gradient(y)), y),
        "^'u' has .* in the dir",
    ),
    "swapped": (lambda w, u, y: (y, u), "^'u' and 'y' are swapped"),
    "begun late": (lambda w, u, y: (late(u, -150), late(y, -150)), "^the record begins 150 samples late; .* lower"),
    "begun early": (lambda w, u, y: (late(u, 230), late(y, 230)), "^the record begins 230 samples early; .* raise"),
}
"""What becomes of excitation, control input and position in a wrong record, and what is said of it."""
RIGHT: dict[str, Callable[[Array, Array], tuple[Array, Array]]] = {
    "exact": lambda u, y: (u, y),
    "few digits": lambda u, y: (np.round(u, 2), np.round(y / np.ptp(y), 4) * np.ptp(y)),
    "begun by a sample late": lambda u, y: (late(u, -1), late(y, -1)),
    "gain of 2 % in u": lambda u, y: (1.02 * u, y),
}
"""Records that are as good as right."""


def write_record(file: Path, u: Array, y: Array) -> None:
    """Write the record of a play as a user's program does."""
    np.savetxt(file, np.array([u, y]).T, delimiter=",", header="u,y", comments="", fmt="%.12g")


def load_record(file: Path, section: dict[str, Any], registry: Registry) -> Signals:
    """Return what a record contains, by the section of its study."""
    settings = RecordSettings.parse(section, "record")
    return records.load(*records.resolve(settings, file.parent, registry), registry)


def section_of(file: Path, table: ExcitationTable, controller: dict[str, Any]) -> dict[str, Any]:
    """Return the section [record] for an excitation."""
    return {
        "file": file.name,
        "sample_rate": 1 / table.sample_time,
        "channels": {"u": "u [N]", "y": "y [m]"},
        "controller": controller,
        "segments": table.segments(),
    }


def is_doubted(signals: Signals) -> bool:
    """Return whether the columns of a record are in doubt by more than the usual accuracy."""
    allowed = Accuracy().relative_error
    return signals.outcome is Outcome.INACCURATE or any(each.error > allowed for each in signals.findings)
