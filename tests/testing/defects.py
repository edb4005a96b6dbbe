"""Friction models with one defect each, and the check that must find it."""

import math
import random
from typing import ClassVar

from fraexp_plugins.friction.dahl import Dahl
from fraexp_plugins.friction.elastoplastic import Elastoplastic
from fraexp_plugins.friction.gms import GeneralizedMaxwellSlip
from pydantic import field_validator

from fraexp.api import FrictionModel, param


class Element(FrictionModel, name="element", version=1):
    """One elasto-slide element (Jenkins 1962), without defect."""

    stiffness: float = param("N/m", "stiffness", above=0)
    limit: float = param("N", "limit force", above=0)
    states = ("force [N]",)
    presets: ClassVar = {"example": {"stiffness": 4e5, "limit": 18.0}}
    max_stiffness = property(lambda self: self.stiffness)
    force_bound = property(lambda self: self.limit)

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness, limit):
        z_next[0] = min(max(z[0] + stiffness * dy, -limit), limit)
        return z_next[0]


class SignLeftInAlpha(Elastoplastic, name="sign_left_in_alpha", version=1):
    """Dupont 2002 with an α(z) that forgets |z|."""

    @staticmethod
    def advance(
        z, dy, dt, z_next, bristle_stiffness, coulomb_force, static_force, stribeck_velocity, elastic_limit_ratio
    ):
        velocity = dy / dt / stribeck_velocity
        steady = (coulomb_force + (static_force - coulomb_force) * math.exp(-velocity * velocity)) / bristle_stiffness
        elastic = elastic_limit_ratio * coulomb_force / bristle_stiffness
        alpha = min(max((z[0] - elastic) / (steady - elastic), 0.0), 1.0)  # |z|, and only if sgn z = sgn v
        z_next[0] = z[0] + dy * (1.0 - alpha * math.copysign(1.0, dy) * z[0] / steady)
        z_next[1] = 0.0
        return bristle_stiffness * z_next[0]


class UnsignedS(GeneralizedMaxwellSlip, name="unsigned_s", version=1):
    """Al-Bender 2005 as printed, dF/dt = sgn(v) C (α - F/S), with S without its sign: repelling for v < 0."""

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness, normalised_fractions, coulomb_force, attraction_rate):
        n = stiffness.size
        sign = math.copysign(1.0, dy) if dy != 0.0 else z[2 * n]
        turned = sign != z[2 * n]
        z_next[2 * n] = sign
        force = 0.0
        for i in range(n):
            limit = normalised_fractions[i] * coulomb_force
            slips = z[n + i] > 0.0 and not turned and dy != 0.0
            if slips:
                z_next[i] = limit + (z[i] - limit) * math.exp(min(-sign * attraction_rate * dt / coulomb_force, 300.0))
            else:
                z_next[i] = min(max(z[i] + stiffness[i] * dy, -limit), limit)
                slips = abs(z_next[i]) >= limit
            z_next[n + i] = 1.0 if slips else 0.0
            force += z_next[i]
        return force


class Held(Element, name="held", version=1):
    """Jenkins 1962, with the force held from the step before."""

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness, limit):
        z_next[0] = min(max(z[0] + stiffness * dy, -limit), limit)
        return z[0]


class Swapped(Dahl, name="swapped", version=1):
    """Dahl 1968 with stiffness and Coulomb force taken for each other."""

    @staticmethod
    def advance(z, dy, dt, z_next, coulomb_force, stiffness):
        coulomb_force, stiffness = stiffness, coulomb_force
        limit = math.copysign(coulomb_force, dy)
        z_next[0] = limit + (z[0] - limit) * math.exp(-stiffness * abs(dy) / coulomb_force)
        return z_next[0]


class Written(Element, name="written", version=1):
    """Jenkins 1962, that writes the state it is tried from."""

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness, limit):
        z[0] = min(max(z[0] + stiffness * dy, -limit), limit)
        z_next[0] = z[0]
        return z_next[0]


class Generator(Element, name="generator", version=1):
    """Jenkins 1962 with a rate of the wrong sign: it gives energy."""

    states = ("force [N]",)

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness, limit):
        z_next[0] = min(max(z[0] + stiffness * dy, -limit), limit)
        return z_next[0] - 0.05 * stiffness * dy / dt


class NoStep(Element, name="no_step", version=1):
    """Jenkins 1962, undecided for a step of 0 m."""

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness, limit):
        direction = dy / math.sqrt(dy * dy) if dy != 0.0 else math.nan
        z_next[0] = min(max(z[0] + stiffness * abs(dy) * direction, -limit), limit)
        return z_next[0]


class Lopsided(Element, name="lopsided", version=1):
    """Jenkins 1962, weaker in one direction."""

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness, limit):
        z_next[0] = min(max(z[0] + stiffness * dy, -0.9 * limit), limit)
        return z_next[0]


class TooFewStates(Element, name="too_few_states", version=1):
    """Jenkins 1962, that remembers more than it declares."""

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness, limit):
        z_next[0] = min(max(z[0] + stiffness * dy, -limit), limit)
        z_next[1] = dy
        return z_next[0]


class TooManyStates(Element, name="too_many_states", version=1):
    """Jenkins 1962, that declares more than it writes."""

    states = ("force [N]", "last step [m]")


class NotWrittenAtRest(Element, name="not_written_at_rest", version=1):
    """Jenkins 1962, that forgets its memory when it stands still."""

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness, limit):
        if dy == 0.0:
            return z[0]
        z_next[0] = min(max(z[0] + stiffness * dy, -limit), limit)
        return z_next[0]


class NoUnit(Element, name="no_unit", version=1):
    """Jenkins 1962, with a number without unit."""

    share: float = param("", "share of something", 1.0)


