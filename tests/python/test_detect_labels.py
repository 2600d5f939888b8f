"""Which corner is which: every turn and both handednesses, and boards that cannot be settled say so."""

from __future__ import annotations

import numpy as np
import pytest

from board_drawing import chessboard_picture, corners_px, view
from mirror_posture import Board, Camera
from mirror_posture.detect import BoardOptions, BoardPrediction, detect_boards

# No turn is along the pixels' rows: point sampling would put those edges off by up to half a sample.
TURNS = [0.07, 1.7, 3.0, -0.9]


def detected(picture: np.ndarray, nx: int, ny: int, via: str, prediction: BoardPrediction | None = None):
    (found,) = detect_boards(
        picture, Board(nx, ny, 0.02), prediction=prediction, options=BoardOptions(views=(via,))
    )
    return found


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("mirrored", [True, False])
@pytest.mark.parametrize("counts", [(7, 4), (6, 5)])
def test_odd_by_even_boards_get_their_true_labels_at_any_turn(
    turn: float, mirrored: bool, counts: tuple[int, int]
) -> None:
    homography = view(turn, mirrored)
    found = detected(chessboard_picture(*counts, homography), *counts, "mirror" if mirrored else "direct")
    assert found.ok, found.reason
    error = found.corners_px - corners_px(*counts, homography)
    assert np.sqrt(np.mean(np.sum(error**2, axis=1))) < 0.08


def test_corner_errors_agree_with_their_covariances() -> None:
    normalised = []
    for seed in range(12):
        homography = view(0.3 + 0.1 * seed, True, center=(240.0 + 0.37 * seed, 180.0 - 0.23 * seed))
        picture = chessboard_picture(7, 4, homography, noise_levels=6.0, seed=seed)
        found = detected(picture, 7, 4, "mirror")
        assert found.ok, found.reason
        error = found.corners_px - corners_px(7, 4, homography)
        normalised.append(np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.covariances_px2), error))
    assert 1.4 < np.mean(np.concatenate(normalised)) < 2.8


@pytest.mark.parametrize("counts", [(8, 6), (7, 5)])
def test_boards_that_look_the_same_turned_are_masked_and_say_why(counts: tuple[int, int]) -> None:
    found = detected(chessboard_picture(*counts, view(0.4, True)), *counts, "mirror")
    assert not found.ok
    assert "looks the same turned by 180°" in found.reason


@pytest.mark.parametrize("counts", [(8, 6), (7, 5)])
@pytest.mark.parametrize("turn", TURNS)
def test_predicted_corners_settle_them(counts: tuple[int, int], turn: float) -> None:
    homography = view(turn, True)
    truth = corners_px(*counts, homography)
    found = detected(
        chessboard_picture(*counts, homography),
        *counts,
        "mirror",
        BoardPrediction(corners_px=truth + np.array([9.0, -7.0])),
    )
    assert found.ok, found.reason
    assert np.abs(found.corners_px - truth).max() < 0.5


def test_a_prediction_between_two_labellings_does_not_settle_them() -> None:
    homography = view(0.0, True)
    middle = np.tile(corners_px(8, 6, homography).mean(axis=0), (48, 1))
    found = detected(chessboard_picture(8, 6, homography), 8, 6, "mirror", BoardPrediction(corners_px=middle))
    assert not found.ok
    assert "predict closer" in found.reason


@pytest.mark.parametrize("upside_down", [False, True])
def test_the_camera_board_transform_settles_a_mirrored_board(upside_down: bool) -> None:
    camera = Camera((480, 360), (500.0, 500.0), (239.5, 179.5))
    spin = np.diag([-1.0, -1.0, 1.0]) if upside_down else np.eye(3)
    # The board looks where the camera looks (z forward), below it, with x to the robot's left or right.
    camera_from_board = np.eye(4)
    camera_from_board[:3, :3] = np.diag([-1.0, -1.0, 1.0]) @ spin
    camera_from_board[:3, 3] = (0.01, 0.05, 0.02)
    normal = np.array([0.08, 0.12, 0.99])
    normal /= np.linalg.norm(normal)
    reflection = np.eye(3) - 2.0 * np.outer(normal, normal)
    reflected = reflection @ camera_from_board[:3, :3]
    centre = reflection @ camera_from_board[:3, 3] + 2.0 * 0.24 * normal
    homography = camera.matrix_px @ np.column_stack(
        [0.014 * reflected[:, 0], 0.014 * reflected[:, 1], centre]
    )
    picture = chessboard_picture(7, 5, homography)
    options = BoardOptions(views=("mirror",))
    prediction = BoardPrediction(camera_from_board=camera_from_board)
    (found,) = detect_boards(picture, Board(7, 5, 0.014), camera, prediction, options)
    assert found.ok, found.reason
    assert np.abs(found.corners_px - corners_px(7, 5, homography)).max() < 0.5


def test_two_odd_counts_tell_a_mirrored_view_from_a_direct_one() -> None:
    found = detected(chessboard_picture(7, 5, view(0.2, False)), 7, 5, "mirror")
    assert not found.ok
    assert "this view is 'direct', not 'mirror'" in found.reason


def test_a_board_with_a_light_first_square_is_refused() -> None:
    found = detected(chessboard_picture(8, 6, view(0.2, True), first_dark=False), 8, 6, "mirror")
    assert not found.ok
    assert "is light at every possible corner 0" in found.reason


def test_a_square_board_is_not_settled_by_turning_it() -> None:
    found = detected(chessboard_picture(5, 5, view(0.2, True)), 5, 5, "mirror")
    assert not found.ok
    assert "ambiguous" in found.reason
    homography = view(1.4, True)
    truth = corners_px(5, 5, homography)
    picture = chessboard_picture(5, 5, homography)
    found = detected(picture, 5, 5, "mirror", BoardPrediction(corners_px=truth + 5.0))
    assert found.ok, found.reason
    assert np.abs(found.corners_px - truth).max() < 0.5


def test_swapped_or_wrong_counts_are_refused() -> None:
    picture = chessboard_picture(7, 5, view(0.2, True))
    assert not detected(picture, 6, 5, "mirror").ok
    assert not detected(picture, 7, 4, "mirror").ok
    assert not detected(picture, 8, 5, "mirror").ok


def test_two_boards_where_one_was_expected_are_masked_unless_the_place_is_predicted() -> None:
    left, right = view(0.2, True, 17.0, (130.0, 180.0)), view(-0.3, True, 17.0, (360.0, 180.0))
    picture = np.where(
        np.arange(480) < 245, chessboard_picture(7, 4, left, seed=1), chessboard_picture(7, 4, right, seed=2)
    )
    views = detect_boards(picture, Board(7, 4, 0.02))
    assert len(views) == 2
    assert not any(found.ok for found in views)
    assert "2 boards found where 1 were expected" in views[0].reason
    truth = corners_px(7, 4, right)
    (found,) = detect_boards(picture, Board(7, 4, 0.02), prediction=BoardPrediction(corners_px=truth + 12.0))
    assert found.ok, found.reason
    assert np.abs(found.corners_px - truth).max() < 0.5


@pytest.mark.parametrize("shift", [(-150.0, 0.0), (0.0, 130.0)])
def test_a_cut_off_board_is_masked(shift: tuple[float, float]) -> None:
    homography = view(0.0, True, center=(240.0 + shift[0], 180.0 + shift[1]))
    found = detected(chessboard_picture(9, 6, homography), 9, 6, "mirror")
    assert not found.ok
    assert "cut off" in found.reason
