"""Camera files of other tools as one `Camera`: OpenCV's YAML and XML, Kalibr's camchain, a dump of ROS's
topic.

A model other than a pinhole or equidistant camera of one picture size is refused with its name, never
replaced by a similar one.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .._core import MirrorPostureError
from ..camera import Camera
from .errors import SessionError, choices

COEFFICIENT_NAMES = {
    "plumb_bob": ("k1", "k2", "p1", "p2", "k3"),
    "rational_polynomial": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "equidistant": ("k1", "k2", "k3", "k4"),
}
"""Coefficients of the lens models that are read, in the file's (ROS and OpenCV) order."""

_KALIBR_MODELS = {"radtan": "plumb_bob", "equidistant": "equidistant", "none": "none"}
_OPENCV_MATRIX = ("camera_matrix", "cameraMatrix", "Camera_Matrix", "K", "intrinsic_matrix")
_OPENCV_LENS = (
    "distortion_coefficients",
    "distCoeffs",
    "Distortion_Coefficients",
    "dist_coeffs",
    "D",
    "distortion",
)


def is_opencv(text: str) -> bool:
    """Whether a text is one that `cv2.FileStorage` wrote: YAML with its own header, or XML."""
    return text.lstrip().startswith("%YAML:1") or "opencv-matrix" in text or "<opencv_storage" in text


def is_kalibr(tree: Mapping[Any, Any]) -> bool:
    """Whether a tree is Kalibr's camchain."""
    return bool(_kalibr_cameras(tree)) or ("camera_model" in tree and "intrinsics" in tree)


def _kalibr_cameras(tree: Mapping[Any, Any]) -> list[str]:
    """The names of a camchain's cameras; of one that was cut out of a chain the number need not be 0."""
    return [key for key in tree if isinstance(key, str) and re.fullmatch(r"cam\d+", key)]


def is_topic(tree: Mapping[Any, Any]) -> bool:
    """Whether a tree is a dump of `sensor_msgs/CameraInfo`."""
    return ("K" in tree or "k" in tree) and "width" in tree and "height" in tree


def from_opencv(name: str, text: str) -> Camera:
    """The camera of a text of `cv2.FileStorage`: matrix, coefficients, `image_width` and `image_height`; `fisheye_model: 1` for an equidistant one."""
    import cv2

    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        found = {key: storage.getNode(key) for key in storage.root().keys()}
        matrix = _opencv_matrix(name, found, _OPENCV_MATRIX, "camera matrix")
        lens = _opencv_matrix(name, found, _OPENCV_LENS, "distortion coefficients")
        width, height = _opencv_size(name, found)
        fisheye = "fisheye_model" in found and bool(found["fisheye_model"].real())
        model = found["distortion_model"].string() if "distortion_model" in found else ""
        storage.release()
    except (cv2.error, SystemError) as error:
        raise SessionError(name, f"is no YAML or XML that OpenCV reads ({str(error).strip()})") from None
    if len(matrix) != 9:
        raise SessionError(name, f"its camera matrix has {len(matrix)} numbers, needed 9 (3 rows of 3)")
    if not model:
        model = "equidistant" if fisheye else "rational_polynomial" if len(lens) > 5 else "plumb_bob"
    return camera_of(name, (width, height), matrix, model, lens)


def _opencv_matrix(name: str, found: Mapping[str, Any], keys: Sequence[str], what: str) -> list[float]:
    for key in keys:
        if key in found:
            matrix = found[key].mat()
            if matrix is not None:
                return [float(v) for v in np.asarray(matrix, dtype=np.float64).ravel()]
    raise SessionError(
        name, f"has no {what}; needed one of the matrices {choices(keys)}, got {choices(found)}"
    )


def _opencv_size(name: str, found: Mapping[str, Any]) -> tuple[int, int]:
    for width, height in (
        ("image_width", "image_height"),
        ("width", "height"),
        ("imageWidth", "imageHeight"),
    ):
        if width in found and height in found:
            return int(found[width].real()), int(found[height].real())
    for key in ("image_size", "imageSize", "image_Size"):
        if key in found and found[key].isSeq() and found[key].size() == 2:
            return int(found[key].at(0).real()), int(found[key].at(1).real())
    raise SessionError(
        name, "has no picture size; add image_width and image_height of the calibration's pictures, px"
    )


def from_kalibr(name: str, tree: Mapping[Any, Any]) -> Camera:
    """The camera of Kalibr's camchain, which must hold one: `pinhole` with `radtan`, `equidistant` or no distortion."""
    cameras = _kalibr_cameras(tree)
    if len(cameras) > 1:
        raise SessionError(
            name, f"holds {len(cameras)} cameras ({choices(cameras)}); keep only the one of the pictures"
        )
    entry = tree[cameras[0]] if cameras else tree
    if not isinstance(entry, Mapping):
        raise SessionError(
            name, f"{cameras[0]}: got a {type(entry).__name__}, needed the keys of a Kalibr camera"
        )
    if entry.get("camera_model") != "pinhole":
        raise SessionError(
            name,
            f"camera_model: got {entry.get('camera_model')!r}, needed 'pinhole' (calibrate with pinhole-radtan or pinhole-equi)",
        )
    said = entry.get("distortion_model")
    if said not in _KALIBR_MODELS:
        raise SessionError(name, f"distortion_model: got {said!r}, needed one of {choices(_KALIBR_MODELS)}")
    intrinsics = numbers(name, "intrinsics", entry.get("intrinsics"), 4)
    width, height = (whole(name, "resolution", v) for v in _pair(name, "resolution", entry.get("resolution")))
    fx, fy, cx, cy = intrinsics
    lens = [] if said == "none" else numbers(name, "distortion_coeffs", entry.get("distortion_coeffs"), 4)
    matrix = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]
    return camera_of(name, (width, height), matrix, _KALIBR_MODELS[said], lens)


