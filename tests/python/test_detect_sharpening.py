"""A camera's sharpening: the board tells its strength, and it is undone before balls are measured.

Boards and balls are drawn here by supersampling in light, as a sensor averages it; levels are sharpened by the definition. Nothing of detection is used.
"""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mirror_posture.detect import PredictedMarker, detect_boards, detect_markers
from mirror_posture.detect.ball import Circle
from mirror_posture.detect.drawn import DrawnBoard, drawn_board
from mirror_posture.detect.sharpening import ghost_and_sharpening, undone, without_sharpening
from test_detect_ghost import BALL, BOARD, CAMERA, MATRIX, SIZE, encoded

BALL_AT = (160.3, 60.6)
FINE = 4


def light_of_a_board(seed: int) -> np.ndarray:
    """A board's light (H, W, 3), not blurred yet."""
    rng = np.random.default_rng(seed)
    turn = cv2.Rodrigues(rng.uniform(-0.3, 0.3, 3))[0]
    picture_from_board = MATRIX @ np.column_stack([turn[:, :2], [0.0, 1.6, 18.0]])
    u, v = ((np.arange(side * FINE) - 0.5 * (FINE - 1)) / FINE for side in SIZE)
    points = np.stack(np.broadcast_arrays(u[None, :], v[:, None], 1.0), axis=-1)
    board = points @ np.linalg.inv(picture_from_board).T
    x, y = board[..., 0] / board[..., 2] + 4.0, board[..., 1] / board[..., 2] + 2.5
    squares = (x > 0) & (y > 0) & (x < 8) & (y < 5) & ((np.floor(x) + np.floor(y)) % 2 == 0)
    fine = np.where(squares, 0.02, np.where((x > -0.8) & (y > -0.8) & (x < 8.8) & (y < 5.8), 0.6, 0.2))
    light = fine.reshape(SIZE[1], FINE, SIZE[0], FINE).mean(axis=(1, 3))
    return np.repeat(light[..., None], 3, axis=2)


def pictured(light: np.ndarray, seed: int, ghost: float = 0.0) -> np.ndarray:
    """Through a pane and a lens onto a sensor; BGR."""
    way = np.array([[1.0, 0.0, 1.5], [0.0, 1.0, 3.2]])
    moved = cv2.warpAffine(light, way, SIZE, borderMode=cv2.BORDER_REPLICATE)
    blurred = cv2.GaussianBlur((1.0 - ghost) * light + ghost * moved, (0, 0), 0.6)
    noise = np.random.default_rng(seed).normal(0.0, 1.0, blurred.shape)
    return np.clip(np.rint(encoded(blurred) + noise), 0, 255).astype(np.uint8)


def sharpened(picture: np.ndarray, strength_px2: float) -> np.ndarray:
    levels = picture.astype(float)
    beside = sum(np.roll(levels, by, axis) for axis in (0, 1) for by in (-1, 1))
    return np.clip(np.rint(levels + strength_px2 * (4.0 * levels - beside)), 0, 255).astype(np.uint8)


def drawn_of(picture: np.ndarray) -> DrawnBoard:
    gray = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    (view,) = detect_boards(gray, BOARD, CAMERA)
    assert view.ok, view.reason
    drawn = drawn_board(gray, view, BOARD)
    assert drawn is not None
    return drawn


@pytest.mark.parametrize("strength", [0.0, 0.12, 0.25])
@pytest.mark.parametrize("ghost", [0.0, 0.06])
def test_a_board_tells_how_much_a_picture_was_sharpened(strength: float, ghost: float) -> None:
    told = [
        ghost_and_sharpening(
            drawn_of(sharpened(pictured(light_of_a_board(seed), seed, ghost), strength)), None
        )[1]
        for seed in range(3)
    ]
    assert max(abs(one - strength) for one in told) < 0.07, told


def test_what_is_undone_is_what_was_before() -> None:
    rng = np.random.default_rng(3)
    before = cv2.GaussianBlur(rng.uniform(0, 255, (60, 80)).astype(np.float32), (0, 0), 1.5)
    after = sharpened(before, 0.2)
    inner = slice(5, -5)
    assert np.abs(after - before)[inner, inner].max() > 3.0
    assert np.abs(undone(after.astype(np.float32), 0.2) - before)[inner, inner].max() < 1.0
    assert undone(before, 0.0) is before


def test_only_the_surroundings_of_balls_are_changed() -> None:
    picture = sharpened(pictured(light_of_a_board(1), 1), 0.25)
    clear = without_sharpening(picture, 0.25, [Circle(np.array([40.0, 50.0]), 8.0)])
    changed = (clear != picture).any(axis=2)
    assert changed[20:80, 10:70].any() and not changed[:, 90:].any()
    assert without_sharpening(picture, 0.0, [Circle(np.array([40.0, 50.0]), 8.0)]) is picture


def test_a_ball_of_a_sharpened_picture_is_where_it_was() -> None:
    """Before a light and a dark half it is displaced differently on the two sides."""
    u, v = np.meshgrid(np.arange(SIZE[0] * FINE), np.arange(SIZE[1] * FINE))
    away = [(axis - 0.5 * (FINE - 1)) / FINE for axis in (u, v)]
    disc = np.hypot(away[0] - BALL_AT[0], away[1] - BALL_AT[1]) < 12.0
    share = disc.reshape(SIZE[1], FINE, SIZE[0], FINE).mean(axis=(1, 3))[..., None]
    behind = np.where(np.arange(SIZE[0]) < 160, 0.04, 0.7)[None, :, None] * np.ones((SIZE[1], 1, 3))
    light = behind * (1.0 - share) + share * np.array([0.02, 0.03, 0.5])
    off: dict[float, list[np.ndarray]] = {0.0: [], 0.25: []}
    for seed in range(4):
        picture = sharpened(pictured(light, seed), 0.25)
        for undo, errors in off.items():
            (view,) = detect_markers(
                picture,
                (BALL,),
                CAMERA,
                expected=(PredictedMarker("ball", BALL_AT, np.inf, 12.0),),
                sharpening_px2=undo,
            )
            assert view.ok, view.reason
            errors.append(np.subtract(view.pixel_px, BALL_AT))
    left = {undo: float(np.hypot(*np.mean(errors, axis=0))) for undo, errors in off.items()}
    assert left[0.25] < 0.6 * left[0.0], left
