"""A joint that rests anywhere, of a robot that was mounted by hand (a session beside the project, where there is one)."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path

import numpy as np
import pytest

import mirror_posture as mp
from session_folder import DATA

BY_HAND = DATA / "by-hand" / "hand-012"
JOINT = "right_elbow_joint"


@pytest.mark.skipif(not BY_HAND.is_dir(), reason="sessions mounted by hand are not beside the project")
def test_it_is_told_at_its_place_and_no_gear_or_coupling_in_its_stead(tmp_path: Path) -> None:
    session = tmp_path / "session"
    shutil.copytree(BY_HAND, session)
    with (session / "frames.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    column, posture = header.index(JOINT), header.index("posture")
    random = np.random.default_rng(2026)
    rest = {name: random.normal(0.0, np.radians(0.5)) for name in dict.fromkeys(row[posture] for row in rows)}
    for row in rows:
        row[column] = f"{float(row[column]) + rest[row[posture]]:.6f}"
    with (session / "frames.csv").open("w", newline="") as file:
        csv.writer(file).writerows([header, *rows])
    found = mp.diagnose(session)
    assert (f"joint:{JOINT}", "posture, each by itself") in {(w.at, w.depends_on) for w in found.where}
    named = [cause for cause in found.causes if cause.kind != "setup" and cause.probability > 0.5]
    # The zeros of that robot are off, by 0.15 degrees.
    assert {cause.effect for cause in named} <= {"geometry"}, named
    for zeros in named:
        spread = zeros.parameters["spread_rad"]
        assert (
            abs(spread.value - np.radians(0.15)) < 3 * spread.std
            and zeros.parameters["spread_m"].value == 0.0
        )
