"""The conventional FRA method: measured position over control input."""

from dataclasses import replace
from typing import ClassVar

from fraexp.api import Result, Signals, param, phasors, response_result
from fraexp_plugins.estimators._shared.delayed_estimator import PlantReferredEstimator
from fraexp_plugins.estimators._shared.measured_motion import recorded_step, with_rounding
from fraexp_plugins.estimators._shared.neighbouring_lines import with_noise_of_neighbours


class Conventional(PlantReferredEstimator, name="conventional", version=6):
    """P̂ = y'/u by Fourier sums over whole periods, averaged (paper, Fig 3).

    It estimates the describing function of plant, friction and delays together: with friction the response depends on
    the amplitude, and is that at the input amplitude stated with it. Do not use it as a plant model unless friction is
    negligible at that amplitude.

    The confidence band contains the rounding error that repeats in every period, and noise by the scatter over periods.
    The encoder's step is `resolution`, or that which the record shows. From four periods of a sine on, noise follows
    from the lines of the record's spectrum beside the excited one, where friction gathers it. That of one simulated
    period follows from its encoder.
    """

    takes_responses: ClassVar[bool] = True

    resolution: float = param("m", "quantisation step of the encoder", 0.0, at_least=0, inherit="loop.resolution")

    def estimate(self, signals: Signals) -> Result:
        """Return y'/u, or y'/(G_di G_do u), at each frequency."""
        units = (signals.unit(self.input), signals.unit(self.output))
        inputs = [phasors(segment, self.input) for segment in signals.segments]
        if self.refer_to_plant:
            path = self.fitted_to(signals).path
            pairs = zip(inputs, signals.segments, strict=True)
            inputs = [u * path(segment.frequency, segment.sample_time) for u, segment in pairs]
        outputs = [phasors(segment, self.output) for segment in signals.segments]
        found = response_result(signals, inputs, outputs, names=(self.input, self.output), units=units)
        if found.response is None:
            return found
        response = with_noise_of_neighbours(found.response, signals.segments, (self.input, self.output))
        resolution = self.resolution or recorded_step(signals.segments, self.output)
        found = replace(found, response=response)
        return with_rounding(found, signals.segments, self.output, resolution, signals.encoder)
