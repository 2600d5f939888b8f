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
from .shrinkage import load_pixels, reference_of_folder, true_closed
from .statistics import Rate, coverage, rate, reliability

CONFIDENT = 0.5
NOT_PARAMETERS = {
    "effect",
    "at",
    "kind",
    "tolerated",
    "rivals",
    "detectable",
    "identifiable",
    "margin",
    "gain",
}


@dataclass(frozen=True)
class Scored:
    """One session: its answer, what was said of it, and how the two compare."""

    name: str
    answer: dict[str, Any]
    said: dict[str, Any]
    seconds: float | None
    true_closed: float | None = None
    """What the named causes truly close, where that can be computed."""

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


def true_names(case: Scored) -> set[str]:
    """Names of the true causes, and of what they bring with them: the droop of a sticking servo is there."""
    return {_key(t) for t in case.truths} | {_key(x) for t in case.truths for x in t.get("tolerated", [])}


def found(case: Scored, truth: dict[str, Any]) -> bool:
    return _key(truth) in {_key(c) for c in case.causes}


def found_or_tied(case: Scored, truth: dict[str, Any]) -> bool:
    """Named, or a rival of it named, or it named as an alternative."""
    named = {_key(c) for c in case.causes}
    alternatives = {_key(a) for c in case.causes for a in c.get("alternatives", [])}
    return _key(truth) in named | alternatives or bool(named & set(_rivals(case, truth)))


def invented(case: Scored) -> list[dict[str, Any]]:
    """Named causes that are neither true, nor tolerated, nor a rival of a true one."""
    fine = true_names(case)
    for t in case.truths:
        fine |= set(_rivals(case, t))
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


def without_effect(answer: dict[str, Any], effect: str) -> dict[str, Any]:
    """The answer as it reads for a vocabulary that lacks `effect`: what has it is outside then.

    Of a single cause the answer tells what the others of the vocabulary can make of it (`left_out`).
    """
    if all(c["effect"] != effect for c in answer["causes"]):
        return answer
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
    return {**answer, **answer.get("left_out", {}), "causes": causes}


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
        closed = _true_closed(session, answer, said, cases / "answers" / f"{session.name}.npz")
        scored.append(Scored(session.name, answer, said, seconds, closed))
    return scored, missing


def _true_closed(session: Path, answer: dict[str, Any], said: dict[str, Any], pixels: Path) -> float | None:
    if "pixels_sha256" not in answer or not answer["causes"]:
        return None
    kept = load_pixels(pixels, answer["pixels_sha256"])
    return true_closed(reference_of_folder(session, kept, answer), kept.planes_m, said.get("causes", []))


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
    claims = [(float(x["probability"]), _key(x) in true_names(c)) for c in scored for x in c.causes]
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
    """Claimed against true share of the gap that the named causes close; claims that are missing are counted.

    `clear_gaps` are the sessions whose markers are off by more than the blobs' noise: of a smaller gap, any share is of
    nothing.
    """
    rows, lacking = [], 0
    for c in scored:
        claimed = c.said.get("gap", {}).get("closed")
        if c.true_closed is None:
            continue
        if not isinstance(claimed, int | float) or not math.isfinite(claimed):
            lacking += 1
            continue
        low, high = c.said["gap"].get("closed_ci95") or [claimed, claimed]
        before = float(c.said["gap"].get("before_px") or 0.0)
        rows.append(
            (
                abs(claimed - c.true_closed) <= 0.05,
                low - 1e-9 <= c.true_closed <= high + 1e-9,
                before > math.sqrt(2) * float(c.answer.get("pixel_std_blob", 0.0)),
            )
        )
    return {
        "within_5_points": rate([a for a, _, _ in rows]).as_json(),
        "clear_gaps_within_5_points": rate([a for a, _, clear in rows if clear]).as_json(),
        "interval_covers": rate([b for _, b, _ in rows]).as_json(),
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
