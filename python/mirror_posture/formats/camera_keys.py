"""The camera's file, ROS `camera_info`: every key that is read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from .keys import LARGEST, Text, Whole

LARGEST_SIDE_PX = 999_999
WIDTH = Whole(name="image_width", what="Of the picture.", unit="px", at_least=1, at_most=LARGEST_SIDE_PX)
HEIGHT = Whole(name="image_height", what="Of the picture.", unit="px", at_least=1, at_most=LARGEST_SIDE_PX)
CAMERA_NAME = Text(name="camera_name", what="A name for people.", default="camera")
MATRIX = "`{rows: 3, cols: 3, data: [fx, 0, cx, 0, fy, cy, 0, 0, 1]}`, or the bare list: focal lengths and principal point."
MODEL = "The lens model."
COEFFICIENTS = "`{rows: 1, cols: N, data: [...]}`, or the bare list, in OpenCV's order; more than the model has may follow as zeros."
NOT_IN_A_SCHEMA = (
    "focal lengths that are written as text (`1e3`, which YAML 1.1 reads as text) and are not above 0",
    "a lens that maps two directions to one pixel",
    "YAML that is too deep, or has aliases",
)
"""What the reader refuses beyond the schema."""

_NUMBER = {
    "anyOf": [
        {"type": "number", "minimum": -LARGEST, "maximum": LARGEST},
        {"type": "string", "pattern": r"^\s*[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?\s*$"},
    ]
}
_ABOVE_0 = {"allOf": [_NUMBER, {"if": {"type": "number"}, "then": {"exclusiveMinimum": 0.0}}]}


def document_schema(coefficients_of: Mapping[str, Sequence[str]]) -> dict[str, Any]:
    """The whole file as JSON Schema; `coefficients_of` names the coefficients of each lens model."""
    zero, one = {"enum": [0, "0", "0.0"]}, {"enum": [1, "1", "1.0"]}
    rows = [_ABOVE_0, zero, _NUMBER, zero, _ABOVE_0, _NUMBER, zero, zero, one]
    models = []
    for model, names in coefficients_of.items():
        least = 4 if model == "plumb_bob" else len(names)
        data = {"type": "array", "prefixItems": [_NUMBER] * len(names), "items": zero, "minItems": least}
        models.append(
            {
                "properties": {
                    "distortion_model": {"const": model},
                    "distortion_coefficients": _matrix(data, f"{COEFFICIENTS} {model}: {', '.join(names)}."),
                }
            }
        )
    matrix = {"type": "array", "prefixItems": rows, "minItems": 9, "maxItems": 9}
    return {
        "type": "object",
        "properties": {
            WIDTH.name: {"description": WIDTH.what, **WIDTH.schema()},
            HEIGHT.name: {"description": HEIGHT.what, **HEIGHT.schema()},
            CAMERA_NAME.name: {"description": CAMERA_NAME.what},
            "camera_matrix": _matrix(matrix, MATRIX),
            "distortion_model": {"description": MODEL, "enum": list(coefficients_of)},
        },
        "required": [
            "image_width",
            "image_height",
            "camera_matrix",
            "distortion_model",
            "distortion_coefficients",
        ],
        "anyOf": models,
    }


def _matrix(data: dict[str, Any], what: str) -> dict[str, Any]:
    block = {"type": "object", "properties": {"data": data}, "required": ["data"]}
    return {"description": what, "anyOf": [block, data]}
