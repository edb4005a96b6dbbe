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
from fraexp_plugins.identification._shared.usable_records import check_one_contact, check_segments, usable_signals
from fraexp_plugins.identification.whole_record._fit_report import FitReport
from fraexp_plugins.identification.whole_record._fitted_records import Fitted
from fraexp_plugins.identification.whole_record._free_parameters import SCALES, FreeParameters
from fraexp_plugins.identification.whole_record._joint_fit import NOISE, likely_noise, noise_in_records
from fraexp_plugins.identification.whole_record._staged_fit import (
    MAX_PARAMETER_STD,
    MAX_START_RATIO,
    StagedFit,
)


class MaximumLikelihood(DelayedEstimator, name="maximum_likelihood", version=7):
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

    It needs the steady state of stepped sines or multisines of up to 64 lines, from one contact. Where friction holds
    the machine nearly still at all frequencies there is nothing to see, by this method neither. Simulation takes time:
    about 0.1 s for each frequency.
    """

    friction: FrictionModel = param("", "friction model at the start", inherit="friction")
    free: tuple[str, ...] = param(
        "",
        "what is estimated: force_scale, displacement_scale, names of the model's numbers, input_dead_time, noise",
        SCALES,
    )
    nominal_plant: Plant | None = param("", "plant at the harmonics; fitted to the response if it is not given", None)
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
        if isinstance(self.friction, PositionDependentFriction):
            raise ParameterError(
                "maximum_likelihood.friction has a position_dependence, and a replay does not know where on the stroke "
                "the record was; leave it out, or use effective_input"
            )
        FreeParameters(tuple(name for name in self.free if name != NOISE)).check(self.friction)
        contacts = [] if self.nominal_plant is None else list(self.nominal_plant.ports().contacts)
        if len(contacts) > 1:
            raise ParameterError(
                f"maximum_likelihood.nominal_plant has friction at {len(contacts)} contacts ({', '.join(contacts)}); "
                "expected one: use multi_contact_maximum_likelihood"
            )

    def estimate(self, signals: Signals) -> Result:
        """Return P̂ with its band, the friction parameters, and how well the model repeats the records."""
        signals.unit(self.input), signals.unit(self.output)
        return self.fit(signals).result() if signals.segments else Result(signals.outcome, signals.message)

    def fit(self, signals: Signals) -> FitReport:
        """Return the fit to signals that have segments."""
        check_one_contact(signals, self.name)
        used = usable_signals(signals, self.output, self.name)
        check_segments(used, self.name)
        noise = noise_in_records(used, self.output, self.resolution) if self.noise is None else self.noise
        free = tuple(name for name in self.free if name != NOISE)
        found, starts = self.staged_fit(used, noise, free).run()
        held = _untold(found)
        if held:
            free = tuple(name for name in free if name not in held)
            found, starts = self.staged_fit(used, noise, free).run()
        if NOISE not in self.free:
            return FitReport(used, found, starts, held)
        level = likely_noise(found.linear.records, float(found.fit.freedom.sum()))
        return FitReport(used, found.with_noise(level.value), starts, held, level)

    def staged_fit(self, signals: Signals, noise: float, free: tuple[str, ...]) -> StagedFit:
        """Return what is fitted to signals with this noise [m], if these parameters are free."""
        shared = {name: getattr(self, name) for name in DelayedEstimator.model_fields}
        observer = EffectiveInput(
            friction=self.friction,
            resolution=self.resolution,
            noise=noise,
            interpolation_tolerance=self.interpolation_tolerance,
            **shared,
        )
        return StagedFit(signals, observer, FreeParameters(free), self.nominal_plant, self.modes)


def _untold(found: Fitted) -> tuple[str, ...]:
    """Return the names of friction's parameters that the records do not tell, if the model is right."""
    if found.mean_ratio > MAX_START_RATIO:
        return ()
    std = np.sqrt(np.diag(found.covariances[0]))
    return tuple(name for name, each in zip(found.fit.free.friction, std, strict=False) if each > MAX_PARAMETER_STD)
