"""A robot of the blind check: the tree below its root, read from a URDF by a separate parser.

A `Robot` is the subtree of a URDF below the link in which gravity is constant, read by this package's own
parser.
Lengths in m, angles in rad, masses in kg; rotations parent-from-child, extrinsic x-y-z (`rpy`) as URDF has
it.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import BlindError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Body:
    """A link with the joint that carries it; `joint_type` is `fixed`, `hinge` or `slide`."""

    name: str
    parent: int
    joint: str
    joint_type: str
    xyz_m: Array
    rotation: Array
    axis: Array
    lower: float
    upper: float
    mass_kg: float
    com_m: Array
    inertia: Array


@dataclass
class Robot:
    """A nominal robot with its rig: what `session.toml` and `robot.urdf` tell."""

    kind: str
    urdf: str
    root: str
    bodies: list[Body]
    commanded: list[str]
    ranges: dict[str, tuple[float, float]]
    markers: list[str]
    marker_diameter_m: float
    board_corners: tuple[int, int]
    board_square_m: float
    path_length_m: tuple[float, float]
    """Shortest and longest optical path from the camera over the mirror to the board."""
    image_size: tuple[int, int]
    focal_px: tuple[float, float]
    length_scale_m: float
    """A typical error of length of this robot: 1 % to 2 % of an arm."""
    camera_link: str = "camera_optical"
    board_link: str = "chest_board"
    index: dict[str, int] = field(default_factory=dict)
    cache: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)
    """Cache of derived quantities, by name."""

    def __post_init__(self) -> None:
        self.index = {b.name: i for i, b in enumerate(self.bodies)}

    def body_of_joint(self, joint: str) -> int:
        """Index of the body that `joint` carries."""
        for i, b in enumerate(self.bodies):
            if b.joint == joint:
                return i
        raise BlindError(f"robot has no joint {joint!r} below {self.root!r}")

    def ancestors(self, body: int) -> list[int]:
        """The body itself and all that carry it, root last."""
        chain = [body]
        while self.bodies[chain[-1]].parent >= 0:
            chain.append(self.bodies[chain[-1]].parent)
        return chain

    def next_body(self, body: int) -> int | None:
        """The body of the next commanded joint that `body` carries (through fixed links), or None."""
        for i, b in enumerate(self.bodies):
            if b.joint in self.commanded and self.rigid_parent(i) == self.rigid_root(body):
                return i
        return None

    def rigid_root(self, body: int) -> int:
        """The body that moves `body`: itself, or the nearest ancestor that is not fixed to its parent."""
        while self.bodies[body].joint_type == "fixed" and self.bodies[body].parent >= 0:
            body = self.bodies[body].parent
        return body

    def rigid_parent(self, body: int) -> int:
        return self.rigid_root(self.bodies[body].parent)

    def moves(self, joint: str) -> list[str]:
        """The markers, and `camera` or `board`, that `joint` moves against the root."""
        b = self.body_of_joint(joint)
        seen = {m: self.index[f"{m}_marker"] for m in self.markers}
        seen |= {"camera": self.index[self.camera_link], "board": self.index[self.board_link]}
        return [name for name, i in seen.items() if b in self.ancestors(i)]


def board_points(robot: Robot, scale: float = 0.0, warp_per_m: float = 0.0) -> Array:
    """Inner corners (C, 3) in the board's frame; bent about its y axis by `warp_per_m`."""
    nx, ny = robot.board_corners
    side = robot.board_square_m * (1 + scale)
    x = np.tile((np.arange(nx) - (nx - 1) / 2) * side, ny)
    y = np.repeat((np.arange(ny) - (ny - 1) / 2) * side, nx)
    if warp_per_m == 0:
        return np.column_stack([x, y, np.zeros(nx * ny)])
    radius = 1 / warp_per_m
    return np.column_stack([radius * np.sin(x / radius), y, radius * (1 - np.cos(x / radius))])


