"""The size of the paper's errors, in px: Figs. 8 to 11 have axes without numbers, and one noise level must fit all four."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .claims import Experiment
from .observation import NoisyEye
from .positions import position_errors
from .rays import against_angle, against_distance
from .stand import Stand

PAPER_AXES_MM = {"fig8": 90.0, "fig9": 12.0, "fig10": 50.0, "fig11": 25.0}
"""The largest numbers at the paper's axes."""
SWEEP_PX = (0.1, 0.2, 0.5, 1.0, 1.3, 2.0)
SWEEP_TRIALS = 50


@dataclass(frozen=True)
class Size:
    """The largest value of Eq. 1 that each figure shows at one noise, mm, and of Eq. 2 beside it."""

    noise_px: float
    eq1_mm: dict[str, float]
    eq2_mm: dict[str, float]

    @property
    def filled(self) -> dict[str, float]:
        """The share of the paper's axis that Eq. 1 reaches, by figure."""
        return {name: mm / PAPER_AXES_MM[name] for name, mm in self.eq1_mm.items()}


def sweep(
    stand: Stand, noises_px: Sequence[float] = SWEEP_PX, trials: int = SWEEP_TRIALS, seed: int = 0
) -> list[Size]:
    """The sizes of all four figures at several noise levels, to find the paper's."""
    sizes = []
    p1, p2 = stand.markers.index("P1"), stand.markers.index("P2")
    for noise in noises_px:
        eye = NoisyEye(stand, noise, seed)
        distance, angle = against_distance(eye, trials), against_angle(eye, trials)
        position = position_errors(eye, trials)
        eq1, eq2 = (
            {
                "fig8": float(np.nanmax(distance.mean(name)[:, p1])),
                "fig9": float(np.nanmax(angle.mean(name)[:, p2])),
                "fig10": float(np.nanmax(position.mean(name))),
                "fig11": float(np.nanmax(position.std(name))),
            }
            for name in ("pose", "point_pair")
        )
        sizes.append(Size(noise, eq1, eq2))
    return sizes


def added_to(figure: Experiment, stand: Stand, trials: int = SWEEP_TRIALS, seed: int = 0) -> Experiment:
    """The figure with the sweep in its data and, in words, in its notes."""
    sizes = sweep(stand, trials=trials, seed=seed)
    rows = "; ".join(
        f"{one.noise_px:g} px: {', '.join(f'{100 * part:.0f} %' for part in one.filled.values())}"
        for one in sizes
    )
    note = f"How far up the paper's axes of Figs. 8, 9, 10 and 11 (90, 12, 50 and 25 mm) Eq. 1 comes, by corner noise. {rows}."
    data = {
        "trials": trials,
        "paper_axes_mm": PAPER_AXES_MM,
        "largest_mm": [{"noise_px": s.noise_px, "eq1": s.eq1_mm, "eq2": s.eq2_mm} for s in sizes],
    }
    return replace(figure, data=figure.data | {"size_by_noise": data}, notes=(*figure.notes, note))
