"""A joint that stops short of each row's target by the whole dead band, however small the row's motion is: between the rows it
was elsewhere. Play and a dead band are then the same, and no other cause is needed beside them.

The body that is seen is that of the simulated robots, which share nothing with the core.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

pytest.importorskip("mujoco", reason="the mirrored session needs mirror_lab's robots")

from mirror_posture.diagnosis import diagnose
from mirrored_session import write_mirrored

JOINT = "r_elbow"
BAND_RAD = 0.06


def stops_short(band_rad: float, directly: bool) -> Callable[[dict[str, float]], dict[str, float]]:
    """By the dead band on the side from which it came; if it comes directly, a motion within the band does not move it."""
    rests = [0.0]

    def actual(q: dict[str, float]) -> dict[str, float]:
        target = q[JOINT]
        if directly:
            rests.append(min(max(rests[-1], target - band_rad), target + band_rad))
        else:
            way = 1.0 if target > rests[0] else -1.0
            rests[0] = target
            rests.append(target - way * band_rad)
        return {**q, JOINT: rests[-1]}

    return actual


@pytest.mark.parametrize("directly", [False, True], ids=["from afar", "directly"])
def test_a_dead_band_is_told_as_such_or_as_play_however_the_joint_comes_to_each_row(
    tmp_path: Path, directly: bool
) -> None:
    folder = write_mirrored(tmp_path / "s", 3, stops_short(BAND_RAD, directly))
    found = diagnose(folder)
    (cause,) = found.causes
    assert cause.at == f"joint:{JOINT}", found.sentence
    told = {cause.effect: cause.probability} | {a.effect: a.probability for a in cause.alternatives}
    assert {"stiction", "backlash"} <= set(told), found.sentence
    # Nothing that was seen tells one from the other.
    assert max(told.values()) < 0.9 < told["stiction"] + told["backlash"], told
    size = cause.parameters.get("deadband_rad") or cause.parameters["width_rad"]
    band_rad = size.value if cause.effect == "stiction" else size.value / 2
    assert abs(band_rad - BAND_RAD) < 4 * size.std, cause
    assert found.verdict == "explained", found.sentence
    assert not found.data.left_out, found.data.left_out
