"""Fig. 13 drawn and judged: the hand's error by the number of corrections, for five gains."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from typing import Any

import numpy as np

from ..robots import TwinOptions
from .claims import Claim, Experiment, judged
from .correction import (
    BEST_GAIN,
    CORRECTIONS,
    EQ2_OFF,
    GAINS,
    JOINT_OFF,
    LONG_CORRECTIONS,
    MOUNT_OFF_M,
    MOUNT_OFF_RAD,
    PAPER,
    PLAIN,
    Runs,
    planned,
    runs_of,
)
from .observation import Told
from .plots import BEYOND, MANY, MARKERS, Panel, Series, drawn

ENOUGH_MM = 5.0
"""The paper's "within 5 mm"."""
JOINT_ENOUGH_MM = 1.0
"""The required accuracy of the joint estimator."""
BESIDE = 0.05
"""How far apart the gains are drawn, corrections."""


def fig13(
    options: TwinOptions, runs: int, counting: Callable[[int], AbstractContextManager[Told]]
) -> Experiment:
    """Error by corrections; `counting(total)` opens a progress bar, which is advanced after each run."""
    plan = planned(options.pictures)
    found: dict[str, dict[float, Runs]] = {}
    long: Runs | None = None
    with counting(len(plan) * runs) as told:
        for way, gain, corrections in plan:
            one = runs_of(way, gain, runs, options, told, corrections)
            if corrections == CORRECTIONS:
                found.setdefault(way.name, {})[gain] = one
            else:
                long = one
    paper = found[PAPER.name]
    claims = [*paper_claims(paper, long), *_other_claims(found)]
    panels = [_panel(PAPER.title, paper, y_top=20.0, y_step=5.0)]
    if PLAIN.name in found:
        panels.append(_panel(PLAIN.title, found[PLAIN.name], y_top=20.0, y_step=5.0))
    panels.append(
        _panel(
            f"joint estimator, four views ({BEYOND})",
            found[JOINT_OFF.name],
            found.get(EQ2_OFF.name, {}),
            logarithmic=True,
            y_ticks=(0.2, 0.5, 1.0, 2.0, 5.0, 10.0),
        )
    )
    data = {
        "runs": runs,
        "corrections": CORRECTIONS,
        "ways": {
            name: {
                f"{gain:g}": {
                    "mean_mm": one.mean,
                    "std_mm": one.std,
                    "error_mm": one.error_mm,
                    "measured_mm": one.measured_mm,
                }
                for gain, one in by_gain.items()
            }
            for name, by_gain in found.items()
        },
    }
    if long is not None:
        data["paper_at_0.2_followed_on"] = {"mean_mm": long.mean, "std_mm": long.std}
    notes = (
        "d is the hand's true distance from its target, mean of the runs; bars: one standard deviation between runs.",
        "J⁺ is damped so that the measurement's noise turns the joints by no more than 0.5° (standard deviation): at the paper's "
        "posture one singular value of this arm's J is 1 mm/rad, the others are 64 and 107.",
        f"Right: the camera–board transform is off by {math.degrees(MOUNT_OFF_RAD):.1f}° and {1e3 * MOUNT_OFF_M:.1f} mm an axis, in each "
        "run otherwise; two of the four views are tilted.",
    )
    return Experiment(
        "fig13",
        "Correction: error by the number of corrections",
        tuple(claims),
        data,
        {"fig13.png": drawn(panels, 6)},
        notes,
    )


def _panel(
    title: str, by_gain: Mapping[float, Runs], beside: Mapping[float, Runs] | None = None, **axes: Any
) -> Panel:
    ticks = np.arange(CORRECTIONS + 1.0)
    series = []
    for gain, runs in by_gain.items():
        k = GAINS.index(gain)
        # Side by side, so that the bars can be told apart.
        x = ticks + BESIDE * (k - (len(GAINS) - 1) / 2)
        series.append(Series(f"λ = {gain:.1f}", x, runs.mean, runs.std, MANY[k], "-", MARKERS[k]))
    series += [
        Series(
            f"Eq. 2, the same views and mount, λ = {gain:g}", ticks, runs.mean, runs.std, "#888888", "--", "x"
        )
        for gain, runs in (beside or {}).items()
    ]
    return Panel(title, "Number of corrections", "Error (mm)", ticks.tolist(), series, **axes)


