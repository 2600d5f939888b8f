"""Random robots: small humanoids of random sizes, and arms with random joints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .robots import Robot, mount, read_bodies

Array = NDArray[np.float64]

OPTICAL_RPY = (-np.pi / 2, 0.0, -np.pi / 2)
"""A camera that looks along x, its picture upright."""
BOARD_RPY = (np.pi / 2, 0.0, np.pi / 2)
"""A board that faces along x."""


def _link(name: str, mass: float, com: Sequence[float] | Array, size: float) -> str:
    """A rod-like link: `size` is its length."""
    i = mass * size**2 / 12
    return (
        f'  <link name="{name}">\n    <inertial>\n'
        f'      <origin xyz="{com[0]:.6g} {com[1]:.6g} {com[2]:.6g}"/>\n'
        f'      <mass value="{mass:.5g}"/>\n'
        f'      <inertia ixx="{i:.4g}" ixy="0" ixz="0" iyy="{i:.4g}" iyz="0" izz="{0.5 * i:.4g}"/>\n'
        f"    </inertial>\n  </link>\n"
    )


def _joint(
    name: str,
    parent: str,
    child: str,
    xyz: Sequence[float] | Array,
    axis: str,
    limits: tuple[float, float],
    rpy: Sequence[float] | Array = (0.0, 0.0, 0.0),
) -> str:
    return (
        f'  <joint name="{name}" type="revolute">\n'
        f'    <origin xyz="{xyz[0]:.6g} {xyz[1]:.6g} {xyz[2]:.6g}" '
        f'rpy="{rpy[0]:.6g} {rpy[1]:.6g} {rpy[2]:.6g}"/>\n'
        f'    <parent link="{parent}"/>\n    <child link="{child}"/>\n    <axis xyz="{axis}"/>\n'
        f'    <limit lower="{limits[0]:.4g}" upper="{limits[1]:.4g}" effort="2" velocity="5"/>\n  </joint>\n'
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
        parts.append(_link(name, mass, com, size))

    def joint(
        name: str, parent: str, child: str, xyz: Sequence[float], axis: str, low: float, high: float
    ) -> None:
        parts.append(_joint(name, parent, child, xyz, axis, (low, high)))

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
        parts.append(mount(f"{side}_hand_marker", hand, np.array([0.006, sign * 0.007, hand_z]) + jitter[0]))
        parts.append(
            mount(
                f"{side}_forearm_marker", arm_link, np.array([0.012, sign * 0.003, -0.45 * fore]) + jitter[1]
            )
        )
        parts.append(
            mount(
                f"{side}_upper_marker", roll_link, np.array([0.013, sign * 0.004, -0.4 * upper]) + jitter[2]
            )
        )
    parts.append(
        mount(
            "camera_optical", "head", (rng.uniform(0.02, 0.035), 0.0, rng.uniform(0.015, 0.03)), OPTICAL_RPY
        )
    )
    board_z = shoulder_z * rng.uniform(0.45, 0.6)
    parts.append(mount("chest_board", "chest", (rng.uniform(0.03, 0.045), 0.0, board_z), BOARD_RPY))
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


def two_arms(rng: np.random.Generator) -> Robot:
    """As `random_robot`, with two arms of seven joints each."""
    return random_robot(rng, ["a", "b"], 7)


def random_robot(
    rng: np.random.Generator, arms: Sequence[str] | None = None, joints_each: int | None = None
) -> Robot:
    """A post with a camera, a board and one or two arms, whose joints, oblique axes, lengths and masses are all
    drawn; how many arms and joints too, where that is not told."""
    reach = rng.uniform(0.45, 0.9)
    if arms is None:
        arms = ["a", "b"] if rng.random() < 0.6 else ["a"]
    parts = [_link("post", 5.0, (0, 0, 0.2), 0.4)]
    ranges: dict[str, tuple[float, float]] = {}
    markers: list[str] = []
    for arm in arms:
        joints = int(rng.integers(4, 7)) if joints_each is None else joints_each
        share = rng.uniform(0.5, 1.5, joints)
        lengths = reach * share / share.sum()
        side = {"a": -1.0, "b": 1.0}[arm]
        parent, at = "post", np.array([0.05, side * rng.uniform(0.18, 0.3) * reach, rng.uniform(0.35, 0.5)])
        before = np.zeros(3)
        for k, length in enumerate(lengths):
            name, child = f"{arm}{k + 1}", f"{arm}{k + 1}_link"
            # Neighbouring axes differ by at least 40 degrees: nearly parallel ones act as one joint.
            axis = _unit(rng.normal(size=3))
            while abs(axis @ before) > np.cos(np.radians(40)):
                axis = _unit(rng.normal(size=3))
            before = axis
            low, high = -rng.uniform(0.5, 1.0), rng.uniform(0.5, 1.0)
            text = " ".join(f"{v:.9f}" for v in axis)
            parts.append(
                _joint(name, parent, child, at, text, (low - 0.1, high + 0.1), rng.normal(0, 0.1, 3))
            )
            ranges[name] = (low, high)
            # Links hang down and forward, each bent a little against the one before.
            at = length * _unit(np.array([0.35, 0.0, -0.9]) + rng.normal(0, 0.35, 3))
            parts.append(_link(child, float(rng.uniform(0.6, 2.0) * length * 4), 0.5 * at, float(length)))
            parent = child
            if k in (joints - 1, joints // 2) or (k >= 1 and rng.random() < 0.3):
                marker = f"{arm}{k + 1}"
                parts.append(mount(f"{marker}_marker", child, 0.8 * at + rng.normal(0, 0.015, 3)))
                markers.append(marker)
    parts.append(mount("camera_optical", "post", (0.08, rng.uniform(-0.03, 0.03), 0.62), OPTICAL_RPY))
    parts.append(
        mount("chest_board", "post", (0.12, rng.uniform(-0.03, 0.03), rng.uniform(0.25, 0.4)), BOARD_RPY)
    )
    urdf = '<robot name="random">\n' + "".join(parts) + "</robot>\n"
    return Robot(
        "random",
        urdf,
        "post",
        read_bodies(urdf, "post"),
        sorted(ranges),
        ranges,
        markers,
        0.025,
        [(7, 4), (8, 5)][rng.integers(2)],
        0.026,
        (1.2, 2.2),
        (1280, 960),
        (930.0, 1100.0),
        0.0125 * reach,
    )


def _unit(v: Array) -> Array:
    result: Array = v / np.linalg.norm(v)
    return result
