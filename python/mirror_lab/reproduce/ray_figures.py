"""Figs. 7, 8 and 9 drawn and judged: virtual rays against distance and angle of the mirror."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from .claims import Claim, Experiment, judged
from .observation import Eye
from .plots import MANY, MARKERS, Panel, Series, drawn
from .rays import ANGLES_DEG, DISTANCES_M, LADDER, PAPER_SIZE_NOISE_PX, RayErrors

Floats = npt.NDArray[np.float64]


def how(found: RayErrors) -> str:
    """A panel's title: the origin of its data."""
    if found.noise_px is None:
        return f"drawn pictures, detected ({found.trials} trials)"
    return f"corner noise {found.noise_px:g} px ({found.trials} trials)"


def _millimetres(found: RayErrors) -> dict[str, Any]:
    return {
        "noise_px": found.noise_px,
        "trials": found.trials,
        "rays_seen": found.seen("point_pair").tolist(),
        "mean_mm": {name: found.mean(name) for name in found.error_mm},
        "std_mm": {name: found.std(name) for name in found.error_mm},
    }


def fig7(eye: Eye, found: RayErrors, large: RayErrors | None) -> Experiment:
    """Six markers against distance: dashed Eq. 1, solid Eq. 2."""
    markers = eye.stand.markers
    x = np.array(DISTANCES_M) * 1e3

    def lines(errors: RayErrors) -> list[Series]:
        return [
            Series(
                f"{marker}, {'without' if name == 'pose' else 'with'}",
                x,
                errors.mean(name)[:, k],
                color=MANY[k],
                line=line,
                marker=MARKERS[k],
                filled=name != "pose",
            )
            for name, _, _, line, _ in LADDER[:2]
            for k, marker in enumerate(markers)
        ]

    axes: dict[str, Any] = {
        "x_label": "Mirror distance (mm)",
        "y_label": "Error (mm)",
        "x_ticks": x.tolist(),
    }
    panels = [Panel(how(found), series=lines(found), **axes)]
    panels.append(Panel("the same, logarithmic", series=lines(found), logarithmic=True, **axes))
    eq1, eq2 = found.mean("pose"), found.mean("point_pair")
    row1, row2 = np.nanmean(eq1, axis=1), np.nanmean(eq2, axis=1)
    power = _power(x, row1)
    claims = (
        judged(
            "Eq. 1 against distance",
            "without the constraint the error increased with the distance",
            f"mean of the six {row1[0]:.2f} mm at {x[0]:.0f} mm, {row1[-1]:.2f} mm at {x[-1]:.0f} mm: about the power {power:.1f} of the distance",
            bool(power > 1.25 and row1[-1] > 2.5 * row1[0]),
        ),
        judged(
            "Eq. 2 against distance",
            "with it the errors were low; the distance had no great effect",
            f"mean of the six {row2[0]:.2f} mm at {x[0]:.0f} mm, {row2[-1]:.2f} mm at {x[-1]:.0f} mm",
            bool(np.nanmax(row2) < np.nanmin(row1)),
        ),
        judged(
            "every marker",
            "both statements are made of all six markers",
            f"Eq. 1 over Eq. 2 is {np.nanmin(eq1 / eq2):.0f} to {np.nanmax(eq1 / eq2):.0f}, for any marker at any distance",
            bool(np.nanmin(eq1 / eq2) > 2.0),
        ),
        _beyond(found),
    )
    return Experiment(
        "fig7",
        "Ray error against distance, six markers",
        claims,
        {"distance_m": DISTANCES_M, "markers": markers, **_millimetres(found)}
        | ({} if large is None else {"at_the_papers_size": _millimetres(large)}),
        {"fig7.png": drawn(panels, 6)},
        ("The six places and the board's size are chosen: the paper shows them in photographs only.",),
    )


def fig8(eye: Eye, found: RayErrors, large: RayErrors | None) -> Experiment:
    """P1 alone, on Fig. 8's axes where the noise is of the paper's size."""
    x = np.array(DISTANCES_M) * 1e3
    axes: dict[str, Any] = {
        "x_label": "Mirror distance (mm)",
        "y_label": "Error (mm)",
        "x_ticks": x.tolist(),
    }
    panels = [Panel(how(found), series=ladder_series(found, x, 0), **axes)]
    claims: list[Claim] = []
    eq1, eq2 = found.mean("pose")[:, 0], found.mean("point_pair")[:, 0]
    claims.append(
        judged(
            "P1 as an example of Fig. 7",
            "Eq. 1 rises with the distance, Eq. 2 stays low",
            f"Eq. 1 from {eq1[0]:.2f} to {eq1[-1]:.2f} mm, Eq. 2 from {eq2[0]:.2f} to {eq2[-1]:.2f} mm",
            bool(eq1[-1] > 3.0 * eq1[0] and np.nanmax(eq2) < np.nanmin(eq1)),
        )
    )
    if large is not None:
        panels.append(
            Panel(
                f"{how(large)}: the paper's axes",
                series=ladder_series(large, x, 0),
                y_top=90.0,
                y_step=10.0,
                **axes,
            )
        )
    claims.append(
        size_claim(
            90.0,
            float(np.nanmax(eq1)),
            large,
            None if large is None else float(np.nanmax(large.mean("pose")[:, 0])),
        )
    )
    return Experiment(
        "fig8",
        "Ray error against distance, P1",
        tuple(claims),
        {"distance_m": DISTANCES_M, "marker": "P1", **_millimetres(found)}
        | ({} if large is None else {"at_the_papers_size": _millimetres(large)}),
        {"fig8.png": drawn(panels)},
        ("Bars: 95 % interval of the mean.",),
    )


