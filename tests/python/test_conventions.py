"""docs/conventions.md: what it says of cameras and pictures, and that the tests that it names are there."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np
import pytest

import mirror_posture as mp

ROOT = Path(__file__).parents[2]


def test_optical_frame() -> None:
    camera = mp.Camera((800, 600), (700.0, 700.0), (399.5, 299.5))
    right, below = camera.project([[0.1, 0.0, 1.0], [0.0, 0.1, 1.0]])
    np.testing.assert_allclose(right, [469.5, 299.5])
    np.testing.assert_allclose(below, [399.5, 369.5])


def test_pixel_zero_is_the_centre_of_the_top_left_pixel() -> None:
    """A picture's middle lies between its pixels, at (width − 1) / 2; OpenCV's projection says the same."""
    camera = mp.Camera((4, 2), (3.0, 3.0), (1.5, 0.5))
    point = np.array([[-0.5, -0.5 / 3.0, 1.0]])
    np.testing.assert_allclose(camera.project(point)[0], [0.0, 0.0], atol=1e-12)
    matrix = np.array([[3.0, 0.0, 1.5], [0.0, 3.0, 0.5], [0.0, 0.0, 1.0]])
    opencv, _ = cv2.projectPoints(point, np.zeros(3), np.zeros(3), matrix, None)
    np.testing.assert_allclose(camera.project(point), opencv[:, 0], atol=1e-12)


def test_a_flip_moves_x_to_width_minus_one_minus_x() -> None:
    picture = np.zeros((5, 8), np.float32)
    picture[2, 5] = 1.0
    (y,), (x,) = np.nonzero(cv2.flip(picture, 1))
    assert (x, y) == (8 - 1 - 5, 2)


def named_tests() -> list[str]:
    text = (ROOT / "docs" / "conventions.md").read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if line.startswith("|")]
    return sorted({name for row in rows for name in re.findall(r"`(\w+)`", row.rsplit("|", 2)[1])})


@pytest.mark.parametrize("name", named_tests())
def test_every_test_that_the_page_names_is_there(name: str) -> None:
    files = [*(ROOT / "tests" / "rust").glob("*.rs"), *(ROOT / "tests" / "python").glob("test_*.py")]
    assert any(re.search(rf"\b(fn|def) {name}\b", file.read_text(encoding="utf-8")) for file in files)
