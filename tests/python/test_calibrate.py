"""Calibration from Python: batches in, named results out; pictures by OpenCV's projection, which shares no code with the core."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mirror_posture import Board, Camera, MirrorPostureError
from mirror_posture.calibrate import calibrate_from_mirror_views, calibrate_with_second_camera

K = np.array([[693.0, 0.0, 399.5], [0.0, 693.0, 299.5], [0.0, 0.0, 1.0]])
LENS = np.array([-0.1, 0.03, 5e-4, -3e-4, 0.0])
CHEST = Board(7, 5, 0.014)
STAND = Board(9, 6, 0.02)
NOISE_PX = 0.1


def camera() -> Camera:
    return Camera((800, 600), (693.0, 693.0), (399.5, 299.5), "plumb_bob", list(LENS))


def places(board: Board) -> np.ndarray:
    nx, ny = board.corners
    ix, iy = np.meshgrid(np.arange(nx), np.arange(ny))
    grid = np.stack([ix - (nx - 1) / 2, iy - (ny - 1) / 2, np.zeros_like(ix)], axis=-1)
    return grid.reshape(-1, 3) * board.square_m


def pose(rotation_vector: list[float], translation: list[float]) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3] = cv2.Rodrigues(np.array(rotation_vector))[0]
    out[:3, 3] = translation
    return out


def picture(points_in_camera: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    pixels = cv2.projectPoints(points_in_camera, np.zeros(3), np.zeros(3), K, LENS)[0].reshape(-1, 2)
    return pixels + rng.normal(0.0, NOISE_PX, pixels.shape)


def moved(a_from_b: np.ndarray, points: np.ndarray) -> np.ndarray:
    return points @ a_from_b[:3, :3].T + a_from_b[:3, 3]


CAMERA_FROM_CHEST = pose([0.03, -0.05, 0.04], [0.004, 0.075, -0.006])


def mirror_views(angles_deg: list[tuple[float, float]], rng: np.random.Generator) -> np.ndarray:
    views = []
    for yaw, pitch in np.radians(angles_deg):
        n = np.array([np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)])
        points = moved(CAMERA_FROM_CHEST, places(CHEST))
        views.append(picture(points + 2.0 * (0.15 - points @ n)[:, None] * n, rng))
    return np.stack(views)


def test_a_cross_of_views_gives_the_transform() -> None:
    rng = np.random.default_rng(1)
    views = mirror_views([(0, 0), (-15, 0), (15, 0), (0, 15), (0, -15), (8, 8)], rng)
    views[2, 5:9] = np.nan  # corners that were not seen
    views[4] += rng.normal(0.0, 5.0, views[4].shape)  # a view that is no board
    found = calibrate_from_mirror_views(camera(), CHEST, views)
    assert found.views.tolist() == [0, 1, 2, 3, 5]
    assert list(found.reasons) == [4] and "grid is wrong" in found.reasons[4]
    np.testing.assert_allclose(found.camera_from_board[:3, 3], CAMERA_FROM_CHEST[:3, 3], atol=0.0015)
    assert found.corner_std_px == pytest.approx(NOISE_PX, rel=0.15)
    assert found.determined and found.warning is None and found.weak_direction is None
    np.testing.assert_allclose(found.offsets_m, 0.15, atol=0.001)
    assert np.linalg.eigvalsh(found.covariance).min() > 0.0


def test_yaw_alone_is_warned_about_in_words() -> None:
    found = calibrate_from_mirror_views(
        camera(), CHEST, mirror_views([(0, 0), (-10, 0), (10, 0), (5, 0)], np.random.default_rng(2))
    )
    assert found.warning is not None and "pitch" in found.warning
    assert found.weak_direction is not None and found.weak_direction.motion == "translation"
    assert str(found.weak_direction).startswith("translation along the board's") and "mm" in str(
        found.weak_direction
    )


def test_a_second_camera_gives_the_transform() -> None:
    rng = np.random.default_rng(3)
    robot, second, chest = [], [], []
    for _ in range(5):
        camera_from_stand = pose([0.25, 0.9, *rng.uniform(-0.2, 0.2, 1)], [-0.06, 0.02, 0.35])
        second_from_camera = np.linalg.inv(
            pose([*rng.uniform(-0.05, 0.05, 1), -2.25, 0.0], [0.33, 0.0, 0.42])
        )
        robot.append(picture(moved(camera_from_stand, places(STAND)), rng))
        second.append(picture(moved(second_from_camera @ camera_from_stand, places(STAND)), rng))
        chest.append(picture(moved(second_from_camera @ CAMERA_FROM_CHEST, places(CHEST)), rng))
    pictures = {
        "stand_in_robot_camera_px": np.stack(robot),
        "stand_in_second_camera_px": np.stack(second),
        "chest_in_second_camera_px": np.stack(chest),
    }
    found = calibrate_with_second_camera(camera(), camera(), CHEST, STAND, **pictures)
    np.testing.assert_allclose(found.camera_from_board[:3, 3], CAMERA_FROM_CHEST[:3, 3], atol=0.001)
    assert found.degrees_of_freedom == 24 and found.chi_squared < 52.0
    assert found.snapshot_camera_from_board.shape == (5, 4, 4)
    # Five snapshots are better than any one of them.
    assert (np.diagonal(found.snapshot_covariances, axis1=1, axis2=2) > np.diagonal(found.covariance)).all()
    pictures["chest_in_second_camera_px"] = pictures["chest_in_second_camera_px"][:4]
    with pytest.raises(MirrorPostureError, match="same number of each"):
        calibrate_with_second_camera(camera(), camera(), CHEST, STAND, **pictures)


def test_what_cannot_be_calibrated_says_why() -> None:
    rng = np.random.default_rng(4)
    views = mirror_views([(0, 0), (-15, 0)], rng)
    with pytest.raises(MirrorPostureError, match=r"mirror views.*got 2, needed 3"):
        calibrate_from_mirror_views(camera(), CHEST, views)
    with pytest.raises(MirrorPostureError, match="go together"):
        calibrate_from_mirror_views(camera(), CHEST, views, nominal_camera_from_board=np.eye(4))
    with pytest.raises(MirrorPostureError, match="corners_px"):
        calibrate_from_mirror_views(camera(), CHEST, views[:, :30])
    prior = calibrate_from_mirror_views(
        camera(),
        CHEST,
        views,
        nominal_camera_from_board=CAMERA_FROM_CHEST,
        nominal_covariance=np.eye(6) * 1e-6,
    )
    assert prior.determined and prior.views.tolist() == [0, 1]
