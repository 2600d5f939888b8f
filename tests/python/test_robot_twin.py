"""The twin: its body against the compiled kinematics, its plays, its two ways of looking, and the shared border checks."""

from __future__ import annotations

import math

import numpy as np
import pytest

import mirror_posture as mp
from mirror_lab.robots import HiddenBody, HiddenEffect, TwinOptions, TwinRobot
from mirror_posture.render import PictureOptions
from mirror_posture.robots import (
    ClosedRobotError,
    CommandedRobot,
    Look,
    Nominal,
    RobotBase,
    RobotError,
    TurnsView,
    UnsafeCommandError,
    detect_look,
)
from mirror_posture.viewpoint import View

POSTURE = {"r_shoulder_pitch": -0.25, "r_shoulder_roll": 1.2, "r_elbow": 0.3, "l_elbow": 0.5, "head_yaw": 0.1}
FAST = TwinOptions(pictures=False, noise_px=0.0)


@pytest.fixture(scope="module")
def nominal() -> Nominal:
    return Nominal.load()


def nominal_markers(nominal: Nominal, positions: dict[str, float]) -> np.ndarray:
    q = nominal.robot.positions(positions)
    return np.array([nominal.robot.points(q, "base_link", m.link)[0] for m in nominal.metadata.markers])


def markers(robot: TwinRobot) -> np.ndarray:
    return np.array(list(robot.marker_truth_m().values()))


def test_without_hidden_effects_the_body_is_the_model(nominal: Nominal) -> None:
    robot = TwinRobot((), FAST, nominal)
    robot.command(POSTURE)
    assert np.allclose(markers(robot), nominal_markers(nominal, POSTURE), atol=1e-12)


@pytest.mark.parametrize(
    ("effect", "actual"),
    [
        (HiddenEffect("joint_offset", "joint:r_elbow", {"offset_rad": 0.03}), {"r_elbow": 0.33}),
        (
            HiddenEffect("gear_ratio", "joint:r_shoulder_roll", {"scale_error": 0.05}),
            {"r_shoulder_roll": 1.26},
        ),
        (
            HiddenEffect("gear_eccentricity", "joint:r_elbow", {"sin_rad": 0.02, "cos_rad": 0.01}),
            {"r_elbow": 0.3 + 0.02 * math.sin(0.3) + 0.01 * math.cos(0.3) - 0.01},
        ),
        (
            HiddenEffect("joint_coupling", "joint:r_elbow<-joint:r_shoulder_roll", {"coupling": 0.1}),
            {"r_elbow": 0.3 + 0.12},
        ),
        (HiddenEffect("drift", "joint:l_elbow", {"rate_rad_per_s": 0.01}), {"l_elbow": 0.51}),
    ],
)
def test_effects_of_a_joint_are_those_of_the_vocabulary(
    nominal: Nominal, effect: HiddenEffect, actual: dict[str, float]
) -> None:
    robot = TwinRobot([effect], FAST, nominal)
    robot.command(POSTURE)
    assert np.allclose(markers(robot), nominal_markers(nominal, POSTURE | actual), atol=1e-12)


def test_compliance_follows_the_gravity_torque_of_the_compiled_kinematics(nominal: Nominal) -> None:
    robot = TwinRobot(
        [HiddenEffect("joint_compliance", "joint:r_shoulder_roll", {"compliance_rad_per_nm": 0.4})],
        FAST,
        nominal,
    )
    robot.command(POSTURE)
    theta = robot.body.theta
    column = nominal.robot.position_index("r_shoulder_roll")
    torque = nominal.robot.gravity_torques(nominal.robot.positions(theta))[0, column]
    assert abs(torque) > 0.01
    assert theta["r_shoulder_roll"] - POSTURE["r_shoulder_roll"] == pytest.approx(0.4 * torque, rel=1e-4)


def test_bending_drops_the_hand_along_gravity(nominal: Nominal) -> None:
    bent = HiddenEffect("link_bending", "link:r_upper_arm", {"compliance_rad_per_nm": 0.5})
    robot = TwinRobot([bent], FAST, nominal)
    robot.command(POSTURE)
    moved = markers(robot) - nominal_markers(nominal, POSTURE)
    assert moved[0, 2] < -2e-4
    assert np.allclose(moved[1], 0.0, atol=1e-12), "the other arm stays"


