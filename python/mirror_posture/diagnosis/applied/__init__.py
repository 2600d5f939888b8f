"""Writes the causes of a diagnosis back into the robot's, the camera's and the session's files."""

from .apply import Applied, Written, apply_diagnosis
from .own_files import OwnFile, twice_told, write_own_files

__all__ = ["Applied", "OwnFile", "Written", "apply_diagnosis", "twice_told", "write_own_files"]
