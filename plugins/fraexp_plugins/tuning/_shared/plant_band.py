"""All plants that a fit and its response allow: for each frequency, a disc of the plant's inverse."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Fit, FrequencyResponse
from fraexp_plugins.plants.modal import Modal

DRAWS = 400
"""Plants on the surface of the fit's 95 % ellipsoid from which the discs are found."""
DRAW_RESERVE = 1.1
"""Factor on the greatest deviation among the draws: the extreme lies between them."""
COMPLEX_95 = 2.4477
"""Radius of the 95 % region of a complex number, in standard deviations along its longest axis."""


@dataclass(frozen=True)
class PlantBand:
    """For each frequency the discs in which 1/P lies; where P may be 0, everything outside of a disc."""

    frequency: NDArray[np.float64]
    """Frequency [Hz], shape (n,)."""
    nominal: NDArray[np.complex128]
    """P̂ [m/N], shape (n,)."""
    radius: NDArray[np.float64]
    """Radius of the disc around P̂ in which all plants lie [m/N], shape (n,)."""
    centre: NDArray[np.complex128]
    """Centre of the disc of 1/P [N/m], shape (n,)."""
    inverse_radius: NDArray[np.float64]
    """Its radius [N/m], shape (n,)."""
    is_outside: NDArray[np.bool_]
    """Whether 1/P lies outside of the disc, shape (n,)."""

    def rows(self, rows: slice) -> "PlantBand":
        """Return the band at some of its frequencies."""
        return replace(self, **{name: value[rows] for name, value in vars(self).items()})


def plant_of(fit: Fit, values: NDArray[np.float64]) -> tuple[Modal, float]:
    """Return the plant with such values of the fitted parameters, and what its dead time exceeds the fit's by [s]."""
    component: dict[str, Any] = {key: value for key, value in fit.component.items() if key not in ("name", "version")}
    late = 0.0
    lists = {key: list(value) for key, value in component.items() if isinstance(value, list | tuple)}
    component |= lists
    for name, value, nominal in zip(fit.parameters, values.tolist(), fit.values.tolist(), strict=True):
        head, _, index = name.partition(".")
        if name == "dead_time":
            late = value - nominal
        elif index:
            component[head][int(index)] = value
        else:
            component[head] = value
    component["damping_ratios"] = [max(ratio, 0.0) for ratio in component.get("damping_ratios", [])]
    return Modal(**component), late


def drawn_values(fit: Fit, count: int, rng: np.random.Generator, on_surface: bool) -> NDArray[np.float64]:
    """Return values of the fitted parameters on the surface of their 95 % ellipsoid, or inside of it, shape (count, p).

    The main axes come first.
    """
    from scipy.stats import chi2

    covariance = np.nan_to_num(fit.covariance)
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    spread, axes = np.linalg.eigh(covariance / np.outer(scale, scale))
    root = scale[:, None] * axes * np.sqrt(np.maximum(spread, 0.0))
    size = len(fit.values)
    directions = rng.normal(size=(count, size))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    if on_surface:
        main = np.concatenate([np.eye(size), -np.eye(size)])[:count]
        directions[: len(main)] = main
    else:
        directions *= rng.uniform(size=(count, 1)) ** (1 / size)
    return np.asarray(fit.values + np.sqrt(chi2.ppf(0.95, max(size, 1))) * directions @ root.T)


def plant_band(
    fit: Fit, response: FrequencyResponse, frequency: NDArray[np.float64], model_error: float, is_whole: bool
) -> PlantBand:
    """Return the band of all plants that the fit's 95 % ellipsoid and `model_error` allow.

    What the response differs from the fit by, beyond its own 95 % band, is added; with `is_whole` that band as well.
    """
    omega = 2 * np.pi * frequency
    nominal = plant_of(fit, fit.values)[0].response(omega)
    drawn = []
    for values in drawn_values(fit, DRAWS, np.random.default_rng(1), True):
        plant, late = plant_of(fit, np.where(_must_be_positive(fit), np.maximum(values, 1e-3 * fit.values), values))
        drawn.append(plant.response(omega) * np.exp(-1j * omega * late))
    by_fit = DRAW_RESERVE * np.abs(np.array(drawn) - nominal).max(axis=0)
    inverse_by_fit = DRAW_RESERVE * np.abs(1 / np.array(drawn) - 1 / nominal).max(axis=0)
    by_response, inverse_by_model = _response_radii(fit, response, frequency, is_whole)
    around = by_response + model_error * np.abs(nominal)
    radius = by_fit + around
    return _smallest_discs(frequency, nominal, radius, around, inverse_by_fit, inverse_by_model)


