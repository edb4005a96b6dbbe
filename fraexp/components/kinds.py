"""What plugins supply: the kinds of component and their contracts."""

import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, cast, get_args

import numpy as np
from pydantic.fields import FieldInfo

from fraexp.components.law_check import rehearse
from fraexp.components.parameters import Parameters
from fraexp.data.results import Result
from fraexp.data.signals import Segment, Signals
from fraexp.errors import PluginError, did_you_mean


def nested_kind(info: FieldInfo) -> "type[Component] | None":
    """Return the kind of component that this parameter holds, or None for plain data."""
    for candidate in (info.annotation, *get_args(info.annotation)):
        if inspect.isclass(candidate) and issubclass(candidate, Component):
            return candidate
    return None


class Component(Parameters, ABC):
    """What a plugin supplies under a name; the subclasses below are the kinds, theirs the components."""

    kind: ClassVar[str] = ""
    """Section of a study that names such a component."""
    name: ClassVar[str] = ""
    """Name in studies and in the store; empty for a kind."""
    version: ClassVar[int] = 0
    """Raised by the author whenever the same parameters give other numbers."""
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {}
    """Named parameter sets, such as that of a paper; a study names one as ``preset`` and may change parts of it."""
    expected_failures: ClassVar[Mapping[str, str]] = {}
    """Checks of `fraexp.testing` that it does not pass by its nature, each with the reason."""

    def __init_subclass__(cls, *, name: str = "", version: int = 0, **kwargs: Any) -> None:
        for option in kwargs:
            near = did_you_mean(option, ("name", "version"))
            raise PluginError(f"class {cls.__name__} is given '{option}', which no component takes{near}")
        super().__init_subclass__()  # pydantic hands class arguments to both hooks

    @classmethod
    def __pydantic_init_subclass__(cls, *, name: str = "", version: int = 0, **kwargs: Any) -> None:
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
        if not cls.kind:
            raise PluginError(f"{name} is of no kind; derive it from FrictionModel, Plant, Controller or another kind")
        missing = sorted(getattr(cls, "__abstractmethods__", ()))
        if missing:
            raise PluginError(f"{name} lacks {', '.join(missing)}, which every {cls.kind} has")
        _check_overrides(cls)
        cls.check_definition()

    @classmethod
    def check_definition(cls) -> None:
        """Raise PluginError if the class breaks its kind's contract in a way that can be seen without running it."""

    def spec(self) -> dict[str, Any]:
        """Return the plain data that identifies this component: name, version and parameters."""
        return {"name": self.name, "version": self.version, **self.plain()}


def _check_overrides(cls: type[Component]) -> None:
    """Raise PluginError for a method that cannot be called as its kind's, or that ought to be a property."""
    kind = next(base for base in KINDS if issubclass(cls, base))
    for name, expected in vars(kind).items():
        found = inspect.getattr_static(cls, name)
        if isinstance(expected, property) and inspect.isfunction(found):
            raise PluginError(f"{cls.name}.{name} is a method; expected a property: put @property above it")
        if inspect.isfunction(expected) and inspect.isfunction(found):
            wanted = [key for key, one in inspect.signature(expected).parameters.items() if one.default is one.empty]
            try:
                inspect.signature(found).bind(*wanted)
            except TypeError:
                has = ", ".join(inspect.signature(found).parameters)
                raise PluginError(f"{cls.name}.{name} takes ({has}); expected ({', '.join(wanted)})") from None


