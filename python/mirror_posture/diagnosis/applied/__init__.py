"""The better model: what a diagnosis found, written back into the robot's, the camera's and the session's files."""

from .apply import Applied, Written, apply_diagnosis

__all__ = ["Applied", "Written", "apply_diagnosis"]
