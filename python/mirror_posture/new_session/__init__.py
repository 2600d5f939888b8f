"""Creates a session's folder from a robot's file and the places of camera, board and markers on it."""

from .create import NewSession, create_session, require_robot_file
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
    "require_robot_file",
]