class FrictionModel(Component, ABC):
    """A friction law in displacement: force from the displacement's increments and a memory of its own.

    The law is one pure function that fraexp compiles; it must be written in the subset of Python that numba
    compiles, and may use `math`. It is called by the loop (several times a step, hence `z` must not be
    written), by the observer and by tests::

        @staticmethod
        def advance(z, dy, dt, z_next, stiffness, coulomb):
            "Friction force [N] after the displacement moved by dy [m] in dt [s]."

    `z` and `z_next` are float64 arrays of `state_size` elements. The arguments after `z_next` are named after
    attributes of the model; a sequence reaches the law as a float64 array.
    """

    kind: ClassVar[str] = "friction"
    states: ClassVar[tuple[str, ...]] = ()
    """Name and unit of each element of z, such as ``("force [N]",)``."""

    advance: ClassVar[Any]

    @classmethod
    def check_definition(cls) -> None:
        law = getattr(cls, "advance", None)
        if not isinstance(inspect.getattr_static(cls, "advance", None), staticmethod) or law is None:
            raise PluginError(f"{cls.name} lacks the static method advance(z, dy, dt, z_next, ...)")
        names = list(inspect.signature(law).parameters)
        if names[:4] != ["z", "dy", "dt", "z_next"]:
            raise PluginError(
                f"{cls.name}.advance takes ({', '.join(names[:4])}, ...); expected (z, dy, dt, z_next, ...)"
            )
        for name in names[4:]:
            if name not in cls.model_fields and not hasattr(cls, name):
                raise PluginError(
                    f"{cls.name}.advance takes '{name}', which is no parameter{did_you_mean(name, cls.model_fields)}"
                )

    @property
    def state_size(self) -> int:
        """Number of elements of z."""
        return len(self.states)

    @property
    def viscous(self) -> float:
        """Linear viscous coefficient [N s/m] on top of the law; loop and observer treat it exactly."""
        return 0.0

    @property
    def forgets(self) -> bool:
        """Whether a periodic motion has one periodic force, but for a constant, whatever came before."""
        return False

    @property
    def force_bound(self) -> float | None:
        """Greatest magnitude [N] that the law's force can reach, such as Fs; None if it has none, or does not say."""
        return None

    @property
    def greatest_stiffness(self) -> float:
        """Greatest slope of force over displacement [N/m] that the loop's step must resolve.

        Unless a model knows better: twice the slope at rest, as after a reversal from full slip.
        """
        z, z_next = np.zeros((2, max(self.state_size, 1)))
        return 2 * abs(self.law(z, PROBE, PROBE / SLOW, z_next, *self.law_arguments())) / PROBE

    @property
    def law(self) -> Callable[..., float]:
        """The function that is compiled: `advance`, unless a model puts its law together from others."""
        return cast(Callable[..., float], type(self).advance)

    @cached_property
    def vectorises(self) -> bool:
        """Whether the law can be computed for several machines at once: it takes no branch on a value."""
        from fraexp.kernels.drive import vectorises  # numba: imported only when a law is run

        return vectorises(self.law, self.law_arguments())

    def law_arguments(self) -> tuple[Any, ...]:
        """Return the values that the law takes after z_next: floats, and float64 arrays for sequences."""
        names = list(inspect.signature(type(self).advance).parameters)[4:]
        values = (getattr(self, name) for name in names)
        return tuple(
            np.asarray(value, dtype=float) if isinstance(value, tuple | list | np.ndarray) else float(value)
            for value in values
        )

    def rehearse(self) -> None:
        """Walk with the law in plain Python; PluginError where compiled code would go wrong without a word.

        Indices beyond `state_size`, writes to `z` or to a parameter, and a force that is no number are found here,
        also where the law goes only after it has slipped, turned, or moved fast or slowly for long, and a law that
        never returns.
        """
        rehearse(self.name, self.law, self.law_arguments(), self.state_size, lambda: self.greatest_stiffness)

    def force(self, displacement: np.ndarray, time_step: float, periodic: bool = False) -> np.ndarray:
        """Return the law's force [N], shape (n,), along a displacement record [m], shape (n,), without `viscous`.

        The record starts from the state at rest; one that is one or more whole periods is answered with the
        periodic force if `periodic`.
        """
        return self.forces([Motion(displacement, time_step, periodic)])[0]

    def forces(self, motions: "Sequence[Motion]") -> list[np.ndarray]:
        """Return the law's force [N] along each of several motions: much faster than one after another."""
        from fraexp.kernels.drive import drive  # numba: imported only when a law is run

        self.rehearse()
        if not motions:
            return []
        wide = len(motions) > 1 and self.vectorises
        return drive(self.law, self.law_arguments(), self.state_size, motions, wide)


class Motion(NamedTuple):
    """A displacement along which a friction model is driven."""

    displacement: np.ndarray
    """Displacement [m], shape (n,)."""
    time_step: float
    """Its time step [s]."""
    periodic: bool = False
    """Whether the displacement is one or more whole periods, and the periodic force is wanted."""
    lead_in: np.ndarray = np.empty(0)
    """Displacement before, from rest [m]."""
    lead_in_step: float = 1.0
    """Its time step [s]."""


PROBE, SLOW = 1e-9, 1e-9
"""A displacement [m] that lets no friction slip, and a velocity [m/s] without rate effects."""


@dataclass(frozen=True)
class StateSpace:
    """A linear single-input single-output system ẋ = A x + b u, y = c x."""

    a: np.ndarray
    """Shape (n, n)."""
    b: np.ndarray
    """Shape (n,)."""
    c: np.ndarray
    """Shape (n,)."""


