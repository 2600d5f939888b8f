"""Measuring a session: mirrors from the board's reflections, markers from two or more views (`docs/measuring.md`)."""

from .inputs import nominal_camera_from_board
from .options import ESTIMATORS, Estimator, MeasureOptions, Mount
from .run import measure, measure_all
from .types import Markers, Measurement, Mirrors, NothingMeasuredError

__all__ = [
    "ESTIMATORS",
    "Estimator",
    "Markers",
    "MeasureOptions",
    "Measurement",
    "Mirrors",
    "Mount",
    "NothingMeasuredError",
    "measure",
    "measure_all",
    "nominal_camera_from_board",
]
