"""Postures that may be held before a mirror: drawn at random within the limits, and sifted by sight, body and room."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from .options import MirrorPlace, PlanOptions
from .setting import Setting
from .sight import Scene, Sight, look, scene_of

if TYPE_CHECKING:
    from ..shapes.body import Body

Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

NEAR_HOME = (0.15, 0.35, 0.7)
"""Besides postures from the whole ranges some are drawn nearer to home, where more of them are in sight."""
GLASS_CLEARANCES = 3.0
"""Clearances that the body keeps from the glass: the mirror does not stand exactly where it was meant."""
ALWAYS_SAMPLES = 40
ALWAYS_SHARE = 0.95
AS_NEAR_AS_AT_HOME = 0.5
RIM_SHARE, RIM_LEAST = 0.8, 3
"""A ball counts as seen where its middle is, and so many of four points this share of its radius off it: of a half-hidden one the outline is
not found surely."""
FACE_POINTS = 5
"""Of the board's face, each way, that nothing may hide."""
LEAST_BODY_M = 0.02
"""Without shapes: every link's origin is taken for a ball of this radius."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """C pairs of a posture and a view in which it may be held, and why others were not taken."""

    positions: Floats
    """(C, nq)."""
    view: npt.NDArray[np.int64]
    """(C,)."""
    markers: Mask
    """(C, M): the balls that are seen."""
    reasons: dict[str, int] = field(default_factory=dict)
    """How many drawn postures each test took away."""
    drawn: int = 0


def draw(setting: Setting, count: int, random: np.random.Generator) -> Floats:
    """Random postures (count, nq) within the limits, home among them."""
    low, high, home = setting.low, setting.high, setting.home
    uniform = low + (high - low) * random.random((count, len(home)))
    scale = random.choice([1.0, *NEAR_HOME], size=(count, 1))
    found: Floats = np.clip(home + scale * (uniform - home), low, high)
    found[0] = home
    return found


def ignore_by_construction(body: Body, setting: Setting, random: np.random.Generator) -> list[str]:
    """Has the body ignore pairs of links that touch at home or nearly always; returns them.

    First by the links' convex hulls. Those that overlap may be hollow, as a torso is at its armpits: they are compared again piece
    by piece, and what is free then at home may come half as near as there (at most the clearance), not nearer.
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


@dataclass(eq=False)
class Room:
    """What a posture must keep clear of: itself, the table, the glass."""

    setting: Setting
    body: Body | None
    clearance_m: float
    table_m: float | None
    """Height along `up` in the base's frame."""

    def links(self) -> list[str]:
        """The links that the plan moves."""
        return sorted(moved_links(self.setting))

    def take(self, positions: Floats) -> None:
        """What follows is asked of this posture."""
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
        """Whether the robot stays before the mirror's plane; told in the base's frame."""
        at = float(mirror.normal_in_root @ mirror.center_in_root_m)
        return self.reach_m(mirror.normal_in_root) < at - GLASS_CLEARANCES * self.clearance_m


def sift(
    setting: Setting,
    mirrors: Sequence[MirrorPlace],
    room: Room,
    options: PlanOptions,
    postures: Floats,
    most: int,
    random: np.random.Generator,
) -> Candidates:
    """The pairs of these postures (N, nq) and mirrors (in the base's frame) that can be taken, at most `most` postures."""
    reasons: Counter[str] = Counter()
    scene = scene_of(setting, postures)
    sights = [look(setting, scene, mirror) for mirror in mirrors]
    wanted = np.zeros((len(postures), len(mirrors)), dtype=bool)
    board = np.stack([sight.board for sight in sights], axis=1)
    some = np.stack([sight.markers.any(axis=1) for sight in sights], axis=1)
    real = sights[0].real & (not options.real_balls_allowed)
    wanted = board & some & ~real[:, None]
    reasons["a real ball is in the picture beside its reflection"] = int(real.sum())
    reasons["the board is not to be seen in the mirror"] = int((~real & ~board.any(axis=1)).sum())
    reasons["no ball is to be seen in the mirror"] = int(
        (~real & board.any(axis=1) & ~(board & some).any(axis=1)).sum()
    )
    rows = np.flatnonzero(wanted.any(axis=1))
    random.shuffle(rows)
    taken, views, seen = [], [], []
    kept = 0
    for row in rows:
        if kept >= most:
            break
        room.take(postures[row])
        trouble = room.collision()
        if trouble is not None:
            reasons[f"it {trouble}"] += 1
            continue
        found = False
        for number in np.flatnonzero(wanted[row]).tolist():
            mirror, sight = mirrors[number], sights[number]
            if not room.glass_free(mirror):
                reasons["it comes too near to the glass"] += 1
                continue
            balls = _unhidden(setting, room.body, scene, sight, mirror, int(row))
            if balls is None:
                reasons["the robot hides the board from the mirror"] += 1
                continue
            if not balls.any():
                reasons["the robot hides its balls from the mirror"] += 1
                continue
            taken.append(postures[row])
            views.append(int(number))
            seen.append(balls)
            found = True
        kept += found
    markers = len(setting.nominal.metadata.markers)
    return Candidates(
        np.array(taken).reshape(-1, postures.shape[1]),
        np.array(views, dtype=np.int64),
        np.array(seen, dtype=bool).reshape(-1, markers),
        {reason: count for reason, count in reasons.items() if count},
        len(postures),
    )


