"""The camera's file: intrinsics as ROS `camera_info` YAML; OpenCV's, Kalibr's and dumped topics are read too."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from ..arguments import checked_arguments
from ..camera import Camera
from ..input_files import parse_yaml, read_text, reason
from .camera_formats import (
    COEFFICIENT_NAMES,
    camera_of,
    from_kalibr,
    from_opencv,
    from_topic,
    is_kalibr,
    is_opencv,
    is_topic,
    numbers,
    whole,
)
from .errors import SessionError, choices


@checked_arguments
def load_camera_info(file: str | os.PathLike[str], shown_as: str | None = None) -> Camera:
    """Reads and validates a camera's file: ROS `camera_info` YAML, a dump of that topic, `cv2.FileStorage`'s YAML or XML, or Kalibr's camchain.

    `shown_as` is the file's name in error messages. Raises `SessionError` for a file that is missing, is no YAML,
    lacks a key or holds an invalid number.
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
    if is_opencv(text):
        return from_opencv(name, text)
    # A dumped topic ends with the line that separates messages.
    try:
        tree = parse_yaml(text.rstrip().removesuffix("\n---"), "a ROS camera_info file")
    except ValueError as error:
        raise SessionError(name, str(error)) from None
    if not isinstance(tree, Mapping):
        raise SessionError(name, f"got a {type(tree).__name__}, needed the keys of a ROS camera_info file")

    if is_kalibr(tree):
        return from_kalibr(name, tree)
    if is_topic(tree):
        return from_topic(name, tree)
    width, height = (whole(name, key, tree.get(key)) for key in ("image_width", "image_height"))
    matrix = numbers(name, "camera_matrix", tree.get("camera_matrix"), 9)
    model = tree.get("distortion_model")
    if not isinstance(model, str) or model not in COEFFICIENT_NAMES:
        raise SessionError(
            name, f"distortion_model: got {model!r}, needed one of {choices(COEFFICIENT_NAMES)}"
        )
    lens = numbers(name, "distortion_coefficients", tree.get("distortion_coefficients"))
    return camera_of(name, (width, height), matrix, model, lens, str(tree.get("camera_name", "camera")))


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
