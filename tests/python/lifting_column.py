"""An arm on a telescopic column, seen by a tracker: the column bends, and its guide has play in tilt.

The column is a stack of thin slices, each of which turns by the moment there over its stiffness, that of all tubes which overlap there. Plain NumPy that shares nothing with the core: neither its law nor its place of bending.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

TUBE_M = 1.5
"""Length of each of the three tubes; the outer one begins at the floor."""
ARM_KG, CARRIAGE_KG = 25.0, 10.0
REACH_M, CENTRE_M = 0.9, 0.5
NOISE_M = 0.0005
READ_M_PER_S2 = 0.01
URDF = f"""<robot name="lift">
<link name="base"/>
<link name="middle"/>
<link name="tube"><inertial><mass value="{CARRIAGE_KG}"/><origin xyz="0 0 {TUBE_M}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="arm"><inertial><mass value="{ARM_KG}"/><origin xyz="{CENTRE_M} 0 0"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="fore"/>
<link name="tool_marker"/>
<joint name="lift_1" type="prismatic"><parent link="base"/><child link="middle"/><origin xyz="0 0 0"/><axis xyz="0 0 1"/>
  <limit lower="0" upper="1.2" effort="1" velocity="1"/></joint>
<joint name="lift_2" type="prismatic"><parent link="middle"/><child link="tube"/><origin xyz="0 0 0"/><axis xyz="0 0 1"/>
  <limit lower="0" upper="1.2" effort="1" velocity="1"/></joint>
<joint name="turn" type="revolute"><parent link="tube"/><child link="arm"/><origin xyz="0 0 {TUBE_M}"/><axis xyz="0 0 1"/>
  <limit lower="-3.2" upper="3.2" effort="1" velocity="1"/></joint>
<joint name="elbow" type="revolute"><parent link="arm"/><child link="fore"/><origin xyz="{REACH_M} 0 0"/><axis xyz="0 1 0"/>
  <limit lower="-3.2" upper="3.2" effort="1" velocity="1"/></joint>
<joint name="tool" type="fixed"><parent link="fore"/><child link="tool_marker"/><origin xyz="0.5 0 0"/></joint>
</robot>"""
SESSION = f"""format = "mirror-posture/session"
version = 1
robot = "robot.urdf"
root = "base"
gravity = [0.0, 0.0, -9.81]

[[markers]]
name = "tool"
link = "tool_marker"
diameter = 0.0

[points]
frame = "unknown"

[noise]
point_std = {NOISE_M}
"""


def rotation(vector: Floats) -> Floats:
    """Rodrigues' formula."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector / angle
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * (k @ k)


def stands(
    lift_1: float,
    lift_2: float,
    turn: float,
    elbow: float,
    softness: tuple[float, float],
    play_rad: float,
    ground_rad_per_nm: tuple[float, float] = (0.0, 0.0),
) -> tuple[Floats, Floats]:
    """Where the tool's marker is, and the turn of the arm. `softness` is the inverse bending stiffness of one tube about x and y, 1/(N m²);
    `play_rad` the guide's whole play about y when half of the innermost tube is out; `ground_rad_per_nm` by what the floor yields about x and y."""
    toward = np.array([np.cos(turn), np.sin(turn), 0.0])
    moment = np.cross(CENTRE_M * toward, [0.0, 0.0, -9.81 * ARM_KG])
    out = lift_1 + lift_2
    slices, length = 150, TUBE_M + out
    step = length / slices
    at, r = np.zeros(3), rotation(moment * [*ground_rad_per_nm, 0.0])
    begins = (0.0, lift_1, out)
    guide = (out + lift_1 + TUBE_M) / 2.0
    for i in range(slices):
        z = (i + 0.5) * step
        tubes = sum(begin < z < begin + TUBE_M for begin in begins)
        bend = step * moment[:2] * np.array(softness) / tubes
        r = r @ rotation(np.array([bend[0], bend[1], 0.0]))
        if abs(z - guide) <= 0.5 * step:
            # A clearance over what is left of the overlap.
            tilt = play_rad * (TUBE_M / 2.0) / (TUBE_M - lift_2)
            r = r @ rotation(np.array([0.0, 0.5 * tilt * np.sign(moment[1]), 0.0]))
        at = at + r @ np.array([0.0, 0.0, step])
    hand = np.array([REACH_M + 0.5 * np.cos(elbow), 0.0, -0.5 * np.sin(elbow)])
    about = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    return at + r @ about @ hand, r @ about


def write_column(
    folder: Path,
    seed: int,
    softness: tuple[float, float] = (2e-5, 4e-5),
    play_rad: float = 0.004,
    postures: int = 160,
    ground_rad_per_nm: tuple[float, float] = (0.0, 0.0),
    sensor: bool = False,
) -> Path:
    """A session of random postures before a tracker that stands anywhere; `sensor`: an accelerometer on the arm."""
    rng = np.random.default_rng(seed)
    away, shift = rotation(np.array([0.1, -0.2, 1.1])), np.array([3.0, -2.0, 0.5])
    frames, points = ["frame,posture,time_s,lift_1,lift_2,turn,elbow"], ["frame,marker,x,y,z"]
    if sensor:
        frames[0] += "".join(f",accelerometer:arm:{axis}" for axis in "xyz")
    for number in range(postures):
        q = rng.uniform([0.0, 0.0, -3.0, -1.4], [1.15, 1.15, 3.0, 1.4])
        at, arm = stands(*map(float, q), softness, play_rad, ground_rad_per_nm)
        seen = away @ at + shift + rng.normal(0.0, NOISE_M, 3)
        read = 9.81 * arm[2] + rng.normal(0.0, READ_M_PER_S2, 3) if sensor else []
        frames.append(f"{number},{number},{3.0 * number},{','.join(map(repr, map(float, [*q, *read])))}")
        points.append(f"{number},tool,{','.join(map(repr, map(float, seen)))}")
    folder.mkdir()
    (folder / "robot.urdf").write_text(URDF, encoding="utf-8")
    (folder / "session.toml").write_text(SESSION, encoding="utf-8")
    (folder / "frames.csv").write_text("\n".join(frames) + "\n", encoding="utf-8")
    (folder / "points.csv").write_text("\n".join(points) + "\n", encoding="utf-8")
    return folder
