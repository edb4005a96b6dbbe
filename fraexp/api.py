"""The one module that a plugin imports."""

from fraexp.analysis.delays import hold_response, image_factor, path_response
from fraexp.analysis.fourier import fourier_sums, phasors, spectrum_of
from fraexp.analysis.response import response_result
from fraexp.components.kinds import (
    Controller,
    Estimator,
    Excitation,
    FrictionModel,
    Motion,
    Period,
    Plant,
    RecordReader,
    RecordTable,
    Schedule,
    StateSpace,
)
from fraexp.components.parameters import Parameters, param
from fraexp.components.registry import hookimpl
from fraexp.components.supplies import component_modules
from fraexp.data.results import HARMONICS, Curve, Fit, FrequencyResponse, Metric, Outcome, Result
from fraexp.data.signals import Segment, Settling, Signals
from fraexp.errors import FraexpError, ParameterError, RecordError, did_you_mean
from fraexp.kernels.choice import where

__all__ = [
    "HARMONICS",
    "Controller",
    "Curve",
    "Estimator",
    "Excitation",
    "Fit",
    "FraexpError",
    "FrequencyResponse",
    "FrictionModel",
    "Metric",
    "Motion",
    "Outcome",
    "ParameterError",
    "Parameters",
    "Period",
    "Plant",
    "RecordError",
    "RecordReader",
    "RecordTable",
    "Result",
    "Schedule",
    "Segment",
    "Settling",
    "Signals",
    "StateSpace",
    "component_modules",
    "did_you_mean",
    "fourier_sums",
    "hold_response",
    "hookimpl",
    "image_factor",
    "param",
    "path_response",
    "phasors",
    "response_result",
    "spectrum_of",
    "where",
]
