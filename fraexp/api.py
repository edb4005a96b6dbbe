"""The one module that a plugin imports."""

from fraexp.components import (
    Controller,
    Estimator,
    Excitation,
    FrictionModel,
    Motion,
    Period,
    Plant,
    RecordReader,
    Schedule,
    StateSpace,
    Table,
)
from fraexp.delays import hold_response, image_factor, path_response
from fraexp.errors import FraexpError, ParameterError, RecordError, did_you_mean
from fraexp.kernels.choice import where
from fraexp.parameters import Parameters, param
from fraexp.periodic import fourier_sums, phasors, spectrum_of
from fraexp.plugins import hookimpl
from fraexp.response import response_result
from fraexp.results import HARMONICS, Curve, Fit, FrequencyResponse, Metric, Outcome, Result
from fraexp.signals import Segment, Settling, Signals
from fraexp.supplies import component_modules

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
    "Result",
    "Schedule",
    "Segment",
    "Settling",
    "Signals",
    "StateSpace",
    "Table",
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
