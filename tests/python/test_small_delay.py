"""A log that is late, or early, by a small part of a row: as small as usual errors, and no error of any one joint.

The body that is seen is that of the simulated robots, which share nothing with the core.
"""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("mujoco", reason="the mirrored session needs mirror_lab's robots")

from mirror_posture.diagnosis import diagnose
from mirrored_session import write_mirrored
from session_breaks.kinds import read, write

ROW_S = 2.0
ZERO_RAD = 0.03


def shifted(folder: Path, rows: float) -> None:
    """The log, late by a part of a row: each position lies between this row's and the one before; the one after, if it is early."""
    head, *logged = read(folder / "frames.csv")
    own = [[float(x) for x in row[3:]] for row in logged]
    other = [own[0], *own[:-1]] if rows > 0 else [*own[1:], own[-1]]
    part = abs(rows)
    mixed = [
        [(1 - part) * a + part * b for a, b in zip(x, y, strict=True)]
        for x, y in zip(own, other, strict=True)
    ]
    # No two rows hold the same command now: each is a posture of its own.
    rows_of = [[row[0], row[0], row[2], *map(repr, q)] for row, q in zip(logged, mixed, strict=True)]
    write(folder / "frames.csv", [head, *rows_of])


@pytest.mark.parametrize("rows", [0.04, -0.04, 0.12])
def test_a_small_delay_of_all_joints_is_told_with_the_zero_beside_it(tmp_path: Path, rows: float) -> None:
    folder = write_mirrored(
        tmp_path / "s", 8, lambda q: {**q, "r_shoulder_roll": q["r_shoulder_roll"] + ZERO_RAD}, postures=60
    )
    shifted(folder, rows)
    found = diagnose(folder)
    told = {f"{c.effect}@{c.at}": c for c in found.causes if c.probability >= 0.5}
    assert set(told) == {"joint_late@robot", "joint_offset@joint:r_shoulder_roll"}, found.sentence
    delay = told["joint_late@robot"].parameters["delay_s"]
    assert abs(delay.value - ROW_S * rows) < 5 * delay.std + 0.02 * ROW_S * abs(rows), delay
    zero = told["joint_offset@joint:r_shoulder_roll"].parameters["offset_rad"]
    assert abs(zero.value - ZERO_RAD) < 5 * zero.std, zero
    assert found.verdict == "explained", found.sentence


def test_a_log_in_time_is_not_late(tmp_path: Path) -> None:
    # Play is the error that is most like it: it follows the direction of motion.
    side = [1.0, 0.0]

    def actual(q: dict[str, float]) -> dict[str, float]:
        if q["r_elbow"] != side[1]:
            side[:] = [1.0 if q["r_elbow"] > side[1] else -1.0, q["r_elbow"]]
        return {
            **q,
            "r_elbow": q["r_elbow"] - 0.04 * side[0],
            "r_shoulder_pitch": q["r_shoulder_pitch"] + ZERO_RAD,
        }

    found = diagnose(write_mirrored(tmp_path / "s", 9, actual, postures=60))
    told = {f"{c.effect}@{c.at}" for c in found.causes}
    assert not any(name.startswith("joint_late") for name in told), found.sentence
    assert found.verdict == "explained", found.sentence
