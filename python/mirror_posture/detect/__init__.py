"""Detection: pictures in, labelled board corners and marker centres with standard deviations out.

`detect_picture` and `detect_pictures` do a whole picture and many; `setup_from_session` and `predictions_from_session` say what a
session's pictures hold. `read_picture` and `list_pictures` read, `draw_overlay` shows.
"""

from .board import BoardOptions, detect_boards, measure_grid
from .charuco import detect_charuco
from .gate import GateOptions
from .into_session import (
    DetectedSession,
    detect_session,
    predictions_from_session,
    setup_from_session,
    with_detections,
)
from .marker_judge import MarkerOptions
from .markers import detect_markers
from .overlay import draw_overlay, write_overlay
from .pictures import DetectionOptions, PicturePrediction, detect_picture, detect_pictures
from .reading import list_pictures, read_picture
from .types import (
    BoardPrediction,
    BoardView,
    DetectionError,
    DetectionSetup,
    Ellipse,
    MarkerView,
    PictureDetections,
    PredictedMarker,
)

__all__ = [
    "BoardOptions",
    "BoardPrediction",
    "BoardView",
    "DetectedSession",
    "DetectionError",
    "DetectionOptions",
    "DetectionSetup",
    "Ellipse",
    "GateOptions",
    "MarkerOptions",
    "MarkerView",
    "PictureDetections",
    "PicturePrediction",
    "PredictedMarker",
    "detect_boards",
    "detect_charuco",
    "detect_markers",
    "detect_picture",
    "detect_pictures",
    "detect_session",
    "draw_overlay",
    "list_pictures",
    "measure_grid",
    "predictions_from_session",
    "read_picture",
    "setup_from_session",
    "with_detections",
    "write_overlay",
]