def paper_claims(paper: Mapping[float, Runs], long: Runs | None) -> list[Claim]:
    last = {gain: float(runs.mean[-1]) for gain, runs in paper.items()}
    ends = ", ".join(f"{gain:.1f}: {mm:.1f}" for gain, mm in last.items())
    smooth = paper[GAINS[0]]
    falls = bool(np.all(np.diff(smooth.distance_mm, axis=1) < 0.0))
    beyond = _overshot(smooth if long is None else long)
    told = f"{', '.join(f'{d:.1f}' for d in smooth.mean)} mm; every run falls at every correction"
    if not falls:
        told = f"{', '.join(f'{d:.1f}' for d in smooth.mean)} mm; not every run falls at every correction"
    if long is not None:
        told += f"; after {LONG_CORRECTIONS} corrections {long.mean[-1]:.1f} mm"
    overshot = {gain: _overshot(runs) for gain, runs in paper.items()}
    best = min(last, key=lambda gain: last[gain])
    return [
        judged(
            "all gains",
            "the error is reduced for all λ",
            f"from {smooth.mean[0]:.1f} mm to (by λ, mean of the runs) {ends} mm",
            all(bool(np.all(runs.distance_mm[:, -1] < runs.distance_mm[:, 0])) for runs in paper.values()),
        ),
        judged(
            "λ = 0.2 converges, without overshoot",
            "at a small gain such as 0.2 the error converged, since nothing overshot",
            f"{told}; overshot by at most {beyond:.1f} mm",
            # By noise the hand may pass its target a little where it has arrived.
            falls and beyond < 1.0 and (long is None or bool(long.mean[-1] < 1.5)),
        ),
        judged(
            "larger gains",
            "a correction that overshoots an angle can harm the convergence",
            "largest overshoot by λ: "
            + ", ".join(f"{gain:.1f}: {mm:.1f}" for gain, mm in overshot.items())
            + " mm",
            overshot[GAINS[-1]] >= overshot[GAINS[0]],
        ),
        judged(
            "final error",
            f"within {ENOUGH_MM:g} mm for an appropriate λ",
            f"{last[best]:.1f} mm with λ = {best:g}; {last[GAINS[0]]:.1f} mm with λ = 0.2",
            last[best] < ENOUGH_MM,
        ),
    ]


def _overshot(runs: Runs) -> float:
    """How far any run went past its target, against its first error, mm."""
    return max(0.0, -float(runs.along.min()))


def _other_claims(found: Mapping[str, Mapping[float, Runs]]) -> list[Claim]:
    claims = []
    if PLAIN.name in found:
        plain = found[PLAIN.name]
        ends = ", ".join(f"{gain:.1f}: {runs.mean[-1]:.1f}" for gain, runs in plain.items())
        all_fall = all(runs.mean[-1] < runs.mean[0] for runs in plain.values())
        claims.append(
            Claim(
                "the plain pseudo-inverse",
                "J⁺ of the paper is not said to be damped; its axis reaches 20 mm",
                f"by λ {ends} mm; up to {max(float(runs.mean.max()) for runs in plain.values()):.0f} mm in between",
                "holds" if all_fall else "differs",
            )
        )
    joint = found[JOINT_OFF.name][BEST_GAIN]
    told = (
        f"{joint.mean[-1]:.2f} mm with λ = {BEST_GAIN:g}, worst run {joint.distance_mm[:, -1].max():.2f} mm"
    )
    if EQ2_OFF.name in found:
        told += f"; Eq. 2 in the same runs {found[EQ2_OFF.name][BEST_GAIN].mean[-1]:.2f} mm"
    claims.append(
        judged(
            "joint estimator, camera–board transform off",
            f"– ({BEYOND}: within {JOINT_ENOUGH_MM:g} mm is asked)",
            told,
            bool(joint.mean[-1] < JOINT_ENOUGH_MM),
        )
    )
    return claims
