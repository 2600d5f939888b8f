"""Which balls a planned mirror shows: one camera, one mirror squarely before it, bounds worked out by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mirror_posture import Board, Camera
from mirror_posture.plan.hiding import unhidden
from mirror_posture.plan.sight import LEAST_BALL_PX, Scene, Sight, look

DISTANCE_M, FOCAL_PX = 0.5, 600.0
CORNERS = np.array([[x, y, 0.0] for y in (-0.03, 0.03) for x in (-0.04, 0.04)])


def looked(
    at: tuple[float, float, float], radius_m: float, width_m: float = 0.5, turned_rad: float = 0.0
) -> tuple[Any, Scene, Sight, Any]:
    """The camera is the base, and looks along z at a mirror 0.5 m away, whose middle is on the axis; the board faces it, but for a turn about x."""
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
    turn = np.array([1.0, np.cos(turned_rad), np.sin(turned_rad)])
    corners = CORNERS[:, [0, 1, 1]] * turn
    normal = np.array([[0.0, -np.sin(turned_rad), np.cos(turned_rad)]])
    scene = Scene(np.eye(4)[None], corners[None], normal, np.array([[at]]))
    sight = look(setting, scene, mirror)
    assert sight.board[0] or turned_rad
    return setting, scene, sight, mirror


def ball_is_seen(at: tuple[float, float, float], radius_m: float, width_m: float = 0.5) -> bool:
    return bool(looked(at, radius_m, width_m)[2].markers[0, 0])


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


@pytest.mark.parametrize(("degrees", "seen"), [(55.0, True), (65.0, False), (-65.0, False)])
def test_a_board_is_seen_unless_it_is_too_steep(degrees: float, seen: bool) -> None:
    sight = looked((0.0, 0.0, 0.3), 0.01, turned_rad=np.radians(degrees))[2]
    assert bool(sight.board[0]) == seen


class HalfPlane:
    """Hides what lies beyond an edge beside a ball straight ahead: on the way from the mirror, never on the camera's side of it."""

    def __init__(self, angle_rad: float, edge_m: float) -> None:
        self.across, self.edge_m = np.array([np.cos(angle_rad), np.sin(angle_rad), 0.0]), edge_m

    def hides(self, start: np.ndarray, way: np.ndarray, length_m: float, past_camera: bool = False) -> bool:
        end = start + length_m * way
        # The board lies at z = 0, the ball at 0.3 m.
        return not past_camera and end[2] > 0.1 and float(end @ self.across) > self.edge_m


@pytest.mark.parametrize(("edge_share", "directions"), [(0.75, 8), (0.3, 4), (-0.1, 0)])
def test_a_ball_needs_its_middle_and_three_of_four_points_of_its_rim(
    edge_share: float, directions: int
) -> None:
    # The four points lie 0.8 radii off the middle, in two directions across; between these, 0.57 radii off, lie two of them.
    radius_m = 0.01
    setting, scene, sight, mirror = looked((0.0, 0.0, 0.3), radius_m)
    seen = [
        unhidden(setting, HalfPlane(angle, edge_share * radius_m), scene, sight, mirror, 0)
        for angle in np.arange(8) * np.pi / 4.0
    ]
    assert sum(int(one[0]) for one in seen if one is not None) == directions
