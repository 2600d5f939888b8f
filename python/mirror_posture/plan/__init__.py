"""Postures and viewpoints for a robot, its mirror and its room, and what they will be able to tell, before a picture is taken."""

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
