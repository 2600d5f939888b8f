"""A user's MJCF: units as MuJoCo reads them, what is at one joint together, what is left out told."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mirror_posture as mp
from mirror_posture import MirrorPostureError
from mirror_posture.diagnosis import Cause, Estimate, Member
from mirror_posture.diagnosis.applied import apply_diagnosis, own_mjcf, write_own_files
from mirror_posture.diagnosis.applied.own_mjcf import patch_own_mjcf
from mirror_posture.diagnosis.applied.urdf import Urdf
from session_folder import write_folder
from test_apply_patch import MJCF, found

mujoco = pytest.importorskip("mujoco")

INCLUDED = '<mujocoinclude><compiler angle="radian"/></mujocoinclude>'
RADIANS = MJCF.replace('"-90 90" ref="10"', '"-1.5 1.5" ref="0.2"').replace('"-120 120"', '"-2 2"')
AT_SHOULDER = found(
    ("joint_offset", "joint:shoulder", {"offset_rad": 0.04}),
    ("backlash", "joint:elbow", {"width_rad": 0.06}),
).causes


def model_of(file: Path):
    return mujoco.MjModel.from_xml_path(str(file))


@pytest.mark.parametrize(
    "text",
    [
        RADIANS.replace("<default>", '<include file="unit.xml"/><default>', 1),
        MJCF.replace("<compiler", '<compiler angle="radian"/><compiler angle="degree"', 1),
        RADIANS.replace("<compiler", '<compiler angle="degree"/><compiler angle="radian"', 1),
        MJCF,
    ],
    ids=["included radian", "last degree", "last radian", "nothing said"],
)
def test_angles_are_in_the_unit_that_mujoco_reads(text: str, tmp_path: Path) -> None:
    """Before: the unit of any `compiler` of this file alone, and a zero that was off by a factor of 57."""
    own, out = tmp_path / "mine.xml", tmp_path / "better.xml"
    (tmp_path / "unit.xml").write_text(INCLUDED)
    own.write_text(text)
    patch_own_mjcf(own, AT_SHOULDER, out)
    was, is_now = model_of(own), model_of(out)
    assert is_now.joint("shoulder").qpos0[0] == pytest.approx(was.joint("shoulder").qpos0[0] - 0.04, abs=1e-9)
    assert is_now.joint("shoulder").range == pytest.approx(was.joint("shoulder").range)
    assert is_now.joint("elbow_play").range == pytest.approx([-0.03, 0.03])


def test_what_mujoco_reads_otherwise_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own, out = tmp_path / "mine.xml", tmp_path / "better.xml"
    own.write_text(MJCF)
    load = own_mjcf._load
    monkeypatch.setattr(own_mjcf, "_load", lambda *told: replace(load(*told), degrees=False))
    with pytest.raises(MirrorPostureError, match=r"mine.xml: MuJoCo would read qpos0 .* of joint shoulder"):
        patch_own_mjcf(own, AT_SHOULDER, out)
    assert not out.exists() and [file.name for file in tmp_path.iterdir()] == ["mine.xml"]


def test_a_cause_and_a_small_error_at_one_joint_are_one_spring(tmp_path: Path) -> None:
    """Before: two joints of one name, which MuJoCo refuses, and nothing at all was written."""
    session = mp.load_session(write_folder(tmp_path / "session"))
    own, part = tmp_path / "mine.xml", tmp_path / "part"
    own.write_text(MJCF)
    part.mkdir()
    (part / "robot.urdf").write_text(Urdf(session.robot_file.read_text()).text())
    springs = [
        Cause("joint_compliance", "joint:elbow", 0.99, {"compliance_rad_per_nm": Estimate(0.03, 0.0)}),
        Cause(
            "geometry", "robot", 0.99, {},
            members=(Member("joint_compliance", "joint:elbow", "compliance_rad_per_nm", 0.01, 0.0),),
        ),
    ]  # fmt: skip
    diagnosis = found()
    object.__setattr__(diagnosis, "causes", tuple(springs))
    [written] = write_own_files(session, diagnosis, part, mjcf=own)
    assert model_of(written.file).joint("elbow_spring").stiffness[0] == pytest.approx(1.0 / 0.04)


def test_stiction_has_its_dead_band_and_its_droop_beside_a_spring(tmp_path: Path) -> None:
    """Before: the droop was dropped without a word."""
    own, out = tmp_path / "mine.xml", tmp_path / "better.xml"
    own.write_text(MJCF)
    stiction = ("stiction", "joint:elbow", {"deadband_rad": 0.01, "droop_rad_per_nm": 0.05})
    spring = ("joint_compliance", "joint:elbow", {"compliance_rad_per_nm": 0.02})
    told = patch_own_mjcf(own, found(stiction, spring).causes, out)
    assert told["stiction", "joint:elbow"] == (
        "frictionloss of joint elbow: 0.4 N m; hinge elbow_droop behind it, of 20 N m/rad"
    )
    model = model_of(out)
    assert model.joint("elbow").frictionloss[0] == pytest.approx(40 * 0.01)
    assert model.joint("elbow_droop").stiffness[0] == pytest.approx(20.0)
    assert model.joint("elbow_spring").stiffness[0] == pytest.approx(50.0)
    # Keyframes refuse the further joint; the friction is written all the same.
    own.write_text(MJCF.replace("</mujoco>", '<keyframe><key qpos="0 0"/></keyframe></mujoco>'))
    told = patch_own_mjcf(own, found(stiction).causes, out)
    assert told["stiction", "joint:elbow"].startswith(
        "frictionloss of joint elbow: 0.4 N m; not written: a spring"
    )


def test_a_compliance_below_0_is_told_and_is_no_spring(tmp_path: Path) -> None:
    """Before: a spring that pushes away."""
    session = mp.load_session(write_folder(tmp_path / "session"))
    spring = found(
        ("joint_compliance", "joint:elbow", {"compliance_rad_per_nm": -0.02}),
        ("stiction", "joint:shoulder", {"deadband_rad": 0.01, "droop_rad_per_nm": -0.01}),
    )
    own, out = tmp_path / "mine.xml", tmp_path / "better.xml"
    own.write_text(MJCF)
    elbow, shoulder = patch_own_mjcf(own, spring.causes, out).values()
    assert elbow == "not written: a compliance that is not above 0 is no spring"
    assert shoulder == f"frictionloss of joint shoulder: 0.4 N m; {elbow}"
    entries = apply_diagnosis(session, spring, tmp_path / "session_better").written
    assert [(entry.file, elbow in entry.what) for entry in entries] == [
        (None, True),
        ("robot.mjcf.xml", True),
    ]


def test_springs_and_play_of_a_joint_that_slides_slide(tmp_path: Path) -> None:
    """Before: not written, "told for hinges"."""
    own, out = tmp_path / "mine.xml", tmp_path / "better.xml"
    slide = 'name="elbow" type="slide" axis="0 0 1" range="-.1 .1"'
    own.write_text(MJCF.replace('name="elbow" axis="0 1 0" range="-120 120"', slide))
    causes = found(
        ("backlash", "joint:elbow", {"width_rad": 0.004}),
        ("joint_compliance", "joint:elbow", {"compliance_rad_per_nm": 0.002}),
    ).causes
    told = patch_own_mjcf(own, causes, out)
    assert list(told.values()) == [
        "slide elbow_play behind it, of 0.00400 m",
        "slide elbow_spring behind it, of 500 N/m",
    ]
    model = model_of(out)
    for name in ("elbow_play", "elbow_spring"):
        assert model.joint(name).type[0] == mujoco.mjtJoint.mjJNT_SLIDE
    assert model.joint("elbow_play").range == pytest.approx([-0.002, 0.002])


def test_each_cause_of_the_robot_that_is_left_out_is_told(tmp_path: Path) -> None:
    """Before: nothing was said of them."""
    own, out = tmp_path / "mine.xml", tmp_path / "better.xml"
    own.write_text(MJCF)
    left_out = (
        ("gear_eccentricity", "joint:elbow", {"sin_rad": 0.01, "cos_rad": 0.0}),
        ("link_length", "link:lower", {"dx_m": 0.01, "dy_m": 0.0, "dz_m": 0.0}),
        ("link_bending", "link:lower", {"compliance_rad_per_nm": 0.01}),
        ("axis_sign", "joint:elbow", {}),
    )
    of_others = (
        ("camera_focal", "camera", {"scale_error": 0.01}),
        ("joint_unit", "joint:elbow", {"factor": 0.5}),
    )
    told = patch_own_mjcf(own, found(*left_out, *of_others).causes, out)
    assert set(told) == {(effect, at) for effect, at, _ in left_out}
    assert all(line.startswith("not written: ") for line in told.values()) and out.read_text() == MJCF


def test_a_folder_that_cannot_be_written_is_told_with_the_users_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before: the bare error of the system, of a temporary file. Root may write everywhere, so the system is stood in for."""
    own = tmp_path / "mine.xml"
    own.write_text(MJCF)

    def read_only(**_: object) -> None:
        raise PermissionError(13, os.strerror(13), str(tmp_path / ".mine-x.xml"))

    monkeypatch.setattr(own_mjcf.tempfile, "mkstemp", read_only)
    with pytest.raises(MirrorPostureError, match=r"mine.xml: its folder cannot be written \(.*give a copy"):
        patch_own_mjcf(own, AT_SHOULDER, tmp_path / "better.xml")


