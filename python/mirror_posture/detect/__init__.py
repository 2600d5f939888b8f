"""Detection: pictures in, labelled board corners and marker centres with standard deviations out."""

from .board import BoardOptions, detect_boards, measure_grid
from .gate import GateOptions
from .types import (
    BoardPrediction,
    BoardSpec,
    BoardView,
    CameraSpec,
    ColorSpec,
    DetectionError,
    DetectionSetup,
    Ellipse,
    MarkerSpec,
    MarkerView,
    PictureDetections,
    PredictedMarker,
)

__all__ = [
    "BoardOptions",
    "BoardPrediction",
    "BoardSpec",
    "BoardView",
    "CameraSpec",
    "ColorSpec",
    "DetectionError",
    "DetectionSetup",
    "Ellipse",
    "GateOptions",
    "MarkerSpec",
    "MarkerView",
    "PictureDetections",
    "PredictedMarker",
    "detect_boards",
    "measure_grid",
]
