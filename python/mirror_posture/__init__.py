"""A robot measures, corrects and diagnoses its own posture in a mirror."""

from ._core import MirrorPostureError, __version__
from .session import Session, SessionError, load_session

__all__ = ["MirrorPostureError", "Session", "SessionError", "__version__", "load_session"]