FRAMED = """<mujoco>
  <compiler angle="radian"/>
  <default><default class="turned"><joint axis="0 0 2" pos="0.1 0 0"/></default></default>
  <worldbody>
    <body name="b">
      <frame euler="0 0 1.5707963267948966" pos="1 0 0"><frame euler="0 0.3 0">
        <joint name="own" axis="1 0 0"/>
        <joint name="of_default" class="turned"/>
      </frame></frame>
      <geom size="0.1" pos="0.3 0 0"/>
    </body>
  </worldbody>
  <actuator><position joint="own" kp="100"/><position joint="of_default" kp="100"/></actuator>
</mujoco>
"""


@pytest.mark.parametrize("joint", ["own", "of_default"])
def test_play_and_springs_in_a_frame_turn_about_the_joints_axis(joint: str, tmp_path: Path) -> None:
    """Before: the frame turned axis and place twice."""
    own, out = tmp_path / "mine.xml", tmp_path / "better.xml"
    own.write_text(FRAMED)
    causes = found(
        ("backlash", f"joint:{joint}", {"width_rad": 0.01}),
        ("joint_compliance", f"joint:{joint}", {"compliance_rad_per_nm": 0.02}),
    ).causes
    assert not any("not written" in line for line in patch_own_mjcf(own, causes, out).values())
    model = model_of(out)
    for further in (f"{joint}_play", f"{joint}_spring"):
        np.testing.assert_allclose(model.joint(further).axis, model.joint(joint).axis, atol=1e-9)
        np.testing.assert_allclose(model.joint(further).pos, model.joint(joint).pos, atol=1e-9)


