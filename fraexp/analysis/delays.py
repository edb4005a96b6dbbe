"""The delays around the plant at each frequency, exactly: dead time, first-order lags, hold and sampling."""

import numpy as np

IMAGES = 50
"""Sampling images on either side that are summed; they fall off with the third power of their number."""


def path_response(omega: np.ndarray, dead_time: float, lags: tuple[float, ...]) -> np.ndarray:
    """Return e^{-jωL} Π 1/(1 + jωτ) at ω [rad/s], shape of `omega`, for a dead time L [s] and lags τ [s]."""
    result = np.exp(-1j * omega * dead_time)
    for lag in lags:
        result = result / (1 + 1j * omega * lag)
    return result


def hold_response(omega: np.ndarray, sample_time: float | np.ndarray) -> np.ndarray:
    """Return the zero-order hold (1 - e^{-jωTs})/(jωTs) at ω [rad/s]: a gain sinc(fTs) and a delay of Ts/2.

    The sample time [s] is one number, or one for each ω.
    """
    half = omega * sample_time / 2
    return np.exp(-1j * half) * np.sinc(half / np.pi)


def image_factor(
    omega: np.ndarray, sample_time: float | np.ndarray, dead_time: float, lags: tuple[float, ...], roll_off: int
) -> np.ndarray:
    """Return what a sampled response to a held input has more than the continuous one, as a factor near 1.

    The hold's images at ω + kωs pass the plant too and fold back on ω when the output is sampled. They lie far
    above the modes, where a plant of relative degree `roll_off` falls as ω^-roll_off; for a pure integrator chain
    the factor is exact.
    """
    k = np.concatenate([np.arange(-IMAGES, 0), np.arange(1, IMAGES + 1)])
    spacing = k * (2 * np.pi / np.asarray(sample_time)[..., None])
    image = omega[..., None] + spacing
    ratio = (omega[..., None] / image) ** (roll_off + 1)  # the hold's numerator is the same at every image
    path = path_response(spacing, dead_time, ())
    if lags:
        path = path * path_response(image, 0.0, lags) / path_response(omega, 0.0, lags)[..., None]
    return 1 + np.sum(ratio * path, axis=-1)