def rotation_rpy(rpy: Sequence[float] | Array) -> Array:
    """Rotation matrix of URDF's roll, pitch, yaw: Rz(yaw) Ry(pitch) Rx(roll)."""
    r, p, y = (float(a) for a in rpy)
    cr, sr, cp, sp, cy, sy = np.cos(r), np.sin(r), np.cos(p), np.sin(p), np.cos(y), np.sin(y)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _floats(text: str | None, default: tuple[float, ...]) -> Array:
    return np.array([float(x) for x in text.split()] if text else default)


def _inertial(link: ET.Element) -> tuple[float, Array, Array]:
    inertial = link.find("inertial")
    mass = inertial.find("mass") if inertial is not None else None
    if inertial is None or mass is None:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    origin = inertial.find("origin")
    xyz = _floats(origin.get("xyz") if origin is not None else None, (0, 0, 0))
    turn = rotation_rpy(_floats(origin.get("rpy") if origin is not None else None, (0, 0, 0)))
    entry = inertial.find("inertia")
    i = {
        k: float(entry.get(k, "0")) if entry is not None else 0.0
        for k in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    }
    matrix = np.array(
        [[i["ixx"], i["ixy"], i["ixz"]], [i["ixy"], i["iyy"], i["iyz"]], [i["ixz"], i["iyz"], i["izz"]]]
    )
    return float(mass.get("value", "0")), xyz, turn @ matrix @ turn.T


def read_bodies(urdf: str, root: str) -> list[Body]:
    """The links below `root`, parents before children; `root` itself first, at the origin."""
    tree = ET.fromstring(urdf)
    links = {element.get("name", ""): element for element in tree.findall("link")}
    if root not in links:
        raise BlindError(f"URDF has no link {root!r}; its links are {', '.join(sorted(links))}")
    children: dict[str, list[ET.Element]] = {}
    for joint in tree.findall("joint"):
        parent = joint.find("parent")
        if parent is not None:
            children.setdefault(parent.get("link", ""), []).append(joint)
    mass, com, inertia = _inertial(links[root])
    bodies = [Body(root, -1, "", "fixed", np.zeros(3), np.eye(3), np.zeros(3), 0, 0, mass, com, inertia)]
    todo = [0]
    while todo:
        parent_index = todo.pop()
        for joint in children.get(bodies[parent_index].name, []):
            child_ref = joint.find("child")
            child = child_ref.get("link", "") if child_ref is not None else ""
            origin, axis, limit = joint.find("origin"), joint.find("axis"), joint.find("limit")
            urdf_type = joint.get("type", "fixed")
            kind = {"revolute": "hinge", "continuous": "hinge", "prismatic": "slide", "fixed": "fixed"}.get(
                urdf_type
            )
            if kind is None:
                raise BlindError(
                    f"joint {joint.get('name')!r} is of type {urdf_type!r}, which is not simulated"
                )
            direction = _floats(axis.get("xyz") if axis is not None else None, (1, 0, 0))
            lower, upper = (
                (float(limit.get(k, d)) if limit is not None else float(d))
                for k, d in (("lower", "-3.1"), ("upper", "3.1"))
            )
            mass, com, inertia = _inertial(links[child])
            bodies.append(
                Body(
                    child,
                    parent_index,
                    joint.get("name", ""),
                    kind,
                    _floats(origin.get("xyz") if origin is not None else None, (0, 0, 0)),
                    rotation_rpy(_floats(origin.get("rpy") if origin is not None else None, (0, 0, 0))),
                    direction / max(float(np.linalg.norm(direction)), 1e-12),
                    lower,
                    upper,
                    mass,
                    com,
                    inertia,
                )
            )
            todo.append(len(bodies) - 1)
    return bodies


def mount(
    name: str, parent: str, xyz: Sequence[float] | Array, rpy: Sequence[float] = (0.0, 0.0, 0.0)
) -> str:
    """URDF of a link without mass, fixed to `parent`."""
    return (
        f'  <link name="{name}"/>\n  <joint name="{name}_mount" type="fixed">\n'
        f'    <origin xyz="{" ".join(f"{v:.9g}" for v in xyz)}" rpy="{" ".join(f"{v:.9g}" for v in rpy)}"/>\n'
        f'    <parent link="{parent}"/>\n    <child link="{name}"/>\n  </joint>\n'
    )
