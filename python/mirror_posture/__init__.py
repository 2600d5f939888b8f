"""A robot measures, corrects and diagnoses its own posture in a mirror."""

from ._core import MirrorPostureError, __version__

__all__ = ["MirrorPostureError", "__version__"]
