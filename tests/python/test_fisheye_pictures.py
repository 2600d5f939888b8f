"""Detection and triangulation in pictures of an equidistant lens, drawn by code that shares nothing with them."""

from __future__ import annotations

import numpy as np

from fisheye_pictures import VIEWS, measured


def test_board_and_balls_far_off_a_fisheyes_axis_are_measured_truly() -> None:
    found = measured(2)
    assert len(found.boards_px) == VIEWS
    assert max(found.boards_px) < 0.15
    errors, squares = np.array(found.balls).T
    assert len(errors) >= 12
    # None is masked: off the axis a pinhole's balls would be twice as large.
    assert np.isfinite(errors).all(), errors
    assert errors.max() < 0.3
    assert squares.mean() < 2.5
    assert len(found.markers) == 5
    off_m, squares = np.array(found.markers).T
    assert np.all((off_m < 0.002) | (squares < 9.0)), (off_m, squares)
