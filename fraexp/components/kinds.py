"""The kinds of component that plugins provide, and their contracts."""

import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray
from pydantic.fields import FieldInfo

from fraexp.components.law_step import argument_names, check_law, explained_calls
from fraexp.components.machine_session import MachineSession, offers_disable
from fraexp.components.parameters import Parameters
from fraexp.components.periods import Period, Schedule
from fraexp.components.ports import Ports, StateSpace
from fraexp.data.findings import Finding
from fraexp.data.results import Result
from fraexp.data.signals import RecordTable, Segment, Signals
from fraexp.errors import PluginError, did_you_mean

if TYPE_CHECKING:  # numba: imported only when a law is run
    from fraexp.components.periods import Feedforward
    from fraexp.kernels.law_arguments import LawArgument


def nested_kind(info: FieldInfo) -> "type[Component] | None":
    """Return the kind of component that this parameter holds, or None for plain data."""
    for candidate in (info.annotation, *get_args(info.annotation)):
        if inspect.isclass(candidate) and issubclass(candidate, Component):
            return candidate
    return None


def parameter_group(info: FieldInfo) -> type[Parameters] | None:
    """Return the type of the parameters that this one groups, such as the curve of a friction model, or None."""
    for candidate in (info.annotation, *get_args(info.annotation)):
        if inspect.isclass(candidate) and issubclass(candidate, Parameters) and not issubclass(candidate, Component):
            return candidate
    return None


def named_kind(info: FieldInfo) -> "type[Component] | None":
    """Return the kind of the components that this parameter names, such as a list of friction laws, or None."""
    for candidate in get_args(info.annotation):
        for of in get_args(candidate) if get_origin(candidate) is type else ():
            if inspect.isclass(of) and issubclass(of, Component):
                return of
    return None


class Component(Parameters, ABC):
    """What a plugin provides under a name; the subclasses below are the kinds, theirs the components."""

    kind: ClassVar[str] = ""
    """Kind of component: the section of a study that names one."""
    name: ClassVar[str] = ""
    """Name in studies and in the database; empty for a kind."""
    version: ClassVar[int] = 0
    """Version, which the author raises whenever the same parameters give other numbers."""
    presets: ClassVar[Mapping[str, Mapping[str, object]]] = {}
    """Named parameter sets, such as that of a paper; a study names one as ``preset`` and may change parts of it."""
    expected_failures: ClassVar[Mapping[str, str]] = {}
    """Checks of `fraexp.testing` that it fails by its nature, each with the reason."""

    def __init_subclass__(cls, *, name: str = "", version: int = 0, **kwargs: object) -> None:
        for option in kwargs:
            near = did_you_mean(option, ("name", "version"))
            raise PluginError(f"class {cls.__name__} has the unknown argument '{option}'{near}")
        super().__init_subclass__()  # pydantic hands class arguments to both hooks

    @classmethod
    def __pydantic_init_subclass__(cls, *, name: str = "", version: int = 0, **kwargs: object) -> None:
        super().__pydantic_init_subclass__(**kwargs)
        if not name:
            return
        if not isinstance(version, int):
            raise PluginError(
                f"{name} has version {version!r}; expected a whole number, raised when its numbers change"
            )
        cls.name, cls.version = name, version
        taken = {"name", "version", "preset"} & set(cls.model_fields)
        if taken:
            raise PluginError(f"{name}: a parameter cannot be called '{taken.pop()}'; choose another name")
        for key, info in cls.model_fields.items():
            if isinstance(info.default, property):
                raise PluginError(f"{name}: '{key}' is a parameter and a property; expected one of them")
        if not cls.kind:
            raise PluginError(f"{name} has no kind; derive it from FrictionModel, Plant, Controller or another kind")
        missing = sorted(getattr(cls, "__abstractmethods__", ()))
        if missing:
            raise PluginError(f"{name} lacks {', '.join(missing)}, which every {cls.kind} has")
        check_overrides(cls, next(base for base in KINDS if issubclass(cls, base)))
        cls.check_definition()

    @classmethod
    def check_definition(cls) -> None:
        """Raise PluginError if the class visibly breaks its kind's contract, without running it."""

    def spec(self) -> dict[str, Any]:
        """Return the plain data that identifies this component: name, version and parameters."""
        return {"name": self.name, "version": self.version, **self.plain()}


