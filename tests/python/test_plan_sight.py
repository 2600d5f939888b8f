"""Which balls a planned mirror shows: one camera, one mirror squarely before it, bounds worked out by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from mirror_posture import Board, Camera
from mirror_posture.plan.sight import LEAST_BALL_PX, Scene, look

DISTANCE_M, FOCAL_PX = 0.5, 600.0
CORNERS = np.array([[x, y, 0.0] for y in (-0.03, 0.03) for x in (-0.04, 0.04)])


def ball_is_seen(at: tuple[float, float, float], radius_m: float, width_m: float = 0.5) -> bool:
    """The camera is the base, and looks along z at a mirror 0.5 m away, whose middle is on the axis."""
    setting = SimpleNamespace(
        camera=Camera((1280, 960), (FOCAL_PX, FOCAL_PX), (639.5, 479.5)),
        board=Board(5, 4, 0.02),
        radii_m=np.array([radius_m]),
        nominal=SimpleNamespace(metadata=SimpleNamespace(mirror=None)),
    )
    mirror = SimpleNamespace(
        normal_in_root=np.array([0.0, 0.0, 1.0]),
        up_in_root=np.array([0.0, -1.0, 0.0]),
        right_in_root=np.array([1.0, 0.0, 0.0]),
        center_in_root_m=np.array([0.0, 0.0, DISTANCE_M]),
        width_m=width_m,
        height_m=0.5,
    )
    scene = Scene(np.eye(4)[None], CORNERS[None], np.array([[0.0, 0.0, 1.0]]), np.array([[at]]))
    sight = look(setting, scene, mirror)
    assert sight.board[0]
    np.testing.assert_allclose(sight.foot[0], [0.0, 0.0, DISTANCE_M])
    return bool(sight.markers[0, 0])


@pytest.mark.parametrize(("gap_m", "seen"), [(0.011, True), (0.009, False), (-0.011, False)])
def test_a_ball_that_reaches_into_the_glass_is_not_seen(gap_m: float, seen: bool) -> None:
    assert ball_is_seen((0.05, 0.0, DISTANCE_M - gap_m), 0.01) == seen


@pytest.mark.parametrize(("share", "seen"), [(1.05, True), (0.95, False)])
def test_a_ball_needs_its_least_diameter_in_the_picture(share: float, seen: bool) -> None:
    # The ball's image stands 0.7 m away, straight ahead.
    radius_m = share * LEAST_BALL_PX * 0.7 / (2.0 * FOCAL_PX)
    assert ball_is_seen((0.0, 0.0, 0.3), radius_m) == seen


@pytest.mark.parametrize(("x_m", "seen"), [(0.14, True), (0.17, False)])
def test_a_ball_is_seen_within_the_mirrors_inner_part_only(x_m: float, seen: bool) -> None:
    # From 0.3 m before the camera's plane: the light meets the glass at 0.5/0.7 of x. The mirror ends 0.125 m from its
    # middle, of which 6 % of its width are kept free, and the ball's radius.
    assert 0.5 / 0.7 * 0.14 < 0.125 - 0.06 * 0.25 - 0.005 < 0.5 / 0.7 * 0.17
    assert ball_is_seen((x_m, 0.0, 0.3), 0.005, width_m=0.25) == seen
