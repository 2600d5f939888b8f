"""Robots of the blind check: own small humanoids of random sizes, Unitree's G1, or any URDF with the mounts
in it.

A `Robot` is the subtree of a URDF below the link in which gravity is constant, read by this package's own
parser.
Lengths in m, angles in rad, masses in kg; rotations parent-from-child, extrinsic x-y-z (`rpy`) as URDF has
it.
"""

from __future__ import annotations

import sys
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

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
                    direction / np.linalg.norm(direction),
                    lower,
                    upper,
                    mass,
                    com,
                    inertia,
                )
            )
            todo.append(len(bodies) - 1)
    return bodies


def _mount(
    name: str, parent: str, xyz: Sequence[float] | Array, rpy: Sequence[float] = (0.0, 0.0, 0.0)
) -> str:
    return (
        f'  <link name="{name}"/>\n  <joint name="{name}_mount" type="fixed">\n'
        f'    <origin xyz="{" ".join(f"{v:.9g}" for v in xyz)}" rpy="{" ".join(f"{v:.9g}" for v in rpy)}"/>\n'
        f'    <parent link="{parent}"/>\n    <child link="{name}"/>\n  </joint>\n'
    )


def small_humanoid(rng: np.random.Generator) -> Robot:
    """A humanoid of 220 to 300 mm whose limbs, masses, joints and mounts are drawn."""
    height = rng.uniform(0.22, 0.30)
    wrist, yaw = rng.random() < 0.5, rng.random() < 0.7
    shoulder_z, shoulder_y = height * rng.uniform(0.26, 0.30), height * rng.uniform(0.17, 0.20)
    upper, fore = height * rng.uniform(0.24, 0.29), height * rng.uniform(0.18, 0.22)
    clavicle, split = height * rng.uniform(0.05, 0.08), rng.uniform(0.55, 0.75)
    heavy = rng.uniform(0.7, 1.5)
    parts: list[str] = []

    def link(name: str, mass: float, com: Sequence[float], size: float) -> None:
        i = mass * size**2 / 12
        parts.append(
            f'  <link name="{name}">\n    <inertial>\n'
            f'      <origin xyz="{com[0]:.6g} {com[1]:.6g} {com[2]:.6g}"/>\n'
            f'      <mass value="{mass:.5g}"/>\n'
            f'      <inertia ixx="{i:.4g}" ixy="0" ixz="0" iyy="{i:.4g}" iyz="0" izz="{0.5 * i:.4g}"/>\n'
            f"    </inertial>\n  </link>\n"
        )

    def joint(
        name: str, parent: str, child: str, xyz: Sequence[float], axis: str, low: float, high: float
    ) -> None:
        parts.append(
            f'  <joint name="{name}" type="revolute">\n'
            f'    <origin xyz="{xyz[0]:.6g} {xyz[1]:.6g} {xyz[2]:.6g}"/>\n'
            f'    <parent link="{parent}"/>\n    <child link="{child}"/>\n    <axis xyz="{axis}"/>\n'
            f'    <limit lower="{low:.4g}" upper="{high:.4g}" effort="2" velocity="5"/>\n  </joint>\n'
        )

    link("chest", 0.4 * heavy, (0, 0, 0.16 * height), 0.4 * height)
    link("neck", 0.02 * heavy, (0, 0, 0.005), 0.02)
    link("head", 0.09 * heavy, (0.01, 0, 0.02), 0.06)
    joint("head_yaw", "chest", "neck", (0, 0, 0.34 * height), "0 0 1", -1.2, 1.2)
    joint("head_pitch", "neck", "head", (0, 0, 0.05 * height), "0 1 0", -0.6, 0.6)
    pitch = rng.uniform(0.1, 0.3)
    still = rng.random() < 0.6
    ranges = {"head_pitch": (pitch, pitch) if still else (0.0, pitch + 0.1)}
    if not still and rng.random() < 0.5:
        ranges["head_yaw"] = (-0.15, 0.15)
    diameter = rng.choice([0.008, 0.0116, 0.014])
    for side, sign in (("r", -1.0), ("l", 1.0)):
        pitch_link, roll_link, arm_link, hand_link = (
            f"{side}_{n}_link" for n in ("shoulder_pitch", "shoulder_roll", "elbow", "wrist")
        )
        link(pitch_link, 0.035 * heavy, (0, sign * 0.3 * clavicle, 0), 0.03)
        link(roll_link, 0.05 * heavy, (0.003, sign * 0.002, -0.4 * upper), 0.6 * upper)
        joint(
            f"{side}_shoulder_pitch",
            "chest",
            pitch_link,
            (0, sign * shoulder_y, shoulder_z),
            "0 1 0",
            -2.2,
            0.4,
        )
        low, high = sorted((sign * -0.2, sign * 1.2))
        joint(f"{side}_shoulder_roll", pitch_link, roll_link, (0, sign * clavicle, 0), "1 0 0", low, high)
        ranges[f"{side}_shoulder_pitch"] = (-2.1, -0.1)
        ranges[f"{side}_shoulder_roll"] = (max(low, -0.9), min(high, 0.9))
        upper_link, left = roll_link, upper
        if yaw:
            upper_link, left = f"{side}_upper_arm_yaw_link", upper * (1 - split)
            link(upper_link, 0.03 * heavy, (0.002, 0, -0.4 * left), 0.02)
            joint(f"{side}_upper_arm_yaw", roll_link, upper_link, (0, 0, -upper * split), "0 0 1", -0.8, 0.8)
            ranges[f"{side}_upper_arm_yaw"] = (-0.7, 0.7)
        link(arm_link, 0.045 * heavy, (0.004, 0, -0.45 * fore), 0.8 * fore)
        joint(f"{side}_elbow", upper_link, arm_link, (0, 0, -left), "0 1 0", -1.7, 0.1)
        ranges[f"{side}_elbow"] = (-1.5, 0.0)
        hand, hand_z = arm_link, -1.25 * fore
        if wrist:
            hand, hand_z = hand_link, -0.35 * fore
            link(hand_link, 0.02 * heavy, (0.002, 0, -0.2 * fore), 0.02)
            joint(
                f"{side}_wrist", arm_link, hand_link, (0, 0, -fore), rng.choice(["1 0 0", "0 0 1"]), -0.8, 0.8
            )
            ranges[f"{side}_wrist"] = (-0.7, 0.7)
        jitter = rng.uniform(-0.003, 0.003, (3, 3))
        parts.append(_mount(f"{side}_hand_marker", hand, np.array([0.006, sign * 0.007, hand_z]) + jitter[0]))
        parts.append(
            _mount(
                f"{side}_forearm_marker", arm_link, np.array([0.012, sign * 0.003, -0.45 * fore]) + jitter[1]
            )
        )
        parts.append(
            _mount(
                f"{side}_upper_marker", roll_link, np.array([0.013, sign * 0.004, -0.4 * upper]) + jitter[2]
            )
        )
    optical = (-np.pi / 2, 0.0, -np.pi / 2)
    parts.append(
        _mount("camera_optical", "head", (rng.uniform(0.02, 0.035), 0.0, rng.uniform(0.015, 0.03)), optical)
    )
    board_z = shoulder_z * rng.uniform(0.45, 0.6)
    parts.append(
        _mount("chest_board", "chest", (rng.uniform(0.03, 0.045), 0.0, board_z), (np.pi / 2, 0.0, np.pi / 2))
    )
    urdf = '<robot name="small_humanoid">\n' + "".join(parts) + "</robot>\n"
    corners, square = [((7, 4), 0.014), ((6, 5), 0.011), ((8, 5), 0.010)][rng.integers(3)]
    return Robot(
        "small",
        urdf,
        "chest",
        read_bodies(urdf, "chest"),
        sorted(ranges),
        ranges,
        [f"{s}_{m}" for s in "rl" for m in ("hand", "forearm", "upper")],
        float(diameter),
        corners,
        square,
        (1.15 * height, 2.3 * height),
        (800, 600),
        (620.0, 760.0),
        0.0025,
    )


