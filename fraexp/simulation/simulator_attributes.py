"""Friction as the attributes that simulators of robots have, with what these leave out."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from fraexp.components.kinds import FrictionModel

SLIDE_STEPS = 4000
FAST_SLIDE, SLOW_SLIDE = (0.2, 0.2), (2e-3, 1e-4)
"""Distance [m] and velocity [m/s] of the slides along which a law's force is observed: beyond the Stribeck effect, and
within it."""
RELATIVE_DIFFERENCE = 0.01
"""Relative difference of forces from which a caveat is written."""


@dataclass(frozen=True)
class FrictionAttributes:
    """What a joint's dry friction and damping can say of a friction model."""

    coulomb: float
    """Force of fast sliding without the viscous part [N], the mean of both directions."""
    asymmetry: float
    """Half of the difference of the directions [N]."""
    breakaway: float
    """Greatest force of slow sliding [N]."""
    viscous: float
    """Viscous coefficient [N s/m]."""
    stiffness: float
    """Stiffness at rest [N/m]."""
    law: str

    @classmethod
    def from_model(cls, friction: FrictionModel) -> "FrictionAttributes":
        """Return the attributes of a friction model, whose law is driven along slides."""
        there, back = (float(_slide(friction, FAST_SLIDE, sign)[SLIDE_STEPS // 2 :].mean()) for sign in (1, -1))
        slow = float(np.abs(_slide(friction, SLOW_SLIDE, 1)).max())
        stiffness = friction.max_stiffness
        return cls((there - back) / 2, (there + back) / 2, slow, friction.viscous, stiffness, friction.name)

    def caveats(self) -> Iterator[str]:
        """Yield what dry friction and damping leave out of the model."""
        if self.stiffness > 0:
            yield (
                f"Presliding is left out: below breakaway the law '{self.law}' is a spring with hysteresis, "
                f"{self.stiffness:.4g} N/m at a reversal; for motions of micrometres use the exported C code instead."
            )
        if self.breakaway > self.coulomb * (1 + RELATIVE_DIFFERENCE):
            forces = f"{self.breakaway:.4g} N, against {self.coulomb:.4g} N in fast sliding"
            yield f"The breakaway force is left out: {forces}."
        if abs(self.asymmetry) > RELATIVE_DIFFERENCE * self.coulomb:
            yield f"The directions differ by {2 * abs(self.asymmetry):.4g} N, of which the mean is taken."


def mjcf_text(friction: FrictionModel, name: str, notes: Sequence[str], is_rotary: bool) -> str:
    """Return a MuJoCo model that gives a joint of the class `name` its friction, to be included in another one."""
    found = FrictionAttributes.from_model(friction)
    kind = "hinge" if is_rotary else "slide"
    joint = f'<joint type="{kind}" damping="{found.viscous!r}" frictionloss="{found.coulomb!r}"/>'
    return (
        f"<mujoco>\n{_comment(found, notes)}"
        f"  <default>\n    <default class={quoteattr(name)}>\n      {joint}\n    </default>\n  </default>\n</mujoco>\n"
    )


def urdf_text(friction: FrictionModel, name: str, notes: Sequence[str], is_rotary: bool) -> str:
    """Return the element `dynamics` of a URDF joint, to be put into it."""
    found = FrictionAttributes.from_model(friction)
    joint = f"joint {name}, {'revolute or continuous' if is_rotary else 'prismatic'}"
    comment = _comment(found, [*notes, f"Put this element into the {joint}."]).replace("  <!--", "<!--", 1)
    return f'{comment}<dynamics damping="{found.viscous!r}" friction="{found.coulomb!r}"/>\n'


def _comment(found: FrictionAttributes, notes: Sequence[str]) -> str:
    lines = "\n".join(f"    {line}" for line in (*notes, *found.caveats())).replace("--", "- -")
    return f"  <!--\n{lines}\n  -->\n"


def _slide(friction: FrictionModel, slide: tuple[float, float], sign: int) -> NDArray[np.float64]:
    """Return the law's force [N] along a slide from rest, shape (SLIDE_STEPS,), in plain Python."""
    step, time = sign * slide[0] / SLIDE_STEPS, slide[0] / slide[1] / SLIDE_STEPS
    z, forces, arguments = np.zeros(friction.state_size), np.empty(SLIDE_STEPS), friction.law_arguments()
    for k in range(SLIDE_STEPS):
        z_next = np.zeros(friction.state_size)
        forces[k] = friction.law(z, step, time, z_next, *arguments)
        z = z_next
    return forces
