"""What the tests of every make of servo share: an arm of two of them, and an eye that sees nothing."""

from __future__ import annotations

import numpy as np

from mirror_posture.robots import ImagePoints

JOINTS = """
[joints.r_shoulder_roll]
id = 1
zero_counts = 1024
direction = 1
upper_rad = 1.6

[joints.r_elbow]
id = 2
zero_counts = 2048
direction = -1
"""
"""Of servos.toml."""


def blind() -> ImagePoints:
    return ImagePoints(np.zeros((30, 2)), np.zeros(30, bool), np.zeros((6, 2)), np.zeros(6, bool))
