"""Makes a plan from a session's folder: the mirror's place, the postures, their order, and what they will
show."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from .._core import MirrorPostureError
from ..arguments import checked_arguments
from ..arrays import Floats, Integers, Mask
from ..counted import counted
from ..robots.nominal import Nominal
from .candidates import Candidates, sift
from .choose import choose, order, stands_clear
from .options import MirrorPlace, PlanOptions, turned_mirrors
from .room import Room, room_of
from .setting import Setting, draw, read_setting
from .sight import look, scene_of
from .telling import Tells, what_it_tells

DISTANCES = (1.0, 1.25, 1.6, 2.0, 2.5, 3.2)
"""Of the mirror from the board, in reaches of the robot towards it; the nearest that shows enough is taken."""
LEAST_DISTANCE_M = 0.15
DRAWN_FOR_A_DISTANCE = 1500
DRAWN = 6000
POOL = 160
"""Smallest number of postures to choose from; more where more are requested."""
LEAST_FRAMES = 4


@dataclass(frozen=True, eq=False)
class Plan:
    """Postures in the order of execution, each with its mirror, and what they will show."""

    setting: Setting
    options: PlanOptions
    mirrors: tuple[MirrorPlace, ...]
    """The views, in the root's frame."""
    positions: Floats
    """(F, nq) commanded, in the order of `Robot.position_names`, rad (m)."""
    view: Integers
    """(F,)."""
    posture: Integers
    """(F,)."""
    markers: Mask
    """(F, M): the balls that will be seen."""
    tells: tuple[Tells, ...]
    not_taken: dict[str, int]
    """Why drawn postures were not taken, and how many."""
    drawn: int
    warnings: tuple[str, ...]
    ignored_pairs: tuple[str, ...]
    """Pairs of links whose shapes overlap by construction: they are not checked."""
    distance_m: float
    """Of the mirror's plane from the board's centre, in the first view."""


