"""A session that a tracker saw: marker positions in the root's frame, of a body that is not as its model says.

The body is the hidden one of the simulated robots: plain NumPy that shares nothing with the core.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from mirror_lab.robots.hidden import HiddenBody, HiddenEffect
from mirror_posture.robots import Nominal

JOINTS = ("r_shoulder_pitch", "r_shoulder_roll", "r_elbow")
MARKERS = ("r_hand", "r_forearm")
NOISE_M = 0.0003
POSTURES = 90
SESSION = """format = "mirror-posture/session"
version = 1
robot = "robot.urdf"
root = "base_link"
gravity = [0.0, 0.0, -9.81]

[[markers]]
name = "r_hand"
link = "r_hand_marker"
diameter = 0.0

[[markers]]
name = "r_forearm"
link = "r_forearm_marker"
diameter = 0.0

[points]
frame = "base_link"

[noise]
point_std = 0.0003
"""


def write_tracked(
    folder: Path,
    seed: int,
    actual: Callable[[dict[str, float]], dict[str, float]] = lambda q: q,
    true_urdf: str | None = None,
    hidden: Sequence[HiddenEffect] = (),
    postures: Sequence[Sequence[float]] | None = None,
) -> Path:
    """Random postures of the embedded robot's right arm, or those given; `actual` gives the joints' real positions, `true_urdf` and `hidden`
    the real body."""
    nominal = Nominal.load()
    text = nominal.robot_file.read_text(encoding="utf-8")
    rng = np.random.default_rng(seed)
    limits = nominal.joint_limits
    low = np.array([max(limits[j].lower, -1.5) for j in JOINTS])
    high = np.array([min(limits[j].upper, 1.5) for j in JOINTS])
    metadata = nominal.metadata
    true = HiddenBody(true_urdf or text, metadata.root, metadata.gravity_m_per_s2, hidden)
    frames, points = [f"frame,posture,time_s,{','.join(JOINTS)}"], ["frame,marker,x,y,z"]
    # Drawn in turn with the noise.
    drawn = (rng.uniform(low, high) for _ in range(POSTURES)) if postures is None else postures
    for number, q in enumerate(drawn):
        true.move(actual(dict(zip(JOINTS, map(float, q), strict=True))))
        frames.append(f"{number},{number},{2.0 * number},{','.join(map(repr, map(float, q)))}")
        poses = true.link_poses()
        for marker in MARKERS:
            at = poses[f"{marker}_marker"][:3, 3] + rng.normal(0.0, NOISE_M, 3)
            points.append(f"{number},{marker},{','.join(map(repr, map(float, at)))}")
    folder.mkdir()
    (folder / "robot.urdf").write_text(text, encoding="utf-8")
    (folder / "session.toml").write_text(SESSION, encoding="utf-8")
    (folder / "frames.csv").write_text("\n".join(frames) + "\n", encoding="utf-8")
    (folder / "points.csv").write_text("\n".join(points) + "\n", encoding="utf-8")
    return folder
