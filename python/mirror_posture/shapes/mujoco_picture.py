"""Pictures by MuJoCo's own renderer, with a reflecting plane in front of the robot's camera.

The renderer has neither lenses nor glass: the lens is applied afterwards, the mirror is a front-surface
one. Needs an OpenGL: set MUJOCO_GL to egl or osmesa on a machine without a screen.
"""

from __future__ import annotations

import functools
import math
import os
import subprocess
import sys
from typing import Any

import cv2
import mujoco
import numpy as np
import numpy.typing as npt

from .._core import MirrorPostureError
from ..arrays import Floats
from ..robots.nominal import Nominal

MIRROR = "mirror_posture:mirror"
CAMERA = "mirror_posture:camera"
FINER = 2
"""Rendered pixels a picture's pixel, each way, before the lens is put on; fewer for a preview."""
EDGE_SAMPLES = 8
BORDER_PX = 4
"""Margin of the rendered picture beyond what the lens sees."""
WALL = "mirror_posture:wall"
MIRROR_HALF_M = (0.6, 0.6)
WALL_HALF_M = 6.0
WALL_BEHIND_M = 1.5
"""From the mirror to the wall behind the robot."""
PAINT = {"value": 0.85, "saturation": 0.94}
SHEET_M = 0.0005
"""Thickness of the printed sheet; its dark squares are raised by an invisible amount."""
INK_M = 1e-5
PROBE_TIMEOUT_S = 60.0


@functools.cache
def opengl_is_there() -> bool:
    """Whether MuJoCo can render here, tried in a separate process, because a failing OpenGL may end the
    process."""
    # The OpenGL was chosen when MuJoCo was first imported; the present value of MUJOCO_GL may be too late.
    backend = getattr(getattr(mujoco, "GLContext", None), "__module__", "").rpartition(".")[2]
    if not backend:
        return False
    environment = {**os.environ, "MUJOCO_GL": backend}
    probe = "import mujoco; mujoco.Renderer(mujoco.MjModel.from_xml_string('<mujoco/>'), 16, 16).close()"
    try:
        done = subprocess.run(
            [sys.executable, "-c", probe], capture_output=True, timeout=PROBE_TIMEOUT_S, env=environment
        )
    except (OSError, subprocess.TimeoutExpired):
        return False
    return done.returncode == 0


def dress(
    spec: mujoco.MjSpec,
    nominal: Nominal,
    mirror_half_m: tuple[float, float] = MIRROR_HALF_M,
    finer: int = FINER,
    edge_samples: int = EDGE_SAMPLES,
) -> None:
    """Gives a model board, balls, camera and mirror as the nominal session has them; raises `MirrorPostureError`.

    `mirror_half_m` are half the mirror's width and height; `finer` and `edge_samples` as of `MirrorRenderer`.
    """
    metadata, camera = nominal.metadata, nominal.camera
    if camera is None or metadata.board is None or metadata.board.pattern != "chessboard":
        raise MirrorPostureError(
            f"{nominal.folder}: rendered pictures need a camera and a [board] of the pattern 'chessboard'"
        )
    for marker in metadata.markers:
        body = _body(spec, marker.link)
        for own in body.geoms:
            spec.delete(own)
        rgba = [*marker.rgb(PAINT["saturation"], PAINT["value"]), 1.0]
        paint = spec.add_material(name=f"mirror_posture:{marker.name}", rgba=rgba)
        paint.emission, paint.specular, paint.shininess = 0.45, 0.0, 0.0
        ball = body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.5 * marker.diameter_m, 0, 0])
        ball.material, ball.contype, ball.conaffinity, ball.mass = paint.name, 0, 0, 0.0
    _print_board(spec, nominal)
    width, height, focal = _pinhole(nominal, finer)
    spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
    spec.visual.quality.offsamples = edge_samples
    spec.visual.quality.shadowsize = 0
    spec.visual.headlight.ambient = [0.55, 0.55, 0.55]
    spec.visual.headlight.diffuse = [0.4, 0.4, 0.4]
    spec.visual.headlight.specular = [0.0, 0.0, 0.0]
    spec.visual.map.znear, spec.visual.map.zfar = 0.005, 20.0
    spec.stat.extent, spec.stat.center = 1.0, [0.0, 0.0, 0.0]
    eye = _body(spec, str(metadata.camera_link)).add_camera(name=CAMERA)
    # MuJoCo's cameras look along −z with y up: the optical frame, half turned about x.
    eye.quat = [0.0, 1.0, 0.0, 0.0]
    eye.fovy = math.degrees(2.0 * math.atan(0.5 * height / focal))
    silver = spec.add_material(name=MIRROR, rgba=[0.0, 0.0, 0.0, 1.0])
    silver.reflectance, silver.specular, silver.emission = 1.0, 0.0, 0.0
    # A light wall behind the robot: before a black room a ball's rim keeps its hue, and its outline is found too large.
    paint = spec.add_material(name=WALL, rgba=[0.62, 0.62, 0.6, 1.0])
    paint.emission, paint.specular = 0.6, 0.0
    for name, kind, size in (
        (MIRROR, mujoco.mjtGeom.mjGEOM_PLANE, [*mirror_half_m, 0.1]),
        (WALL, mujoco.mjtGeom.mjGEOM_BOX, [WALL_HALF_M, WALL_HALF_M, 0.01]),
    ):
        # Turned slightly, so that MuJoCo does not take its frame for the world's permanently: it is moved for
        # each picture.
        geom = spec.worldbody.add_geom(
            name=name, type=kind, size=size, pos=[1.0, 0.0, 0.0], quat=[0.7, 0.1, 0.7, 0.1]
        )
        geom.material, geom.contype, geom.conaffinity = name, 0, 0


