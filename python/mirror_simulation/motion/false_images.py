"""Gross detection errors in a sequence of pictures: single images that deviate from those before and after
them.

Over time a wrong model's error is smooth. At each image a parabola is fitted to the nine around it with the
least sum of distances (by reweighted least squares), which two gross errors among the nine do not bend. The
farthest outlier of each neighbourhood is removed, and the others are tested again without it. Where more
than two successive images deviate, the body moves in that way.
"""

from __future__ import annotations

import numpy as np

from mirror_posture.arrays import Floats, Integers, Mask

FALSE_DEVIATIONS = 6.0
LEAST_DEVIATIONS = 4.0
"""Of the stated noise."""
MOST_FALSE = 0.1
"""Of a marker's images."""
LONGEST_RUN = 2
WINDOW, REWEIGHTED = 9, 12
LOOKS = 5
LEAST_DISTANCE = 0.2
"""Of the stated noise: nearer images count no more."""


def false_images(residual_px: Floats, noise_px: float) -> Mask:
    """(F, markers): the gross errors among residuals (F, markers, 2), NaN where nothing was seen."""
    false = np.zeros(residual_px.shape[:2], dtype=bool)
    for m in range(residual_px.shape[1]):
        at = np.flatnonzero(np.isfinite(residual_px[:, m]).all(axis=1))
        if len(at) >= WINDOW:
            false[at, m] = _of_row(at, residual_px[at, m], noise_px)
    return false


def _of_row(at: Integers, row: Floats, noise_px: float) -> Mask:
    false, about = np.zeros(len(row), dtype=bool), _windows(len(row))
    for _ in range(LOOKS):
        off = np.abs(row - _smooth(at, row, about, LEAST_DISTANCE * noise_px, ~false)).max(axis=1)
        # Of two axes the larger is usually 1.2 times one; the median of distances is theirs over 1.48.
        usual = 1.4826 / 1.2 * float(np.median(off))
        far = off > max(FALSE_DEVIATIONS * usual, LEAST_DEVIATIONS * noise_px)
        # What one image bent is judged again without it.
        fresh = far & ~false & (off >= np.where(false, 0.0, off)[about].max(axis=1))
        if not fresh.any():
            break
        false = (false | fresh) & far
    false = _without_long_runs(false, far)
    # A limb that swings as the model never does leaves many behind: then it is the model that is wrong.
    few = int(false.sum()) <= MOST_FALSE * len(row)
    return false if few else np.zeros_like(false)


def _without_long_runs(false: Mask, far: Mask) -> Mask:
    """Those of which no more than `LONGEST_RUN` follow each other, with all that lie off counted."""
    all_far: Mask = false | far
    out: Mask = false.copy()
    begins = np.flatnonzero(all_far & ~np.concatenate([[False], all_far[:-1]]))
    ends = np.flatnonzero(all_far & ~np.concatenate([all_far[1:], [False]]))
    for begin, end in zip(begins, ends, strict=True):
        if end - begin >= LONGEST_RUN:
            out[begin : end + 1] = False
    return out


def _windows(count: int) -> Integers:
    """(n, WINDOW): the images about each."""
    first = np.clip(np.arange(count) - WINDOW // 2, 0, count - WINDOW)
    return np.asarray(first[:, None] + np.arange(WINDOW))


def _smooth(at: Integers, row: Floats, about: Integers, least: float, counts: Mask) -> Floats:
    """(n, 2): beside each image of a row, seen in pictures `at`, what the parabola through those about it says that count."""
    time = (at[about] - at[:, None]) / WINDOW
    powers = np.stack([np.ones_like(time), time, time**2], axis=-1)[:, None]
    values = np.moveaxis(row[about], 2, 1)
    counted = counts[about][:, None].astype(float)
    weight = counted * np.ones_like(values)
    for _ in range(REWEIGHTED):
        weighted = powers * weight[..., None]
        normal = np.swapaxes(weighted, 2, 3) @ powers
        pull = np.swapaxes(weighted, 2, 3) @ values[..., None]
        fitted = np.linalg.solve(normal + 1e-9 * np.eye(3), pull)
        left = np.abs(values - (powers @ fitted)[..., 0])
        weight = counted * least / np.maximum(left, least)
    return np.asarray(fitted[:, :, 0, 0])
