"""When a live picture is taken: not while something moves, however slowly, and not blurred."""

from __future__ import annotations

import cv2
import numpy as np

from mirror_posture.capture.stillness import Stillness

RNG = np.random.default_rng(4)
SCENE = cv2.resize(
    RNG.integers(40, 200, (30, 40, 3)).astype(np.uint8), (320, 240), interpolation=cv2.INTER_NEAREST
)


def test_a_move_too_slow_to_show_from_picture_to_picture_is_a_move() -> None:
    stillness = Stillness()
    stillness.see(SCENE, 0.0)
    stillness.take(SCENE)
    moved = []
    for k in range(1, 5):
        # Each picture is one grey level from the one before: less than what counts as a move.
        stillness.see(SCENE + np.uint8(k), 0.1 * k)
        assert stillness.motion < 1.5
        moved.append(stillness.moved)
    assert moved == [False, True, True, True]


def test_the_next_picture_after_one_that_was_taken_is_of_something_else() -> None:
    stillness = Stillness()
    assert stillness.moved, "the first picture is always taken"
    stillness.see(SCENE, 0.0)
    stillness.take(SCENE)
    assert stillness.see(SCENE, 0.5) == 0.5 and not stillness.moved
    # A quick move ends the rest.
    assert stillness.see(np.roll(SCENE, 60, axis=1), 0.6) == 0.0 and stillness.moved
    assert abs(stillness.see(np.roll(SCENE, 60, axis=1), 1.0) - 0.4) < 1e-9


def test_a_picture_that_is_far_less_sharp_than_those_before_is_not_taken() -> None:
    stillness = Stillness()
    blurred = cv2.GaussianBlur(SCENE, (0, 0), 6.0)
    assert stillness.is_sharp(blurred), "nothing to compare with yet"
    for _ in range(3):
        stillness.see(SCENE, 0.0)
        stillness.take(SCENE)
    assert stillness.is_sharp(SCENE) and not stillness.is_sharp(blurred)


def test_what_moved_and_came_back_has_moved() -> None:
    stillness = Stillness()
    stillness.see(SCENE, 0.0)
    stillness.take(SCENE)
    stillness.see(np.roll(SCENE, 60, axis=1), 0.5)
    # A hand that passed: the scene is as it was when it was taken, and yet another moment.
    stillness.see(SCENE, 1.0)
    stillness.see(SCENE, 1.5)
    assert stillness.moved
