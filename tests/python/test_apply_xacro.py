"""What was found, written into xacro as people write it: the property or argument that holds a joint's number, in one line."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest

import mirror_posture as mp
from mirror_posture import MirrorPostureError
from mirror_posture.diagnosis.applied import twice_told, write_own_files
from mirror_posture.diagnosis.applied.apply import apply_diagnosis
from mirror_posture.diagnosis.applied.own_xacro import patch_own_xacro
from mirror_posture.diagnosis.applied.urdf import Urdf
from mirror_posture.diagnosis.applied.xacro_tree import XacroTree
from session_folder import URDF, replaced, write_folder
from test_apply_patch import changed_lines, found

pytest.importorskip("xacro")

ROBOT = """<?xml version="1.0"?>
<!-- Two arms; see arm.xacro. -->
<robot name="pair" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="elbow_zero" default="0.0"/>
  <xacro:property name="elbow_zero" value="$(arg elbow_zero)"/>
  <xacro:property name="upper" value="0.3"/> <!-- m -->
  <xacro:property name="lift" value="0.02"/>
  <xacro:include filename="$(find pair_description)/urdf/arm.xacro"/>
  <link name="base"/>
  <xacro:arm prefix="left_" side="1"/>
  <xacro:arm prefix="right_" side="-1"
             wrist_zero="-0.01"/>
  <link name="head"/>
  <joint name="neck" type="revolute">
    <parent link="base"/> <child link="head"/>
    <origin xyz="0 ${lift} ${upper + lift}" rpy="0 0 ${pi/2}"/>
    <axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
</robot>
"""
ARM = """<?xml version="1.0"?>
<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:macro name="arm" params="prefix side wrist_zero:=0.0">
    <link name="${prefix}upper"><visual><origin xyz="${upper/2} 0 0"/><geometry><sphere radius="0.01"/></geometry></visual></link>
    <link name="${prefix}lower"/>
    <link name="${prefix}hand"/>
    <joint name="${prefix}shoulder" type="revolute">
      <parent link="base"/> <child link="${prefix}upper"/>
      <origin xyz="0 ${side*0.1} 0" rpy="0 0 0"/>
      <axis xyz="0 1 0"/>
      <limit lower="-1" upper="1" effort="1" velocity="1"/>
    </joint>
    <joint name="${prefix}elbow" type="revolute">
      <parent link="${prefix}upper"/> <child link="${prefix}lower"/>
      <origin xyz="${upper} 0 0" rpy="0 ${elbow_zero if side &gt; 0 else 0.0} 0"/>
      <axis xyz="0 1 0"/>
      <limit lower="-1" upper="1" effort="1" velocity="1"/>
    </joint>
    <joint name="${prefix}wrist" type="revolute">
      <parent link="${prefix}lower"/> <child link="${prefix}hand"/>
      <origin xyz="0.2 0 0" rpy="${wrist_zero} 0 0"/>
      <axis xyz="1 0 0"/>
      <limit lower="-1" upper="1" effort="1" velocity="1"/>
    </joint>
  </xacro:macro>
</robot>
"""


def write_package(folder: Path) -> Path:
    """A ROS package as people keep it; returns the robot's file."""
    (folder / "urdf").mkdir(parents=True)
    (folder / "package.xml").write_text("<package format='3'><name>pair_description</name></package>\n")
    (folder / "urdf" / "arm.xacro").write_text(ARM)
    main = folder / "urdf" / "pair.urdf.xacro"
    main.write_text(ROBOT)
    return main


