"""A base that is turned against the URDF's root, as that of UR's arms: the length of its link is told in its own frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mirror_posture import load_session
from mirror_posture.diagnosis import diagnose
from mirror_posture.diagnosis.applied.apply import apply_diagnosis

FRAMES, NOISE_M, OFF_M = 50, 2e-4, 0.006
URDF = """<robot name="turned"><link name="world"/><link name="base"/><link name="upper"/><link name="lower"/><link name="elbow_ball"/><link name="hand_ball"/>
<joint name="stand" type="fixed"><parent link="world"/><child link="base"/><origin xyz="0.1 0 0" rpy="0 0 1.5707963267948966"/></joint>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.3"/><axis xyz="0 0 1"/>
  <limit lower="-2" upper="2" effort="9" velocity="9"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>
  <limit lower="-2" upper="2" effort="9" velocity="9"/></joint>
<joint name="m1" type="fixed"><parent link="upper"/><child link="elbow_ball"/><origin xyz="0.25 0.03 0.02"/></joint>
<joint name="m2" type="fixed"><parent link="lower"/><child link="hand_ball"/><origin xyz="0.2 0.02 -0.03"/></joint></robot>"""
SESSION = """format = "mirror-posture/session"
version = 1
robot = "robot.urdf"
root = "world"
gravity = [0.0, 0.0, -9.81]
[[markers]]
name = "elbow"
link = "elbow_ball"
tolerance = 0.0
[[markers]]
name = "hand"
link = "hand_ball"
tolerance = 0.0
[noise]
point_std = 0.0002
[points]
frame = "world"
"""


def turn(axis: int, angle: float) -> np.ndarray:
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out = np.eye(3)
    out[i, i] = out[j, j] = np.cos(angle)
    out[j, i], out[i, j] = np.sin(angle), -np.sin(angle)
    return out


def balls(shoulder: float, elbow: float, off: np.ndarray) -> np.ndarray:
    """Elbow's and hand's ball (2, 3) in the world's frame, by the drawing of the arm; `off`: of the shoulder's origin, along the base's axes."""
    base = turn(2, np.pi / 2)
    at, upper = np.array([0.1, 0.0, 0.0]) + base @ (np.array([0.0, 0.0, 0.3]) + off), base @ turn(2, shoulder)
    joint, lower = at + upper @ [0.3, 0.0, 0.0], upper @ turn(1, elbow)
    return np.array([at + upper @ [0.25, 0.03, 0.02], joint + lower @ [0.2, 0.02, -0.03]])


def test_the_length_of_a_turned_base_is_told_along_its_own_axes_and_written_there(tmp_path: Path) -> None:
    random = np.random.default_rng(2)
    q = random.uniform(-1.5, 1.5, (FRAMES, 2))
    seen = np.array([balls(a, b, np.array([OFF_M, 0.0, 0.0])) for a, b in q])
    seen += random.normal(0.0, NOISE_M, seen.shape)
    folder = tmp_path / "session"
    folder.mkdir()
    (folder / "robot.urdf").write_text(URDF)
    (folder / "session.toml").write_text(SESSION)
    rows = "".join(f"{i},{i},{a!r},{b!r}\n" for i, (a, b) in enumerate(q.tolist()))
    (folder / "frames.csv").write_text("frame,posture,shoulder,elbow\n" + rows)
    rows = "".join(
        f"{i},{name},{','.join(map(repr, point))}\n"
        for i, both in enumerate(seen.tolist())
        for name, point in zip(("elbow", "hand"), both, strict=True)
    )
    (folder / "points.csv").write_text("frame,marker,x,y,z\n" + rows)
    session = load_session(folder)
    found = diagnose(session)
    (cause,) = found.causes
    assert (cause.effect, cause.at) == ("link_length", "link:base")
    told = [cause.parameters[name] for name in ("dx_m", "dy_m", "dz_m")]
    for parameter, true in zip(told, (OFF_M, 0.0, 0.0), strict=True):
        assert abs(parameter.value - true) < 4.0 * parameter.std < 0.001
    apply_diagnosis(session, found, tmp_path / "better")
    better = load_session(tmp_path / "better")
    poses = better.robot.link_poses(better.positions, ["elbow_ball", "hand_ball"])[:, :, :3, 3]
    rms_m = np.sqrt(((poses - seen) ** 2).sum(axis=2).mean())
    assert rms_m < 1.2 * np.sqrt(3.0) * NOISE_M
