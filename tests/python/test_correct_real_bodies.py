"""A correction on robots of another size than the embedded one: Unitree's G1 and an SO-101, from `example-robot-data`."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from mirror_lab.robots import HiddenEffect, TwinOptions, TwinRobot
from mirror_posture import MirrorPostureError
from mirror_posture.correct import CorrectOptions, correct, make_target
from mirror_posture.correct.planner import propose_views, reach_m
from mirror_posture.render import view_planes
from mirror_posture.robots import Nominal
from mirror_posture.robots.servo_config import load_config
from mirror_posture.viewpoint import View

pytest.importorskip("mujoco")

from mirror_lab.robots.mujoco import MujocoOptions, MujocoRobot

FACING = (math.pi / 2, 0.0, math.pi / 2)
"""A board whose face looks forward."""
LOOKING = (-math.pi / 2 - 0.1, 0.0, -math.pi / 2)
"""A camera that looks forward and a little down."""
G1 = (
    "g1_description/urdf/g1_29dof_rev_1_0.urdf",
    "torso_link",
    {
        "camera_optical": ("torso_link", (0.085, 0.0, 0.42), LOOKING),
        "chest_board": ("torso_link", (0.13, 0.0, 0.2), FACING),
        "r_hand_marker": ("right_wrist_yaw_link", (0.11, -0.01, 0.03), (0.0, 0.0, 0.0)),
        "r_forearm_marker": ("right_elbow_link", (0.07, 0.0, 0.035), (0.0, 0.0, 0.0)),
    },
    {"right_shoulder_pitch_joint": -0.5, "right_elbow_joint": 0.35},
    "right_elbow_joint",
)
SO101 = (
    "so_arm_description/urdf/so101.urdf",
    "base_link",
    {
        "camera_optical": ("base_link", (-0.02, 0.18, 0.30), LOOKING),
        "chest_board": ("base_link", (0.0, -0.2, 0.15), FACING),
        "gripper_marker": ("gripper_link", (0.0, 0.0, -0.06), (0.0, 0.0, 0.0)),
        "forearm_marker": ("lower_arm_link", (-0.09, 0.0, 0.06), (0.0, 0.0, 0.0)),
    },
    {"shoulder_pan": 0.17, "shoulder_lift": 0.35, "elbow_flex": -0.5, "wrist_flex": 0.35},
    "elbow_flex",
)
CAMERA = """
image_width: 1280
image_height: 960
camera_name: head
camera_matrix: {rows: 3, cols: 3, data: [1000.0, 0.0, 639.5, 0.0, 1000.0, 479.5, 0.0, 0.0, 1.0]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.0, 0.0, 0.0, 0.0, 0.0]}
"""
BODIES = {"g1": G1, "so101": SO101}


def mounted(name: str, folder: Path, **moved: tuple[tuple[float, ...], tuple[float, ...]]) -> Nominal:
    """The robot's URDF with its mounts, as a session; `moved` puts mounts elsewhere."""
    data = pytest.importorskip("mirror_lab.blind.known_robots")
    file, root, mounts, _, _ = BODIES[name]
    try:
        described = data.description_file(file)
        urdf = described.read_text(encoding="utf-8")
    except MirrorPostureError as missing:
        pytest.skip(str(missing))
    # example-robot-data's meshes are named by package; its folder of robots lies in the package.
    package = described.parents[len(Path(file).parts) - 1].parent
    urdf = urdf.replace("package://example-robot-data/", f"{package}/")
    added, markers = "", ""
    for link, (parent, xyz, rpy) in mounts.items():
        xyz, rpy = moved.get(link, (xyz, rpy))
        added += (
            f'<link name="{link}"/><joint name="{link}_mount" type="fixed"><parent link="{parent}"/><child link="{link}"/>'
            f'<origin xyz="{" ".join(map(str, xyz))}" rpy="{" ".join(map(str, rpy))}"/></joint>'
        )
        if link.endswith("_marker"):
            markers += (
                f'[[markers]]\nname = "{link[:-7]}"\nlink = "{link}"\ndiameter = 0.03\nmount = "known"\n'
            )
    (folder / "robot.urdf").write_text(urdf.replace("</robot>", added + "</robot>"))
    (folder / "camera.yaml").write_text(CAMERA)
    (folder / "session.toml").write_text(
        f'format = "mirror-posture/session"\nversion = 1\nrobot = "robot.urdf"\ncamera = "camera.yaml"\nroot = "{root}"\n'
        f'gravity = [0.0, 0.0, -9.81]\n[camera_mount]\nlink = "camera_optical"\n[board]\nlink = "chest_board"\n'
        f'corners = [8, 5]\nsquare = 0.025\npattern = "chessboard"\n{markers}'
    )
    return Nominal.load(folder)


