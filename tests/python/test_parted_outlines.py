"""Balls whose outline parts, into edges of which each set agrees with a sphere of its own: the claim holds the distance."""

from __future__ import annotations

from pathlib import Path

import pytest

from ball_variants import score

GLASS = Path(__file__).resolve().parents[3] / "shared" / "data" / "pictures" / "mitsuba-glass-a"


@pytest.mark.skipif(not GLASS.is_dir(), reason="the shared pictures are not here")
def test_no_large_ball_is_wrong_by_a_part_of_its_outline() -> None:
    # Interpolated to five times the size: some tenths of a pixel of shading part the edges of these two pictures' balls.
    (found,) = score(GLASS, ["size × 5.0"], pictures=5, seed=606, first=14)
    assert len(found.errors) >= 10
    assert found.wrong == 0, found.worst