class FrictionModel(Component, ABC):
    """A friction law in displacement: force from the displacement's increments and a memory of its own.

    The law is one pure function that fraexp compiles; it must be written in the subset of Python that numba
    compiles, and may use `math`. The loop calls it several times a step, hence it must not write `z`; the observer
    and tests call it too::

        @staticmethod
        def advance(z, dy, dt, z_next, stiffness, coulomb_force):
            "Friction force [N] after the displacement moved by dy [m] in dt [s]."

    `z` and `z_next` are float64 arrays of `state_size` elements. The arguments after `z_next` are named after
    attributes of the model; a sequence reaches the law as a float64 array.
    """

    kind: ClassVar[str] = "friction"
    states: ClassVar[tuple[str, ...]] = ()
    """Name and unit of each element of z, such as ``("force [N]",)``."""

    advance: ClassVar[Callable[..., float]]

    @classmethod
    def check_definition(cls) -> None:
        law = getattr(cls, "advance", None)
        if not isinstance(inspect.getattr_static(cls, "advance", None), staticmethod) or law is None:
            raise PluginError(f"{cls.name} lacks the static method advance(z, dy, dt, z_next, ...)")
        states = inspect.getattr_static(cls, "states", ())
        if isinstance(states, str | int | float):
            raise PluginError(f"{cls.name}.states is {states!r}; expected a tuple of names, such as ('force [N]',)")
        names = list(inspect.signature(law).parameters)
        if names[:4] != ["z", "dy", "dt", "z_next"]:
            raise PluginError(
                f"{cls.name}.advance takes ({', '.join(names[:4])}, ...); expected (z, dy, dt, z_next, ...)"
            )
        for name in names[4:]:
            if name not in cls.model_fields and not hasattr(cls, name):
                raise PluginError(
                    f"{cls.name}.advance takes '{name}', which is not a parameter{did_you_mean(name, cls.model_fields)}"
                )

    @property
    def state_size(self) -> int:
        """Number of elements of z."""
        return len(self.states)

    @property
    def viscous(self) -> float:
        """Linear viscous coefficient [N s/m] on top of the law; loop and observer treat it exactly.

        By default the parameter `viscous_coefficient`, if the model has one.
        """
        return float(getattr(self, "viscous_coefficient", 0.0))

    @property
    def has_unique_periodic_force(self) -> bool:
        """Whether a periodic motion has one periodic force, apart from a constant, whatever came before."""
        return False

    @property
    def force_bound(self) -> float | None:
        """Maximum magnitude [N] of the law's force, such as Fs; None if it is unbounded or unknown."""
        return None

    @property
    def max_stiffness(self) -> float:
        """Maximum slope of force over displacement [N/m], which the loop's step must resolve.

        By default twice the slope at rest, as after a reversal from gross sliding.
        """
        return 2 * self.stiffness_in_step(PROBE_M / PROBE_VELOCITY_M_S)

    def stiffness_in_step(self, time_step: float) -> float:
        """Return the slope of force over displacement [N/m] at rest, rates in a step of `time_step` [s] included."""
        z, z_next = np.zeros((2, max(self.state_size, 1)))
        return abs(self.law(z, PROBE_M, time_step, z_next, *self.law_arguments())) / PROBE_M

    @property
    def law(self) -> Callable[..., float]:
        """The function that is compiled: `advance`, unless a model composes its law from others."""
        return type(self).advance

    @cached_property
    def is_vectorisable(self) -> bool:
        """Whether the law can be computed for several machines at once: it must not branch on a value."""
        from fraexp.kernels.prescribed_motion import can_vectorise  # numba: imported only when a law is run

        return can_vectorise(self.law, self.law_arguments())

    @property
    def velocity_law(self) -> Callable[..., float] | None:
        """The force as a function of velocity dy/dt alone, which jumps at rest, with `advance`'s arguments; or None.

        The loop then finds stick and slip exactly, without `advance`: at rest the force is whatever balances the
        thrust, between the law's limits on either side.
        """
        return None

    def law_arguments(self) -> "tuple[LawArgument, ...]":
        """Return the values that the law takes after z_next: floats, and float64 arrays for sequences."""
        values = (getattr(self, name) for name in argument_names(type(self).advance))
        return tuple(
            np.asarray(value, dtype=float) if isinstance(value, tuple | list | np.ndarray) else float(value)
            for value in values
        )

    def check_law(self, time_step: float | None = None) -> None:
        """Run the law along a test motion in plain Python; PluginError for what `law_step.check_law` finds.

        The motion slips, turns, and goes fast and slowly for long; with `time_step` [s] it is a few steps of that time.
        """
        for law in filter(None, (self.law, self.velocity_law)):
            check_law(self.name, law, self.law_arguments(), self.state_size, lambda: self.max_stiffness, time_step)

    def force(self, displacement: NDArray[np.float64], time_step: float, periodic: bool = False) -> NDArray[np.float64]:
        """Return the law's force [N], shape (n,), along a displacement record [m], shape (n,), without `viscous`.

        The record starts from the state at rest. With `periodic` it must be one or more whole periods, and the force is
        the periodic one.
        """
        return self.forces([Motion(displacement, time_step, periodic)])[0]

    def forces(self, motions: "Sequence[Motion]") -> list[NDArray[np.float64]]:
        """Return the law's force [N] along each of several motions: much faster than one by one."""
        from fraexp.kernels.prescribed_motion import friction_forces  # numba: imported only when a law is run

        self.check_law()
        if not motions:
            return []
        is_vectorised, arguments = len(motions) > 1 and self.is_vectorisable, self.law_arguments()
        with explained_calls(self.name, arguments):
            return friction_forces(self.law, arguments, self.state_size, motions, is_vectorised)


