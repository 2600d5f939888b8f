"""Corners of boards seen at a flat angle, or small: the point to which gradients are perpendicular runs up to a pixel away there, in all corners alike, and no residual shows it.

Boards are drawn through homographies with samples inside each pixel; nothing of detection is used.
"""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from board_drawing import chessboard_picture, corners_px
from mirror_posture import Board
from mirror_posture.detect import detect_boards
from mirror_posture.detect.board import measure_grid

# Columns, rows, and where a board's outermost corners are seen, px.
FLAT = {
    "lines 5 px apart": (9, 6, [[112.0, 60.0], [112.0, 125.0], [180.0, 210.0], [205.0, 140.0]]),
    "at 40 degrees": (7, 4, [[60.0, 60.0], [230.0, 75.0], [290.0, 130.0], [105.0, 115.0]]),
    "small and straight": (7, 4, [[100.0, 100.0], [133.0, 103.0], [131.0, 120.0], [99.0, 117.0]]),
}


def flat_view(name: str) -> tuple[Board, np.ndarray, np.ndarray]:
    """A board, its picture with blur and noise, and its true corners (N, 2) px."""
    columns, rows, seen = FLAT[name]
    half = np.array([(columns - 1) / 2, (rows - 1) / 2])
    outer = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    warp = cv2.getPerspectiveTransform(outer.astype(np.float32), np.array(seen, np.float32))
    sharp = chessboard_picture(columns, rows, warp, (340, 260), 0.0)
    noise = np.random.default_rng(5).normal(0.0, 2.0, sharp.shape)
    picture = cv2.GaussianBlur(sharp.astype(np.float64), (0, 0), 0.8) + noise
    return (
        Board(columns, rows, 0.02),
        np.clip(np.rint(picture), 0, 255).astype(np.uint8),
        corners_px(columns, rows, warp),
    )


@pytest.mark.parametrize("name", FLAT)
@pytest.mark.parametrize("seed", [1, 2])
def test_corners_at_a_slant_are_where_they_are(name: str, seed: int) -> None:
    board, picture, truth = flat_view(name)
    start = truth + np.random.default_rng(seed).normal(0.0, 0.3, truth.shape)
    view = measure_grid(picture, start.reshape(board.rows, board.columns, 2), board)
    assert view.corners_px is not None
    away = np.linalg.norm(view.corners_px[:, None] - truth[None], axis=2).min(axis=1)
    assert away.max() < 0.15, away.max()


def test_what_is_found_at_a_slant_is_not_claimed_too_well() -> None:
    for name in FLAT:
        board, picture, truth = flat_view(name)
        (view,) = detect_boards(picture, board)
        assert view.ok, (name, view.reason)
        assert view.corners_px is not None and view.std_px is not None and view.visible is not None
        away = np.linalg.norm(view.corners_px[:, None] - truth[None], axis=2).min(axis=1)[view.visible]
        assert np.mean((away / view.std_px[view.visible]) ** 2) / 2 < 2.0