@pytest.mark.parametrize("simulated", ["twin", "mujoco"])
@pytest.mark.parametrize("name", list(BODIES))
def test_a_robot_of_its_own_size_ends_within_a_millimetre(name: str, simulated: str, tmp_path: Path) -> None:
    nominal = mounted(name, tmp_path)
    _, root, _, posture, wrong = BODIES[name]
    hidden = [HiddenEffect("joint_offset", f"joint:{wrong}", {"offset_rad": 0.04})]
    robot: TwinRobot | MujocoRobot
    if simulated == "twin":
        robot = TwinRobot(hidden, TwinOptions(pictures=False, seed=3), nominal)
    else:
        robot = MujocoRobot(hidden, MujocoOptions(way="pixels", seed=3), nominal)
    target = make_target(nominal, posture, CorrectOptions())
    q = nominal.robot.positions(posture)
    with robot:
        before = dict(robot.commanded)
        outcome = correct(robot, posture)
        truth, after = robot.marker_truth_m(), robot.commanded
        view = robot.view
    assert outcome.converged, outcome.stop.sentence
    for marker, link in zip(target.markers, target.marker_links, strict=True):
        wanted = nominal.robot.points(q, root, link)[0]
        assert np.linalg.norm(truth[marker] - wanted) < 1e-3, marker
        # The glass is farther away than the ball, and than any link.
        board = nominal.robot.points(q, root, "chest_board")[0]
        assert view.normal_in_root @ (wanted - board) + 0.015 < view.distance_m
    assert reach_m(target) < view.distance_m
    # Only what lies between the board and the markers is moved.
    robot_model = nominal.robot
    between = {s.joint for link in target.marker_links for s in robot_model.chain("chest_board", link)}
    moved = {j for j in after if after[j] != before[j] and j not in posture}
    assert moved <= between
    assert outcome.best_command[wrong] == pytest.approx(posture[wrong] - 0.04, abs=0.02)


def test_a_mirror_that_would_touch_the_robot_is_not_proposed(tmp_path: Path) -> None:
    """An arm that is stretched forward: at the usual 0.15 m its hand would be behind the glass."""
    nominal = mounted("g1", tmp_path)
    posture = {"right_shoulder_pitch_joint": -1.0, "right_elbow_joint": 0.6}
    target = make_target(nominal, posture, CorrectOptions())
    assert reach_m(target) > View().distance_m
    views = propose_views(target, 3)
    assert len(views) >= 2
    links = [name for name in nominal.robot.link_names if name != "chest_board"]
    q = nominal.robot.positions(posture)
    board = nominal.robot.points(q, "torso_link", "chest_board")[0]
    for view in views:
        far = max(view.normal_in_root @ (nominal.robot.points(q, "torso_link", n)[0] - board) for n in links)
        assert far < view.distance_m