def _must_be_positive(fit: Fit) -> NDArray[np.bool_]:
    positive = ("rigid_body_gain", "frequencies", "viscous_coefficient", "ground_stiffness")
    return np.array([name.partition(".")[0] in positive for name in fit.parameters])


def _response_radii(
    fit: Fit, response: FrequencyResponse, frequency: NDArray[np.float64], is_whole: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return how far the response is from the fit [m/N], and the friction model's band of 1/P [N/m].

    Outside of the measured frequencies nothing is known but the fit.
    """
    order = np.argsort(response.frequency)
    at = response.frequency[order]
    known = np.isfinite(response.covariance[order]).all(axis=(1, 2)) & response.settled[order]
    deviation = np.sqrt(np.linalg.eigvalsh(np.nan_to_num(response.covariance[order])).max(axis=1))
    nominal = plant_of(fit, fit.values)[0].response(2 * np.pi * at)
    late = dict(zip(fit.parameters, fit.values.tolist(), strict=True)).get("dead_time", 0.0)
    fitted = nominal * np.exp(-2j * np.pi * at * late)
    distance, band = np.abs(response.response[order] - fitted), COMPLEX_95 * deviation
    reach = (distance + band if is_whole else np.maximum(distance - band, 0.0)) / np.abs(nominal)
    inside = (frequency >= at[0]) & (frequency <= at[-1])
    usable = known if known.any() else np.ones(at.size, dtype=bool)
    scale = np.abs(plant_of(fit, fit.values)[0].response(2 * np.pi * frequency))
    relative = np.where(inside, np.interp(frequency, at[usable], reach[usable]), 0.0)
    if response.model_covariance is None:
        return relative * scale, np.zeros(frequency.size)
    model = np.sqrt(np.linalg.eigvalsh(np.nan_to_num(response.model_covariance[order])).max(axis=1))
    return relative * scale, np.where(inside, COMPLEX_95 * np.interp(frequency, at, model), 0.0)


def _smallest_discs(
    frequency: NDArray[np.float64],
    nominal: NDArray[np.complex128],
    radius: NDArray[np.float64],
    around: NDArray[np.float64],
    inverse_by_fit: NDArray[np.float64],
    inverse_by_model: NDArray[np.float64],
) -> PlantBand:
    """Return the smaller one of two discs of 1/P, both of which hold all plants.

    One is the image of the disc of P; the other has the draws' own inverses, which are small at resonances.
    """
    centre, inverse_radius, is_outside = _image(nominal, radius)
    near_centre, near_radius, near_outside = _image(nominal, around)
    direct = np.where(near_outside, np.inf, inverse_by_fit + near_radius + np.abs(near_centre - 1 / nominal))
    is_better = is_outside & np.isfinite(direct) & (direct < 1 / np.abs(nominal)) | (
        ~is_outside & (direct < inverse_radius)
    )
    centre = np.where(is_better, 1 / nominal, centre)
    inverse_radius = np.where(is_better, direct, inverse_radius)
    is_outside = is_outside & ~is_better
    inverse_radius = np.where(is_outside, inverse_radius - inverse_by_model, inverse_radius + inverse_by_model)
    return PlantBand(frequency, nominal, radius, centre, inverse_radius, is_outside)


def _image(
    centre: NDArray[np.complex128], radius: NDArray[np.float64]
) -> tuple[NDArray[np.complex128], NDArray[np.float64], NDArray[np.bool_]]:
    """Return centre and radius of the image of discs under 1/z, and whether it is the outside of that circle."""
    power = np.abs(centre) ** 2 - radius**2
    power = np.where(power == 0, np.finfo(float).tiny ** 0.5, power)
    return np.asarray(np.conj(centre) / power), radius / np.abs(power), power < 0
