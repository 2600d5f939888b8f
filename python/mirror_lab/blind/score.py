"""Opens the seals and scores the diagnoses against the answers. Rules: A named cause is *right* when effect and place are those of a true
cause, and *tolerated* when the
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
from pathlib import Path
from statistics import mean, median
from typing import Any

from .breakdown import breakdown
from .comparison import (
    OTHER_LAWS,
    Scored,
    found,
    found_or_tied,
    identifiable,
    invented,
    mixed_verdict,
    name_of,
    normalised_errors,
    outside_verdict,
    true_names,
)
from .errors import BlindError
from .first_day_score import by_hand, first_day
from .made_of import check_results
from .runner import RESULT, sessions_in
from .seal import unseal
from .shrinkage import frictions_of, is_judge, load_pixels, reference_of_folder, true_closed
from .statistics import Rate, coverage, rate, reliability


def without_effect(answer: dict[str, Any], effect: str) -> dict[str, Any]:
    """The answer as it reads for a vocabulary that lacks `effect`: what has it is outside then.

    Of a single cause the answer tells what the others of the vocabulary can make of it (`left_out`); of one among several it does
    not (`is_left_out_of_several`).
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


def is_left_out_of_several(answer: dict[str, Any], effect: str | None) -> bool:
    """Whether `effect` is one of several causes. What the others can make of it then was not judged."""
    return len(answer["causes"]) > 1 and any(c["effect"] == effect for c in answer["causes"])


def load(
    cases: Path, results: Path, leave_out: str | None = None
) -> tuple[list[Scored], list[str], list[str]]:
    """All sessions with a result, the names of those without one, and of those in which `leave_out` is one of several causes; each
    answer is checked against its seal, and each result against the seal of its session."""
    with_result = [s.name for s in sessions_in(cases) if (results / s.name).is_dir()]
    check_results(cases, results, with_result, leave_out)
    scored, missing, several = [], [], []
    for session in sessions_in(cases):
        answer = unseal(cases / "answers" / f"{session.name}.json", session / "seal.json")
        if is_left_out_of_several(answer, leave_out):
            several.append(session.name)
            continue
        if leave_out is not None:
            answer = without_effect(answer, leave_out)
        path = results / session.name / RESULT
        if not path.is_file():
            refusal = _refusal(results / session.name / "failure.json")
            if refusal is not None and any("mistake" in c for c in answer["causes"]):
                scored.append(Scored(session.name, answer, {"refused": refusal, "causes": []}))
            else:
                missing.append(session.name)
            continue
        try:
            said = json.loads(path.read_text(encoding="utf-8"))
        except ValueError as e:
            raise BlindError(f"{path} is not JSON: {e}; delete it and run again") from e
        if said.get("format") != "mirror-posture/diagnosis" or said.get("version") not in (1, 2):
            raise BlindError(
                f"{path}: format {said.get('format')!r} {said.get('version')!r}, "
                "needed mirror-posture/diagnosis 1 or 2"
            )
        clock = path.parent / "time.json"
        times = json.loads(clock.read_text(encoding="utf-8")) if clock.is_file() else {}
        judged, closed = _true_closed(session, answer, said, cases / "answers" / f"{session.name}.npz")
        seconds, cpu_seconds = times.get("seconds"), times.get("cpu_seconds")
        scored.append(Scored(session.name, answer, said, seconds, cpu_seconds, closed, judged))
    return scored, missing, several


def _refusal(failure: Path) -> str | None:
    """The error with which a session was refused as it was read (a column in degrees, for example)."""
    if not failure.is_file():
        return None
    told = json.loads(failure.read_text(encoding="utf-8"))
    return str(told["message"]) if told.get("error") == "SessionError" else None


def _true_closed(
    session: Path, answer: dict[str, Any], said: dict[str, Any], pixels: Path
) -> tuple[bool, float | None]:
    """Whether the true shrinkage can be judged, and what it is."""
    if "pixels_sha256" not in answer or not answer["causes"]:
        return True, None
    kept = load_pixels(pixels, answer["pixels_sha256"])
    ref, truths = reference_of_folder(session, kept, answer), answer["causes"]
    if not is_judge(ref, kept.planes_m, truths):
        return False, None
    return True, true_closed(ref, kept.planes_m, said.get("causes", []), frictions_of(truths))


