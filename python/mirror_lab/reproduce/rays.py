"""The shortest distance of virtual rays from their markers, against distance and angle of the mirror: what Figs. 7, 8 and 9 show."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from mirror_posture.mirror import Estimator, estimate_mirrors, virtual_rays
from mirror_posture.render import View

from .observation import Eye, NoisyEye, Sighting, Told
from .plots import BEYOND, EQ1, EQ2, OURS
from .spread import deviation, students_95

Floats = npt.NDArray[np.float64]

PAPER_TRIALS = 100
DISTANCES_M = (0.150, 0.175, 0.200, 0.225, 0.250, 0.275, 0.300)
"""The ticks of Fig. 8."""
ANGLES_DEG = (-15.0, -10.0, -5.0, 0.0, 5.0, 10.0, 15.0, 20.0, 25.0)
"""The ticks of Figs. 10 and 11; Fig. 9 spans the same angles."""
ANGLE_DISTANCE_M = 0.150

PAPER_SIZE_NOISE_PX = 1.3
"""The corner noise at which Eq. 1 fills the axes of Figs. 8 to 11 (90, 12, 50 and 25 mm) to between a half and the whole, all at once: found by a sweep
over 0.2 to 2 px, docs/reproduce.md. It says how large the paper's errors are in px; nothing of their course depends on it."""

WITHOUT = "Without the mirror constraint"
WITH = "With the mirror constraint (proposed method)"
LIKELIEST = f"Maximum likelihood ({BEYOND})"
LADDER: tuple[tuple[Estimator, str, str, str, str], ...] = (
    ("pose", WITHOUT, EQ1, "--", "s"),
    ("point_pair", WITH, EQ2, "-", "o"),
    ("maximum_likelihood", LIKELIEST, OURS, ":", "^"),
)
"""Estimator, the paper's legend, colour, line and marker."""


@dataclass(frozen=True)
class RayErrors:
    """Shortest distances of virtual rays from their markers, by estimator: (views, trials, markers), mm; NaN if not seen."""

    noise_px: float | None
    trials: int
    error_mm: Mapping[Estimator, Floats]

    def mean(self, estimator: Estimator) -> Floats:
        """(views, markers); NaN where no trial saw the marker."""
        return _over_trials(np.nanmean, self.error_mm[estimator])

    def std(self, estimator: Estimator) -> Floats:
        """(views, markers), between trials; NaN where fewer than two saw the marker."""
        return _over_trials(deviation, self.error_mm[estimator])

    def half_width(self, estimator: Estimator) -> Floats:
        """(views, markers): half of the mean's 95 % interval, by Student's distribution."""
        seen = self.seen(estimator)
        quantile = np.array([students_95(n - 1) for n in seen.ravel()]).reshape(seen.shape)
        return quantile * self.std(estimator) / np.sqrt(np.maximum(seen, 1))

    def seen(self, estimator: Estimator) -> npt.NDArray[np.int64]:
        """(views, markers): how many trials gave a ray."""
        return np.asarray(np.isfinite(self.error_mm[estimator]).sum(axis=1))


def _over_trials(reduce: Any, error_mm: Floats) -> Floats:
    out = np.full((error_mm.shape[0], error_mm.shape[2]), np.nan)
    some = np.isfinite(error_mm).any(axis=1)
    columns = error_mm.swapaxes(1, 2)[some]
    if len(columns):
        out[some] = reduce(columns, axis=1)
    return out


def ray_errors(
    eye: Eye, views: Sequence[View], trials: int, stream: int, told: Told | None = None
) -> RayErrors:
    """Looks at the stand in each view and measures each ray's distance from the true place of its marker."""
    seen = [eye.see(view, trials, stream + k, told) for k, view in enumerate(views)]
    errors = {name: np.stack([_distances_mm(eye, sight, name) for sight in seen]) for name, *_ in LADDER}
    return RayErrors(eye.noise_px, trials, errors)


def _distances_mm(eye: Eye, sight: Sighting, estimator: Estimator) -> Floats:
    stand = eye.stand
    trials, markers = sight.markers_px.shape[:2]
    mirrors = estimate_mirrors(stand.rig(eye.glass_thickness_m), sight.corners_px, estimator=estimator)
    rows = np.repeat(np.arange(trials), markers)
    rays = virtual_rays(mirrors, rows, sight.markers_px.reshape(-1, 2), noise_px=eye.noise_px or 0.1)
    truth = np.tile(stand.markers_in_camera_m, (trials, 1))
    # The height of the triangle over the unit direction.
    away = np.linalg.norm(np.cross(truth - rays.origins_m, rays.directions), axis=1)
    return np.where(rays.valid, away * 1e3, np.nan).reshape(trials, markers)


def against_distance(eye: Eye, trials: int, told: Told | None = None) -> RayErrors:
    """The six markers, the board squarely before the mirror at `DISTANCES_M`."""
    return ray_errors(eye, [View(distance_m=d) for d in DISTANCES_M], trials, 700, told)


def against_angle(eye: Eye, trials: int, told: Told | None = None) -> RayErrors:
    """The six markers, of which the paper shows P2, the board at 150 mm and turned to `ANGLES_DEG`."""
    views = [View(yaw_rad=math.radians(a), distance_m=ANGLE_DISTANCE_M) for a in ANGLES_DEG]
    return ray_errors(eye, views, trials, 900, told)


def larger_noise(eye: Eye) -> NoisyEye | None:
    """The same eye at the noise of the paper's size; None where noise was not chosen, or is that size already."""
    if not isinstance(eye, NoisyEye) or eye.noise_px >= PAPER_SIZE_NOISE_PX:
        return None
    return NoisyEye(eye.stand, PAPER_SIZE_NOISE_PX, eye.seed + 1)
