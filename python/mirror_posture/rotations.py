"""Rotations: URDF's angles, and rotation vectors; reflections."""

from __future__ import annotations

import math

import numpy as np

from .arrays import Floats

NEARLY_X = 0.8
"""From this x component on an axis is tilted against y (the vocabulary's convention of `axis_tilt`)."""


def rotation_of_rpy(rpy_rad: Floats) -> Floats:
    """`Rz(yaw) Ry(pitch) Rx(roll)`, URDF's fixed-axis angles."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy_rad), np.sin(rpy_rad)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def rpy_of_rotation(rotation: Floats) -> Floats:
    """Roll, pitch and yaw of a rotation; at a pitch of ±90° the roll is 0."""
    across = math.hypot(rotation[0, 0], rotation[1, 0])
    pitch = math.atan2(-rotation[2, 0], across)
    if across < 1e-9:
        return np.array([0.0, pitch, math.atan2(-rotation[0, 1], rotation[1, 1])])
    return np.array(
        [math.atan2(rotation[2, 1], rotation[2, 2]), pitch, math.atan2(rotation[1, 0], rotation[0, 0])]
    )


def nearest_rpy(rotation: Floats, near_rpy_rad: Floats) -> Floats:
    """Of the equivalent angles of a rotation, (r, p, y) and (r + π, π − p, y + π), those that are nearest
    to given ones."""
    roll, pitch, yaw = rpy_of_rotation(rotation)
    both = np.array([[roll, pitch, yaw], [roll + math.pi, math.pi - pitch, yaw + math.pi]])
    both -= 2.0 * math.pi * np.round((both - near_rpy_rad) / (2.0 * math.pi))
    nearest: Floats = both[int(np.argmin(np.abs(both - near_rpy_rad).sum(axis=1)))]
    return nearest


def rotation_of_vector(vector_rad: Floats) -> Floats:
    """The rotations (…, 3, 3) by the length of vectors (…, 3) about them (Rodrigues)."""
    angle = np.linalg.norm(vector_rad, axis=-1)[..., None, None]
    k = cross_matrix(vector_rad)
    # sinc and its half-angle form are exact at 0.
    out: Floats = np.eye(3) + np.sinc(angle / np.pi) * k + 0.5 * np.sinc(0.5 * angle / np.pi) ** 2 * (k @ k)
    return out


def tilt_directions(axis: Floats) -> tuple[Floats, Floats]:
    """The two directions across a unit axis a in which it is tilted, `u = unit(a × e)`, `v = a × u`, e = x, or y where |a_x| ≥ 0.8 (docs/effects.md)."""
    e = np.array([0.0, 1.0, 0.0]) if abs(axis[0]) >= NEARLY_X else np.array([1.0, 0.0, 0.0])
    u = np.cross(axis, e)
    u /= np.linalg.norm(u)
    return u, np.cross(axis, u)


def reflected(points_m: Floats, normal: Floats, offset_m: float | Floats) -> Floats:
    """Where ideal mirrors `n·x = d` show points (…, 3); normals (…, 3) and offsets (…) are broadcast."""
    behind_m = np.asarray(offset_m) - (points_m * normal).sum(axis=-1)
    image: Floats = points_m + 2.0 * behind_m[..., None] * normal
    return image


def cross_matrix(vector: Floats) -> Floats:
    """The matrices (…, 3, 3) of x ↦ v × x for vectors v (…, 3)."""
    out: Floats = np.cross(vector[..., None, :], np.eye(3)).swapaxes(-1, -2)
    return out


def pose_of(vector_rad: Floats, shift_m: Floats) -> Floats:
    """The motion (4, 4) of a rotation vector (3,) and a shift (3,)."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation_of_vector(vector_rad), shift_m
    return out