def _body(spec: mujoco.MjSpec, link: str) -> mujoco.MjsBody:
    body = spec.body(link)
    if body is None:
        raise MirrorPostureError(
            f"rendered pictures: the MuJoCo model has no body {link!r}; it has {', '.join(b.name for b in spec.bodies[1:])}"
        )
    return body


def _print_board(spec: mujoco.MjSpec, nominal: Nominal) -> None:
    board = nominal.metadata.board
    assert board is not None
    body = _body(spec, board.link)
    for own in body.geoms:
        spec.delete(own)
    for name, grey in (("paper", 0.92), ("ink", 0.04)):
        material = spec.add_material(name=f"mirror_posture:{name}", rgba=[grey, grey, grey, 1.0])
        material.emission, material.specular = 0.3, 0.0
    across, down, side = board.columns + 1, board.rows + 1, board.square_m

    def tile(x: float, y: float, half: list[float], z: float, material: str) -> None:
        geom = body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=half, pos=[x, y, z])
        geom.material, geom.contype, geom.conaffinity, geom.mass = f"mirror_posture:{material}", 0, 0, 0.0

    margin = 0.8 * side
    half_sheet = [0.5 * across * side + margin, 0.5 * down * side + margin, 0.5 * SHEET_M]
    tile(0.0, 0.0, half_sheet, -0.5 * SHEET_M, "paper")
    for iy in range(down):
        for ix in range(across):
            if (ix + iy) % 2 == 0:  # the square diagonally beyond corner 0 is dark
                x, y = (ix - 0.5 * (across - 1)) * side, (iy - 0.5 * (down - 1)) * side
                tile(x, y, [0.5 * side, 0.5 * side, 0.5 * INK_M], 0.5 * INK_M, "ink")


def _pinhole(nominal: Nominal, finer: int) -> tuple[int, int, float]:
    """Width, height and focal length (px) of a centred pinhole picture that holds all that the lens sees."""
    camera = nominal.camera
    assert camera is not None
    focal = finer * max(camera.fx_px, camera.fy_px)
    rays = np.abs(_rays(nominal, finer).reshape(-1, 2)).max(axis=0)
    width, height = (2 * math.ceil(focal * ray + BORDER_PX) for ray in rays)
    return width, height, focal


def _rays(nominal: Nominal, finer: int) -> Floats:
    """Directions (H·finer, W·finer, 2) of a finer picture's pixels, as x/z and y/z, through the lens."""
    camera = nominal.camera
    assert camera is not None
    u, v = ((np.arange(size * finer) + 0.5) / finer - 0.5 for size in (camera.width_px, camera.height_px))
    pixels = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 1, 2)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-7)
    # OpenCV 4 has the variant with criteria under a different name.
    iterated: Any = getattr(cv2, "undistortPointsIter", cv2.undistortPoints)
    rays = iterated(
        pixels,
        cameraMatrix=camera.matrix_px,
        distCoeffs=camera.opencv_distortion,
        R=np.eye(3),
        P=np.eye(3),
        criteria=criteria,
    )
    return np.asarray(rays, dtype=np.float64).reshape(camera.height_px * finer, camera.width_px * finer, 2)


class MirrorRenderer:
    """Renders a dressed model from its robot's camera; `finer` rendered pixels a picture's pixel, each way, as it was dressed for."""

    def __init__(self, model: mujoco.MjModel, nominal: Nominal, finer: int = FINER) -> None:
        width, height, focal = _pinhole(nominal, finer)
        camera = nominal.camera
        assert camera is not None
        self._size = (camera.width_px, camera.height_px)
        rays = _rays(nominal, finer)
        self._map_u = (focal * rays[..., 0] + 0.5 * (width - 1)).astype(np.float32)
        self._map_v = (focal * rays[..., 1] + 0.5 * (height - 1)).astype(np.float32)
        self._model = model
        self._mirror, self._wall = model.geom(MIRROR).id, model.geom(WALL).id
        try:
            self._renderer = mujoco.Renderer(model, height, width)
        except Exception as error:  # what a missing OpenGL raises depends on the platform
            raise MirrorPostureError(
                f"MuJoCo cannot render here ({error}); set MUJOCO_GL to egl or osmesa, or look by traced pictures or pixels"
            ) from None

    def picture(
        self, data: mujoco.MjData, mirror_center_m: Floats, mirror_normal: Floats
    ) -> npt.NDArray[np.uint8]:
        """The camera's picture, BGR, with the mirror's centre there (m, world) and its normal away from the robot."""
        # The plane faces the robot: its z axis is the other way.
        z = -mirror_normal
        helper = np.array([0.0, 0.0, 1.0]) if abs(z[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
        x = np.cross(helper, z)
        x /= np.linalg.norm(x)
        quat = np.zeros(4)
        mujoco.mju_mat2Quat(quat, np.column_stack([x, np.cross(z, x), z]).reshape(9))
        self._model.geom_pos[[self._mirror, self._wall]] = (
            mirror_center_m,
            mirror_center_m + WALL_BEHIND_M * z,
        )
        self._model.geom_quat[[self._mirror, self._wall]] = quat
        mujoco.mj_forward(self._model, data)
        self._renderer.update_scene(data, camera=CAMERA)
        fine = cv2.remap(self._renderer.render(), self._map_u, self._map_v, cv2.INTER_LINEAR)
        small = cv2.resize(fine, self._size, interpolation=cv2.INTER_AREA)
        return np.ascontiguousarray(small[..., ::-1])

    def close(self) -> None:
        """Frees the OpenGL context."""
        self._renderer.close()
