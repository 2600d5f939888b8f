"""A session's folder from nothing: a robot's file, and where camera, board and markers sit on it."""

from .create import NewSession, create_session
from .drawing import draw_setup
from .mounts import CameraMount, FaceMount, MarkerMount, parse_marker, parse_vector

__all__ = [
    "CameraMount",
    "FaceMount",
    "MarkerMount",
    "NewSession",
    "create_session",
    "draw_setup",
    "parse_marker",
    "parse_vector",
]