def score(cases: Path, results: Path, leave_out: str | None = None) -> dict[str, Any]:
    """The content of the page, as JSON-ready data; `leave_out` names an effect that the diagnosis
    lacked."""
    everything, missing, left_out_of_several = load(cases, results, leave_out)
    # Whole mistakes are counted apart.
    scored = [c for c in everything if not any("mistake" in t for t in c.truths)]
    single = [c for c in scored if c.kind == "single"]
    several = [c for c in scored if c.kind == "several"]
    # Where mounts are off there is something to name: `by_hand` counts these (`none_only_set_up`).
    none = [c for c in scored if c.kind == "none" and "setup" not in c.answer]
    outside = [c for c in scored if c.kind == "outside"]
    clear = [c for c in single if identifiable(c, c.truths[0])]
    unclear = [c for c in single if not identifiable(c, c.truths[0])]
    pairs = [(c, t) for c in several for t in c.truths if identifiable(c, t)]
    verdicts = {c.name: outside_verdict(c) for c in outside}
    mixed = [c for c in scored if c.kind == "mixed"]
    beside = {c.name: mixed_verdict(c) for c in mixed if identifiable(c, c.truths[-1])}
    named_beside = [
        (c, t) for c in mixed for t in c.truths if t["effect"] != "unknown" and identifiable(c, t)
    ]
    clear_outside = [c for c in outside if identifiable(c, c.truths[0])]
    claims = [(float(x["probability"]), name_of(x) in true_names(c)) for c in scored for x in c.causes]
    errors = [z for c in scored for z in normalised_errors(c)]
    named, false_names = sum(len(c.causes) for c in several), sum(len(invented(c)) for c in several)
    by_effect = {}
    for effect in sorted({c.truths[0]["effect"] for c in single}):
        mine = [c for c in clear if c.truths[0]["effect"] == effect]
        by_effect[effect] = rate([found(c, c.truths[0]) and not invented(c) for c in mine]).as_json()
    times = [c.seconds for c in scored if c.seconds is not None]
    cpu = [c.cpu_seconds for c in scored if c.cpu_seconds is not None]
    return {
        "format": "mirror-posture/blind-score",
        "version": 1,
        "sessions": len(everything),
        "without_result": missing,
        "left_out_of_several": left_out_of_several,
        "by_hand": by_hand(scored),
        "first_day": first_day(everything),
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
        "outside_false_cause": rate([verdicts[c.name]["false_cause"] for c in clear_outside]).as_json(),
        "mixed_named_found": rate([found(c, t) for c, t in named_beside]).as_json(),
        "mixed_place": rate([v["met"] for v in beside.values()]).as_json(),
        "mixed_false_cause": rate([v["false_cause"] for v in beside.values()]).as_json(),
        "mixed_explained": rate([v["confidently_wrong"] for v in beside.values()]).as_json(),
        "by_effect": by_effect,
        "breakdown": breakdown(scored),
        "confusion": confusion(clear),
        "calibration": reliability([p for p, _ in claims], [r for _, r in claims]),
        "parameters": coverage(errors),
        "parameters_of_the_vocabularys_laws": coverage(
            [z for c in scored for z in normalised_errors(c, lambda effect: effect not in OTHER_LAWS)]
        ),
        "shrinkage": shrinkage(scored),
        "seconds": {"median": median(times), "worst": max(times)} if times else None,
        "cpu_seconds": {"median": median(cpu), "mean": mean(cpu), "worst": max(cpu)} if cpu else None,
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
    """Claimed against true share of the gap that the named causes close; missing claims are counted.

    `clear_gaps` are the sessions whose markers are off by more than the blobs' noise: the shares of smaller gaps mean nothing.
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
        "without_judge": sum(not c.judged for c in scored),
    }


def failures(scored: list[Scored]) -> list[dict[str, Any]]:
    """The sessions with a wrong diagnosis: the answer and the diagnosis."""
    out = []
    for c in scored:
        if c.kind == "none":
            wrong = bool(invented(c)) if "setup" in c.answer else c.said.get("verdict") != "none"
        elif c.kind == "outside":
            wrong = identifiable(c, c.truths[0]) and not outside_verdict(c)["met"]
        elif c.kind == "mixed":
            told = mixed_verdict(c)
            lost = any(identifiable(c, t) and not found(c, t) for t in c.truths[:-1])
            wrong = lost or told["false_cause"] or (identifiable(c, c.truths[-1]) and not told["met"])
        else:
            wrong = any(identifiable(c, t) and not found(c, t) for t in c.truths) or bool(invented(c))
        if wrong:
            out.append(
                {
                    "session": c.name,
                    "kind": c.kind,
                    "true": [f"{t.get('kind', t['effect'])}@{t['at']}" for t in c.truths],
                    "verdict": c.said.get("verdict"),
                    "said": [f"{name_of(x)} ({x.get('probability', float('nan')):.2f})" for x in c.causes],
                    "where": [w["at"] for w in c.said.get("where", [])[:2]],
                }
            )
    return out
