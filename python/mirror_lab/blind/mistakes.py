"""Gross mistakes: the written session (model, log, names) differs from what was done.

The true machine and the light are unchanged; a mistake changes what is written: a column, the URDF,
camera.yaml, a name, an index. Slips are physical: from a row on a marker, the board or the camera is really
displaced. Each draw returns the causes in the public vocabulary.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .errors import NoPlaceError

if TYPE_CHECKING:
    from .simulate import Case

Array = NDArray[np.float64]
Cause = dict[str, Any]


@dataclass
class Told:
    """What is written of the session; a mistake changes it."""

    urdf: str
    q: Array
    """(F, J) the columns of frames.csv."""
    time_s: Array
    lens_factor: float = 1.0
    lens_shift_px: Array = field(default_factory=lambda: np.zeros(2))
    square_m: float = 0.0
    gravity: Array = field(default_factory=lambda: np.zeros(3))
    pictured: set[str] = field(default_factory=set)
    """Mistakes of camera and mirror so far: at most one is drawn."""


Mistake = Callable[[np.random.Generator, "Case", Told], list[Cause]]


def told_truly(case: Case) -> Told:
    """What is written where nothing is mistaken."""
    off_rad = 0.0 if case.logged_off_rad is None else case.logged_off_rad
    return Told(
        case.robot.urdf,
        (case.plan.commands.q_rad + off_rad)[case.plan.posture_of_frame],
        case.plan.time_of_frame_s,
        square_m=case.robot.board_square_m,
        gravity=case.gravity,
    )


def moved_joints(case: Case, least_range_rad: float = 0.3) -> list[str]:
    """Joints that move a marker and are moved themselves."""
    robot, commands = case.robot, case.plan.commands
    return [
        j
        for j in commands.joints
        if set(robot.moves(j)) - {"camera", "board"} and np.ptp(commands.of(j)) > least_range_rad
    ]


def pick(rng: np.random.Generator, names: list[str], what: str) -> str:
    """One of the names; NoPlaceError where there is none."""
    if not names:
        raise NoPlaceError(f"this robot has no place for {what}")
    return str(names[int(rng.integers(len(names)))])


def column_of(case: Case, joint: str) -> int:
    """The joint's column of `Told.q`."""
    return case.plan.commands.joints.index(joint)


