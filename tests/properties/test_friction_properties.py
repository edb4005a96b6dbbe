"""What must hold for any parameters and any motion: bounds, symmetry, memory and energy of the friction models."""

import numpy as np
import pytest
from fraexp_plugins.friction.coulomb import Coulomb
from fraexp_plugins.friction.dahl import Dahl
from fraexp_plugins.friction.elastoplastic import Elastoplastic
from fraexp_plugins.friction.gms import GeneralizedMaxwellSlip
from fraexp_plugins.friction.lugre import LuGre
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.friction.rolling_force_slider import RollingForceSlider
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.examples import portion

number = st.floats
positive = number(1e-2, 1e2)
GRID = 2.0**-12
"""Displacements on a grid: their differences are exact, and so is the force at the same place."""
walks = st.lists(st.integers(-4000, 4000).filter(bool), min_size=3, max_size=60).map(
    lambda moves: np.concatenate([[0.0], np.cumsum(moves) * GRID])
)
elements = st.lists(st.tuples(positive, positive), min_size=1, max_size=6)
steps = st.sampled_from([1e-5, 1e-3, 0.1, 10.0])
few = settings(max_examples=portion(60))


@st.composite
def stribeck(draw) -> dict[str, float]:
    coulomb = draw(positive)
    return {
        "coulomb_force": coulomb,
        "static_force": coulomb * draw(number(1.0, 3.0)),
        "stribeck_velocity": draw(positive),
    }


@st.composite
def rollings(draw, reading=Rolling):
    drawn = draw(elements)
    return reading(stiffness=tuple(k for k, _ in drawn), limit_force=tuple(f for _, f in drawn))


@st.composite
def generalized(draw):
    drawn = draw(elements)
    total = sum(share for _, share in drawn)
    return GeneralizedMaxwellSlip(
        stiffness=tuple(k for k, _ in drawn),
        force_fractions=tuple(share / total for _, share in drawn),
        attraction_rate=draw(positive),
        **draw(stribeck()),
    )


dahls = st.builds(Dahl, stiffness=positive, coulomb_force=positive)
lugres = stribeck().flatmap(
    lambda g: st.builds(LuGre, bristle_stiffness=positive, **{k: st.just(v) for k, v in g.items()})
)
elastoplastics = stribeck().flatmap(
    lambda g: st.builds(
        Elastoplastic,
        bristle_stiffness=positive,
        elastic_limit_ratio=number(0.05, 0.95),
        **{k: st.just(v) for k, v in g.items()},
    )
)
coulombs = stribeck().flatmap(
    lambda g: st.builds(Coulomb, stiction_displacement=positive, **{k: st.just(v) for k, v in g.items()})
)
path_dependent = st.one_of(rollings(), rollings(RollingForceSlider), dahls)
any_model = st.one_of(path_dependent, generalized(), lugres, elastoplastics, coulombs)


def greatest(model) -> float:
    """Return the force that no motion can exceed [N]."""
    if hasattr(model, "limit_force"):
        return sum(model.limit_force)
    return model.static_force if hasattr(model, "static_force") else model.coulomb_force


@few
@given(any_model, walks, steps)
def test_the_force_is_bounded(model, walk, step):
    force = model.force(walk, step)
    assert np.isfinite(force).all()
    assert np.max(np.abs(force)) <= greatest(model) * (1 + 1e-12)


@few
@given(any_model, walks, steps)
def test_the_force_is_odd(model, walk, step):
    assert np.array_equal(model.force(-walk, step), -model.force(walk, step))


@few
@given(any_model, walks, steps, st.integers(-(10**6), 10**6))
def test_the_force_does_not_know_where_it_is(model, walk, step, places):
    assert np.array_equal(model.force(walk + places * GRID, step), model.force(walk, step))


@few
@given(path_dependent, walks)
def test_the_path_alone_decides_not_its_pace(model, walk):
    assert np.array_equal(model.force(walk, 1e-5), model.force(walk, 10.0))


@few
@given(path_dependent, walks, st.integers(2, 9))
def test_more_samples_of_the_same_path_change_nothing(model, walk, finer):
    between = np.arange(walk.size * finer - finer + 1) / finer
    fine = np.interp(between, np.arange(walk.size), walk)
    change = np.abs(model.force(fine, 1e-3)[::finer] - model.force(walk, 1e-3))
    assert np.max(change) <= 1e-12 * (greatest(model) + model.max_stiffness * np.max(np.abs(walk)))


@few
@given(rollings(), walks)
def test_rolling_never_pushes_and_is_no_stiffer_than_its_springs(model, walk):
    force, dy = np.diff(model.force(walk, 1e-3)), np.diff(walk)
    rounding = 1e-13 * greatest(model)
    assert np.all(force * np.sign(dy) >= -rounding)
    assert np.all(np.abs(force) <= sum(model.stiffness) * np.abs(dy) * (1 + 1e-12) + rounding)