def unitree_g1(rng: np.random.Generator, urdf_path: Path | None = None) -> Robot:
    """Unitree's G1 from `example-robot-data`, its torso held still, with drawn mounts of camera, board and
    markers."""
    text = (urdf_path or _g1_path()).read_text(encoding="utf-8")
    tree = ET.fromstring(text)
    for link in tree.findall("link"):
        for tag in ("visual", "collision"):
            for element in link.findall(tag):
                link.remove(element)
    for tag in ("mujoco", "transmission", "gazebo"):
        for element in tree.findall(tag):
            tree.remove(element)
    ET.indent(tree)
    mounts = []
    ranges: dict[str, tuple[float, float]] = {}
    for side, sign in (("right", -1.0), ("left", 1.0)):
        s = side[0]
        jitter = rng.uniform(-0.015, 0.015, (3, 3))
        mounts.append(
            _mount(
                f"{s}_hand_marker", f"{side}_wrist_yaw_link", np.array([0.11, sign * 0.01, 0.03]) + jitter[0]
            )
        )
        mounts.append(
            _mount(f"{s}_forearm_marker", f"{side}_elbow_link", np.array([0.07, 0.0, 0.035]) + jitter[1])
        )
        mounts.append(
            _mount(f"{s}_upper_marker", f"{side}_shoulder_yaw_link", np.array([0.045, 0, -0.045]) + jitter[2])
        )
        ranges |= {
            f"{side}_shoulder_pitch_joint": (-1.5, 0.4),
            f"{side}_shoulder_roll_joint": tuple(sorted((sign * -0.1, sign * 0.9))),
            f"{side}_shoulder_yaw_joint": (-0.7, 0.7),
            f"{side}_elbow_joint": (-0.3, 1.4),
            f"{side}_wrist_roll_joint": (-0.7, 0.7),
            f"{side}_wrist_pitch_joint": (-0.7, 0.7),
            f"{side}_wrist_yaw_joint": (-0.7, 0.7),
        }
    tilt = rng.uniform(-0.05, 0.25)
    optical = (-np.pi / 2 - tilt, 0.0, -np.pi / 2)
    mounts.append(
        _mount(
            "camera_optical", "torso_link", (rng.uniform(0.07, 0.1), rng.uniform(-0.02, 0.02), 0.42), optical
        )
    )
    board = (rng.uniform(0.12, 0.14), rng.uniform(-0.03, 0.03), rng.uniform(0.15, 0.24))
    mounts.append(_mount("chest_board", "torso_link", board, (np.pi / 2, 0.0, np.pi / 2)))
    urdf = ET.tostring(tree, encoding="unicode").replace("</robot>", "".join(mounts) + "</robot>\n")
    return Robot(
        "g1",
        urdf,
        "torso_link",
        read_bodies(urdf, "torso_link"),
        sorted(ranges),
        ranges,
        [f"{s}_{m}" for s in "rl" for m in ("hand", "forearm", "upper")],
        0.03,
        (8, 5),
        float(rng.choice([0.025, 0.03])),
        (1.0, 1.8),
        (1280, 960),
        (930.0, 1100.0),
        0.005,
    )


