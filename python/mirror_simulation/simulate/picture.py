"""The staircase as a picture: the simulator's gap after each cause, and the gap that the diagnosis
predicted."""

from __future__ import annotations

from pathlib import Path

from mirror_posture.diagnosis.formatting import effect_in_words, place_in_words
from mirror_posture.pages.drawing import AFTER, BEFORE, PNG_DPI, figure, styled

from .staircase import Simulation

WIDEST_LABEL = 34


@styled
def draw_staircase(simulation: Simulation, file: Path) -> None:
    """Writes the staircase as PNG: a step for each cause, in px and in mm; the diagnosis' prediction is
    dashed."""
    stairs = simulation.stairs
    drawn, axes = figure(9.0, 1.6 + 0.75 * len(stairs), 1, 2, sharey=True)
    places = range(len(stairs))
    for axis, unit, scale, values, told in (
        (
            axes[0, 0],
            "px",
            1.0,
            [stair.gap.rms_px for stair in stairs],
            (simulation.told_before_px, simulation.told_after_px),
        ),
        (
            axes[0, 1],
            "mm",
            1e3,
            [stair.gap.rms_m for stair in stairs],
            (simulation.told_before_m, simulation.told_after_m),
        ),
    ):
        lengths = [scale * (value or 0.0) for value in values]
        colours = [BEFORE] + [AFTER] * (len(stairs) - 1)
        axis.barh(places, lengths, color=colours, height=0.6)
        dashes = dict(zip((0, len(stairs) - 1), told, strict=True)) if len(stairs) > 1 else {}
        for place, value in zip(places, values, strict=True):
            text = "not measured" if value is None else f"{scale * value:.3g}"
            axis.annotate(
                text,
                (scale * max(value or 0.0, dashes.get(place) or 0.0), place),
                xytext=(4, 0),
                textcoords="offset points",
                va="center",
            )
        for place, value in dashes.items():
            if value is not None:
                axis.plot([scale * value] * 2, [place - 0.38, place + 0.38], color="black", ls="--", lw=1.3)
        axis.set_xlabel(f"simulated against seen, RMS {unit}")
        axis.margins(x=0.18)
    axes[0, 0].set_yticks(places, [_label(stair.added, stair.simulated) for stair in stairs])
    axes[0, 0].invert_yaxis()
    title = f"The gap in the simulator, {simulation.model_file.name}"
    if simulation.told_after_px is not None or simulation.told_after_m is not None:
        title += " (dashed: as the diagnosis told it, held out)"
    drawn.suptitle(title, fontsize=11)
    drawn.savefig(file, dpi=PNG_DPI)


def _label(added: str | None, simulated: bool) -> str:
    if added is None:
        return "the model as it is"
    effect, _, place = added.partition("@")
    where = place_in_words(place)
    where = where if len(where) <= WIDEST_LABEL else where[: WIDEST_LABEL - 1] + "…"
    return f"+ {effect_in_words(effect)}\n{where}" + ("" if simulated else "\n(cannot be simulated)")
