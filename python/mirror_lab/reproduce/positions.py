"""Figs. 10 and 11: mean and standard deviation of the error of a marker's position, from two views, against the angle."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from mirror_posture.mirror import Estimator, estimate_mirrors
from mirror_posture.render import View
from mirror_posture.triangulate import Triangulator, triangulate

from .claims import Claim, Experiment, judged
from .observation import Eye, Told
from .plots import Panel, Series, drawn
from .ray_figures import size_claim
from .rays import ANGLE_DISTANCE_M, ANGLES_DEG, LADDER

Floats = npt.NDArray[np.float64]

PAPER_TRIALS = 10
"""The paper took ten measurements at each angle."""
SECOND_VIEW_DEG = 15.0
"""How much farther the second view is turned: as in the paper's correction experiment."""

TRIANGULATORS: dict[Estimator, Triangulator] = {
    "pose": "midpoint",
    "point_pair": "midpoint",
    "maximum_likelihood": "maximum_likelihood",
}
"""The paper's midpoint for its own two; maximum likelihood goes on in pixels."""


@dataclass(frozen=True)
class PositionErrors:
    """Distances of measured from true positions of P2, by estimator: (angles, measurements), mm; NaN if not measured."""

    noise_px: float | None
    trials: int
    second_deg: tuple[float, ...]
    """Where the second view of each angle stands."""
    error_mm: Mapping[Estimator, Floats]

    def mean(self, estimator: Estimator) -> Floats:
        """(angles,)."""
        return self._over(estimator, 0)

    def std(self, estimator: Estimator) -> Floats:
        """(angles,), of a sample."""
        return self._over(estimator, 1)

    def _over(self, estimator: Estimator, ddof: int) -> Floats:
        rows = self.error_mm[estimator]
        out = np.full(len(rows), np.nan)
        for k, row in enumerate(rows):
            good = row[np.isfinite(row)]
            if len(good) > ddof:
                out[k] = good.std(ddof=1) if ddof else good.mean()
        return out


def second_angle_deg(angle_deg: float, widest_deg: float) -> float:
    """15° farther, or 15° back where that would go beyond the widest angle that can be seen."""
    farther = angle_deg + SECOND_VIEW_DEG
    return farther if farther <= widest_deg else angle_deg - SECOND_VIEW_DEG


def position_errors(eye: Eye, trials: int, told: Told | None = None) -> PositionErrors:
    """Measures P2 from two views at each angle, `trials` times."""
    rig = eye.stand.rig(eye.glass_thickness_m)
    marker = eye.stand.markers.index("P2")
    truth = eye.stand.markers_in_camera_m[marker]
    errors = {name: np.full((len(ANGLES_DEG), trials), np.nan) for name, *_ in LADDER}
    rows = np.stack([np.arange(trials), np.arange(trials) + trials], axis=1)
    for k, angle in enumerate(ANGLES_DEG):
        pair = [
            eye.see(
                View(yaw_rad=math.radians(a), distance_m=ANGLE_DISTANCE_M), trials, 1000 + 2 * k + i, told
            )
            for i, a in enumerate((angle, second_angle_deg(angle, eye.widest_deg)))
        ]
        corners = np.concatenate([sight.corners_px for sight in pair])
        pixels = np.stack([sight.markers_px[:, marker] for sight in pair], axis=1)
        for name in errors:
            errors[name][k] = _errors_mm(rig, name, corners, rows, pixels, eye.noise_px, truth)
    second = tuple(second_angle_deg(angle, eye.widest_deg) for angle in ANGLES_DEG)
    return PositionErrors(eye.noise_px, trials, second, errors)


def _errors_mm(
    rig: Any,
    estimator: Estimator,
    corners: Floats,
    rows: npt.NDArray[np.int64],
    pixels: Floats,
    noise_px: float | None,
    truth: Floats,
) -> Floats:
    mirrors = estimate_mirrors(rig, corners, estimator=estimator, noise_px=noise_px)
    found = triangulate(
        mirrors, rows, pixels, noise_px=noise_px or 0.1, triangulator=TRIANGULATORS[estimator]
    )
    away = np.linalg.norm(found.points_in_camera_m - truth, axis=1) * 1e3
    return np.where(found.valid, away, np.nan)


def fig10(found: PositionErrors, large: PositionErrors | None) -> Experiment:
    """The mean error."""
    return _experiment(
        "fig10",
        "Marker position: mean error against angle",
        ("mean", "the mean", "accuracy", "Error (mm)", 50.0),
        (found, large),
        "The paper does not say where its second view stands. Here: 15° farther, as in its correction experiment, or 15° back "
        "where that would leave the range or the picture.",
    )


