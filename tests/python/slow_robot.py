"""A robot of somebody's own, as `--robot-class slow_robot:SlowRobot` loads it: a twin that takes its time."""

from __future__ import annotations

import os
import time

from mirror_lab.robots import HiddenEffect, TwinOptions, TwinRobot
from mirror_posture.robots import Look, Nominal


class SlowRobot(TwinRobot):
    """Looks take a tenth of a second, the one of number SLOW_ROBOT_WAITS_AT a minute; it says so when it is brought to rest."""

    looks = 0

    def __init__(self, nominal: Nominal) -> None:
        elbow = HiddenEffect("joint_offset", "joint:r_elbow", {"offset_rad": 0.06})
        super().__init__([elbow], TwinOptions(pictures=False), nominal, name="slow")

    def _look(self) -> Look:
        self.looks += 1
        # Whoever means to stop it there is never too late, however busy the machine.
        time.sleep(60.0 if os.environ.get("SLOW_ROBOT_WAITS_AT") == str(self.looks) else 0.1)
        return super()._look()

    def _rest(self) -> None:
        print("at rest", flush=True)