class Motion(NamedTuple):
    """A displacement along which a friction model is driven."""

    displacement: NDArray[np.float64]
    """Displacement [m], shape (n,)."""
    time_step: float
    """Time step of the displacement [s]."""
    periodic: bool = False
    """Whether the displacement is one or more whole periods whose periodic force is asked for."""
    lead_in: NDArray[np.float64] = np.empty(0)
    """Displacement before the motion, from rest [m], shape (m,)."""
    lead_in_step: float = 1.0
    """Time step of the lead-in [s]."""


PROBE_M, PROBE_VELOCITY_M_S = 1e-9, 1e-9
"""A displacement at which no friction slips, and a velocity without rate effects."""


class Plant(Component, ABC):
    """The linear plant P(s), from effective thrust [N] to table displacement [m]."""

    kind: ClassVar[str] = "plant"

    @abstractmethod
    def state_space(self) -> StateSpace:
        """Return a state-space realisation of P(s)."""

    def ports(self) -> Ports:
        """Return where forces act and positions are measured: by default one place, where friction acts as well."""
        return Ports.from_state_space(self.state_space())

    @abstractmethod
    def response(self, omega: NDArray[np.floating]) -> NDArray[np.complex128]:
        """Return P(jω) [m/N], shape (n,), at angular frequencies omega [rad/s], shape (n,)."""


