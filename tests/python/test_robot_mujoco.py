"""The MuJoCo robot: its dynamics against the twin's statics, MJCF and other robots, and its own rendered pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mirror_posture as mp
from mirror_lab.robots import HiddenEffect, TwinOptions, TwinRobot
from mirror_posture.robots import Nominal, TurnsView, detect_look
from mirror_posture.viewpoint import View

mujoco = pytest.importorskip("mujoco")

from mirror_lab.blind.errors import BlindError  # noqa: E402
from mirror_lab.blind.known_robots import unitree_g1  # noqa: E402
from mirror_lab.robots.mujoco import MujocoOptions, MujocoRobot  # noqa: E402
from mirror_lab.robots.mujoco_model import ServoOptions, read_spec  # noqa: E402
from mirror_posture.shapes.mujoco_picture import opengl_is_there  # noqa: E402

POSTURE = {"r_shoulder_pitch": -0.25, "r_shoulder_roll": 1.2, "r_elbow": 0.3, "l_elbow": 0.5}
STIFF = MujocoOptions(servo=ServoOptions(droop_rad=1e-4), noise_px=0.0)


@pytest.fixture(scope="module")
def nominal() -> Nominal:
    return Nominal.load()


def markers(robot: MujocoRobot | TwinRobot) -> np.ndarray:
    return np.array(list(robot.marker_truth_m().values()))


@pytest.mark.parametrize(
    "effect",
    [
        HiddenEffect("joint_offset", "joint:r_elbow", {"offset_rad": 0.03}),
        HiddenEffect("gear_ratio", "joint:r_shoulder_roll", {"scale_error": 0.05}),
        HiddenEffect("gear_eccentricity", "joint:r_elbow", {"sin_rad": 0.06, "cos_rad": 0.03}),
        HiddenEffect("joint_coupling", "joint:r_elbow<-joint:r_shoulder_roll", {"coupling": 0.05}),
        HiddenEffect("backlash", "joint:r_shoulder_roll", {"width_rad": 0.04}),
        HiddenEffect("stiction", "joint:r_elbow", {"deadband_rad": 0.02}),
        HiddenEffect("joint_compliance", "joint:r_shoulder_roll", {"compliance_rad_per_nm": 0.4}),
        HiddenEffect("link_bending", "link:r_upper_arm", {"compliance_rad_per_nm": 0.5}),
        HiddenEffect("axis_tilt", "joint:r_shoulder_roll", {"tilt_1_rad": 0.03, "tilt_2_rad": -0.02}),
        HiddenEffect("link_length", "link:r_upper_arm", {"dx_m": 0.001, "dy_m": 0.0, "dz_m": -0.002}),
        HiddenEffect("marker_mount", "marker:r_hand", {"dx_m": 0.001, "dy_m": 0.002, "dz_m": 0.0}),
    ],
    ids=lambda effect: effect.effect,
)
def test_the_dynamics_rest_where_the_statics_say(nominal: Nominal, effect: HiddenEffect) -> None:
    """Two bodies that share no code: springs, limits and friction in motion; and the twin's laws at rest."""
    moved, still = (
        MujocoRobot([effect], STIFF, nominal),
        TwinRobot([effect], TwinOptions(pictures=False), nominal),
    )
    plain = TwinRobot((), TwinOptions(pictures=False), nominal)
    for robot in (moved, still, plain):
        robot.command(POSTURE)
    size = np.linalg.norm(markers(still) - markers(plain), axis=1).max()
    assert size > 5e-4, "the effect is worth finding"
    # Stiction comes with its servo's droop, which the twin's law leaves out.
    allowed = 0.15 * size if effect.effect == "stiction" else 0.03 * size
    assert np.abs(markers(moved) - markers(still)).max() < allowed


