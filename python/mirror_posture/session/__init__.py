"""Sessions: folders with a robot model, a camera and observations; read, validated and written."""

from ..board import Board
from ..marker import ColorRange, Marker
from ..mirror import Mirror
from .camera_info import dump_camera_info, load_camera_info
from .errors import SessionError
from .load import as_session, load_session
from .types import (
    UNKNOWN_FRAME,
    Frames,
    Noise,
    Points,
    Session,
    States,
    Views,
)
from .write import write_detections, write_session

__all__ = [
    "UNKNOWN_FRAME",
    "Board",
    "ColorRange",
    "Frames",
    "Marker",
    "Mirror",
    "Noise",
    "Points",
    "Session",
    "SessionError",
    "States",
    "Views",
    "as_session",
    "dump_camera_info",
    "load_camera_info",
    "load_session",
    "write_detections",
    "write_session",
]
