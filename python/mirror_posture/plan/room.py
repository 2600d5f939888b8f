"""Clearances of a posture: from the robot itself, the table, the glass."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from .._core import MirrorPostureError
from ..arrays import Floats
from ..counted import counted
from .options import MirrorPlace, PlanOptions
from .setting import Setting, draw

if TYPE_CHECKING:
    from ..shapes.body import Body


STEP_RAD = 0.15
"""A path between two postures is checked at least this often where joints turn."""
GLASS_CLEARANCES = 3.0
"""Clearances of the body from the glass, because the mirror is not exactly where it was meant."""
ALWAYS_SAMPLES = 40
ALWAYS_SHARE = 0.95
AS_NEAR_AS_AT_HOME = 0.5
CLEARANCE_M, USUAL_SIZE_M = 0.01, 0.6
"""The clearance of a robot of at least this size."""
LEAST_BODY_M = 0.02
"""Without shapes: every link's origin is taken for a ball of this radius."""


@dataclass(eq=False)
class Room:
    """What a posture must keep clear of: itself, the table, the glass."""

    setting: Setting
    body: Body | None
    clearance_m: float
    table_m: float | None
    """Height along `up` in the base's frame."""

    @cached_property
    def steps(self) -> Floats:
        """(nq,): how far each joint may go between two checks of a path, rad (m); one that slides by the clearance, which it must not pass unseen."""
        robot = self.setting.nominal.robot
        per_step = np.full(len(robot.position_names), 1e-9)
        for joint in robot.joints:
            if joint.position is not None:
                step = self.clearance_m if joint.kind == "prismatic" else STEP_RAD
                # A coupled joint moves with the column of another.
                per_step[joint.position] = max(per_step[joint.position], abs(joint.multiplier) / step)
        return 1.0 / per_step

    def links(self) -> list[str]:
        """The links that the plan moves."""
        return sorted(moved_links(self.setting))

    def take(self, positions: Floats) -> None:
        """The posture to which the following calls refer."""
        robot = self.setting.nominal.robot
        if self.body is not None:
            self.body.put(positions)
        else:
            self._origins = robot.link_poses(positions[None], list(robot.link_names))[0]

    def reach_m(self, direction: Floats, moved_only: bool = False) -> float:
        """How far the robot reaches along a direction, m."""
        wanted = self.links() if moved_only else None
        if self.body is not None:
            return self.body.extent_m(direction, wanted)
        names = list(self.setting.nominal.robot.link_names)
        rows = range(len(names)) if wanted is None else [names.index(name) for name in wanted]
        return max(float(self._origins[row, :3, 3] @ direction) for row in rows) + LEAST_BODY_M

    def collision(self) -> str | None:
        """What the posture runs into, itself or the table; None where it is free."""
        if self.body is not None and self.body.touching():
            return "touches itself"
        if (
            self.table_m is not None
            and -self.reach_m(-self.setting.up, True) < self.table_m + self.clearance_m
        ):
            return "touches the table"
        return None

    def glass_free(self, mirror: MirrorPlace) -> bool:
        """Whether the robot stays in front of the mirror's plane, given in the base's frame."""
        at = float(mirror.normal_in_root @ mirror.center_in_root_m)
        return self.reach_m(mirror.normal_in_root) < at - GLASS_CLEARANCES * self.clearance_m


def room_of(
    setting: Setting, options: PlanOptions, random: np.random.Generator
) -> tuple[Room, list[str], list[str]]:
    """The room around a robot at home, the pairs of links that are not compared, and warnings of what is
    not checked."""
    warnings: list[str] = []
    ignored: list[str] = []
    clearance_m = _clearance_m(setting, options)
    body = None
    try:
        from ..shapes.body import Body
    except MirrorPostureError as missing:
        warnings.append(f"collisions of the robot with itself are NOT checked: {missing}")
    else:
        body = Body(setting.nominal, options.packages, clearance_m, moved_links(setting))
        where = "state where their ROS package is: --package NAME=FOLDER, preferably of `init`, which keeps copies"
        if body.bare and body.missing:
            warnings.append(
                f"none of the robot's meshes was found, as {body.missing[0]}: collisions of the robot with itself are NOT checked; {where}"
            )
        elif body.missing:
            warnings.append(
                f"{counted(len(body.missing), 'mesh was', 'meshes were')} not found, {'its link is' if len(body.missing) == 1 else 'their links are'} NOT checked for collisions, as {body.missing[0]}; {where}"
            )
        elif body.bare:
            warnings.append("the URDF has no shapes: collisions of the robot with itself are NOT checked")
        if body.bare:
            body = None
    if body is not None:
        ignored = ignore_by_construction(body, setting, random)
    room = Room(setting, body, clearance_m, None)
    room.take(setting.home)
    if options.table_m is None:
        # A part that stands on the table at home touches it, and is not moved.
        lowest = -room.reach_m(-setting.up)
        room.table_m = lowest - clearance_m if lowest > -np.inf else None
    else:
        room.table_m = options.table_m + float(setting.up @ setting.base_from_root[:3, 3])
    return room, ignored, warnings


def _clearance_m(setting: Setting, options: PlanOptions) -> float:
    if options.clearance_m is not None:
        return options.clearance_m
    robot = setting.nominal.robot
    origins = robot.link_poses(setting.home[None], list(robot.link_names))[0, :, :3, 3]
    size = float(np.linalg.norm(origins.max(axis=0) - origins.min(axis=0)))
    return CLEARANCE_M * min(1.0, size / USUAL_SIZE_M)


def ignore_by_construction(body: Body, setting: Setting, random: np.random.Generator) -> list[str]:
    """Excludes pairs of links that touch at home or nearly always; returns them.

    First by the links' convex hulls. Those that overlap may be hollow, as a torso is at its armpits: they
    are compared again piece by piece. Pieces that are free then at home may come half as near as there (at
    most the clearance), not nearer.
    """
    sample = draw(setting, ALWAYS_SAMPLES, random)
    hollow = _by_construction(body, setting, sample)
    if hollow:
        body.cut({link for pair in hollow for link in pair})
        body.put(setting.home)
        body.nearest_m = {
            pair: AS_NEAR_AS_AT_HOME * distance
            for pair, distance in body.distances_m().items()
            if pair in hollow and distance > 0.0
        }
    body.ignored = _by_construction(body, setting, sample)
    return sorted(" and ".join(sorted(pair)) for pair in body.ignored)


def _by_construction(body: Body, setting: Setting, sample: Floats) -> set[frozenset[str]]:
    """The pairs that touch at home, or in nearly all of a sample of postures."""
    body.put(setting.home)
    always = body.touching()
    count: Counter[frozenset[str]] = Counter()
    for posture in sample:
        body.put(posture)
        count.update(body.touching())
    return always | {pair for pair, n in count.items() if n > ALWAYS_SHARE * len(sample)}


def moved_links(setting: Setting) -> set[str]:
    """The links that a plan moves."""
    robot = setting.nominal.robot
    found: set[str] = set()
    for joint in robot.joints:
        if joint.position in setting.moving or joint.parent_link in found:
            found.add(joint.child_link)
    return found
