"""Balls in pictures of a shake, of a coarse codec, and behind a plate: drawn by OpenCV and NumPy, apart from detection."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pytest

from mirror_posture import Camera, ColorRange, Marker
from mirror_posture.detect import PredictedMarker, detect_markers, markers
from mirror_posture.detect.marker_judge import MarkerOptions, size_share
from mirror_posture.detect.reading import read_picture_file

BALLS = {
    "red": (62.3, 60.8, 9.4, (0.03, 0.04, 0.6), 2.0),
    "green": (150.6, 88.2, 8.2, (0.05, 0.5, 0.06), 119.0),
    "blue": (238.4, 70.5, 10.1, (0.7, 0.08, 0.05), 237.0),
    "yellow": (120.2, 172.7, 8.8, (0.03, 0.55, 0.6), 56.0),
}
CAMERA = Camera((320, 240), (600.0, 600.0), (159.5, 119.5))
MARKERS = tuple(
    Marker(name, diameter_m=0.02, color=ColorRange(hue, 18.0, 0.4, 0.12)) for name, (*_, hue) in BALLS.items()
)


def outline(name: str) -> tuple[np.ndarray, float]:
    """Centre and radius of a ball's drawn disc, px."""
    u, v, radius, *_ = BALLS[name]
    return np.array([u, v]), radius


def light(hidden: dict[str, float] | None = None) -> np.ndarray:
    """Shaded balls in linear light before two greys; a plate hides a share of the width of some."""
    return _drawn(tuple((hidden or {}).items())).copy()


@cache
def _drawn(hidden: tuple[tuple[str, float], ...]) -> np.ndarray:
    fine = 6
    u = (np.arange(320 * fine) + 0.5) / fine - 0.5
    v = (np.arange(240 * fine) + 0.5) / fine - 0.5
    scene = np.where((u + 0.3 * v[:, None] < 170.0)[..., None], 0.12, 0.26) * np.ones(3)
    shares = dict(hidden)
    for name, (x, y, radius, paint, _) in BALLS.items():
        # All of a ball and of its plate lies within 1.6 radii.
        rows, columns = (
            slice(*np.searchsorted(at, [middle - 1.7 * radius, middle + 1.7 * radius]))
            for at, middle in ((v, y), (u, x))
        )
        du, dv = (u[None, columns] - x) / radius, (v[rows, None] - y) / radius
        toward = np.sqrt(np.maximum(1.0 - du**2 - dv**2, 0.0))
        shade = 0.25 + 0.75 * np.maximum(0.7 * toward - 0.6 * dv - 0.38 * du, 0.0)
        inside = (du**2 + dv**2 <= 1.0)[..., None]
        part = np.where(inside, shade[..., None] * np.array(paint), scene[rows, columns])
        if name in shares:
            plate = (du > 1.0 - 2.0 * shares[name]) & (du < 1.6) & (np.abs(dv) < 1.4)
            part = np.where(plate[..., None], 0.2, part)
        scene[rows, columns] = part
    return scene.reshape(240, fine, 320, fine, 3).mean(axis=(1, 3))


def shaken(scene: np.ndarray, length: float, turn: float) -> np.ndarray:
    side = int(np.ceil(length)) + 2
    kernel = np.zeros((2 * side + 1, 2 * side + 1))
    for t in np.linspace(-0.5 * length, 0.5 * length, 401):
        u, v = side + t * np.cos(turn), side + t * np.sin(turn)
        i, j = int(u), int(v)
        a, b = u - i, v - j
        kernel[j : j + 2, i : i + 2] += np.outer([1 - b, b], [1 - a, a])
    return cv2.filter2D(scene, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REPLICATE)


def levels(scene: np.ndarray, seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0.0, 1.0, scene.shape)
    return np.clip(np.rint(255.0 * scene ** (1.0 / 2.2) + noise), 0, 255).astype(np.uint8)


def expected(seed: int) -> tuple[PredictedMarker, ...]:
    """What a model says that is some px and 1 % off."""
    random = np.random.default_rng(seed)
    return tuple(
        PredictedMarker(
            name,
            tuple(outline(name)[0] + random.normal(0.0, 4.0, 2)),
            float("inf"),
            outline(name)[1] * (1.0 + random.normal(0.0, 0.01)),
        )
        for name in BALLS
    )


