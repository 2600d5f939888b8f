"""Mirrors without a plan: straight in front of the board, or from a plan's views.csv."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from .._core import MirrorPostureError
from ..arrays import Floats
from ..robots.nominal import Nominal
from .options import MirrorPlace, PlanOptions, turned_mirror
from .setting import read_setting
from .table import POSTURES, VIEWS, PlannedFrame, numbers_of, read_plan


def mirrors_before(
    nominal: Nominal, options: PlanOptions, yaws_rad: Sequence[float], distance_m: float
) -> list[MirrorPlace]:
    """A mirror so far before the board, centred between the ways to the camera and the board, turned by each yaw; in the root's frame."""
    if not (math.isfinite(distance_m) and distance_m > 0.0):
        raise MirrorPostureError(f"distance: got {distance_m!r} m, needed a number above 0")
    setting = read_setting(nominal, options)
    robot = nominal.robot
    camera, board = robot.link_poses(setting.home[None], [setting.camera_link, setting.board.link])[
        0, :, :3, 3
    ]
    aim = 0.5 * (camera + board)
    center = aim + (float((board - aim) @ setting.forward) + distance_m) * setting.forward
    return [
        setting.in_root(turned_mirror(options, center, setting.forward, setting.up, yaw)) for yaw in yaws_rad
    ]


def planned_mirrors(folder: Path, nominal: Nominal) -> list[tuple[PlannedFrame, Floats, Floats]]:
    """Each row of a plan with its mirror's centre (m) and normal, in the root's frame."""
    rows = read_plan(folder / POSTURES, nominal.robot)
    table = numbers_of(folder / VIEWS)
    wanted = [
        "frame",
        *(f"{kind}_{axis}{unit}" for kind, unit in (("center", "_m"), ("normal", "")) for axis in "xyz"),
    ]
    if missing := [name for name in wanted if name not in table]:
        raise MirrorPostureError(
            f"{folder / VIEWS}: has no column {missing[0]!r}; mirror-posture plan writes it"
        )
    at = {int(frame): index for index, frame in enumerate(table["frame"])}
    found = []
    for row in rows:
        if row.frame not in at:
            raise MirrorPostureError(f"{folder / VIEWS}: has no row for frame {row.frame}")
        center, normal = (
            np.array([table[name][at[row.frame]] for name in wanted[k : k + 3]]) for k in (1, 4)
        )
        found.append((row, center, normal))
    return found
