"""The frame in which a marker's mount is given: that of the link to which the marker's link is fixed."""

from __future__ import annotations

import numpy as np

from mirror_posture.arrays import Floats
from mirror_posture.robot import Robot


def turn_of_mount(robot: Robot, link: str) -> Floats | None:
    """The turn `parent_from_link` (3, 3) of a link that is fixed to its parent; None of others, whose mount is given in their own frame."""
    joint = robot.links[robot.link_index(link)].parent_joint
    if joint is None or robot.joints[joint].kind != "fixed":
        return None
    return np.asarray(robot.joints[joint].parent_from_joint, dtype=np.float64)[:3, :3]