class NoSource(Element, name="no_source", version=1):
    """One elasto-slide element."""


class Drifting(Element, name="drifting", version=1):
    """Jenkins 1962, whose limit grows whenever it is read."""

    @field_validator("limit")
    @classmethod
    def grow(cls, value):
        return 1.01 * value


class Incomplete(Element, name="incomplete", version=1):
    """Jenkins 1962, with a preset that lacks a parameter."""

    presets: ClassVar = {"example": {"stiffness": 4e5}}


class Jumping(Element, name="jumping", version=1):
    """Coulomb 1785: the sign of the velocity, which jumps."""

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness, limit):
        z_next[0] = math.copysign(limit, dy) if dy != 0.0 else z[0]
        return z_next[0]


class OfVelocity(FrictionModel, name="of_velocity", version=1):
    """Coulomb 1785, smoothed in a narrow transition, without defect and without memory."""

    states = ()

    @staticmethod
    def advance(z, dy, dt, z_next):
        return 10 * math.tanh(dy / dt / 1e-6)


class JumpingWithoutStates(OfVelocity, name="jumping_without_states", version=1):
    """Coulomb 1785: the sign of the velocity, which jumps, without memory."""

    @staticmethod
    def advance(z, dy, dt, z_next):
        return math.copysign(10.0, dy)


class OfSteps(OfVelocity, name="of_steps", version=1):
    """Coulomb 1785, with a force of the step, which vanishes with it."""

    @staticmethod
    def advance(z, dy, dt, z_next):
        return 1e6 * dy


class Leaking(Element, name="leaking", version=1):
    """Jenkins 1962, that forgets a part of its force in every step, however short."""

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness, limit):
        z_next[0] = min(max(0.97 * z[0] + stiffness * dy, -limit), limit)
        return z_next[0]


class Overdriven(Element, name="overdriven", version=1):
    """Jenkins 1962, that exceeds the force it declares."""

    force_bound = property(lambda self: 0.8 * self.limit)


class Understated(Element, name="understated", version=1):
    """Jenkins 1962, that understates its stiffness."""

    max_stiffness = property(lambda self: 0.5 * self.stiffness)


class Falling(Element, name="falling", version=1):
    """Jenkins 1962, whose force falls in long steps."""

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness, limit):
        z_next[0] = min(max(z[0] + stiffness * dy, -limit), limit)
        return z_next[0] / (1.0 + 0.5 * stiffness * abs(dy) / limit)


class Preloaded(Element, name="preloaded", version=1):
    """Jenkins 1962, with a force before anything has moved."""

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness, limit):
        z_next[0] = min(max(z[0] + stiffness * dy, -limit), limit)
        return z_next[0] + 0.1 * limit


class OfAPlace(Element, name="of_a_place", version=1):
    """Jenkins 1962 with a spring to ground: its force depends on the place."""

    def force(self, displacement, time_step, periodic=False):
        return super().force(displacement, time_step, periodic) + 0.1 * self.stiffness * displacement


class Divided(Element, name="divided", version=1):
    """Jenkins 1962, with a bound at which it divides by 0."""

    blend: float = param("1", "blend", 0.5, at_least=0, at_most=1)

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness, limit, blend):
        z_next[0] = min(max(z[0] + stiffness * dy, -limit), limit)
        return z_next[0] * (blend / blend)


class CompiledOtherwise(Element, name="compiled_otherwise", version=1):
    """Jenkins 1962, with what compiled code does otherwise: an integer that does not fit."""

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness, limit):
        z_next[0] = min(max(z[0] + stiffness * dy, -limit), limit)
        big = 3
        for _ in range(45):
            big *= 3
        return z_next[0] * (1.0 if big > 1e20 else 0.5)


class Remembering(Element, name="remembering", version=1):
    """Jenkins 1962, that counts how often it was asked."""

    def force(self, displacement, time_step, periodic=False):
        ASKED.append(self)
        return super().force(displacement, time_step, periodic) * (1 + 1e-3 * len(ASKED))


ASKED: list[FrictionModel] = []


class Dice(Element, name="dice", version=1):
    """Jenkins 1962 with a random force."""

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness, limit):
        z_next[0] = min(max(z[0] + stiffness * dy, -limit), limit)
        return z_next[0] * (1.0 + 1e-9 * random.random())


class Tiring(Element, name="tiring", version=1):
    """Jenkins 1962 that writes beyond its memory once it has moved for long."""

    states = ("force [N]", "steps [1]")

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness, limit):
        z_next[0] = min(max(z[0] + stiffness * dy, -limit), limit)
        z_next[1] = z[1] + 1.0
        if z_next[1] > 20000.0:
            z_next[2] = 0.0
        return z_next[0]


FRICTION = {
    Dice: "pure",
    Tiring: "endurance",
    SignLeftInAlpha: "odd",
    UnsignedS: "odd",
    Held: "present",
    Swapped: "bound",
    Written: "trial",
    Generator: "energy",
    NoStep: "finite",
    Lopsided: "odd",
    TooFewStates: "state-size",
    TooManyStates: "state-size",
    NotWrittenAtRest: "state-size",
    NoUnit: "units",
    NoSource: "source",
    Drifting: "plain-data",
    Incomplete: "presets",
    Jumping: "continuous",
    JumpingWithoutStates: "continuous",
    OfSteps: "refinement",
    Leaking: "refinement",
    Overdriven: "bound",
    Understated: "stiffness",
    Falling: "monotone",
    Preloaded: "rest",
    OfAPlace: "translation",
    Divided: "limits",
    CompiledOtherwise: "compiled",
    Remembering: "compiled",
}
