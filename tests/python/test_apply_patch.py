"""Applying changes what changed and nothing else, in the files in which people keep it."""

from __future__ import annotations

import itertools
import json
import math
import subprocess
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

import mirror_posture as mp
from mirror_posture import MirrorPostureError, cli
from mirror_posture.diagnosis import Cause, Diagnosis, Estimate, Gap
from mirror_posture.diagnosis.applied import apply_diagnosis, write_own_files
from mirror_posture.diagnosis.applied.lerobot import patch_lerobot
from mirror_posture.diagnosis.applied.own_mjcf import patch_own_mjcf
from mirror_posture.diagnosis.applied.own_urdf import patch_own_urdf
from mirror_posture.diagnosis.applied.ur_calibration import patch_ur_calibration
from mirror_posture.diagnosis.applied.urdf import Urdf
from mirror_posture.diagnosis.applied.xml_text import XmlText
from mirror_posture.diagnosis.fingerprint import KEY, fingerprint
from mirror_posture.diagnosis.result import VERSION
from session_folder import URDF, replaced, write_folder


def g1_file() -> Path:
    """G1's URDF as others published it."""
    import sysconfig

    file = (
        Path(sysconfig.get_paths()["purelib"])
        / "cmeel.prefix/share/example-robot-data/robots/g1_description/urdf/g1_29dof_rev_1_0.urdf"
    )
    if not file.is_file():
        pytest.skip("example-robot-data has no G1")
    return file


def found(*causes: tuple[str, str, dict[str, float]], document: dict[str, object] | None = None) -> Diagnosis:
    made = tuple(
        Cause(effect, at, 0.99, {name: Estimate(value, 0.0) for name, value in values.items()})
        for effect, at, values in causes
    )
    return Diagnosis("explained", "", made, (), Gap(1.0, 0.0, 0.0), document=document or {})


def changed_lines(before: str, after: str) -> list[tuple[str, str]]:
    a, b = before.splitlines(keepends=True), after.splitlines(keepends=True)
    assert len(a) == len(b)
    return [(x, y) for x, y in zip(a, b, strict=True) if x != y]


@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_one_value_of_g1_changes_one_line(ends: str) -> None:
    text = g1_file().read_bytes().decode().replace("\r\n", "\n").replace("\n", ends)
    urdf = Urdf(text)
    urdf.add_offset("left_elbow_joint", 0.03)
    after = urdf.text()
    assert urdf.text() == after, "asking twice gives the same"
    [(old, new)] = changed_lines(text, after)
    # The elbow's axis is y and its origin is not turned: the angle itself stands in the file.
    assert 'rpy="0 0 0"' in old and 'rpy="0 0.03 0"' in new
    assert old.replace("0 0 0", "0 0.03 0") == new
    assert Urdf(text).text() == text


def test_every_joint_of_g1_can_be_changed_and_stands_as_told() -> None:
    pin = pytest.importorskip("pinocchio")
    text = g1_file().read_text()
    model = pin.buildModelFromXML(text)
    generator = np.random.default_rng(3)
    urdf, offsets = Urdf(text), {}
    for name in list(model.names)[1:]:
        offsets[name] = float(generator.uniform(-0.1, 0.1))
        urdf.add_offset(name, offsets[name])
    assert len(changed_lines(text, urdf.text())) == len(offsets) == 29
    # Pinocchio, another reader: the corrected robot at q is the nominal one at q + a.
    better = pin.buildModelFromXML(urdf.text())
    q = generator.uniform(-0.5, 0.5, model.nq)
    shifted = q + np.array([offsets[name] for name in list(model.names)[1:]])
    data, data_better = model.createData(), better.createData()
    pin.forwardKinematics(model, data, shifted)
    pin.forwardKinematics(better, data_better, q)
    for index in range(model.njoints):
        np.testing.assert_allclose(data_better.oMi[index].translation, data.oMi[index].translation, atol=1e-9)