def test_a_mount_of_the_camera_turns_it(nominal: Nominal) -> None:
    turn = {"rx_rad": 0.01, "ry_rad": -0.02, "rz_rad": 0.005, "dx_m": 0.001, "dy_m": 0.0, "dz_m": 0.002}
    effect = HiddenEffect("camera_mount", "camera", turn)
    found = []
    for robot in (
        MujocoRobot([effect], STIFF, nominal),
        TwinRobot([effect], TwinOptions(pictures=False, noise_px=0.0), nominal),
    ):
        points = robot.look().points
        assert points is not None
        found.append(points.board_px)
    assert np.abs(found[0] - found[1]).max() < 0.2


def test_a_play_keeps_the_side_of_its_last_motion(nominal: Nominal) -> None:
    play = HiddenEffect("backlash", "joint:r_elbow", {"width_rad": 0.05, "friction_nm": 0.05})
    robot = MujocoRobot([play], STIFF, nominal)
    robot.command({"r_elbow": 0.8})
    robot.command({"r_elbow": 0.4})
    from_above = markers(robot)
    robot.command({"r_elbow": 0.0})
    robot.command({"r_elbow": 0.4})
    # 85 mm from the elbow to the hand's ball, times the width.
    apart = np.linalg.norm(markers(robot) - from_above, axis=1)
    hand = nominal.robot.points(nominal.robot.positions({}), "r_forearm", "r_hand_marker")[0]
    assert apart[0] == pytest.approx(0.05 * np.hypot(hand[0], hand[2]), rel=0.03)


def test_a_play_and_a_spring_at_one_joint_come_to_rest(nominal: Nominal) -> None:
    hidden = [
        HiddenEffect("joint_compliance", "joint:r_shoulder_roll", {"compliance_rad_per_nm": 0.39}),
        HiddenEffect("backlash", "joint:r_shoulder_roll", {"width_rad": 0.02, "friction_nm": 0.0086}),
    ]
    moved, still = (
        MujocoRobot(hidden, STIFF, nominal),
        TwinRobot(hidden, TwinOptions(pictures=False), nominal),
    )
    for robot in (moved, still):
        robot.command({"r_shoulder_pitch": -0.3, "r_shoulder_roll": 0.8})
    assert np.abs(markers(moved) - markers(still)).max() < 2e-4


def test_encoders_do_not_see_what_lies_behind_them(nominal: Nominal) -> None:
    spring = HiddenEffect("joint_compliance", "joint:r_shoulder_roll", {"compliance_rad_per_nm": 0.5})
    options = MujocoOptions(encoders=True, servo=ServoOptions(droop_rad=1e-4))
    arrival = MujocoRobot([spring], options, nominal).command(POSTURE)
    assert arrival.measured["r_shoulder_roll"] == pytest.approx(1.2, abs=2e-4)
    assert arrival.duration_s > 0.4
    assert MujocoRobot([], STIFF, nominal).command(POSTURE).measured == {}


def test_a_soft_servo_droops_and_says_so(nominal: Nominal) -> None:
    soft = MujocoRobot([], MujocoOptions(encoders=True, servo=ServoOptions(droop_rad=0.02)), nominal)
    measured = soft.command({"r_shoulder_roll": 1.4}).measured["r_shoulder_roll"]
    assert 1.37 < measured < 1.395


def test_an_mjcf_with_a_free_root_and_motors_is_taken_as_well(nominal: Nominal, tmp_path: Path) -> None:
    spec = read_spec(nominal.robot_file)
    spec.body("base_link").add_freejoint()
    motor = spec.add_actuator(name="m", target="r_elbow")
    motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
    motor.set_to_motor()
    spec.compile()
    file = tmp_path / "robot.xml"
    file.write_text(spec.to_xml())
    one, other = MujocoRobot([], STIFF, nominal, model=file), MujocoRobot([], STIFF, nominal)
    for robot in (one, other):
        robot.command(POSTURE)
    assert np.abs(markers(one) - markers(other)).max() < 1e-6


G1_SESSION = """
format = "mirror-posture/session"
version = 1
robot = "robot.urdf"
camera = "camera.yaml"
root = "torso_link"
gravity = [0.0, 0.0, -9.81]
[camera_mount]
link = "camera_optical"
[board]
link = "chest_board"
corners = [8, 5]
square = 0.025
pattern = "chessboard"
[[markers]]
name = "r_hand"
link = "r_hand_marker"
diameter = 0.03
mount = "known"
"""


