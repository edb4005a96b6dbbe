"""Friction as attributes of simulators: well-formed, with the sliding forces of the law, and honest about the rest."""

from xml.etree import ElementTree

import pytest

from fraexp.components.kinds import FrictionModel
from fraexp.components.registry import Registry, create
from fraexp.simulation.simulator_attributes import mjcf_text, urdf_text

LUGRE = {"name": "lugre", "preset": "linear_motor_table"}
COULOMB = {"name": "coulomb", "coulomb_force": 10.0, "negative_ratio": 1.2, "viscous_coefficient": 3.0}
NONE = {"name": "none", "viscous_coefficient": 2.5}


@pytest.mark.parametrize(
    ("spec", "force", "damping", "caveats"),
    [
        (LUGRE, 17.9, 4.69, ["Presliding is left out", "7.8e+05 N/m", "breakaway force is left out: 21.9"]),
        (COULOMB, 11.0, 3.0, ["directions differ by 2 N"]),
        (NONE, 0.0, 2.5, []),
    ],
)
def test_attributes_are_the_forces_of_sliding(
    registry: Registry, spec: dict[str, object], force: float, damping: float, caveats: list[str]
) -> None:
    friction = create(registry, FrictionModel, spec)
    mjcf = mjcf_text(friction, "axis", ["a -- note"], False)
    joint = ElementTree.fromstring(mjcf).find("default/default[@class='axis']/joint")
    assert joint is not None
    assert float(joint.attrib["frictionloss"]) == pytest.approx(force, rel=1e-3)
    assert float(joint.attrib["damping"]) == damping
    urdf = urdf_text(friction, "axis", ["note"], True)
    dynamics = ElementTree.fromstring(urdf)
    assert float(dynamics.attrib["friction"]) == pytest.approx(force, rel=1e-3)
    assert all(text in mjcf and text in urdf for text in caveats), mjcf
    assert "revolute" in urdf
    if not caveats:
        assert "left out" not in mjcf
