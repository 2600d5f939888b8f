"""Checks an existing plan as a new one: after its rows, the mounts, their tolerances or the mirror were
changed."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..robots.nominal import Nominal
from .again import PlannedRoom, read_planned_room
from .candidates import sift
from .choose import path_blocked, stands_clear
from .options import MirrorPlace, square_to
from .run import Plan
from .table import POSTURES, read_plan
from .telling import what_it_tells


def judge_plan(folder: str | os.PathLike[str], plan_folder: Path) -> tuple[Plan, tuple[str, ...]]:
    """The plan of a folder with its predicted detection limits, and for each row that cannot be taken the
    reason, in a sentence.

    Each row must satisfy `plan`'s conditions for a posture: within the joints' limits; free of collisions,
    also on the straight path from the previous row; clear of the glass; board and a ball visible in the
    mirror's frame; no real ball in the picture. Rows that show nothing give no information.

    Raises:
        MirrorPostureError: no plan there, one that is broken, or one of another robot.
    """
    nominal = Nominal.load(folder)
    planned = read_planned_room(plan_folder, nominal)
    setting, room = planned.setting, planned.room
    rows = read_plan(plan_folder / POSTURES, nominal.robot)
    numbers = sorted({row.view for row in rows})
    mirrors = [planned.in_base(mirror) for mirror in planned.mirrors[: len(numbers)]]
    view = np.array([numbers.index(row.view) for row in rows], dtype=np.int64)
    positions = np.array([setting.home] * len(rows))
    for posture, row in zip(positions, rows, strict=True):
        for name, value in row.commanded.items():
            posture[nominal.robot.position_index(name)] = value
    markers = np.zeros((len(rows), len(nominal.metadata.markers)), dtype=bool)
    wrong: list[str] = []
    any_order = np.random.default_rng(0)
    before = setting.home
    for at, row in enumerate(rows):
        mirror = mirrors[view[at]]
        found = sift(setting, [mirror], room, planned.options, positions[at : at + 1], 1, any_order)
        markers[at] = found.markers.any(axis=0)
        trouble = [*_beyond_limits(planned, row.commanded), *found.reasons]
        blocked = path_blocked(setting, room, mirror, before, positions[at])
        if blocked is not None:
            trouble.append(f"on the way there it {blocked}")
        if at and view[at] != view[at - 1] and not stands_clear(room, mirror, before):
            trouble.append(
                "the row before it comes too near to the glass when the mirror is turned for this one"
            )
        if trouble:
            wrong.append(f"frame {row.frame}: {'; '.join(trouble)}")
        before = positions[at]
    used = tuple(_turned(planned, mirror) for mirror in planned.mirrors[: len(numbers)])
    board = nominal.robot.link_poses(setting.home[None], [setting.board.link])[0, 0, :3, 3]
    first = mirrors[view[0]]
    options = planned.options
    plan = Plan(
        setting, options, used, positions, view, np.array([row.posture for row in rows], dtype=np.int64), markers,
        what_it_tells(setting, positions, mirrors, view, markers), {}, 0, planned.warnings, planned.ignored,
        float(first.normal_in_root @ (first.center_in_root_m - board)),
    )  # fmt: skip
    return plan, tuple(wrong)


def _beyond_limits(planned: PlannedRoom, commanded: dict[str, float]) -> list[str]:
    limits = planned.setting.nominal.joint_limits
    return [
        f"{name} is at {value:.4g}, its limits are {limits[name].lower:.4g} to {limits[name].upper:.4g} rad (m)"
        for name, value in commanded.items()
        if name in limits and not limits[name].lower <= value <= limits[name].upper
    ]


def _turned(planned: PlannedRoom, mirror: MirrorPlace) -> MirrorPlace:
    """A mirror of the root's frame with its turn from straight before the robot, as `turned_mirrors` counts it."""
    up, forward = planned.setting.up, planned.setting.forward
    across, lean = square_to(forward, up)
    normal = planned.in_base(mirror).normal_in_root
    yaw = math.atan2(float(normal @ across), float(normal @ forward))
    return replace(mirror, yaw_rad=yaw, pitch_rad=math.asin(float(np.clip(normal @ lean, -1.0, 1.0))))