@few
@given(rollings(), walks)
def test_after_a_reversal_rolling_is_as_stiff_as_all_its_springs(model, walk):
    narrowest = min(f / k for k, f in zip(model.stiffness, model.limit_force, strict=True))
    last = walk[-1] - walk[-2]
    back = -np.sign(last) * min(narrowest, 0.5 * abs(last))  # within the last move: beyond it older memory is met
    force = model.force(np.append(walk, walk[-1] + back), 1e-3)
    assert force[-1] - force[-2] == pytest.approx(sum(model.stiffness) * back, rel=1e-9)


@few
@given(rollings(), number(0.01, 50.0))
def test_branches_of_rolling_are_its_virgin_curve_twice_as_large(model, reach):
    there = np.linspace(0, reach, 30)
    virgin = model.force(there, 1e-3)
    branch = model.force(np.concatenate([there, reach - 2 * there[1:]]), 1e-3)[29:]
    assert np.allclose(branch, virgin[-1] - 2 * virgin, rtol=0, atol=1e-12 * greatest(model))


@few
@given(rollings(), st.lists(number(-1, 1), min_size=2, max_size=8), number(0.1, 50.0))
def test_rolling_remembers_its_return_points(model, inner, reach):
    """Whatever happens between -reach and reach is wiped out once both are visited again in turn."""
    path = np.array([0.0, reach, -reach, *(reach * x for x in inner), -reach, reach])
    force = model.force(path, 1e-3)
    assert force[-1] == pytest.approx(force[1], abs=1e-12 * greatest(model))
    assert force[-2] == pytest.approx(force[2], abs=1e-12 * greatest(model))


@few
@given(rollings(), st.lists(number(-5, 5), min_size=1, max_size=8), number(-3, 3), number(0.01, 5))
def test_minor_loops_of_rolling_are_congruent(model, history, begin, width):
    ends = np.linspace(begin, begin + width, 12)
    loop = np.concatenate([ends, ends[-2::-1], ends[1:], ends[-2::-1]])
    alone, after = model.force(loop, 1e-3)[-12:], model.force(np.concatenate([history, loop]), 1e-3)[-12:]
    assert np.allclose(after - after[0], alone - alone[0], rtol=0, atol=1e-12 * greatest(model))


@few
@given(any_model, walks, steps)
def test_a_closed_loop_takes_energy(model, walk, step):
    """Of the periodic force along a path that ends where it began; of coarse steps by the force at their end."""
    path = np.concatenate([walk, walk[-2::-1]])
    fine = np.interp(np.arange(0, path.size - 1, 0.1), np.arange(path.size), path)
    force = model.force(np.tile(fine, 4), step)[-fine.size :]
    dy = fine - np.roll(fine, 1)
    assert np.sum(force * dy) >= -1e-9 * greatest(model) * np.sum(np.abs(dy))


@few
@given(rollings(), rollings(), walks)
def test_forces_of_parallel_elements_add_up(first, second, walk):
    both = Rolling(
        stiffness=first.stiffness + second.stiffness, limit_force=first.limit_force + second.limit_force
    ).force(walk, 1e-3)
    apart = first.force(walk, 1e-3) + second.force(walk, 1e-3)
    assert np.allclose(both, apart, rtol=0, atol=1e-13 * (greatest(first) + greatest(second)))


@few
@given(generalized(), walks, steps)
def test_without_stribeck_effect_gms_is_rolling(model, walk, step):
    level = model.model_copy(update={"static_force": model.coulomb_force})
    force = tuple(model.coulomb_force * share for share in model.force_fractions)
    rolling = Rolling(stiffness=model.stiffness, limit_force=force)
    assert np.allclose(level.force(walk, step), rolling.force(walk, step), rtol=0, atol=1e-13 * model.coulomb_force)


@few
@given(stribeck(), positive, walks)
def test_without_damping_and_stribeck_effect_lugre_is_dahl(curve, stiffness, walk):
    lugre = LuGre(
        bristle_stiffness=stiffness, coulomb_force=curve["coulomb_force"], static_force=curve["coulomb_force"]
    )
    dahl = Dahl(stiffness=stiffness, coulomb_force=curve["coulomb_force"])
    assert np.allclose(lugre.force(walk, 1e-3), dahl.force(walk, 1e-3), rtol=0, atol=1e-12 * curve["coulomb_force"])


@few
@given(elastoplastics, st.lists(number(-1, 1), min_size=1, max_size=40), steps)
def test_elastoplastic_friction_is_a_spring_within_its_elastic_limit(model, shares, step):
    limit = model.elastic_limit_ratio * model.coulomb_force / model.bristle_stiffness
    walk = np.concatenate([[0.0], np.array(shares) * limit])
    assert np.allclose(
        model.force(walk, step), model.bristle_stiffness * walk, rtol=0, atol=1e-12 * model.coulomb_force
    )
