"""What is claimed along a lamp's light: drawn balls, whose light and outline are known."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from mirror_posture import Camera
from mirror_posture.detect.ball import Circle, OutlineFit, Start, measure_balls
from mirror_posture.detect.ghost_light import linear_light

SIZE_PX, FINE = 80, 6
CENTER_PX = (39.3, 40.6)
RADIUS_PX = 14.0


def drawn(lamp: float, seed: int = 3) -> npt.NDArray[np.uint8]:
    """A ball under even light from above the camera and a lamp (share 0..1) from the right. Linear light, blurred, with a
    sensor's noise, as sRGB levels (H, W, 3) BGR."""
    at = (np.arange(SIZE_PX * FINE) + 0.5) / FINE - 0.5
    x, y = (np.stack(np.meshgrid(at, at)) - np.reshape(CENTER_PX, (2, 1, 1))) / RADIUS_PX
    inside = x * x + y * y <= 1.0
    z = np.sqrt(np.clip(1.0 - x * x - y * y, 0.0, 1.0))
    light = (1.0 - lamp) * (0.8 + 0.2 * z) + lamp * 1.3 * np.maximum(0.9 * x + 0.436 * z, 0.0)
    picture = np.where(inside[..., None], light[..., None] * np.array([0.06, 0.14, 0.6]), 0.2)
    pixels = picture.reshape(SIZE_PX, FINE, SIZE_PX, FINE, 3).mean(axis=(1, 3))
    noise = np.random.default_rng(seed).normal(0.0, 1.0, pixels.shape) * np.sqrt(pixels / 6000.0)
    shown = np.clip(cv2.GaussianBlur(pixels, (0, 0), 0.6) + noise, 0.0, 1.0)
    levels = np.where(shown <= 0.0031308, 12.92 * shown, 1.055 * shown ** (1 / 2.4) - 0.055)
    return np.rint(255.0 * levels).astype(np.uint8)


def measured(bgr: npt.NDArray[np.uint8]) -> OutlineFit:
    camera = Camera((SIZE_PX, SIZE_PX), (900.0, 900.0), (39.5, 39.5))
    start = Start(Circle(np.array([40.0, 40.0]), 13.0), 10.0, 18.0)
    (fit,) = measure_balls(bgr, [start], camera)
    assert fit is not None
    return fit


def variances(lamp: float) -> npt.NDArray[np.float64]:
    """Mean claimed variances of the centre across and down, without the camera's curve, px²."""
    fits = [measured(drawn(lamp, seed=seed)) for seed in range(8)]
    own = [fit.centroid_covariance_px2 - np.outer(fit.curve_moved_px, fit.curve_moved_px) for fit in fits]
    return np.diagonal(np.mean(own, axis=0))


def test_a_lamp_widens_the_claim_along_its_light_and_soft_light_does_not() -> None:
    soft, lit = variances(0.0), variances(0.7)
    assert soft[0] / soft[1] == pytest.approx(1.0, abs=0.15)
    assert lit[0] > 1.4 * lit[1]
    # (0.018 px for each px of blur.)
    assert 0.00006 < lit[0] - lit[1] < 0.0005


def test_levels_of_the_drawing_are_srgb() -> None:
    assert linear_light(drawn(0.0))[5, 5].mean() == pytest.approx(0.2, abs=0.02)
