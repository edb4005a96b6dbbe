"""Friction at several contacts: against harmonic balance, an independent simulation, the sum of laws, by both paths."""

import numpy as np
import pytest
from fraexp_plugins.controllers.pid import Pid
from fraexp_plugins.friction.composite import Composite
from fraexp_plugins.plants.modal import Modal

from fraexp.analysis.fourier import phasors
from fraexp.components.kinds import Plant
from fraexp.components.ports import Contact, Ports
from fraexp.data.results import Outcome
from fraexp.errors import ParameterError
from fraexp.simulation import loop_setup
from tests.examples import some
from tests.machines import FRICTIONLESS, TABLE, guide, simulated
from tests.physics.harmonic_balance import Elements, solve_contacts
from tests.refusals import refused

SAMPLE = 500e-6
CONTROLLERS = {
    "two_mass": Pid(proportional=8000.0, derivative_time=0.04, filter_time=0.004),
    "ball_screw": Pid(proportional=1e6, derivative_time=0.025, filter_time=0.0015),
    "flexible_joint": Pid(proportional=6000.0, derivative_time=0.08, filter_time=0.006),
    "gantry": Pid(proportional=9000.0, derivative_time=0.05, filter_time=0.005),
}
AMPLITUDES = {"two_mass": 20.0, "ball_screw": 300.0, "flexible_joint": 60.0, "gantry": 40.0}


class TwoPlaces(Modal, name="two_places", version=1):
    """The table of the paper with two contacts at the same place."""

    def ports(self) -> Ports:
        """Return the table's ports, with a nut and a guide."""
        ports = super().ports()
        contact = ports.contacts["table"]
        return Ports(ports.a, ports.thrusts, {"nut": contact, "guide": contact}, ports.positions)


@pytest.fixture
def table():
    return TwoPlaces(**dict(TABLE))


def responses(signals, channel="y"):
    return np.array([(phasors(each, channel) / phasors(each, "u"))[0, 0] for each in signals.segments])


def example(registry, name, kind="plant"):
    component = registry.provider(kind, name).component
    return registry.create(kind, {"name": name, "preset": next(iter(component.presets))})


def laws(plant: Plant, scale: float):
    """Return a different law for each contact: their forces differ by an irrational factor."""
    names = list(plant.ports().contacts)
    return {
        name: guide(scale * 0.3 * 1.37**k, 20e-6 * 1.61**k, scale / 10, elements=3 + k) for k, name in enumerate(names)
    }


def balanced(plant, frictions, controller, frequency, amplitude):
    """Return y/u of each position by harmonic balance; the hold's images are neglected."""
    bodies, names = plant.bodies, list(frictions)
    omega = 2 * np.pi * frequency * (2 * np.arange(32) + 1)
    s, z = 1j * omega[:, None, None], np.exp(-1j * omega * SAMPLE)
    numerator, denominator = controller.transfer_function(SAMPLE)
    feedback = np.polyval(numerator[::-1], z) / np.polyval(denominator[::-1], z)
    path = (1 - z) / (1j * omega * SAMPLE) * z**2  # the hold, and two samples of dead time
    thrust, fed_back = next(iter(bodies.thrusts.values())), next(iter(bodies.positions.values()))
    at = np.array([bodies.contacts[name] for name in names])
    viscous = sum(law.viscous_coefficient * np.outer(v, v) for law, v in zip(frictions.values(), at, strict=True))
    dynamic = bodies.mass * s**2 + (bodies.damping + viscous) * s + bodies.stiffness
    dynamic = dynamic + (path * feedback)[:, None, None] * np.outer(thrust, fed_back)
    moved = np.linalg.solve(dynamic, np.broadcast_to(at.T.astype(complex), (omega.size, *at.T.shape)))
    free = np.zeros((omega.size, len(thrust)), complex)
    free[0] = np.linalg.solve(dynamic[0], thrust * path[0] * amplitude)
    elements = [
        Elements(np.array(law.stiffness), np.array(law.limit_force) / law.stiffness) for law in frictions.values()
    ]
    displacement = solve_contacts(at @ moved, free @ at.T, elements)
    # The forces are those that take the free displacements to these; they move the bodies as well. Of more contacts
    # than bodies many forces do, all with the same effect on the bodies.
    forces = np.linalg.lstsq((at @ moved)[0], free[0] @ at.T - displacement[0], rcond=1e-10)[0]
    q = free[0] - moved[0] @ forces
    u = amplitude - feedback[0] * (fed_back @ q)
    return {name: complex(port @ q / u) for name, port in bodies.positions.items()}


