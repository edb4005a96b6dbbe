"""Plant and friction parameters of greatest likelihood: every sample of the records, through a simulated machine."""

from collections.abc import Sequence

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
from fraexp_plugins.identification._shared.law_numbers import shape_parameters
from fraexp_plugins.identification._shared.usable_records import (
    check_one_contact,
    check_one_thrust,
    check_segments,
    usable_signals,
)
from fraexp_plugins.identification.whole_record._fit_report import FitReport
from fraexp_plugins.identification.whole_record._joint_fit import likely_noise, noise_in_records
from fraexp_plugins.identification.whole_record._law_selection import try_laws, with_verdict
from fraexp_plugins.identification.whole_record._machine_fit import Fitted, fit_machine, least_told
from fraexp_plugins.identification.whole_record._machine_problem import (
    DEAD_TIME,
    NOISE,
    SCALES,
    FreeParameters,
    MachineProblem,
)
from fraexp_plugins.identification.whole_record._motion_start import RoughFriction, rough_friction


class MaximumLikelihood(DelayedEstimator, name="maximum_likelihood", version=10):
    """P̂ of greatest likelihood: a simulated machine that repeats all samples of the records, friction included.

    The observer of `effective_input` drives its friction model by measured positions, and takes the small difference of
    two forces. Here the machine itself is simulated along the recorded control input, and plant and friction are those
    with which it most probably gives the samples that were recorded. A sample tells an interval, that of the encoder's
    resolution, widened by its noise: the likelihood is Φ((r + q/2)/σ) - Φ((r - q/2)/σ) for the residual r, step q and
    standard deviation σ (F. Gustafsson and R. Karlsson, Automatica 45(12), 2009). Rounding costs hardly anything then,
    and the parameters of friction come out as well.

    Before that the measured motion drives the friction model, with a plant beside it: what is left of the control input
    at the excited lines and, of sines, their odd harmonics, tells where the fit begins. The model may be wrong by a
    factor of three at the start.

    `free` names what is estimated of friction: by default one factor on its force and one on its deflections. They
    belong to all records; the more records of different frequencies and amplitudes there are, the better they are
    known. The response of each record is its own. At harmonics of the excitation, which friction causes, the plant acts
    as well: as `nominal_plant`, or as the modal plant that is fitted to all records together. An unknown dead time is
    estimated if `free` names `input_dead_time`: it may be some samples wrong at the start, or 0, and stands for all
    dead time of the loop. With `noise` the encoder's noise is estimated from the residual; it must not be more than
    scatter or spectrum of the records show.

    The band is that of the information in the likelihood, with the parameters' part. The metrics are the parameters
    with their 95 % intervals, and the geometric mean of the residuals over what noise and rounding explain, which is 1
    where the model is right. Where it is not, the outcome is not ok, and the message says so: another friction law,
    wrong dead times, unknown noise. Where noise covers the encoder's steps, the residual must be white, too. A
    parameter that the records do not tell is held, and named. Plant and friction are results as components too, where
    the parameters of the law can express the scales. Where noise goes round a loop, no period repeats another. The
    state at the start of a record is then its own, too.

    **Which law?** With `laws`, names of any laws, your own included, or several models as `starts`, each law is fitted
    to three quarters of the records with its scales and its shape parameters free (viscous coefficient, static force,
    Stribeck velocity, damping, attraction, and pure numbers without a default). A named law begins with numbers of the
    sizes that their units say, and with those of its first preset where units say nothing. What it leaves of the
    others, over what noise and rounding explain, is 1 where law and plant are right (cross-validation: M. Stone, J.
    Royal Statistical Society B 36(2), 1974). The law with the least residual wins; of equals that with the least
    Bayesian information criterion, which is the simpler one unless the other is much more likely. Where a law fits,
    those that left five times as much along the motion, or more with no fewer parameters, are not carried to the end;
    laws that are not replayed in lanes (elastoplastic, GMS) take minutes, and are tried last, if no other law fits. A
    law that cannot be computed is named, and the others go on. `verdict` is 1 if a law fits. Take some 16 frequencies
    or more, from presliding to gross sliding, or two amplitudes (`concatenated`): laws that differ only in what the
    records do not show, such as the Stribeck effect without slow sliding, are not told apart.

    **Several contacts.** The response between one thrust and one position does not say how friction at another contact
    moves the machine. So the plant is one with ports whose numbers are estimated, `nominal_plant` being the start, and
    P̂ is its response: a mode that it lacks is not found, but shows in the residual. The one position that is fed back
    tells the scales of all contacts if the records have frequencies below and above the modes; below them all contacts
    move alike. There is one start, which must be near: friction, its viscous part included, and plant within some ten
    percent. A number that is 0 at the start stays 0.

    It needs the steady state of stepped sines or multisines of up to 64 lines. Where friction holds the machine nearly
    still at all frequencies there is nothing to see, by this method neither. Simulation takes time: about 0.1 s for
    each frequency.
    """

    friction: FrictionModel | None = param("", "friction model at the start", None, inherit="friction")
    frictions: dict[str, FrictionModel] = param(
        "", "friction model of each contact at the start, of a machine with several", {}, inherit="friction"
    )
    laws: tuple[type[FrictionModel], ...] = param("", "names of laws to choose from, of any law, without numbers", ())
    starts: tuple[FrictionModel, ...] = param("", "friction models to choose from, of any law, in place of one", ())
    free: tuple[str, ...] | None = param(
        "",
        "what is estimated: force_scale, displacement_scale, names of the model's numbers, input_dead_time, noise; of "
        "several contacts such as motor.force_scale or stiffness. By default the scales, and with several contacts "
        "their viscous coefficients and all numbers of the plant, too; of laws to choose from all that it may be",
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
        for law in self.laws:
            try:
                RoughFriction(1.0, 1e-5, 1e-2).model(law)
            except ParameterError as error:
                raise ParameterError("maximum_likelihood.laws: ", *error.args, "; give a model in `starts`") from None
        models: dict[str, FrictionModel | None] = {"friction": self.friction}
        models |= {f"frictions.{contact}": model for contact, model in self.frictions.items()}
        models |= {f"starts.{place}": model for place, model in enumerate(self.starts)}
        for place, model in models.items():
            if isinstance(model, PositionDependentFriction):
                raise ParameterError(
                    f"maximum_likelihood.{place} has a position_dependence, and a replay does not know where on the "
                    "stroke the record was; leave it out, or use an effective input"
                )
        contacts = [] if self.nominal_plant is None else list(self.nominal_plant.ports().contacts)
        if self.frictions and not self._is_open:
            if self.nominal_plant is None:
                raise ParameterError("maximum_likelihood.nominal_plant is missing; expected the plant of all contacts")
            for contact in self.frictions:
                if contact not in contacts:
                    raise ParameterError(
                        f"maximum_likelihood.frictions: the nominal plant has no contact '{contact}'; known: "
                        f"{', '.join(contacts)}"
                    )
        elif len(contacts) > 1:
            raise ParameterError(
                f"maximum_likelihood.nominal_plant has friction at {len(contacts)} contacts ({', '.join(contacts)}); "
                "give the model of each one in frictions"
            )
        for model in self.starts if self._is_open else (self.friction,):
            if model is not None or self.frictions:
                self._free_of(model)

    def estimate(self, signals: Signals) -> Result:
        """Return P̂ with its band, the friction parameters, and how well the model repeats the records."""
        signals.unit(self.input), signals.unit(self.output)
        if not signals.segments:
            return Result(signals.outcome, signals.findings)
        if not self._is_open:
            return self.fit(signals).result()
        check_one_contact(signals, self.name)
        used, noise = self._used(signals)
        best, trials = try_laws([self.problem(used, noise, model) for model in self._candidates(used, noise)])
        return with_verdict(self._report(best.problem, best.found).result(), best, trials)

    @property
    def _is_open(self) -> bool:
        """Whether a law is chosen from several."""
        return bool(self.laws or self.starts)

    @property
    def law(self) -> FrictionModel:
        """Friction model of the one contact; ParameterError if there is none."""
        if self.friction is None:
            raise ParameterError("maximum_likelihood.friction is missing; expected the friction model at the start")
        return self.friction

    def fit(self, signals: Signals) -> FitReport:
        """Return the fit of the one machine at the start to signals that have segments."""
        (check_one_thrust if self.frictions else check_one_contact)(signals, self.name)
        used, noise = self._used(signals)
        return self._report(self.problem(used, noise, None if self.frictions else self.law))

    def _used(self, signals: Signals) -> tuple[Signals, float]:
        """Return the records that can be fitted, and their noise [m]."""
        used = usable_signals(signals, self.output, self.name)
        check_segments(used, self.name)
        return used, noise_in_records(used, self.output, self.resolution) if self.noise is None else self.noise

    def _report(self, problem: MachineProblem, known: Fitted | None = None) -> FitReport:
        """Return the fit without parameters that the records do not tell."""
        held: list[str] = []
        found, starts = fit_machine(problem, known)
        while untold := least_told(found):  # one at a time: of two that only their sum is told, one remains
            held.append(untold)
            problem = problem.leave_out(untold)
            found, starts = fit_machine(problem)
        if NOISE not in (self.free or ()):
            return FitReport(problem.signals, found, starts, held)
        level = likely_noise(found.linear.records, float(found.fit.freedom.sum()))
        return FitReport(problem.signals, found.with_noise(level.value), starts, held, level)

    def _candidates(self, signals: Signals, noise: float) -> Sequence[FrictionModel]:
        """Return the models of the laws to choose from."""
        rough = rough_friction(signals, self._observer(Frictionless(), noise)) if self.laws else None
        return [*([rough.model(law) for law in self.laws] if rough else []), *self.starts]

    def _free_of(self, model: FrictionModel | None) -> FreeParameters:
        """Return what is free of a friction model at the one contact, or of all contacts and the plant."""
        if self._is_open:
            assert model is not None
            shape = shape_parameters(model)
            return FreeParameters((*SCALES, *shape, *(name for name in self.free or () if name == DEAD_TIME)))
        if self.frictions:
            return FreeParameters.chosen(self.free, self.frictions, self.nominal_plant)
        assert model is not None
        return FreeParameters.chosen(self.free, {"": model}, None)

    def problem(self, signals: Signals, noise: float, friction: FrictionModel | None = None) -> MachineProblem:
        """Return what is fitted to signals with this noise [m], if friction is this at the start of the one contact."""
        law = Frictionless() if friction is None else friction
        contacts = {} if self._is_open else self.frictions
        return MachineProblem(
            signals, self._observer(law, noise), self._free_of(friction), self.nominal_plant, self.modes, contacts,
            (self.thrust, self.position) if contacts else ("", ""),
        )  # fmt: skip

    def _observer(self, friction: FrictionModel, noise: float) -> EffectiveInput:
        shared = {name: getattr(self, name) for name in DelayedEstimator.model_fields}
        return EffectiveInput(
            friction=friction,
            resolution=self.resolution,
            noise=noise,
            interpolation_tolerance=self.interpolation_tolerance,
            **shared,
        )
