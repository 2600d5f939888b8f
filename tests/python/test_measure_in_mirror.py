"""Mirrors and markers from Python against light traced in NumPy: the way of least time, no reflection formula."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from mirror_posture import Board, Camera, MirrorPostureError
from mirror_posture.mirror import ESTIMATORS, Rig, estimate_mirrors, planar_poses, virtual_rays
from mirror_posture.triangulate import TRIANGULATORS, triangulate, two_view_markers

SQUARE_M, FOCAL_PX = 0.014, 693.0
BOARD = Board(7, 5, SQUARE_M)
CENTER_PX = np.array([399.5, 299.5])
BOARD_M = np.array([0.004, 0.075, 0.01])
MARKER_M = np.array([0.06, 0.05, 0.03])


def traced_pixels(points_m: np.ndarray, at_m: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Pixels of real points seen in the mirror through `at_m` with two orthonormal edges."""
    pixels = []
    for point in points_m:

        def length(s: np.ndarray, point: np.ndarray = point) -> float:
            bounce = at_m + s @ edges
            return 1e3 * float(np.linalg.norm(bounce) + np.linalg.norm(bounce - point))

        best = minimize(length, [0.0, 0.0], method="BFGS", options={"gtol": 1e-9}).x
        sight = at_m + best @ edges
        pixels.append(FOCAL_PX * sight[:2] / sight[2] + CENTER_PX)
    return np.array(pixels)


def edges(yaw: float) -> np.ndarray:
    return np.array([[np.cos(yaw), 0.0, -np.sin(yaw)], [0.0, 1.0, 0.0]])


@pytest.fixture(scope="module")
def rig() -> Rig:
    camera_from_board = np.eye(4)
    camera_from_board[:3, 3] = BOARD_M
    return Rig(Camera((800, 600), (FOCAL_PX, FOCAL_PX), tuple(CENTER_PX)), BOARD, camera_from_board)


@pytest.fixture(scope="module")
def traced() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Corners (2, 35, 2) and marker (2, 2) px in two views, and the mirrors' normals."""
    iy, ix = np.divmod(np.arange(35), 7)
    corners = BOARD_M + np.column_stack([(ix - 3) * SQUARE_M, (iy - 2) * SQUARE_M, np.zeros(35)])
    at = np.array([0.0, 0.0, 0.16])
    seen = [
        (traced_pixels(corners, at, edges(y)), traced_pixels(MARKER_M[None], at, edges(y))[0])
        for y in (0.0, 0.25)
    ]
    normals = np.array([np.cross(*edges(y)) for y in (0.0, 0.25)])
    return np.array([s[0] for s in seen]), np.array([s[1] for s in seen]), normals


@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize("triangulator", TRIANGULATORS)
def test_finds_the_traced_mirrors_and_marker(rig, traced, estimator, triangulator):
    corners, marker, normals = traced
    mirrors = estimate_mirrors(rig, corners, estimator=estimator, noise_px=0.2)
    assert mirrors.valid.all() and mirrors.reasons == {}
    np.testing.assert_allclose(mirrors.normals, normals, atol=1e-4)
    assert (np.linalg.eigvalsh(mirrors.covariances_m2) > 0).all()
    found = triangulate(mirrors, [[0, 1]], marker[None], noise_px=0.2, triangulator=triangulator)
    assert found.valid.all()
    # The tracer's minimum is flat: it places the bounce to some micrometres.
    np.testing.assert_allclose(found.points_in_camera_m[0], MARKER_M, atol=1e-4)
    assert (np.linalg.eigvalsh(found.covariances_m2) > 0).all()


