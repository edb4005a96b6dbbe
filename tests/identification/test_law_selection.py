"""Which friction law, of a machine of which nothing is known: the law, its numbers, the plant, and what none fits."""

from dataclasses import replace

import numpy as np
import pytest
from fraexp_plugins.identification._law_numbers import shape_parameters

from fraexp.components.kinds import Estimator, FrictionModel
from fraexp.components.registry import create, discover
from fraexp.data.results import Outcome
from fraexp.errors import FraexpError, RecordError
from tests.identification.plant_responses import SCALE
from tests.identification.test_maximum_likelihood import LUGRE, MACHINE, metrics, plant_at
from tests.machines import decibel, degrees
from tests.refusals import refused

SINE = {"name": "stepped_sine", "amplitude": 12.0, "points": 20}


BOUC_WEN = """
import math
from fraexp.api import FrictionModel, param

class BoucWen(FrictionModel, name="bouc_wen", version=1):
    states = ("force [N]",)
    stiffness: float = param("N/m", "stiffness", above=0)
    limit_force: float = param("N", "limit force", above=0)
    exponent: float = param("1", "exponent", at_least=0.5, at_most=4)
    viscous_coefficient: float = param("N s/m", "viscous coefficient", 0.0, at_least=0)

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness, limit_force, exponent):
        share = min(abs(z[0]) / limit_force, 1.0) ** exponent
        middle = z[0] + stiffness * dy / 2 * (1 - math.copysign(share, z[0] * dy))
        share = min(abs(middle) / limit_force, 1.0) ** exponent
        moved = z[0] + stiffness * dy * (1 - math.copysign(share, middle * dy))
        z_next[0] = min(max(moved, -limit_force), limit_force)
        return z_next[0]
"""


def comparison(registry=None, **given):
    parameters = {**SCALE, "noise": 0.0, "input_dead_time": MACHINE["loop"]["input_dead_time"]}
    return create(registry or discover(), Estimator, {"name": "maximum_likelihood", **parameters, **given})


def test_shape_parameters_are_those_that_scales_do_not_change(registry):
    friction = create(registry, FrictionModel, LUGRE)
    assert set(shape_parameters(friction)) == {
        "viscous_coefficient", "static_force", "bristle_damping", "stribeck_velocity"
    }  # fmt: skip
    rolling = create(registry, FrictionModel, MACHINE["friction"])
    assert set(shape_parameters(rolling)) == {"viscous_coefficient", "curve.min_knot", "curve.max_knot"}


def test_too_few_records_are_refused(recorded):
    signals = recorded(SINE, noise=0.0)
    with pytest.raises(RecordError, match=r"there are 5 records; expected 8 or more"):
        comparison(laws=["rolling"]).estimate(replace(signals, segments=signals.segments[:5]))


@pytest.fixture(scope="module")
def with_own_law(tmp_path_factory):
    """Registry with a law of the user's own, in a file of the workspace."""
    folder = tmp_path_factory.mktemp("plugins")
    (folder / "bouc_wen.py").write_text(BOUC_WEN)
    return discover(folder)


def test_a_law_of_the_user_is_named_and_is_a_part_of_the_run(with_own_law):
    estimator = comparison(with_own_law, laws=["dahl", "bouc_wen"])
    assert estimator.spec()["laws"] == ["dahl", "bouc_wen"]
    files = [provider.file.name for provider in with_own_law.used_providers("estimator", estimator.spec())]
    assert "bouc_wen.py" in files  # a run is computed anew when it changes


@pytest.mark.thorough
def test_a_law_of_the_user_is_identified_by_its_name(recorded, with_own_law):
    numbers = {"stiffness": 3e5, "limit_force": 18.0, "exponent": 1.4, "viscous_coefficient": 8.0}
    law = create(with_own_law, FrictionModel, {"name": "bouc_wen", **numbers})
    sine = {"name": "stepped_sine", "amplitude": 30.0, "points": 12, "min_frequency": 10.0, "max_frequency": 120.0}
    signals = recorded(sine, law, noise=0.0)
    result = comparison(with_own_law, laws=["dahl", "bouc_wen"]).estimate(signals)
    assert result.findings[0].place == "bouc_wen"
    found = metrics(result)
    assert result.outcome is Outcome.OK
    assert found["exponent"] == pytest.approx(1.4, abs=found["exponent, 95 %"])


@pytest.mark.parametrize(
    ("given", "names"),
    [
        ({"laws": ["dahll"]}, ["dahll", "dahl"]),
        ({"laws": ["composite"]}, ["laws", "starts"]),
        ({"laws": ["dahl"], "free": ["force_scale"]}, ["free", "force_scale"]),
    ],
)
def test_a_choice_that_cannot_begin_is_refused(given, names):
    with refused(FraexpError, *names):
        comparison(**given)


@pytest.mark.thorough
def test_law_numbers_and_plant_are_found_of_a_machine_of_which_nothing_is_known(recorded, registry):
    signals = recorded(SINE, noise=0.0)
    result = comparison(laws=["rolling", "dahl"]).estimate(signals)
    assert result.outcome is Outcome.OK, result.message
    assert result.findings[0].place == "rolling"
    found, curve = metrics(result), MACHINE["friction"]["curve"]
    assert found["rolling: held-out residual"] < 1.1
    assert found["dahl: held-out residual"] > 10 * found["rolling: held-out residual"]
    assert found["dahl: residual along the motion"] > 10 * found["rolling: residual along the motion"]
    assert found["Coulomb force"] == pytest.approx(curve["coulomb_force"], abs=found["Coulomb force, 95 %"])
    assert found["Coulomb force, 95 %"] < 1e-3 * curve["coulomb_force"]
    friction = create(registry, FrictionModel, result.fits[1].component)
    assert friction.curve.coulomb_force == pytest.approx(curve["coulomb_force"], rel=1e-4)
    ratio = result.response.response / plant_at(registry, result)
    assert np.abs(decibel(ratio)).max() < 0.1
    assert np.abs(degrees(ratio)).max() < 1.5


@pytest.mark.thorough
def test_none_fits_where_the_machines_law_is_no_candidate(recorded):
    signals = recorded({**SINE, "points": 14}, noise=0.0)
    result = comparison(laws=["dahl"]).estimate(signals)
    assert result.outcome is Outcome.INACCURATE
    assert result.findings[0].kind == "misfit"


@pytest.mark.thorough
def test_the_simpler_of_two_laws_that_both_fit_wins(recorded):
    dahl = {"name": "dahl", "stiffness": 1.5e5, "coulomb_force": 17.9, "viscous_coefficient": 10.0}
    lugre = {**LUGRE, "static_force": 18.0}
    signals = recorded({"name": "stepped_sine", "amplitude": 25.0, "points": 20}, dahl, noise=0.0)
    result = comparison(starts=[lugre, dahl]).estimate(signals)
    assert result.findings[0].place == "dahl"
    assert result.outcome is Outcome.OK