class Controller(Component, ABC):
    """The feedback controller C(z), from position error [m] to thrust [N]."""

    kind: ClassVar[str] = "controller"

    @abstractmethod
    def transfer_function(self, sample_time: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return numerator and denominator in ascending powers of z⁻¹; the denominator starts with 1."""

    def reference_numerator(self, sample_time: float) -> NDArray[np.float64]:
        """Return the numerator by which exported feedback acts on the reference, over the same denominator.

        By default C(z) without its zeros, with the same gain at rest: nothing is derived from a reference that jumps.
        The sum of the coefficients is that of C(z)'s numerator.
        """
        return np.array([self.transfer_function(sample_time)[0].sum()])

    def response(self, omega: NDArray[np.floating], sample_time: float) -> NDArray[np.complex128]:
        """Return C(e^{jωTs}) [N/m], shape (n,), at angular frequencies omega [rad/s], shape (n,)."""
        numerator, denominator = self.transfer_function(sample_time)
        delay, polyval = np.exp(-1j * np.asarray(omega) * sample_time), np.polynomial.polynomial.polyval
        return np.asarray(polyval(delay, numerator) / polyval(delay, denominator), dtype=np.complex128)


KINDS_BY_PORT = (FrictionModel.kind, Controller.kind)
"""Kinds of which a machine may have several: a friction model for each contact, a controller for each thrust."""


class Excitation(Component, ABC):
    """Periodic excitations, run one after another, each until successive periods agree."""

    kind: ClassVar[str] = "excitation"
    quantity: ClassVar[str] = "force"
    """What is excited: ``force`` at the control input of the loop, or ``displacement`` of a friction model."""
    rounds: ClassVar[int] = 1
    """Expected number of times that a period is run: above 1 if `revise` asks for more."""

    def check(self, sample_time: float) -> None:
        """Raise ParameterError if it cannot be sampled at `sample_time` [s]; called before anything runs."""

    @abstractmethod
    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return one period of each experiment, sampled at `sample_time` [s]."""

    def revise(self, period: Period, segment: Segment) -> Period | None:
        """Return the period to run in place of one that was recorded, or None to keep the record.

        For excitations with a target, such as an amplitude of the displacement.
        """
        return None

    def max_force_and_stroke(self) -> tuple[float | None, float | None]:
        """Return the maximum force [N] and stroke [m] of revised periods; None for one that `periods` shows."""
        return None, None

    def findings(self, segments: Sequence[Segment]) -> tuple[Finding, ...]:
        """Return what is to be known of the record, such as a target that was missed; empty for nothing."""
        return ()

    def feedforward(self, sample_time: float) -> "Feedforward | None":
        """Return the feedforward of a motion from target to target, or None for an excitation that is none."""
        return None

    @property
    @abstractmethod
    def schedule(self) -> Schedule:
        """How each experiment settles to its periodic state and is recorded."""


class Estimator(Component, ABC):
    """A method that computes a frequency response, or another result, from signals."""

    kind: ClassVar[str] = "estimator"
    fits: ClassVar[str] = ""
    """Kind of component that it identifies from the response of another estimator, its `method`; empty for none."""
    takes_responses: ClassVar[bool] = False
    """Whether it takes a response that was measured elsewhere: sines of which only the fundamental is known."""

    @abstractmethod
    def estimate(self, signals: Signals) -> Result:
        """Return the result that the signals give."""

    def relies_on(self, frequency: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return at which frequencies [Hz] its result needs the response, shape (n,): all, unless it fits some."""
        return np.ones(frequency.size, dtype=bool)

    def resolve_for(self, signals: Signals) -> Self:
        """Return the estimator with what it chooses by itself along these signals, such as a number of points."""
        return self

    def matched(self, machine: Mapping[str, object]) -> "Estimator | None":
        """Return the estimator that knows a simulated machine, whose response without friction must be the plant.

        `machine` has its friction model, dead times and lags by the names of parameters. None if friction stays in.
        """
        return None


class RecordReader(Component, ABC):
    """A file format of measured records."""

    kind: ClassVar[str] = "reader"
    suffixes: ClassVar[tuple[str, ...]] = ()
    """File name suffixes that it reads, such as ``.csv``."""

    def recognises(self, path: Path) -> bool:
        """Say whether a file is evidently of this format, and this reader preferred to others."""
        return False

    @abstractmethod
    def read(self, path: Path, columns: Sequence[str]) -> RecordTable:
        """Return the named columns of a file; RecordError states the fault, and which columns exist."""


class MachineDriver(Component, ABC):
    """A machine that plays excitations and records what it does."""

    kind: ClassVar[str] = "machine"

    @abstractmethod
    def connect(self, folder: Path) -> MachineSession:
        """Return the connected machine; `folder` is the workspace's. MachineError if it cannot be reached."""

    def address(self, folder: Path) -> str:
        """Return what tells the machine from others, so that one process at a time plays on it; empty: nothing does."""
        return ""

    def consent(self, folder: Path) -> str:
        """Return all that the machine runs, or reaches over a network, as words after "the study would".

        The user has to allow it. It is empty for a machine that does nothing of the kind.
        """
        return ""

    @property
    def can_disable(self) -> bool | None:
        """Whether its sessions can switch the drive off, by the class that `connect` says it returns; None if it says
        none.
        """
        session = get_type_hints(type(self).connect).get("return")
        is_known = isinstance(session, type) and session is not MachineSession
        return offers_disable(session) if is_known and session is not None else None


KINDS: tuple[type[Component], ...] = (
    FrictionModel, Plant, Controller, Excitation, Estimator, RecordReader, MachineDriver,
)  # fmt: skip


def check_overrides(cls: type, kind: type) -> None:
    """Raise PluginError for a method that cannot be called as that of its kind, or that must be a property."""
    name_of_class = getattr(cls, "name", cls.__name__)
    for name, expected in vars(kind).items():
        found = inspect.getattr_static(cls, name)
        if isinstance(expected, property) and inspect.isfunction(found):
            raise PluginError(f"{name_of_class}.{name} is a method; expected a property: put @property above it")
        if inspect.isfunction(expected) and inspect.isfunction(found):
            wanted = [key for key, one in inspect.signature(expected).parameters.items() if one.default is one.empty]
            try:
                inspect.signature(found).bind(*wanted)
            except TypeError:
                has = ", ".join(inspect.signature(found).parameters)
                raise PluginError(f"{name_of_class}.{name} takes ({has}); expected ({', '.join(wanted)})") from None