def test_the_g1_stands_with_its_root_in_the_middle_of_the_tree(tmp_path: Path, nominal: Nominal) -> None:
    try:
        g1 = unitree_g1(np.random.default_rng(1))
    except BlindError as missing:
        pytest.skip(str(missing))
    (tmp_path / "robot.urdf").write_text(g1.urdf)
    (tmp_path / "session.toml").write_text(G1_SESSION)
    (tmp_path / "camera.yaml").write_text((nominal.folder / "camera.yaml").read_text())
    own = Nominal.load(tmp_path)
    robot = MujocoRobot([], MujocoOptions(servo=ServoOptions(droop_rad=1e-4)), own)
    posture = {"right_shoulder_pitch_joint": -0.6, "right_elbow_joint": 0.5, "waist_yaw_joint": 0.3}
    robot.command(posture)
    q = own.robot.positions(posture)
    expected = own.robot.points(q, "torso_link", "r_hand_marker")[0]
    assert np.linalg.norm(robot.marker_truth_m()["r_hand"] - expected) < 1e-3
    assert isinstance(robot, TurnsView)


def test_what_the_model_does_not_have_is_named(nominal: Nominal, tmp_path: Path) -> None:
    with pytest.raises(mp.MirrorPostureError, match="no joint 'tail' to command"):
        MujocoRobot([HiddenEffect("joint_offset", "joint:tail", {"offset_rad": 0.1})], STIFF, nominal)
    with pytest.raises(mp.MirrorPostureError, match="cannot hide 'board_scale'"):
        MujocoRobot([HiddenEffect("board_scale", "board", {"scale_error": 0.1})], STIFF, nominal)
    with pytest.raises(mp.MirrorPostureError, match="width_rad"):
        MujocoRobot([HiddenEffect("backlash", "joint:r_elbow", {})], STIFF, nominal)
    (tmp_path / "a.xml").write_text("<mujoco><worldbody/></mujoco>")
    with pytest.raises(mp.MirrorPostureError, match="has no joint 'head_yaw'"):
        MujocoRobot([], STIFF, nominal, model=tmp_path / "a.xml")
    (tmp_path / "b.xml").write_text("<mujoco><worldbody>")
    with pytest.raises(mp.MirrorPostureError, match="cannot read it"):
        MujocoRobot([], STIFF, nominal, model=tmp_path / "b.xml")


@pytest.mark.skipif(not opengl_is_there(), reason="MuJoCo finds no OpenGL here")
def test_its_own_pictures_agree_with_exact_pixels(nominal: Nominal) -> None:
    """A reflecting plane drawn by OpenGL, through detection, against the light's path worked out."""
    bare = nominal.with_mirror(0.0)
    options = {"view": View(0.2), "servo": ServoOptions(droop_rad=1e-4)}
    hidden = [HiddenEffect("joint_offset", "joint:r_elbow", {"offset_rad": 0.03})]
    with (
        MujocoRobot(hidden, MujocoOptions(way="auto", **options), bare) as drawn,
        MujocoRobot(hidden, MujocoOptions(noise_px=0.0, **options), bare) as exact,
    ):
        looks = []
        for view in (View(0.2), View(-0.05, 0.15)):
            for robot in (drawn, exact):
                robot.command(POSTURE)
                robot.turn(view)
            looks.append(detect_look(bare, drawn.look()))
            found, expected = looks[-1].points, exact.look().points
            assert found is not None and expected is not None
            assert found.board_seen.all()
            assert np.sqrt(np.mean((found.board_px - expected.board_px) ** 2)) < 0.06
            seen = found.marker_seen & expected.marker_seen
            assert seen.sum() >= 3 and np.abs(found.marker_px - expected.marker_px)[seen].max() < 0.15
        measured = mp.measure(bare.session(looks, [0, 0])).markers
        truth = markers(drawn)[measured.marker]
    off = np.linalg.norm(measured.point_in_root_m - truth, axis=1)[measured.measured]
    assert len(off) >= 3 and off.max() < 3e-4
