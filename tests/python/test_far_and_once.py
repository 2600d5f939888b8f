"""A marker that is far from its place is no marker on another link, and a zero that changes once is no drift: both were told at 0.99.

The sessions come from `twisted_arm`, which shares nothing with the core.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import mirror_posture as mp
import twisted_arm
from twisted_arm import Wrong, write_tracked

STILL = 0.25
"""The part of their range that the wrist's joints use: a marker beyond them hardly tells which of them moves it."""


def test_a_marker_far_from_its_place_is_that_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("LOW_RAD", "HIGH_RAD"):
        limits = getattr(twisted_arm, name).copy()
        limits[3:] *= STILL
        monkeypatch.setattr(twisted_arm, name, limits)
    off_m = (0.02, -0.01, 0.012)
    found = mp.diagnose(write_tracked(tmp_path / "far", 0, Wrong("j4", marker_m=("tool_a", off_m))))
    (cause,) = found.causes
    assert (cause.effect, cause.at, found.verdict) == ("marker_mount", "marker:tool_a", "explained")
    told = [cause.parameters[name].value for name in ("dx_m", "dy_m", "dz_m")]
    assert told == pytest.approx(off_m, abs=5e-4)


@pytest.mark.parametrize(
    ("joint", "zero_rad"), [("j1", 0.012), ("j3", 0.012), ("j4", 0.012), ("j4", 0.03), ("j5", 0.012)]
)
def test_a_zero_that_changes_once_is_no_drift(joint: str, zero_rad: float, tmp_path: Path) -> None:
    once = Wrong(joint, zero_rad=zero_rad, from_row=25)
    found = mp.diagnose(write_tracked(tmp_path / "once", 3, once, std_m=5e-4))
    assert found.verdict == "unknown" and not found.causes
    assert found.where[0].at == f"joint:{joint}"
    (warning,) = [text for text in found.warnings if "another zero" in text]
    told = re.search(r"from row (\d+) on: its position is ([0-9.]+) rad larger than", warning)
    assert told, warning
    # With a small step a row more or less is within chance.
    assert abs(int(told[1]) - 25) <= 1 and abs(float(told[2]) - zero_rad) < 0.0015, warning