def test_rays_and_poses_agree_with_the_scene(rig, traced):
    corners, marker, _ = traced
    mirrors = estimate_mirrors(rig, corners, estimator="point_pair")
    rays = virtual_rays(mirrors, [0, 1, 0], np.vstack([marker, marker[:1]]), noise_px=0.2)
    offset = MARKER_M - rays.origins_m
    distance = np.linalg.norm(np.cross(offset, rays.directions), axis=1)
    assert distance.max() < 1e-5
    poses = planar_poses(rig.camera, BOARD, corners)
    # The first mirror is squarely before the camera: the board appears at 2 * 0.16 m less its own depth.
    np.testing.assert_allclose(
        poses.camera_from_pattern[0, :3, 3], [*BOARD_M[:2], 0.32 - BOARD_M[2]], atol=1e-5
    )
    bulk = two_view_markers(rig.camera, BOARD_M, poses.camera_from_pattern[None, :, :3, 3], marker[None])
    np.testing.assert_allclose(bulk.points_in_camera_m[0], MARKER_M, atol=2e-5)


def test_rows_without_a_result_are_masked_with_their_reason(rig, traced):
    corners, marker, _ = traced
    views = np.concatenate([corners, corners[:1]])
    views[2, 3:] = np.nan
    mirrors = estimate_mirrors(rig, views)
    assert mirrors.valid.tolist() == [True, True, False]
    assert "needed at least 4" in mirrors.reasons[2]
    assert np.isnan(mirrors.normals[2]).all()
    pixels = np.array([marker, [marker[0], marker[0]], marker, marker])
    found = triangulate(mirrors, [[0, 1], [0, 0], [0, 2], [0, -1]], pixels, noise_px=0.2)
    assert found.valid.tolist() == [True, False, False, False]
    assert "got 0.000°" in found.reasons[1] and "needed at least 1.000°" in found.reasons[1]
    assert "needed at least 4" in found.reasons[2]
    assert "needed 2" in found.reasons[3]
    assert np.isnan(found.points_in_camera_m[1:]).all()
    missing = views.copy()
    missing[0, [3, 17]] = np.nan
    assert estimate_mirrors(rig, missing).valid[0]


def test_bad_arguments_name_what_was_got_and_needed(rig, traced):
    corners, marker, _ = traced
    for call, message in [
        (
            lambda: estimate_mirrors(rig, corners[:, :30]),
            r"corners_px: got .*\[2, 30, 2\], needed \(N, 35, 2\)",
        ),
        (lambda: estimate_mirrors(rig, corners, estimator="best"), "pose, pose_snapped, point_pair, maximum"),
        (lambda: estimate_mirrors(rig, corners, noise_px=-1.0), "noise of a corner"),
        (lambda: Board(7, 5, -1.0), "side of a square above 0 m"),
        (lambda: Rig(rig.camera, BOARD, np.diag([1.0, 1, -1, 1])), "not a rigid transform"),
        (lambda: Rig(rig.camera, BOARD, np.eye(4), -np.eye(6)), "positive semi-definite"),
        (lambda: Rig(rig.camera, BOARD, np.eye(4), glass_thickness_m=3.0), "not millimetres"),
        (
            lambda: Camera((800, 600), (693, 693), (400, 300), "fisheye"),
            "none, plumb_bob, rational_polynomial",
        ),
        (lambda: Camera((800, 600), (693, 693), (400, 300), "plumb_bob", [0.1]), "got 1, needed 5"),
        (
            lambda: two_view_markers(rig.camera, BOARD_M, np.zeros((4, 2, 3)), np.zeros((3, 2, 2))),
            "got 3, needed 4",
        ),
    ]:
        with pytest.raises(MirrorPostureError, match=message):
            call()
    with pytest.raises(MirrorPostureError, match="mirror_rows"):
        triangulate(estimate_mirrors(rig, corners), [0, 1], marker[None], noise_px=0.2)
    # Every row with its own reason, none dropped.
    masked = two_view_markers(rig.camera, BOARD_M, np.broadcast_to(BOARD_M, (2, 2, 3)), np.zeros((2, 2, 2)))
    assert not masked.valid.any() and set(masked.reasons) == {0, 1}
