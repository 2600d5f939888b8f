"""Faults injected into robots of servos: the torque is as promised, and no servo was told more than its limit. Figures: docs/faults.md."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import ProcessPoolExecutor

import pytest

pytest.importorskip("dynamixel_sdk")
pytest.importorskip("scservo_sdk")

from faulty_servos import kinds, trial

SEED = 7
NOT_OF_THIS_PROGRAM = ("limits_written_over",)
"""Another program takes the limit away in the middle of a motion: until that is seen, within a few hundredths of a second, a servo turns faster."""
CHOSEN = (
    *("answers_garbled", "packets_not_heard", "answers_late", "line_dead_for_a_moment", "line_cut"),
    *(
        "overload",
        "too_heavy",
        "power_dips",
        "power_dips_and_torque_comes_back",
        "servo_dies",
        "limits_written_over",
    ),
    *("signals_one_after_another", "parent_ends", "killed"),
    *("raises", "exits", "closed_by_another_thread", "commands_nonsense"),
    *("clock_is_set", "machine_is_busy"),
)


@pytest.mark.realtime
def test_whatever_fails_the_torque_is_as_promised() -> None:
    chosen = [kind for kind in kinds() if kind[1] in CHOSEN]
    assert len(chosen) == len(CHOSEN) == 20
    with ProcessPoolExecutor(6, multiprocessing.get_context("spawn")) as pool:
        trials = list(pool.map(trial, chosen, [SEED] * len(chosen)))
    for one in trials:
        assert one.promise_kept and one.still, one
        assert 0.0 < one.commanded_share <= 1.0, one
        assert one.fastest_share <= 1.001 or one.fault in NOT_OF_THIS_PROGRAM, one
    assert {one.make for one in trials} == {"dynamixel", "feetech"}
    assert {one.at_end for one in trials} == {"off", "hold"}
    ended = {one.fault: one for one in trials}
    for fault in ("line_cut", "power_dips", "parent_ends", "raises", "overload"):
        assert ended[fault].ended != "went on", ended[fault]
    assert ended["killed"].torque == "held" and ended["line_cut"].said == "not known"
