"""The camera's file: intrinsics as ROS `camera_info` YAML."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from .._core import MirrorPostureError
from ..arguments import checked_arguments
from ..camera import Camera
from ..input_files import parse_yaml, read_text, reason
from .errors import SessionError, choices

COEFFICIENT_NAMES = {
    "plumb_bob": ("k1", "k2", "p1", "p2", "k3"),
    "rational_polynomial": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
}
"""Coefficients of the lens models that are read, in the file's (ROS and OpenCV) order."""


@checked_arguments
def load_camera_info(file: str | os.PathLike[str], shown_as: str | None = None) -> Camera:
    """Reads and validates a ROS `camera_info` YAML file.

    `shown_as` is the file's name in error messages. Raises `SessionError` for a file that is missing, is no YAML,
    lacks a key or holds a number that cannot be meant.
    """
    file = Path(file)
    name = shown_as or str(file)
    try:
        text = read_text(file)
    except FileNotFoundError:
        raise SessionError(name, "the file is missing; save the camera's ROS camera_info there") from None
    except (OSError, UnicodeDecodeError) as error:
        raise SessionError(
            name, f"cannot be read ({reason(error)}); needed a ROS camera_info YAML file"
        ) from None
    try:
        tree = parse_yaml(text, "a ROS camera_info file")
    except ValueError as error:
        raise SessionError(name, str(error)) from None
    if not isinstance(tree, Mapping):
        raise SessionError(name, f"got a {type(tree).__name__}, needed the keys of a ROS camera_info file")

    width, height = (_size(name, tree, key) for key in ("image_width", "image_height"))
    matrix = _numbers(name, tree, "camera_matrix")
    if len(matrix) != 9:
        raise SessionError(name, f"camera_matrix: got {len(matrix)} numbers, needed 9 (3 rows of 3)")
    fx, skew, cx, m10, fy, cy, m20, m21, m22 = matrix
    if not (fx > 0.0 and fy > 0.0):
        raise SessionError(
            name, f"camera_matrix: got focal lengths {fx:g} and {fy:g} px, needed both above 0"
        )
    if skew or m10 or m20 or m21 or m22 != 1.0:
        raise SessionError(name, "camera_matrix: needed [fx, 0, cx, 0, fy, cy, 0, 0, 1] (no skew)")
    model, coefficients = _lens(name, tree)
    camera_name = tree.get("camera_name", "camera")
    try:
        return Camera((width, height), (fx, fy), (cx, cy), model, coefficients, str(camera_name))
    except MirrorPostureError as error:
        raise SessionError(name, str(error)) from None


@checked_arguments
def dump_camera_info(camera: Camera) -> str:
    """The camera as ROS `camera_info` YAML; `load_camera_info` reads the same numbers back."""

    def block(rows: int, columns: int, data: list[float]) -> dict[str, Any]:
        return {"rows": rows, "cols": columns, "data": data}

    (fx, fy), (cx, cy) = camera.focal_px, camera.center_px
    model, coefficients = camera.distortion_model, list(camera.distortion)
    if model == "none":
        # ROS has no lens without a model.
        model, coefficients = "plumb_bob", [0.0] * 5
    tree = {
        "image_width": camera.width_px,
        "image_height": camera.height_px,
        "camera_name": camera.name,
        "camera_matrix": block(3, 3, [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]),
        "distortion_model": model,
        "distortion_coefficients": block(1, len(coefficients), coefficients),
        "rectification_matrix": block(3, 3, [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]),
        "projection_matrix": block(3, 4, [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]),
    }
    return yaml.safe_dump(tree, sort_keys=False, allow_unicode=True)


def _lens(name: str, tree: Mapping[Any, Any]) -> tuple[str, tuple[float, ...]]:
    model = tree.get("distortion_model")
    if not isinstance(model, str) or model not in COEFFICIENT_NAMES:
        raise SessionError(
            name, f"distortion_model: got {model!r}, needed one of {choices(COEFFICIENT_NAMES)}"
        )
    coefficients = _numbers(name, tree, "distortion_coefficients")
    needed = len(COEFFICIENT_NAMES[model])
    # OpenCV writes 4 coefficients of a plumb_bob lens (k3 = 0) and pads a rational_polynomial one to 12 or 14 with zeros.
    if model == "plumb_bob" and len(coefficients) == 4:
        coefficients.append(0.0)
    if len(coefficients) > needed and not any(coefficients[needed:]):
        coefficients = coefficients[:needed]
    if len(coefficients) != needed:
        raise SessionError(
            name,
            f"distortion_coefficients: got {len(coefficients)} numbers, needed {needed} for {model}: "
            f"{choices(COEFFICIENT_NAMES[model])}",
        )
    return model, tuple(coefficients)


def _size(name: str, tree: Mapping[Any, Any], key: str) -> int:
    value = tree.get(key)
    if isinstance(value, bool) or not isinstance(value, int) or not 0 < value < 1_000_000:
        raise SessionError(
            name, f"{key}: got {value!r}, needed the picture's size, a whole number of px above 0"
        )
    return value


def _numbers(name: str, tree: Mapping[Any, Any], key: str) -> list[float]:
    """The `data` list of a matrix entry (a bare list is taken too), as finite numbers."""
    entry = tree.get(key)
    data = entry.get("data") if isinstance(entry, Mapping) else entry
    if not isinstance(data, list):
        raise SessionError(name, f"{key}: needed `{key}: {{rows, cols, data: [...]}}`")
    numbers = []
    for position, value in enumerate(data):
        try:
            # YAML 1.1 reads 1e-3 (no dot) as text.
            number = float(value) if isinstance(value, (int, float, str)) else math.nan
        except (ValueError, OverflowError):
            number = math.nan
        if isinstance(value, bool) or not math.isfinite(number):
            raise SessionError(name, f"{key}, number {position + 1}: got {value!r}, needed a finite number")
        numbers.append(number)
    return numbers