def axis_sign(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    j = pick(rng, moved_joints(case), "axis_sign")
    tree = ET.fromstring(told.urdf)
    axis = next(e for e in tree.findall("joint") if e.get("name") == j).find("axis")
    if axis is None:
        raise NoPlaceError(f"{j} has no axis element")
    axis.set("xyz", " ".join(f"{-float(v):.9g}" for v in axis.get("xyz", "1 0 0").split()))
    told.urdf = ET.tostring(tree, encoding="unicode")
    return [{"effect": "axis_sign", "at": f"joint:{j}"}]


def joints_swapped(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    joints = moved_joints(case)
    j = pick(rng, joints, "joints_swapped")
    k = pick(rng, [k for k in joints if k != j], "joints_swapped")
    return [_swapped(case, told, j, k)]


def _swapped(case: Case, told: Told, j: str, k: str) -> Cause:
    a, b = column_of(case, j), column_of(case, k)
    told.q[:, [a, b]] = told.q[:, [b, a]]
    return {"effect": "joints_swapped", "at": f"joint:{j}<->joint:{k}"}


def left_right(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    """All columns of the left side for the right one's."""
    joints = moved_joints(case, 0.05)
    pairs = [(j, k) for j in joints for k in joints if k == right_of(j) and k != j]
    if not pairs:
        raise NoPlaceError("this robot has no two sides")
    return [_swapped(case, told, j, k) for j, k in pairs]


def right_of(joint: str) -> str:
    """The name of the right side's joint; the same for one that is not of the left: `l_elbow`, `arm_left_1_joint`, `LElbow`."""
    return re.sub(r"(?<![A-Za-z])(?:l_|left)|^L(?=[A-Z])", lambda found: OTHER_SIDE[found[0]], joint)


OTHER_SIDE = {"l_": "r_", "left": "right", "L": "R"}


def degrees(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    j = pick(rng, moved_joints(case), "joint_unit")
    told.q[:, column_of(case, j)] *= 180 / np.pi
    return [{"effect": "joint_unit", "at": f"joint:{j}", "factor": np.pi / 180}]


def all_degrees(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    told.q *= 180 / np.pi
    return [{"effect": "joint_unit", "at": "robot", "factor": np.pi / 180}]


def joint_frozen(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    """The log stands still over a run of rows."""
    j = pick(rng, moved_joints(case), "joint_frozen")
    frames = len(told.q)
    length = int(rng.integers(frames // 4, frames // 2))
    first = int(rng.integers(3, frames - length - 3))
    column = told.q[:, column_of(case, j)]
    column[first : first + length] = column[first - 1]
    return [
        {"effect": "joint_frozen", "at": f"joint:{j}", "first_frame": first, "last_frame": first + length - 1}
    ]


def joint_late(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    """One column by a fraction of a row or more."""
    j = pick(rng, moved_joints(case), "joint_late")
    delay_s = _delay(rng, told)
    k = column_of(case, j)
    told.q[:, k] = _earlier(told, delay_s)[:, k]
    return [{"effect": "joint_late", "at": f"joint:{j}", "delay_s": delay_s}]


def clock_late(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    """All columns."""
    delay_s = _delay(rng, told)
    told.q = _earlier(told, delay_s)
    return [{"effect": "joint_late", "at": "robot", "delay_s": delay_s}]


def _delay(rng: np.random.Generator, told: Told) -> float:
    return float(rng.uniform(0.25, 1.5) * np.median(np.diff(told.time_s)))


def _earlier(told: Told, delay_s: float) -> Array:
    return np.stack([np.interp(told.time_s - delay_s, told.time_s, q) for q in told.q.T], axis=1)


def markers_swapped(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    """Two names exchanged, in all frames or in some."""
    names = case.robot.markers
    if len(names) < 2:
        raise NoPlaceError("this robot has one marker")
    a, b = (int(i) for i in rng.permutation(len(names))[:2])
    share = 1.0 if rng.random() < 0.5 else float(rng.uniform(0.05, 0.3))
    hit = np.flatnonzero(rng.random(len(case.blobs_px)) < share)
    first = case.blobs_px[hit, a].copy()
    case.blobs_px[hit, a], case.blobs_px[hit, b] = case.blobs_px[hit, b], first
    return [
        {
            "effect": "markers_swapped",
            "at": f"marker:{names[a]}<->marker:{names[b]}",
            "share": len(hit) / max(len(case.blobs_px), 1),
        }
    ]


def _once(told: Told, what: str) -> None:
    if told.pictured:
        raise NoPlaceError(f"{what}: the picture has a mistake already")
    told.pictured.add(what)


def camera_resolution(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    """camera.yaml of another resolution, or of a crop."""
    _once(told, "camera")
    if rng.random() < 0.6:
        factor, shift = float(rng.choice([0.5, 2.0, 0.75])), np.zeros(2)
    else:
        factor, shift = 1.0, rng.uniform(30, 90, 2) * rng.choice([-1, 1], 2)
    # The written intrinsics are the factor times the true ones, plus the shift.
    told.lens_factor, told.lens_shift_px = 1 / factor, -shift / factor
    return [
        {
            "effect": "camera_resolution",
            "at": "camera",
            "factor": factor,
            "du_px": float(shift[0]),
            "dv_px": float(shift[1]),
            "tolerated": [{"effect": "camera_center", "at": "camera"}] if factor == 1.0 else [],
        }
    ]


def picture_flipped(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    _once(told, "flip")
    flip = int(rng.integers(1, 4))
    width, height = case.robot.image_size
    for px in (case.corners_px, case.blobs_px):
        if flip & 1:
            px[..., 0] = width - 1 - px[..., 0]
        if flip & 2:
            px[..., 1] = height - 1 - px[..., 1]
    return [{"effect": "picture_flipped", "at": "camera", "flip": flip}]


def square_size(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    """The board was printed at another scale than is told."""
    _once(told, "square")
    scale = float(rng.choice([-0.3, -0.2, -0.1, 0.1, 0.25, 0.4]))
    told.square_m = case.robot.board_square_m / (1 + scale)
    return [{"effect": "board_scale", "at": "board", "scale_error": scale}]


def right_angle_zero(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    j = pick(rng, moved_joints(case), "joint_offset")
    offset = float(rng.choice([-1, 1])) * np.pi / 2
    told.q[:, column_of(case, j)] -= offset
    return [{"effect": "joint_offset", "at": f"joint:{j}", "offset_rad": offset}]


def scaled_column(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    """A gear box of another ratio than is told."""
    j = pick(rng, moved_joints(case, 0.6), "gear_ratio")
    factor = float(rng.choice([0.75, 0.8, 1.25, 1.5, 2.0]))
    told.q[:, column_of(case, j)] /= factor
    return [{"effect": "gear_ratio", "at": f"joint:{j}", "scale_error": factor - 1}]


def board_turned(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    """Corners counted from the other end."""
    _once(told, "board")
    case.corners_px[:] = case.corners_px[:, ::-1].copy()
    return [{"effect": "board_turned", "at": "board", "turn_rad": np.pi}]


def marker_parent(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    """The URDF has the marker on a neighbouring link, which moves differently."""
    robot = case.robot
    options = []
    for m in robot.markers:
        own = robot.bodies[robot.index[f"{m}_marker"]].parent
        for other in (robot.bodies[own].parent, robot.next_body(own)):
            moves = other is not None and robot.rigid_root(other) != robot.rigid_root(own)
            if other is not None and moves and other > 0 and robot.bodies[other].joint in moved_joints(case):
                options.append((m, own, other))
    if not options:
        raise NoPlaceError("this robot has no marker on a moving link beside another")
    m, own, other = options[int(rng.integers(len(options)))]
    tree = ET.fromstring(told.urdf)
    mount = next(
        j
        for j in tree.findall("joint")
        if (child := j.find("child")) is not None and child.get("link") == f"{m}_marker"
    )
    parent = mount.find("parent")
    if parent is None:
        raise NoPlaceError(f"the mount of {m} has no parent element")
    parent.set("link", robot.bodies[other].name)
    told.urdf = ET.tostring(tree, encoding="unicode")
    on, by = (f"marker:{m}<-link:{robot.bodies[k].name}" for k in (own, robot.rigid_root(own)))
    cause = {"effect": "marker_parent", "at": on}
    # Links that are fixed to each other are one body.
    return [cause if on == by else cause | {"tolerated": [{"effect": "marker_parent", "at": by}]}]


def gravity_sign(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    """Gravity points upwards; a spring is drawn as well, since only its deflection shows it."""
    told.gravity = -case.gravity
    return [{"effect": "gravity_direction", "at": "robot"}]


def shifted_rows(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    """A run of rows holds the measurement of others."""
    first, last = run_of_rows(rng, len(told.q))
    shift = int(rng.choice([-3, -2, -1, 1, 2, 3]))
    source = np.arange(len(told.q))
    source[first : last + 1] += shift
    return [pictures_of_rows(case, source) | {"shift_rows": shift}]


def run_of_rows(rng: np.random.Generator, frames: int) -> tuple[int, int]:
    """The first and the last of a sixth to a third of the rows."""
    length = int(rng.integers(frames // 6, frames // 3))
    first = int(rng.integers(8, frames - length - 8))
    return first, first + length - 1


def pictures_of_rows(case: Case, source: NDArray[np.int_]) -> Cause:
    """Each row gets what was seen in the row `source`; the cause, from the first row to the last that has another's."""
    case.corners_px[:], case.blobs_px[:] = case.corners_px[source], case.blobs_px[source]
    others = np.flatnonzero(source != np.arange(len(source)))
    return {
        "effect": "pairing",
        "at": "data",
        "first_frame": int(others[0]),
        "last_frame": int(others[-1]),
    }


MISTAKES: dict[str, Mistake] = {
    f.__name__: f
    for f in (
        axis_sign,
        joints_swapped,
        left_right,
        degrees,
        all_degrees,
        joint_frozen,
        joint_late,
        clock_late,
        markers_swapped,
        camera_resolution,
        picture_flipped,
        square_size,
        right_angle_zero,
        scaled_column,
        board_turned,
        marker_parent,
        gravity_sign,
        shifted_rows,
    )
}
SLIPS = ("slip_marker", "slip_board", "slip_camera")
"""Drawn in `simulate`: they are physical."""
NOT_TWICE = {"left_right", "all_degrees", "clock_late", "shifted_rows", "gravity_sign"}
"""Mistakes that touch everything: they come alone, or with a small cause."""


def draw_mistakes(rng: np.random.Generator, kinds: list[str], case: Case, made: dict[str, Mistake]) -> Told:
    """Makes the named mistakes in what is written of a case, each at another place, and adds them to its answer.

    Raises NoPlaceError where a robot has none.
    """
    told = told_truly(case)
    for kind in kinds:
        taken = {place for c in case.answer["causes"] for place in _places(c["at"])}
        before = (told.urdf, told.q.copy())
        for attempt in range(40):
            told.urdf, told.q = before[0], before[1].copy()
            causes = made[kind](rng, case, told)
            if not any(p in taken for c in causes for p in _places(c["at"])):
                break
            if kind in ("markers_swapped",) or attempt == 39:
                raise NoPlaceError(f"no free place left for {kind}")
        for cause in causes:
            cause |= {
                "mistake": kind,
                "detectable": True,
                "identifiable": cause.get("identifiable", kind != "gravity_sign"),
                "rivals": [],
            }
        case.answer["causes"] += causes
    return told


def _places(at: str) -> list[str]:
    return [p for p in re.split(r"<->|<-", at) if p not in ("robot", "data")]


def kinds_for(rng: np.random.Generator, number: int) -> list[str]:
    """Names of `number` mistakes that can be made at once."""
    every = [*MISTAKES, *SLIPS]
    if number == 1:
        return [str(rng.choice(every))]
    alone = [k for k in every if k not in NOT_TWICE and k not in SLIPS]
    return [str(k) for k in rng.choice(alone, number, replace=False)]
