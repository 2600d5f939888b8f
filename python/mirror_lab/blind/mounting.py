"""Errors of a set-up by hand: displaced board, camera and markers, and wrong zeros of joints. The session states, at most, their
tolerances. The board's displacement is drawn on its own link and the camera's on
its own; the public vocabulary tells the first as `board_mount`, which carries a camera on the same rigid body along, and the
camera against the board as `camera_mount`. With L the nominal poses of board and camera in that body, D_b and D_c what was drawn,
the camera's is `X = L_c⁻¹ L_b D_b⁻¹ L_b⁻¹ L_c D_c`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .robots import Robot

if TYPE_CHECKING:
    from .body import BodyPoses
    from .truth import Commands, Truth

Array = NDArray[np.float64]

SHIFT_M, TURN_RAD, ZERO_RAD = 0.003, np.radians(1.0), np.radians(0.15)
"""One standard deviation in each axis: parts attached by hand with tape; zeros of servos set by eye with a jig."""
STATED_SHARE = 0.4
"""Share of sessions that state their tolerances."""
NOT_BESIDE = {"camera_mount", "marker_mount", "geometry", "pairing"}
"""Effects that belong to the set-up, or have no law that is identifiable beside it."""


@dataclass(frozen=True)
class Mounting:
    """The true mounts: rotation vector and shift in the nominal frame; a marker's shift in its link's frame."""

    board: tuple[Array, Array]
    camera: tuple[Array, Array]
    markers_m: dict[str, Array]
    zeros_rad: dict[str, float]
    stated: bool

    def add_to(self, truth: Truth, robot: Robot) -> None:
        """Displaces camera, markers and zeros of the true machine; the board's poses are moved by `moved`."""
        truth.camera_turn_rad, truth.camera_shift_m = self.camera
        for name, shift in self.markers_m.items():
            body = robot.index[f"{name}_marker"]
            truth.origin_shift_m[body] = truth.origin_shift_m.get(body, np.zeros(3)) + shift
        for joint, zero in self.zeros_rad.items():
            truth.servo.append((joint, _constant(zero)))

    def moved(self, poses: BodyPoses) -> BodyPoses:
        """The same poses with the board where it really sits."""
        turn, shift = self.board
        poses.board_m = poses.board_m + poses.board_rotation @ shift
        poses.board_rotation = poses.board_rotation @ rotation_of(turn)
        return poses

    def answer(self, robot: Robot) -> list[dict[str, Any]]:
        """The displacements as causes of the public vocabulary."""
        board, camera = _matrix(*self.board), _matrix(*self.camera)
        body, own = (_rigid(robot, link) for link in (robot.board_link, robot.camera_link))
        if body[0] == own[0]:
            along = np.linalg.inv(own[1]) @ body[1]
            camera = along @ np.linalg.inv(board) @ np.linalg.inv(along) @ camera
        told = [_told("board_mount", "board", board), _told("camera_mount", "camera", camera)]
        for name, shift in self.markers_m.items():
            told.append(
                {
                    "effect": "marker_mount",
                    "at": f"marker:{name}",
                    **dict(zip(SHIFTS, shift.tolist(), strict=True)),
                }
            )
        return told

    def tolerances(self) -> dict[str, float]:
        """What the session states, one standard deviation; empty where nothing is stated."""
        return {"tolerance_m": SHIFT_M, "tolerance_rad": round(float(TURN_RAD), 5)} if self.stated else {}


TURNS, SHIFTS = ("rx_rad", "ry_rad", "rz_rad"), ("dx_m", "dy_m", "dz_m")


def draw_mounting(rng: np.random.Generator, robot: Robot) -> Mounting:
    """Independent normal displacements of everything that a person mounts, and of the zeros of joints that move something."""

    def pose() -> tuple[Array, Array]:
        return rng.normal(0, TURN_RAD, 3), rng.normal(0, SHIFT_M, 3)

    return Mounting(
        pose(),
        pose(),
        {name: rng.normal(0, SHIFT_M, 3) for name in robot.markers},
        {j: float(rng.normal(0, ZERO_RAD)) for j in robot.commanded if robot.moves(j)},
        bool(rng.random() < STATED_SHARE),
    )


def rotation_of(turn: Array) -> Array:
    """Rotation matrix of a rotation vector."""
    angle = float(np.linalg.norm(turn))
    if angle == 0:
        return np.eye(3)
    x, y, z = turn / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    result: Array = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k
    return result


def _vector_of(rotation: Array) -> Array:
    """Rotation vector of a rotation by less than half a turn."""
    axis = np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    sine = float(np.linalg.norm(axis)) / 2
    angle = float(np.arctan2(sine, (np.trace(rotation) - 1) / 2))
    result: Array = axis / 2 * (angle / sine if sine > 0 else 1.0)
    return result


def _matrix(turn: Array, shift: Array) -> Array:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation_of(turn), shift
    return out


def _told(effect: str, at: str, moved: Array) -> dict[str, Any]:
    turn, shift = _vector_of(moved[:3, :3]), moved[:3, 3]
    values = zip((*TURNS, *SHIFTS), (*turn.tolist(), *shift.tolist()), strict=True)
    return {"effect": effect, "at": at, **dict(values)}


def _rigid(robot: Robot, link: str) -> tuple[int, Array]:
    """The body that moves a link, and the link's nominal pose in it."""
    i = robot.index[link]
    pose = np.eye(4)
    while robot.bodies[i].joint_type == "fixed" and robot.bodies[i].parent >= 0:
        b = robot.bodies[i]
        step = np.eye(4)
        step[:3, :3], step[:3, 3] = b.rotation, b.xyz_m
        pose, i = step @ pose, b.parent
    return i, pose


def _constant(value: float) -> Any:
    def law(commands: Commands) -> Array:
        return np.full(len(commands.q_rad), value)

    return law
