"""The second half of the demonstration: the robot that was measured is diagnosed and corrected."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .output import Output
from .plugins import plugins

if TYPE_CHECKING:
    from ..session import Session

TWIN = "twin"
NOISE_PX = 0.1
"""Noise of the twin's exact pixels, px."""
LOOKS = 8
"""The most looks of the correction."""
MILLIMETRES = 1000.0


def demonstrate_diagnosis(output: Output, session: Session, folder: Path) -> dict[str, Any]:
    """Diagnoses the measured session, writes diagnosis.json and the report; returns the result for
    `--json`."""
    from ..diagnosis import diagnose
    from .told_diagnosis import write_results

    found = diagnose(session)
    output.say(found.sentence)
    write_results(output, session, found, folder)
    return {
        "verdict": found.verdict,
        "causes": [{"effect": cause.effect, "at": cause.at} for cause in found.causes],
        "gap_before_m": found.gap.before_m,
        "gap_after_m": found.gap.after_m,
    }


def demonstrate_correction(
    output: Output, hidden_rad: Mapping[str, float], posture: Mapping[str, float], seed: int, picture: Path
) -> dict[str, Any] | None:
    """Corrects a simulated robot with the same joint errors, by looks into the mirror (exact pixels with
    noise).

    The simulated robot is in the distribution mirror-posture-lab; without it nothing is corrected, and a
    message says so.
    """
    from ..correct import CorrectOptions, StopOptions, correct
    from ..correct.figures import plot_convergence
    from ..robots import Nominal
    from .commands._robots import ROBOT_GROUP

    opens = plugins(ROBOT_GROUP)
    if TWIN not in opens:
        output.warn("the correction is left out: simulated robots need pip install 'mirror-posture[lab]'")
        return None
    nominal = Nominal.load()
    options = CorrectOptions(stop=StopOptions(looks=LOOKS))
    settings = {
        "hide": [f"joint_offset@joint:{name}:offset_rad={value!r}" for name, value in hidden_rad.items()],
        "pictures": False,
        "noise_px": NOISE_PX,
        "stand_error_deg": 0.5,
        "seed": seed,
    }
    with opens[TWIN].load()(settings, nominal, output.say) as robot:
        outcome = correct(robot, posture, options)
    plot_convergence(outcome, picture, options.stop.tolerance_m)
    by_look = [
        {m.marker: m.distance_m for m in look.markers if m.distance_m is not None} for look in outcome.looks
    ]
    output.table(
        "Distance of the markers from where the model wants them, mm",
        ("look", *outcome.markers),
        [
            (
                str(number),
                *(f"{MILLIMETRES * look[name]:.2f}" if name in look else "" for name in outcome.markers),
            )
            for number, look in enumerate(by_look, 1)
        ],
    )
    output.say(outcome.stop.sentence)
    return {"stop": outcome.stop.kind, "distance_m": by_look}
