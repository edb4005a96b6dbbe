"""jaxonomy: a leaf system with continuous states and a periodic update, traced and compiled by JAX.

Its own `simulate` runs lane by lane; its simulator can also be put under jit and vmap by hand, which is much faster
than `simulate_batch`, as that compiles at each call.
"""

import logging
from typing import Any

import numpy as np

from peers.problem import Peer, Problem, Run


def peers() -> list[Peer]:
    """Return lane by lane and all lanes together, at one instant per sample or two."""
    settings = [("rk4", 0.0, 1, 5e-4), ("rk4", 0.0, 2, 1e-4), ("dopri5", 1e-6, 2, 1e-3)]
    single = [
        Peer(
            "jaxonomy simulate",
            f"{name}, " + (f"rtol {rtol:g}, " if rtol else "fixed, ") + f"Ts/{steps} at most",
            error,
            lambda problem, name=name, rtol=rtol, steps=steps: one_by_one(problem, name, rtol, steps),
            "jaxonomy",
        )
        for name, rtol, steps, error in settings
    ]
    together = [
        Peer(
            "jaxonomy Simulator in jit + vmap",
            f"rk4, fixed, Ts/{steps}",
            error,
            lambda problem, steps=steps: side_by_side(problem, steps),
            "jaxonomy",
            batch=True,
        )
        for steps, error in ((1, 5e-4), (2, 1e-4))
    ]
    return single + together


def one_by_one(problem: Problem, solver: str, rtol: float, steps: int) -> Run:
    """Return the simulation, lane by lane with one compiled kernel."""
    import jaxonomy

    system, template, options, end = _prepared(problem, solver, rtol, steps)

    def run() -> tuple[np.ndarray, np.ndarray]:
        records = []
        for excitation in problem.excitation:
            context = template.with_discrete_state(system.at_rest(excitation))
            done = jaxonomy.simulate(system, context, (0.0, end), options=options)
            records.append([np.asarray(part) for part in done.context.discrete_state[-2:]])
        u, y = np.swapaxes(np.array(records), 0, 1)
        return u, y

    return run


def side_by_side(problem: Problem, steps: int) -> Run:
    """Return the simulation of all lanes at once."""
    import jax
    from jaxonomy.simulation import Simulator

    system, template, options, end = _prepared(problem, "rk4", 0.0, steps)
    simulator = Simulator(system, options=options)

    def lane(excitation: Any) -> Any:
        begun = template.with_discrete_state(system.at_rest(excitation))
        return simulator.advance_to(end, begun).context.discrete_state[-2:]

    lanes = jax.jit(jax.vmap(lane))

    def run() -> tuple[np.ndarray, np.ndarray]:
        u, y = lanes(problem.excitation)
        return np.asarray(u), np.asarray(y)

    return run


def _prepared(problem: Problem, solver: str, rtol: float, steps: int) -> tuple[Any, Any, Any, float]:
    """Return system, context, options and the time just before the first instant after the last sample."""
    from jaxonomy.simulation import SimulatorOptions

    logging.getLogger("jaxonomy").setLevel(logging.WARNING)
    system, samples = _loop_class()(problem, steps), problem.excitation.shape[1]
    tolerances = {"rtol": rtol, "atol": rtol * 1e-6} if rtol else {}
    options = SimulatorOptions(
        ode_solver_method=solver,
        max_minor_step_size=problem.sample_time / steps,
        max_major_steps=samples * steps + 10,
        return_context=True,
        **tolerances,
    )
    return system, system.create_context(), options, (samples - 0.5 / steps) * problem.sample_time


def _loop_class() -> Any:
    import jax.numpy as jnp
    from jaxonomy import LeafSystem

    class Loop(LeafSystem):  # type: ignore[misc]
        """Table and controller; the discrete state is what is held, the controller's memory and the record."""

        def __init__(self, problem: Problem, steps: int) -> None:
            super().__init__(name="loop")
            self.p, self.steps = problem, steps
            self.declare_continuous_state(default_value=jnp.zeros(problem.b.size), ode=self.derivative)
            self.declare_discrete_state(default_value=self.at_rest(problem.excitation[0]), as_array=False)
            self.declare_periodic_update(self.instant, period=problem.sample_time / steps, offset=0.0)

        def at_rest(self, excitation: np.ndarray) -> Any:
            """Count, displacement, deflections, controller, inputs on their way, excitation, recorded u and y."""
            sizes = (self.p.limit.size, self.p.numerator.size, self.p.delay + 1)
            empty = jnp.zeros(excitation.size)
            return (jnp.array(0), jnp.array(0.0), *(jnp.zeros(n) for n in sizes), jnp.asarray(excitation), empty, empty)

        def derivative(self, time: Any, state: Any, *inputs: Any, **parameters: Any) -> Any:
            p, x = self.p, state.continuous_state
            _, start, z, _, pipe, *_ = state.discrete_state
            force = p.stiffness @ jnp.clip(z + (p.c @ x - start), -p.limit, p.limit)
            return p.a @ x + p.b * (pipe[0] - force)

        def instant(self, time: Any, state: Any, *inputs: Any, **parameters: Any) -> Any:
            p = self.p
            count, start, z, w, pipe, excitation, us, ys = state.discrete_state
            y = p.c @ state.continuous_state
            z = jnp.clip(z + (y - start), -p.limit, p.limit)
            k, due = count // self.steps, count % self.steps == 0
            value = w[0] - p.numerator[0] * y
            after = jnp.append(w[1:] - p.numerator[1:] * y - p.denominator[1:] * value, 0.0)
            u = value + excitation[k]
            w, pipe = jnp.where(due, after, w), jnp.where(due, jnp.append(pipe[1:], u), pipe)
            us, ys = us.at[k].set(jnp.where(due, u, us[k])), ys.at[k].set(jnp.where(due, y, ys[k]))
            return count + 1, y, z, w, pipe, excitation, us, ys

    return Loop