def test_an_offset_reaches_the_joints_that_follow() -> None:
    """Gears drive the followers from where the leading joint really is: `θ = m (q + a) + b`, by chains of them too."""
    chain = "base a b c d".split()
    links = "".join(f'<link name="{link}"/>' for link in chain)
    follows = {
        "b": '<mimic joint="a" multiplier="-1.5" offset="0.2"/>',
        "c": '<mimic joint="b" multiplier="2"/>',
    }

    def text(mimics: dict[str, str]) -> str:
        joints = "".join(
            f'<joint name="{child}" type="{"prismatic" if child == "c" else "revolute"}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="0.1 0.02 0" rpy="0.3 0 0.1"/><axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="1" velocity="1"/>'
            f"{mimics.get(child, '')}</joint>"
            for parent, child in itertools.pairwise(chain)
        )
        return f'<robot name="r">{links}{joints}</robot>'

    urdf, q, a = Urdf(text(follows)), 0.4, 0.07
    assert urdf.add_offset("a", a) == ["a", "b", "c"]
    better, free = mp.Robot.from_urdf_text(urdf.text()), mp.Robot.from_urdf_text(text({}))
    real = q + a
    stands = [real, -1.5 * real + 0.2, 2.0 * (-1.5 * real + 0.2), -0.3]
    np.testing.assert_allclose(
        better.forward_kinematics([[q, -0.3]]), free.forward_kinematics([stands]), atol=1e-12
    )


def test_text_around_an_attribute_stays_to_the_letter() -> None:
    text = "\ufeff<?xml version='1.0'?>\r\n<!-- <robot> of ä -->\r\n<a  one = '1>2'\r\n   two=\"x\" >\r\n\t<b/><c\n/></a>\r\n"
    assert XmlText(text).text() == text
    document = XmlText(text)
    b, c = document.root.children
    document.set(document.root, "one", 'q"&')
    document.set(c, "new", "5")
    document.insert_after(b, "d", {"e": "f"})
    assert document.text() == text.replace("'1>2'", "'q\"&amp;'").replace(
        "<b/>", '<b/>\r\n\t<d e="f"/>'
    ).replace("<c\n/>", '<c new="5"\n/>')
    with pytest.raises(MirrorPostureError, match="no XML"):
        XmlText("<a><b></a>")


def test_a_fixed_joint_whose_axis_is_zero_stays_as_it_is(tmp_path: Path) -> None:
    """As exporters write it: 0 0 0 is no direction, and was once written back as nan."""
    text = (
        '<robot name="r"><link name="a"/><link name="b"/><link name="c"/>'
        '<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/><origin xyz="0 0 0" rpy="0 0 0"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        '<joint name="f" type="fixed"><parent link="b"/><child link="c"/><axis xyz="0 0 0"/></joint></robot>'
    )
    own, out = tmp_path / "own.urdf", tmp_path / "out.urdf"
    own.write_text(text)
    after = Urdf(text)
    after.add_offset("j", 0.1)
    assert patch_own_urdf(own, Urdf(text), Urdf(after.text()), out) == ["j"]
    assert out.read_text() == text.replace('rpy="0 0 0"', 'rpy="0 0 0.1"')


def test_a_joint_without_an_origin_gets_one() -> None:
    text = '<robot name="r">\n  <link name="a"/><link name="b"/>\n  <joint name="j" type="revolute">\n    <parent link="a"/>\n    <child link="b"/>\n    <limit lower="-1" upper="1" effort="1" velocity="1"/>\n  </joint>\n</robot>\n'
    urdf = Urdf(text)
    urdf.add_offset("j", 0.2)
    assert urdf.text() == text.replace('"revolute">\n', '"revolute">\n    <origin rpy="0.2 0 0"/>\n')
    assert mp.Robot.from_urdf_text(urdf.text()).joints[0].parent_from_joint[1, 2] == pytest.approx(
        -math.sin(0.2)
    )