class Plant(Component, ABC):
    """The linear plant P(s), from effective thrust [N] to table displacement [m]."""

    kind: ClassVar[str] = "plant"

    @abstractmethod
    def state_space(self) -> StateSpace:
        """Return a state-space realisation of P(s)."""

    @abstractmethod
    def response(self, omega: np.ndarray) -> np.ndarray:
        """Return P(jω) [m/N], shape (n,), at angular frequencies omega [rad/s], shape (n,)."""


class Controller(Component, ABC):
    """The feedback controller C(z), from position error [m] to thrust [N]."""

    kind: ClassVar[str] = "controller"

    @abstractmethod
    def transfer_function(self, sample_time: float) -> tuple[np.ndarray, np.ndarray]:
        """Return numerator and denominator in ascending powers of z⁻¹, the denominator starting with 1."""

    def response(self, omega: np.ndarray, sample_time: float) -> np.ndarray:
        """Return C(e^{jωTs}) [N/m], shape (n,), at angular frequencies omega [rad/s], shape (n,)."""
        numerator, denominator = self.transfer_function(sample_time)
        delay = np.exp(-1j * np.asarray(omega) * sample_time)
        return np.polynomial.polynomial.polyval(delay, numerator) / np.polynomial.polynomial.polyval(delay, denominator)


@dataclass(frozen=True)
class Period:
    """One period of an excitation, and the harmonics of it that it excites."""

    waveform: np.ndarray
    """Samples [N or m], shape (n,)."""
    lines: np.ndarray
    """Excited harmonics of the period, ascending, shape (lines,) of int."""
    reference: np.ndarray | None = None
    """How the position reference moves around that of the loop meanwhile [m], shape (n,); None if it rests."""


class Excitation(Component, ABC):
    """Periodic excitations, run one after another, each until successive periods agree."""

    kind: ClassVar[str] = "excitation"
    quantity: ClassVar[str] = "force"
    """What is excited: ``force`` at the control input of the loop, or ``displacement`` of a friction model."""
    rounds: ClassVar[int] = 1
    """How often a period is run, about: more than once where `revise` asks for it."""

    def check(self, sample_time: float) -> None:
        """Raise ParameterError if it cannot be sampled at `sample_time` [s]: asked before anything is run."""

    @abstractmethod
    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return one period of each experiment, sampled at `sample_time` [s]."""

    def revise(self, period: Period, segment: Segment) -> Period | None:
        """Return the period to be run in place of one that was recorded, or None if its record will do.

        For excitations that aim at something, such as an amplitude of the displacement.
        """
        return None

    def greatest(self) -> tuple[float | None, float | None]:
        """Return the greatest force [N] and stroke [m] that revised periods may ask for; None where `periods` tell."""
        return None, None

    def remark(self, segments: Sequence[Segment]) -> str:
        """Return what there is to say of what was recorded, such as an aim that was missed; empty if nothing."""
        return ""

    @property
    @abstractmethod
    def schedule(self) -> "Schedule":
        """How each experiment is brought to its periodic state and recorded."""


@dataclass(frozen=True)
class Schedule:
    """How a periodic experiment is started, settled and recorded."""

    ramp: float = 0.0
    """Time over which the amplitude rises [s]."""
    tolerance: float = 1e-6
    """Relative difference of successive periods at which the response counts as periodic."""
    settle_limit: float = 60.0
    """Time after which settling is given up [s]; 0 to record from the start."""
    periods: int = 1
    """Periods that are recorded once settled, at least."""
    record_time: float = 0.0
    """Time that is recorded once settled, at least [s]."""


class Estimator(Component, ABC):
    """A frequency response (or another result) from signals."""

    kind: ClassVar[str] = "estimator"
    fits: ClassVar[str] = ""
    """Kind of component that it identifies from the response of another estimator, its `method`; empty for none."""

    @abstractmethod
    def estimate(self, signals: Signals) -> Result:
        """Return what the signals teach."""


class RecordReader(Component, ABC):
    """A file format of measured records."""

    kind: ClassVar[str] = "reader"
    suffixes: ClassVar[tuple[str, ...]] = ()
    """File name endings that it reads, such as ``.csv``."""

    @abstractmethod
    def read(self, path: Path, columns: Sequence[str]) -> "RecordTable":
        """Return the named columns of a file; RecordError says what is wrong and which columns exist."""


@dataclass(frozen=True)
class RecordTable:
    """Columns of a measured record as they stand in the file."""

    columns: Mapping[str, np.ndarray]
    """Each of shape (n,)."""
    sample_time: float | None = None
    """Sample time [s] if the file states one."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Unit of each column of which the file tells it."""


KINDS: tuple[type[Component], ...] = (FrictionModel, Plant, Controller, Excitation, Estimator, RecordReader)