def _g1_path() -> Path:
    relative = "cmeel.prefix/share/example-robot-data/robots/g1_description/urdf/g1_29dof_rev_1_0.urdf"
    for place in sys.path:
        if (Path(place) / relative).is_file():
            return Path(place) / relative
    raise BlindError(
        "the G1 needs the package `example-robot-data` (extra `test`); "
        "or draw other robots: --robot small, --robot URDF"
    )


def from_urdf(path: Path, rng: np.random.Generator) -> Robot:
    """Any robot whose URDF has a link `camera_optical`, one that ends in `_board`, and markers that end in
    `_marker`.

    The root is the link that carries the board. Commanded are the joints between the root and the markers.
    """
    text = path.read_text(encoding="utf-8")
    links = [element.get("name", "") for element in ET.fromstring(text).findall("link")]
    boards = [n for n in links if n.endswith("_board")]
    markers = [n.removesuffix("_marker") for n in links if n.endswith("_marker")]
    if "camera_optical" not in links or len(boards) != 1 or not markers:
        raise BlindError(
            f"{path}: a robot of the blind check needs the links `camera_optical`, "
            f"one `…_board` and `…_marker`s; "
            f"got boards {boards}, markers {markers}"
        )
    parents = {
        j.find("child").get("link"): j  # type: ignore[union-attr]
        for j in ET.fromstring(text).findall("joint")
    }
    root = parents[boards[0]].find("parent").get("link")  # type: ignore[union-attr]
    while root in parents and parents[root].get("type") == "fixed":
        root = parents[root].find("parent").get("link")  # type: ignore[union-attr]
    bodies = read_bodies(text, str(root))
    robot = Robot(
        "urdf",
        text,
        str(root),
        bodies,
        [],
        {},
        markers,
        0.0,
        (8, 5),
        0.0,
        (0, 0),
        (1280, 960),
        (930, 1100),
        0,
    )
    robot.board_link = boards[0]
    missing = [m for m in [*(f"{m}_marker" for m in markers), "camera_optical"] if m not in robot.index]
    if missing:
        raise BlindError(
            f"{path}: {', '.join(missing)} does not hang on {root!r}, the link that carries the board"
        )
    used: set[int] = set()
    for m in markers:
        used |= set(robot.ancestors(robot.index[f"{m}_marker"]))
    for i in sorted(used):
        b = bodies[i]
        if b.joint_type == "hinge":
            middle, half = (b.lower + b.upper) / 2, min((b.upper - b.lower) / 2, 1.6) * 0.85
            robot.ranges[b.joint] = (middle - half, middle + half)
    robot.commanded = sorted(robot.ranges)
    reach = max(
        sum(float(np.linalg.norm(bodies[i].xyz_m)) for i in robot.ancestors(robot.index[f"{m}_marker"]))
        for m in markers
    )
    small = reach < 0.4
    robot.length_scale_m = 0.0125 * reach
    robot.marker_diameter_m = 0.0116 if small else 0.03
    robot.board_square_m = 0.010 if small else 0.03
    robot.path_length_m = (1.6 * reach, 3.0 * reach) if not small else (1.4 * reach, 2.8 * reach)
    if small:
        robot.image_size, robot.focal_px = (800, 600), (620.0, 760.0)
    return robot