def test_own_files_get_a_copy_and_a_patch_that_git_applies(tmp_path: Path) -> None:
    session = mp.load_session(write_folder(tmp_path / "session"))
    # The user's file: another order of attributes, other blanks, no mounts of the session.
    own = tmp_path / "own" / "mine.urdf"
    own.parent.mkdir()
    own.write_text(replaced(URDF, "<robot", "<!-- mine -->\n<robot"))
    before = own.read_bytes()
    diagnosis = found(("joint_offset", "joint:elbow", {"offset_rad": 0.05}))
    applied = apply_diagnosis(session, diagnosis, tmp_path / "better")
    [written] = write_own_files(session, diagnosis, applied.folder, urdf=own)
    assert own.read_bytes() == before and written.told == ("joint elbow",)
    assert len(changed_lines(before.decode(), written.file.read_text())) == 1
    subprocess.run(
        ["git", "apply", "-p1", str(written.patch)], cwd=own.parent, check=True, capture_output=True
    )
    assert own.read_bytes() == written.file.read_bytes()
    # The patched file is no longer the session's robot.
    with pytest.raises(MirrorPostureError, match="corrected already"):
        apply_again = apply_diagnosis(session, diagnosis, tmp_path / "twice")
        write_own_files(session, diagnosis, apply_again.folder, urdf=own)


def test_a_urdf_of_another_robot_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    """Before: exit code 0, "nothing of what was found belongs into it", and a copy of the other robot."""
    session = mp.load_session(write_folder(tmp_path / "session"))
    other, partly = tmp_path / "other.urdf", tmp_path / "partly.urdf"
    other.write_text(
        URDF.replace('"shoulder"', '"hip"').replace('"elbow"', '"knee"').replace('"lower"', '"shin"')
    )
    partly.write_text(URDF.replace('"lower"', '"shin"'))
    at_elbow = ("gear_ratio", "joint:elbow", {"scale_error": 0.03})
    exchanged = ("joints_swapped", "joint:shoulder<->joint:elbow", {})
    at_link = ("link_length", "link:lower", {"dx_m": 0.001, "dy_m": 0.0, "dz_m": 0.0})
    for cause, own, lacks in (
        (at_elbow, other, "joint elbow"),
        (exchanged, other, "joint shoulder, joint elbow"),
        (at_link, partly, "link lower"),
        # Nothing of it moves: still no joint of the session's robot is there.
        (("camera_focal", "camera", {"scale_error": 0.01}), other, "joint shoulder, joint elbow"),
    ):
        with pytest.raises(MirrorPostureError) as refused:
            apply_diagnosis(
                session, found(cause), tmp_path / "better",
                also=lambda part, cause=cause, own=own: write_own_files(session, found(cause), part, urdf=own),
            )  # fmt: skip
        told = str(refused.value)
        assert (
            told.startswith(f"{own}: has no {lacks}, of the session's robot; its joints: ")
            and "\n" not in told
        )
        assert ("hip, knee" if own is other else "shoulder, elbow") in told
    assert not (tmp_path / "better").exists()
    # The file of the session's robot stays as it is, where what was found is elsewhere.
    mine = tmp_path / "mine.urdf"
    mine.write_text(URDF)
    for number, cause in enumerate((at_elbow, exchanged)):
        (own_part := tmp_path / f"part{number}").mkdir()
        (own_part / "robot.urdf").write_bytes(session.robot_file.read_bytes())
        [written] = write_own_files(session, found(cause), own_part, urdf=mine)
        assert written.told == () and written.file.read_text() == URDF


def test_a_diagnosis_of_another_session_is_refused(tmp_path: Path) -> None:
    first = mp.load_session(write_folder(tmp_path / "a"))
    other = mp.load_session(
        write_folder(tmp_path / "b", robot=replaced(URDF, "<robot", "<!-- another --><robot"))
    )
    diagnosis = found(document={KEY: fingerprint(first)})
    apply_diagnosis(first, diagnosis, tmp_path / "better")
    with pytest.raises(MirrorPostureError, match=r"another session \(its robot.urdf differ"):
        apply_diagnosis(other, diagnosis, tmp_path / "worse")
    assert not (tmp_path / "worse").exists()


MJCF = """<mujoco model="mine">
  <!-- degrees, as MuJoCo reads a file that says nothing -->
  <compiler autolimits="true"/>
  <default><joint damping="1"/><position kp="40" inheritrange="1"/></default>
  <asset><mesh name="wedge" vertex="0 0 0  .02 0 0  0 .02 0  0 0 .02"/></asset>
  <worldbody>
    <body name="upper">
      <joint name="shoulder" axis="0 1 0"   range="-90 90" ref="10"/> <!-- stays -->
      <geom type="mesh" mesh="wedge" mass="0.1"/><site name="s"/>
      <body name="lower" pos="0.2 0 0">
        <joint name="elbow" axis="0 1 0" range="-120 120"/>
        <geom name="g" type="capsule" fromto="0 0 0 0.2 0 0" size="0.01" mass="0.05"/>
        <site name="tip" pos="0.2 0 0"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="m1" joint="shoulder"/>
    <position name="m2" joint="elbow"/>
  </actuator>
</mujoco>
"""


