"""What was found, written back: the corrected session has no gap left; the MJCF moves as the causes say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mirror_posture as mp
from mirror_posture.diagnosis import Cause, Diagnosis, Estimate, Gap
from mirror_posture.diagnosis.applied import apply_diagnosis
from mirror_posture.diagnosis.applied.urdf import Urdf
from mirror_posture.rotations import nearest_rpy, rotation_of_rpy, rpy_of_rotation
from session_folder import DATA, URDF, replaced, write_folder

SESSIONS = DATA / "sessions"


def found(*causes: tuple[str, str, dict[str, float]]) -> Diagnosis:
    """A diagnosis with these causes."""
    made = tuple(
        Cause(effect, at, 0.99, {name: Estimate(value, 0.0) for name, value in values.items()})
        for effect, at, values in causes
    )
    return Diagnosis("explained", "", made, (), Gap(1.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("name", "effect"),
    [
        ("dev-016", "joint_offset"),
        ("dev-011", "link_length"),
        ("dev-014", "marker_mount"),
        ("dev-019", "axis_tilt"),
        ("dev-017", "camera_mount"),
        ("dev-010", "camera_focal"),
        ("dev-013", "lens_distortion"),
        ("dev-007", "board_scale"),
        ("dev-002", "mirror_glass"),
    ],
)
def test_a_corrected_session_has_no_gap(name: str, effect: str, tmp_path: Path) -> None:
    if not (SESSIONS / name).is_dir():
        pytest.skip(f"{SESSIONS / name} is not there")
    session = mp.load_session(SESSIONS / name)
    first = mp.diagnose(session)
    assert [cause.effect for cause in first.causes] == [effect]
    applied = apply_diagnosis(session, first, tmp_path / "better")
    assert all(entry.file is not None for entry in applied.written)
    again = mp.diagnose(applied.folder)
    assert again.verdict == "none", again.sentence
    assert again.gap.before_m <= first.gap.before_m


def test_angles_of_an_origin_that_is_only_shifted_stay_as_they_were_written() -> None:
    """At a pitch of 90° many angles mean one rotation: none of them is written in place of the file's own."""
    text = '<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 0 1" rpy="0.3 1.5707963267948966 0.2"/></joint></robot>'
    urdf = Urdf(text)
    pose = urdf.origin("j")
    pose[0, 3] = 0.25
    urdf.set_origin("j", pose)
    assert urdf.text() == text.replace('xyz="0 0 1"', 'xyz="0.25 0 1"')


def test_offset_and_tilt_move_the_robot_as_the_vocabulary_says(tmp_path: Path) -> None:
    session = mp.load_session(write_folder(tmp_path / "session"))
    offset, tilt_1, tilt_2 = 0.07, 0.03, -0.02
    applied = apply_diagnosis(
        session,
        found(
            ("joint_offset", "joint:elbow", {"offset_rad": offset}),
            ("axis_tilt", "joint:elbow", {"tilt_1_rad": tilt_1, "tilt_2_rad": tilt_2}),
        ),
        tmp_path / "better",
    )
    better = mp.Robot.from_urdf(applied.folder / "robot.urdf")
    q = better.positions({"shoulder": [0.1], "elbow": [0.4]})
    got = better.points(q, "upper", "hand_marker")[0]
    # By SciPy: a = y, u = y × x = -z, v = a × u = -x; θ = q + offset about the tilted axis, 0.1 m below the shoulder.
    from scipy.spatial.transform import Rotation

    axis = np.array([-np.tan(tilt_2), 1.0, -np.tan(tilt_1)])
    turned = Rotation.from_rotvec((0.4 + offset) * axis / np.linalg.norm(axis))
    below = np.array([0.0, 0.0, -0.1])
    np.testing.assert_allclose(got, below + turned.apply(below), atol=1e-10)


def test_a_twist_turns_the_origin_before_the_tilted_joint_moves(tmp_path: Path) -> None:
    session = mp.load_session(write_folder(tmp_path / "session"))
    offset, tilt_2, twist_1, twist_2 = 0.05, 0.04, 0.03, -0.06
    applied = apply_diagnosis(
        session,
        found(
            ("joint_offset", "joint:elbow", {"offset_rad": offset}),
            ("axis_tilt", "joint:elbow", {"tilt_1_rad": 0.0, "tilt_2_rad": tilt_2}),
            ("link_twist", "link:upper", {"twist_1_rad": twist_1, "twist_2_rad": twist_2}),
            ("link_twist", "link:lower", {"twist_1_rad": 0.1, "twist_2_rad": 0.0}),
        ),
        tmp_path / "better",
    )
    assert [entry.file for entry in applied.written] == ["robot.urdf"] * 3 + [None]
    assert applied.written[-1].what == "link lower carries no single moving joint"
    better = mp.Robot.from_urdf(applied.folder / "robot.urdf")
    q = better.positions({"shoulder": [0.1], "elbow": [0.4]})
    got = better.points(q, "upper", "hand_marker")[0]
    # By SciPy: a = y, u = -z, v = -x.
    from scipy.spatial.transform import Rotation

    twisted = Rotation.from_rotvec([-twist_2, 0.0, -twist_1])
    axis = np.array([-np.tan(tilt_2), 1.0, 0.0])
    turned = Rotation.from_rotvec((0.4 + offset) * axis / np.linalg.norm(axis))
    below = np.array([0.0, 0.0, -0.1])
    np.testing.assert_allclose(got, below + (twisted * turned).apply(below), atol=1e-10)


