"""Posture correction: a robot that stands wrong looks in the mirror and moves its joints until its markers are where they should be.

    from mirror_posture.correct import correct

    with robot:
        outcome = correct(robot, {"r_shoulder_pitch": -0.26, "r_shoulder_roll": 1.48, "r_elbow": 0.26})
    print(outcome.stop.sentence)

`robot` is any `mirror_posture.robots.CommandedRobot`. The mathematics, and what a stop rests on, is the core's (`mirror_core::correct`).
"""

from .._core import CorrectionStep, correction_step
from .first_commands import CommandForPosture
from .loop import correct
from .options import PAPER_VIEWS, CorrectOptions, MeasureChoice, StepOptions, StopOptions
from .outcome import LookReport, MarkerError, Outcome, Stop
from .planned import PlannedViews, views_of_plan
from .planner import propose_views
from .recorder import Recorder
from .target import Target, make_target

__all__ = [
    "PAPER_VIEWS",
    "CommandForPosture",
    "CorrectOptions",
    "CorrectionStep",
    "LookReport",
    "MarkerError",
    "MeasureChoice",
    "Outcome",
    "PlannedViews",
    "Recorder",
    "StepOptions",
    "Stop",
    "StopOptions",
    "Target",
    "correct",
    "correction_step",
    "make_target",
    "propose_views",
    "views_of_plan",
]