@checked_arguments
def make_plan(
    folder: str | os.PathLike[str],
    options: PlanOptions | None = None,
    *,
    say: Callable[[str], None] | None = None,
) -> Plan:
    """Plans postures and views for the robot of a session's folder (`init` makes one; no frames are
    needed).

    Every posture is within the joints' limits, clear of the robot itself, of the table and of the glass,
    also on the straight path from the previous one; board and balls are visible in the mirror's finite
    frame, and no real ball is in the picture.

    Raises:
        MirrorPostureError: a folder that cannot be planned for; too few postures, with the reasons why others were rejected.
    """
    say = say or (lambda _: None)
    nominal = Nominal.load(folder)
    options = (options or PlanOptions()).before(nominal.metadata.mirror)
    setting = read_setting(nominal, options)
    random = np.random.default_rng(options.seed)
    room, ignored, warnings = room_of(setting, options, random)
    say("looking for the mirror's place")
    mirrors = _place(setting, room, options, random)
    say("drawing postures")
    candidates = _gather(setting, mirrors, room, options, random)
    mirrors, candidates = _best_views(mirrors, candidates, options)
    if not len(candidates.view):
        raise _too_few(nominal, candidates, 0)
    views = sorted(set(candidates.view.tolist()))
    frames = options.postures * (len(views) if options.same_postures else 1)
    say(f"choosing among {counted(len(candidates.view), 'picture')}")
    share = [options.postures // len(views) + (k < options.postures % len(views)) for k in range(len(views))]
    blocks = [options.postures] * len(views) if options.same_postures else share
    chosen = choose(setting, candidates, mirrors, blocks, options.same_postures, random)
    say("ordering them on free paths")
    rows, trouble = _ordered(setting, room, mirrors, candidates, chosen)
    reasons = Counter(candidates.reasons) + trouble
    if len(rows) < LEAST_FRAMES:
        raise _too_few(nominal, replace(candidates, reasons=dict(reasons)), len(rows))
    positions, view = candidates.positions[rows], candidates.view[rows]
    say("what they will tell")
    tells = what_it_tells(setting, positions, mirrors, view, candidates.markers[rows])
    if len(rows) < sum(len(block) for block in chosen):
        warnings.append(
            f"{counted(sum(map(len, chosen)) - len(rows), 'posture was', 'postures were')} left out: no free way led there from the one before"
        )
    if len(rows) < frames:
        warnings.append(
            f"{len(rows)} pictures are planned, {frames} were asked for: no more postures can be taken"
        )
    warnings += _standing(setting, room, [mirrors[v] for v in view], positions)
    _, posture = np.unique(positions.round(12), axis=0, return_inverse=True)
    if not options.same_postures:
        posture = np.arange(len(rows))
    board = nominal.robot.link_poses(setting.home[None], [setting.board.link])[0, 0, :3, 3]
    first = mirrors[view[0]]
    used = sorted(set(view.tolist()))
    return Plan(
        setting, options,
        tuple(setting.in_root(mirrors[number]) for number in used),
        positions, np.searchsorted(used, view), _renumbered(posture), candidates.markers[rows], tells,
        dict(reasons), candidates.drawn, tuple(warnings), tuple(ignored),
        float(first.normal_in_root @ (first.center_in_root_m - board)),
    )  # fmt: skip


def _place(
    setting: Setting, room: Room, options: PlanOptions, random: np.random.Generator
) -> list[MirrorPlace]:
    """The mirror's views, in the base's frame: as given, or where it shows most."""
    if options.mirror_at_m is not None:
        turn, shift = setting.base_from_root[:3, :3], setting.base_from_root[:3, 3]
        center = turn @ np.array(options.mirror_at_m) + shift
        return turned_mirrors(options, center, setting.forward, setting.up)
    nominal = setting.nominal
    links = [setting.camera_link, setting.board.link, *(m.link for m in nominal.metadata.markers)]
    postures = draw(setting, DRAWN_FOR_A_DISTANCE, random)
    poses = nominal.robot.link_poses(postures, links)[:, :, :3, 3]
    camera, board = poses[0, 0], poses[0, 1]
    markers = poses[:, 2:].reshape(-1, 3)
    # How far the balls mostly come forward: postures that reach farther fall away.
    reach = float(np.quantile((markers - board) @ setting.forward, 0.8)) + 3.0 * room.clearance_m
    room.take(setting.home)
    ahead = room.reach_m(setting.forward) - float(board @ setting.forward) + 4.0 * room.clearance_m
    # Camera and board that are far apart see each other in the mirror at a moderate angle only from some way off.
    apart = 0.5 * float(np.linalg.norm(camera - board))
    reach = max(reach, ahead, apart, LEAST_DISTANCE_M)
    scene = scene_of(setting, postures)
    middle = 0.5 * (board + np.median(markers, axis=0))
    best: tuple[float, Floats] = (0.0, board + reach * setting.forward)
    for factor in DISTANCES:
        for sight in (middle, board):
            # Half-way between the camera and what it looks at, where the plane is.
            aim = 0.5 * (camera + sight)
            center = aim + (float((board - aim) @ setting.forward) + factor * reach) * setting.forward
            mirror = turned_mirrors(replace(options, mirror_fixed=True), center, setting.forward, setting.up)[
                0
            ]
            seen = look(setting, scene, mirror)
            usable = seen.board & ~(seen.real & (not options.real_balls_allowed))
            path = factor * reach * 2.0
            value = float((seen.markers.sum(axis=1) * usable).sum()) / path
            if value > 1.05 * best[0]:
                best = (value, center)
    return turned_mirrors(options, best[1], setting.forward, setting.up)


def _gather(
    setting: Setting,
    mirrors: list[MirrorPlace],
    room: Room,
    options: PlanOptions,
    random: np.random.Generator,
) -> Candidates:
    return sift(
        setting, mirrors, room, options, draw(setting, DRAWN, random), max(POOL, 4 * options.postures), random
    )


def _best_views(
    mirrors: list[MirrorPlace], candidates: Candidates, options: PlanOptions
) -> tuple[list[MirrorPlace], Candidates]:
    """The views that show most balls, turned apart from each other; the candidates of the others are left."""
    counts = np.array(
        [candidates.markers[candidates.view == k].sum() for k in range(len(mirrors))], dtype=float
    )
    if not counts.any():
        return mirrors, candidates
    chosen: list[int] = []
    for _ in range(options.views):
        spread = np.array(
            [min((_apart(mirrors[k], mirrors[c]) for c in chosen), default=1.0) for k in range(len(mirrors))]
        )
        value = counts * np.minimum(spread, math.radians(25.0))
        best = int(np.argmax(value))
        if value[best] <= 0.05 * counts.max() * math.radians(5.0):
            break
        chosen.append(best)
    chosen.sort(key=lambda k: (mirrors[k].yaw_rad, mirrors[k].pitch_rad))
    keep = np.isin(candidates.view, chosen)
    number = {old: new for new, old in enumerate(chosen)}
    return [mirrors[k] for k in chosen], replace(
        candidates,
        positions=candidates.positions[keep],
        view=np.array([number[int(v)] for v in candidates.view[keep]], dtype=np.int64),
        markers=candidates.markers[keep],
    )


def _apart(a: MirrorPlace, b: MirrorPlace) -> float:
    return math.acos(float(np.clip(a.normal_in_root @ b.normal_in_root, -1.0, 1.0)))


def _ordered(
    setting: Setting,
    room: Room,
    mirrors: list[MirrorPlace],
    candidates: Candidates,
    chosen: list[list[int]],
) -> tuple[list[int], Counter[str]]:
    rows: list[int] = []
    trouble: Counter[str] = Counter()
    tally = np.zeros((3, candidates.positions.shape[1]))
    here = setting.home
    views = [view for view, block in enumerate(chosen) if block]
    for view, after in zip(views, [*views[1:], None], strict=True):
        block = chosen[view]
        postures = candidates.positions[block]
        onward = None if after is None else mirrors[after]
        torque = setting.torques_nm(postures)
        found, why = order(setting, room, mirrors[view], postures, here, tally, torque, onward)
        trouble += why
        rows += [block[i] for i in found]
        if found:
            here = postures[found[-1]]
    return rows, trouble


def _standing(setting: Setting, room: Room, mirrors: Sequence[MirrorPlace], positions: Floats) -> list[str]:
    """What is in the robot's way where it begins, and where it stands while the mirror is turned: paths are checked between their ends only."""
    clear = stands_clear(room, mirrors[0], setting.home)
    trouble = room.collision() or (None if clear else "comes too near to the glass of the first view")
    found = []
    if trouble is not None:
        found.append(
            f"at home the robot {trouble}: begin at another --home, or check --table and --mirror-at"
        )
    found += [
        f"at frame {at} the robot is too near to the glass of the next view: move it away before you turn the mirror"
        for at, (mirror, after) in enumerate(pairwise(mirrors))
        if after is not mirror and not stands_clear(room, after, positions[at])
    ]
    return found


def _renumbered(posture: Integers) -> Integers:
    """The same numbers in the order of their first appearance."""
    first: dict[int, int] = {}
    return np.array([first.setdefault(int(p), len(first)) for p in posture], dtype=np.int64)


def _too_few(nominal: Nominal, candidates: Candidates, count: int) -> MirrorPostureError:
    why = "; ".join(
        f"{n} of {candidates.drawn}: {reason}"
        for reason, n in sorted(candidates.reasons.items(), key=lambda r: -r[1])
    )
    return MirrorPostureError(
        f"{nominal.folder}: only {counted(count, 'picture')} can be planned, needed {LEAST_FRAMES}. Of the postures that were drawn: {why}. "
        "What helps: a larger mirror or another place (--mirror-size, --mirror-at), a table or floor that lies elsewhere (--table), "
        "less clearance (--clearance-mm), fewer joints (--hold), another --home, other places of camera, board and balls"
    )