@pytest.mark.parametrize("name", some(CONTROLLERS, "two_mass"))
def test_machines_agree_with_harmonic_balance(registry, name):
    plant, controller, amplitude = example(registry, name), CONTROLLERS[name], AMPLITUDES[name]
    frictions, frequencies = laws(plant, amplitude), (4.0, 10.0, 25.0)
    signals = simulated(frictions, frequencies, amplitude, plant=plant, controller=controller, steps=0)
    assert signals.outcome is Outcome.OK
    fed_back, *others = plant.ports().closed_by("", "").positions
    expected = [balanced(plant, frictions, controller, frequency, amplitude) for frequency in frequencies]
    for channel, position in [("y", fed_back), *((f"y.{each}", each) for each in others)]:
        assert responses(signals, channel) == pytest.approx([each[position] for each in expected], rel=1e-4)


@pytest.mark.thorough
def test_the_implicit_solution_is_that_of_the_sum(table, monkeypatch):
    """Two contacts at one place are the hardest case: what one gives way, the other takes over."""
    monkeypatch.setattr(loop_setup, "is_friction_soft", lambda *_: False)
    first, second = guide(10.0, 5e-6, 3.0, elements=6), guide(8.0, 2e-6, 2.0, elements=5)
    apart = simulated({"nut": first, "guide": second}, (2.0, 25.0), 40.0, plant=table)
    together = simulated(Composite(parts=(first, second)), (2.0, 25.0), 40.0)
    assert "implicitly" in apart.numerics
    assert responses(apart) == pytest.approx(responses(together), rel=1e-9)


@pytest.mark.thorough
def test_further_positions_are_as_exact_as_the_tolerance(registry):
    """The link behind its gear is off by ten times as much as the motor, if the motor alone decides about the steps."""
    plant = example(registry, "flexible_joint")
    settings = {"plant": plant, "controller": CONTROLLERS["flexible_joint"], "tolerance": 1e-6}
    found, exact = (simulated(laws(plant, 60.0), (12.0, 150.0), 60.0, steps=steps, **settings) for steps in (0, 150))
    assert np.all(np.abs(responses(found, "y.link") / responses(exact, "y.link") - 1) < 1e-4)
    assert found.verification.further_step_errors["y.link"].max() <= 1e-4


@pytest.mark.parametrize(
    ("frictions", "names"),
    [
        (FRICTIONLESS, ["2 contacts", "[friction.motor]", "[friction.load]"]),
        ({"motor": FRICTIONLESS}, ["'load'", "[friction.load]"]),
        ({"motor": FRICTIONLESS, "load": FRICTIONLESS, "lod": FRICTIONLESS}, ["[friction.lod]", "'load'"]),
    ],
)
def test_models_fit_the_contacts(registry, frictions, names):
    with refused(ParameterError, *names):
        simulated(frictions, (5.0,), plant=example(registry, "two_mass"))


@pytest.mark.parametrize(
    ("settings", "names"),
    [({"thrust": "lod"}, ["thrust 'lod'", "motor"]), ({"position": "lod"}, ["position 'lod'", "'load'"])],
)
def test_the_loop_names_ports_of_the_plant(registry, settings, names):
    frictions = {"motor": FRICTIONLESS, "load": FRICTIONLESS}
    with refused(ParameterError, *names):
        simulated(frictions, (5.0,), plant=example(registry, "two_mass"), **settings)


def ports_with(**changes):
    a = np.array([[0.0, 1.0], [0.0, 0.0]])
    column, row = np.array([0.0, 1.0]), np.array([1.0, 0.0])
    given = {"thrusts": {"motor": column}, "contacts": {"guide": Contact(column, row)}, "positions": {"table": row}}
    return Ports(a, **{**given, **changes})


def test_ports_of_the_wrong_shape_or_degree_are_refused():
    ports_with().check()
    with refused(ParameterError, "position 'table'", "(3,)", "(2,)"):
        ports_with(positions={"table": np.ones(3)}).check()
    jumping = {"guide": Contact(np.array([1.0, 1.0]), np.array([1.0, 0.0]))}
    with refused(ParameterError, "position 'table'", "contact 'guide'"):
        ports_with(contacts=jumping).check()
