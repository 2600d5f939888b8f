"""Results of the blind checks belong to the sessions and the vocabulary with which they were made."""

from __future__ import annotations

import json
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path

import pytest

from mirror_lab.blind import BlindError
from mirror_lab.blind.runner import Diagnosed, RunReport, run_sessions, timed
from mirror_lab.blind.score import score
from mirror_lab.blind.seal import seal


def _case(folder: Path, name: str) -> None:
    (folder / name).mkdir(parents=True, exist_ok=True)
    seal({"id": name, "causes": []}, folder / "answers" / f"{name}.json", folder / name / "seal.json")


def _diagnose(session: Path) -> str:
    return json.dumps(
        {
            "format": "mirror-posture/diagnosis",
            "version": 2,
            "verdict": "none",
            "causes": [],
            "name": session.name,
        }
    )


def _run(cases: Path, results: Path, leave_out: str | None = None) -> RunReport:
    def submit(pool: Executor, session: Path) -> Future[Diagnosed]:
        return pool.submit(timed, _diagnose, session)

    pool = partial(ThreadPoolExecutor, 1)
    if leave_out is None:
        return run_sessions(cases, results, submit, pool)
    return run_sessions(cases, results, submit, pool, leave_out=leave_out)


def test_results_of_another_vocabulary_are_refused(tmp_path: Path) -> None:
    cases, results = tmp_path / "cases", tmp_path / "results"
    _case(cases, "a")
    assert _run(cases, results).done == 1
    _case(cases, "b")
    with pytest.raises(BlindError, match="left out none, got drift; give the same, or use another folder"):
        _run(cases, results, "drift")
    with pytest.raises(BlindError, match="use another folder"):
        score(cases, results, "drift")
    assert _run(cases, results).before == 1, "the rest is diagnosed"
    assert score(cases, results)["false_alarms"]["of"] == 2
    assert _run(cases, tmp_path / "other", "drift").done == 2
    assert score(cases, tmp_path / "other", "drift")["sessions"] == 2


def test_results_of_other_sessions_are_refused(tmp_path: Path) -> None:
    cases, results = tmp_path / "cases", tmp_path / "results"
    _case(cases, "a")
    _run(cases, results)
    # The same name again, from another seed.
    _case(cases, "a")
    for again in (lambda: _run(cases, results), lambda: score(cases, results)):
        with pytest.raises(BlindError, match=r"a: is the result of another session .* use another folder"):
            again()
    # A session that had no result yet may be another one.
    (results / "a" / "diagnosis.json").unlink()
    assert _run(cases, results).done == 1 and score(cases, results)["sessions"] == 1


def test_results_of_an_earlier_version_are_kept(tmp_path: Path) -> None:
    from mirror_lab.blind.made_of import begin_results, check_results

    cases, results = tmp_path / "cases", tmp_path / "results"
    _case(cases, "a")
    _run(cases, results)
    (results / "set.json").unlink()
    _case(cases, "b")
    assert _run(cases, results).before == 1 and score(cases, results)["sessions"] == 2
    (results / "set.json").unlink()
    with pytest.raises(BlindError, match="with which vocabulary"):
        begin_results(cases, results, ["a", "b"], [], "drift")
    assert check_results(cases, results, ["a", "b"], "drift") is None
