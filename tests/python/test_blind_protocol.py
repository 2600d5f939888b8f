"""Seals, running and scoring: the protocol, on answers and diagnoses whose score is known."""

from __future__ import annotations

import json
import os
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirror_lab.blind import BlindError
from mirror_lab.blind.runner import run_sessions, timed
from mirror_lab.blind.score import score
from mirror_lab.blind.score_page import write_page
from mirror_lab.blind.seal import seal, unseal
from mirror_lab.blind.statistics import Rate, coverage, reliability


def _case(folder: Path, name: str, causes: list[dict[str, Any]], **more: Any) -> None:
    (folder / name).mkdir(parents=True)
    seal(
        {"id": name, "causes": causes, **more},
        folder / "answers" / f"{name}.json",
        folder / name / "seal.json",
    )


def _said(
    results: Path, name: str, verdict: str, causes: list[dict[str, Any]], where: list[str] | None = None
) -> None:
    (results / name).mkdir(parents=True)
    body = {
        "format": "mirror-posture/diagnosis",
        "version": 1,
        "verdict": verdict,
        "causes": causes,
        "where": [{"at": w, "share": 1.0} for w in where or []],
        "gap": {"closed": 0.99, "closed_ci95": [0.97, 1.0]},
    }
    (results / name / "diagnosis.json").write_text(json.dumps(body), encoding="utf-8")


OFFSET = {"effect": "joint_offset", "at": "joint:a", "offset_rad": 0.02}


def _named(effect: str, at: str, p: float = 0.9, **parameters: tuple[float, float]) -> dict[str, Any]:
    values = {k: {"value": v, "std": s} for k, (v, s) in parameters.items()}
    return {"effect": effect, "at": at, "probability": p, "parameters": values, "alternatives": []}


def test_a_changed_answer_is_refused(tmp_path: Path) -> None:
    _case(tmp_path, "one", [OFFSET])
    answer, stamp = tmp_path / "answers" / "one.json", tmp_path / "one" / "seal.json"
    assert unseal(answer, stamp)["causes"] == [OFFSET]
    answer.write_text(answer.read_text(encoding="utf-8").replace("0.02", "0.03"), encoding="utf-8")
    with pytest.raises(BlindError, match="changed afterwards"):
        unseal(answer, stamp)
    assert "joint" not in stamp.read_text(encoding="utf-8")


def test_the_same_answer_has_another_seal_each_time(tmp_path: Path) -> None:
    _case(tmp_path, "one", [])
    _case(tmp_path, "two", [])
    seals = [
        json.loads((tmp_path / n / "seal.json").read_text(encoding="utf-8"))["sha256"] for n in ("one", "two")
    ]
    assert seals[0] != seals[1]


def test_score_counts_right_wrong_invented_and_false_alarms(tmp_path: Path) -> None:
    cases, results = tmp_path / "cases", tmp_path / "results"
    shows = {"identifiable": True, "detectable": True, "rivals": []}
    _case(cases, "right", [OFFSET], **shows)
    _said(results, "right", "explained", [_named("joint_offset", "joint:a", offset_rad=(0.021, 0.001))])
    _case(cases, "wrong-place", [OFFSET], **shows)
    _said(results, "wrong-place", "explained", [_named("joint_offset", "joint:b")])
    _case(cases, "tied", [OFFSET], identifiable=False, rivals=["marker_mount@marker:m"])
    _said(results, "tied", "explained", [_named("marker_mount", "marker:m", 0.4)])
    _case(cases, "empty-quiet", [])
    _said(results, "empty-quiet", "none", [])
    _case(cases, "empty-alarm", [])
    _said(results, "empty-alarm", "explained", [_named("drift", "joint:a")])
    two = [{**OFFSET, **shows}, {"effect": "drift", "at": "joint:c", "rate_rad_per_s": 1e-4, **shows}]
    _case(cases, "two", two)
    _said(results, "two", "partial", [_named("joint_offset", "joint:a"), _named("board_scale", "board")])
    strange = {"effect": "unknown", "kind": "cable", "at": "joint:a"}
    _case(cases, "strange-met", [strange], **shows)
    _said(results, "strange-met", "unknown", [], ["joint:a"])
    _case(cases, "strange-wrong", [strange], **shows)
    _said(results, "strange-wrong", "explained", [_named("drift", "joint:a")], ["joint:a"])
    got = score(cases, results)

    def counts(key: str) -> tuple[int, int]:
        return got[key]["hits"], got[key]["of"]

    assert counts("single_identifiable_right") == (1, 2)
    assert counts("single_not_identifiable_found_or_tied") == (1, 1)
    assert counts("several_identifiable_found") == (1, 2)
    assert counts("several_invented") == (1, 2)
    assert counts("false_alarms") == (1, 2)
    assert counts("outside_met") == (1, 2)
    assert counts("outside_confidently_wrong") == (1, 2)
    assert got["confusion"] == {"joint_offset": {"joint_offset": 1, "~joint_offset": 1}}
    assert got["parameters"]["within_95"]["hits"] == 1 and got["parameters"]["rms"] == pytest.approx(1.0)
    assert {f["session"] for f in got["failures"]} == {"wrong-place", "empty-alarm", "two", "strange-wrong"}
    page = tmp_path / "score.html"
    write_page(got, page)
    text = page.read_text(encoding="utf-8")
    assert "strange-wrong" in text and "http:" not in text and "https:" not in text
    left = score(cases, results, leave_out="joint_offset")
    assert left["single_identifiable_right"]["of"] == 0
    assert left["outside_met"]["of"] == 4, "two strange ones, two offsets that show"
    assert left["left_out_of_several"] == ["two"], "what the others make of one of several was not judged"


