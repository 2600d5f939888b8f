"""Fisheyes against OpenCV's, and camera files of other tools: each is read as the camera that it says, or refused by name."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from mirror_posture import Camera, MirrorPostureError
from mirror_posture.session.camera_info import dump_camera_info, load_camera_info

MATRIX = np.array([[412.5, 0.0, 640.2], [0.0, 413.1, 361.7], [0.0, 0.0, 1.0]])
FISHEYE = (-0.021, 0.0113, -0.0067, 0.0012)
RADTAN = (-0.28, 0.09, 0.001, -0.0008)
SIZE = (1280, 720)
FOCAL, CENTRE = (412.5, 413.1), (640.2, 361.7)


def fisheye() -> Camera:
    return Camera(SIZE, FOCAL, CENTRE, "equidistant", FISHEYE)


def test_a_fisheye_is_opencvs() -> None:
    rng = np.random.default_rng(1)
    rays = np.column_stack([rng.uniform(-2.5, 2.5, (200, 2)), np.ones(200)])
    expected, jacobian = cv2.fisheye.projectPoints(
        rays.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), MATRIX, np.array(FISHEYE)
    )
    pixels = fisheye().project(rays)
    np.testing.assert_allclose(pixels, expected.reshape(-1, 2), atol=1e-9)
    assert np.isfinite(jacobian).all()
    back = fisheye().unproject(pixels)
    np.testing.assert_allclose(back, rays / np.linalg.norm(rays, axis=1, keepdims=True), atol=1e-10)
    undistorted = cv2.fisheye.undistortPoints(
        pixels.reshape(-1, 1, 2), MATRIX, np.array(FISHEYE), criteria=(cv2.TERM_CRITERIA_COUNT, 50, 0.0)
    )
    np.testing.assert_allclose(back[:, :2] / back[:, 2:], undistorted.reshape(-1, 2), atol=1e-6)


def test_a_fisheye_is_never_taken_for_a_pinhole() -> None:
    with pytest.raises(MirrorPostureError, match="equidistant"):
        _ = fisheye().opencv_distortion
    with pytest.raises(MirrorPostureError, match="equidistant"):
        Camera(SIZE, FOCAL, CENTRE, "fov", (0.9,))
    assert Camera(SIZE, FOCAL, CENTRE, "equidistant", (0.0,) * 4).project([[1.0, 0.0, 1.0]])[
        0, 0
    ] == pytest.approx(640.2 + 412.5 * np.pi / 4.0)


def opencv_file(path: Path, lens: tuple[float, ...], **more: float) -> Path:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", SIZE[0])
    storage.write("image_height", SIZE[1])
    storage.write("camera_matrix", MATRIX)
    storage.write("distortion_coefficients", np.array(lens))
    for key, value in more.items():
        storage.write(key, value)
    storage.release()
    return path


def text_file(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


KALIBR = """cam0:
  cam_overlaps: []
  camera_model: pinhole
  distortion_coeffs: [{lens}]
  distortion_model: {model}
  intrinsics: [412.5, 413.1, 640.2, 361.7]
  resolution: [1280, 720]
  rostopic: /cam0/image_raw
"""
TOPIC = """header:
  stamp: {{sec: 3, nanosec: 5}}
  frame_id: camera
height: 720
width: 1280
distortion_model: {model}
d:
{lens}
k:
- 412.5
- 0.0
- 640.2
- 0.0
- 413.1
- 361.7
- 0.0
- 0.0
- 1.0
binning_x: 0
binning_y: 0
roi: {{x_offset: 0, y_offset: 0, height: 0, width: 0, do_rectify: false}}
---
"""


def kalibr(model: str, lens: tuple[float, ...]) -> str:
    return KALIBR.format(model=model, lens=", ".join(map(str, lens)))


def topic(model: str, lens: tuple[float, ...]) -> str:
    return TOPIC.format(model=model, lens="\n".join(f"- {k}" for k in lens))


@pytest.mark.parametrize("ending", ["yaml", "xml"])
def test_opencvs_files_are_read(tmp_path: Path, ending: str) -> None:
    camera = load_camera_info(opencv_file(tmp_path / f"c.{ending}", (*RADTAN, 0.03)))
    assert (camera.size_px, camera.focal_px, camera.center_px) == (SIZE, FOCAL, CENTRE)
    assert (camera.distortion_model, camera.distortion) == ("plumb_bob", (*RADTAN, 0.03))
    wide = load_camera_info(opencv_file(tmp_path / f"w.{ending}", FISHEYE, fisheye_model=1))
    assert wide == fisheye()


@pytest.mark.parametrize(
    ("text", "model", "lens"),
    [
        (kalibr("equidistant", FISHEYE), "equidistant", FISHEYE),
        (kalibr("radtan", RADTAN), "plumb_bob", (*RADTAN, 0.0)),
        # Of a chain of cameras one that is not the first, cut out.
        (kalibr("radtan", RADTAN).replace("cam0", "cam1"), "plumb_bob", (*RADTAN, 0.0)),
        (topic("equidistant", FISHEYE), "equidistant", FISHEYE),
        (topic("plumb_bob", (*RADTAN, 0.0)), "plumb_bob", (*RADTAN, 0.0)),
        (
            topic("plumb_bob", (*RADTAN, 0.0)).replace("height: 0, width: 0", "height: 720, width: 1280"),
            "plumb_bob",
            (*RADTAN, 0.0),
        ),
        (dump_camera_info(fisheye()), "equidistant", FISHEYE),
    ],
)
def test_kalibrs_and_ros_files_are_read(
    tmp_path: Path, text: str, model: str, lens: tuple[float, ...]
) -> None:
    camera = load_camera_info(text_file(tmp_path / "camera.yaml", text))
    assert (camera.size_px, camera.focal_px, camera.center_px) == (SIZE, FOCAL, CENTRE)
    assert (camera.distortion_model, camera.distortion) == (model, lens)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (kalibr("equidistant", FISHEYE).replace("pinhole", "omni"), "pinhole"),
        (kalibr("fov", (0.9,)), "distortion_model"),
        ("cam3: 1\n", "cam3: got a int, needed the keys of a Kalibr camera"),
        (
            kalibr("radtan", RADTAN) + KALIBR.format(model="none", lens="").replace("cam0", "cam1"),
            "2 cameras",
        ),
        (topic("equidistant", FISHEYE[:3]), "needed 4"),
        (topic("plumb_bob", RADTAN).replace("binning_x: 0", "binning_x: 2"), "binning"),
        (topic("plumb_bob", RADTAN).replace("x_offset: 0", "x_offset: 8"), "roi"),
        (topic("plumb_bob", RADTAN).replace("y_offset: 0", "y_offset: 8"), "roi"),
        (topic("plumb_bob", RADTAN).replace("width: 0", "width: 640"), "roi"),
        (topic("plumb_bob", RADTAN).replace("height: 0", "height: 360"), "roi"),
        ("%YAML:1.0\n---\ncamera_matrix: 3\n", "OpenCV"),
        ("%YAML:1.0\n---\n[[[", "OpenCV"),
    ],
)
def test_what_is_not_such_a_camera_is_refused(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(MirrorPostureError, match=said):
        load_camera_info(text_file(tmp_path / "camera.yaml", text))
