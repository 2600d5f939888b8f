"""The nominal chain in plain NumPy, all postures at once, with the changes of a hypothesis.

Used only to decide what a session can show; the sessions themselves come from MuJoCo.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .robots import Robot
from .truth import Commands

Array = NDArray[np.float64]

SUBSTITUTIONS = 3
"""Number of iterations of load and deflection: each reduces the error to a few percent."""


@dataclass(frozen=True)
class Yield:
    """A body that turns about `pivot_m` by gravity's moment there: rad per N m about `axis`, both in its
    frame."""

    body: int
    axis: Array
    compliance: float
    pivot_m: Array


@dataclass
class Change:
    """What a model assumes beyond the nominal robot and rig; all zero is nominal."""

    joint_rad: dict[str, Array] = field(default_factory=dict)
    """By joint: what is added to its command, (P,)."""
    yields: list[Yield] = field(default_factory=list)
    origin_m: dict[int, Array] = field(default_factory=dict)
    axis: dict[int, Array] = field(default_factory=dict)
    camera_turn_rad: Array = field(default_factory=lambda: np.zeros(3))
    camera_shift_m: Array = field(default_factory=lambda: np.zeros(3))
    board_turn_rad: Array = field(default_factory=lambda: np.zeros(3))
    board_shift_m: Array = field(default_factory=lambda: np.zeros(3))
    focal: float = 0.0
    center_px: Array = field(default_factory=lambda: np.zeros(2))
    k1: float = 0.0
    board_scale: float = 0.0
    glass_m: float = 0.0
    curvature_per_m: float = 0.0

    def add_joint(self, joint: str, angle: Array) -> None:
        self.joint_rad[joint] = self.joint_rad[joint] + angle if joint in self.joint_rad else angle

    def copy(self) -> Change:
        """A change that can be added to without touching this one."""
        other = copy.copy(self)
        other.joint_rad, other.origin_m, other.axis = (
            dict(self.joint_rad),
            dict(self.origin_m),
            dict(self.axis),
        )
        other.yields = list(self.yields)
        return other


@dataclass(frozen=True)
class Skeleton:
    """The parts of a robot that are computed: the bodies above markers, camera and board, and its masses."""

    needed: list[int]
    """Parents before children."""
    above: NDArray[np.bool_]
    """(B, B): `above[i, k]` where body `i` is body `k` or carries it."""
    turned: list[bool]
    """Whether a body's frame is turned against its parent's at rest."""
    mass_kg: Array
    center_m: Array
    """(L, 3), in the frame of the needed body that carries the lump rigidly."""
    carrier: NDArray[np.int_]


def skeleton_of(robot: Robot) -> Skeleton:
    """The robot's skeleton, made once."""
    kept: Skeleton | None = robot.cache.get("skeleton")
    if kept is None:
        kept = robot.cache["skeleton"] = _skeleton(robot)
    return kept


def _skeleton(robot: Robot) -> Skeleton:
    count = len(robot.bodies)
    above = np.zeros((count, count), dtype=bool)
    for i in range(count):
        above[robot.ancestors(i), i] = True
    ends = [robot.index[n] for n in (robot.camera_link, robot.board_link)]
    ends += [robot.index[f"{m}_marker"] for m in robot.markers]
    ends += [robot.body_of_joint(j) for j in robot.commanded]
    wanted = np.flatnonzero(above[:, ends].any(axis=1))
    mass, center, carrier = [], [], []
    for i, b in enumerate(robot.bodies):
        if b.mass_kg <= 0:
            continue
        at, k = b.com_m, i
        while k not in wanted:
            at = robot.bodies[k].xyz_m + robot.bodies[k].rotation @ at
            k = robot.bodies[k].parent
        mass.append(b.mass_kg)
        center.append(at)
        carrier.append(k)
    return Skeleton(
        [int(i) for i in wanted],
        above,
        [not np.array_equal(b.rotation, np.eye(3)) for b in robot.bodies],
        np.array(mass),
        np.array(center).reshape(-1, 3),
        np.array(carrier, dtype=np.int_),
    )


