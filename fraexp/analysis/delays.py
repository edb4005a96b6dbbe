"""The delays around the plant at each frequency, exactly: dead time, first-order lags, hold and sampling."""

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.array_cache import cached_arrays

IMAGES_PER_SIDE = 50
"""Aliasing images of the hold that are summed on either side; they fall off with the third power of their number."""

MAX_FACTORS_BYTES = 1 << 23
"""Memory of all image factors that are cached: 40 bytes a frequency."""


def path_response(omega: NDArray[np.floating], dead_time: float, lags: tuple[float, ...]) -> NDArray[np.complex128]:
    """Return e^{-jωL} Π 1/(1 + jωτ) at ω [rad/s], shape of `omega`, for a dead time L [s] and lags τ [s]."""
    result = np.exp(-1j * omega * dead_time)
    for lag in lags:
        result = result / (1 + 1j * omega * lag)
    return result


def hold_response(omega: NDArray[np.floating], sample_time: float | NDArray[np.floating]) -> NDArray[np.complex128]:
    """Return the zero-order hold (1 - e^{-jωTs})/(jωTs) at ω [rad/s]: a gain sinc(fTs) and a delay of Ts/2.

    The sample time [s] is one number, or one for each ω.
    """
    half = omega * sample_time / 2
    return np.exp(-1j * half) * np.sinc(half / np.pi)


def image_factor(
    omega: NDArray[np.floating],
    sample_time: float | NDArray[np.floating],
    dead_time: float,
    lags: tuple[float, ...],
    relative_degree: int,
) -> NDArray[np.complex128]:
    """Return the ratio of a sampled response to a held input and the continuous response: a factor near 1.

    The hold's aliasing images at ω + kωs pass the plant too, and fold back on ω when the output is sampled. They lie
    far above the modes, where a plant of relative degree r falls as ω^-r; for a pure integrator chain the factor is
    exact.
    """
    shape = np.shape(omega)
    times = np.broadcast_to(np.asarray(sample_time, dtype=float), shape)
    omegas = np.asarray(omega, dtype=float).tobytes()
    return _image_factor(omegas, times.tobytes(), dead_time, tuple(lags), relative_degree).reshape(shape)


@cached_arrays(MAX_FACTORS_BYTES)
def _image_factor(
    omegas: bytes, sample_times: bytes, dead_time: float, lags: tuple[float, ...], relative_degree: int
) -> NDArray[np.complex128]:
    """Return the factor from numbers as bytes, which are hashable: estimators and sweeps share frequencies."""
    omega, sample_time = np.frombuffer(omegas), np.frombuffer(sample_times)
    if omega.nbytes * IMAGES_PER_SIDE > MAX_FACTORS_BYTES:  # one half after the other: all images take more memory
        halves = zip(np.array_split(omega, 2), np.array_split(sample_time, 2), strict=True)
        args = (dead_time, lags, relative_degree)
        return np.concatenate([_image_factor(a.tobytes(), b.tobytes(), *args) for a, b in halves])
    k = np.concatenate([np.arange(-IMAGES_PER_SIDE, 0), np.arange(1, IMAGES_PER_SIDE + 1)])
    spacing = k * (2 * np.pi / sample_time[..., None])
    image = omega[..., None] + spacing
    ratio = (omega[..., None] / image) ** (relative_degree + 1)  # the hold's numerator is the same at every image
    path = path_response(spacing, dead_time, ())
    if lags:
        path = path * path_response(image, 0.0, lags) / path_response(omega, 0.0, lags)[..., None]
    return np.asarray(1 + np.sum(ratio * path, axis=-1))
