"""Responses of eq (1) with noise, and what is asked of the fits to them."""

import tomllib

import numpy as np
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.identification.modal_fit import ModalFit
from fraexp_plugins.plants.modal import Modal

from fraexp.study.study_file import packaged_studies
from tests.responses import frequency_response

MACHINE = tomllib.loads((packaged_studies() / "machines" / "linear_motor_table.toml").read_text(encoding="utf-8"))
SCALE = {"resolution": 0.1e-6, "noise": 30e-9}
TWO = Modal(
    rigid_body_gain=0.132, frequencies=(38.8, 81.2), damping_ratios=(0.03, 0.012), modal_gain_ratios=(0.342, 0.3)
)
DEAD_TIME = 1.25e-3
FREQUENCY = np.geomspace(1.0, 200.0, 200)
PLANTS = {
    "rigid body": Modal(rigid_body_gain=2.0),
    "one mode": Modal(rigid_body_gain=0.132, frequencies=(38.8,), damping_ratios=(0.04,), modal_gain_ratios=(0.342,)),
    "two modes": TWO,
    "close modes": Modal(
        rigid_body_gain=0.132, frequencies=(60.0, 62.0), damping_ratios=(0.02, 0.02), modal_gain_ratios=(0.3, 0.3)
    ),
    "modes that overlap": Modal(
        rigid_body_gain=1.1,
        frequencies=(25.2, 60.5, 69.6),
        damping_ratios=(0.011, 0.056, 0.056),
        modal_gain_ratios=(0.39, 0.35, 0.29),
    ),
    "a mode out of phase": Modal(
        rigid_body_gain=0.02,
        frequencies=(11.3, 22.3, 45.0, 110.0),
        damping_ratios=(0.01, 0.02, 0.03, 0.02),
        modal_gain_ratios=(0.5, -0.3, 0.4, 0.3),
    ),
    "six modes": Modal(
        rigid_body_gain=0.5,
        frequencies=(8.0, 15.0, 27.0, 48.0, 85.0, 150.0),
        damping_ratios=(0.02, 0.01, 0.03, 0.02, 0.01, 0.02),
        modal_gain_ratios=(0.4, 0.3, 0.5, -0.3, 0.4, 0.6),
    ),
}


def measured(plant=TWO, *, noise=0.01, known=False, dead_time=DEAD_TIME, frequency=FREQUENCY, seed=1):
    """Return a response with complex noise whose root mean square is `noise` of it."""
    omega = 2 * np.pi * frequency
    n = frequency.size
    truth = plant.response(omega) * np.exp(-1j * omega * dead_time)
    generator = np.random.default_rng(seed)
    error = (generator.standard_normal(n) + 1j * generator.standard_normal(n)) / np.sqrt(2)
    covariance = np.full((n, 2, 2), np.nan)
    if known:
        covariance = (noise * np.abs(truth))[:, None, None] ** 2 / 2 * np.eye(2)
    unknown = np.full(n, np.nan)
    return frequency_response(
        frequency,
        truth * (1 + noise * error),
        covariance=covariance,
        output_amplitude=np.abs(truth),
        settling_time=unknown,
        residual=unknown,
        harmonics=np.full((n, 6), np.nan),
    )


def fitted(response, **given):
    return ModalFit(method=Conventional(), **given).fit_response(response)


def values(result):
    """Return the values of the fit by name, and their standard deviations."""
    (fit,) = result.fits
    return dict(zip(fit.parameters, fit.values, strict=True)), dict(
        zip(fit.parameters, fit.standard_deviation, strict=True)
    )


def metric(result, name):
    return next(each.value for each in result.metrics if each.name == name)


def worst(result, plant, dead_time=DEAD_TIME):
    """Return the greatest relative error of the fitted plant with its dead time against the true one."""
    omega = 2 * np.pi * FREQUENCY
    found = Modal.parse({k: v for k, v in result.fits[0].component.items() if k not in ("name", "version")}, "modal")
    late = values(result)[0]["dead_time"] - dead_time
    return float(np.max(np.abs(found.response(omega) / plant.response(omega) * np.exp(-1j * omega * late) - 1)))
