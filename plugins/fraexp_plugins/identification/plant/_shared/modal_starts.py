"""Start values of a modal fit from the response: orthogonal matching pursuit of the modes."""

import itertools
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fraexp_plugins.identification.plant._shared.log_response import LogResponse
from fraexp_plugins.identification.plant._shared.modal_model import ModalModel, resonators

TRIAL_DAMPING_RATIOS = (0.01, 0.03, 0.1)
TRIAL_FREQUENCY_COUNT = 250
FREQUENCY_RANGE_FACTOR = 1.25
"""Highest natural frequency that is tried, over the upper limit of the frequency range."""
MAX_DELAY_TURNS, STEPS_PER_TURN = 2.0, 8
"""Largest dead time that is tried, in turns of the phase at the upper frequency limit, and steps for each turn."""
TRIAL_RATES = (0.1, 1.0, 6.0)
"""Rates k0 D of the viscous rigid body that are tried, over ω_l."""
LAST_MODE_CHOICES, CHOICE_DISTANCE = 3, 6
"""Choices of the last mode that are tried if the other modes are given, and their distance in steps of f."""
WEIGHT_EXPONENTS = (1.0, 0.5)
"""Exponents x of the weights |Ĝ|^-x: the first favours the anti-resonances, the second the resonances."""


class ModeDictionary:
    """Trial modes of a response, as rows of a linear least-squares problem for each weight."""

    def __init__(self, data: LogResponse) -> None:
        self.data = data
        grid = np.geomspace(data.frequency[0], FREQUENCY_RANGE_FACTOR * data.frequency[-1], TRIAL_FREQUENCY_COUNT)
        self.atoms = np.array([(f, z) for z in TRIAL_DAMPING_RATIOS for f in grid])
        """Pairs (f [Hz], ζ), shape (m, 2)."""
        modes = resonators(data.s, 2 * np.pi * self.atoms[:, 0], self.atoms[:, 1])
        self.weights: list[NDArray[np.float64]] = [np.abs(data.response) ** -exponent for exponent in WEIGHT_EXPONENTS]
        self.rows = [_real(modes * weight) for weight in self.weights]
        self.powers = [np.sum(rows**2, axis=1) for rows in self.rows]


def start_vectors(
    model: ModalModel,
    dictionary: ModeDictionary,
    modes: NDArray[np.float64],
    ends: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None,
) -> Iterator[NDArray[np.float64]]:
    """Yield start vectors p; they keep `modes`, pairs (f [Hz], ζ), shape (m, 2), not more than model.modes.

    `ends` are the rates k0 D [rad/s] and the dead times [s] to try, by default a grid.

    For given poles and dead time the response is linear in k0 and k0 r_i. For each dead time and weight the mode that
    reduces the squared error of that linear fit most is added, until there are enough (orthogonal matching pursuit:
    Y. C. Pati, R. Rezaiifar and P. S. Krishnaprasad, Asilomar Conf. 1993, doi 10.1109/ACSSC.1993.342465).
    """
    data, count = dictionary.data, model.modes - len(modes)
    kept = resonators(data.s, 2 * np.pi * modes[:, 0], modes[:, 1])
    rates, times = ends or (_rates(model), _dead_times(model, data))
    for rate, time in itertools.product(rates.tolist(), times.tolist()):
        rigid = 1 / (data.s**2 + rate * data.s)
        advance: NDArray[np.complex128] = np.exp(data.s * time)
        undelayed = data.response * advance
        for weight, rows, power in zip(dictionary.weights, dictionary.rows, dictionary.powers, strict=True):
            rigid_and_modes: NDArray[np.complex128] = np.vstack([rigid, kept])
            basis, target = _real(rigid_and_modes * weight), _real(undelayed * weight)
            for places in _pursue(basis, (rows, power), target, count, 1 if ends is None else LAST_MODE_CHOICES):
                gains = _coefficients(np.vstack([basis, rows[places]]), target)
                if gains[0] > 0:
                    poles = np.concatenate([modes, dictionary.atoms[places]])
                    yield _vector(model, gains, poles, rate, time)


def _real(values: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return real parts and then imaginary parts along the last axis."""
    return np.concatenate([values.real, values.imag], axis=-1)


def _rates(model: ModalModel) -> NDArray[np.float64]:
    """Return the rates k0 D [rad/s] to try."""
    return np.array(TRIAL_RATES) * model.rate_unit if model.fit_viscous else np.zeros(1)


def _dead_times(model: ModalModel, data: LogResponse) -> NDArray[np.float64]:
    """Return the dead times [s] to try."""
    if model.dead_time is not None:
        return np.array([model.dead_time])
    return np.arange(-1, MAX_DELAY_TURNS * STEPS_PER_TURN + 1) / (STEPS_PER_TURN * data.frequency[-1])


def _pursue(
    basis: NDArray[np.float64],
    dictionary: tuple[NDArray[np.float64], NDArray[np.float64]],
    target: NDArray[np.float64],
    count: int,
    last: int,
) -> Iterator[list[int]]:
    """Yield the `count` rows of the dictionary that describe the target best, with `last` choices of the last row.

    The basis is always in the fit. The dictionary is its rows and their sums of squares.
    """
    places: list[int] = []
    rows, power = dictionary
    for _ in range(count - 1):
        places.append(int(np.argmax(_error_reduction(np.vstack([basis, rows[places]]), rows, power, target))))
    if not count:
        yield places
        return
    gain = _error_reduction(np.vstack([basis, rows[places]]), rows, power, target).reshape(
        len(TRIAL_DAMPING_RATIOS), -1
    )
    for _ in range(last):
        damping, place = np.unravel_index(np.argmax(gain), gain.shape)
        yield [*places, int(damping * gain.shape[1] + place)]
        gain[:, max(place - CHOICE_DISTANCE, 0) : place + CHOICE_DISTANCE + 1] = -1.0


def _error_reduction(
    basis: NDArray[np.float64], rows: NDArray[np.float64], power: NDArray[np.float64], target: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return how much each row reduces the squared error of a linear fit with the basis, shape (rows,)."""
    orthogonal, _ = np.linalg.qr(basis.T)
    residual = target - orthogonal @ (orthogonal.T @ target)
    new = power - np.sum((rows @ orthogonal) ** 2, axis=1)
    usable = new > 1e-6 * power
    return np.where(usable, (rows @ residual) ** 2 / np.where(usable, new, 1.0), -1.0)


def _coefficients(basis: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    scale = np.linalg.norm(basis, axis=1)
    coefficients, *_ = np.linalg.lstsq((basis / scale[:, None]).T, target, rcond=None)
    return np.asarray(coefficients / scale)


def _vector(
    model: ModalModel, gains: NDArray[np.float64], poles: NDArray[np.float64], rate: float, time: float
) -> NDArray[np.float64]:
    modes = np.column_stack([np.log(poles), gains[1:] / gains[0]])
    ends = [rate / model.rate_unit] * model.fit_viscous + [time / model.time_unit] * (model.dead_time is None)
    return model.sort_modes(np.concatenate([[np.log(gains[0])], modes.ravel(), ends]))