def from_topic(name: str, tree: Mapping[Any, Any]) -> Camera:
    """The camera of a dumped `sensor_msgs/CameraInfo` (`ros2 topic echo --once`, `rostopic echo -n 1`), of whole pictures without binning."""
    for key in ("binning_x", "binning_y"):
        if tree.get(key, 0) not in (0, 1):
            raise SessionError(name, f"{key}: got {tree[key]!r}; needed pictures without binning")
    width, height = whole(name, "width", tree["width"]), whole(name, "height", tree["height"])
    roi = tree.get("roi")
    if isinstance(roi, Mapping) and (
        roi.get("x_offset")
        or roi.get("y_offset")
        or roi.get("width") not in (0, width, None)
        or roi.get("height") not in (0, height, None)
    ):
        raise SessionError(name, "roi: needed whole pictures, got a part of the sensor; record without it")
    matrix = numbers(name, "k", tree.get("k", tree.get("K")), 9)
    lens = numbers(name, "d", tree.get("d", tree.get("D")) or [])
    model = str(tree.get("distortion_model") or "plumb_bob")
    if not lens and model == "plumb_bob":
        # Drivers of ideal cameras leave them out.
        model = "none"
    return camera_of(name, (width, height), matrix, model, lens)


def camera_of(
    name: str,
    size_px: tuple[int, int],
    matrix: Sequence[float],
    model: str,
    coefficients: Sequence[float],
    camera_name: str = "camera",
) -> Camera:
    """A camera of a matrix (9 numbers), a lens' name and its coefficients, as files have them.

    Raises `SessionError` for a skewed matrix, an unknown lens or another number of coefficients than it has.
    """
    fx, skew, cx, m10, fy, cy, m20, m21, m22 = matrix
    if not (fx > 0.0 and fy > 0.0):
        raise SessionError(
            name, f"camera_matrix: got focal lengths {fx:g} and {fy:g} px, needed both above 0"
        )
    if skew or m10 or m20 or m21 or m22 != 1.0:
        raise SessionError(name, "camera_matrix: needed [fx, 0, cx, 0, fy, cy, 0, 0, 1] (no skew)")
    lens = list(coefficients)
    if model != "none":
        model, lens = _lens(name, model, lens)
    try:
        return Camera(size_px, (fx, fy), (cx, cy), model, tuple(lens), camera_name)
    except MirrorPostureError as error:
        raise SessionError(name, str(error)) from None


def _lens(name: str, model: str, lens: list[float]) -> tuple[str, list[float]]:
    if model not in COEFFICIENT_NAMES:
        raise SessionError(
            name, f"distortion_model: got {model!r}, needed one of {choices(COEFFICIENT_NAMES)}"
        )
    needed = len(COEFFICIENT_NAMES[model])
    # OpenCV writes 4 coefficients of a plumb_bob lens (k3 = 0) and pads a rational_polynomial one to 12 or 14 with zeros.
    if model == "plumb_bob" and len(lens) == 4:
        lens.append(0.0)
    if len(lens) > needed and not any(lens[needed:]):
        lens = lens[:needed]
    if len(lens) != needed:
        raise SessionError(
            name,
            f"distortion_coefficients: got {len(lens)} numbers, needed {needed} for {model}: {choices(COEFFICIENT_NAMES[model])}",
        )
    return model, lens


def numbers(name: str, key: str, entry: Any, needed: int | None = None) -> list[float]:
    """A list of finite numbers (the `data` of a matrix entry is taken too)."""
    data = entry.get("data") if isinstance(entry, Mapping) else entry
    if not isinstance(data, list):
        raise SessionError(
            name, f"{key}: needed a list of numbers (`{key}: {{rows, cols, data: [...]}}` in ROS's files)"
        )
    found = []
    for position, value in enumerate(data):
        try:
            # YAML 1.1 reads 1e-3 (no dot) as text.
            number = float(value) if isinstance(value, (int, float, str)) else math.nan
        except (ValueError, OverflowError):
            number = math.nan
        if isinstance(value, bool) or not math.isfinite(number):
            raise SessionError(name, f"{key}, number {position + 1}: got {value!r}, needed a finite number")
        found.append(number)
    if needed is not None and len(found) != needed:
        raise SessionError(name, f"{key}: got {len(found)} numbers, needed {needed}")
    return found


def _pair(name: str, key: str, value: Any) -> list[Any]:
    if not isinstance(value, list) or len(value) != 2:
        raise SessionError(name, f"{key}: got {value!r}, needed [width, height], px")
    return value


def whole(name: str, key: str, value: Any) -> int:
    """A side of the picture, px."""
    if isinstance(value, bool) or not isinstance(value, int) or not 0 < value < 1_000_000:
        raise SessionError(
            name, f"{key}: got {value!r}, needed the picture's size, a whole number of px above 0"
        )
    return value
