"""Open the seals and score: what was said against what was true.

Rules. A named cause is *right* when effect and place are those of a true cause, and *tolerated* when the
answer says that it may
be named too (the droop of a sticking servo). A true cause is *found* when it is named, and *found or tied*
when it, or one of its
`rivals`, is. Only true causes that the data can show (`identifiable`) count in the headline; the others are
scored apart.
An effect outside the vocabulary is met by `unknown` or `partial` with the true place first in `where` (or
by a rival that the answer names);
it is *confidently wrong* when a cause is named at 0.5 or more under `explained` that is no rival.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .errors import BlindError
from .run import RESULT, sessions_in
from .seal import unseal
from .statistics import Rate, coverage, rate, reliability

CONFIDENT = 0.5
NOT_PARAMETERS = {"effect", "at", "kind", "tolerated", "rivals", "detectable", "identifiable", "margin"}


@dataclass(frozen=True)
class Scored:
    """One session: its answer, what was said of it, and how the two compare."""

    name: str
    answer: dict[str, Any]
    said: dict[str, Any]
    seconds: float | None

    @property
    def truths(self) -> list[dict[str, Any]]:
        return list(self.answer["causes"])

    @property
    def causes(self) -> list[dict[str, Any]]:
        return list(self.said.get("causes", []))

    @property
    def kind(self) -> str:
        if not self.truths:
            return "none"
        if any(t["effect"] == "unknown" for t in self.truths):
            return "outside"
        return "single" if len(self.truths) == 1 else "several"


def _key(cause: dict[str, Any]) -> str:
    return f"{cause['effect']}@{cause['at']}"


def _identifiable(case: Scored, truth: dict[str, Any]) -> bool:
    return bool(truth.get("identifiable", case.answer.get("identifiable", False)))


def _rivals(case: Scored, truth: dict[str, Any]) -> list[str]:
    return list(truth.get("rivals", case.answer.get("rivals", [])))


def found(case: Scored, truth: dict[str, Any]) -> bool:
    return _key(truth) in {_key(c) for c in case.causes}


def found_or_tied(case: Scored, truth: dict[str, Any]) -> bool:
    """Named, or a rival of it named, or it named as an alternative."""
    named = {_key(c) for c in case.causes}
    alternatives = {_key(a) for c in case.causes for a in c.get("alternatives", [])}
    return _key(truth) in named | alternatives or bool(named & set(_rivals(case, truth)))


def invented(case: Scored) -> list[dict[str, Any]]:
    """Named causes that are neither true, nor tolerated, nor a rival of a true one."""
    fine = {_key(t) for t in case.truths}
    for t in case.truths:
        fine |= {_key(x) for x in t.get("tolerated", [])} | set(_rivals(case, t))
    return [c for c in case.causes if _key(c) not in fine]


def normalised_errors(case: Scored) -> list[float]:
    """(value − truth) / std of each parameter of each cause that was found and carries a deviation."""
    out = []
    truths = {_key(t): t for t in case.truths}
    for c in case.causes:
        truth = truths.get(_key(c))
        for name, estimate in c.get("parameters", {}).items() if truth else []:
            true = truth.get(name) if truth else None
            std = estimate.get("std")
            if (
                isinstance(true, int | float)
                and isinstance(std, int | float)
                and std > 0
                and name not in NOT_PARAMETERS
            ):
                out.append((estimate["value"] - true) / std)
    return out


def outside_verdict(case: Scored) -> dict[str, bool]:
    truth = case.truths[0]
    verdict = case.said.get("verdict")
    where = [w["at"] for w in case.said.get("where", [])]
    same = {truth["at"]} | {c["at"] for c in case.causes if c["at"].split("<-")[0] == truth["at"]}
    rivals = set(_rivals(case, truth))
    named = {_key(c) for c in case.causes}
    right_place = bool(where) and where[0].split("<-")[0] in same
    met = (verdict in ("unknown", "partial") and right_place) or bool(named & rivals)
    wrong = verdict == "explained" and any(
        c.get("probability", 1.0) >= CONFIDENT and _key(c) not in rivals for c in case.causes
    )
    return {
        "met": met,
        "abstained": verdict in ("unknown", "partial"),
        "right_place": right_place,
        "confidently_wrong": wrong,
    }


def true_shrinkage(case: Scored) -> float | None:
    """Share of the gap that a perfect model closes: 1 where everything is in the vocabulary and found, else
    not known here."""
    if case.kind in ("single", "several") and all(found(case, t) for t in case.truths):
        return 1.0
    return None


def without_effect(answer: dict[str, Any], effect: str) -> dict[str, Any]:
    """The answer as it reads for a vocabulary that lacks `effect`: what has it is outside then."""
    causes = [
        {
            **c,
            "effect": "unknown",
            "kind": effect,
            "rivals": [r for r in c.get("rivals", []) if not r.startswith(f"{effect}@")],
        }
        if c["effect"] == effect
        else c
        for c in answer["causes"]
    ]
    return {**answer, "causes": causes}


def load(cases: Path, results: Path, leave_out: str | None = None) -> tuple[list[Scored], list[str]]:
    """All sessions with a result, and the names of those without one; each answer is checked against its
    seal."""
    scored, missing = [], []
    for session in sessions_in(cases):
        answer = unseal(cases / "answers" / f"{session.name}.json", session / "seal.json")
        if leave_out is not None:
            answer = without_effect(answer, leave_out)
        path = results / session.name / RESULT
        if not path.is_file():
            missing.append(session.name)
            continue
        try:
            said = json.loads(path.read_text(encoding="utf-8"))
        except ValueError as e:
            raise BlindError(f"{path} is not JSON: {e}; delete it and run again") from e
        if said.get("format") != "mirror-posture/diagnosis" or said.get("version") != 1:
            raise BlindError(
                f"{path}: format {said.get('format')!r} {said.get('version')!r}, "
                "needed mirror-posture/diagnosis 1"
            )
        clock = path.parent / "time.json"
        seconds = json.loads(clock.read_text(encoding="utf-8"))["seconds"] if clock.is_file() else None
        scored.append(Scored(session.name, answer, said, seconds))
    return scored, missing


def score(cases: Path, results: Path, leave_out: str | None = None) -> dict[str, Any]:
    """Everything that the page shows, as JSON-ready data; `leave_out` names an effect that the diagnosis
    lacked."""
    scored, missing = load(cases, results, leave_out)
    single = [c for c in scored if c.kind == "single"]
    several = [c for c in scored if c.kind == "several"]
    none = [c for c in scored if c.kind == "none"]
    outside = [c for c in scored if c.kind == "outside"]
    clear = [c for c in single if _identifiable(c, c.truths[0])]
    unclear = [c for c in single if not _identifiable(c, c.truths[0])]
    pairs = [(c, t) for c in several for t in c.truths if _identifiable(c, t)]
    verdicts = {c.name: outside_verdict(c) for c in outside}
    clear_outside = [c for c in outside if _identifiable(c, c.truths[0])]
    claims = [
        (float(x["probability"]), _key(x) in {_key(t) for t in c.truths}) for c in scored for x in c.causes
    ]
    errors = [z for c in scored for z in normalised_errors(c)]
    named, false_names = sum(len(c.causes) for c in several), sum(len(invented(c)) for c in several)
    by_effect = {}
    for effect in sorted({c.truths[0]["effect"] for c in single}):
        mine = [c for c in clear if c.truths[0]["effect"] == effect]
        by_effect[effect] = rate([found(c, c.truths[0]) and not invented(c) for c in mine]).as_json()
    times = sorted(c.seconds for c in scored if c.seconds is not None)
    return {
        "format": "mirror-posture/blind-score",
        "version": 1,
        "sessions": len(scored),
        "without_result": missing,
        "single_identifiable_right": rate(
            [found(c, c.truths[0]) and not invented(c) for c in clear]
        ).as_json(),
        "single_identifiable_found": rate([found(c, c.truths[0]) for c in clear]).as_json(),
        "single_not_identifiable_found_or_tied": rate(
            [found_or_tied(c, c.truths[0]) for c in unclear]
        ).as_json(),
        "several_identifiable_found": rate([found(c, t) for c, t in pairs]).as_json(),
        "several_invented": Rate(false_names, named).as_json(),
        "false_alarms": rate([c.said.get("verdict") != "none" for c in none]).as_json(),
        "outside_met": rate([verdicts[c.name]["met"] for c in clear_outside]).as_json(),
        "outside_abstained": rate([verdicts[c.name]["abstained"] for c in clear_outside]).as_json(),
        "outside_confidently_wrong": rate(
            [verdicts[c.name]["confidently_wrong"] for c in clear_outside]
        ).as_json(),
        "by_effect": by_effect,
        "confusion": confusion(clear),
        "calibration": reliability([p for p, _ in claims], [r for _, r in claims]),
        "parameters": coverage(errors),
        "shrinkage": shrinkage(scored),
        "seconds": {"median": times[len(times) // 2], "worst": times[-1]} if times else None,
        "failures": failures(scored),
    }


def confusion(clear: list[Scored]) -> dict[str, dict[str, int]]:
    """True effect → what was named first (`none` or `unknown` where nothing was); a `~` marks a right
    effect elsewhere."""
    table: dict[str, Counter[str]] = {}
    for c in clear:
        truth = c.truths[0]
        said = c.causes[0]["effect"] if c.causes else str(c.said.get("verdict"))
        if c.causes and said == truth["effect"] and c.causes[0]["at"] != truth["at"]:
            said = f"~{said}"
        table.setdefault(truth["effect"], Counter())[said] += 1
    return {k: dict(v) for k, v in sorted(table.items())}


def shrinkage(scored: list[Scored]) -> dict[str, Any]:
    """Claimed against true share of the gap closed, where the truth is known; NaN or missing claims are
    counted."""
    rows, lacking = [], 0
    for c in scored:
        true = true_shrinkage(c)
        claimed = c.said.get("gap", {}).get("closed")
        if true is None:
            continue
        if not isinstance(claimed, int | float) or not math.isfinite(claimed):
            lacking += 1
            continue
        interval = c.said["gap"].get("closed_ci95") or [claimed, claimed]
        rows.append((abs(claimed - true) <= 0.05, interval[0] - 1e-9 <= true <= interval[1] + 1e-9))
    return {
        "within_5_points": rate([a for a, _ in rows]).as_json(),
        "interval_covers": rate([b for _, b in rows]).as_json(),
        "without_claim": lacking,
    }


def failures(scored: list[Scored]) -> list[dict[str, Any]]:
    """The sessions on which something is wrong, with what was true and what was said."""
    out = []
    for c in scored:
        if c.kind == "none":
            wrong = c.said.get("verdict") != "none"
        elif c.kind == "outside":
            wrong = _identifiable(c, c.truths[0]) and not outside_verdict(c)["met"]
        else:
            wrong = any(_identifiable(c, t) and not found(c, t) for t in c.truths) or bool(invented(c))
        if wrong:
            out.append(
                {
                    "session": c.name,
                    "kind": c.kind,
                    "true": [f"{t.get('kind', t['effect'])}@{t['at']}" for t in c.truths],
                    "verdict": c.said.get("verdict"),
                    "said": [f"{_key(x)} ({x.get('probability', float('nan')):.2f})" for x in c.causes],
                    "where": [w["at"] for w in c.said.get("where", [])[:2]],
                }
            )
    return out