def fig9(eye: Eye, found: RayErrors, large: RayErrors | None) -> Experiment:
    """P2 against the angle between board and mirror."""
    x = np.array(ANGLES_DEG)
    marker = eye.stand.markers.index("P2")
    axes: dict[str, Any] = {
        "x_label": "Mirror angle (deg)",
        "y_label": "Error (mm)",
        "x_ticks": x.tolist(),
    }
    panels = [Panel(how(found), series=ladder_series(found, x, marker), **axes)]
    if large is not None:
        panels.append(
            Panel(
                f"{how(large)}: the paper's axes",
                series=ladder_series(large, x, marker),
                y_top=12.0,
                y_step=2.0,
                **axes,
            )
        )
    eq1, eq2 = found.mean("pose")[:, marker], found.mean("point_pair")[:, marker]
    there = np.isfinite(eq1)
    # Means over several angles: single ones of a hundred trials scatter by a tenth.
    near, far = np.nanmean(eq1[np.abs(x) <= 5.0]), np.nanmean(eq1[np.abs(x) >= 15.0])
    claims = [
        judged(
            "Eq. 1 near 0°",
            "without the constraint the error notably increased around 0°",
            f"{near:.2f} mm within 5° of 0°, {far:.2f} mm beyond 15°",
            bool(near > 1.2 * far),
        ),
        judged(
            "Eq. 2 at all angles",
            "with the constraint the error was low for all angles",
            f"{np.nanmin(eq2):.2f} to {np.nanmax(eq2):.2f} mm, below Eq. 1 at every angle"
            if np.all(eq2[there] < eq1[there])
            else f"{np.nanmin(eq2):.2f} to {np.nanmax(eq2):.2f} mm",
            bool(np.all(eq2[there] < eq1[there]) and np.ptp(eq2[there]) < 0.25 * eq1[there].mean()),
        ),
        size_claim(
            12.0,
            float(np.nanmax(eq1)),
            large,
            None if large is None else float(np.nanmax(large.mean("pose")[:, marker])),
        ),
    ]
    return Experiment(
        "fig9",
        "Ray error against angle, P2",
        tuple(claims),
        {"angle_deg": ANGLES_DEG, "marker": "P2", **_millimetres(found)}
        | ({} if large is None else {"at_the_papers_size": _millimetres(large)}),
        {"fig9.png": drawn(panels)},
        ("Bars: 95 % interval of the mean.", *_missing(there, x)),
    )


def ladder_series(found: RayErrors, x: Floats, marker: int) -> list[Series]:
    """The two estimators of the paper, and maximum likelihood, for one marker."""
    return [
        Series(
            label,
            x,
            found.mean(name)[:, marker],
            found.half_width(name)[:, marker],
            color,
            line,
            mark,
            name != "maximum_likelihood",
        )
        for name, label, color, line, mark in LADDER
    ]


def size_claim(top_mm: float, here_mm: float, large: object | None, large_mm: float | None) -> Claim:
    """The size of the errors: the paper prints no numbers, only axes."""
    said = f"largest {here_mm:.1f} mm"
    if large is not None and large_mm is not None:
        said += f"; with {PAPER_SIZE_NOISE_PX:g} px a corner {large_mm:.0f} mm"
    same = top_mm / 2.0 <= here_mm <= top_mm * 1.1
    return Claim("size", f"the axis reaches {top_mm:.0f} mm", said, "holds" if same else "differs")


def _beyond(found: RayErrors) -> Claim:
    ml, eq2 = np.nanmean(found.mean("maximum_likelihood")), np.nanmean(found.mean("point_pair"))
    return Claim(
        "maximum likelihood", "–", f"{ml:.3f} mm where Eq. 2 has {eq2:.3f} mm, over all", "beyond the paper"
    )


def _missing(there: npt.NDArray[np.bool_], x: Floats) -> tuple[str, ...]:
    if there.all():
        return ()
    return (f"Nothing at {', '.join(f'{a:.0f}°' for a in x[~there])}: board or marker leave the picture.",)


def _power(x: Floats, y: Floats) -> float:
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])
