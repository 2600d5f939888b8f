"""A correction in a process of its own, slow enough to be killed at any moment: `python correct_child.py FOLDER`."""

from __future__ import annotations

import sys
import time
from pathlib import Path

from mirror_lab.robots import HiddenEffect, TwinOptions, TwinRobot
from mirror_posture.correct import CorrectOptions, Recorder, StepOptions, StopOptions, correct
from mirror_posture.robots import Look

POSTURE = {"r_shoulder_pitch": -0.5, "r_shoulder_roll": 0.9, "r_elbow": 0.8}
HIDDEN = (HiddenEffect("joint_offset", "joint:r_elbow", {"offset_rad": 0.06}),)
OPTIONS = CorrectOptions(step=StepOptions(gain=0.3), stop=StopOptions(looks=30))


class Robot(TwinRobot):
    """Tells of each look before it is recorded."""

    def _look(self) -> Look:
        look = super()._look()
        time.sleep(0.01)
        return look


def main(folder: Path) -> None:
    robot = Robot(HIDDEN, TwinOptions(pictures=False))
    with robot:
        if (folder / "correction.json").exists():
            recorder, _ = Recorder.resume(folder)
        else:
            recorder = Recorder.start(folder, robot.nominal, robot.joint_names)
        # What is counted here was on the disk before.
        outcome = correct(
            robot, POSTURE, OPTIONS, recorder=recorder, on_picture=lambda look, n: print(n, flush=True)
        )
    print("stop", outcome.stop.kind, flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
