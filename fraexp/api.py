"""The one module that a plugin imports."""

from fraexp.analysis.array_cache import cached_arrays
from fraexp.analysis.confidence import NORMAL_QUANTILE, BandReach, circle_factor, degrees_of_freedom, interval_factor
from fraexp.analysis.delays import hold_response, image_factor, path_response
from fraexp.analysis.fourier import fourier_sums, phasors, record_spectrum
from fraexp.analysis.quantisation import grid_step, phasor_variance, rounding_symmetry
from fraexp.analysis.response import response_result, silence
from fraexp.analysis.steady_motion import steady_leakage, with_steady_motion
from fraexp.analysis.tolerances import (
    COARSE_DIFFERENCE,
    CONVERGED,
    CURVE_POINTS,
    DIFFERENCE,
    MAX_ITERATIONS,
    ROUNDING,
    SIGNIFICANCE,
    significant_deviation,
)
from fraexp.components.kinds import (
    Controller,
    Estimator,
    Excitation,
    FrictionModel,
    MachineDriver,
    Motion,
    Plant,
    RecordReader,
)
from fraexp.components.machine_session import Chunk, MachineDescription, MachineSession, PlayRequest, workspace_path
from fraexp.components.parameters import Parameters, param
from fraexp.components.periods import Feedforward, Period, Schedule
from fraexp.components.ports import Contact, Ports, StateSpace
from fraexp.components.position_dependence import PositionDependentFriction
from fraexp.components.registry import component_modules, hookimpl
from fraexp.data.findings import Finding, Quantity, at_worst, remarks
from fraexp.data.results import HARMONICS, Curve, Fit, FrequencyResponse, Metric, Outcome, Result
from fraexp.data.sample_file import read_header, read_samples
from fraexp.data.signals import Encoder, RecordTable, Segment, Settling, Signals
from fraexp.data.texts import frequency_text
from fraexp.errors import ConnectionLostError, FraexpError, MachineError, ParameterError, RecordError, did_you_mean
from fraexp.kernels.choice import where
from fraexp.simulation.experiment_run import LiveLoop, live_setup
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics
from fraexp.simulation.replay import Replay, Replayed, ReplayModel, replay

__all__ = [
    "COARSE_DIFFERENCE",
    "CONVERGED",
    "CURVE_POINTS",
    "DIFFERENCE",
    "HARMONICS",
    "MAX_ITERATIONS",
    "NORMAL_QUANTILE",
    "ROUNDING",
    "SIGNIFICANCE",
    "BandReach",
    "Chunk",
    "ConnectionLostError",
    "Contact",
    "ControlLoop",
    "Controller",
    "Curve",
    "Encoder",
    "Estimator",
    "Excitation",
    "Feedforward",
    "Finding",
    "Fit",
    "FraexpError",
    "FrequencyResponse",
    "FrictionModel",
    "LiveLoop",
    "Machine",
    "MachineDescription",
    "MachineDriver",
    "MachineError",
    "MachineSession",
    "Metric",
    "Motion",
    "Numerics",
    "Outcome",
    "ParameterError",
    "Parameters",
    "Period",
    "Plant",
    "PlayRequest",
    "Ports",
    "PositionDependentFriction",
    "Quantity",
    "RecordError",
    "RecordReader",
    "RecordTable",
    "Replay",
    "ReplayModel",
    "Replayed",
    "Result",
    "Schedule",
    "Segment",
    "Settling",
    "Signals",
    "StateSpace",
    "at_worst",
    "cached_arrays",
    "circle_factor",
    "component_modules",
    "degrees_of_freedom",
    "did_you_mean",
    "fourier_sums",
    "frequency_text",
    "grid_step",
    "hold_response",
    "hookimpl",
    "image_factor",
    "interval_factor",
    "live_setup",
    "param",
    "path_response",
    "phasor_variance",
    "phasors",
    "read_header",
    "read_samples",
    "record_spectrum",
    "remarks",
    "replay",
    "response_result",
    "rounding_symmetry",
    "significant_deviation",
    "silence",
    "simulate_loop",
    "steady_leakage",
    "where",
    "with_steady_motion",
    "workspace_path",
]
