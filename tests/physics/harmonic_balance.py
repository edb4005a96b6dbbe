"""Harmonic balance of a linear system with elasto-slide elements: shares no code and no idea with the simulation.

The displacements of all contacts are sums of odd harmonics Y_k e^{jkωt}. In the frequency domain Z_k Y_k + F_k = T_k,
where Z_k is the dynamic stiffness and F_k comes from the elements' force along one period in time (alternating
frequency/time: T. M. Cameron and J. H. Griffin, J. Applied Mechanics 56, 1989). Newton's method solves it with the
exact Jacobian: a sticking element follows the displacement since the instant at which it last slipped, a slipping one
does not.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix


class Elements(NamedTuple):
    """Parallel elasto-slide elements."""

    stiffness: NDArray[np.float64]
    """K_i [N/m], shape (N,)."""
    width: NDArray[np.float64]
    """Deflection at which each slips [m], shape (N,)."""


class Force(NamedTuple):
    """The elements' force along one period."""

    force: NDArray[np.float64]
    """Force [N], shape (points,)."""
    anchors: NDArray[np.int64]
    """Instant at which each element last slipped, or `points` if it never does, shape (points, N)."""


def solve(
    dynamic_stiffness: NDArray[np.complex128], thrust: complex, elements: Elements, points: int = 2048
) -> NDArray[np.complex128]:
    """Return Y_k [m] of the odd harmonics 1, 3, 5…, shape (n,).

    `dynamic_stiffness` is Z_k [N/m], shape (n,); `thrust` is T_1 [N], the others are zero.
    """
    compliance = 1 / dynamic_stiffness
    free = np.append(thrust * compliance[:1], np.zeros(compliance.size - 1))
    return solve_contacts(compliance[:, None, None], free[:, None], [elements], points)[:, 0]


def solve_contacts(
    compliance: NDArray[np.complex128], free: NDArray[np.complex128], contacts: Sequence[Elements], points: int = 2048
) -> NDArray[np.complex128]:
    """Return Y_k [m] of the odd harmonics 1, 3, 5… at c contacts, shape (n, c).

    `compliance` is G_k [m/N] from the contacts' forces to their displacements, shape (n, c, c); `free` are the
    displacements without friction [m], shape (n, c). Y_k + G_k F_k = free_k is solved.
    """
    n, c = free.shape
    order = 2 * np.arange(n) + 1
    angle = 2 * np.pi * np.outer(np.arange(points) / points, order)
    basis = np.hstack([np.cos(angle), -np.sin(angle)])  # y(t) = basis @ (real parts, imaginary parts)
    anchored = np.vstack([basis, np.zeros(2 * n)])  # what has never slipped moves from zero

    def harmonics(values: NDArray[np.float64]) -> NDArray[np.float64]:
        phasors = np.fft.rfft(values, axis=0)[order] * 2 / points
        return np.concatenate([phasors.real, phasors.imag])

    def moved_by(forces: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return G F of real and imaginary parts at each contact, shape (c, 2 n, columns)."""
        force = forces[:, :n] + 1j * forces[:, n:]
        moved = np.einsum("kij,jkm->ikm", compliance, force)
        return np.concatenate([moved.real, moved.imag], axis=1)

    start = np.concatenate([free.real, free.imag]).T  # (c, 2 n)

    def residual(y: NDArray[np.float64]) -> tuple[NDArray[np.float64], list[Force]]:
        found = [periodic_force(basis @ y[i], contacts[i]) for i in range(c)]
        forces = np.stack([harmonics(each.force) for each in found])
        return y + moved_by(forces[:, :, None])[:, :, 0] - start, found

    def derivative(found: Force, elements: Elements) -> NDArray[np.float64]:
        """Return the derivative of F by Y at one contact, shape (2 n, 2 n)."""
        rows = np.repeat(np.arange(points), elements.stiffness.size)
        entries = (np.tile(elements.stiffness, points), (rows, found.anchors.ravel()))
        return elements.stiffness.sum() * np.eye(2 * n) - harmonics(
            csr_matrix(entries, shape=(points, points + 1)) @ anchored
        )

    def jacobian(found: list[Force]) -> NDArray[np.float64]:
        columns = []
        for j in range(c):
            forces = np.zeros((c, 2 * n, 2 * n))
            forces[j] = derivative(found[j], contacts[j])
            columns.append(moved_by(forces).reshape(c * 2 * n, 2 * n))
        return np.eye(c * 2 * n) + np.hstack(columns)

    stiffness = np.diag([elements.stiffness.sum() for elements in contacts])
    stuck = np.linalg.solve(np.eye(c) + compliance @ stiffness, free[:, :, None])[:, :, 0]
    y = np.concatenate([stuck.real, stuck.imag]).T
    error, found = residual(y)
    for _ in range(100):
        if np.linalg.norm(error) < 1e-11 * np.linalg.norm(start):
            return (y[:, :n] + 1j * y[:, n:]).T
        step, share = np.linalg.solve(jacobian(found), error.ravel()).reshape(c, -1), 1.0
        trial, trial_found = residual(y - step)
        while np.linalg.norm(trial) > np.linalg.norm(error) and share > 1e-3:
            share /= 2
            trial, trial_found = residual(y - share * step)
        y, error, found = y - share * step, trial, trial_found
    raise AssertionError(f"harmonic balance did not converge: {np.linalg.norm(error) / np.linalg.norm(start):.1e}")


def periodic_force(y: NDArray[np.float64], elements: Elements) -> Force:
    """Return the force along one period of a displacement [m], shape (points,): branch by branch between its turns."""
    points, count = y.size, elements.width.size
    rises = np.roll(y, -1) > y
    turns = np.flatnonzero(rises != np.roll(rises, 1))
    deflection, anchor = np.zeros(count), np.full(count, points)
    deflections, anchors = np.zeros((points, count)), np.full((points, count), points)
    for begin, end in 2 * list(zip(turns, np.append(turns[1:], turns[0] + points), strict=True)):
        times = np.arange(begin + 1, end + 1) % points
        free = deflection + (y[times] - y[begin])[:, None]
        deflections[times] = np.clip(free, -elements.width, elements.width)
        anchors[times] = np.where(free == deflections[times], anchor, times[:, None])
        deflection, anchor = deflections[times[-1]], anchors[times[-1]]
    return Force(deflections @ elements.stiffness, anchors)
