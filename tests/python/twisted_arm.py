"""A six-axis arm beside a mast with camera and board, seen in a mirror or by a tracker: one of its links is twisted, or another one place is off.

Plain NumPy that shares nothing with the core. The markers are points, so that no outline enters.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from lifting_column import rotation

Floats = npt.NDArray[np.float64]

JOINTS = {
    "j1": ("base", "l1", (0.0, 0.0, 0.12), (0, 0, 1), 60),
    "j2": ("l1", "l2", (0.0, 0.0, 0.06), (0, 1, 0), 60),
    "j3": ("l2", "l3", (0.0, 0.0, 0.26), (0, 1, 0), 40),
    "j4": ("l3", "l4", (0.05, 0.0, 0.03), (1, 0, 0), 10),
    "j5": ("l4", "l5", (0.2, 0.0, 0.0), (0, 1, 0), 10),
    "j6": ("l5", "l6", (0.06, 0.0, 0.0), (1, 0, 0), 10),
}
"""Parent, child, origin, axis, effort."""
MASSES = {
    "l1": (2.0, (0.0, 0.0, 0.03)),
    "l2": (1.8, (0.0, 0.0, 0.13)),
    "l3": (1.0, (0.03, 0.0, 0.02)),
    "l4": (0.9, (0.1, 0.0, 0.0)),
    "l5": (0.5, (0.03, 0.0, 0.0)),
    "l6": (0.4, (0.04, 0.0, 0.0)),
}
MARKERS = {
    "fore": ("l3", (0.02, 0.0, 0.085)),
    "wrist": ("l4", (0.13, 0.0, 0.062)),
    "tool_a": ("l6", (0.09, 0.05, 0.0)),
    "tool_b": ("l6", (0.09, -0.05, 0.02)),
    "upper": ("l2", (0.07, 0.0, 0.18)),
}
CAMERA_M, BOARD_M = np.array([-0.05, 0.28, 0.62]), np.array([-0.04, 0.26, 0.35])
CORNERS, SQUARE_M = (7, 4), 0.03
FOCAL_PX, SIZE_PX = 826.0, (800, 600)
LOW_RAD = np.array([-1.1, -0.5, -0.9, -1.6, -1.3, -2.0])
HIGH_RAD = np.array([0.65, 0.88, 1.3, 1.6, 1.3, 2.0])
OFTEN_HIDDEN = "upper"


def _frames() -> tuple[Floats, Floats]:
    """Camera and board in the root: both look along +x, the camera a little down."""
    forward = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    camera = rotation(np.array([0.0, 0.18, 0.0])) @ forward
    board = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    return camera, board


def _rpy(turn: Floats) -> str:
    values = (
        np.arctan2(turn[2, 1], turn[2, 2]),
        -np.arcsin(turn[2, 0]),
        np.arctan2(turn[1, 0], turn[0, 0]),
    )
    return " ".join(f"{v:.12g}" for v in values)


def _urdf() -> str:
    camera, board = _frames()
    none = np.eye(3)
    fixed = {"camera": ("base", CAMERA_M, camera), "board": ("base", BOARD_M, board)}
    fixed |= {name: (link, np.array(at), none) for name, (link, at) in MARKERS.items()}
    links = '<link name="base"/>' + "".join(f'<link name="{name}"/>' for name in fixed)
    for name, (mass, at) in MASSES.items():
        links += (
            f'<link name="{name}"><inertial><origin xyz="{at[0]} {at[1]} {at[2]}"/><mass value="{mass}"/>'
            '<inertia ixx="0.002" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.002"/></inertial></link>'
        )
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="{at[0]} {at[1]} {at[2]}"/>'
        f'<axis xyz="{axis[0]} {axis[1]} {axis[2]}"/><limit lower="-3" upper="3" effort="{effort}" velocity="3"/></joint>'
        for name, (parent, child, at, axis, effort) in JOINTS.items()
    )
    joints += "".join(
        f'<joint name="{name}_fixed" type="fixed"><parent link="{link}"/><child link="{name}"/>'
        f'<origin xyz="{at[0]} {at[1]} {at[2]}" rpy="{_rpy(turn)}"/></joint>'
        for name, (link, at, turn) in fixed.items()
    )
    return f'<robot name="six_axis">{links}{joints}</robot>'


Numbers = tuple[float, float, float]
NO: Numbers = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Wrong:
    """What is wrong at a joint: its origin turned, its axis turned, its zero (from a row on), its origin shifted; and by how much a marker is off."""

    at: str
    twist_rad: Numbers = NO
    tilt_rad: Numbers = NO
    zero_rad: float = 0.0
    shift_m: Numbers = NO
    from_row: int = 0
    marker_m: tuple[str, Numbers] = ("", NO)


@dataclass(frozen=True)
class ByHand:
    """How far mounts are off, one standard deviation; stated as tolerances. Board and camera are turned by `rad` too."""

    m: float = 0.0
    rad: float = 0.0

    def line(self, *, turns: bool) -> str:
        """The lines of session.toml; none where mounts are exact."""
        if self.m == 0.0:
            return ""
        return f"tolerance_m = {self.m}\n" + (f"tolerance_rad = {self.rad}\n" if turns else "")


def _markers(hand: ByHand) -> str:
    """Their lines of session.toml."""
    return "".join(
        f'[[markers]]\nname = "{name}"\nlink = "{name}"\ndiameter = 0.0\n{hand.line(turns=False)}'
        for name in MARKERS
    )


def _session(gravity_m_per_s2: float, hand: ByHand) -> str:
    mount = hand.line(turns=True)
    return (
        'format = "mirror-posture/session"\nversion = 1\nrobot = "robot.urdf"\ncamera = "camera.yaml"\nroot = "base"\n'
        f'gravity = [0.0, 0.0, {gravity_m_per_s2}]\n[camera_mount]\nlink = "camera"\n{mount}'
        f'[board]\nlink = "board"\ncorners = [{CORNERS[0]}, {CORNERS[1]}]\nsquare = {SQUARE_M}\n{mount}{_markers(hand)}[mirror]\nglass_thickness = 0.0\n'
    )


Poses = dict[str, tuple[Floats, Floats]]


def _poses(q: Floats, wrong: Wrong, row: int = 0) -> Poses:
    """Turn and place of the links in the root."""
    poses = {"base": (np.eye(3), np.zeros(3))}
    for angle, (name, (parent, child, at, axis, _)) in zip(q, JOINTS.items(), strict=True):
        turn, place = poses[parent]
        here = wrong if name == wrong.at else Wrong(name)
        own, real = (
            rotation(np.array(here.twist_rad)),
            rotation(np.array(here.tilt_rad)) @ np.array(axis, float),
        )
        poses[child] = (
            turn @ own @ rotation((angle + (here.zero_rad if row >= here.from_row else 0.0)) * real),
            place + turn @ (np.array(at) + here.shift_m),
        )
    return poses


def _places(poses: Poses, off_m: Floats) -> Floats:
    """Where the markers are in the root, each off on its link."""
    of = [
        poses[link][0] @ (np.array(on) + off) + poses[link][1]
        for (link, on), off in zip(MARKERS.values(), off_m, strict=True)
    ]
    return np.array(of)


def _off_m(wrong: Wrong) -> Floats:
    """Of each marker on its link."""
    return np.array([wrong.marker_m[1] if name == wrong.marker_m[0] else NO for name in MARKERS])


def _torque_nm(poses: Poses, joint: str) -> float:
    """The torque of the weight of all beyond a joint about its axis."""
    names = list(JOINTS)
    _, child, _, axis, _ = JOINTS[joint]
    turn, place = poses[child]
    beyond = [JOINTS[name][1] for name in names[names.index(joint) :]]
    moment = np.zeros(3)
    for link in beyond:
        mass, at = MASSES[link]
        moment += np.cross(poses[link][0] @ np.array(at) + poses[link][1] - place, [0.0, 0.0, -9.81 * mass])
    return float(turn @ np.array(axis, float) @ moment)


def write_twisted(
    folder: Path,
    seed: int,
    twist_rad: Numbers,
    at: str = "j4",
    postures: int = 45,
    std_px: tuple[float, float] = (0.02, 0.1),
    spring: tuple[str, float] | None = None,
    stated_m_per_s2: float = -9.81,
) -> Path:
    """Random postures, one view each; `std_px` of the corners and of the markers. `spring`: a joint that yields, and its
    compliance, rad/N m. `stated_m_per_s2`: gravity along z as the session states it."""
    return write_wrong(
        folder,
        seed,
        Wrong(at, twist_rad),
        postures=postures,
        std_px=std_px,
        spring=spring,
        stated_m_per_s2=stated_m_per_s2,
    )


def write_wrong(
    folder: Path,
    seed: int,
    wrong: Wrong,
    *,
    hand: ByHand = ByHand(),
    postures: int = 45,
    std_px: tuple[float, float] = (0.02, 0.1),
    spring: tuple[str, float] | None = None,
    stated_m_per_s2: float = -9.81,
) -> Path:
    """As `write_twisted`, of anything that is wrong at one joint, beside mounts by hand."""
    rng = np.random.default_rng(seed)
    camera, board = _frames()
    # Of their own, so that the postures of a seed are the same with exact mounts.
    by_hand = np.random.default_rng((seed, 1))
    off_m = by_hand.normal(0.0, 1.0, (len(MARKERS), 3)) * hand.m + _off_m(wrong)
    camera_m, board_m = (place + hand.m * by_hand.normal(0.0, 1.0, 3) for place in (CAMERA_M, BOARD_M))
    camera, board = (turn @ rotation(hand.rad * by_hand.normal(0.0, 1.0, 3)) for turn in (camera, board))
    grid = np.array([[x, y, 0.0] for y in range(CORNERS[1]) for x in range(CORNERS[0])], float)
    grid = (grid - [(CORNERS[0] - 1) / 2, (CORNERS[1] - 1) / 2, 0.0]) * SQUARE_M
    corners = grid @ board.T + board_m
    frames, rows = [f"frame,posture,{','.join(JOINTS)}"], ["frame,target,index,u,v,std_px"]
    number = 0
    while number < postures:
        q = np.round(rng.uniform(LOW_RAD, HIGH_RAD), 4)
        turned = rotation(np.array([0.0, rng.normal(-0.09, 0.02), rng.normal(0.0, 0.02)]))
        normal = turned @ np.array([-1.0, 0.0, 0.0])
        away = float(normal @ np.array([1.05, 0.1, 0.4]))

        def seen(points: Floats, normal: Floats = normal, away: float = away) -> Floats:
            mirrored = points - 2.0 * np.outer(points @ normal - away, normal)
            at = (mirrored - camera_m) @ camera
            return FOCAL_PX * at[:, :2] / at[:, 2:] + [SIZE_PX[0] / 2, SIZE_PX[1] / 2]

        poses = _poses(q, wrong, number)
        if spring is not None:
            yields = np.array([name == spring[0] for name in JOINTS])
            poses = _poses(q + yields * spring[1] * _torque_nm(poses, spring[0]), wrong, number)
        places = _places(poses, off_m)
        pixels = [seen(corners), seen(places)]
        inside = [np.all((p > 5.0) & (p < np.array(SIZE_PX) - 5.0), axis=1) for p in pixels]
        if not inside[0].all() or inside[1].sum() < 3 or np.max(places @ -normal) > -away - 0.1:
            continue
        frames.append(f"{number},{number},{','.join(map(str, q))}")
        for i, pixel in enumerate(pixels[0]):
            u, v = pixel + rng.normal(0.0, std_px[0], 2)
            rows.append(f"{number},board,{i},{u:.4f},{v:.4f},{std_px[0]}")
        for name, pixel, there in zip(MARKERS, pixels[1], inside[1], strict=True):
            if there and (name != OFTEN_HIDDEN or rng.random() < 0.5):
                u, v = pixel + rng.normal(0.0, std_px[1], 2)
                rows.append(f"{number},{name},0,{u:.4f},{v:.4f},{std_px[1]}")
        number += 1
    folder.mkdir(parents=True)
    (folder / "robot.urdf").write_text(_urdf(), encoding="utf-8")
    (folder / "session.toml").write_text(_session(stated_m_per_s2, hand), encoding="utf-8")
    (folder / "camera.yaml").write_text(
        f"image_width: {SIZE_PX[0]}\nimage_height: {SIZE_PX[1]}\ncamera_name: mast\n"
        f"camera_matrix: {{rows: 3, cols: 3, data: [{FOCAL_PX}, 0, {SIZE_PX[0] / 2}, 0, {FOCAL_PX}, {SIZE_PX[1] / 2}, 0, 0, 1]}}\n"
        "distortion_model: plumb_bob\ndistortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}\n",
        encoding="utf-8",
    )
    (folder / "frames.csv").write_text("\n".join(frames) + "\n", encoding="utf-8")
    (folder / "detections.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return folder


def write_tracked(
    folder: Path, seed: int, wrong: Wrong, *, hand: ByHand = ByHand(), postures: int = 60, std_m: float = 1e-4
) -> Path:
    """The same arm with its markers measured by a tracker in a frame of its own, without camera, board and mirror."""
    rng = np.random.default_rng(seed)
    off_m = rng.normal(0.0, 1.0, (len(MARKERS), 3)) * hand.m + _off_m(wrong)
    turn, at = rotation(np.array([0.4, -0.2, 1.1])), np.array([1.5, -0.4, 0.2])
    frames, rows = [f"frame,posture,{','.join(JOINTS)}"], ["frame,marker,x,y,z"]
    for number in range(postures):
        q = np.round(rng.uniform(LOW_RAD, HIGH_RAD), 4)
        frames.append(f"{number},{number},{','.join(map(str, q))}")
        seen = (
            _places(_poses(q, wrong, number), off_m) @ turn.T + at + rng.normal(0.0, std_m, (len(MARKERS), 3))
        )
        rows += [
            f"{number},{name},{x:.7f},{y:.7f},{z:.7f}" for name, (x, y, z) in zip(MARKERS, seen, strict=True)
        ]
    folder.mkdir(parents=True)
    (folder / "robot.urdf").write_text(_urdf(), encoding="utf-8")
    (folder / "session.toml").write_text(
        'format = "mirror-posture/session"\nversion = 1\nrobot = "robot.urdf"\nroot = "base"\ngravity = [0.0, 0.0, -9.81]\n'
        f'{_markers(hand)}[points]\nframe = "unknown"\n[noise]\npoint_std = {std_m}\n',
        encoding="utf-8",
    )
    (folder / "frames.csv").write_text("\n".join(frames) + "\n", encoding="utf-8")
    (folder / "points.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return folder
