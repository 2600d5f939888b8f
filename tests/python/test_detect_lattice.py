"""Grids of crossings: the board is read from them without a detector, and other things full of squares are told from it without one.

Keyboard, tiles and cloth are drawn by OpenCV through a homography, boards by `test_detect_places`; nothing of detection is used.
"""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from board_drawing import chessboard_picture, corners_px
from mirror_posture import Board
from mirror_posture.detect import board_search as search
from mirror_posture.detect import detect_boards
from mirror_posture.detect.lattice import Reading, read_crossings
from mirror_posture.detect.places import Place, board_places
from test_cli_second_camera import MATRIX, draw
from test_detect_places import BOARD, drawn

SIZE = (480, 360)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, ...]]:
    """Sizes of the pictures that detectors are given; they find nothing."""
    sizes: list[tuple[int, ...]] = []
    for name in search.DETECTORS:
        monkeypatch.setitem(search.DETECTORS, name, lambda gray, size: sizes.append(gray.shape))
    return sizes


def keyboard(rng: np.random.Generator) -> np.ndarray:
    keys = np.full((490, 1190), 30, np.uint8)
    for top in range(0, 490, 70):
        for left in range(0, 1190, 70):
            keys[top + 6 : top + 64, left + 6 : left + 64] = rng.integers(60, 90)
            cv2.putText(keys, chr(65 + int(rng.integers(26))), (left + 20, top + 45), 0, 1, 220, 2)
    return keys


def tiles(rng: np.random.Generator) -> np.ndarray:
    wall = np.full((720, 900), 200, np.uint8)
    for top in range(0, 720, 60):
        for left in range(0, 900, 60):
            wall[top + 3 : top + 57, left + 3 : left + 57] = rng.integers(110, 150)
    return wall


def cloth(rng: np.random.Generator) -> np.ndarray:
    checks = (np.indices((16, 20)).sum(axis=0) % 2 * 150 + 50).astype(np.uint8)
    return np.kron(checks, np.ones((40, 40), np.uint8))


