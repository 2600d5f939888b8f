"""A pane's ghost: the board tells its strength and place, and it is taken off the balls.

Boards are drawn by `board_drawing`, the ghost is laid over in linear light by OpenCV; nothing of detection is used.
"""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from board_drawing import chessboard_picture
from mirror_posture import Board, Camera
from mirror_posture.detect import PredictedMarker, detect_boards, detect_markers
from mirror_posture.detect.ball import Circle
from mirror_posture.detect.drawn import drawn_board
from mirror_posture.detect.ghost import board_ghost
from mirror_posture.detect.ghost_light import Ghost, Pane, without_ghost
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


def ghost_of(picture: np.ndarray, pane: Pane | None = None):
    gray = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    (view,) = detect_boards(gray, BOARD, CAMERA)
    assert view.ok, view.reason
    drawn = drawn_board(gray, view, BOARD)
    assert drawn is not None
    ghost = board_ghost(drawn, pane)
    assert ghost is not None
    return ghost


@pytest.mark.parametrize(("strength", "shift"), [(0.06, (1.5, 3.2)), (0.1, (-3.0, 1.0)), (0.12, (0.0, -5.0))])
def test_a_board_tells_a_panes_ghost(strength: float, shift: tuple[float, float]) -> None:
    for seed in range(3):
        ghost = ghost_of(behind_a_pane(seed, strength, shift))
        assert np.hypot(*np.subtract(ghost.shift_px, shift)) < 0.8, (seed, ghost)
        assert 0.6 * strength < ghost.strength < 1.4 * strength, (seed, ghost)


def test_no_ghost_is_told_where_none_is() -> None:
    for seed in range(4):
        ghost = ghost_of(behind_a_pane(seed, 0.0, (0.0, 0.0)))
        assert ghost.strength == 0.0 and ghost.weakest < 0.03, (seed, ghost)


def test_a_ghost_is_taken_off_a_ball() -> None:
    """With the ghost told, the ball lies where it does without one, and its claim is wider along the ghost than across; untold, it is pulled."""
    at = (110.0, 60.0)
    expected = (PredictedMarker("ball", at, 30.0, 12.0),)
    found = {}
    for strength, told in ((0.0, False), (0.12, False), (0.12, True)):
        picture = behind_a_pane(5, strength, (0.0, 3.0), at)
        ghost = Ghost(0.12, (0.0, 3.0)) if told else None
        (view,) = detect_markers(picture, (BALL,), CAMERA, expected, ghost=ghost)
        assert view.ok, view.reason
        found[strength, told] = view
    plain = found[0.0, False].pixel_px
    pulled = np.subtract(found[0.12, False].pixel_px, plain)
    freed = np.subtract(found[0.12, True].pixel_px, plain)
    assert pulled[1] > 0.015
    assert abs(freed[1]) < 0.4 * pulled[1], (pulled, freed)
    claimed = found[0.12, True].covariance_px2
    assert claimed[1, 1] > claimed[0, 0]


def test_a_ghost_is_taken_off_only_around_the_balls() -> None:
    rng = np.random.default_rng(2)
    picture = rng.integers(0, 256, (120, 160, 3), dtype=np.uint8)
    clear = without_ghost(picture, Ghost(0.1, (2.0, 1.0)), [Circle(np.array([40.0, 50.0]), 8.0)])
    changed = np.argwhere((clear != picture).any(axis=2))
    assert changed.min(axis=0).tolist() > [10, 0] and changed.max(axis=0)[1] < 75
    assert without_ghost(picture, None, [Circle(np.array([40.0, 50.0]), 8.0)]) is picture


def test_light_without_its_ghost_is_the_light_before() -> None:
    """Laid over by OpenCV in linear light, taken off again: what is left is rounding and the third image."""
    rng = np.random.default_rng(1)
    squares = cv2.resize(rng.uniform(0.05, 0.9, (12, 16, 3)), (160, 120), interpolation=cv2.INTER_NEAREST)
    light = cv2.GaussianBlur(squares, (0, 0), 1.0)
    moved = cv2.warpAffine(
        light, np.array([[1.0, 0, 2.5], [0, 1.0, -1.5]]), (160, 120), borderMode=cv2.BORDER_REPLICATE
    )
    with_it = encoded(0.9 * light + 0.1 * moved).astype(np.uint8)
    clear = without_ghost(with_it, Ghost(0.1, (2.5, -1.5)), [Circle(np.array([80.0, 60.0]), 12.0)])
    part = np.s_[35:85, 55:105]
    left = linear(clear[part].astype(float)) - light[part]
    before = linear(with_it[part].astype(float)) - light[part]
    assert np.sqrt(np.mean(left**2)) < 0.25 * np.sqrt(np.mean(before**2))


NORMAL = np.array([0.15, -0.5, 0.85]) / np.linalg.norm([0.15, -0.5, 0.85])
AWAY = np.array([0.0, 0.0, 18.0])


def of_a_real_pane(seed: int, strength: float, moved: float, alike: bool) -> np.ndarray:
    """A board and its picture moved along the mirror's normal (`moved`, in squares), as a pane's front makes it; or moved alike everywhere by what that is at the
    board's middle; BGR."""
    rng = np.random.default_rng(seed)
    turn = cv2.Rodrigues(rng.uniform(-0.3, 0.3, 3))[0]

    def drawn(center: np.ndarray) -> np.ndarray:
        picture_from_board = MATRIX @ np.column_stack([turn[:, :2], center])
        return linear(chessboard_picture(7, 4, picture_from_board, SIZE, 0.0))

    light, nearer = drawn(AWAY), drawn(AWAY - moved * NORMAL)
    if alike:
        first, last = ((MATRIX @ at)[:2] / at[2] for at in (AWAY, AWAY - moved * NORMAL))
        way = np.column_stack([np.eye(2), last - first])
        nearer = cv2.warpAffine(light, way, SIZE, borderMode=cv2.BORDER_REPLICATE)
    light = cv2.GaussianBlur((1.0 - strength) * light + strength * nearer, (0, 0), 0.6)
    noisy = np.clip(encoded(light) + rng.normal(0.0, 1.0, light.shape), 0, 255).astype(np.uint8)
    return np.repeat(noisy[..., None], 3, axis=2)


def test_a_panes_ghost_differs_across_the_picture() -> None:
    pane = Pane(NORMAL, float(np.linalg.norm(AWAY)) * 0.02, CAMERA)
    for seed in range(2):
        ghost = ghost_of(of_a_real_pane(seed, 0.08, 0.3, alike=False), pane)
        assert ghost.probability > 0.8, ghost
        assert ghost.moved_m == pytest.approx(0.3 * 0.02, rel=0.3)
        # At another place it lies where the pane's second picture of it does.
        point = np.array([0.1, -0.08, 0.36])
        point *= pane.distance_m / np.linalg.norm(point)
        seen = CAMERA.project(np.stack([point, point - 0.006 * NORMAL]))
        shift, other = ghost.shifts_at(seen[0])
        assert np.hypot(*(shift - (seen[1] - seen[0]))) < 0.35 * np.hypot(*(seen[1] - seen[0]))
        assert np.allclose(other, ghost.shift_px)
        same = ghost_of(of_a_real_pane(seed, 0.08, 0.3, alike=True), pane)
        assert same.probability < 0.3, same
