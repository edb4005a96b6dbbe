"""Start values of a modal fit, from the response alone: modes are pursued one after another."""

import itertools
from collections.abc import Iterator

import numpy as np

from fraexp_plugins.identification.log_response import LogResponse
from fraexp_plugins.identification.modal_model import ModalModel, resonators

DAMPING = (0.01, 0.03, 0.1)
"""Damping ratios that are tried."""
FREQUENCIES = 250
"""Natural frequencies that are tried."""
BEYOND = 1.25
"""How far above the band a mode is looked for."""
TURNS, STEPS = 2.0, 8
"""Whole turns of the phase at the band's upper limit up to which a dead time is looked for, in so many steps each."""
RATES = (0.1, 1.0, 6.0)
"""Rates k0 D of the viscous rigid body that are tried, over ω_l."""
LAST, APART = 3, 6
"""How many choices of the last mode are tried where the other ones are given, and how many steps of f apart."""
EXPONENTS = (1.0, 0.5)
"""Weights |Ĝ|^-x that are tried: the first sees the anti-resonances best, the second the resonances."""


class Dictionary:
    """The modes that are tried for a response, as rows of a linear least-squares problem for each weight."""

    def __init__(self, data: LogResponse) -> None:
        self.data = data
        grid = np.geomspace(data.frequency[0], BEYOND * data.frequency[-1], FREQUENCIES)
        self.atoms = np.array([(f, z) for z in DAMPING for f in grid])
        """Pairs (f [Hz], ζ), shape (m, 2)."""
        modes = resonators(data.s, 2 * np.pi * self.atoms[:, 0], self.atoms[:, 1])
        self.weights = [np.abs(data.response) ** -exponent for exponent in EXPONENTS]
        self.rows = [_real(modes * weight) for weight in self.weights]
        self.powers = [np.sum(rows**2, axis=1) for rows in self.rows]


def starts(
    model: ModalModel, dictionary: Dictionary, modes: np.ndarray, ends: tuple[np.ndarray, np.ndarray] | None = None
) -> Iterator[np.ndarray]:
    """Yield vectors p to start from; `modes` are pairs (f [Hz], ζ), shape (m, 2), that are kept, at most model.modes.

    `ends` are the rates k0 D [rad/s] and the dead times [s] that are tried, by default a grid.

    With poles and dead time given the response is linear in k0 and k0 r_i. For each dead time and weight the mode is
    added that lowers the squared error of that linear fit most, until there are enough (orthogonal matching pursuit:
    Y. C. Pati, R. Rezaiifar and P. S. Krishnaprasad, Asilomar Conf. 1993, doi 10.1109/ACSSC.1993.342465).
    """
    data, count = dictionary.data, model.modes - len(modes)
    kept = resonators(data.s, 2 * np.pi * modes[:, 0], modes[:, 1])
    for rate, time in itertools.product(*(ends or (_rates(model), _dead_times(model, data)))):
        rigid = 1 / (data.s**2 + rate * data.s)
        undelayed = data.response * np.exp(data.s * time)
        for weight, rows, power in zip(dictionary.weights, dictionary.rows, dictionary.powers, strict=True):
            basis, target = _real(np.vstack([rigid, kept]) * weight), _real(undelayed * weight)
            for places in _pursue(basis, (rows, power), target, count, 1 if ends is None else LAST):
                gains = _coefficients(np.vstack([basis, rows[places]]), target)
                if gains[0] > 0:
                    poles = np.concatenate([modes, dictionary.atoms[places]])
                    yield _vector(model, gains, poles, rate, time)


def _real(values: np.ndarray) -> np.ndarray:
    """Return real parts and then imaginary parts along the last axis."""
    return np.concatenate([values.real, values.imag], axis=-1)


def _rates(model: ModalModel) -> np.ndarray:
    """Return the rates k0 D [rad/s] that are tried."""
    return np.array(RATES) * model.rate_unit if model.viscous else np.zeros(1)


def _dead_times(model: ModalModel, data: LogResponse) -> np.ndarray:
    """Return the dead times [s] that are tried."""
    if model.dead_time is not None:
        return np.array([model.dead_time])
    return np.arange(-1, TURNS * STEPS + 1) / (STEPS * data.frequency[-1])


def _pursue(
    basis: np.ndarray, dictionary: tuple[np.ndarray, np.ndarray], target: np.ndarray, count: int, last: int
) -> Iterator[list[int]]:
    """Yield which `count` rows of the dictionary describe the target best with the basis; `last` last choices.

    The dictionary is its rows and their sums of squares.
    """
    places: list[int] = []
    rows, power = dictionary
    for _ in range(count - 1):
        places.append(int(np.argmax(_gain(np.vstack([basis, rows[places]]), rows, power, target))))
    if not count:
        yield places
        return
    gain = _gain(np.vstack([basis, rows[places]]), rows, power, target).reshape(len(DAMPING), -1)
    for _ in range(last):
        damping, place = np.unravel_index(np.argmax(gain), gain.shape)
        yield [*places, int(damping * gain.shape[1] + place)]
        gain[:, max(place - APART, 0) : place + APART + 1] = -1.0


def _gain(basis: np.ndarray, rows: np.ndarray, power: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return by how much each row lowers the squared error of a linear fit with the basis."""
    orthogonal, _ = np.linalg.qr(basis.T)
    left = target - orthogonal @ (orthogonal.T @ target)
    new = power - np.sum((rows @ orthogonal) ** 2, axis=1)
    usable = new > 1e-6 * power
    return np.where(usable, (rows @ left) ** 2 / np.where(usable, new, 1.0), -1.0)


def _coefficients(basis: np.ndarray, target: np.ndarray) -> np.ndarray:
    scale = np.linalg.norm(basis, axis=1)
    coefficients, *_ = np.linalg.lstsq((basis / scale[:, None]).T, target, rcond=None)
    return np.asarray(coefficients / scale)


def _vector(model: ModalModel, gains: np.ndarray, poles: np.ndarray, rate: float, time: float) -> np.ndarray:
    modes = np.column_stack([np.log(poles), gains[1:] / gains[0]])
    ends = [rate / model.rate_unit] * model.viscous + [time / model.time_unit] * (model.dead_time is None)
    return model.ordered(np.concatenate([[np.log(gains[0])], modes.ravel(), ends]))
