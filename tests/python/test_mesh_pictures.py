"""Any robot drawn by MuJoCo: balls where OpenCV projects their reflections, a mirror that ends, a plan's pictures as a session."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from mirror_posture import load_session
from small_arm import run, setup

pytest.importorskip("mujoco")

from mirror_posture.shapes.mujoco_picture import opengl_is_there

pytestmark = pytest.mark.skipif(
    not opengl_is_there(), reason="no OpenGL here: set MUJOCO_GL to egl or osmesa"
)


def test_a_preview_and_a_session_with_meshes(tmp_path: Path) -> None:
    session = setup(tmp_path, half=True)
    words = [
        "--template",
        session,
        "--meshes",
        "--joint",
        "lift=70",
        "--joint",
        "elbow=-80",
        "--distance",
        "500",
    ]
    run("render", tmp_path / "look.png", *words, "--preview")
    picture = cv2.imread(str(tmp_path / "look.png"))
    assert picture.shape == (360, 480, 3)
    picture_hsv = cv2.cvtColor(picture, cv2.COLOR_BGR2HSV)
    hue, saturation, value = cv2.split(picture_hsv)
    # By hand: lift and elbow turn the arm in its plane y = 0; the mirror stands 0.5 m before the board, x = 0.52.
    a = np.radians([70, 70 - 80])
    elbow = np.array([0.15 * np.cos(a[0]), 0.11 + 0.15 * np.sin(a[0])])
    hand = (
        elbow + 0.13 * np.array([np.cos(a[1]), np.sin(a[1])]) + 0.02 * np.array([-np.sin(a[1]), np.cos(a[1])])
    )
    mirrored = np.array([2 * 0.52 - hand[0], 0.0, hand[1]]) - [-0.05, 0.12, 0.25]
    forward = np.array([1.0, 0.0, -0.2]) / np.hypot(1.0, 0.2)
    right, down = np.array([0.0, -1.0, 0.0]), np.cross(forward, [0.0, -1.0, 0.0])
    at = 380 * np.array([mirrored @ right, mirrored @ down]) / (mirrored @ forward) + [239.5, 179.5]
    red = ((hue < 8) | (hue > 172)) & (saturation > 150) & (value > 60)
    # The real ball is in the picture as well, larger.
    _, _, _, centers = cv2.connectedComponentsWithStats(red.astype(np.uint8))
    assert np.linalg.norm(centers[1:] - at, axis=1).min() < 1.0
    # A small mirror ends: the ball is not in it any more.
    run("render", tmp_path / "small.png", *words, "--preview", "--mirror-size", "4x4")
    small = cv2.cvtColor(cv2.imread(str(tmp_path / "small.png")), cv2.COLOR_BGR2HSV)
    assert small[round(at[1]), round(at[0]), 1] < 100 < picture_hsv[round(at[1]), round(at[0]), 1]
    run("render", tmp_path / "drawn", *words, "--offset", "pan=2", "--mirror-size", "60x60")
    loaded = load_session(tmp_path / "drawn")
    assert len(loaded.frames) == 1 and loaded.mirror is not None and loaded.mirror.glass_thickness_m == 0.0
    assert "needed a file that ends with .png" in " ".join(
        run("render", tmp_path / "x", *words, "--preview", code=1).stderr.split()
    )
    assert "--meshes" in run("render", tmp_path / "x", "--joint", "lift=3", code=1).stderr


def test_a_twin_looks_with_its_meshes(tmp_path: Path) -> None:
    """What is detected in the picture of a twin with meshes is where its exact pixels are, a hidden error included."""
    from mirror_lab.robots import HiddenEffect, TwinOptions, TwinRobot
    from mirror_posture.robots import Nominal, detect_look
    from mirror_posture.viewpoint import View

    nominal = Nominal.load(setup(tmp_path, half=True))
    hidden = [HiddenEffect("joint_offset", "joint:lift", {"offset_rad": 0.1})]
    view, posture = View(0.0, 0.1, 0.5), {"pan": -0.3, "lift": 1.2, "elbow": -1.4}
    seen = []
    for options in (
        TwinOptions(meshes=True, view=view),
        TwinOptions(pictures=False, noise_px=0.0, view=view),
    ):
        with TwinRobot(hidden, options, nominal) as robot:
            robot.command(posture)
            seen.append(detect_look(nominal, robot.look()).points)
    drawn, exact = seen
    assert drawn is not None and exact is not None and drawn.board_seen.all() and drawn.marker_seen.any()
    assert np.abs(drawn.board_px - exact.board_px).max() < 0.5
    assert np.abs(drawn.marker_px - exact.marker_px)[drawn.marker_seen].max() < 0.7
