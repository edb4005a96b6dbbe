"""Drake: a leaf system with continuous states, a compiled right-hand side and a periodic discrete update."""

from typing import Any

from peers.problem import Peer, Problem, Run
from peers.table import Lane, all_lanes, right_hand_side


def peers() -> list[Peer]:
    """Return the integrators, at one instant per sample or two."""
    settings = [("runge_kutta3", 0.0, 1, 3e-3), ("runge_kutta3", 0.0, 2, 5e-4), ("runge_kutta3", 1e-4, 2, 5e-4)]
    return [
        Peer(
            "Drake",
            f"{name}, " + (f"accuracy {accuracy:g}, " if accuracy else "fixed, ") + f"Ts/{steps} at most",
            error,
            lambda problem, name=name, accuracy=accuracy, steps=steps: prepare(problem, name, accuracy, steps),
            "pydrake",
        )
        for name, accuracy, steps, error in settings
    ]


def prepare(problem: Problem, integrator: str, accuracy: float, steps: int) -> Run:
    """Return the simulation, with `steps` instants per sample; without an accuracy in fixed steps between them."""
    from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator

    table, derivative = _table_class(), right_hand_side(problem)
    step = problem.sample_time / steps

    def lane(number: int) -> Lane:
        one = Lane(problem, number, steps)
        simulator = Simulator(table(one, step, problem.b.size, derivative))
        chosen = ResetIntegratorFromFlags(simulator, integrator, step)
        if accuracy:
            chosen.set_target_accuracy(accuracy)
        else:
            chosen.set_fixed_step_mode(True)
        simulator.AdvanceTo(problem.excitation.shape[1] * problem.sample_time)
        return one

    return all_lanes(problem, lane)


def _table_class() -> Any:
    from pydrake.systems.framework import LeafSystem

    class Table(LeafSystem):  # type: ignore[misc]
        """The table, its thrust and friction memory held as discrete state."""

        def __init__(self, lane: Lane, step: float, size: int, derivative: Any) -> None:
            LeafSystem.__init__(self)
            self.lane, self.derivative = lane, derivative
            self.DeclareContinuousState(size)
            self.held = self.DeclareDiscreteState(lane.held.size)
            self.DeclarePeriodicDiscreteUpdateEvent(step, 0.0, self.instant)

        def DoCalcTimeDerivatives(self, context: Any, derivatives: Any) -> None:  # noqa: N802
            """Call the compiled right-hand side."""
            x = context.get_continuous_state_vector().CopyToVector()
            derivatives.SetFromVector(self.derivative(x, context.get_discrete_state(self.held).value()))

        def instant(self, context: Any, discrete: Any) -> None:
            """Latch the friction, and sample where it is time."""
            self.lane.latch(context.get_continuous_state_vector().CopyToVector())
            discrete.set_value(self.held, self.lane.held)

    return Table
