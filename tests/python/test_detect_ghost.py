"""A pane's ghost: the board tells its strength and place, and the balls' claims hold its pull.

Boards are drawn by `board_drawing`, the ghost is laid over in linear light by OpenCV; nothing of detection is used.
"""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from board_drawing import chessboard_picture
from mirror_posture import Board, Camera
from mirror_posture.detect import (
    DetectionSetup,
    PicturePrediction,
    PredictedMarker,
    detect_boards,
    detect_picture,
)
from mirror_posture.detect.ghost import board_ghost
from mirror_posture.marker import ColorRange, Marker

BOARD = Board(7, 4, 0.02)
SIZE = (320, 240)
CAMERA = Camera(SIZE, (400.0, 400.0), (159.5, 119.5))
MATRIX = np.array([[400.0, 0.0, 159.5], [0.0, 400.0, 119.5], [0.0, 0.0, 1.0]])
BALL = Marker("ball", diameter_m=0.03, color=ColorRange(0.0, 15.0, 0.5, 0.2))


def encoded(light: np.ndarray) -> np.ndarray:
    return np.clip(np.rint(255.0 * (1.055 * np.clip(light, 0.0, 1.0) ** (1 / 2.4) - 0.055)), 0, 255)


def linear(levels: np.ndarray) -> np.ndarray:
    return ((levels / 255.0 + 0.055) / 1.055) ** 2.4


def behind_a_pane(
    seed: int, strength: float, shift: tuple[float, float], ball: tuple[float, float] | None = None
) -> np.ndarray:
    """A board, and a red ball where given, with their ghost, blur and noise; BGR."""
    rng = np.random.default_rng(seed)
    turn = cv2.Rodrigues(rng.uniform(-0.3, 0.3, 3))[0]
    picture_from_board = MATRIX @ np.column_stack([turn[:, :2], [0.0, 1.6 if ball else 0.0, 18.0]])
    light = np.repeat(linear(chessboard_picture(7, 4, picture_from_board, SIZE, 0.0))[..., None], 3, axis=2)
    if ball is not None:
        u, v = np.meshgrid(np.arange(SIZE[0] * 4), np.arange(SIZE[1] * 4))
        disc = np.hypot((u - 1.5) / 4.0 - ball[0], (v - 1.5) / 4.0 - ball[1]) < 12.0
        share = disc.reshape(SIZE[1], 4, SIZE[0], 4).mean(axis=(1, 3))[..., None]
        light = light * (1.0 - share) + share * np.array([0.02, 0.03, 0.5])
    moved = cv2.warpAffine(
        light, np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]]), SIZE, borderMode=cv2.BORDER_REPLICATE
    )
    light = cv2.GaussianBlur((1.0 - strength) * light + strength * moved, (0, 0), 0.6)
    return np.clip(encoded(light) + rng.normal(0.0, 1.5, light.shape), 0, 255).astype(np.uint8)


def ghost_of(picture: np.ndarray):
    gray = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    (view,) = detect_boards(gray, BOARD, CAMERA)
    assert view.ok, view.reason
    return board_ghost(gray, view, BOARD)


@pytest.mark.parametrize(("strength", "shift"), [(0.06, (1.5, 3.2)), (0.1, (-3.0, 1.0)), (0.12, (0.0, -5.0))])
def test_a_board_tells_a_panes_ghost(strength: float, shift: tuple[float, float]) -> None:
    for seed in range(3):
        ghost = ghost_of(behind_a_pane(seed, strength, shift))
        assert ghost is not None, seed
        assert np.hypot(*np.subtract(ghost.shift_px, shift)) < 1.1, (seed, ghost)
        assert 0.6 * strength < ghost.strength < 1.5 * strength, (seed, ghost)


def test_no_ghost_is_told_where_none_is() -> None:
    for seed in range(4):
        assert ghost_of(behind_a_pane(seed, 0.0, (0.0, 0.0))) is None, seed


def test_claims_hold_the_pull_of_a_ghost() -> None:
    """Along the ghost, not across; the same picture without one claims less."""
    at = (110.0, 60.0)
    expected = PicturePrediction(markers=(PredictedMarker("ball", at, 30.0, 12.0),))
    claimed = []
    for strength in (0.0, 0.12):
        picture = behind_a_pane(5, strength, (0.0, 3.0), at)
        (view,) = detect_picture(picture, DetectionSetup(BOARD, (BALL,), CAMERA), expected).markers
        assert view.ok, view.reason
        claimed.append(view.covariance_px2)
        error = np.subtract(view.pixel_px, at)
        assert error @ np.linalg.solve(view.covariance_px2, error) < 9.0
    assert claimed[1][1, 1] > claimed[0][1, 1] + 0.05**2
    assert claimed[1][1, 1] > 2.0 * claimed[1][0, 0]
