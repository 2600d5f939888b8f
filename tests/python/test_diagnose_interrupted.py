"""Ctrl-C while a session is diagnosed: what was found so far is kept, says of itself that it was interrupted, and soon."""

from __future__ import annotations

import _thread
import json
import signal
import threading
import time
from pathlib import Path

import pytest

import mirror_posture as mp
from diagnosis_format import faults
from mirror_posture.cli.commands import diagnose as command
from mirror_posture.cli.output import Output
from mirror_posture.diagnosis.applied import apply_diagnosis
from mirror_posture.diagnosis.run import DiagnosisInterrupted
from session_folder import DATA
from tracked_session import write_tracked

LONG = DATA / "sessions" / "dev-000"
SOON_S = 0.2
STAGES = (
    "searching for gross mistakes",
    "searching for causes",
    "comparing the causes found",
    "assessing the result",
)
"""As the core goes through them."""


def _actual(q: dict[str, float]) -> dict[str, float]:
    return q | {"r_elbow": 1.05 * q["r_elbow"]}


def _clocks() -> tuple[float, float]:
    """By the clock, and of the processor, s."""
    return time.perf_counter(), time.process_time()


def _interrupted(session: Path, after: str) -> tuple[DiagnosisInterrupted, float, list[str]]:
    """Diagnoses, with a Ctrl-C as soon as the stage begins with `after`; how long the answer took, and the stages."""
    stages: list[str] = []
    pressed: list[tuple[float, float]] = []

    def watch(stage: str, found: int) -> None:
        stages.append(stage)
        if stage.startswith(after) and not pressed:
            pressed.append(_clocks())
            _thread.interrupt_main()

    # A shell starts what it runs in the background with Ctrl-C ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(DiagnosisInterrupted) as caught:
            mp.diagnose(session, progress=watch)
    finally:
        signal.signal(signal.SIGINT, before)
    # The lesser of both: neither a busy machine's pauses nor a second core's work count.
    return caught.value, min(now - then for now, then in zip(_clocks(), pressed[0], strict=True)), stages


@pytest.mark.skipif(not LONG.is_dir(), reason=f"{LONG} is not there")
def test_ctrl_c_is_answered_soon_and_what_was_found_is_a_diagnosis(tmp_path: Path) -> None:
    # A busy machine may have a pause of its own: the better of two tries.
    tries = [_interrupted(LONG, "searching") for _ in range(2)]
    assert min(took for _, took, _ in tries) < SOON_S + 0.05
    found = tries[0][0].found
    assert found.interrupted and faults(dict(found.document)) == []
    assert found.gap.before_m is None and found.limits == ()
    session = mp.load_session(LONG)
    with pytest.raises(mp.MirrorPostureError, match="interrupted"):
        apply_diagnosis(session, found, tmp_path / "better")
    # The page and the tables take it as it is.
    command.write_results(Output(), session, found, tmp_path / "out")
    assert "Interrupted" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert (
        json.loads((tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8"))["interrupted"] is True
    )


def test_progress_is_told_in_order_from_another_thread(tmp_path: Path) -> None:
    told: list[tuple[str, int]] = []
    threads = set()

    def watch(stage: str, found: int) -> None:
        told.append((stage, found))
        threads.add(threading.get_ident())

    session, other = (write_tracked(tmp_path / f"s{k}", k, _actual) for k in range(2))
    # So many predictions last a second; what is done sooner may be over between two looks.
    mp.diagnose(session, check=[mp.load_session(other)] * 200, progress=watch)
    assert told and told[-1] == (STAGES[-1], 1)
    assert len(threads) == 1 and threading.get_ident() not in threads
    assert len(set(told)) == len(told)
    places = [STAGES.index(stage) for stage, _ in told]
    assert places == sorted(places)
    assert all(found >= 0 for _, found in told)
