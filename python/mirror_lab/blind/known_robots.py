"""Robots that exist, from the package `example-robot-data`, with drawn mounts of camera, board and markers."""

from __future__ import annotations

import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from .drawn_robots import BOARD_RPY, OPTICAL_RPY
from .errors import BlindError
from .robots import Robot, mount, read_bodies

PACKAGE = "cmeel.prefix/share/example-robot-data/robots"
G1 = "g1_description/urdf/g1_29dof_rev_1_0.urdf"
TALOS = "talos_data/robots/talos_reduced.urdf"
UR10 = "ur_description/urdf/ur10_robot.urdf"


def description_file(file: str) -> Path:
    for place in sys.path:
        path = Path(place) / PACKAGE / file
        if path.is_file():
            return path
    raise BlindError(
        f"{file} is in the package `example-robot-data` (extra `blind`), which is not installed; "
        "or draw other robots: --robot small, --robot random, --robot FILE"
    )


def bare(text: str) -> ET.Element:
    """The URDF without meshes and without what only controllers read."""
    tree = ET.fromstring(text)
    for link in tree.findall("link"):
        for tag in ("visual", "collision"):
            for element in link.findall(tag):
                link.remove(element)
    for tag in ("mujoco", "transmission", "gazebo", "material"):
        for element in tree.findall(tag):
            tree.remove(element)
    ET.indent(tree)
    return tree


def mounted(tree: ET.Element, mounts: list[str]) -> str:
    return ET.tostring(tree, encoding="unicode").replace("</robot>", "".join(mounts) + "</robot>\n")


def unitree_g1(rng: np.random.Generator, urdf_path: Path | None = None) -> Robot:
    """Unitree's G1 from `example-robot-data`, its torso held still, with drawn mounts of camera, board and
    markers."""
    text = (urdf_path or description_file(G1)).read_text(encoding="utf-8")
    tree = bare(text)
    mounts = []
    ranges: dict[str, tuple[float, float]] = {}
    for side, sign in (("right", -1.0), ("left", 1.0)):
        s = side[0]
        jitter = rng.uniform(-0.015, 0.015, (3, 3))
        mounts.append(
            mount(
                f"{s}_hand_marker", f"{side}_wrist_yaw_link", np.array([0.11, sign * 0.01, 0.03]) + jitter[0]
            )
        )
        mounts.append(
            mount(f"{s}_forearm_marker", f"{side}_elbow_link", np.array([0.07, 0.0, 0.035]) + jitter[1])
        )
        mounts.append(
            mount(f"{s}_upper_marker", f"{side}_shoulder_yaw_link", np.array([0.045, 0, -0.045]) + jitter[2])
        )
        ranges |= {
            f"{side}_shoulder_pitch_joint": (-1.5, 0.4),
            f"{side}_shoulder_roll_joint": _sorted(sign * -0.1, sign * 0.9),
            f"{side}_shoulder_yaw_joint": (-0.7, 0.7),
            f"{side}_elbow_joint": (-0.3, 1.4),
            f"{side}_wrist_roll_joint": (-0.7, 0.7),
            f"{side}_wrist_pitch_joint": (-0.7, 0.7),
            f"{side}_wrist_yaw_joint": (-0.7, 0.7),
        }
    tilt = rng.uniform(-0.05, 0.25)
    optical = (-np.pi / 2 - tilt, 0.0, -np.pi / 2)
    mounts.append(
        mount(
            "camera_optical", "torso_link", (rng.uniform(0.07, 0.1), rng.uniform(-0.02, 0.02), 0.42), optical
        )
    )
    board = (rng.uniform(0.12, 0.14), rng.uniform(-0.03, 0.03), rng.uniform(0.15, 0.24))
    mounts.append(mount("chest_board", "torso_link", board, BOARD_RPY))
    urdf = mounted(tree, mounts)
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


