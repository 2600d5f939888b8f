"""The true light path: camera, mirror (flat, behind glass, or curved), board corners and the outlines of
balls.

Nothing is linearised and no virtual-camera formula is used: a pane is traced by Snell's law, shooting for
the ray that
arrives; a curved mirror by Fermat's principle, searching the shortest path over its surface. A ball's image
is the centroid of its traced outline. Points (N, 3) m in the true camera's optical frame.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

OUTLINE_POINTS = 24
NEWTON_STEPS = 30


@dataclass
class Lens:
    """A real lens: focal lengths and centre in px, distortion k1, k2, p1, p2, k3, and a shear of the rows."""

    focal_px: Array
    center_px: Array
    distortion: Array
    size_px: tuple[int, int]
    shear: float = 0.0

    def image(self, direction: Array, focal_factor: Array | float = 1.0) -> Array:
        """Pixels (…, 2) of light that comes from `direction` (…, 3); NaN behind the camera."""
        with np.errstate(divide="ignore", invalid="ignore"):
            x, y = direction[..., 0] / direction[..., 2], direction[..., 1] / direction[..., 2]
        x, y = np.where(direction[..., 2] > 0, x, np.nan), np.where(direction[..., 2] > 0, y, np.nan)
        k1, k2, p1, p2, k3 = self.distortion
        s = x * x + y * y
        radial = 1 + s * (k1 + s * (k2 + s * k3))
        u = x * radial + 2 * p1 * x * y + p2 * (s + 2 * x * x)
        v = y * radial + p1 * (s + 2 * y * y) + 2 * p2 * x * y
        px = np.stack([u, v], axis=-1) * self.focal_px * np.asarray(focal_factor)[..., None] + self.center_px
        px[..., 0] += self.shear * (px[..., 1] - self.center_px[1])
        result: Array = px
        return result


@dataclass
class Mirror:
    """One mirror for each row: unit normals away from the camera (N, 3), distances (N,), and what it is
    made of."""

    normal: Array
    distance_m: Array
    glass_m: float = 0.0
    refractive_index: float = 1.52
    curvature_per_m: Array = field(default_factory=lambda: np.zeros(2))
    """Along the two directions across the normal; positive is concave as the camera sees it."""

    def rows(self, index: NDArray[np.int_]) -> Mirror:
        return Mirror(
            self.normal[index],
            self.distance_m[index],
            self.glass_m,
            self.refractive_index,
            self.curvature_per_m,
        )


def apparent(mirror: Mirror, point: Array) -> Array:
    """The direction in which the camera at the origin sees `point` in the mirror: (N, 3), direction times optical
    path length."""
    if mirror.glass_m > 0:
        return _through_glass(mirror, point)
    # Flat, without glass: the law of reflection divides the path in the ratio of the perpendicular distances.
    height = mirror.distance_m - np.einsum("ni,ni->n", mirror.normal, point)
    result: Array = point + 2 * height[:, None] * mirror.normal
    # No light comes from behind a mirror, but a hypothesis may put a point there: the law of the flat one continues every other, for the
    # nearer to the mirror, the less its shape matters.
    if np.any(mirror.curvature_per_m):
        in_front = np.flatnonzero(height > _sag_beside(mirror, point))
        if len(in_front):
            result[in_front] = _off_curved(mirror.rows(in_front), point[in_front])
    return result


def _through_glass(mirror: Mirror, point: Array) -> Array:
    """Shoot for the sine of the angle of incidence at which the ray, bent into the pane and back, meets the
    point."""
    n = mirror.normal
    camera_height = mirror.distance_m
    point_height = camera_height - np.einsum("ni,ni->n", n, point)
    across = point - np.einsum("ni,ni->n", n, point)[:, None] * n
    reach = np.linalg.norm(across, axis=1)
    air, glass, index = camera_height + point_height, 2 * mirror.glass_m, mirror.refractive_index
    sine = reach / np.hypot(reach, air + glass)
    for _ in range(NEWTON_STEPS):
        outside, inside = np.sqrt(1 - sine**2), np.sqrt(1 - (sine / index) ** 2)
        miss = air * sine / outside + glass * (sine / index) / inside - reach
        slope = air / outside**3 + glass / index / inside**3
        step = miss / slope
        sine = np.clip(sine - step, 0.0, 0.999999)
        if np.max(np.abs(step), initial=0.0) < 1e-15:
            break
    safe = np.where(reach > 0, reach, 1.0)[:, None]
    cosine = np.sqrt(1 - sine**2)
    direction = sine[:, None] * across / safe + cosine[:, None] * n
    inside = np.sqrt(1 - (sine / index) ** 2)
    length = air / cosine + glass * index / inside
    result: Array = direction * length[:, None]
    return result


def _across(normal: Array) -> tuple[Array, Array]:
    """Two unit vectors across each normal, the first as near to the camera's x axis as can be."""
    first = np.array([1.0, 0.0, 0.0]) - normal[:, :1] * normal
    first /= np.linalg.norm(first, axis=1)[:, None]
    return first, np.cross(normal, first)


