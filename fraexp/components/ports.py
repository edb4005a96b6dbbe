"""A linear machine between its ports: thrusts and friction forces go in, positions and displacements come out."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fraexp.errors import ParameterError, did_you_mean

RELATIVE_ZERO = 1e-9
"""Product of a row and a column that counts as zero, relative to their norms."""


@dataclass(frozen=True)
class StateSpace:
    """A linear single-input single-output system ẋ = A x + b u, y = c x."""

    a: NDArray[np.float64]
    """A, shape (n, n)."""
    b: NDArray[np.float64]
    """b, shape (n,)."""
    c: NDArray[np.float64]
    """c, shape (n,)."""


@dataclass(frozen=True)
class Contact:
    """Where friction acts: on a body against the ground, or between two bodies."""

    force: NDArray[np.float64]
    """Column by which a force along the displacement enters the state, shape (n,); friction acts against it."""
    displacement: NDArray[np.float64]
    """Row that gives the displacement from the state, shape (n,)."""


@dataclass(frozen=True)
class Ports:
    """A linear machine ẋ = A x + Σ b u - Σ e f with positions y = c x and contacts' displacements d x, each by name."""

    a: NDArray[np.float64]
    """A, shape (n, n)."""
    thrusts: Mapping[str, NDArray[np.float64]]
    """Column b of each thrust, shape (n,)."""
    contacts: Mapping[str, Contact]
    """Column e and row d of each contact."""
    positions: Mapping[str, NDArray[np.float64]]
    """Row c of each measured position, shape (n,)."""

    @classmethod
    def from_state_space(cls, model: StateSpace) -> "Ports":
        """Return the ports of a machine with one thrust, whose friction acts where the position is measured."""
        return cls(model.a, {"thrust": model.b}, {"table": Contact(model.b, model.c)}, {"table": model.c})

    @classmethod
    def from_matrices(
        cls,
        mass: NDArray[np.float64],
        damping: NDArray[np.float64],
        stiffness: NDArray[np.float64],
        *,
        thrusts: Mapping[str, NDArray[np.float64]],
        contacts: Mapping[str, NDArray[np.float64]],
        positions: Mapping[str, NDArray[np.float64]],
    ) -> "Ports":
        """Return the ports of M q̈ + D q̇ + K q = forces, matrices of shape (k, k); the state is (q, q̇).

        Each port is a vector v of shape (k,): a thrust or the force of a contact acts as v·force, and a position or the
        displacement of a contact is vᵀq.
        """
        k = mass.shape[0]
        inverse, zero = np.linalg.inv(mass), np.zeros(k)
        a = np.block([[np.zeros((k, k)), np.eye(k)], [-inverse @ stiffness, -inverse @ damping]])

        def column(port: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.concatenate([zero, inverse @ port])

        def row(port: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.concatenate([port, zero])

        return cls(
            a,
            {name: column(port) for name, port in thrusts.items()},
            {name: Contact(column(port), row(port)) for name, port in contacts.items()},
            {name: row(port) for name, port in positions.items()},
        )

    def check(self) -> None:
        """Raise ParameterError for a port of the wrong shape, or a displacement that jumps in velocity with a force."""
        n = self.a.shape[0]
        columns = {f"thrust '{name}'": column for name, column in self.thrusts.items()}
        columns |= {f"force of contact '{name}'": contact.force for name, contact in self.contacts.items()}
        rows = {f"position '{name}'": row for name, row in self.positions.items()}
        rows |= {f"displacement of contact '{name}'": contact.displacement for name, contact in self.contacts.items()}
        if self.a.shape != (n, n):
            raise ParameterError(f"the plant has a state matrix of shape {self.a.shape}; expected a square one")
        for what, numbers in {**columns, **rows}.items():
            if numbers.shape != (n,):
                raise ParameterError(f"the plant's {what} has shape {numbers.shape}; expected ({n},), as the state")
        for what, row in rows.items():
            for force, column in columns.items():
                if abs(row @ column) > RELATIVE_ZERO * np.linalg.norm(row) * np.linalg.norm(column):
                    found = f"the plant's {what} jumps in velocity with the {force}"
                    raise ParameterError(f"{found}; expected a relative degree of 2 or more")

    def closed_by(self, thrust: str, position: str, controlled: Iterable[str] = ()) -> "Ports":
        """Return the ports with the thrust that is excited, and the position that is fed back to it, before the others.

        Without a name it is the first thrust, and the position that is called like the thrust, or else the first.
        Further thrusts that are `controlled` follow, each with the position of its own name in the same place. Raises
        ParameterError for a name that the plant does not have, and a position that would be fed back to two thrusts.
        """
        thrusts = _with_first(self.thrusts, thrust, "thrust")
        drive = next(iter(thrusts))
        positions = _with_first(self.positions, position or (drive if drive in self.positions else ""), "position")
        further = [name for name in controlled if name != drive]
        fed_back = [next(iter(positions)), *further]
        for name in further:
            for kind, known in (("thrust", thrusts), ("position", positions)):
                if name not in known:
                    raise ParameterError(
                        f"[controller.{name}]: the plant has no {kind} '{name}'{did_you_mean(name, known)}"
                    )
            if name == fed_back[0]:
                raise ParameterError(
                    f"[controller.{name}] feeds back the position '{name}', as [controller.{drive}] does; expected one "
                    "for each: set [loop] position to another one, or leave it out"
                )
        return replace(self, thrusts=_in_order(thrusts, [drive, *further]), positions=_in_order(positions, fed_back))

    @property
    def drive(self) -> NDArray[np.float64]:
        """Column of the first thrust, shape (n,)."""
        return next(iter(self.thrusts.values()))

    @property
    def measured(self) -> NDArray[np.float64]:
        """Rows of all positions, shape (positions, n)."""
        return np.array(list(self.positions.values()))

    def response(self, omega: NDArray[np.floating], position: str = "") -> NDArray[np.complex128]:
        """Return the response [m/N] to the first thrust of a position, or of the first one, without friction.

        `omega` [rad/s] and the response have the shape (n,).
        """
        row = self.positions[position] if position else self.measured[0]
        return self.transfer(self.drive, row, omega)

    def share(
        self, force: NDArray[np.float64], omega: NDArray[np.floating], position: str
    ) -> NDArray[np.complex128] | float:
        """Return the first thrust that moves a position as a unit force does that enters by a column, at omega [rad/s].

        It is 1 for a force at the thrust itself.
        """
        if np.array_equal(force, self.drive):
            return 1.0
        row = self.positions[position]
        return self.transfer(force, row, omega) / self.transfer(self.drive, row, omega)

    def transfer(
        self, column: NDArray[np.float64], row: NDArray[np.float64], omega: NDArray[np.floating]
    ) -> NDArray[np.complex128]:
        """Return the response of what a row gives to what enters by a column, at omega [rad/s], shape (n,)."""
        shifted = 1j * np.asarray(omega, dtype=float)[:, None, None] * np.eye(self.a.shape[0]) - self.a
        columns = np.broadcast_to(column[:, None], (*shifted.shape[:2], 1))
        return np.asarray(np.linalg.solve(shifted, columns)[..., 0] @ row)


def _with_first(ports: Mapping[str, NDArray[np.float64]], name: str, kind: str) -> Mapping[str, NDArray[np.float64]]:
    if name and name not in ports:
        raise ParameterError(f"the plant has no {kind} '{name}'{did_you_mean(name, ports)}")
    return _in_order(ports, [name]) if name else ports


def _in_order(ports: Mapping[str, NDArray[np.float64]], first: Iterable[str]) -> Mapping[str, NDArray[np.float64]]:
    return {**{name: ports[name] for name in first}, **ports}