def test_a_link_moves_what_it_carries_through_turned_mounts_too(tmp_path: Path) -> None:
    text = replaced(
        URDF,
        '<parent link="upper"/><child link="lower"/><origin xyz="0 0 -0.1"/>',
        '<parent link="bracket"/><child link="lower"/>',
    )
    text = replaced(
        text,
        "</robot>",
        '<link name="bracket"/><joint name="plate" type="fixed"><parent link="upper"/><child link="bracket"/>'
        '<origin xyz="0 0 -0.1" rpy="0.3 -0.2 1.1"/></joint></robot>',
    )
    session = mp.load_session(write_folder(tmp_path / "session", robot=text))
    shift = np.array([0.004, -0.002, 0.003])
    values = dict(zip(("dx_m", "dy_m", "dz_m"), shift, strict=True))
    applied = apply_diagnosis(session, found(("link_length", "link:upper", values)), tmp_path / "better")
    better = mp.Robot.from_urdf(applied.folder / "robot.urdf")
    q = session.robot.positions({"elbow": [0.5]})
    moved = better.points(q, "upper", "hand_marker") - session.robot.points(q, "upper", "hand_marker")
    np.testing.assert_allclose(moved[0], shift, atol=1e-10)
    still = better.points(q, "upper", "elbow_marker") - session.robot.points(q, "upper", "elbow_marker")
    np.testing.assert_allclose(still, 0.0, atol=1e-12)


def test_names_comments_and_licence_of_the_robot_stay(tmp_path: Path) -> None:
    text = replaced(URDF, "?>\n", "?>\n<!-- licence -->\n")
    text = replaced(text, '<link name="base"/>', '<!-- the base --><link name="base"/>')
    urdf = Urdf(text)
    urdf.add_offset("elbow", 0.1)
    written = urdf.text()
    assert "<!-- licence -->" in written and "<!-- the base -->" in written
    assert written.count("<joint ") == text.count("<joint ")
    with pytest.raises(mp.MirrorPostureError, match="shoulder, elbow"):
        urdf.add_offset("knee", 0.1)


@pytest.mark.parametrize(
    "rpy", [(0.0, 0.0, 0.0), (0.3, -1.2, 2.9), (0.0, np.pi / 2, 0.4), (1.1, -np.pi / 2, 0.0)]
)
def test_angles_of_a_rotation_give_it_back(rpy: tuple[float, float, float]) -> None:
    rotation = rotation_of_rpy(np.array(rpy))
    np.testing.assert_allclose(rotation_of_rpy(rpy_of_rotation(rotation)), rotation, atol=1e-9)


def test_the_nearest_angles_of_a_rotation_are_its_own_and_no_others_are_nearer() -> None:
    random = np.random.default_rng(8)
    for _ in range(300):
        rpy, near = random.uniform(-3.0, 3.0, 3), random.uniform(-6.0, 6.0, 3)
        rotation = rotation_of_rpy(rpy)
        found = nearest_rpy(rotation, near)
        np.testing.assert_allclose(rotation_of_rpy(found), rotation, atol=1e-9)
        # What the rotation was made of says the same, by whole turns.
        own = rpy + 2.0 * np.pi * np.round((near - rpy) / (2.0 * np.pi))
        assert np.abs(found - near).sum() <= np.abs(own - near).sum() + 1e-6


def test_what_no_file_can_hold_is_said(tmp_path: Path) -> None:
    session = mp.load_session(write_folder(tmp_path / "session"))
    applied = apply_diagnosis(
        session, found(("drift", "joint:elbow", {"rate_rad_per_s": 0.1})), tmp_path / "better"
    )
    assert applied.written[0].file is None and "home" in applied.written[0].what


def test_mujoco_moves_as_the_causes_say(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    mass = '<inertial><origin xyz="0 0 -0.05"/><mass value="0.2"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>'
    text = URDF
    for link in ("upper", "lower"):
        text = replaced(text, f'<link name="{link}"/>', f'<link name="{link}">{mass}</link>')
    session = mp.load_session(write_folder(tmp_path / "session", robot=text))
    width, compliance = 0.04, 0.05
    applied = apply_diagnosis(
        session,
        found(
            ("backlash", "joint:elbow", {"width_rad": width}),
            ("joint_compliance", "joint:shoulder", {"compliance_rad_per_nm": compliance}),
        ),
        tmp_path / "better",
    )
    model = mujoco.MjModel.from_xml_path(str(applied.folder / "robot.mjcf.xml"))
    for elbow in (0.6, -1.4):
        data = mujoco.MjData(model)
        data.ctrl[model.actuator("elbow").id] = elbow
        for _ in range(4000):
            mujoco.mj_step(model, data)

        def at(name: str, data: object = data) -> float:
            return float(data.qpos[model.joint(name).qposadr[0]])  # type: ignore[attr-defined]

        # Gravity's torque by the project's own robot, in the posture in which MuJoCo came to rest.
        total = {"shoulder": at("shoulder") + at("shoulder_spring"), "elbow": at("elbow") + at("elbow_play")}
        q = session.robot.positions({name: [value] for name, value in total.items()})
        torque = dict(zip(session.robot.position_names, session.robot.gravity_torques(q)[0], strict=True))
        assert at("elbow_play") == pytest.approx(np.sign(torque["elbow"]) * width / 2, abs=2e-4)
        assert at("shoulder_spring") == pytest.approx(compliance * torque["shoulder"], rel=0.01)
