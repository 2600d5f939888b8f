"""The viewpoints of a plan, for a correction: the ways to turn its mirror in which this target may be held and is seen."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from .._core import MirrorPostureError
from ..arguments import checked_arguments
from ..plan.again import read_planned_room
from ..plan.options import MirrorPlace
from ..viewpoint import View
from .planner import USUAL_VIEWS, Prospect, best_first, prospects
from .target import Target

FURTHER = 2
"""Viewpoints beside the usual ones, for a look that is too uncertain."""


@dataclass(frozen=True)
class PlannedViews:
    """What a plan offers to a correction."""

    usual: tuple[View, ...]
    """Of every look, best first."""
    further: tuple[View, ...]
    """For a look that is too uncertain to say anything."""
    left_out: tuple[str, ...]
    """The plan's own viewpoints that are not taken, each with the reason."""
    warnings: tuple[str, ...]
    """What could not be checked."""


@checked_arguments
def views_of_plan(
    target: Target,
    folder: str | os.PathLike[str],
    start: Mapping[str, float] | None = None,
    count: int = USUAL_VIEWS,
) -> PlannedViews:
    """The viewpoints of a plan's folder for a target: `count` usual ones, and further ones.

    A viewpoint is taken where the mirror (of the plan's size, at its place) shows the board and all of the target's markers, past the
    robot's own body, with no real ball beside them, and the body keeps clear of the glass, at the target and on the straight way to it from
    `start` (rad by joint name; others at 0). The plan's own viewpoints come first, ordered by how well they measure together, as
    `propose_views` does; then, since a plan may show a posture in one viewpoint only, its mirror turned in other ways (unless it is fixed).

    Raises:
        MirrorPostureError: a folder that is no plan of this robot; a target, or a way to it, on which the robot touches itself or the table;
            fewer than two viewpoints, with the reason for each.
    """
    folder = Path(folder)
    planned = read_planned_room(folder, target.nominal)
    begin = None if start is None else _positions(target, start)
    trouble = planned.collision(target.positions, begin)
    if trouble is not None:
        raise MirrorPostureError(
            f"{folder}: the target cannot be held in this plan's room: {trouble}; choose another target, begin elsewhere, or "
            "plan with less clearance (--clearance-mm) or another --table"
        )
    left_out: list[str] = []

    def shown(mirrors: Sequence[MirrorPlace]) -> list[Prospect]:
        found = []
        for mirror in mirrors:
            view = _view(mirror, target)
            why = planned.why_not(mirror, target.positions, target.marker_indices, begin)
            seen = (
                prospects(target, view, (view.yaw_rad,), (view.pitch_rad,))
                if why is None and view.distance_m > 0.0
                else []
            )
            found += seen
            if not seen:
                why = why or "board or markers come too near to the edge of the picture"
                left_out.append(
                    f"yaw {math.degrees(view.yaw_rad):+.0f}°, pitch {math.degrees(view.pitch_rad):+.0f}°: {why}"
                )
        return found

    own = shown(planned.mirrors)
    told = tuple(left_out)
    kept = best_first(target, own, len(own)) or own[:1]
    chosen = best_first(target, [*own, *shown(planned.turned)], max(count, len(kept)) + FURTHER, kept)
    if len(chosen) < 2:
        raise MirrorPostureError(
            f"{folder}: needed two ways to turn this plan's mirror for the target, got {len(own)} ({'; '.join(left_out) or 'it has one'}); "
            "choose another target or other markers, or go without --plan"
        )
    views = [one.view for one in chosen]
    return PlannedViews(tuple(views[:count]), tuple(views[count:]), told, planned.warnings)


def _positions(target: Target, named: Mapping[str, float]) -> npt.NDArray[np.float64]:
    names = target.nominal.robot.position_names
    return np.array([float(named.get(name, 0.0)) for name in names])


def _view(mirror: MirrorPlace, target: Target) -> View:
    """A plan's mirror as a view of the target: its normal in the root's frame, and how far the board is from it then."""
    nominal = target.nominal
    root, board = nominal.robot.link_poses(
        target.positions[None], [nominal.metadata.root, target.board_link]
    )[0]
    normal = mirror.normal_in_root
    board_in_root = np.linalg.solve(root, board)[:3, 3]
    return View(
        math.atan2(normal[1], normal[0]),
        math.asin(float(np.clip(normal[2], -1.0, 1.0))),
        float(normal @ (mirror.center_in_root_m - board_in_root)),
    )
