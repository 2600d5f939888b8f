"""Pictures by Mitsuba 3 (extra `blind`): a path tracer that nobody here wrote, with a real pane of glass silvered behind.

The pane is a dielectric front and a perfect conductor behind it, so that ghosts of the front face are there as Fresnel
has them; curved mirrors are a conducting sphere or cylinder. Lengths are mm with the origin at the mirror: in single
precision, metres from the camera shift corners by 0.09 px. Mitsuba's camera is a pinhole: it is rendered larger and
finer, and the lens is laid over it by `cv2.remap`.
"""

from __future__ import annotations

import colorsys
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from .drawing import (
    BALL_SATURATION,
    BALL_VALUE,
    GAMMA,
    INK,
    MARGIN_SQUARES,
    PAPER,
    WALL,
    View,
    marker_hue_deg,
    rays,
)
from .errors import BlindError
from .optics import Lens, _across
from .robots import Robot

Array = NDArray[np.float64]

FINER = 1.5
"""Pixels of the pinhole's picture over those of the lens'."""
PATHS_A_PIXEL = 48
DEEPEST = 8
TEXELS_A_SQUARE = 16
HALF_SIDE_MM = 3000.0
BACKDROP_MM = 4000.0
AMBIENT, LAMP = 0.15, 2.4


def draw(robot: Robot, lens: Lens, view: View, frame: int, paths: int = PATHS_A_PIXEL) -> Array:
    """A frame's picture (H, W, 3), linear RGB, as `pictures.draw` gives it.

    Raises BlindError where Mitsuba is not installed, and for a bent board, which it cannot draw.
    """
    if view.warp_per_m:
        raise BlindError("Mitsuba's rectangle cannot be a bent board: draw this one with `--renderer own`")
    mi = _mitsuba()
    width, height = lens.size_px
    rows, columns = np.mgrid[0:height, 0:width]
    px = np.column_stack([columns.ravel(), rows.ravel()]).astype(float)
    direction = rays(lens, px, float(view.focal_factor[frame]))
    tangent = (direction[:, :2] / direction[:, 2:]).reshape(height, width, 2)
    half = np.abs(tangent).max(axis=(0, 1)) * 1.02
    focal = FINER * float(lens.focal_px.mean())
    size = np.ceil(2 * half * focal).astype(int)
    scene = mi.load_dict(_scene(mi, robot, view, frame, size, focal, paths))
    pinhole = np.array(mi.render(scene))[..., :3].astype(np.float32)
    place = (tangent * focal + (size - 1) / 2).astype(np.float32)
    # Each pixel of the lens is the mean over FINER² of the pinhole's.
    smooth = cv2.GaussianBlur(pinhole, (0, 0), 0.3 * FINER)
    return cv2.remap(smooth, place[..., 0], place[..., 1], cv2.INTER_CUBIC).astype(float)


def _mitsuba() -> Any:
    try:
        import mitsuba as mi
    except ModuleNotFoundError as error:
        raise BlindError(
            "`--renderer mitsuba` needs Mitsuba 3: pip install 'mirror-posture[blind]'"
        ) from error
    mi.set_variant("scalar_rgb")
    return mi