def before_the_camera(thing: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A thing seen at an angle, three samples a pixel each way, with noise."""
    height, width = thing.shape
    flat = np.float32([[0, 0], [width, 0], [width, height], [0, height]])
    seen = np.float32([[70, 50], [400, 50], [400, 310], [70, 310]])
    seen += rng.uniform(-40, 40, (4, 2)).astype(np.float32)
    warp = cv2.getPerspectiveTransform(flat, 3.0 * seen)
    large = cv2.warpPerspective(thing, warp, (3 * SIZE[0], 3 * SIZE[1]), borderValue=120)
    small = cv2.resize(large, SIZE, interpolation=cv2.INTER_AREA)
    return np.clip(small + rng.normal(0.0, 2.0, small.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("thing", [keyboard, tiles, cloth])
def test_things_full_of_squares_cost_no_detector(thing, asked: list[tuple[int, ...]]) -> None:
    for seed in range(4):
        rng = np.random.default_rng(seed)
        (view,) = detect_boards(before_the_camera(thing(rng), rng), BOARD)
        assert not view.ok
    assert not asked


@pytest.mark.parametrize("seed", [8, 39])
def test_gingham_costs_no_detector(seed: int, asked: list[tuple[int, ...]]) -> None:
    """Three shades look like a board with some corners hidden, here and there."""
    rng = np.random.default_rng(seed)
    shades = np.array([60, 130, 220], np.uint8)[(np.indices((16, 20)) % 2).sum(axis=0)]
    (view,) = detect_boards(before_the_camera(np.kron(shades, np.ones((40, 40), np.uint8)), rng), BOARD)
    assert not view.ok
    assert not asked


def before_cloth(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A board before chequered cloth, and its corners (28, 2) px."""
    rng = np.random.default_rng(seed)
    checks = np.kron(np.indices((12, 14)).sum(axis=0) % 2 * 150 + 50, np.ones((60, 60))).astype(np.uint8)
    picture = before_the_camera(checks, rng)
    left, top = rng.integers(10, 150), rng.integers(10, 110)
    board, corners = drawn(rng, 20.0, 0.5, 2.0)
    picture[top : top + 134, left : left + 192] = board[53:187, 64:256]
    return picture, corners + np.array([left - 64.0, top - 53.0])


@pytest.mark.parametrize("seed", [65, 78, 81, 85])
def test_a_board_before_chequered_cloth_is_read(seed: int) -> None:
    """Its crossings are joined to the cloth's, a step beyond its margin."""
    picture, truth = before_cloth(seed)
    (view,) = detect_boards(picture, BOARD)
    assert view.ok, view.reason
    away = np.linalg.norm(view.corners_px[view.visible][:, None] - truth[None], axis=2).min(axis=1)
    assert away.max() < 0.3


def test_a_place_is_read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The search for a surplus board looks at the same places."""
    read = []

    def counted(gray: np.ndarray, place: Place, board: Board) -> Reading:
        read.append(place)
        return read_crossings(gray, place, board)

    monkeypatch.setattr(search, "read_crossings", counted)
    (view,) = detect_boards(before_cloth(65)[0], BOARD)
    assert view.ok, view.reason
    assert len(read) == len(set(map(id, read)))


@pytest.mark.parametrize("square_px", [6.0, 12.0, 22.0])
def test_a_board_is_read_from_its_crossings(square_px: float, asked: list[tuple[int, ...]]) -> None:
    for seed in range(3):
        picture, corners = drawn(np.random.default_rng(seed), square_px, 0.5, 2.0)
        (view,) = detect_boards(picture, BOARD)
        assert view.ok, (seed, view.reason)
        assert view.method == "crossings"
        away = np.linalg.norm(view.corners_px[view.visible][:, None] - corners[None], axis=2).min(axis=1)
        assert float(np.sqrt(np.mean(away**2))) < 0.15
    assert not asked


def test_a_faint_board_is_found() -> None:
    """Squares 8 grey levels apart, in little noise."""
    for seed in range(3):
        picture, corners = drawn(np.random.default_rng(seed), 20.0, 0.7, 0.8, 8.0 / 180.0)
        (view,) = detect_boards(picture, BOARD)
        assert view.ok, (seed, view.reason)
        away = np.linalg.norm(view.corners_px[view.visible][:, None] - corners[None], axis=2).min(axis=1)
        assert float(np.sqrt(np.mean(away**2))) < 4.0 * float(np.sqrt(2.0 * np.mean(view.std_px**2)))


@pytest.mark.parametrize("counts", [(5, 4), (7, 3), (6, 4), (3, 3)])
def test_a_larger_grid_is_no_board(counts: tuple[int, int]) -> None:
    picture, _ = drawn(np.random.default_rng(1), 20.0, 0.6, 2.0)
    (place, *_) = board_places(picture, BOARD.corner_count, 0.5)
    small = cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    reading = read_crossings(small, place, Board(*counts, 0.02))
    assert not reading.whole
    assert not reading.may_hold
    assert len(read_crossings(small, place, BOARD).whole) == 1


@pytest.mark.parametrize("counts", [(24, 17), (31, 24)])
def test_boards_of_many_corners_are_found(counts: tuple[int, int]) -> None:
    """More corners than crossings are joined."""
    pitch = 16.0
    size = (int((counts[0] + 5) * pitch), int((counts[1] + 5) * pitch))
    picture_from_board = np.array(
        [[0.95 * pitch, 1.2, size[0] / 2], [-1.0, 0.93 * pitch, size[1] / 2], [1e-4, 2e-4, 1.0]]
    )
    picture = chessboard_picture(*counts, picture_from_board, size)
    (view,) = detect_boards(picture, Board(*counts, 0.02))
    assert view.ok, view.reason
    assert view.visible.all()
    assert np.linalg.norm(view.corners_px - corners_px(*counts, picture_from_board), axis=1).max() < 0.3


@pytest.mark.parametrize(
    ("columns", "rows", "turn_rad", "at_m"),
    [
        (7, 4, (-1.1013, 0.0075, 1.0706), (0.1703, 0.0206, 0.7101)),
        (11, 8, (-1.2377, 0.542, 2.1323), (-0.068, -0.1179, 0.6651)),
    ],
)
def test_a_board_at_a_slant_is_read_though_its_crossings_are_joined_across_its_rows(
    columns: int,
    rows: int,
    turn_rad: tuple[float, ...],
    at_m: tuple[float, ...],
    asked: list[tuple[int, ...]],
) -> None:
    camera_from_board = np.eye(4)
    camera_from_board[:3, :3] = cv2.Rodrigues(np.array(turn_rad))[0]
    camera_from_board[:3, 3] = at_m
    picture = draw(MATRIX, [((columns, rows, 0.02), camera_from_board)])
    (view,) = detect_boards(np.asarray(picture), Board(columns, rows, 0.02))
    assert view.ok, view.reason
    assert not asked
