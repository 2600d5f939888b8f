"""A link that is hollow: whether an arm in it touches its walls."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mirror_posture.plan import PlanOptions
from mirror_posture.plan.room import ignore_by_construction
from mirror_posture.plan.setting import read_setting
from mirror_posture.render import EMBEDDED_FOLDER
from mirror_posture.robots import Nominal
from mirror_posture.shapes.body import Body
from mirror_posture.shapes.triangles import Triangles, box, write_stl

HOLLOW = """<robot name="hollow"><link name="base"/><link name="shoulder"/>
<link name="channel"><visual><geometry><mesh filename="channel.stl"/></geometry></visual></link>
<link name="arm"><visual><origin xyz="0.08 0 0"/><geometry><box size="0.16 0.02 0.02"/></geometry></visual></link>
<joint name="fixed" type="fixed"><parent link="base"/><child link="channel"/></joint>
<joint name="first" type="revolute"><parent link="channel"/><child link="shoulder"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="second" type="revolute"><parent link="shoulder"/><child link="arm"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<link name="camera_optical"/><joint name="camera" type="fixed"><parent link="base"/><child link="camera_optical"/></joint>
<link name="board"/><joint name="board" type="fixed"><parent link="base"/><child link="board"/><origin xyz="0 0 1"/></joint>
<link name="hand_marker"/><joint name="hand" type="fixed"><parent link="arm"/><child link="hand_marker"/><origin xyz="0.3 0 0"/></joint>
</robot>"""


def test_an_arm_in_a_hollow_link_is_checked_against_its_walls(tmp_path: Path) -> None:
    """A channel of two walls, as a torso beside an arm: its convex hull holds the arm at home, its walls do not."""
    walls = [box(np.array([0.2, 0.01, 0.1])).moved(np.eye(3), np.array([0.1, y, 0.0])) for y in (-0.06, 0.06)]
    channel = Triangles(
        np.concatenate([w.vertices_m for w in walls]),
        np.concatenate([w.faces + k * len(walls[0].vertices_m) for k, w in enumerate(walls)]),
    )
    write_stl(channel, tmp_path / "channel.stl")
    (tmp_path / "robot.urdf").write_text(HOLLOW)
    for name in ("camera.yaml", "session.toml"):
        (tmp_path / name).write_bytes((EMBEDDED_FOLDER / name).read_bytes())
    toml = 'format = "mirror-posture/session"\nversion = 1\nrobot = "robot.urdf"\ncamera = "camera.yaml"\nroot = "base"\ngravity = [-9.81, 0.0, 0.0]\n'
    toml += '[camera_mount]\nlink = "camera_optical"\n[board]\nlink = "board"\ncorners = [7, 4]\nsquare = 0.02\npattern = "chessboard"\n'
    toml += '[[markers]]\nname = "hand"\nlink = "hand_marker"\ndiameter = 0.02\nmount = "known"\n'
    (tmp_path / "session.toml").write_text(toml)
    nominal = Nominal.load(tmp_path)
    setting = read_setting(nominal, PlanOptions())
    body = Body(nominal, {}, 0.01)
    pair = frozenset(("arm", "channel"))
    body.put(np.zeros(2))
    assert pair in body.touching(), "by its hull the channel is full"
    assert ignore_by_construction(body, setting, np.random.default_rng(0)) == []
    for posture, touches in (
        ((0.0, 0.0), False),
        ((0.15, 0.0), False),
        ((0.6, 0.0), True),
        ((0.6, -0.6), False),
        ((-0.3, -0.3), True),
    ):
        body.put(np.array(posture))
        assert (pair in body.touching()) == touches, posture
