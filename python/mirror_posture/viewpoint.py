"""The viewpoint of a robot in front of its mirror."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .arrays import Floats


@dataclass(frozen=True)
class View:
    """The mirror's pose in front of the robot.

    At `yaw_rad = pitch_rad = 0` the chest board faces it squarely. The unit normal, from the robot to the
    mirror, is `(cos p cos y, cos p sin y, sin p)` in the root's frame (x forward, y left, z up): a positive
    yaw is the robot turned to its right, so that its right hand comes nearer to the picture's middle; a
    positive pitch is a mirror whose top leans towards the robot. `distance_m` is that of the board's centre
    from the mirror's front face.
    """

    yaw_rad: float = 0.0
    pitch_rad: float = 0.0
    distance_m: float = 0.150

    @property
    def normal_in_root(self) -> Floats:
        """The mirror's unit normal, from the robot to the mirror, (3,)."""
        level = math.cos(self.pitch_rad)
        return np.array(
            [level * math.cos(self.yaw_rad), level * math.sin(self.yaw_rad), math.sin(self.pitch_rad)]
        )
