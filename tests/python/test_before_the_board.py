"""Mistakes of joints that carry the camera: no mirror explains the board of such a row, so its picture looks like that of another
board.

The body that is seen is that of the simulated robots, which share nothing with the core.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count
from pathlib import Path

import pytest

pytest.importorskip("mujoco", reason="the mirrored session needs mirror_lab's robots")

from mirror_posture.diagnosis import Diagnosis, diagnose
from mirrored_session import TURNS_RAD, write_mirrored
from session_breaks.kinds import read, write

SEED = 12
POSTURES = 60
HEAD_RAD = 0.3


def said(found: Diagnosis) -> set[str]:
    return {f"{c.effect}@{c.at}" for c in found.causes if c.probability >= 0.5}


def test_a_joint_of_the_head_that_stands_still_to_the_end_is_no_false_board(tmp_path: Path) -> None:
    rows: Iterator[int] = count()
    kept: list[float] = []

    def stops(q: dict[str, float]) -> dict[str, float]:
        if next(rows) >= POSTURES // 2:
            return {**q, "head_pitch": kept[-1]}
        kept.append(q["head_pitch"])
        return q

    folder = write_mirrored(tmp_path / "s", SEED, stops, POSTURES, head_rad=HEAD_RAD)
    found = diagnose(folder)
    assert said(found) == {"joint_frozen@joint:head_pitch"}, found.sentence
    (frozen,) = found.causes
    first = len(TURNS_RAD) * POSTURES // 2
    assert abs(frozen.parameters["first_frame"].value - first) <= 2, frozen.parameters
    assert found.verdict == "explained", found.sentence
    # Only what has no board at all is left out.
    assert {left.why for left in found.data.left_out} <= {"the mirror of this frame is not known: no board"}
    assert not any("no flat mirror" in warning for warning in found.warnings), found.warnings


def test_rows_of_the_head_s_earlier_posture_are_no_slips(tmp_path: Path) -> None:
    folder = write_mirrored(tmp_path / "s", SEED, postures=POSTURES, head_rad=HEAD_RAD)
    # From frame 40 to 79 the log holds the posture before.
    head, *rows = read(folder / "frames.csv")
    views = len(TURNS_RAD)
    logged = [[*row[:3], *rows[i - views][3:]] if 40 <= i < 80 else row for i, row in enumerate(rows)]
    write(folder / "frames.csv", [head, *logged])
    found = diagnose(folder)
    assert said(found) == {"pairing@data"}, found.sentence
    (pairing,) = found.causes
    told = {name: parameter.value for name, parameter in pairing.parameters.items()}
    assert abs(told["first_frame"] - 40) <= 2 and abs(told["last_frame"] - 79) <= 4, told
    assert found.verdict == "explained", found.sentence
