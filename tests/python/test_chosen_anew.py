"""The gap told with causes that are chosen anew without the region that they predict."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mirror_posture as mp
from tracked_session import write_tracked

OFFSET_RAD = 0.012


def session_with_elbow(folder: Path, elbow_rad: float) -> Path:
    """75 postures with the elbow at one place and 15, near one another, at another: an offset of the elbow and a ratio of its gear are one
    thing on the 75."""
    rng = np.random.default_rng(7)
    many = [
        (rng.uniform(-1.2, 1.2), rng.uniform(-1.2, -0.1), rng.normal(elbow_rad, 0.003)) for _ in range(75)
    ]
    few = [(rng.uniform(-0.2, 0.2), rng.uniform(-0.7, -0.6), rng.uniform(1.2, 1.3)) for _ in range(15)]
    return write_tracked(
        folder, 1, lambda q: {**q, "r_elbow": q["r_elbow"] + OFFSET_RAD}, postures=many + few
    )


def test_a_choice_that_hangs_on_one_region_is_said_to(tmp_path: Path) -> None:
    found = mp.diagnose(session_with_elbow(tmp_path / "session", 0.3))
    assert [(c.effect, c.at) for c in found.causes] == [("joint_offset", "joint:r_elbow")]
    gap, anew = found.gap, found.gap.chosen_anew
    # The 15 tell an offset from a ratio, and with that choice all regions are predicted to the noise.
    assert gap.after_m < 1.1 * gap.noise_floor_m
    # Without them it is taken for a ratio, which at 1.25 rad is off by three times the offset.
    assert (anew.regions, anew.changed) == (5, 1)
    assert anew.rms_m > 1.4 * gap.after_m
    assert any("depends on few postures" in warning for warning in found.warnings)


def test_a_choice_that_every_region_tells_is_the_same_gap(tmp_path: Path) -> None:
    session = write_tracked(
        tmp_path / "session", 2, lambda q: {**q, "r_elbow": q["r_elbow"] + 3 * OFFSET_RAD}
    )
    found = mp.diagnose(session)
    anew = found.gap.chosen_anew
    assert anew.changed == 0
    assert anew.rms_m == pytest.approx(found.gap.after_m, rel=1e-9)
    assert not any("depends on few postures" in warning for warning in found.warnings)


def test_nothing_named_is_not_chosen_anew(tmp_path: Path) -> None:
    assert mp.diagnose(write_tracked(tmp_path / "session", 3)).gap.chosen_anew is None
