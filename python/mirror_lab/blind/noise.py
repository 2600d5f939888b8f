"""Measurement noise of the blind check: white, coloured, heavy-tailed, and gross outliers."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Noise:
    """One session's noise: standard deviations in px, one axis, and how it departs from white and normal."""

    corner_px: float
    blob_px: float
    neighbour_correlation: float = 0.0
    """Between neighbouring corners of one frame."""
    time_correlation: float = 0.0
    """Between a marker's errors in successive frames."""
    tail_dof: float = 0.0
    """Student's degrees of freedom of the blobs; 0 is normal."""
    outlier_fraction: float = 0.0

    def answer(self) -> dict[str, Any]:
        return asdict(self)


def draw_noise(rng: np.random.Generator, image_width: int, plain: bool = False) -> Noise:
    """Levels as a good detector has them; with `plain`, white and normal."""
    corner, blob = rng.uniform(0.08, 0.2), rng.uniform(0.12, 0.3)
    if plain:
        return Noise(corner, blob)
    return Noise(
        corner,
        blob,
        float(rng.uniform(0.1, 0.5)) if rng.random() < 0.4 else 0.0,
        float(rng.uniform(0.1, 0.4)) if rng.random() < 0.3 else 0.0,
        float(rng.uniform(4, 10)) if rng.random() < 0.4 else 0.0,
        float(rng.choice([0.002, 0.005, 0.01])) if rng.random() < 0.35 else 0.0,
    )


def _first_order(white: Array, correlation: float, axis: int) -> Array:
    """Stationary first-order correlation along an axis, variance kept."""
    if correlation == 0:
        return white
    moved = np.moveaxis(white, axis, 0).copy()
    for i in range(1, len(moved)):
        moved[i] = correlation * moved[i - 1] + np.sqrt(1 - correlation**2) * moved[i]
    return np.moveaxis(moved, 0, axis)


def corner_errors(noise: Noise, rng: np.random.Generator, frames: int, corners: tuple[int, int]) -> Array:
    """(F, C, 2) px, correlated along rows and columns of the board."""
    nx, ny = corners
    white = rng.normal(size=(frames, ny, nx, 2))
    white = _first_order(_first_order(white, noise.neighbour_correlation, 1), noise.neighbour_correlation, 2)
    return noise.corner_px * white.reshape(frames, nx * ny, 2)


def blob_errors(noise: Noise, rng: np.random.Generator, frames: int, markers: int) -> Array:
    """(F, M, 2) px, correlated in time, with the tails of Student's distribution scaled to the same
    variance."""
    if noise.tail_dof > 2:
        white = rng.standard_t(noise.tail_dof, (frames, markers, 2)) / np.sqrt(
            noise.tail_dof / (noise.tail_dof - 2)
        )
    else:
        white = rng.normal(size=(frames, markers, 2))
    return noise.blob_px * _first_order(white, noise.time_correlation, 0)


def add_outliers(noise: Noise, rng: np.random.Generator, px: Array) -> Array:
    """Marker blobs (F, M, 2) of which a fraction sits 4 to 40 px off."""
    hit = rng.random(px.shape[:2]) < noise.outlier_fraction
    angle, size = rng.uniform(0, 2 * np.pi, hit.shape), np.exp(rng.uniform(np.log(4), np.log(40), hit.shape))
    shift = np.stack([np.cos(angle), np.sin(angle)], axis=-1) * size[..., None]
    return np.where(hit[..., None], px + shift, px)