def fig11(found: PositionErrors, large: PositionErrors | None) -> Experiment:
    """The standard deviation of the error."""
    return _experiment(
        "fig11",
        "Marker position: deviation of the error against angle",
        ("std", "the deviation", "precision", "Standard deviation (mm)", 25.0),
        (found, large),
        "Deviation of the error's length, of a sample.",
    )


def _experiment(
    name: str,
    title: str,
    about: tuple[str, str, str, str, float],
    sizes: tuple[PositionErrors, PositionErrors | None],
    note: str,
) -> Experiment:
    """One figure of a statistic: which (`mean`, `std`), its words, what is gained, the axis' label, the paper's axis, mm."""
    statistic, words, gain, label, axis_mm = about
    found, large = sizes

    def of(errors: PositionErrors, estimator: str) -> Floats:
        values: Floats = getattr(errors, statistic)(estimator)
        return values

    eq1, eq2 = of(found, "pose"), of(found, "point_pair")
    there = np.isfinite(eq1) & np.isfinite(eq2)
    claims = _claims(words, gain, eq1[there], eq2[there], of(found, "maximum_likelihood")[there])
    if there.any():
        largest = None if large is None else float(np.nanmax(of(large, "pose")))
        claims.append(size_claim(axis_mm, float(np.nanmax(eq1)), large, largest))
    return Experiment(
        name,
        title,
        tuple(claims),
        _data(found, large),
        {f"{name}.png": _drawn(statistic, label, axis_mm, 5.0, found, large)},
        (note, *_missing(there)),
    )


def _claims(what: str, gain: str, eq1: Floats, eq2: Floats, ml: Floats) -> list[Claim]:
    if not len(eq1):
        return [judged(what, "measured at every angle", "nothing measured often enough", False)]
    ratio = float(eq1.mean() / eq2.mean())
    below = bool(np.all(eq2 < eq1))
    return [
        judged(
            f"{what}, Eq. 2",
            "with the constraint it is not affected by the angle",
            f"{eq2.min():.2f} to {eq2.max():.2f} mm over all angles; Eq. 1 {eq1.min():.2f} to {eq1.max():.2f} mm",
            # Against the size of Eq. 1's error: of a few measurements even an equal deviation scatters by half.
            bool(eq2.max() < 0.5 * eq1.mean()),
        ),
        judged(
            f"{gain} gained",
            f"with the constraint the {gain} improves significantly",
            f"by {ratio:.1f} in the mean over the angles; {'at every angle' if below else 'not at every angle'}",
            bool(below and ratio > 2.0),
        ),
        Claim(
            "maximum likelihood",
            "–",
            f"{ml.mean():.2f} mm where Eq. 2 has {eq2.mean():.2f} mm, over all angles",
            "beyond the paper",
        ),
    ]


def _drawn(
    kind: str,
    y_label: str,
    top: float,
    step: float,
    found: PositionErrors,
    large: PositionErrors | None,
) -> bytes:
    x = np.array(ANGLES_DEG)
    axes: dict[str, Any] = {
        "x_label": "Angle with the mirror (deg)",
        "y_label": y_label,
        "x_ticks": ANGLES_DEG,
    }

    def lines(errors: PositionErrors) -> list[Series]:
        return [
            Series(
                label, x, getattr(errors, kind)(name), None, color, line, mark, name != "maximum_likelihood"
            )
            for name, label, color, line, mark in LADDER
        ]

    panels = [Panel(_how(found), series=lines(found), **axes)]
    if large is not None:
        panels.append(
            Panel(f"{_how(large)}: the paper's axes", series=lines(large), y_top=top, y_step=step, **axes)
        )
    return drawn(panels)


def _how(found: PositionErrors) -> str:
    way = "drawn pictures, detected" if found.noise_px is None else f"corner noise {found.noise_px:g} px"
    return f"{way} ({found.trials} measurements)"


def _data(found: PositionErrors, large: PositionErrors | None) -> dict[str, Any]:
    def numbers(errors: PositionErrors) -> dict[str, Any]:
        return {
            "noise_px": errors.noise_px,
            "measurements": errors.trials,
            "measured": {
                name: np.isfinite(rows).sum(axis=1).tolist() for name, rows in errors.error_mm.items()
            },
            "mean_mm": {name: errors.mean(name) for name in errors.error_mm},
            "std_mm": {name: errors.std(name) for name in errors.error_mm},
        }

    own = {
        "angle_deg": ANGLES_DEG,
        "second_angle_deg": found.second_deg,
        "marker": "P2",
    }
    return own | numbers(found) | ({} if large is None else {"at_the_papers_size": numbers(large)})


def _missing(there: npt.NDArray[np.bool_]) -> tuple[str, ...]:
    if there.all():
        return ()
    gone = ", ".join(f"{a:.0f}°" for a, seen in zip(ANGLES_DEG, there, strict=True) if not seen)
    return (f"Nothing at {gone}: board or marker leave the picture in one of the views.",)