@pytest.mark.parametrize(
    ("link", "place", "words"),
    [
        ("camera_optical", ((0.085, 0.0, 0.42), (-math.pi / 2, 0.0, math.pi / 2)), "camera looks away"),
        ("chest_board", ((0.13, 0.0, 0.2), (0.0, 0.0, 0.0)), "board does not face the mirror"),
        ("r_hand_marker", ((0.0, -9.0, 9.0), (0.0, 0.0, 0.0)), "out of the picture are: marker r_hand"),
    ],
)
def test_what_cannot_be_seen_is_said_before_anything_moves(
    tmp_path: Path, link: str, place: tuple[tuple[float, ...], tuple[float, ...]], words: str
) -> None:
    nominal = mounted("g1", tmp_path, **{link: place})
    robot = TwinRobot([], TwinOptions(pictures=False), nominal)
    before = dict(robot.commanded)
    with pytest.raises(MirrorPostureError, match=words):
        correct(robot, G1[3])
    assert robot.commanded == before


def test_the_example_of_an_so101_s_servos_is_of_that_arm(tmp_path: Path) -> None:
    nominal = mounted("so101", tmp_path)
    example = Path(__file__).parents[2] / "docs" / "examples" / "servos-so101.toml"
    config = load_config(example, nominal, "feetech")
    assert {servo.joint for servo in config.servos} == set(nominal.joint_limits)
    assert [servo.servo_id for servo in config.servos] == [1, 2, 3, 4, 5, 6]


def test_a_far_mirror_is_drawn_large_enough(tmp_path: Path) -> None:
    """Where the line from the camera to a reflected point crosses the glass, there is glass."""
    nominal = mounted("so101", tmp_path)
    view = View(0.3, 0.1, 0.6)
    robot = TwinRobot([], TwinOptions(pictures=False, view=view), nominal)
    robot.command(SO101[3])
    poses, board = robot.body.link_poses(), robot.body.link_poses()["chest_board"][:3, 3]
    (plane,) = view_planes([view], board)
    width_m, height_m = robot._mirror_size_m(poses, plane)
    normal, centre = np.array(plane.normal_in_root), np.array(plane.center_in_root_m)
    eye = poses["camera_optical"][:3, 3]
    for link in ("chest_board", "gripper_marker", "forearm_marker"):
        point = poses[link][:3, 3]
        image = point + 2.0 * ((centre - point) @ normal) * normal
        way = image - eye
        crossing = eye + way * (((centre - eye) @ normal) / (way @ normal)) - centre
        assert abs(crossing @ normal) < 1e-12
        upright = crossing[2] / math.cos(view.pitch_rad)
        assert abs(upright) < 0.5 * height_m - 0.02
        assert np.linalg.norm(crossing) ** 2 - upright**2 < (0.5 * width_m - 0.02) ** 2
    (near,) = view_planes([View()], board)
    robot.turn(View())
    assert robot._mirror_size_m(poses, near) == (0.0, 0.0), "a near mirror is as large as by default"


def test_a_hand_that_reaches_farther_than_its_link_keeps_off_the_glass(tmp_path: Path) -> None:
    """A box of 20 cm before the hand's origin, in the URDF alone: the mirror is proposed beyond it."""
    bare = mounted("so101", tmp_path)
    text = re.sub(r"<(visual|collision)>.*?</\1>", "", bare.robot_file.read_text(), flags=re.DOTALL)
    bare.robot_file.write_text(text)
    short = reach_m(make_target(bare, SO101[3], CorrectOptions()))
    box = '<visual><origin xyz="0.5 0 0"/><geometry><box size="0.2 0.02 0.02"/></geometry></visual>'
    bare.robot_file.write_text(text.replace('<link name="base_link">', f'<link name="base_link">{box}'))
    target = make_target(Nominal.load(tmp_path), SO101[3], CorrectOptions())
    # The board sits at x = 0, the box ends at 0.6 m; 2 cm are kept from the glass.
    assert reach_m(target) == pytest.approx(0.62, abs=0.004) and short < 0.5
    assert all(view.distance_m > 0.62 * math.cos(view.yaw_rad) for view in propose_views(target, 3))
