"""Sessions in motion: the user's simulator compared with a minute of motion in the mirror (extra `mujoco`)."""

from mirror_posture.session.motion import is_moving

from .diagnose import MotionDiagnosis, Unseen, diagnose_motion, unseen_gap, with_checked

__all__ = ["MotionDiagnosis", "Unseen", "diagnose_motion", "is_moving", "unseen_gap", "with_checked"]
