"""Camera, board and markers on their mounts: what was found to move is moved, in its own frame, and nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mirror_posture as mp
from mirror_posture.diagnosis.applied import apply_diagnosis
from mirror_posture.rotations import pose_of
from session_folder import URDF, replaced, write_folder
from test_apply_patch import found

MOTION = {"rx_rad": 0.02, "ry_rad": -0.01, "rz_rad": 0.03, "dx_m": 0.003, "dy_m": 0.001, "dz_m": -0.002}
REAL = pose_of(np.array([0.02, -0.01, 0.03]), np.array([0.003, 0.001, -0.002]))
EYE = '<parent link="base"/><child link="camera_optical"/>'
CHEST = '<parent link="base"/><child link="chest_board"/>'
BRACKET = (
    '<link name="bracket"/><joint name="arm_of_bracket" type="fixed"><parent link="{0}"/><child link="bracket"/>'
    '<origin xyz="0 0 0.05" rpy="0 0.3 0"/></joint></robot>'
)


def nested(camera_on: str, board_on: str, bracket_on: str | None = None) -> str:
    """The small robot with camera and board on these links, turned."""
    text = replaced(URDF, EYE, EYE.replace("base", camera_on) + '<origin xyz="0.1 0.02 0" rpy="0.4 0 0.2"/>')
    text = replaced(
        text, CHEST, CHEST.replace("base", board_on) + '<origin xyz="0 0.1 0.03" rpy="0 0.5 -0.3"/>'
    )
    return text if bracket_on is None else replaced(text, "</robot>", BRACKET.format(bracket_on))


def applied_to(text: str, folder: Path, *causes: tuple[str, str, dict[str, float]]):
    """The session before and after, and what was told of each cause."""
    session = mp.load_session(write_folder(folder / "session", robot=text))
    applied = apply_diagnosis(session, found(*causes), folder / "better")
    told = [(entry.file, entry.what) for entry in applied.written]
    return session, mp.load_session(applied.folder), told


def poses(session: mp.Session, *links: str) -> np.ndarray:
    return session.robot.link_poses(session.positions[-1:], list(links))[0]


NESTED = {
    "side by side": ("base", "base", None),
    "camera on board": ("chest_board", "base", None),
    "board on camera": ("base", "camera_optical", None),
    "camera on a bracket of the board": ("bracket", "base", "chest_board"),
    "board on a bracket of the camera": ("base", "bracket", "camera_optical"),
}


@pytest.mark.parametrize("links", NESTED.values(), ids=list(NESTED))
def test_the_boards_mount_moves_board_and_camera(links: tuple[str, str, str | None], tmp_path: Path) -> None:
    """Before: a board on the camera moved twice."""
    was, now, told = applied_to(nested(*links), tmp_path, ("board_mount", "board", MOTION))
    camera, board, hand = poses(was, "camera_optical", "chest_board", "hand_marker")
    real_board = board @ REAL
    wanted = [real_board @ np.linalg.inv(board) @ camera, real_board, hand]
    np.testing.assert_allclose(poses(now, "camera_optical", "chest_board", "hand_marker"), wanted, atol=1e-10)
    assert [file for file, _ in told] == ["robot.urdf"]


@pytest.mark.parametrize("links", NESTED.values(), ids=list(NESTED))
def test_the_cameras_mount_moves_the_camera_alone(links: tuple[str, str, str | None], tmp_path: Path) -> None:
    """Before: a board on the camera moved along, so that the camera against the board stayed as it was."""
    was, now, told = applied_to(nested(*links), tmp_path, ("camera_mount", "camera", MOTION))
    camera, board, hand = poses(was, "camera_optical", "chest_board", "hand_marker")
    np.testing.assert_allclose(
        poses(now, "camera_optical", "chest_board", "hand_marker"), [camera @ REAL, board, hand], atol=1e-10
    )
    rides = "camera" in links[1] or links[2] == "camera_optical"
    assert told == [("robot.urdf", f"origin of joint eye{', chest' if rides else ''}")]


def test_both_mounts_of_a_nested_camera(tmp_path: Path) -> None:
    """The camera's motion is told after the board's."""
    causes = (("camera_mount", "camera", {**MOTION, "dx_m": 0.007}), ("board_mount", "board", MOTION))
    was, now, _ = applied_to(nested("base", "camera_optical"), tmp_path, *causes)
    camera, board = poses(was, "camera_optical", "chest_board")
    real_board = board @ REAL
    own = REAL.copy()
    own[0, 3] = 0.007
    wanted = [real_board @ np.linalg.inv(board) @ camera @ own, real_board]
    np.testing.assert_allclose(poses(now, "camera_optical", "chest_board"), wanted, atol=1e-10)


def test_a_board_that_carries_the_arm_and_a_marker_moves_without_them(tmp_path: Path) -> None:
    """Before: the arm moved with its board."""
    text = replaced(
        nested("base", "base"), '<parent link="base"/><child link="upper"/>', '<parent link="chest_board"/><child link="upper"/>'
    )  # fmt: skip
    text = replaced(text, '<parent link="upper"/><child link="elbow_marker"/>', '<parent link="chest_board"/><child link="elbow_marker"/>')  # fmt: skip
    was, now, told = applied_to(text, tmp_path, ("board_mount", "board", MOTION))
    links = ("chest_board", "upper", "hand_marker", "elbow_marker")
    board, *others = poses(was, *links)
    np.testing.assert_allclose(poses(now, *links), [board @ REAL, *others], atol=1e-10)
    ((file, what),) = told
    assert file == "robot.urdf"
    assert set(what.removeprefix("origin of joint ").split(", ")) == {"chest", "eye", "shoulder", "elbow_mount"}  # fmt: skip


TOOL = (
    '<link name="tool"/><joint name="flange" type="fixed"><parent link="lower"/><child link="tool"/>'
    '<origin xyz="0 0 -0.1" rpy="0 0 1.5707963267948966"/></joint></robot>'
)
ON_TOOL = '<parent link="tool"/><child link="hand_marker"/><origin xyz="0 0 0.02" rpy="0.3 0 0"/>'
SHIFT = {"dx_m": 0.006, "dy_m": 0.0, "dz_m": 0.001}


def test_a_marker_behind_a_turned_flange_moves_in_the_flanges_frame(tmp_path: Path) -> None:
    """Before: the shift was told in the frame of the moving link, and a corrected session was worse than the first one."""
    text = replaced(
        URDF, '<parent link="lower"/><child link="hand_marker"/><origin xyz="0 0 -0.1"/>', ON_TOOL
    )
    text = replaced(text, "</robot>", TOOL)
    was, now, told = applied_to(text, tmp_path, ("marker_mount", "marker:hand", SHIFT))
    assert told == [("robot.urdf", "origin of joint hand_mount")]
    for session, shift in ((was, np.zeros(3)), (now, np.array([0.006, 0.0, 0.001]))):
        tool, hand = poses(session, "tool", "hand_marker")
        np.testing.assert_allclose(
            (np.linalg.inv(tool) @ hand)[:3, 3], shift + np.array([0.0, 0.0, 0.02]), atol=1e-10
        )
    joint = now.robot_file.read_text().split('name="hand_mount"')[1]
    assert 'xyz="0.006 0 0.021" rpy="0.3 0 0"' in joint


def test_a_marker_moves_without_what_it_carries(tmp_path: Path) -> None:
    text = replaced(URDF, '<parent link="base"/><child link="upper"/>', '<parent link="elbow_marker"/><child link="upper"/>')  # fmt: skip
    text = replaced(text, '<parent link="upper"/><child link="elbow_marker"/>', '<parent link="base"/><child link="elbow_marker"/>')  # fmt: skip
    was, now, told = applied_to(text, tmp_path, ("marker_mount", "marker:elbow_ball", SHIFT))
    assert told == [("robot.urdf", "origin of joint elbow_mount, shoulder")]
    marker, hand = poses(was, "elbow_marker", "hand_marker")
    marker[:3, 3] += [0.006, 0.0, 0.001]
    np.testing.assert_allclose(poses(now, "elbow_marker", "hand_marker"), [marker, hand], atol=1e-10)


def test_what_has_no_fixed_mount_is_told(tmp_path: Path) -> None:
    text = replaced(URDF, '<joint name="hand_mount" type="fixed">', '<joint name="hand_mount" type="continuous">')  # fmt: skip
    text = replaced(text, '<joint name="eye" type="fixed">', '<joint name="eye" type="continuous">')
    causes = (("marker_mount", "marker:hand", SHIFT), ("camera_mount", "camera", MOTION))
    _, _, told = applied_to(text, tmp_path, *causes)
    assert told == [
        (None, "link hand_marker has no fixed mount"),
        (None, "link camera_optical has no fixed mount"),
    ]
