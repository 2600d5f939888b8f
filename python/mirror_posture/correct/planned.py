"""The viewpoints of a plan for a correction: orientations of its mirror in which this target may be held
and is visible."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .._core import MirrorPostureError
from ..arguments import checked_arguments
from ..arrays import Floats
from ..plan.again import PlannedRoom, read_planned_room
from ..plan.options import MirrorPlace
from ..viewpoint import View
from .planner import USUAL_VIEWS, Prospect, best_first, predicted_std_m, prospects
from .target import Target

FARTHER = (1.0, 1.25, 1.6, 2.0)
"""A target may reach farther than the plan's postures, or need more of the picture: largest mirror
distance, in multiples of the planned one."""
GOOD_STD_M = 0.00015
"""Of a marker along its worst axis: with this a correction sees a millimetre, and the mirror stays where it is."""
FURTHER = 3
"""Additional viewpoints: for a look that would otherwise measure too badly, or that turns out to be too
uncertain."""


@dataclass(frozen=True)
class PlannedViews:
    """What a plan offers to a correction."""

    usual: tuple[View, ...]
    """Of every look, best first."""
    further: tuple[View, ...]
    """For a look that is too uncertain for a decision."""
    std_m: float
    """The largest standard deviation that a marker would have along its worst axis, as the model predicts it."""
    warnings: tuple[str, ...]
    """What could not be checked."""


@checked_arguments
def views_of_plan(
    target: Target,
    folder: str | os.PathLike[str],
    start: Mapping[str, float] | None = None,
    count: int = USUAL_VIEWS,
) -> PlannedViews:
    """The viewpoints of a plan's mirror for a target: `count` usual ones (up to three more where these
    measure too badly), and further ones.

    A viewpoint is accepted if the mirror, with the plan's size, shows the board and all of the target's
    markers past the robot's own body, with no real ball beside them, and if the body keeps the plan's
    clearance from the glass, at the target and on the straight path to it from `start` (rad by joint name;
    others at 0). The mirror is turned in many ways and slid within its plane so that it shows them. It is
    at the plan's distance, or farther where that measures too badly; one whose place was given
    (`--mirror-at`, `mirror.center`) stays. Chosen are the orientations that measure best together, as in
    `propose_views`.

    Raises:
        MirrorPostureError: a folder that is no plan of this robot; a target, or a path to it, on which the robot touches itself or the table; fewer than two viewpoints, with the reasons.
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
    best: tuple[float, list[Prospect], list[Prospect]] = (math.inf, [], [])
    left_out: Counter[str] = Counter()
    for farther in (1.0,) if planned.told_place else FARTHER:
        offered, reasons = _offered(planned, target, begin, farther)
        left_out += reasons
        chosen = best_first(target, offered, count + FURTHER)
        if len(chosen) < 2:
            continue
        # More viewpoints a look where the first ones measure too badly.
        sets = [chosen[:number] for number in range(min(count, len(chosen)), len(chosen) + 1)]
        std_m = predicted_std_m(target, sets)
        good = np.flatnonzero(std_m <= GOOD_STD_M)
        number = int(good[0]) if len(good) else len(sets) - 1
        if std_m[number] < best[0]:
            best = float(std_m[number]), sets[number], chosen[len(sets[number]) :]
        if len(good):
            break
    if not best[1]:
        why = (
            "; ".join(f"{number} ways: {reason}" for reason, number in left_out.most_common())
            or "it is fixed"
        )
        raise MirrorPostureError(
            f"{folder}: needed two ways to turn this plan's mirror for the target, found fewer ({why}); "
            "choose another target or other markers, or go without --plan"
        )
    usual, further = (tuple(one.view for one in part) for part in best[1:])
    return PlannedViews(usual, further, best[0], planned.warnings)


def _offered(
    planned: PlannedRoom, target: Target, start: Floats | None, farther: float
) -> tuple[list[Prospect], Counter[str]]:
    """The possible orientations of the mirror at a multiple of the planned distance, and why others are not
    possible."""
    mirrors, seen = [], []
    for turned in planned.mirrors:
        mirror = planned.moved(turned, target.positions, target.marker_indices, farther)
        view = _view(mirror, target)
        if view.distance_m > 0.0:
            here = prospects(target, view, (view.yaw_rad,), (view.pitch_rad,))
            mirrors += [mirror] * len(here)
            seen += here
    good, reasons = planned.takeable(mirrors, target.positions, target.marker_indices, start)
    reasons["board or markers come too near to the picture's edge, or the robot to the glass"] += len(
        planned.mirrors
    ) - len(mirrors)
    return [seen[index] for index in good], reasons


def _positions(target: Target, named: Mapping[str, float]) -> Floats:
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
