"""Boards in real and in independently rendered pictures: found, labelled, and as accurate as claimed."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from board_drawing import chessboard_picture
from mirror_posture import Board, Camera
from mirror_posture.detect import BoardOptions, detect_boards, measure_grid
from mirror_posture.detect.gate import GateOptions, board_residual

PICTURES = Path(__file__).resolve().parents[3] / "shared" / "data" / "pictures"
GLASS = PICTURES / "mitsuba-glass-a"


def need(folder: Path) -> Path:
    if not folder.is_dir():
        pytest.skip(f"reference pictures are not here: {folder.name}")
    return folder


def gray(path: Path) -> np.ndarray:
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert picture is not None, path
    return picture


def glass_camera() -> Camera:
    return Camera((800, 600), (701.872, 701.872), (405.576, 302.685))


def test_rendered_mirror_boards_are_found_labelled_and_accurate() -> None:
    folder = need(GLASS)
    truth = json.loads((folder / "truth.json").read_text())
    board = Board(7, 4, 0.01)
    errors, normalised = [], []
    for frame in truth["frames"]:
        (view,) = detect_boards(gray(folder / frame["image"]), board, glass_camera())
        assert view.ok, (frame["frame"], view.reason)
        error = view.corners_px - np.array(frame["corners_px"])
        errors.append(error)
        normalised.append(np.einsum("ni,nij,nj->n", error, np.linalg.inv(view.covariances_px2), error))
    assert len(errors) == 20
    rms = np.sqrt(np.mean(np.sum(np.concatenate(errors) ** 2, axis=1)))
    assert rms <= 0.06, rms
    # Claimed covariances are honest: normalised squared errors have mean 2 for two axes. Errors are partly aliasing, not
    # white noise, hence a band wider than that of 560 independent draws.
    assert 1.6 < np.mean(np.concatenate(normalised)) < 2.5


@pytest.mark.parametrize("side", ["left", "right"])
def test_all_thirteen_stereo_boards_are_found(side: str) -> None:
    folder = need(PICTURES / "opencv-samples-calib")
    board = Board(9, 6, 0.025)
    paths = sorted(folder.glob(f"{side}[0-9][0-9].jpg"))
    assert len(paths) == 13
    for path in paths:
        (view,) = detect_boards(gray(path), board, options=BoardOptions(views=("direct",)))
        assert view.ok, (path.name, view.reason)


def test_lcd_board_seen_in_five_mirrors_has_the_published_labels() -> None:
    folder = need(PICTURES / "tnm")
    camera = Camera.from_matrix(np.loadtxt(folder / "camera.txt", delimiter=","), np.zeros(5), (1600, 1200))
    for number in range(1, 6):
        (view,) = detect_boards(gray(folder / f"input{number}.jpg"), Board(10, 7, 0.0275), camera)
        assert view.ok, (number, view.reason)
        # The published frame has z into the board and its origin at another corner: x runs the other way.
        ours = view.corners_px.reshape(7, 10, 2)[:, ::-1].reshape(-1, 2)
        published = np.loadtxt(folder / f"input{number}.txt")
        assert np.mean(np.linalg.norm(ours - published, axis=1)) < 0.6, number


@pytest.mark.parametrize("number", [1, 3, 4, 7, 8, 10, 11])
def test_direct_and_mirrored_views_of_one_board_get_the_same_physical_labels(number: int) -> None:
    folder = need(PICTURES / "lcma-two-mirrors")
    stored = np.load(folder / "corners_raw_px.npz")
    camera = Camera.from_matrix(stored["K"], stored["dist"], (3264, 1470))
    names = [key.split("|")[1] for key in stored.files if key.startswith(f"Image{number}.jpg|")]
    options = BoardOptions(
        views=tuple("direct" if name == "direct" else "mirror" for name in names), strict_count=False
    )
    views = detect_boards(gray(folder / f"Image{number}.jpg"), Board(7, 6, 1.0), camera, options=options)
    assert [view.via for view in views] == ["direct"] + ["mirror"] * (len(names) - 1)
    matched = set()
    for view in views:
        assert view.ok, view.reason
        # The stored labels are OpenCV's, with z into the board: y runs the other way, in every view alike.
        ours = view.corners_px.reshape(6, 7, 2)[::-1].reshape(-1, 2)
        for name in names:
            error = np.sqrt(np.mean(np.sum((ours - stored[f"Image{number}.jpg|{name}"]) ** 2, axis=1)))
            if error < 0.5 and (name == "direct") == (view.via == "direct"):
                matched.add(name)
    assert matched == set(names)


def test_the_wrong_grid_of_a_public_detector_is_refused_by_its_residual_and_the_right_one_found() -> None:
    folder = need(PICTURES / "lcma-two-mirrors")
    stored = np.load(folder / "corners_raw_px.npz")
    camera = Camera.from_matrix(stored["K"], stored["dist"], (3264, 1470))
    board = Board(7, 6, 1.0)
    picture = gray(folder / "Image9.jpg")
    found, corners = cv2.findChessboardCorners(picture, (7, 6))
    assert found, "the public detector claims success on this picture: that is the trap"
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-4)
    refined = cv2.cornerSubPix(picture, corners, (5, 5), (-1, -1), criteria).reshape(-1, 2).astype(float)
    result = board_residual(refined, board, camera)
    assert not result.ok
    assert "px RMS against a flat board is above the limit of 1.00 px" in result.reason
    # Our own search finds the right ones.
    options = BoardOptions(views=("direct", "mirror"), strict_count=False)
    views = detect_boards(picture, board, camera, options=options)
    assert [view.ok for view in views] == [True, True]
    assert max(view.residual_rms_px for view in views) < 0.45


@pytest.mark.parametrize("step", [(0, 1), (0, -1), (1, 0), (-1, 0)])
def test_a_grid_shifted_by_a_row_or_column_is_refused_without_any_calibration(step: tuple[int, int]) -> None:
    folder = need(GLASS)
    truth = json.loads((folder / "truth.json").read_text())
    for frame in truth["frames"][:6]:
        grid = np.array(frame["corners_px"]).reshape(4, 7, 2)
        shifted = grid + step[0] * np.gradient(grid, axis=1) + step[1] * np.gradient(grid, axis=0)
        view = measure_grid(gray(folder / frame["image"]), shifted, Board(7, 4, 0.01))
        assert not view.ok
        assert "shifted by a" in view.reason, view.reason


def test_a_camera_file_of_another_camera_is_noticed() -> None:
    folder = need(GLASS)
    matrix = np.array([[701.872, 0.0, 405.576], [0.0, 380.0, 302.685], [0.0, 0.0, 1.0]])
    camera = Camera.from_matrix(matrix, np.zeros(5), (800, 600))
    (view,) = detect_boards(gray(folder / "images" / "000.png"), Board(7, 4, 0.01), camera)
    assert not view.ok
    assert "reprojection residual" in view.reason and "camera file" in view.reason


def test_large_squares_may_leave_a_residual_of_their_share() -> None:
    board, square_px = Board(7, 4, 0.02), 130.0
    picture_from_board = np.array([[square_px, 0.0, 600.0], [0.0, -square_px, 400.0], [0.0, 0.0, 1.0]])
    flat = chessboard_picture(7, 4, picture_from_board, (1200, 800))
    v, u = np.mgrid[:800, :1200].astype(np.float32)
    # Waves that are shorter than the board: no lens and no homography explains them.
    uneven = cv2.remap(flat, u + 2.5 * np.sin(u / 45), v + 2.5 * np.sin(v / 35), cv2.INTER_LINEAR)
    (view,) = detect_boards(uneven, board, options=BoardOptions(views=("direct",)))
    assert view.ok, view.reason
    assert 1.0 < view.residual_rms_px < view.residual_limit_px == pytest.approx(0.02 * square_px, rel=0.05)
    # Of a board that is partly hidden the squares count that are seen, wherever the others are said to be.
    seen = np.ones(28, dtype=bool)
    seen[:3] = False
    corners = np.where(seen[:, None], view.corners_px, 0.0)
    assert GateOptions().limit_px(corners, board, seen) == pytest.approx(0.02 * square_px, rel=0.05)
    assert board_residual(corners, board, None, visible=seen).limit_px > 2.0
    assert GateOptions().limit_px(corners, board, np.zeros(28, dtype=bool)) == 1.0