@dataclass
class Chain:
    """Positions (B, P, 3) and rotations (B, P, 3, 3) of the needed bodies in the root's frame."""

    position_m: Array
    rotation: Array
    centers_m: Array | None = None
    """(L, P, 3) of the lumps of mass, once asked for."""


def rotations(vectors: Array) -> Array:
    """Rotation matrices (P, 3, 3) of rotation vectors (P, 3)."""
    angle = np.linalg.norm(vectors, axis=1)
    x, y, z = (vectors / np.where(angle > 0, angle, 1.0)[:, None]).T
    zero = np.zeros_like(x)
    k = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    result: Array = (
        np.eye(3) + np.sin(angle)[:, None, None] * k + (1 - np.cos(angle))[:, None, None] * (k @ k)
    )
    return result


def cross_matrix(v: Array) -> Array:
    """The matrix of v × ·."""
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def turns(axis: Array, angle: Array) -> Array:
    """Rotation matrices (P, 3, 3) about one unit axis by angles (P,)."""
    k = cross_matrix(axis)
    return np.eye(3) + np.sin(angle)[:, None, None] * k + (1 - np.cos(angle))[:, None, None] * (k @ k)


def chain(
    robot: Robot, commands: Commands, change: Change, twist: dict[int, tuple[Array, Array]] | None = None
) -> Chain:
    """Forward kinematics; `twist` are the rotation vectors (P, 3) of bodies that yield, and their pivots."""
    bones, n = skeleton_of(robot), len(commands.q_rad)
    position, rotation = np.zeros((len(robot.bodies), n, 3)), np.zeros((len(robot.bodies), n, 3, 3))
    for i in bones.needed:
        b = robot.bodies[i]
        if b.parent < 0:
            rotation[i] = np.eye(3)
            continue
        origin = b.xyz_m + change.origin_m[i] if i in change.origin_m else b.xyz_m
        carried = rotation[b.parent]
        at = position[b.parent] + carried @ origin
        turned = carried @ b.rotation if bones.turned[i] else carried
        if b.joint in robot.commanded:
            angle = commands.of(b.joint)
            if b.joint in change.joint_rad:
                angle = angle + change.joint_rad[b.joint]
            turned = turned @ turns(change.axis.get(i, b.axis), angle)
        if twist and i in twist:
            vector, pivot = twist[i]
            bent = turned @ rotations(vector)
            at = at + (turned - bent) @ pivot
            turned = bent
        position[i], rotation[i] = at, turned
    return Chain(position, rotation)


def moments(robot: Robot, at: Chain, gravity: Array, body: int, pivot_m: Array | None = None) -> Array:
    """Moment of gravity (P, 3) N m on `body` and all it carries, about its joint's origin or a pivot, in
    its frame."""
    bones = skeleton_of(robot)
    if at.centers_m is None:
        at.centers_m = (
            at.position_m[bones.carrier]
            + (at.rotation[bones.carrier] @ bones.center_m[:, None, :, None])[..., 0]
        )
    turn, about = at.rotation[body], at.position_m[body]
    if pivot_m is not None:
        about = about + turn @ pivot_m
    mass = np.where(bones.above[body, bones.carrier], bones.mass_kg, 0.0)
    arm = np.tensordot(mass, at.centers_m, 1) - mass.sum() * about
    result: Array = (np.cross(arm, gravity)[:, None, :] @ turn)[:, 0]
    return result


def settled_chain(robot: Robot, commands: Commands, change: Change, gravity: Array) -> Chain:
    """The chain with its elastic deflections: load and deflection are iterated until they agree."""
    at = chain(robot, commands, change)
    for _ in range(SUBSTITUTIONS if change.yields else 0):
        twist: dict[int, tuple[Array, Array]] = {}
        for y in change.yields:
            turn = y.compliance * (moments(robot, at, gravity, y.body, y.pivot_m) @ y.axis)[:, None] * y.axis
            before = twist[y.body][0] if y.body in twist else 0.0
            twist[y.body] = (before + turn, y.pivot_m)
        at = chain(robot, commands, change, twist)
    return at
