"""Wrong friction at one of two contacts, or a wrong plant between them: the band holds the plant, or it is not ok."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from fraexp_plugins.controllers.pid import Pid
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.plants.two_mass import TwoMass

from fraexp.analysis.confidence import confidence_limits
from fraexp.data.results import Outcome, Result
from fraexp.data.signals import Signals
from tests.examples import thorough
from tests.machines import guide, simulated
from tests.responses import judged

FREQUENCIES = tuple(np.geomspace(2.0, 150.0, 20))
ENCODERS = ((0.0, 0.0), (1e-7, 0.0), (1e-7, 30e-9))
"""Resolution [m] and noise [m]."""
GAINS = {"motor": (1000.0, 0.04), "load": (250.0, 0.06)}
"""Proportional gain over mass [1/s²] and derivative time [s], by the position that is fed back."""
WRONG = ({"motor": 1.05}, {"load": 1.05}, {"motor": 0.95}, {"load": 0.95})
DRAWS = [0, *(thorough(number) for number in range(1, 6))]


class Drive(NamedTuple):
    """A two-mass drive drawn at random, and its record."""

    plant: TwoMass
    frictions: dict[str, Rolling]
    position: str
    encoder: tuple[float, float]
    signals: Signals

    def estimated(self, factors: dict[str, float], **changes: object) -> Result:
        """Return the response found with friction models whose forces are too large by these factors."""
        resolution, noise = self.encoder
        models = {name: scaled(model, factors.get(name, 1.0)) for name, model in self.frictions.items()}
        given = {"frictions": models, "nominal_plant": self.plant, "position": self.position, "relative_degree": 2}
        given |= {"resolution": resolution, "noise": noise, "input_dead_time": 1e-3, **changes}
        return judged(EffectiveInput(**given), self.signals)

    def error(self, found: Result) -> float:
        """Return the greatest relative error of a response at settled frequencies."""
        response = found.response
        ports = self.plant.ports().closed_by("", self.position)
        ratio = response.response / ports.response(2 * np.pi * response.frequency, self.position)
        return float(np.abs(ratio - 1)[response.settled].max())


def scaled(model: Rolling, factor: float) -> Rolling:
    stiffness, limit_force = ([factor * each for each in part] for part in (model.stiffness, model.limit_force))
    return Rolling(stiffness=stiffness, limit_force=limit_force, viscous_coefficient=model.viscous_coefficient)


def drawn(number: int, frequencies: tuple[float, ...] = FREQUENCIES) -> Drive:
    random = np.random.default_rng(number)
    masses, stiffness = random.uniform([2.0, 2.0], [5.0, 8.0]), 10 ** random.uniform(5, 6)
    plant = TwoMass(motor_mass=masses[0], load_mass=masses[1], stiffness=stiffness, damping=random.uniform(10.0, 60.0))
    frictions = {
        name: guide(force, 10 ** random.uniform(-4.8, -4.0), random.uniform(1.0, 8.0), elements)
        for name, force, elements in (("motor", random.uniform(8, 25), 12), ("load", random.uniform(3, 15), 8))
    }
    amplitude = random.uniform(0.6, 3.0) * sum(model.force_bound for model in frictions.values())
    position, encoder = ("motor", "load")[number % 2], ENCODERS[number % 3]
    gain, derivative_time = GAINS[position]
    controller = Pid(proportional=gain * masses.sum(), derivative_time=derivative_time, filter_time=0.004)
    signals = simulated(
        frictions, frequencies, amplitude, plant=plant, controller=controller, steps=10, position=position,
        resolution=encoder[0], noise=encoder[1], tolerance=1e-4 if encoder[1] else 1e-5,
    )  # fmt: skip
    return Drive(plant, frictions, position, encoder, signals)


def without_motor_encoder(drive: Drive) -> Drive:
    units = {name: unit for name, unit in drive.signals.units.items() if name != "y.motor"}
    return drive._replace(signals=replace(drive.signals, units=units))


def holds(drive: Drive, found: Result) -> np.ndarray:
    """Return where the band of a response holds the plant."""
    response, ports = found.response, drive.plant.ports().closed_by("", drive.position)
    truth = np.abs(ports.response(2 * np.pi * response.frequency, drive.position) / response.response)
    low, high = confidence_limits(response).magnitude + np.array([[-1e-3], [1e-3]])
    return (truth >= low) & (truth <= high) | ~response.settled


@pytest.mark.parametrize("number", DRAWS)
def test_a_force_five_percent_wrong_at_one_contact_is_in_the_band(number):
    """The band contains the friction models' errors, and what rounding and noise do to the force along all of them."""
    drive = drawn(number, FREQUENCIES[::3])
    for factors in ({}, *WRONG):
        found = drive.estimated(factors)
        assert holds(drive, found).mean() > 0.8
        assert found.outcome is not Outcome.OK or drive.error(found) < 0.06


@pytest.mark.thorough
def test_a_displacement_that_is_reconstructed():
    """Without the motor's encoder its displacement follows from the load's, by the nominal plant."""
    drive = without_motor_encoder(drawn(3, FREQUENCIES[::3]))
    assert drive.estimated({}).outcome is Outcome.OK
    for factors in WRONG[:2]:
        assert holds(drive, drive.estimated(factors)).mean() > 0.8


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["stiffness", "load_mass"])
def test_a_wrong_nominal_plant_is_not_ok_unless_its_uncertainty_is_stated(name):
    """A nominal plant 20 % wrong, by which friction at the load acts and the motor's displacement is reconstructed."""
    drive = without_motor_encoder(drawn(9))
    wrong = drive.plant.model_copy(update={name: 1.2 * getattr(drive.plant, name)})
    found = drive.estimated({}, nominal_plant=wrong)
    assert drive.error(found) > 0.1
    assert found.outcome is not Outcome.OK
    deviations = [{"parameter": name, "std": 0.2 * getattr(drive.plant, name)}]
    assert holds(drive, drive.estimated({}, nominal_plant=wrong, plant_deviations=deviations)).mean() > 0.8
