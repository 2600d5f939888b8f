"""Where a chessboard can be: its crossings are told from texture, noise and other squares, and only there is searched at length.

Boards are drawn through a homography with samples inside each pixel; nothing of detection is used.
"""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mirror_posture import Board
from mirror_posture.detect import board_search as search
from mirror_posture.detect import detect_boards, places
from mirror_posture.detect.lattice import Reading
from mirror_posture.detect.places import board_places

BOARD = Board(7, 4, 0.02)
SIZE = (320, 240)
FINE = 3


def drawn(
    rng: np.random.Generator, square_px: float, blur_px: float, noise: float, light: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """A picture (H, W) of a board before an uneven background, and its corners (28, 2), px."""
    width, height = SIZE
    half = np.array([[-4.0, -2.5], [4.0, -2.5], [4.0, 2.5], [-4.0, 2.5]])
    seen = np.array([160.0, 120.0]) + square_px * (half + rng.uniform(-0.25, 0.25, (4, 2)))
    warp = cv2.getPerspectiveTransform(half.astype(np.float32), seen.astype(np.float32))
    u = (np.arange(width * FINE) + 0.5) / FINE - 0.5
    v = (np.arange(height * FINE) + 0.5) / FINE - 0.5
    places = np.stack([*np.meshgrid(u, v), np.ones((len(v), len(u)))], axis=-1) @ np.linalg.inv(warp).T
    x, y = places[..., 0] / places[..., 2], places[..., 1] / places[..., 2]
    inside = (np.abs(x) < 4.0) & (np.abs(y) < 2.5)
    dark = (np.floor(x + 4.0) + np.floor(y + 2.5)) % 2 == 0
    paper = (np.abs(x) < 4.6) & (np.abs(y) < 3.1)
    uneven = cv2.resize(rng.uniform(60, 190, (6, 8)), (width * FINE, height * FINE))
    fine = np.where(inside & dark, 20.0, np.where(paper, 200.0, uneven))
    picture = fine.reshape(height, FINE, width, FINE).mean(axis=(1, 3))
    picture = light * cv2.GaussianBlur(picture, (0, 0), blur_px) + rng.normal(0.0, noise, (height, width))
    grid = np.stack(np.meshgrid(np.arange(7) - 3.0, np.arange(4) - 1.5), axis=-1).reshape(-1, 2)
    corners = cv2.perspectiveTransform(grid[None], warp)[0]
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8), corners


def holds(box: tuple[int, int, int, int], corners: np.ndarray) -> bool:
    return bool(np.all(corners > box[:2]) and np.all(corners < box[2:]))


@pytest.mark.parametrize(
    ("square_px", "blur_px", "noise", "light"),
    [
        (9.0, 0.5, 2.0, 1.0),
        (20.0, 0.6, 25.0, 1.0),
        (24.0, 2.5, 3.0, 1.0),
        (28.0, 3.5, 2.0, 1.0),
        (24.0, 0.6, 3.0, 0.2),
    ],
)
def test_a_board_is_one_of_the_places(square_px: float, blur_px: float, noise: float, light: float) -> None:
    for seed in range(2):
        picture, corners = drawn(np.random.default_rng(seed), square_px, blur_px, noise, light)
        boxes = [
            place.box_px
            for scale in search.PLACE_SCALES
            for place in board_places(picture, BOARD.corner_count, scale)
        ]
        assert any(holds(box, corners) for box in boxes), (seed, boxes)
        (view,) = detect_boards(picture, BOARD)
        assert view.ok, (seed, view.reason)


@pytest.fixture
def long_searches(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int]]:
    """Sizes of the pictures that the slow detector is given."""
    asked: list[tuple[int, int]] = []
    detector = search.DETECTORS["sector"]

    def counted(gray: np.ndarray, size: tuple[int, int]) -> np.ndarray | None:
        asked.append(gray.shape)
        return detector(gray, size)

    monkeypatch.setitem(search.DETECTORS, "sector", counted)
    return asked


def test_texture_and_noise_are_not_searched_at_length(long_searches: list[tuple[int, int]]) -> None:
    rng = np.random.default_rng(5)
    coarse = cv2.resize(rng.uniform(0, 255, (40, 50)), SIZE, interpolation=cv2.INTER_CUBIC)
    for picture in (coarse, rng.normal(128, 40, SIZE[::-1]), 0.5 * coarse + rng.normal(60, 20, SIZE[::-1])):
        (view,) = detect_boards(np.clip(picture, 0, 255).astype(np.uint8), BOARD)
        assert not view.ok
        assert "no chessboard of 7 × 4 inner corners found" in view.reason
    assert not long_searches


def test_a_board_half_behind_a_thing_is_not_searched_at_length(long_searches: list[tuple[int, int]]) -> None:
    picture, corners = drawn(np.random.default_rng(6), 22.0, 0.6, 2.0)
    picture[:, int(np.quantile(corners[:, 0], 0.2)) :] = 120
    (view,) = detect_boards(picture, BOARD)
    assert not view.ok
    assert not long_searches


def test_squares_of_other_things_do_not_hide_the_board(long_searches: list[tuple[int, int]]) -> None:
    picture, corners = drawn(np.random.default_rng(7), 15.0, 0.6, 2.0)
    for left, top, size, count in ((8, 8, 11, 4), (240, 10, 14, 5), (15, 170, 7, 8), (262, 180, 9, 6)):
        tiles = (np.indices((count, count)).sum(axis=0) % 2 * 190 + 30).astype(np.uint8)
        part = np.kron(tiles, np.ones((size, size), np.uint8))
        picture[top : top + part.shape[0], left : left + part.shape[1]] = part
    (view,) = detect_boards(picture, BOARD)
    assert view.ok, view.reason
    away = np.linalg.norm(view.corners_px[:, None] - corners[None], axis=2).min(axis=1)
    assert float(np.sqrt(np.mean(away**2))) < 0.15
    # Slow searches, where any, are of parts.
    assert all(rows * columns < 0.7 * SIZE[0] * SIZE[1] for rows, columns in long_searches)


@pytest.mark.parametrize(("noise", "asked"), [(2.0, 0), (18.0, 1)])
def test_a_detector_is_asked_only_where_noise_may_hide_crossings(
    monkeypatch: pytest.MonkeyPatch, long_searches: list[tuple[int, int]], noise: float, asked: int
) -> None:
    """Crossings that may be a board, of which no grid passes the checks."""
    picture, corners = drawn(np.random.default_rng(8), 14.0, 0.5, noise, 0.5)
    grid = corners.reshape(4, 7, 2) + 9.0
    shown = np.arange(28).reshape(4, 7) > 3
    monkeypatch.setattr(search, "read_crossings", lambda *given: Reading((), ((grid, shown),), True))
    detect_boards(picture, BOARD)
    assert bool(long_searches) == bool(asked)


def test_contrasts_that_are_read_one_by_one_are_those_of_all_pixels(monkeypatch: pytest.MonkeyPatch) -> None:
    picture, _ = drawn(np.random.default_rng(5), 20.0, 0.8, 3.0)
    smooth = picture.astype(np.float32)
    height, width = smooth.shape
    # Corners and borders too.
    peaks = np.array(
        [0, width - 1, 5 * width + 2, (height - 1) * width, height * width - 1, 90 * width + 160]
    )
    alone = places._contrast_around(smooth, peaks)
    monkeypatch.setattr(places, "MOST_READ_ALONE", 0)
    np.testing.assert_array_equal(alone, places._contrast_around(smooth, peaks))
