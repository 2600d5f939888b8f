"""Robots of the package `example-robot-data` on which nothing of this project was tuned, in front of a mast
with camera and board.

The link that stands still carries a camera behind and above and a board below it, both looking along x.
Each marker is at a random place of its link; each joint moves 0.7 rad to both sides of a random posture in
which the markers are in front and apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .drawn_robots import BOARD_RPY
from .kinematics import Change, chain
from .known_robots import bare, description_file, mounted
from .robots import Body, Robot, mount, read_bodies
from .truth import Commands

Array = NDArray[np.float64]

HALF_RANGE_RAD = 0.7
TRIED = 1500
"""Postures that are drawn to choose one from."""
TILT_RAD = 0.15
"""By how much the camera looks down."""


@dataclass(frozen=True)
class Described:
    """A described robot: its file, the link that stands still, the link of each marker, and its arm's reach."""

    file: str
    root: str
    markers: dict[str, str]
    reach_m: float


DESCRIBED = {
    "panda": Described(
        "panda_description/urdf/panda.urdf",
        "panda_link0",
        {"fore": "panda_link4", "wrist": "panda_link6", "hand": "panda_hand"},
        0.9,
    ),
    "baxter": Described(
        "baxter_description/urdf/baxter.urdf",
        "torso",
        {
            f"{side[0]}_{name}": f"{side}_{link}"
            for side in ("left", "right")
            for name, link in (("upper", "upper_forearm"), ("fore", "lower_forearm"), ("hand", "hand_link"))
        },
        1.0,
    ),
    "romeo": Described(
        "romeo_description/urdf/romeo.urdf",
        "torso",
        {
            "l_upper": "LElbowRollLink",
            "l_hand": "l_gripper",
            "r_upper": "RElbowRollLink",
            "r_hand": "r_gripper",
        },
        0.6,
    ),
    "icub": Described(
        "icub_description/robots/icub.urdf",
        "chest",
        {
            f"{s}_{name}": f"{s}_{link}"
            for s in "lr"
            for name, link in (("upper", "elbow_1"), ("fore", "forearm"), ("hand", "hand"))
        },
        0.4,
    ),
    "kinova": Described(
        "kinova_description/robots/kinova.urdf",
        "j2s6s200_link_base",
        {"fore": "j2s6s200_link_3", "wrist": "j2s6s200_link_5", "hand": "j2s6s200_end_effector"},
        0.7,
    ),
    "z1": Described(
        "z1_description/urdf/z1.urdf",
        "link00",
        {"upper": "link02", "fore": "link03", "hand": "link06"},
        0.6,
    ),
    "tiago": Described(
        "tiago_description/robots/tiago.urdf",
        "torso_lift_link",
        {"upper": "arm_3_link", "fore": "arm_5_link", "hand": "arm_7_link"},
        0.8,
    ),
}


def described_robot(name: str, rng: np.random.Generator) -> Robot:
    """A robot of [`DESCRIBED`] with drawn mounts and postures."""
    of = DESCRIBED[name]
    tree = bare(description_file(of.file).read_text(encoding="utf-8"))
    # Each marker at its link's origin first: where the camera goes depends on where these are.
    at_links = [mount(f"{marker}_marker", link, np.zeros(3)) for marker, link in of.markers.items()]
    rig = [mount(link, of.root, np.zeros(3)) for link in ("camera_optical", "chest_board")]
    bare_robot = _robot(name, of, mounted(tree, at_links + rig), {})
    above = {i for m in of.markers for i in bare_robot.ancestors(bare_robot.index[f"{m}_marker"])}
    moving = [bare_robot.bodies[i] for i in sorted(above) if bare_robot.bodies[i].joint_type == "hinge"]
    limits = {body.joint: _limits(body) for body in moving}
    middle, at_m = _in_front(_robot(name, of, bare_robot.urdf, limits), list(limits), of.reach_m, rng)
    height = float(at_m[:, 2].mean())
    mounts = []
    for marker, link in of.markers.items():
        direction = rng.normal(0, 1, 3)
        place = 0.06 * of.reach_m * direction / np.linalg.norm(direction)
        mounts.append(mount(f"{marker}_marker", link, place))
    camera = (-0.3 * of.reach_m, rng.uniform(-0.05, 0.05), height + 0.35 * of.reach_m)
    board = (-0.25 * of.reach_m, rng.uniform(-0.1, 0.1) * of.reach_m, height + 0.05 * of.reach_m)
    mounts.append(mount("camera_optical", of.root, camera, (-np.pi / 2 - TILT_RAD, 0.0, -np.pi / 2)))
    mounts.append(mount("chest_board", of.root, board, BOARD_RPY))
    ranges = {
        joint: (max(low, q - HALF_RANGE_RAD), min(high, q + HALF_RANGE_RAD))
        for (joint, (low, high)), q in zip(limits.items(), middle.tolist(), strict=True)
    }
    return _robot(name, of, mounted(tree, mounts), ranges)


def _robot(name: str, of: Described, urdf: str, ranges: dict[str, tuple[float, float]]) -> Robot:
    return Robot(
        name,
        urdf,
        of.root,
        read_bodies(urdf, of.root),
        sorted(ranges),
        ranges,
        list(of.markers),
        0.03,
        (8, 5),
        0.03,
        (1.6 * of.reach_m, 3.0 * of.reach_m),
        (1280, 960),
        (930.0, 1100.0),
        0.0125 * of.reach_m,
    )


def _limits(body: Body) -> tuple[float, float]:
    """Where a joint may go, no farther than so that its arm stays one posture away from its middle."""
    return max(body.lower, -2.8), min(body.upper, 2.8)


def _in_front(
    robot: Robot, joints: list[str], reach_m: float, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Positions (J,) of the joints, of many drawn, at which the markers (M, 3) are farthest in front and apart."""
    low, high = np.array([robot.ranges[joint] for joint in joints]).T
    drawn = low + rng.uniform(0.15, 0.85, (TRIED, len(joints))) * (high - low)
    poses = chain(robot, Commands(joints, drawn, np.zeros(TRIED)), Change())
    at_m = poses.position_m[[robot.index[f"{m}_marker"] for m in robot.markers]].transpose(1, 0, 2)
    pairs = np.triu_indices(len(robot.markers), 1)
    apart = np.linalg.norm(at_m[:, pairs[0]] - at_m[:, pairs[1]], axis=2).min(axis=1)
    height = at_m[:, :, 2]
    score = (
        np.minimum(at_m[:, :, 0], 0.5 * reach_m).sum(axis=1)
        - 0.3 * np.abs(height - height.mean(axis=1, keepdims=True)).sum(axis=1)
        - 5 * np.maximum(0.0, 0.12 * reach_m - apart)
    )
    best = int(np.argmax(score))
    return drawn[best], at_m[best]