@pytest.mark.parametrize("turn", [0.3, 1.4, 2.4])
def test_a_shake_of_ten_pixels_leaves_every_ball_with_a_true_deviation(turn: float) -> None:
    seed = round(10 * turn)
    picture = levels(shaken(light(), 10.0, turn), seed)
    for view in detect_markers(picture, MARKERS, CAMERA, expected=expected(seed)):
        assert view.ok, (view.name, view.reason)
        error = np.subtract(view.pixel_px, outline(view.name)[0])
        assert np.hypot(*error) < 0.6, (view.name, error)
        assert error @ np.linalg.solve(view.covariance_px2, error) < 16.0, (view.name, error, view.std_px)


def test_a_shake_that_leaves_rays_their_colours_is_read_by_rays() -> None:
    """Six pixels: rays read it to a fifth of what the balls as a whole tell."""
    picture = levels(shaken(light(), 6.0, 1.4), 1)
    for view in detect_markers(picture, MARKERS, CAMERA, expected=expected(1)):
        assert view.ok, (view.name, view.reason)
        assert np.hypot(*np.subtract(view.pixel_px, outline(view.name)[0])) < 0.08, view.name


def test_a_ball_behind_a_plate_is_not_taken_for_a_moved_one() -> None:
    hidden = dict.fromkeys(BALLS, 0.25)
    coded = cv2.imencode(".jpg", levels(light(hidden), 5), [cv2.IMWRITE_JPEG_QUALITY, 92])[1]
    picture = cv2.imdecode(coded, cv2.IMREAD_COLOR)
    views = detect_markers(
        picture, MARKERS, CAMERA, expected=expected(5), chroma_step_px=(2, 2), quantisation_step=2.0
    )
    # Today all four are found.
    assert sum(view.ok for view in views) >= 3, [(view.name, view.reason) for view in views]
    for view in views:
        if view.ok:
            error = np.subtract(view.pixel_px, outline(view.name)[0])
            assert np.hypot(*error) < max(0.3, 4.0 * (view.std_px or 0.0)), (view.name, error, view.std_px)


def test_balls_of_a_coarse_codec_are_kept_with_large_deviations(tmp_path) -> None:
    """JPEG 4:2:0 of quality 20 moves edges by half a pixel: that is claimed, and does not mask the ball."""
    found = 0
    for seed in range(3):
        flags = [
            cv2.IMWRITE_JPEG_QUALITY,
            20,
            cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
            cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420,
        ]
        place = tmp_path / f"{seed}.jpg"
        place.write_bytes(cv2.imencode(".jpg", levels(light(), seed), flags)[1].tobytes())
        file = read_picture_file(place)
        views = detect_markers(
            file.pixels,
            MARKERS,
            CAMERA,
            expected=expected(seed),
            chroma_step_px=file.chroma_step_px,
            quantisation_step=file.quantisation_step,
        )
        for view in views:
            if view.ok:
                found += 1
                error = np.subtract(view.pixel_px, outline(view.name)[0])
                assert np.hypot(*error) < max(0.3, 4.0 * (view.std_px or 0.0)), (view.name, error)
    assert found >= 11, found


def test_a_fit_that_runs_away_is_made_again_with_the_models_size(monkeypatch) -> None:
    measure = markers.measure_balls

    def only_of_known_size(bgr, starts, *others):
        fits = measure(bgr, starts, *others)
        return [
            fit if one.max_radius_px < 1.3 * one.min_radius_px else None
            for one, fit in zip(starts, fits, strict=True)
        ]

    monkeypatch.setattr(markers, "measure_balls", only_of_known_size)
    for view in detect_markers(levels(light(), 1), MARKERS, CAMERA, expected=expected(1)):
        assert view.ok, (view.name, view.reason)
        assert np.hypot(*np.subtract(view.pixel_px, outline(view.name)[0])) < 0.15


def test_limits_grow_with_the_codecs_step() -> None:
    plain = MarkerOptions()
    coarse = plain.with_codec(32.0, True)
    assert plain.with_codec(0.0, False) == plain
    assert coarse.max_outline_residual_px > 2.0 * plain.max_outline_residual_px
    assert size_share(10.0, coarse) > size_share(10.0, plain) + 0.08