def test_the_property_the_argument_or_the_call_that_holds_the_number(tmp_path: Path) -> None:
    main = write_package(tmp_path / "anything")
    tree = XacroTree(main)
    assert {file.name for file in tree.sources} == {"pair.urdf.xacro", "arm.xacro"}
    before = Urdf(tree.expand({}))
    after = Urdf(tree.expand({}))
    after.add_offset("left_elbow", 0.05)  # an argument
    after.add_offset("right_wrist", 0.02)  # a parameter of the call
    after.add_offset("left_wrist", 0.03)  # the macro's default, which the other call overrides
    after.add_offset("neck", -0.04)  # an expression
    patched = patch_own_xacro(tree, before, Urdf(after.text()))
    assert set(patched.texts) == set(tree.sources) and not any("not written" in line for line in patched.told)
    assert changed_lines(ROBOT, patched.texts[main]) == [
        (
            '  <xacro:arg name="elbow_zero" default="0.0"/>\n',
            '  <xacro:arg name="elbow_zero" default="0.05"/>\n',
        ),
        ('             wrist_zero="-0.01"/>\n', '             wrist_zero="0.01"/>\n'),
        (
            '    <origin xyz="0 ${lift} ${upper + lift}" rpy="0 0 ${pi/2}"/>\n',
            '    <origin xyz="0 ${lift} ${upper + lift}" rpy="0 0 ${(pi/2) - 0.04}"/>\n',
        ),
    ]
    [(_, line)] = changed_lines(ARM, patched.texts[main.parent / "arm.xacro"])
    assert 'wrist_zero:=0.03"' in line
    assert any("pair.urdf.xacro, line 4, argument elbow_zero: 0.0 to 0.05" in line for line in patched.told)
    # What a person would do: expand the new files. The robot at q is the old one at q + a.
    for file, text in patched.texts.items():
        file.write_text(text)
    new, old = mp.Robot.from_urdf_text(XacroTree(main).expand({})), mp.Robot.from_urdf_text(before.text())
    names = new.position_names
    q = 0.1 * np.arange(len(names))[None]
    shift = {"left_elbow": 0.05, "right_wrist": 0.02, "left_wrist": 0.03, "neck": -0.04}
    shifted = q + np.array([shift.get(name, 0.0) for name in names])
    links = ["left_hand", "right_hand", "head"]
    np.testing.assert_allclose(new.link_poses(q, links), old.link_poses(shifted, links), atol=1e-9)


def test_what_joints_share_is_told_with_its_line(tmp_path: Path) -> None:
    main = write_package(tmp_path / "anything")
    tree = XacroTree(main)
    before, after = Urdf(tree.expand({})), Urdf(tree.expand({}))
    after.add_offset("left_shoulder", 0.05)  # one line of the macro makes both shoulders
    after.shift_origin(
        "left_elbow", np.array([0.001, 0.0, 0.0])
    )  # `upper` moves neck and right elbow as well
    patched = patch_own_xacro(tree, before, Urdf(after.text()))
    assert not patched.texts
    told = dict(line.split(": ", 1) for line in patched.told)
    assert told["joint left_shoulder"] == (
        'not written: its numbers also move right_shoulder; at arm.xacro, line 7: origin rpy must become "0 0.05 0"'
    )
    assert "also move neck, right_elbow" in told["joint left_elbow"] and "line 13" in told["joint left_elbow"]


def test_a_property_that_shapes_follow_is_told(tmp_path: Path) -> None:
    """As published descriptions write it: a link's height stands for its joint, its box and its inertia."""
    file = tmp_path / "rr.xacro"
    file.write_text(
        '<robot name="rr" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:property name="height" value="1"/>\n'
        '<xacro:property name="gap" value="0.05"/>\n'
        '<link name="a"><visual><origin xyz="0 0 ${height/2 - gap}"/><geometry><box size="0.1 0.1 ${height}"/></geometry></visual></link>'
        '<link name="b"/><joint name="j" type="continuous"><parent link="a"/><child link="b"/>\n'
        '<origin xyz="0 ${2*gap} ${height - gap*2}" rpy="0 0 0"/><axis xyz="0 1 0"/></joint></robot>'
    )
    tree = XacroTree(file)
    before, after = Urdf(tree.expand({})), Urdf(tree.expand({}))
    after.shift_origin("j", np.array([0.0, 0.0, 0.004]))
    patched = patch_own_xacro(tree, before, Urdf(after.text()))
    assert patched.told == (
        "joint j: rr.xacro, line 1, property height: 1 to 1.004; 2 numbers of shapes and masses follow it",
    )


def test_other_arguments_and_other_robots_are_refused(tmp_path: Path) -> None:
    main = write_package(tmp_path / "anything")
    before = Urdf(XacroTree(main).expand({}))
    after = Urdf(before.text())
    after.add_offset("left_elbow", 0.05)
    with pytest.raises(MirrorPostureError, match="other arguments"):
        patch_own_xacro(XacroTree(main, {"elbow_zero": "0.1"}), before, Urdf(after.text()))
    main.write_text(ROBOT.replace("pair_description", "missing_one"))
    with pytest.raises(MirrorPostureError, match="--package missing_one=FOLDER"):
        XacroTree(main)
    XacroTree(main, packages={"missing_one": tmp_path / "anything"})
    main.write_text(ROBOT.replace('<xacro:arg name="elbow_zero" default="0.0"/>', ""))
    with pytest.raises(MirrorPostureError, match=r"elbow_zero.*--xacro-arg"):
        XacroTree(main, packages={"missing_one": tmp_path / "anything"})
    main.write_text(ROBOT.replace("${lift}", "${lift"))
    with pytest.raises(MirrorPostureError, match=r"pair\.urdf\.xacro: xacro cannot expand it"):
        XacroTree(main, packages={"missing_one": tmp_path / "anything"})