def settled(mujoco, file: Path, commands: dict[str, float]):
    model = mujoco.MjModel.from_xml_path(str(file))
    model.opt.timestep = 0.001
    data = mujoco.MjData(model)
    for name, value in commands.items():
        data.ctrl[model.actuator(name).id] = value
    for _ in range(6000):
        mujoco.mj_step(model, data)
    return model, data


def test_own_mjcf_keeps_its_geoms_and_moves_as_the_causes_say(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    own, out = tmp_path / "mine.xml", tmp_path / "better.xml"
    own.write_text(MJCF)
    causes = found(
        ("joint_offset", "joint:shoulder", {"offset_rad": 0.05}),
        ("gear_ratio", "joint:elbow", {"scale_error": 0.03}),
    ).causes
    told = patch_own_mjcf(own, causes, out)
    assert len(told) == 2 and not any("not written" in text for text in told.values())
    assert len(changed_lines(MJCF, out.read_text())) == 2
    was, is_now = (mujoco.MjModel.from_xml_path(str(file)) for file in (own, out))
    assert (was.ngeom, was.nsite, was.nmesh, was.nq) == (is_now.ngeom, is_now.nsite, is_now.nmesh, is_now.nq)

    # Kinematics: the better file at q is the old one at q + a.
    def tip(model, shoulder: float, elbow: float) -> np.ndarray:
        data = mujoco.MjData(model)
        data.qpos[:] = shoulder, elbow
        mujoco.mj_forward(model, data)
        return data.site("tip").xpos.copy()

    np.testing.assert_allclose(tip(is_now, 0.2, 0.3), tip(was, 0.25, 0.3), atol=1e-9)
    # The servo stops 3 % beyond its command; gravity is balanced by the same spring in both.
    still = MJCF.replace("<compiler", '<option gravity="0 0 0"/><compiler')
    own.write_text(still)
    patch_own_mjcf(own, causes, out)
    _, data = settled(mujoco, out, {"m2": 0.8})
    assert data.joint("elbow").qpos[0] == pytest.approx(1.03 * 0.8, rel=1e-4)


def test_own_mjcf_gets_play_springs_and_friction(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    own, out = tmp_path / "mine.xml", tmp_path / "better.xml"
    own.write_text(MJCF)
    causes = found(
        ("backlash", "joint:elbow", {"width_rad": 0.06}),
        ("joint_compliance", "joint:shoulder", {"compliance_rad_per_nm": 0.1}),
        ("stiction", "joint:shoulder", {"deadband_rad": 0.01}),
        ("stiction", "joint:wrist", {"deadband_rad": 0.01}),
    ).causes
    told = patch_own_mjcf(own, causes, out)
    assert told["stiction", "joint:wrist"] == "not written: joint wrist is not in this file"
    model, data = settled(mujoco, out, {})
    assert data.joint("elbow_play").qpos[0] == pytest.approx(0.03, abs=3e-3)
    torque = 9.81 * (0.1 * _wedge_arm(model) + 0.05 * 0.3)
    assert data.joint("shoulder_spring").qpos[0] == pytest.approx(0.1 * torque, rel=0.05)
    assert model.joint("shoulder").frictionloss[0] == pytest.approx(40 * 0.01)
    # Keyframes fit their positions: a further joint is refused, the rest is written.
    own.write_text(MJCF.replace("</mujoco>", '<keyframe><key qpos="0 0"/></keyframe></mujoco>'))
    told = patch_own_mjcf(own, causes, out)
    assert "keyframes" in told["backlash", "joint:elbow"]
    mujoco.MjModel.from_xml_path(str(out))


def test_own_mjcf_in_degrees_keeps_the_metres_of_a_joint_that_slides(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    own, out = tmp_path / "mine.xml", tmp_path / "better.xml"
    slide = 'name="elbow" type="slide" axis="0 0 1" range="-.1 .1"'
    own.write_text(MJCF.replace('name="elbow" axis="0 1 0" range="-120 120"', slide))
    causes = found(("joint_offset", "joint:elbow", {"offset_rad": 0.01})).causes
    assert patch_own_mjcf(own, causes, out) == {("joint_offset", "joint:elbow"): "ref of joint elbow"}

    def tip_height(file: Path) -> float:
        model = mujoco.MjModel.from_xml_path(str(file))
        data = mujoco.MjData(model)
        data.qpos[:] = model.joint("shoulder").qpos0[0], 0.02
        mujoco.mj_forward(model, data)
        return float(data.site("tip").xpos[2])

    # At the same position of the joint, the part that slides is a centimetre farther.
    assert tip_height(out) - tip_height(own) == pytest.approx(0.01, abs=1e-9)


def _wedge_arm(model) -> float:
    """Centre of mass of the mesh's body along x, as MuJoCo has it."""
    return float(model.body("upper").ipos[0])


LEROBOT = """{
    "shoulder_pan": {
        "id": 1,
        "drive_mode": 0,
        "homing_offset": -1470,
        "range_min": 758,
        "range_max": 3292
    },
    "gripper": {
        "id": 6,
        "drive_mode": 0,
        "homing_offset": 2040,
        "range_min": 2047,
        "range_max": 3507
    }
}"""


def test_homing_offsets_in_ticks(tmp_path: Path) -> None:
    own, out = tmp_path / "arm.json", tmp_path / "better.json"
    own.write_text(LEROBOT)
    offset = 0.05
    causes = found(("joint_offset", "joint:shoulder_pan", {"offset_rad": offset})).causes
    patch_lerobot(own, causes, out)
    assert len(changed_lines(LEROBOT, out.read_text())) == 1

    def reported_deg(calibration: dict[str, int], actual: int) -> float:
        """LeRobot's own rule (motors_bus, MotorNormMode.DEGREES) for what a Feetech servo reports."""
        present = actual - calibration["homing_offset"]
        middle = (calibration["range_min"] + calibration["range_max"]) / 2
        return (present - middle) * 360 / 4095

    before, after = (json.loads(text)["shoulder_pan"] for text in (LEROBOT, out.read_text()))
    grown = reported_deg(after, 2000) - reported_deg(before, 2000)
    assert grown == pytest.approx(math.degrees(offset), abs=0.05)
    patch_lerobot(own, causes, out, "dynamixel")
    turned = json.loads(out.read_text())["shoulder_pan"]["homing_offset"]
    assert turned - before["homing_offset"] == before["homing_offset"] - after["homing_offset"]
    with pytest.raises(MirrorPostureError, match="±2047"):
        patch_lerobot(own, found(("joint_offset", "joint:gripper", {"offset_rad": -0.1})).causes, out)
    own.write_text(LEROBOT.replace('"drive_mode": 0', '"drive_mode": 1', 1))
    assert "try the sign" in patch_lerobot(own, causes, out)["joint_offset", "joint:shoulder_pan"]
    own.write_text("[1]")
    with pytest.raises(MirrorPostureError, match="LeRobot"):
        patch_lerobot(own, causes, out)


def test_the_command_writes_own_files(tmp_path: Path) -> None:
    write_folder(tmp_path / "session")
    found_file, own = tmp_path / "diagnosis.json", tmp_path / "mine.urdf"
    cause = {
        "effect": "joint_offset",
        "at": "joint:elbow",
        "probability": 0.99,
        "parameters": {"offset_rad": {"value": 0.05, "std": 0.001}},
        "alternatives": [],
    }
    gap = {
        "before_m": 0.01,
        "after_m": 0.001,
        "noise_floor_m": 0.001,
        "closed": 1.0,
        "closed_ci95": [0.9, 1.0],
    }
    document = {
        "format": "mirror-posture/diagnosis",
        "version": VERSION,
        "verdict": "explained",
        "causes": [cause],
    }
    found_file.write_text(json.dumps({**document, "where": [], "gap": gap, "next_postures": []}))
    own.write_text(URDF)
    arguments = [
        "apply",
        tmp_path / "session",
        found_file,
        "--out",
        tmp_path / "out",
        "--urdf",
        own,
        "--json",
    ]
    run = CliRunner().invoke(cli.app, [str(argument) for argument in arguments])
    assert run.exit_code == 0, run.output
    [told] = json.loads(run.stdout)["own_files"]
    assert told["told"] == ["joint elbow"] and (tmp_path / "out" / "mine.urdf.patch").is_file()
    # One refused file of the user's, and nothing is there: neither the folder nor a part of it.
    before = sorted(path.name for path in tmp_path.iterdir())
    (bad := tmp_path / "calibration.json").write_text("[1]")
    arguments[4] = tmp_path / "none"
    run = CliRunner().invoke(cli.app, [*map(str, arguments), "--lerobot", str(bad)])
    assert run.exit_code == 1 and "LeRobot" in run.output
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*before, "calibration.json"])


UR = """# from ur_calibration
kinematics:
  shoulder: {x: 0, y: 0, z: 0.1625, roll: -0, pitch: 0, yaw: 0}
  upper_arm:
    x: 0
    y: 0
    z: 0
    roll: 1.570796327  # a quarter
    pitch: 0
    yaw: 0
  forearm: {x: -0.425, y: 0, z: 0, roll: 0, pitch: 0, yaw: 0}
  wrist_1: {x: -0.3922, y: 0, z: 0.1333, roll: 0, pitch: 0, yaw: 0}
  wrist_2: {x: 0, y: -0.0997, z: 0, roll: 1.570796327, pitch: 0, yaw: 0}
  wrist_3: {x: 0, y: 0.0996, z: 0, roll: 1.570796327, pitch: 3.141592653589793, yaw: 3.141592653589793}
  hash: calib_1
"""


def ur_urdf(text: str) -> str:
    """What ur_description makes of the file: each section is a joint's origin."""
    names = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]
    joints, links = "", '<link name="l0"/>'
    for index, (name, pose) in enumerate(
        zip(names, list(yaml.safe_load(text)["kinematics"].values())[:6], strict=True)
    ):
        links += f'<link name="l{index + 1}"/>'
        joints += (
            f'<joint name="ur_{name}_joint" type="revolute"><parent link="l{index}"/><child link="l{index + 1}"/>'
            f'<origin xyz="{pose["x"]} {pose["y"]} {pose["z"]}" rpy="{pose["roll"]} {pose["pitch"]} {pose["yaw"]}"/>'
            '<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        )
    return f'<robot name="ur">{links}{joints}</robot>'


def test_a_universal_robots_calibration(tmp_path: Path) -> None:
    own, out = tmp_path / "kinematics.yaml", tmp_path / "better.yaml"
    own.write_text(UR)
    before, after = Urdf(ur_urdf(UR)), Urdf(ur_urdf(UR))
    after.add_offset("ur_elbow_joint", 0.02)
    after.add_offset("ur_wrist_3_joint", -0.03)
    told = patch_ur_calibration(own, before, Urdf(after.text()), out)
    assert told == ("forearm: origin of ur_elbow_joint", "wrist_3: origin of ur_wrist_3_joint")
    assert len(changed_lines(UR, out.read_text())) == 2 and "# a quarter" in out.read_text()
    # The robot that is built of the new file at q is the old one at q + a.
    old, new = (mp.Robot.from_urdf_text(ur_urdf(text)) for text in (UR, out.read_text()))
    q = np.array([[0.3, -0.4, 0.5, 0.6, -0.7, 0.8]])
    shifted = q + np.array([0, 0, 0.02, 0, 0, -0.03])
    np.testing.assert_allclose(new.link_poses(q, ["l6"]), old.link_poses(shifted, ["l6"]), atol=1e-8)
    own.write_text(UR.replace("-0.425", "-0.6127"))
    with pytest.raises(MirrorPostureError, match="forearm: is not the origin"):
        patch_ur_calibration(own, before, after, out)
    own.write_text("kinematics: 3")
    with pytest.raises(MirrorPostureError, match="Universal Robots"):
        patch_ur_calibration(own, before, after, out)
