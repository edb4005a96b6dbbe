"""Measure how the cost of a loop grows with the number of contacts at which friction acts.

    python benchmarks/contacts.py             medians of 15 turns
    python benchmarks/contacts.py --reduced   of 5

One to four contacts share the friction of the paper's table: ten elasto-slide elements at each, or dry friction.
Nanoseconds per step of one experiment of a sweep, all Python included. Elements run in lanes, where the forces are
predicted, and one by one, where they are solved together implicitly. Dry friction sticks and slips within the step, one
by one; at one contact it runs in lanes as well. Experiments with different numbers of contacts take turns.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from fraexp_plugins.friction.coulomb import Coulomb
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.plants.modal import Modal
from harness import Bench, in_turns, run
from kernel import machine, sweep
from paper_machine import PAPER, PLANT, REGISTRY

from fraexp.components.kinds import Excitation, FrictionModel
from fraexp.components.ports import Ports
from fraexp.components.registry import create
from fraexp.simulation.experiment_run import run_experiments
from fraexp.simulation.experiments import Experiment, Setup
from fraexp.simulation.loop_setup import prepare_setup

MAX_CONTACTS = 4
ELEMENTS, STEPS = 10, 5
POINTS = 64
"""Frequencies of the sweep."""


class SharedTable(Modal, name="shared_table", version=1):
    """The paper's table with several contacts at the same place."""

    def ports(self) -> Ports:
        """Return the table's ports with a contact for each share of its friction."""
        ports = super().ports()
        (contact,) = ports.contacts.values()
        return Ports(ports.a, ports.thrusts, {f"contact_{k}": contact for k in range(self.count)}, ports.positions)

    count: int = 1


def shares(count: int, is_dry: bool) -> dict[str, FrictionModel]:
    """Return the table's friction as equal laws at so many contacts."""
    if is_dry:
        dry = Coulomb(coulomb_force=18.0 / count, viscous_coefficient=4.69 / count)
        return {f"contact_{k}": dry for k in range(count)}
    knots = np.geomspace(1e-6, 1e-3, ELEMENTS)
    force = 18.0 * np.diff(1 - np.exp(-knots / 1e-4), prepend=0.0) / count
    law = Rolling(stiffness=tuple(force / knots), limit_force=tuple(force), viscous_coefficient=4.69 / count)
    return {f"contact_{k}": law for k in range(count)}


def setup_of(count: int, is_vectorised: bool, is_dry: bool) -> Setup:
    """Return the table with so many contacts, made ready."""
    plant = SharedTable(**PLANT.model_dump(), count=count)
    made = replace(
        machine(Rolling(stiffness=(1.0,), limit_force=(1.0,)), STEPS), plant=plant, friction=shares(count, is_dry)
    )
    return replace(prepare_setup(made), is_vectorised=is_vectorised)


def sweep_of(setup: Setup) -> tuple[Callable[[], object], float]:
    """Return what runs a sweep, and the number of its steps."""
    excitation = create(REGISTRY, Excitation, sweep(POINTS))
    periods = excitation.periods(PAPER["loop"]["sample_time"])
    experiments = [Experiment(setup, period, excitation.schedule, n) for n, period in enumerate(periods)]
    segments = run_experiments(experiments, lambda _: None)
    if not all(segments):
        raise SystemExit(f"{setup.numerics}: a loop diverged")
    samples = sum(
        segment.settling.time / setup.sample_time + segment.channels["y"].size
        for segment in segments
        if segment and segment.settling
    )
    return lambda: run_experiments(experiments, lambda _: None), samples * setup.steps


def contacts(bench: Bench) -> None:
    """Cost [ns] per step with ten elements or dry friction at each contact, and over that of one contact."""
    counts, turns = range(1, MAX_CONTACTS + 1), bench.options.turns
    for kind, is_vectorised, is_dry in (
        ("lanes", True, False),
        ("one by one", False, False),
        ("dry, one by one", False, True),
    ):
        made = [sweep_of(setup_of(count, is_vectorised, is_dry)) for count in counts]
        times = np.median(in_turns(*(action for action, _ in made), turns=turns), axis=1)
        costs = 1e9 * times / [steps for _, steps in made]
        for count, cost in zip(counts, costs, strict=True):
            bench.row(f"{kind}, {count} contacts", f"{cost:7.1f} ns {cost / costs[0]:5.2f} times", ns=float(cost))


if __name__ == "__main__":
    run(__doc__, contacts, turns=(15, 5))
