"""Files as they come from machines that nobody here has seen, made by simulations of their own, with known truth."""

from dataclasses import dataclass
from math import copysign, pi, sin
from pathlib import Path

import h5py
import numpy as np
from scipy.io import savemat


@dataclass(frozen=True)
class Drive:
    """A positioning drive in a loop at 1 kHz: a mass with Coulomb, viscous and constant friction, in SI units."""

    mass: float = 4.2
    coulomb: float = 8.0
    viscous: float = 25.0
    offset: float = 1.3
    ripple: float = 0.0
    """Amplitude of a force that the motor adds along the stroke [N]."""
    pitch: float = 7e-3
    """Its wavelength [m]."""
    volt: float = 31.5
    """Thrust per volt of the control input [N/V]."""
    count: float = 0.5e-6
    """Displacement per encoder increment [m]."""
    rate: float = 1000.0

    def follow(self, reference: np.ndarray, injected: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return control input [V] and position [increments] while a PID controller follows a reference [m].

        The control input includes what is injected [N].

        Time-stepping with set-valued Coulomb friction (J. J. Moreau, 1988): 20 steps per sample, thrust held.
        """
        steps, sample_time = 20, 1 / self.rate
        h = sample_time / steps
        stiffness, damping, integral = self.mass * 90.0**2, self.mass * 2 * 0.9 * 90.0, self.mass * 90.0**3 / 12
        loss = h * self.viscous / self.mass / 2
        u, counts = np.zeros((2, reference.size))
        x = v = total = before = 0.0
        more = np.zeros(reference.size) if injected is None else injected
        for k, r in enumerate(reference.tolist()):
            seen = round(x / self.count)
            error = r - seen * self.count
            total += error * sample_time
            force = stiffness * error + damping * (error - before) / sample_time + integral * total + more[k]
            before = error
            u[k], counts[k] = force / self.volt, seen
            for _ in range(steps):
                along = self.ripple * sin(2 * pi * x / self.pitch)
                free = (v * (1 - loss) + h / self.mass * (force - self.offset - along)) / (1 + loss)
                slip = h * self.coulomb / self.mass / (1 + loss)
                before_step, v = v, copysign(max(abs(free) - slip, 0.0), free)
                x += h * (before_step + v) / 2
        return u, counts


def point_to_point(rate: float, seconds: float = 24.0) -> np.ndarray:
    """Return moves of several lengths and speeds with dwells, each a minimum-jerk curve [m]."""
    rng = np.random.default_rng(3)
    parts, here = [np.zeros(int(0.2 * rate))], 0.0
    while sum(part.size for part in parts) < seconds * rate:
        there, time = rng.uniform(-0.04, 0.04), rng.uniform(0.25, 1.2)
        s = np.linspace(0, 1, int(time * rate))
        parts += [here + (there - here) * (10 * s**3 - 15 * s**4 + 6 * s**5), np.full(int(0.15 * rate), there)]
        here = there
    return np.concatenate(parts)


def slow_noise(rate: float, seconds: float = 24.0, rms: float = 3e-3, highest: float = 30.0) -> np.ndarray:
    """Return a noise that does not repeat itself, from 0.3 Hz, falling with the frequency [m]."""
    n = int(seconds * rate)
    frequency = np.fft.rfftfreq(n, 1 / rate)
    phases = np.exp(2j * np.pi * np.random.default_rng(5).uniform(size=frequency.size))
    inside = (frequency > 0.3) & (frequency < highest)
    wave = np.fft.irfft(np.where(inside, phases / np.maximum(frequency, 1.0), 0), n)
    wave *= np.minimum(1, np.minimum(np.arange(n), np.arange(n)[::-1]) / (rate / 2))
    return wave * rms / wave.std()


@dataclass(frozen=True)
class Structure:
    """A ground-vibration test: force by a shaker, acceleration of a mode whose spring stiffens with displacement."""

    mass: float = 20.0
    stiffness: float = 20.0 * (2 * np.pi * 25.0) ** 2
    damping: float = 20.0 * 2 * 0.02 * (2 * np.pi * 25.0)
    cubic: float = 4e10
    rate: float = 512.0
    samples: int = 1024
    lines: tuple[int, ...] = tuple(range(11, 180, 2))
    levels: tuple[float, ...] = (5.0, 20.0, 60.0)
    """Rms of the force [N]."""

    def frequency(self) -> np.ndarray:
        return np.array(self.lines) * self.rate / self.samples

    def linear(self) -> np.ndarray:
        """Return acceleration over force of the structure without its cubic spring [m/s²/N]."""
        s = 2j * np.pi * self.frequency()
        return s**2 / (self.mass * s**2 + self.damping * s + self.stiffness)

    def record(self, level: float, seed: int, periods: int) -> tuple[np.ndarray, np.ndarray]:
        """Return force [N] and acceleration [m/s²] of so many settled periods, each of shape (samples periods,)."""
        fine, settling = 16, 4
        rng = np.random.default_rng(seed)
        spectrum = np.zeros(self.samples * fine // 2 + 1, dtype=complex)
        spectrum[list(self.lines)] = np.exp(2j * np.pi * rng.uniform(size=len(self.lines)))
        wave = np.fft.irfft(spectrum, self.samples * fine)
        wave *= level / wave.std()
        h = 1 / (self.rate * fine)
        x = v = 0.0
        acceleration = np.empty(wave.size * periods)
        for period in range(settling + periods):
            for k, force in enumerate(wave.tolist()):
                a = (force - self.damping * v - self.stiffness * x - self.cubic * x**3) / self.mass
                if period >= settling:
                    acceleration[(period - settling) * wave.size + k] = a
                v += h * a  # symplectic Euler: the resonance keeps its frequency and damping
                x += h * v
        noise = 2e-3 * rng.normal(size=(2, self.samples * periods))
        return np.tile(wave[::fine], periods) + noise[0], acceleration[::fine] + noise[1]

    def all_records(self, realisations: int, periods: int) -> tuple[np.ndarray, np.ndarray]:
        """Return force and acceleration, each of shape (samples, periods, realisations, levels)."""
        shape = (self.samples, periods, realisations, len(self.levels))
        both = np.empty((2, *shape))
        for place, level in enumerate(self.levels):
            for number in range(realisations):
                for values, target in zip(self.record(level, 10 * place + number, periods), both, strict=True):
                    target[:, :, number, place] = values.reshape(self.samples, periods, order="F")
        return both[0], both[1]


def write_hdf5(path: Path, variables: dict[str, np.ndarray]) -> None:
    """Write arrays as MATLAB 7.3 does: transposed, behind a header of its own."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in variables.items():
            dataset = file.create_dataset(name, data=np.asarray(values).T)
            dataset.attrs["MATLAB_class"] = np.bytes_(b"double")
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file")


def write_classic(path: Path, variables: dict[str, object]) -> None:
    """Write arrays and structs as MATLAB 5 does."""
    savemat(path, variables)