def _face(setting: Setting, scene: Scene, row: int) -> Floats:
    """Points all over the board's print, its outermost squares included, in the camera's frame: the scene has its corners only."""
    board, (first, right, down) = setting.board, scene.corners[row][:3]
    x, y = (right - first) / (board.columns - 1), (down - first) / (board.rows - 1)
    across, along = np.linspace(-1.0, board.columns, FACE_POINTS), np.linspace(-1.0, board.rows, FACE_POINTS)
    grid = np.stack(np.meshgrid(across, along), axis=-1).reshape(-1, 2)
    points: Floats = first + grid[:, :1] * x + grid[:, 1:] * y
    return points


def _rim(centre: Floats, way: Floats, radius_m: float) -> Floats:
    """Points (4, 3) near the rim of what is seen of a ball along a way."""
    first = np.cross(way, [1.0, 0.0, 0.0] if abs(way[0]) < abs(way[1]) else [0.0, 1.0, 0.0])
    first /= np.linalg.norm(first)
    second = np.cross(way, first) / np.linalg.norm(way)
    points: Floats = centre + RIM_SHARE * radius_m * np.array([first, -first, second, -second])
    return points


def _unhidden(
    setting: Setting, body: Body | None, scene: Scene, sight: Sight, mirror: MirrorPlace, row: int
) -> Mask | None:
    """The balls (M,) that are seen and that no part of the robot hides, on the way to the mirror or back; None: the board is hidden."""
    if body is None:
        alone: Mask = sight.markers[row]
        return alone
    base_from_camera = np.linalg.inv(scene.camera_from_base[row])
    eye = base_from_camera[:3, 3]
    normal, at = mirror.normal_in_root, float(mirror.normal_in_root @ mirror.center_in_root_m)
    balls = np.flatnonzero(sight.markers[row])
    turn = base_from_camera[:3, :3].T
    face, centres = _face(setting, scene, row) @ turn + eye, scene.markers[row][balls] @ turn + eye

    def clear(points: Floats, keep_off_m: float) -> Mask:
        image = points + 2.0 * (at - points @ normal)[:, None] * normal
        share = (at - eye @ normal) / ((image - eye) @ normal)
        crossing = eye + share[:, None] * (image - eye)
        found: Mask = ~body.hidden(eye, crossing, [setting.camera_link], np.zeros(len(points)))
        off = np.array([keep_off_m])
        for k in np.flatnonzero(found):
            found[k] = not body.hidden(crossing[k], points[k : k + 1], [], off)[0]
        return found

    if not clear(face, 1e-3).all():
        return None
    seen = np.zeros(sight.markers.shape[1], dtype=bool)
    for ball, centre in zip(balls, centres, strict=True):
        radius, towards = float(setting.radii_m[ball]), centre + 2.0 * (at - centre @ normal) * normal - eye
        off = radius + 1e-3
        seen[ball] = (
            clear(centre[None], off)[0] and clear(_rim(centre, towards, radius), off).sum() >= RIM_LEAST
        )
    return seen