def with_actuators(text: str, file: Path) -> Path:
    """The small robot with these actuators in place of its own."""
    start, end = MJCF.index("<actuator>"), MJCF.index("</actuator>")
    file.write_text(MJCF[:start] + "<actuator>" + text + MJCF[end:])
    return file


GEAR = ("gear_ratio", "joint:elbow", {"scale_error": 0.02})
STICTION = ("stiction", "joint:elbow", {"deadband_rad": 0.01})


@pytest.mark.parametrize("kind", ["motor", "velocity"])
def test_the_gear_of_a_motor_is_left_alone(kind: str, tmp_path: Path) -> None:
    """Before: its torque was scaled, and written was told."""
    own = with_actuators(f'<{kind} name="m" joint="elbow" gear="50"/>', tmp_path / "mine.xml")
    told = patch_own_mjcf(own, found(GEAR, STICTION).causes, tmp_path / "better.xml")
    assert (
        all(line.startswith("not written: joint elbow has no position servo") for line in told.values())
        and len(told) == 2
    )
    assert (tmp_path / "better.xml").read_text() == own.read_text()


def test_the_position_servo_is_found_among_other_actuators(tmp_path: Path) -> None:
    """Before: the first actuator counted for stiction, and a gear needed a single one."""
    actuators = (
        '<velocity name="v" joint="elbow" kv="3"/><motor name="other" joint="shoulder" gear="7"/>'
        '<position name="p" joint="elbow" kp="40" gear="2"/><motor name="t" joint="elbow" gear="50"/>'
    )
    own, out = with_actuators(actuators, tmp_path / "mine.xml"), tmp_path / "better.xml"
    told = patch_own_mjcf(own, found(GEAR, STICTION).causes, out)
    assert told["stiction", "joint:elbow"] == "frictionloss of joint elbow: 1.6 N m"
    assert told["gear_ratio", "joint:elbow"] == "gear of the actuator of joint elbow: 1.960784"
    model = model_of(out)
    gears = {name: model.actuator(name).gear[0] for name in ("v", "other", "p", "t")}
    assert gears == pytest.approx({"v": 1.0, "other": 7.0, "p": 2.0 / 1.02, "t": 50.0})


def test_several_position_servos_of_a_joint_are_told(tmp_path: Path) -> None:
    servo = '<position name="{}" joint="elbow" kp="40"/>'
    own = with_actuators(servo.format("a") + servo.format("b"), tmp_path / "mine.xml")
    [line] = patch_own_mjcf(own, found(GEAR).causes, tmp_path / "better.xml").values()
    assert line.startswith("not written: joint elbow has 2 position servos, needed one")