def _scene(
    mi: Any, robot: Robot, view: View, frame: int, size: NDArray[np.int_], focal_px: float, paths: int
) -> dict[str, Any]:
    n, d = view.mirror.normal[frame], float(view.mirror.distance_m[frame])
    origin = d * n

    def mm(point: Array) -> Array:
        result: Array = 1e3 * (point - origin)
        return result

    def placed(turn: Array, at_mm: Array, scale: tuple[float, float, float] = (1, 1, 1)) -> Any:
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = turn * np.array(scale), at_mm
        return mi.ScalarTransform4f(matrix)

    eye = mm(np.zeros(3))
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": DEEPEST},
        "light": {"type": "constant", "radiance": {"type": "rgb", "value": [AMBIENT] * 3}},
        "sensor": {
            "type": "perspective",
            "fov": float(np.degrees(2 * np.arctan(size[0] / 2 / focal_px))),
            "fov_axis": "x",
            "near_clip": 1.0,
            "far_clip": 1e5,
            "to_world": mi.ScalarTransform4f().look_at(
                origin=list(eye), target=list(eye + np.array([0, 0, 1.0])), up=[0, -1, 0]
            ),
            "film": {
                "type": "hdrfilm",
                "width": int(size[0]),
                "height": int(size[1]),
                "rfilter": {"type": "box"},
                "pixel_format": "rgb",
                "component_format": "float32",
            },
            "sampler": {"type": "independent", "sample_count": paths, "seed": frame},
        },
        # The background in the mirror: a grey wall behind the robot.
        "wall": {
            "type": "rectangle",
            "to_world": placed(np.eye(3), eye - np.array([0, 0, BACKDROP_MM]), (2e4, 2e4, 1)),
            "bsdf": _diffuse([WALL] * 3),
        },
        "board": {
            "type": "rectangle",
            "to_world": placed(
                view.board_rotation[frame], mm(view.board_m[frame]), _board_half_mm(robot, view)
            ),
            "bsdf": {"type": "diffuse", "reflectance": _print(mi, robot)},
        },
    }
    count = len(robot.markers)
    for k in range(count):
        hue = marker_hue_deg(k, count) / 360
        paint = np.array(colorsys.hsv_to_rgb(hue, BALL_SATURATION, BALL_VALUE)) ** GAMMA
        scene[f"ball_{k}"] = {
            "type": "sphere",
            "center": list(mm(view.balls_m[frame, k])),
            "radius": 500 * robot.marker_diameter_m,
            "bsdf": _diffuse(list(paint)),
        }
    first = _across(n[None])[0][0]
    for side in (-1, 1):
        # Lamps as points close before the mirror: each board or ball sees them without the pane, so without noise.
        scene[f"lamp_{side + 1}"] = {
            "type": "point",
            "position": list(1e3 * d * (0.8 * side * first - 0.1 * n)),
            "intensity": {"type": "rgb", "value": [LAMP * (1e3 * d) ** 2] * 3},
        }
    return scene | _mirror(view, n, placed)


def _diffuse(rgb: list[float]) -> dict[str, Any]:
    return {"type": "diffuse", "reflectance": {"type": "rgb", "value": [float(v) for v in rgb]}}


def _mirror(view: View, n: Array, placed: Any) -> dict[str, Any]:
    """The pane, the bare silver, or the curved mirror, with its front's foot at the origin."""
    first, second = (v[0] for v in _across(n[None]))
    silver = {"type": "twosided", "bsdf": {"type": "conductor", "material": "none"}}
    towards = np.column_stack([first, -second, -n])
    c1, c2 = view.mirror.curvature_per_m
    wide = (HALF_SIDE_MM, HALF_SIDE_MM, 1.0)
    if c1 == c2 == 0:
        glass_mm = 1e3 * view.mirror.glass_m
        back = {"type": "rectangle", "to_world": placed(towards, glass_mm * n, wide), "bsdf": silver}
        if glass_mm == 0:
            return {"silver": back}
        pane = {"type": "dielectric", "int_ior": view.mirror.refractive_index, "ext_ior": 1.0}
        front = {"type": "rectangle", "to_world": placed(towards, np.zeros(3), wide), "bsdf": pane}
        return {"front": front, "silver": back}
    # A concave mirror's centre lies on the camera's side of its vertex.
    if c1 == c2:
        return {
            "silver": {
                "type": "sphere",
                "center": list(-1e3 / c1 * n),
                "radius": abs(1e3 / c1),
                "bsdf": silver,
            }
        }
    curved, axis = (c1, second) if c1 else (c2, first)
    middle = -1e3 / curved * n
    return {
        "silver": {
            "type": "cylinder",
            "p0": list(middle - HALF_SIDE_MM * axis),
            "p1": list(middle + HALF_SIDE_MM * axis),
            "radius": abs(1e3 / curved),
            "bsdf": silver,
        }
    }


def _board_half_mm(robot: Robot, view: View) -> tuple[float, float, float]:
    nx, ny = robot.board_corners
    half = 500 * view.square_m
    return half * (nx + 1 + 2 * MARGIN_SQUARES), half * (ny + 1 + 2 * MARGIN_SQUARES), 1.0


def _print(mi: Any, robot: Robot) -> dict[str, Any]:
    """The printed face: the first row of the texture is at the smallest y."""
    nx, ny = robot.board_corners
    squares = np.full((ny + 3, nx + 3), PAPER, dtype=np.float32)
    i, j = np.meshgrid(np.arange(nx + 1), np.arange(ny + 1))
    squares[1:-1, 1:-1] = np.where((i + j) % 2 == 0, INK, PAPER)
    face = np.kron(squares, np.ones((TEXELS_A_SQUARE, TEXELS_A_SQUARE), dtype=np.float32))
    rgb = np.ascontiguousarray(np.repeat(face[..., None], 3, axis=2))
    return {"type": "bitmap", "bitmap": mi.Bitmap(rgb), "filter_type": "nearest", "raw": True}
