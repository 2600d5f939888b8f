"""Words that several commands share: counts, and distances of several markers."""

from __future__ import annotations

import pytest

from mirror_posture.correct.outcome import Stop
from mirror_posture.counted import counted


def test_one_of_a_thing_and_several() -> None:
    assert [counted(count, "picture") for count in (0, 1, 4)] == ["0 pictures", "1 picture", "4 pictures"]
    assert [counted(count, "mesh was", "meshes were") for count in (1, 2)] == ["1 mesh was", "2 meshes were"]


@pytest.mark.parametrize(
    ("measured_m", "below_m", "measured", "below"),
    [
        ([0.0005], [0.00075], "0.50 mm", "0.75 mm"),
        ([0.0005, 0.0004], [0.00075, 0.00064], "0.50 and 0.40 mm", "0.75 and 0.64 mm"),
        ([0.0005, 0.0004, 0.0], [0.0007, 0.0006, 0.0002], "0.50, 0.40 and 0.00 mm", "0.70, 0.60 and 0.20 mm"),
    ],
)  # fmt: skip
def test_the_end_of_a_correction_is_a_sentence(
    measured_m: list[float], below_m: list[float], measured: str, below: str
) -> None:
    """Before: "every marker is below 0.75, 0.64 mm from its target"."""
    evidence = {"distance_m": measured_m, "below_m": below_m, "tolerance_m": 0.001, "wrong_converged": 0.01}
    assert Stop("converged", evidence).sentence == (
        f"converged: every marker is within 1.00 mm of its target (measured {measured} away, at most {below} with the measurement's "
        "uncertainty); wrong in at most 1 % of corrections"
    )
    stalled = Stop("stalled", {"distance_m": measured_m, "cause": "no_progress", "responses": [], "left_m": below_m, "below_m": below_m})  # fmt: skip
    assert stalled.sentence.startswith(f"stalled at {measured} from the target")
    spent = Stop("budget_spent", {"looks": 1, "distance_m": measured_m})
    assert spent.sentence == f"budget spent: 1 look; {measured} are left"
