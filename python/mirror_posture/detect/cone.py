"""The cone of rays that touch a sphere, fitted to edge points of its outline.

Unit rays r of the outline satisfy `r · a = cos γ`, a the direction of the sphere's centre, γ its half angle; divided by cos γ it is linear,
`r · w = 1` with w = a / cos γ. The sphere's centre projects where a points, which is not the outline's centroid. A sphere in a flat mirror is
a sphere (the reflected one), so the same holds; the pane's glass changes the cone by less than 0.05 px.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ..camera import Camera
from ..short_repr import ShortRepr
from .gate import undistort
from .outline import INLIER_PX, MIN_EDGE_POINTS, Circle
from .types import Ellipse, FloatArray

OUTLINE_SAMPLES = 72
# Steps of the robust refit: inliers are chosen again from the last fit.
REFITS = 6
# Edges that are uncertain themselves (low contrast, noise) may lie this many of their deviations off.
INLIER_DEVIATIONS = 2.5


@dataclass(frozen=True, eq=False, repr=False)
class OutlineFit(ShortRepr):
    """A fitted outline: its centroid and ellipse in the picture, the sphere's centre, and how well the edges agree.

    `inlier` `(N,)` tells which edge points belong to it; `arc_fraction` is the share of the outline that they cover.
    """

    centroid_px: FloatArray
    centroid_covariance_px2: FloatArray
    sphere_center_px: FloatArray
    ellipse: Ellipse
    boundary_px: FloatArray
    mean_radius_px: float
    inlier: np.ndarray
    arc_fraction: float
    residual_rms_px: float
    blur_px: float = 0.0


def fit_outline(
    points: FloatArray,
    std_px: FloatArray,
    start: Circle,
    camera: Camera,
    rays: int,
    correlation_rays: float = 1.0,
) -> OutlineFit | None:
    """Robust weighted fit of a ball's outline to edge points `(N, 2)` px, started from a circle.

    `rays` is the count of all rays cast, `correlation_rays` how many neighbours share an error at least.
    """
    if len(points) < MIN_EDGE_POINTS:
        return None
    rows = unit_rays(points, camera)
    target = np.ones(len(points))
    inlier = np.abs(np.linalg.norm(points - start.center_px, axis=1) - start.radius_px) <= 2.0 * INLIER_PX
    weight = 1.0 / std_px
    parameters = np.zeros(3)
    distance = np.zeros(len(points))
    for _ in range(REFITS):
        if inlier.sum() < MIN_EDGE_POINTS:
            return None
        scaled = rows[inlier] * weight[inlier, None]
        parameters, _, rank, _ = np.linalg.lstsq(scaled, target[inlier] * weight[inlier], rcond=None)
        if rank < 3:
            return None
        away = _distances_px(rows, parameters, camera.mean_focal_px)
        if away is None:
            return None
        distance = away
        chosen = _agreeing(distance, std_px)
        if (chosen == inlier).all():
            break
        inlier = chosen
    if inlier.sum() < MIN_EDGE_POINTS:
        return None
    rms = float(np.sqrt(np.mean(distance[inlier] ** 2)))
    freedom = max(int(inlier.sum()) - 3, 1)
    whitened = distance[inlier] * weight[inlier]
    variance = float(np.sum(whitened**2)) / freedom * max(_correlation_factor(whitened), correlation_rays)
    gradient = _distance_gradient(rows[inlier], parameters, camera.mean_focal_px) * weight[inlier, None]
    normal = gradient.T @ gradient
    if not np.isfinite(normal).all() or np.linalg.cond(normal) > 1e14:
        return None
    covariance = variance * np.linalg.inv(normal)
    boundary = _boundary(parameters, camera)
    if boundary is None:
        return None
    centroid = _polygon_centroid(boundary)
    jacobian = np.empty((2, 3))
    for column in range(3):
        step = 1e-5 * max(float(np.linalg.norm(parameters)), 1e-6)
        shifted = parameters.copy()
        shifted[column] += step
        moved = _boundary(shifted, camera)
        if moved is None:
            return None
        jacobian[:, column] = (_polygon_centroid(moved) - centroid) / step
    return OutlineFit(
        centroid_px=centroid,
        centroid_covariance_px2=jacobian @ covariance @ jacobian.T,
        sphere_center_px=project_rays(parameters[None], camera)[0],
        ellipse=_ellipse(boundary),
        boundary_px=boundary,
        mean_radius_px=float(np.sqrt(max(_polygon_area(boundary), 0.0) / np.pi)),
        inlier=inlier,
        arc_fraction=float(inlier.sum()) / max(rays, 1),
        residual_rms_px=rms,
    )


def _agreeing(distance: FloatArray, std_px: FloatArray) -> np.ndarray:
    """Edges within the tolerance, those beside a stray one left out: what hides the outline blurs its neighbours too."""
    near = np.abs(distance) <= np.maximum(INLIER_PX, INLIER_DEVIATIONS * std_px)
    stray = ~near
    beside = stray | np.roll(stray, 1) | np.roll(stray, -1)
    kept: np.ndarray = near & ~beside
    return kept if kept.sum() >= MIN_EDGE_POINTS else near


def _correlation_factor(residuals: FloatArray) -> float:
    """How much fewer independent edges there are than rays: 1 + 2 Σ of the residuals' autocorrelation along the outline, at least 1."""
    power = float(np.mean(residuals**2))
    if power <= 0.0:
        return 1.0
    factor = 1.0
    for lag in range(1, max(2, len(residuals) // 6)):
        correlation = float(np.mean(residuals * np.roll(residuals, lag))) / power
        if correlation <= 0.0:
            break
        factor += 2.0 * correlation
    return factor


def unit_rays(points: FloatArray, camera: Camera) -> FloatArray:
    """Unit ray directions `(N, 3)` of pixels in the camera frame."""
    ideal = undistort(points, camera)
    rays = np.column_stack([ideal, np.ones(len(ideal))]) @ np.linalg.inv(camera.matrix_px).T
    result: FloatArray = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    return result


def project_rays(rays: FloatArray, camera: Camera) -> FloatArray:
    """Pixels `(N, 2)` of ray directions in front of the camera."""
    pixels, _ = cv2.projectPoints(
        rays.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), camera.matrix_px, camera.opencv_distortion
    )
    return pixels.reshape(-1, 2).astype(np.float64)


def _distances_px(rows: FloatArray, parameters: FloatArray, focal_px: float) -> FloatArray | None:
    """Signed distance of each edge ray from the cone, positive outside, in px at the picture's middle."""
    length = float(np.linalg.norm(parameters))
    if length <= 1.0 or parameters[2] <= 0.0:
        return None
    angle = np.arccos(np.clip(rows @ parameters / length, -1.0, 1.0))
    result: FloatArray | None = (angle - np.arccos(1.0 / length)) * focal_px
    return result


def _distance_gradient(rows: FloatArray, parameters: FloatArray, focal_px: float) -> FloatArray:
    """Derivative of the distances by the three parameters, `(N, 3)`: of `f (acos(r·w / |w|) - acos(1 / |w|))`."""
    length = float(np.linalg.norm(parameters))
    along = rows @ parameters / length
    by_along = (rows - along[:, None] * (parameters / length)) / length
    sine = np.sqrt(np.maximum(1.0 - along**2, 1e-18))
    half_sine = np.sqrt(max(1.0 - 1.0 / length**2, 1e-18))
    result: FloatArray = focal_px * (-by_along / sine[:, None] - parameters / (length**3 * half_sine))
    return result


def _boundary(parameters: FloatArray, camera: Camera) -> FloatArray | None:
    """The outline in the picture as a polygon `(OUTLINE_SAMPLES, 2)`."""
    turn = np.arange(OUTLINE_SAMPLES) * (2.0 * np.pi / OUTLINE_SAMPLES)
    length = float(np.linalg.norm(parameters))
    if length <= 1.0:
        return None
    axis = parameters / length
    side = np.cross(axis, [0.0, 1.0, 0.0])
    side /= max(np.linalg.norm(side), 1e-12)
    other = np.cross(axis, side)
    sine = np.sqrt(max(1.0 - 1.0 / length**2, 0.0))
    rays = axis / length + sine * (np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * other)
    if np.any(rays[:, 2] <= 0.05):
        return None
    return project_rays(rays, camera)


def _polygon_area(polygon: FloatArray) -> float:
    following = np.roll(polygon, -1, axis=0)
    return 0.5 * abs(float(np.sum(polygon[:, 0] * following[:, 1] - polygon[:, 1] * following[:, 0])))


def _polygon_centroid(polygon: FloatArray) -> FloatArray:
    middle = polygon.mean(axis=0)
    local = polygon - middle
    following = np.roll(local, -1, axis=0)
    cross = local[:, 0] * following[:, 1] - local[:, 1] * following[:, 0]
    result: FloatArray = middle + ((local + following) * cross[:, None]).sum(axis=0) / (3.0 * cross.sum())
    return result


def _ellipse(boundary: FloatArray) -> Ellipse:
    """Half axes and angle from the boundary's moments: for an ellipse sampled evenly in its angle, axis² = 2 × variance."""
    center = boundary.mean(axis=0)
    values, vectors = np.linalg.eigh(np.cov((boundary - center).T, bias=True))
    half = np.sqrt(np.maximum(2.0 * values, 0.0))
    return Ellipse(
        (float(center[0]), float(center[1])),
        float(half[1]),
        float(half[0]),
        float(np.arctan2(vectors[1, 1], vectors[0, 1])),
    )
