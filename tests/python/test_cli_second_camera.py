"""`calibrate` the paper's way, from pictures: flat boards are drawn by warping a print, which needs no renderer."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from mirror_posture import cli
from session_folder import SESSION, replaced, write_folder

SIZE = (800, 600)
MATRIX = np.array([[693.0, 0.0, 399.5], [0.0, 693.0, 299.5], [0.0, 0.0, 1.0]])
CAMERA = """image_width: 800
image_height: 600
camera_matrix: {data: [693.0, 0, 399.5, 0, 693.0, 299.5, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {data: [0, 0, 0, 0, 0]}
"""
SECOND_MATRIX = np.array([[500.0, 0.0, 399.5], [0.0, 500.0, 299.5], [0.0, 0.0, 1.0]])
CHEST, STAND = (7, 4, 0.014), (9, 6, 0.02)
FINE = 4
"""Pictures are drawn this much larger and then averaged."""


def facing(at_m: list[float], towards_m: np.ndarray, down: float) -> np.ndarray:
    """A frame at a place whose z points to another; its y points down (+1, a camera's) or up (-1, a board's)."""
    z = np.asarray(towards_m, float) - at_m
    z /= np.linalg.norm(z)
    x = np.cross([0.0, down, 0.0], z)
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    matrix[:3, 3] = at_m
    return matrix


def draw(matrix: np.ndarray, boards: list[tuple[tuple[int, int, float], np.ndarray]]) -> np.ndarray:
    """A picture of boards (inner corners and square, camera_from_board): dark square beyond corner 0, white margin of a square."""
    fine = np.diag([FINE, FINE, 1.0]) @ matrix
    fine[:2, 2] += (FINE - 1) / 2
    canvas = np.full((SIZE[1] * FINE, SIZE[0] * FINE), 120, np.uint8)
    cell = 40
    for (nx, ny, square), camera_from_board in boards:
        dark = (np.add.outer(np.arange(ny + 1), np.arange(nx + 1)) % 2) == 0
        squares = np.where(dark, 25, 230).astype(np.uint8)
        printed = np.pad(np.kron(squares, np.ones((cell, cell), np.uint8)), cell, constant_values=230)
        # From the print's pixels to the board's plane: corner 0 lies two cells in, at the pixels' edge.
        scale = square / cell
        board_from_print = np.array(
            [
                [scale, 0.0, (0.5 - 2 * cell) * scale - (nx - 1) / 2 * square],
                [0.0, scale, (0.5 - 2 * cell) * scale - (ny - 1) / 2 * square],
                [0.0, 0.0, 1.0],
            ]
        )
        homography = fine @ camera_from_board[:3, [0, 1, 3]] @ board_from_print
        size = (canvas.shape[1], canvas.shape[0])
        shown = cv2.warpPerspective(printed, homography, size, flags=cv2.INTER_AREA)
        inside = cv2.warpPerspective(np.full_like(printed, 255), homography, size) > 127
        canvas[inside] = shown[inside]
    return cv2.GaussianBlur(cv2.resize(canvas, SIZE, interpolation=cv2.INTER_AREA), (0, 0), 0.6)


@pytest.fixture
def rig(tmp_path: Path) -> tuple[Path, Path, np.ndarray]:
    """A session, its pictures and the true camera_from_chest."""
    text = replaced(SESSION, "corners = [3, 2]", "corners = [7, 4]")
    folder = write_folder(tmp_path / "session", session=text, camera=CAMERA)
    (tmp_path / "second.yaml").write_text(CAMERA.replace("693.0", "500.0"))
    camera_from_chest = facing([0.004, 0.09, -0.01], np.array([0.05, 0.07, 1.0]), -1.0)
    pictures = tmp_path / "pictures"
    for name in ("robot", "second"):
        (pictures / name).mkdir(parents=True)
    for k in range(3):
        # Everything in the robot's camera frame. The standing board faces between the two cameras.
        second_at = [0.45 + 0.03 * k, 0.05 - 0.02 * k, 0.40]
        stand_at = [-0.05 + 0.02 * k, 0.01 * k, 0.40]
        halfway = np.array(stand_at) + np.array([1.1, 0.1 * k, -0.9 + 0.05 * k])
        camera_from_stand = facing(stand_at, halfway, -1.0)
        second_from_camera = np.linalg.inv(facing(second_at, np.array([-0.03, 0.05, 0.18]), 1.0))
        cv2.imwrite(str(pictures / "robot" / f"{k}.png"), draw(MATRIX, [(STAND, camera_from_stand)]))
        boards = [
            (CHEST, second_from_camera @ camera_from_chest),
            (STAND, second_from_camera @ camera_from_stand),
        ]
        cv2.imwrite(str(pictures / "second" / f"{k}.png"), draw(SECOND_MATRIX, boards))
    return folder, pictures, camera_from_chest


def run(rig: tuple[Path, Path, np.ndarray], *more: str, code: int = 0):
    folder, pictures, _ = rig
    words = [
        "calibrate",
        folder,
        "--second-camera",
        folder.parent / "second.yaml",
        "--second-pictures",
        pictures,
        *more,
    ]
    result = CliRunner().invoke(cli.app, [str(word) for word in words])
    assert result.exit_code == code, f"{result.exit_code}: {result.output}\n{result.exception!r}"
    return result


def test_bad_calls_are_named(rig: tuple[Path, Path, np.ndarray]) -> None:
    assert "all of" in run(rig, code=1).stderr
    assert "as in 9x6x20" in run(rig, "--stand", "9x6", code=1).stderr
    assert "cannot be distinguished" in run(rig, "--stand", "4x7x20", code=1).stderr
    (rig[1] / "second" / "1.png").unlink()
    assert "second/1.png" in run(rig, "--stand", "9x6x20", code=1).stderr


def test_the_transform_is_found_from_pictures(rig: tuple[Path, Path, np.ndarray], tmp_path: Path) -> None:
    truth = rig[2]
    document = json.loads(
        run(rig, "--stand", "9x6x20", "--out", str(tmp_path / "mount.json"), "--json").stdout
    )
    found = np.array(document["camera_from_board"])
    assert np.linalg.norm(found[:3, 3] - truth[:3, 3]) < 0.001
    turn = np.arccos(min(1.0, (np.trace(found[:3, :3].T @ truth[:3, :3]) - 1.0) / 2.0))
    assert turn < np.radians(0.3)
    std = np.sqrt(np.diag(document["covariance"]))
    assert (std[3:] < 0.002).all() and (std > 0.0).all()
    assert (
        json.loads((tmp_path / "mount.json").read_text())["camera_from_board"]
        == document["camera_from_board"]
    )
