"""Friction models of several laws at which a fit may begin, from records of a machine of which nothing is known."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fraexp.api import FrictionModel, Signals, phasors
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.friction.dahl import Dahl
from fraexp_plugins.friction.lugre import LuGre
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.identification.whole_record._shared.free_parameters import SCALES
from fraexp_plugins.identification.whole_record._shared.staged_fit import ScaleSearch

FORCE_RATIO, FORCE_RANGE = 0.55, 5.5
"""Coulomb force over the largest control input that is tried first, and the largest factor on it."""
WIDTH_RATIOS = (1 / 3, 1 / 27, 1 / 243)
"""Presliding distances over the largest motion, each of which stands for those within a factor of three."""
ELEMENTS, MIN_KNOT_RATIO, MAX_KNOT_RATIO = 20, 0.01, 2.2
"""Elements of the curve, and its knots over the presliding distance."""
STATIC_RATIO, STRIBECK_RATIO, VISCOUS_RATIO = 1.2, 0.1, 0.05
"""Static over Coulomb force, Stribeck over largest velocity, and viscous over Coulomb force at that velocity."""
DAMPING_TIME_S = 5e-4
"""Bristle damping over stiffness [s]."""


class RoughFriction(NamedTuple):
    """What an observer tells of friction, whatever its law."""

    force: float
    """Coulomb force [N]."""
    width: float
    """Presliding distance [m]."""
    velocity: float
    """Largest velocity of the records [m/s]."""

    def rolling(self) -> FrictionModel:
        """Return elements along an exponential curve."""
        curve = {
            "shape": "exponential", "coulomb_force": self.force, "characteristic_displacement": self.width,
            "elements": ELEMENTS, "min_knot": MIN_KNOT_RATIO * self.width, "max_knot": MAX_KNOT_RATIO * self.width,
        }  # fmt: skip
        return Rolling.parse({"curve": curve, "viscous_coefficient": self.viscous}, "rolling")

    @property
    def viscous(self) -> float:
        """Viscous coefficient [N s/m] that is tried first."""
        return VISCOUS_RATIO * self.force / self.velocity

    def models(self) -> list[FrictionModel]:
        """Return a model of each law that is replayed in lanes."""
        stiffness = self.force / self.width
        common = {"coulomb_force": self.force, "viscous_coefficient": self.viscous}
        stribeck = {"static_force": STATIC_RATIO * self.force, "stribeck_velocity": STRIBECK_RATIO * self.velocity}
        bristles = {"bristle_stiffness": stiffness, "bristle_damping": DAMPING_TIME_S * stiffness}
        return [
            self.rolling(),
            Dahl.parse({"stiffness": stiffness, **common}, "dahl"),
            LuGre.parse({**bristles, **common, **stribeck}, "lugre"),
        ]


def rough_friction(signals: Signals, observer: EffectiveInput) -> RoughFriction:
    """Return what the response of an observer tells of friction: that with which it is most like a plant's."""
    thrust = max(float(np.abs(segment.channels[observer.input]).max()) for segment in signals.segments)
    motion = max(float(np.ptp(segment.channels[observer.output])) for segment in signals.segments) / 2
    velocity = _velocity(signals, observer)
    starts = [RoughFriction(FORCE_RATIO * thrust, ratio * motion, velocity) for ratio in WIDTH_RATIOS]
    found = [_plausible_friction(signals, observer, start) for start in starts]
    return min(found, key=lambda each: each[0])[1]


def _plausible_friction(
    signals: Signals, observer: EffectiveInput, start: RoughFriction
) -> tuple[float, RoughFriction]:
    """Return the cost of the most plausible friction around a start, and that friction."""
    changed = observer.model_copy(update={"friction": start.rolling()})
    segments = signals.segments
    search = ScaleSearch(segments, changed.resolve_oversampling(segments), SCALES, force_range=FORCE_RANGE)
    (best, *_) = search.starts()
    cost = float(search.costs(best[None, :])[0])
    force, width = np.exp(best)
    return cost, start._replace(force=start.force * float(force), width=start.width * float(width))


def _velocity(signals: Signals, observer: EffectiveInput) -> float:
    """Return the largest velocity that an excited line causes [m/s]."""
    speeds: Sequence[float] = [
        float((2 * np.pi * segment.frequency * np.abs(phasors(segment, observer.output)).max(axis=0)).max())
        for segment in signals.segments
    ]
    return max(speeds)
