"""Plants of rigid bodies that springs and dampers couple: M q̈ + D q̇ + K q = Σ v·force."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Plant, Ports, StateSpace


class Bodies(NamedTuple):
    """Bodies with k coordinates q, and where forces act on them and positions are measured.

    A port is a vector v of shape (k,): its force acts as v·force, and its displacement is vᵀq.
    """

    mass: NDArray[np.float64]
    """M, shape (k, k)."""
    damping: NDArray[np.float64]
    """D, shape (k, k)."""
    stiffness: NDArray[np.float64]
    """K, shape (k, k)."""
    thrusts: Mapping[str, NDArray[np.float64]]
    contacts: Mapping[str, NDArray[np.float64]]
    positions: Mapping[str, NDArray[np.float64]]


class CoupledBodies(Plant, ABC):
    """A plant of coupled bodies; P is the response of the first position to the first thrust."""

    @property
    @abstractmethod
    def bodies(self) -> Bodies:
        """The bodies with their ports."""

    def ports(self) -> Ports:
        """Return the ports of the bodies."""
        mass, damping, stiffness, thrusts, contacts, positions = self.bodies
        return Ports.from_matrices(mass, damping, stiffness, thrusts=thrusts, contacts=contacts, positions=positions)

    def state_space(self) -> StateSpace:
        """Return P(s) with the coordinates and their velocities as states."""
        ports = self.ports()
        return StateSpace(ports.a, ports.drive, ports.measured[0])

    def response(self, omega: NDArray[np.floating]) -> NDArray[np.complex128]:
        """Return P(jω) by the dynamic stiffness K + jωD - ω²M."""
        bodies, s = self.bodies, 1j * np.asarray(omega, dtype=float)[:, None, None]
        dynamic = bodies.mass * s**2 + bodies.damping * s + bodies.stiffness
        force = next(iter(bodies.thrusts.values())).astype(complex)
        moved = np.linalg.solve(dynamic, np.broadcast_to(force[:, None], (len(dynamic), force.size, 1)))[..., 0]
        return np.asarray(moved @ next(iter(bodies.positions.values())))


def spring(first: NDArray[np.float64], second: NDArray[np.float64], value: float) -> NDArray[np.float64]:
    """Return the matrix of a spring or damper between two coordinates, shape (k, k)."""
    between = first - second
    return value * np.outer(between, between)