def talos(rng: np.random.Generator) -> Robot:
    """TALOS of PAL Robotics, upper body: the torso held still, a camera in its real head, which is held or moved a
    little."""
    tree = bare(description_file(TALOS).read_text(encoding="utf-8"))
    mounts = []
    ranges: dict[str, tuple[float, float]] = {}
    for side, sign in (("right", -1.0), ("left", 1.0)):
        s = side[0]
        jitter = rng.uniform(-0.02, 0.02, (3, 3))
        hand, forearm, upper = (
            np.array(v) for v in ((0.0, 0.0, -0.12), (0.05, 0.0, -0.12), (0.07, 0.0, -0.13))
        )
        mounts.append(mount(f"{s}_hand_marker", f"arm_{side}_7_link", hand + jitter[0]))
        mounts.append(mount(f"{s}_forearm_marker", f"arm_{side}_4_link", forearm + jitter[1]))
        mounts.append(mount(f"{s}_upper_marker", f"arm_{side}_3_link", upper + jitter[2]))
        ranges |= {
            f"arm_{side}_1_joint": _sorted(sign * -0.7, sign * 0.3),
            f"arm_{side}_2_joint": _sorted(sign * 0.1, sign * 0.9),
            f"arm_{side}_3_joint": (-0.8, 0.8),
            f"arm_{side}_4_joint": (-2.0, -0.4),
            f"arm_{side}_5_joint": (-1.0, 1.0),
            f"arm_{side}_6_joint": (-0.7, 0.7),
            f"arm_{side}_7_joint": (-0.6, 0.6),
        }
    pitch = rng.uniform(0.15, 0.35)
    ranges["head_1_joint"] = (pitch, pitch) if rng.random() < 0.6 else (pitch - 0.08, pitch + 0.08)
    mounts.append(mount("camera_optical", "head_2_link", (0.07, rng.uniform(-0.02, 0.02), 0.12), OPTICAL_RPY))
    board = (0.17, rng.uniform(-0.03, 0.03), rng.uniform(0.1, 0.2))
    mounts.append(mount("chest_board", "torso_2_link", board, BOARD_RPY))
    urdf = mounted(tree, mounts)
    return Robot(
        "talos",
        urdf,
        "torso_2_link",
        read_bodies(urdf, "torso_2_link"),
        sorted(ranges),
        ranges,
        [f"{s}_{m}" for s in "rl" for m in ("hand", "forearm", "upper")],
        0.04,
        (8, 5),
        0.03,
        (1.3, 2.2),
        (1280, 960),
        (930.0, 1100.0),
        0.008,
    )


def ur10(rng: np.random.Generator) -> Robot:
    """A UR10 on a stand, with a camera and a board on a mast behind it: one industrial arm of six joints."""
    tree = bare(description_file(UR10).read_text(encoding="utf-8"))
    jitter = rng.uniform(-0.02, 0.02, (3, 3))
    places = {
        "forearm": ("forearm_link", (0.0, 0.06, 0.3)),
        "wrist": ("wrist_2_link", (0.0, 0.06, 0.09)),
        "tool": ("ee_link", (0.08, 0.03, 0.02)),
    }
    mounts = [
        mount(f"{m}_marker", link, np.array(at) + jitter[k])
        for k, (m, (link, at)) in enumerate(places.items())
    ]
    mounts.append(mount("camera_optical", "base_link", (-0.35, rng.uniform(-0.1, 0.1), 1.0), OPTICAL_RPY))
    mounts.append(
        mount("chest_board", "base_link", (-0.3, rng.uniform(-0.1, 0.1), rng.uniform(0.6, 0.75)), BOARD_RPY)
    )
    urdf = mounted(tree, mounts)
    ranges = {
        "shoulder_pan_joint": (-0.6, 0.6),
        "shoulder_lift_joint": (-1.9, -1.0),
        "elbow_joint": (0.9, 1.9),
        "wrist_1_joint": (-1.0, 0.6),
        "wrist_2_joint": (-0.9, 0.9),
        "wrist_3_joint": (-1.2, 1.2),
    }
    return Robot(
        "ur10",
        urdf,
        "base_link",
        read_bodies(urdf, "base_link"),
        sorted(ranges),
        ranges,
        list(places),
        0.04,
        (8, 5),
        0.05,
        (2.4, 3.6),
        (1280, 960),
        (930.0, 1100.0),
        0.012,
    )


def _sorted(a: float, b: float) -> tuple[float, float]:
    return (a, b) if a < b else (b, a)