def test_mounts_and_lengths_move_what_they_carry(nominal: Nominal) -> None:
    shift = {"dx_m": 0.002, "dy_m": 0.0, "dz_m": 0.0}
    mount = TwinRobot([HiddenEffect("marker_mount", "marker:r_hand", shift)], FAST, nominal)
    length = TwinRobot([HiddenEffect("link_length", "link:r_upper_arm", shift)], FAST, nominal)
    for robot in (mount, length):
        robot.command(POSTURE)
    moved = np.linalg.norm(markers(mount) - nominal_markers(nominal, POSTURE), axis=1)
    assert np.allclose(moved, [0.002, 0, 0, 0, 0, 0], atol=1e-12)
    moved = np.linalg.norm(markers(length) - nominal_markers(nominal, POSTURE), axis=1)
    assert np.allclose(moved, [0.002, 0, 0.002, 0, 0, 0], atol=1e-12), (
        "hand and forearm hang on the upper arm"
    )


def test_an_unloaded_play_keeps_the_side_of_the_last_motion(nominal: Nominal) -> None:
    play = {"width_rad": 0.04, "friction_nm": 1e3}
    robot = TwinRobot([HiddenEffect("backlash", "joint:r_elbow", play)], FAST, nominal)
    robot.command({"r_elbow": 0.6})
    assert robot.body.theta["r_elbow"] == pytest.approx(0.58)
    robot.command({"r_elbow": 0.57})
    assert robot.body.theta["r_elbow"] == pytest.approx(0.58), "within the play the output stays"
    robot.command({"r_elbow": 0.3})
    assert robot.body.theta["r_elbow"] == pytest.approx(0.32)


def test_a_loaded_play_lies_on_the_side_of_its_load(nominal: Nominal) -> None:
    for roll in (0.4, 1.2):
        robot = TwinRobot(
            [HiddenEffect("backlash", "joint:r_shoulder_roll", {"width_rad": 0.04})], FAST, nominal
        )
        for start in (0.0, 2.0):
            robot.command({"r_shoulder_roll": start})
            robot.command({"r_shoulder_roll": roll})
            column = nominal.robot.position_index("r_shoulder_roll")
            torque = nominal.robot.gravity_torques(nominal.robot.positions(robot.body.theta))[0, column]
            side = robot.body.theta["r_shoulder_roll"] - roll
            assert abs(torque) > 0.002
            assert side == pytest.approx(math.copysign(0.02, torque)), "whichever way it came"


def test_both_ways_of_looking_agree(nominal: Nominal) -> None:
    """The traced picture through detection against the exact pixels: two light paths that share nothing."""
    hidden = [HiddenEffect("joint_offset", "joint:r_elbow", {"offset_rad": 0.05})]
    view = View(math.radians(12.0))
    traced = TwinRobot(
        hidden, TwinOptions(view=view, camera=PictureOptions(samples=1, edge_samples=3)), nominal
    )
    exact = TwinRobot(hidden, TwinOptions(pictures=False, noise_px=0.0, view=view), nominal)
    found = []
    for robot in (traced, exact):
        robot.command(POSTURE)
        look = detect_look(nominal, robot.look())
        assert look.points is not None
        found.append(look.points)
    assert found[0].board_seen.all() and found[1].board_seen.all()
    assert np.sqrt(np.mean((found[0].board_px - found[1].board_px) ** 2)) < 0.1
    seen = found[0].marker_seen & found[1].marker_seen
    assert seen.sum() >= 3
    assert np.abs(found[0].marker_px - found[1].marker_px)[seen].max() < 0.3
    assert any("r_foot" in reason for reason in found[0].reasons)


def test_looks_are_measured_where_the_balls_are(nominal: Nominal) -> None:
    hidden = [HiddenEffect("gear_ratio", "joint:r_shoulder_roll", {"scale_error": 0.05})]
    with TwinRobot(hidden, TwinOptions(pictures=False, stand_error_rad=0.02, seed=4), nominal) as robot:
        robot.command(POSTURE)
        looks = []
        for view in (View(), View(0.26), View(0.1, 0.15)):
            robot.turn(view)
            looks.append(robot.look())
        found = mp.measure(nominal.session(looks, [0, 0, 0])).markers
        truth = markers(robot)[found.marker]
    off = (found.point_in_root_m - truth)[found.measured]
    assert found.measured.sum() >= 4
    assert (np.linalg.norm(off, axis=1) < 4 * found.std_m[found.measured]).all()
    assert found.distance_m[0] > 3 * np.linalg.norm(off[0]), "the hidden error is seen"


def test_a_mount_of_the_camera_moves_every_pixel(nominal: Nominal) -> None:
    turn = {"rx_rad": 0.0, "ry_rad": 0.01, "rz_rad": 0.0, "dx_m": 0.0, "dy_m": 0.0, "dz_m": 0.0}
    points = []
    for hidden in ((), [HiddenEffect("camera_mount", "camera", turn)]):
        look = TwinRobot(hidden, FAST, nominal).look()
        assert look.points is not None
        points.append(look.points.board_px)
    # 0.01 rad about the downward axis, at f = 693 px: everything moves left by about 7 px.
    assert np.allclose((points[1] - points[0])[:, 0], -6.9, atol=0.6)