def _diagnose(session: Path) -> str:
    """A stand-in: session `b` fails until it is mended, `c` takes its process with it."""
    if session.name == "b" and not (session / "mended").exists():
        raise ValueError("broken")
    if session.name == "c" and not (session / "mended").exists():
        os._exit(9)
    return json.dumps({"name": session.name})


def test_run_resumes_and_keeps_failures(tmp_path: Path) -> None:
    cases, results = tmp_path / "cases", tmp_path / "results"
    for name in ("a", "b"):
        _case(cases, name, [])
    pool = partial(ThreadPoolExecutor, 2)
    told: list[tuple[str, bool]] = []
    first = run_sessions(
        cases, results, lambda p, s: p.submit(timed, _diagnose, s), pool, lambda *x: told.append(x)
    )
    assert (first.done, first.before, first.failed) == (1, 0, ["b"])
    assert sorted(told) == [("a", True), ("b", False)]
    assert "broken" in json.loads((results / "b" / "failure.json").read_text(encoding="utf-8"))["message"]
    (cases / "b" / "mended").touch()
    second = run_sessions(cases, results, lambda p, s: p.submit(timed, _diagnose, s), pool)
    assert (second.done, second.before, second.failed) == (1, 1, [])
    assert not (results / "b" / "failure.json").exists()
    assert json.loads((results / "a" / "time.json").read_text(encoding="utf-8"))["cpu_seconds"] >= 0


def test_a_session_that_kills_its_process_costs_no_other(tmp_path: Path) -> None:
    cases, results = tmp_path / "cases", tmp_path / "results"
    for name in ("a", "c", "d", "e"):
        _case(cases, name, [])
    pool = partial(ProcessPoolExecutor, 1, mp_context=get_context("fork"))
    report = run_sessions(cases, results, lambda p, s: p.submit(timed, _diagnose, s), pool)
    assert (report.done, report.failed) == (3, ["c"])
    assert json.loads((results / "c" / "failure.json").read_text(encoding="utf-8"))["error"] == (
        "BrokenProcessPool"
    )


def test_wilson_interval_against_its_published_values() -> None:
    low, high = Rate(8, 10).interval
    assert (low, high) == (pytest.approx(0.4902, abs=2e-4), pytest.approx(0.9433, abs=2e-4))
    assert Rate(0, 0).interval == (0.0, 1.0)
    assert Rate(10, 10).interval[0] == pytest.approx(0.7225, abs=2e-4)


def test_calibrated_claims_have_a_small_error_and_bold_ones_a_large_one() -> None:
    rng = np.random.default_rng(0)
    p = rng.uniform(0, 1, 20000)
    right = [bool(v) for v in rng.random(20000) < p]
    assert reliability(list(p), right)["expected_calibration_error"] < 0.015
    assert reliability([0.95] * 1000, right[:1000])["expected_calibration_error"] > 0.3
    assert coverage(list(rng.normal(size=20000)))["within_95"]["rate"] == pytest.approx(0.95, abs=0.01)
