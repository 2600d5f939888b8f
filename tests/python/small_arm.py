"""An arm of boxes with three joints on a table, camera and board beside it: the session of the tests of the way in."""

from __future__ import annotations

from pathlib import Path

from typer.testing import CliRunner

from init_once import initialised
from mirror_posture import cli

URDF = """<?xml version="1.0"?>
<robot name="small_arm">
  <link name="base"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><origin xyz="0 0 0.025"/><geometry><box size="0.1 0.3 0.05"/></geometry></visual></link>
  <link name="turret"><inertial><origin xyz="0 0 0.03"/><mass value="0.3"/><inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><origin xyz="0 0 0.03"/><geometry><box size="0.05 0.05 0.06"/></geometry></visual></link>
  <link name="upper"><inertial><origin xyz="0.07 0 0"/><mass value="0.3"/><inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><origin xyz="0.07 0 0"/><geometry><box size="0.14 0.03 0.03"/></geometry></visual></link>
  <link name="fore"><inertial><origin xyz="0.06 0 0"/><mass value="0.2"/><inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><origin xyz="0.06 0 0"/><geometry><box size="0.12 0.025 0.025"/></geometry></visual></link>
  <joint name="pan" type="revolute"><parent link="base"/><child link="turret"/><origin xyz="0 0 0.05"/>
    <axis xyz="0 0 1"/><limit lower="-1.5" upper="1.5" effort="5" velocity="3"/></joint>
  <joint name="lift" type="revolute"><parent link="turret"/><child link="upper"/><origin xyz="0 0 0.06"/>
    <axis xyz="0 -1 0"/><limit lower="-0.4" upper="1.6" effort="5" velocity="3"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.15 0 0"/>
    <axis xyz="0 -1 0"/><limit lower="-2.2" upper="2.2" effort="5" velocity="3"/></joint>
</robot>
"""
MOUNTS = [
    "--camera", "base", "--camera-at=-0.05,0.12,0.25", "--camera-looks", "1,0,-0.2",
    "--board", "base", "--board-at=0.02,-0.17,0.12", "--marker", "hand=fore@0.13,0,0.02", "--marker", "wrist=fore@0.03,0.025,0",
    "--corners", "7x4", "--square-mm", "20", "--ball-mm", "20", "--glass-mm", "0", "--picture", "960x720", "--focal-px", "760",
]  # fmt: skip


def run(*arguments: object, code: int = 0, **options):
    """Runs a command of the package and checks its exit code."""
    result = CliRunner().invoke(cli.app, [str(argument) for argument in arguments], **options)
    assert result.exit_code == code, f"{result.exit_code}: {result.output}\n{result.exception!r}"
    return result


def setup(folder: Path, half: bool = False) -> Path:
    """A session without frames, made by `init`; `half`: of a camera with half as many pixels across and down."""
    file = folder / "small_arm.urdf"
    file.write_text(URDF)
    smaller = ["--picture", "480x360", "--focal-px", "380"]
    return initialised(file, folder / "session", *(MOUNTS[:-4] + smaller if half else MOUNTS))
