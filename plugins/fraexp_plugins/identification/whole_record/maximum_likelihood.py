"""Plant and friction parameters of greatest likelihood: every sample of the records, through a simulated machine."""

import numpy as np

from fraexp.api import (
    FrictionModel,
    ParameterError,
    Plant,
    PositionDependentFriction,
    Result,
    Signals,
    param,
)
from fraexp_plugins.estimators._shared.delayed_estimator import DelayedEstimator
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.friction.none import Frictionless
from fraexp_plugins.identification._shared.usable_records import (
    check_one_contact,
    check_one_thrust,
    check_segments,
    usable_signals,
)
from fraexp_plugins.identification.whole_record._contact_fit import fit_contacts, machine_of_contacts
from fraexp_plugins.identification.whole_record._fit_report import FitReport
from fraexp_plugins.identification.whole_record._fitted_records import Fitted
from fraexp_plugins.identification.whole_record._free_parameters import SCALES, FreeParameters
from fraexp_plugins.identification.whole_record._joint_fit import NOISE, likely_noise, noise_in_records
from fraexp_plugins.identification.whole_record._staged_fit import (
    MAX_PARAMETER_STD,
    MAX_START_RATIO,
    StagedFit,
)


class MaximumLikelihood(DelayedEstimator, name="maximum_likelihood", version=8):
    """P̂ of greatest likelihood: a simulated machine that repeats all samples of the records, friction included.

    The observer of `effective_input` drives its friction model by measured positions, and takes the small difference of
    two forces. Here the machine itself is simulated along the recorded control input, and plant and friction are those
    with which it most probably gives the samples that were recorded. A sample tells an interval, that of the encoder's
    resolution, widened by its noise: the likelihood is Φ((r + q/2)/σ) - Φ((r - q/2)/σ) for the residual r, step q and
    standard deviation σ (F. Gustafsson and R. Karlsson, Automatica 45(12), 2009). Rounding costs hardly anything then,
    and the parameters of friction come out as well.

    `free` names what is estimated of friction: by default one factor on its force and one on its deflections, for
    which the model may be wrong by a factor of three at the start. They belong to all records; the more records of
    different frequencies and amplitudes there are, the better they are known. The response of each record is its own.
    At harmonics of the excitation, which friction causes, the plant acts as well: as `nominal_plant`, or as the modal
    plant that is fitted to all records together.

    The band is that of the information in the likelihood, with the parameters' part. The metrics are the parameters
    with their 95 % intervals, and the geometric mean of the residuals over what noise and rounding explain, which is 1
    where the model is right. Where it is not, the outcome is not ok, and the message says so: another friction law,
    wrong dead times, unknown noise. Where noise covers the encoder's steps, the residual must be white, too. A
    parameter that the records do not tell is held, and named. Plant and friction are results as components too, where
    the parameters of the law can express the scales.

    An unknown dead time is estimated if `free` names `input_dead_time`: it may be some samples wrong at the start, or
    0, and stands for all dead time of the loop. With `noise` the encoder's noise is estimated from the residual; it
    must not be more than scatter or spectrum of the records show.

    Where noise goes round a loop, no period repeats another. The state at the start of a record is then its own, too.

    With friction at several contacts the response between one thrust and one position does not say how friction at
    another one moves the machine. So the plant is one with ports whose numbers are estimated, `nominal_plant` being the
    start, and P̂ is its response: a mode that it lacks is not found, but shows in the residual. The one position that is
    fed back tells the scales of all contacts if the records have frequencies below and above the modes; below them all
    contacts move alike. The start must be near: friction, its viscous part included, and plant within some ten percent.
    There is one start. A number that is 0 at the start stays 0.

    It needs the steady state of stepped sines or multisines of up to 64 lines. Where friction holds
    the machine nearly still at all frequencies there is nothing to see, by this method neither. Simulation takes time:
    about 0.1 s for each frequency.
    """

    friction: FrictionModel | None = param("", "friction model at the start", None, inherit="friction")
    frictions: dict[str, FrictionModel] = param(
        "", "friction model of each contact at the start, of a machine with several", {}, inherit="friction"
    )
    free: tuple[str, ...] | None = param(
        "",
        "what is estimated: force_scale, displacement_scale, names of the model's numbers, input_dead_time, noise; of "
        "several contacts such as motor.force_scale or stiffness. By default the scales, and with several contacts "
        "their viscous coefficients and all numbers of the plant, too",
        None,
    )
    nominal_plant: Plant | None = param(
        "", "plant at the harmonics, fitted to the response if it is not given; the start, with several contacts", None
    )
    thrust: str = param("", "thrust that is excited, as in the loop", "", inherit="loop.thrust")
    position: str = param("", "position that is fed back, as in the loop", "", inherit="loop.position")
    modes: int | None = param("1", "modes of the fitted plant; chosen if not given", None, at_least=0, at_most=12)
    resolution: float = param("m", "quantisation step of the encoder", 0.0, at_least=0, inherit="loop.resolution")
    noise: float | None = param(
        "m",
        "standard deviation of the encoder's noise; from scatter or spectrum of the periods if it is not given",
        None,
        at_least=0,
        inherit="loop.noise",
    )
    interpolation_tolerance: float = param(
        "1", "relative error of y'/u that is tolerated", 1e-4, at_least=1e-5, at_most=0.1, inherit="numerics.tolerance"
    )

    def model_post_init(self, context: object) -> None:
        """Check the names of the free parameters, and that plant and friction can be replayed."""
        models: dict[str, FrictionModel | None] = {"friction": self.friction}
        models |= {f"frictions.{contact}": model for contact, model in self.frictions.items()}
        for place, model in models.items():
            if isinstance(model, PositionDependentFriction):
                raise ParameterError(
                    f"maximum_likelihood.{place} has a position_dependence, and a replay does not know where on the "
                    "stroke the record was; leave it out, or use an effective input"
                )
        contacts = [] if self.nominal_plant is None else list(self.nominal_plant.ports().contacts)
        if self.frictions:
            if self.nominal_plant is None:
                raise ParameterError("maximum_likelihood.nominal_plant is missing; expected the plant of all contacts")
            return
        if len(contacts) > 1:
            raise ParameterError(
                f"maximum_likelihood.nominal_plant has friction at {len(contacts)} contacts ({', '.join(contacts)}); "
                "give the model of each one in frictions"
            )
        FreeParameters(tuple(name for name in self.own_free if name != NOISE)).check(self.law)

    def estimate(self, signals: Signals) -> Result:
        """Return P̂ with its band, the friction parameters, and how well the model repeats the records."""
        signals.unit(self.input), signals.unit(self.output)
        return self.fit(signals).result() if signals.segments else Result(signals.outcome, signals.findings)

    @property
    def law(self) -> FrictionModel:
        """Friction model of the one contact; ParameterError if there is none."""
        if self.friction is None:
            raise ParameterError("maximum_likelihood.friction is missing; expected the friction model at the start")
        return self.friction

    @property
    def own_free(self) -> tuple[str, ...]:
        """What is estimated of one contact."""
        return SCALES if self.free is None else self.free

    def fit(self, signals: Signals) -> FitReport:
        """Return the fit to signals that have segments."""
        (check_one_thrust if self.frictions else check_one_contact)(signals, self.name)
        used = usable_signals(signals, self.output, self.name)
        check_segments(used, self.name)
        noise = noise_in_records(used, self.output, self.resolution) if self.noise is None else self.noise
        if self.frictions:
            assert self.nominal_plant is not None
            observer, ports = self._observer(Frictionless(), noise), (self.thrust, self.position)
            sample_time = used.segments[0].sample_time
            start = machine_of_contacts(self.nominal_plant, self.frictions, ports, observer, sample_time)
            return fit_contacts(used, start, self.free or (), observer)
        free = tuple(name for name in self.own_free if name != NOISE)
        found, starts = self.staged_fit(used, noise, free).run()
        held = _untold(found)
        if held:
            free = tuple(name for name in free if name not in held)
            found, starts = self.staged_fit(used, noise, free).run()
        if NOISE not in self.own_free:
            return FitReport(used, found, starts, held)
        level = likely_noise(found.linear.records, float(found.fit.freedom.sum()))
        return FitReport(used, found.with_noise(level.value), starts, held, level)

    def staged_fit(self, signals: Signals, noise: float, free: tuple[str, ...]) -> StagedFit:
        """Return what is fitted to signals with this noise [m], if these parameters are free."""
        return StagedFit(signals, self._observer(self.law, noise), FreeParameters(free), self.nominal_plant, self.modes)

    def _observer(self, friction: FrictionModel, noise: float) -> EffectiveInput:
        shared = {name: getattr(self, name) for name in DelayedEstimator.model_fields}
        return EffectiveInput(
            friction=friction,
            resolution=self.resolution,
            noise=noise,
            interpolation_tolerance=self.interpolation_tolerance,
            **shared,
        )


def _untold(found: Fitted) -> tuple[str, ...]:
    """Return the names of friction's parameters that the records do not tell, if the model is right."""
    if found.mean_ratio > MAX_START_RATIO:
        return ()
    std = np.sqrt(np.diag(found.covariances[0]))
    return tuple(name for name, each in zip(found.fit.free.friction, std, strict=False) if each > MAX_PARAMETER_STD)