def _off_curved(mirror: Mirror, point: Array) -> Array:
    """Fermat: the point of the mirror's surface over which the path is stationary, by Newton's steps in two
    unknowns.

    The surface is a paraboloid-like cap with principal curvatures, whose sag is exact for a sphere.
    """
    n, d = mirror.normal, mirror.distance_m[:, None]
    e1, e2 = _across(n)
    c1, c2 = mirror.curvature_per_m
    height = mirror.distance_m - np.einsum("ni,ni->n", n, point)
    share = (mirror.distance_m / (mirror.distance_m + height))[:, None]
    guess = share * (point + 2 * height[:, None] * n) - d * n
    s, t = np.einsum("ni,ni->n", guess, e1), np.einsum("ni,ni->n", guess, e2)

    for _ in range(NEWTON_STEPS):
        # Sag of a sphere (or of a torus' cap): towards the camera for a concave mirror, away from its vertex.
        at, (sag_s, sag_t) = _on_cap(d * n, n, e1, e2, (c1, c2), s, t)
        along_s, along_t = e1 - sag_s[:, None] * n, e2 - sag_t[:, None] * n
        gs, gt = np.zeros_like(s), np.zeros_like(t)
        a, b, e = np.zeros_like(s), np.zeros_like(s), np.zeros_like(s)
        for leg in (at, at - point):
            length = _lengths(leg)
            unit = leg / length[:, None]
            us, ut, un = (np.einsum("ni,ni->n", unit, v) for v in (along_s, along_t, n))
            gs, gt = gs + us, gt + ut
            # The cap's own second derivatives are c1 and c2 to second order in its slope: enough for the steps.
            a += (1 + sag_s**2 - us**2) / length - un * c1
            b += (sag_s * sag_t - us * ut) / length
            e += (1 + sag_t**2 - ut**2) / length - un * c2
        determinant = a * e - b * b
        ds, dt = (e * gs - b * gt) / determinant, (a * gt - b * gs) / determinant
        # Near the mirror the path is a cone over its surface, on which whole steps would leave it: none is longer than half of the
        # shorter leg.
        nearest = np.minimum(_lengths(at), _lengths(at - point))
        shorter = np.minimum(1.0, 0.5 * nearest / np.maximum(np.hypot(ds, dt), 1e-300))
        ds, dt = shorter * ds, shorter * dt
        s, t = s - ds, t - dt
        if max(np.max(np.abs(ds), initial=0.0), np.max(np.abs(dt), initial=0.0)) < 1e-13:
            break
    at = _on_cap(d * n, n, e1, e2, (c1, c2), s, t)[0]
    out, back = _lengths(at), _lengths(at - point)
    return at / out[:, None] * (out + back)[:, None]


def _sag_beside(mirror: Mirror, point: Array) -> Array:
    """By how much the mirror's surface beside each point is nearer to the camera than its tangent plane, m."""
    e1, e2 = _across(mirror.normal)
    s, t = np.einsum("ni,ni->n", point, e1), np.einsum("ni,ni->n", point, e2)
    vertex = mirror.distance_m[:, None] * mirror.normal
    on_cap = _on_cap(vertex, mirror.normal, e1, e2, (*mirror.curvature_per_m,), s, t)[0]
    result: Array = mirror.distance_m - np.einsum("ni,ni->n", mirror.normal, on_cap)
    return result


def _lengths(v: Array) -> Array:
    result: Array = np.sqrt(np.einsum("ni,ni->n", v, v))
    return result


def _on_cap(
    vertex: Array, n: Array, e1: Array, e2: Array, curvature: tuple[float, float], s: Array, t: Array
) -> tuple[Array, tuple[Array, Array]]:
    """Points of the cap over (s, t), and its slopes along the two directions."""
    c1, c2 = curvature
    root = np.sqrt(1 - (c1 * s) ** 2 - (c2 * t) ** 2)
    sag = (c1 * s * s + c2 * t * t) / (1 + root)
    slope_s = (2 * c1 * s + sag * c1 * c1 * s / root) / (1 + root)
    slope_t = (2 * c2 * t + sag * c2 * c2 * t / root) / (1 + root)
    return vertex + s[:, None] * e1 + t[:, None] * e2 - sag[:, None] * n, (slope_s, slope_t)


def ball_images(
    lens: Lens, mirror: Mirror, center: Array, radius_m: float, focal_factor: Array | float = 1.0
) -> Array:
    """Pixels (N, 2) of the centroids of the outlines of balls, as a detector of filled discs measures
    them."""
    seen = apparent(mirror, center)
    if radius_m <= 0:
        return lens.image(seen, focal_factor)
    away = np.linalg.norm(seen, axis=1)
    axis = seen / away[:, None]
    first = np.cross(axis, np.array([0.0, 1.0, 0.0]))
    first /= np.linalg.norm(first, axis=1)[:, None]
    second = np.cross(axis, first)
    # The cone that touches the ball: its circle of contact lies nearer than the centre.
    touch = away - radius_m**2 / away
    ring = radius_m * np.sqrt(1 - (radius_m / away) ** 2)
    angle = np.arange(OUTLINE_POINTS) * 2 * np.pi / OUTLINE_POINTS
    outline = (touch[:, None] * axis)[:, None] + ring[:, None, None] * (
        np.cos(angle)[None, :, None] * first[:, None] + np.sin(angle)[None, :, None] * second[:, None]
    )
    factor = np.broadcast_to(np.asarray(focal_factor, dtype=float), (len(center),))
    px = lens.image(outline, np.repeat(factor[:, None], OUTLINE_POINTS, axis=1))
    following = np.roll(px, -1, axis=1)
    cross = px[..., 0] * following[..., 1] - following[..., 0] * px[..., 1]
    result: Array = ((px + following) * cross[..., None]).sum(axis=1) / (3 * cross.sum(axis=1))[:, None]
    return result
