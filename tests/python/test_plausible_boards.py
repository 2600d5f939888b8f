"""Whether a board's corners are the image of a plane: all views of a session at once."""

from __future__ import annotations

import numpy as np
import pytest

from mirror_posture.session.plausible_boards import _misfits

FLAT = np.stack(np.meshgrid(np.linspace(-1, 1, 6), np.linspace(-0.8, 0.8, 5)), axis=-1).reshape(-1, 2)


def images(random: np.random.Generator, views: int) -> np.ndarray:
    """Images of the plane by drawn homographies, px."""
    out = []
    for _ in range(views):
        h = np.eye(3) + 0.15 * random.standard_normal((3, 3))
        image = np.concatenate([FLAT, np.ones((len(FLAT), 1))], axis=1) @ h.T
        out.append(300.0 + 200.0 * image[:, :2] / image[:, 2:])
    return np.array(out)


def test_images_of_a_plane_fit_it_with_any_corners_hidden() -> None:
    random = np.random.default_rng(5)
    px = images(random, 40)
    seen = random.random(px.shape[:2]) > 0.4
    px[~seen] = np.nan
    assert _misfits(FLAT, px, seen).max() < 1e-9


def test_noise_is_told_as_a_share_of_the_spread() -> None:
    random = np.random.default_rng(6)
    px = images(random, 40)
    spread = np.sqrt(((px - px.mean(axis=1, keepdims=True)) ** 2).sum(axis=2).mean(axis=1))
    noisy = px + 2.0 * random.standard_normal(px.shape)
    misfits = _misfits(FLAT, noisy, np.ones(px.shape[:2], dtype=bool)) * spread
    # Of 60 numbers a homography takes eight.
    assert np.sqrt((misfits**2).mean()) == pytest.approx(2.0 * np.sqrt(2.0 * 52 / 60), rel=0.05)


def test_corners_in_another_order_are_no_image_and_one_point_has_no_spread() -> None:
    random = np.random.default_rng(7)
    px = images(random, 3)
    px[1] = px[1][random.permutation(len(FLAT))]
    px[2] = px[2, 0]
    right, mixed, point = _misfits(FLAT, px, np.ones(px.shape[:2], dtype=bool))
    assert right < 1e-9 < 0.3 < mixed
    assert np.isinf(point)
