"""Plans postures and viewpoints for a robot, its mirror and its room, and predicts what they will show."""

from .judge import judge_plan
from .options import MirrorPlace, PlanOptions
from .run import Plan, make_plan
from .table import PlannedFrame, read_plan, write_plan

__all__ = [
    "MirrorPlace",
    "Plan",
    "PlanOptions",
    "PlannedFrame",
    "judge_plan",
    "make_plan",
    "read_plan",
    "write_plan",
]
