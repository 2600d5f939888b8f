"""What is found at a joint that slides is in m and N, in the files of others too."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import mirror_posture as mp
from mirror_posture.diagnosis.applied import apply_diagnosis, write_own_files
from session_folder import URDF, replaced, write_folder
from test_apply_another_robot import lerobot
from test_apply_patch import found

MASS = '<inertial><mass value="0.2"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>'


def session_that_slides(folder: Path) -> mp.Session:
    """The small session with a shoulder that slides."""
    text = replaced(URDF, 'name="shoulder" type="revolute"', 'name="shoulder" type="prismatic"')
    for link in ("upper", "lower"):
        text = replaced(text, f'<link name="{link}"/>', f'<link name="{link}">{MASS}</link>')
    return mp.load_session(write_folder(folder, robot=text))


def test_play_springs_and_stiction_of_a_joint_that_slides_slide(tmp_path: Path) -> None:
    """Before: hinges, whose numbers were m and N/m; and of stiction's droop nothing."""
    mujoco = pytest.importorskip("mujoco")
    diagnosis = found(
        ("backlash", "joint:shoulder", {"width_rad": 0.002}),
        ("joint_compliance", "joint:shoulder", {"compliance_rad_per_nm": 0.004}),
        ("stiction", "joint:shoulder", {"deadband_rad": 0.001, "droop_rad_per_nm": 0.005}),
        ("stiction", "joint:elbow", {"deadband_rad": 0.001, "droop_rad_per_nm": 0.0}),
    )
    applied = apply_diagnosis(session_that_slides(tmp_path / "session"), diagnosis, tmp_path / "better")
    play, spring, stiction, elbow = (entry.what for entry in applied.written)
    assert play == "slide shoulder_play in series, from -0.00100 to 0.00100 m"
    assert spring == "slide shoulder_spring in series with a stiffness of 250 N/m"
    assert (
        stiction.startswith("frictionloss") and "slide shoulder_droop" in stiction and "rad" not in stiction
    )
    assert "N m/rad" in elbow and "droop" not in elbow
    model = mujoco.MjModel.from_xml_path(str(applied.folder / "robot.mjcf.xml"))
    for name in ("shoulder_play", "shoulder_spring", "shoulder_droop"):
        assert model.joint(name).type[0] == mujoco.mjtJoint.mjJNT_SLIDE
    assert model.joint("shoulder_droop").stiffness[0] == pytest.approx(200.0)


def test_a_length_is_no_ticks_of_a_turn(tmp_path: Path) -> None:
    """Before: 12 mm were written as 0.012 rad. Nor does the file hold gear ratios, which was not said."""
    session = session_that_slides(tmp_path / "session")
    diagnosis = found(
        ("joint_offset", "joint:shoulder", {"offset_rad": 0.012}),
        ("gear_ratio", "joint:elbow", {"scale_error": 0.02}),
        ("joint_offset", "joint:elbow", {"offset_rad": 0.012}),
    )
    own, better = tmp_path / "arm.json", tmp_path / "better"
    own.write_text(lerobot("shoulder", "elbow"))
    apply_diagnosis(session, diagnosis, better)
    [written] = write_own_files(session, diagnosis, better, lerobot=own)
    slides, gear, turns = written.told
    assert "not written: joint shoulder slides by +12 mm" in slides
    assert "not written" in gear and "no gear ratios" in gear
    assert "homing_offset of elbow: 100 to 92" in turns
    after = json.loads(written.file.read_text())
    assert (after["shoulder"]["homing_offset"], after["elbow"]["homing_offset"]) == (100, 92)


CONTROL = """<robot name="arm"><ros2_control name="hardware" type="system">
  <joint name="shoulder"/><joint name="elbow"/>
</ros2_control></robot>
"""


def test_what_to_do_in_a_driver_is_told_in_metres(tmp_path: Path) -> None:
    """Before: "grow by 0.012 rad" of a joint that slides."""
    diagnosis = found(
        ("joint_offset", "joint:shoulder", {"offset_rad": 0.012}),
        ("joint_offset", "joint:elbow", {"offset_rad": 0.012}),
    )
    session, own, better = (
        session_that_slides(tmp_path / "session"),
        tmp_path / "control.urdf",
        tmp_path / "better",
    )
    own.write_text(CONTROL)
    apply_diagnosis(session, diagnosis, better)
    [written] = write_own_files(session, diagnosis, better, ros2_control=own)
    slides, turns = written.told
    assert slides.endswith("what the joint reports must grow by +0.012 m")
    assert turns.endswith("what the joint reports must grow by +0.012 rad")
