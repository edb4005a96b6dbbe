"""JAX by hand: lax.scan over the samples, in float64, by the scheme of the NumPy loops.

All lanes together either by vmap, or written out with the lanes as last dimension, which compiles to faster code.
"""

from typing import Any

import numpy as np

from peers.problem import Peer, Problem, Run


def peers() -> list[Peer]:
    """Return the scans of all lanes, and of one lane at a time."""
    ways = [("JAX scan, lanes as last dimension", True), ("JAX scan + vmap", True), ("JAX scan", False)]
    return [
        Peer(name, "predict-correct, Ts/2", 1e-3, lambda p, name=name: prepare(p, 2, name), "jax", batch=batch)
        for name, batch in ways
    ]


def prepare(problem: Problem, steps: int, way: str) -> Run:
    """Return the simulation of all lanes together, or one after another; it is compiled when first run."""
    import jax

    jax.config.update("jax_enable_x64", True)
    lanes = problem.excitation.shape[0]
    if way == "JAX scan":
        one = jax.jit(_scan(problem, steps, ()))
        return lambda: _arrays(*zip(*(one(excitation) for excitation in problem.excitation), strict=True))
    if way == "JAX scan + vmap":
        together = jax.jit(jax.vmap(_scan(problem, steps, ())))
        return lambda: _arrays(*together(problem.excitation))
    last = jax.jit(_scan(problem, steps, (lanes,)))
    excitation = np.ascontiguousarray(problem.excitation.T)
    return lambda: _arrays(*(channel.T for channel in last(excitation)))


def _arrays(u: Any, y: Any) -> tuple[np.ndarray, np.ndarray]:
    return np.asarray(u), np.asarray(y)


def _scan(problem: Problem, steps: int, lanes: tuple[int, ...]) -> Any:
    """Return the simulation of an excitation of shape (samples, *lanes)."""
    import jax
    import jax.numpy as jnp

    transition, held, ramp = (jnp.asarray(part) for part in problem.exact_step(problem.sample_time / steps))
    c, stiffness, limit = (jnp.asarray(part) for part in (problem.c, problem.stiffness, problem.limit))
    numerator, denominator = jnp.asarray(problem.numerator), jnp.asarray(problem.denominator)
    limit = limit.reshape(-1, *(1 for _ in lanes))
    times = jnp.multiply.outer

    def sample(state: Any, excitation: Any) -> Any:
        x, z, w, pipe, force, last = state
        y = c @ x
        control = w[0] - numerator[0] * y
        w = jnp.concatenate([w[1:] - times(numerator[1:], y) - times(denominator[1:], control), jnp.zeros((1, *lanes))])
        u = control + excitation
        pipe = jnp.concatenate([pipe, u[None]])
        for _ in range(steps):
            x = transition @ x + times(held, pipe[0] - force)
            displacement = c @ x
            z = jnp.clip(z + (displacement - last), -limit, limit)
            before, force, last = force, stiffness @ z, displacement
            x = x - times(ramp, force - before)
        return (x, z, w, pipe[1:], force, last), (u, y)

    sizes = (c.size, stiffness.size, numerator.size, problem.delay)
    rest = (*(jnp.zeros((size, *lanes)) for size in sizes), jnp.zeros(lanes), jnp.zeros(lanes))
    return lambda excitation: jax.lax.scan(sample, rest, excitation)[1]