def test_own_files_in_xacro_get_patches_that_git_applies(tmp_path: Path) -> None:
    """The session's arm, its elbow's zero a property; and ros2_control's description, which must not say the same again."""
    own = tmp_path / "own" / "mine.xacro"
    own.parent.mkdir()
    robot = replaced(URDF, "<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ')
    head, start, rest = robot.partition('<joint name="elbow"')
    assert start and "<origin" in rest.partition("</joint>")[0]
    first, origin, tail = rest.partition("<origin ")
    assert 'rpy="' not in tail.partition("/>")[0]
    robot = f'{head}<xacro:property name="zero" value="0"/>\n{start}{first}{origin}rpy="0 ${{zero}} 0" {tail}'
    own.write_text(robot)
    session = mp.load_session(write_folder(tmp_path / "session"))
    controller = tmp_path / "control.xacro"
    controller.write_text(CONTROL)
    diagnosis = found(("joint_offset", "joint:elbow", {"offset_rad": 0.05}))
    applied = apply_diagnosis(session, diagnosis, tmp_path / "better")
    written = write_own_files(session, diagnosis, applied.folder, urdf=own, ros2_control=controller)
    model, hardware = written
    assert (
        len(changed_lines(robot, model.file.read_text())) == 1
        and 'name="zero" value="0.05"' in model.file.read_text()
    )
    assert [line for line in twice_told(written)] == ["elbow: mine.xacro and control.xacro"]
    subprocess.run(["git", "apply", "-p1", str(model.patch)], cwd=own.parent, check=True, capture_output=True)
    assert own.read_bytes() == model.file.read_bytes()
    [(_, line)] = changed_lines(CONTROL, hardware.file.read_text())
    assert line.strip() == "<offset>0.08</offset> <!-- by hand, May -->"


def test_a_xacro_of_another_robot_is_refused(tmp_path: Path) -> None:
    main = write_package(tmp_path / "anything")
    session = mp.load_session(write_folder(tmp_path / "session"))
    diagnosis = found(("joint_offset", "joint:elbow", {"offset_rad": 0.05}))
    applied = apply_diagnosis(session, diagnosis, tmp_path / "better")
    with pytest.raises(MirrorPostureError, match=r"pair\.urdf\.xacro: has no joint elbow.*left_elbow"):
        write_own_files(session, diagnosis, applied.folder, urdf=main)


CONTROL = """<?xml version="1.0"?>
<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:macro name="control" params="prefix">
    <ros2_control name="Arm" type="system">
      <hardware><plugin>my_hardware/Arm</plugin></hardware>
      <joint name="shoulder"><command_interface name="position"/><param name="offset">2048</param></joint>
      <joint name="elbow"><command_interface name="position"/><state_interface name="position"/></joint>
      <transmission name="elbow_transmission">
        <plugin>transmission_interface/SimpleTransmission</plugin>
        <actuator name="m2" role="actuator1"/>
        <joint name="elbow" role="joint1">
          <mechanical_reduction>50.0</mechanical_reduction>
          <offset>0.03</offset> <!-- by hand, May -->
        </joint>
      </transmission>
      <transmission name="wrist_transmission">
        <plugin>transmission_interface/SimpleTransmission</plugin>
        <joint name="wrist" role="joint1"/>
      </transmission>
      <transmission name="hand_transmission">
        <plugin>transmission_interface/DifferentialTransmission</plugin>
        <joint name="hand" role="joint1"><mechanical_reduction>${ratio}</mechanical_reduction></joint>
      </transmission>
      <transmission name="neck_transmission">
        <plugin>transmission_interface/SimpleTransmission</plugin>
        <joint name="neck" role="joint1">
          <mechanical_reduction>${ratio}</mechanical_reduction>
          <offset>${neck_zero}</offset>
        </joint>
      </transmission>
    </ros2_control>
  </xacro:macro>
</robot>
"""
