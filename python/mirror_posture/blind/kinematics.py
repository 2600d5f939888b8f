"""The nominal chain in plain NumPy, all postures at once, with whatever a hypothesis changes of it.

Used only to judge what a session can show; the sessions themselves come from MuJoCo.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .robots import Robot
from .truth import Commands

Array = NDArray[np.float64]


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
    focal: float = 0.0
    center_px: Array = field(default_factory=lambda: np.zeros(2))
    k1: float = 0.0
    board_scale: float = 0.0
    glass_m: float = 0.0
    curvature_per_m: float = 0.0

    def add_joint(self, joint: str, angle: Array) -> None:
        self.joint_rad[joint] = self.joint_rad[joint] + angle if joint in self.joint_rad else angle


@dataclass
class Chain:
    """Positions (P, 3) and rotations (P, 3, 3) of every body in the root's frame."""

    position_m: list[Array]
    rotation: list[Array]


def rotations(vectors: Array) -> Array:
    """Rotation matrices (P, 3, 3) of rotation vectors (P, 3)."""
    angle = np.linalg.norm(vectors, axis=1)
    x, y, z = (vectors / np.where(angle > 0, angle, 1.0)[:, None]).T
    zero = np.zeros_like(x)
    k = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    return np.eye(3) + np.sin(angle)[:, None, None] * k + (1 - np.cos(angle))[:, None, None] * (k @ k)


def chain(
    robot: Robot, commands: Commands, change: Change, twist: dict[int, tuple[Array, Array]] | None = None
) -> Chain:
    """Forward kinematics; `twist` are the rotation vectors (P, 3) of bodies that yield, and their pivots."""
    n = len(commands.q_rad)
    position: list[Array] = []
    rotation: list[Array] = []
    for i, b in enumerate(robot.bodies):
        if b.parent < 0:
            position.append(np.zeros((n, 3)))
            rotation.append(np.broadcast_to(np.eye(3), (n, 3, 3)))
            continue
        at = position[b.parent] + rotation[b.parent] @ (b.xyz_m + change.origin_m.get(i, np.zeros(3)))
        turned = rotation[b.parent] @ b.rotation
        if b.joint in robot.commanded:
            angle = commands.of(b.joint) + change.joint_rad.get(b.joint, 0.0)
            turned = turned @ rotations(angle[:, None] * change.axis.get(i, b.axis))
        if twist and i in twist:
            vector, pivot = twist[i]
            bent = turned @ rotations(vector)
            at = at + (turned - bent) @ pivot
            turned = bent
        position.append(at)
        rotation.append(turned)
    return Chain(position, rotation)


def moments(robot: Robot, at: Chain, gravity: Array, body: int, pivot_m: Array | None = None) -> Array:
    """Moment of gravity (P, 3) N m on `body` and all it carries, about its joint's origin or a pivot, in
    its frame."""
    turn, about = at.rotation[body], at.position_m[body]
    if pivot_m is not None:
        about = about + turn @ pivot_m
    moment = np.zeros_like(about)
    for i, b in enumerate(robot.bodies):
        if b.mass_kg > 0 and body in robot.ancestors(i):
            moment += np.cross(at.position_m[i] + at.rotation[i] @ b.com_m - about, b.mass_kg * gravity)
    return np.einsum("pji,pj->pi", turn, moment)


def settled_chain(robot: Robot, commands: Commands, change: Change, gravity: Array) -> Chain:
    """The chain where what yields has yielded: the load is taken where the body then is, by three
    substitutions."""
    at = chain(robot, commands, change)
    for _ in range(3 if change.yields else 0):
        twist: dict[int, tuple[Array, Array]] = {}
        for y in change.yields:
            turn = y.compliance * (moments(robot, at, gravity, y.body, y.pivot_m) @ y.axis)[:, None] * y.axis
            before = twist[y.body][0] if y.body in twist else 0.0
            twist[y.body] = (before + turn, y.pivot_m)
        at = chain(robot, commands, change, twist)
    return at