def test_what_is_outside_is_masked_with_its_reason(nominal: Nominal) -> None:
    robot = TwinRobot((), FAST, nominal)
    robot.turn(View(math.radians(80.0)))
    points = robot.look().points
    assert points is not None and not points.board_seen.any() and (points.board_px == 0.0).all()
    assert any(reason.startswith("board:") for reason in points.reasons)


@pytest.mark.parametrize("position", [2.2, -0.4, math.nan, math.inf])
def test_commands_beyond_the_limits_move_nothing(nominal: Nominal, position: float) -> None:
    robot = TwinRobot((), FAST, nominal)
    robot.command({"r_elbow": 0.3})
    with pytest.raises(UnsafeCommandError, match=r"r_elbow.*needed a number from -0.35 to 2.1") as caught:
        robot.command({"l_elbow": 0.4, "r_elbow": position})
    assert caught.value.joint == "r_elbow"
    assert robot.commanded["l_elbow"] == 0.0 and robot.body.theta["r_elbow"] == 0.3


def test_unknown_joints_and_effects_are_named(nominal: Nominal) -> None:
    robot = TwinRobot((), FAST, nominal)
    with pytest.raises(UnsafeCommandError, match="has no joint 'elbow' to command; its joints: head_yaw"):
        robot.command({"elbow": 0.1})
    for effect, words in (
        (HiddenEffect("joint_offset", "joint:elbow", {"offset_rad": 0.1}), "has no 'elbow'"),
        (HiddenEffect("joint_offset", "joint:r_elbow", {}), "offset_rad"),
        (HiddenEffect("pairing", "data", {}), "cannot hide 'pairing'"),
    ):
        with pytest.raises(mp.MirrorPostureError, match=words):
            TwinRobot([effect], FAST, nominal)


def test_a_body_moves_only_joints_that_it_has(nominal: Nominal) -> None:
    body = HiddenBody(nominal.robot_file.read_text(), "base_link", np.array([0, 0, -9.81]))
    with pytest.raises(mp.MirrorPostureError, match="no joint 'tail'"):
        body.move({"tail": 0.1})


class Recorder(RobotBase):
    """Says what was called, and fails where it is told to."""

    def __init__(self, nominal: Nominal, fails: str = "") -> None:
        super().__init__(nominal, name="recorder")
        self.calls: list[str] = []
        self.fails = fails

    def _did(self, what: str) -> None:
        self.calls.append(what)
        if what == self.fails:
            raise RobotError(f"{what} failed")

    def _move(self, positions: dict[str, float]) -> dict[str, float]:
        self._did("move")
        return {"r_elbow": positions["r_elbow"] + 0.01}

    def _look(self) -> Look:
        self._did("look")
        return Look(self.commanded, self._now_s())

    def _rest(self) -> None:
        self._did("rest")

    def _close(self) -> None:
        self._did("close")


def test_rest_and_close_come_at_the_end_however_it_comes(nominal: Nominal) -> None:
    robot = Recorder(nominal)
    with pytest.raises(KeyboardInterrupt), robot:
        robot.command({"r_elbow": 0.2})
        raise KeyboardInterrupt
    assert robot.calls == ["move", "rest", "close"]
    with pytest.raises(ClosedRobotError):
        robot.command({})
    robot.close()
    robot.rest()
    assert robot.calls == ["move", "rest", "close"], "safe to call again"


def test_the_first_error_is_the_one_that_is_told(nominal: Nominal) -> None:
    robot = Recorder(nominal, fails="rest")
    with pytest.raises(RuntimeError, match="first"), robot:
        raise RuntimeError("first")
    assert robot.calls == ["rest", "close"]
    with pytest.raises(RobotError, match="rest failed"), Recorder(nominal, fails="rest"):
        pass


def test_the_protocol_is_met(nominal: Nominal) -> None:
    def typed(robot: CommandedRobot) -> str:
        return robot.name

    twin = TwinRobot((), FAST, nominal)
    assert typed(twin) == "twin"
    assert isinstance(twin, TurnsView) and not isinstance(Recorder(nominal), TurnsView)
    arrival = Recorder(nominal).command({"r_elbow": 0.2})
    assert arrival.measured == {"r_elbow": pytest.approx(0.21)} and arrival.commanded["r_elbow"] == 0.2
