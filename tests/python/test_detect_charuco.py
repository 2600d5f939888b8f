"""ChArUco boards: found in a mirror only because the picture is flipped, exactly, before and after."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mirror_posture import Board
from mirror_posture.detect import BoardOptions, DetectionError, detect_charuco

BOARD = Board(6, 5, 0.02, "charuco", 0.015, "DICT_4X4_50")


def drawn(board: Board, mirrored: bool) -> tuple[np.ndarray, np.ndarray]:
    """A board drawn by OpenCV, and its true corners in the session's order, both turned and, if asked, mirrored by a homography."""
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    made = cv2.aruco.CharucoBoard(
        (board.columns + 1, board.rows + 1), board.square_m, board.marker_size_m, dictionary
    )
    scale = 160
    flat = made.generateImage(((board.columns + 1) * scale, (board.rows + 1) * scale), marginSize=0)
    flat = cv2.copyMakeBorder(flat, scale, scale, scale, scale, cv2.BORDER_CONSTANT, value=255)
    pixel_from_print = np.array([[0.23, 0.05, 60.0], [-0.04, 0.24, 90.0], [2e-5, 4e-5, 1.0]])
    if mirrored:
        pixel_from_print = np.array([[-1.0, 0.0, 479.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]) @ pixel_from_print
    # Area sampling by an enlarged warp: pixel centres are whole numbers, hence the half pixels.
    fine = 4
    grow = np.array([[fine, 0, (fine - 1) / 2], [0, fine, (fine - 1) / 2], [0, 0, 1.0]])
    large = cv2.warpPerspective(flat, grow @ pixel_from_print, (480 * fine, 400 * fine), borderValue=128)
    picture = cv2.resize(large, (480, 400), interpolation=cv2.INTER_AREA)
    printed = []
    for iy in range(board.rows):
        for ix in range(board.columns):
            # z out of the printed face: y runs up on the paper, against the picture's rows.
            printed.append(((ix + 2) * scale - 0.5, (board.rows - iy + 1) * scale - 0.5, 1.0))
    if board.rows % 2 == 1 and board.columns % 2 == 0:
        # Turned by 180° so that the square beyond corner 0 is dark: the top left square of the print is.
        printed = printed[::-1]
    projected = pixel_from_print @ np.array(printed).T
    return picture, (projected[:2] / projected[2]).T


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("counts", [(6, 5), (5, 6), (7, 5)])
def test_charuco_boards_are_found_with_their_labels(mirrored: bool, counts: tuple[int, int]) -> None:
    board = Board(*counts, 0.02, "charuco", 0.015, "DICT_4X4_50")
    picture, truth = drawn(board, mirrored)
    via = "mirror" if mirrored else "direct"
    (view,) = detect_charuco(picture, board, options=BoardOptions(views=(via,)))
    assert view.ok, view.reason
    assert view.visible.all()
    assert np.sqrt(np.mean(np.sum((view.corners_px - truth) ** 2, axis=1))) < 0.1
    # The contract's rule, read from the picture itself, where the pattern can meet it.
    if counts != (7, 5):
        grid = view.corners_px.reshape(counts[1], counts[0], 2)
        beyond = grid[0, 0] - 0.25 * (grid[0, 1] + grid[1, 0] - 2 * grid[0, 0])
        assert picture[round(beyond[1]), round(beyond[0])] < 100


def test_a_mirrored_board_is_not_found_as_a_direct_one() -> None:
    picture, _ = drawn(BOARD, True)
    (view,) = detect_charuco(picture, BOARD, options=BoardOptions(views=("direct",)))
    assert not view.ok
    assert "corners of a ChArUco board found" in view.reason


def test_a_part_of_the_board_is_enough() -> None:
    picture, truth = drawn(BOARD, True)
    covered = picture.copy()
    covered[:, : int(np.median(truth[:, 0]))] = 128
    (view,) = detect_charuco(covered, BOARD)
    assert view.ok, view.reason
    assert 6 <= view.visible.sum() < BOARD.corner_count
    error = view.corners_px[view.visible] - truth[view.visible]
    assert np.abs(error).max() < 0.4
    assert np.isfinite(view.corners_px).all() and np.isfinite(view.std_px).all()


def test_an_unknown_dictionary_lists_the_valid_ones() -> None:
    board = Board(6, 5, 0.02, "charuco", 0.015, "DICT_9X9")
    with pytest.raises(DetectionError, match="DICT_4X4_50"):
        detect_charuco(np.zeros((100, 100), np.uint8), board)


def test_a_dictionary_with_too_few_markers_is_refused() -> None:
    board = Board(20, 20, 0.02, "charuco", 0.015, "DICT_4X4_50")
    with pytest.raises(DetectionError, match="holds 50 markers"):
        detect_charuco(np.zeros((100, 100), np.uint8), board)
