"""The score of sessions with mounts by hand or a gross mistake: named with nothing else except the mounts,
misled, or silent."""

from __future__ import annotations

import math
from typing import Any

from .comparison import CONFIDENT, Scored, found, identifiable, invented, name_of
from .statistics import coverage, rate

SETUP = {"board_mount", "camera_mount", "marker_mount", "geometry"}
"""The causes that may be named for a set-up by hand: mounts, and zeros of all joints."""
MOUNTS = SETUP - {"geometry"}
NOTHING_WRONG = {"thing_in_the_background"}
"""Accidents after which nothing is wrong with the robot: `none` is right."""


def sides(name: str) -> str:
    """`effect@a<->b` in one order: what is exchanged has no first."""
    effect, _, at = name.partition("@")
    return f"{effect}@{'<->'.join(sorted(at.split('<->')))}"


def outcome(case: Scored) -> str:
    """`named`: every identifiable mistake (of one that is not: it, where there is no other), and nothing invented at even odds or
    more; `abstained`: no cause told with confidence that is not true, at a true place, or refused at the border; `misled`:
    something else; `silent`: `none`, or no word of a mistake that is not identifiable."""
    if "refused" in case.said:
        return "refused"
    mistakes = [t for t in case.truths if "mistake" in t]
    wanted = {sides(name_of(t)) for t in mistakes if identifiable(case, t)}
    told = {sides(name_of(c)) for c in case.causes}
    true = {sides(name_of(t)) for t in case.truths}
    tolerated = {sides(name_of(x)) for t in case.truths for x in t.get("tolerated", [])}
    # Zeros of all joints that are a little off are small errors everywhere.
    displaced = SETUP if "zeros_rad" in case.answer else MOUNTS if "setup" in case.answer else ()
    wrong = [
        c
        for c in case.causes
        if sides(name_of(c)) not in true | tolerated
        and c["effect"] not in displaced
        and c.get("probability", 1.0) >= CONFIDENT
    ]
    verdict = case.said.get("verdict")
    enough = len(told & (true | tolerated)) >= len(wanted)
    if not wanted:
        # What the data cannot show need not be named, but only what is named counts so.
        names = [sides(name_of(t)) for t in mistakes]
        enough = any(n in told or _tolerated(case, n, told) for n in names)
        enough |= verdict == "none" and all(t["mistake"] in NOTHING_WRONG for t in mistakes)
    if enough and all(t in told or _tolerated(case, t, told) for t in wanted) and not wrong:
        return "named"
    if verdict in ("unknown", "partial", "insufficient") and not wrong:
        places = {p for t in case.truths for p in _places(t["at"])}
        where = [w["at"] for w in case.said.get("where", [])[:1]]
        right = not where or any(p in places for w in where for p in _places(w))
        return "abstained" if right else "elsewhere"
    return "silent" if not wrong and (verdict == "none" or not wanted) else "misled"


def _tolerated(case: Scored, name: str, told: set[str]) -> bool:
    truth = next(t for t in case.truths if sides(name_of(t)) == name)
    return any(sides(name_of(x)) in told for x in truth.get("tolerated", []))


def _places(at: str) -> list[str]:
    return [p for part in at.split("<->") for p in part.split("<-")]


def by_hand(scored: list[Scored]) -> dict[str, Any] | None:
    """Of the sessions that were mounted by hand; None where there are none."""
    cases = [c for c in scored if "setup" in c.answer]
    if not cases:
        return None
    # What has no name cannot be named: it is scored apart.
    one = [c for c in cases if c.kind == "single" and identifiable(c, c.truths[0])]
    several = [(c, t) for c in cases if c.kind == "several" for t in c.truths if identifiable(c, t)]
    none = [c for c in cases if not c.truths]

    def is_lost(c: Scored, t: dict[str, Any]) -> bool:
        return t["effect"] != "unknown" and identifiable(c, t) and not found(c, t)

    def only_setup(c: Scored) -> bool:
        return all(x["effect"] in SETUP for x in invented(c))

    errors = [z for c in cases for z in mount_errors(c)]
    return {
        "sessions": len(cases),
        "single_named_with_only_set_up": rate(
            [found(c, c.truths[0]) and only_setup(c) for c in one]
        ).as_json(),
        "single_named": rate([found(c, c.truths[0]) for c in one]).as_json(),
        "several_named": rate([found(c, t) for c, t in several]).as_json(),
        "none_only_set_up": rate([only_setup(c) for c in none]).as_json(),
        "mounts": coverage(errors),
        "wrong": [
            {
                "session": c.name,
                "true": [name_of(t) for t in c.truths],
                "said": [f"{name_of(x)} ({x.get('probability', math.nan):.2f})" for x in c.causes],
                "verdict": c.said.get("verdict"),
            }
            for c in cases
            if not only_setup(c) or any(is_lost(c, t) for t in c.truths)
        ],
    }


def mount_errors(case: Scored) -> list[float]:
    """(value − truth) / std of each parameter of each mount that is told."""
    truths = {name_of(t): t for t in case.answer.get("setup", [])}
    # A further cause beside the set-up adds to its mount's displacement.
    displaced = {name_of(t) for t in case.truths} & set(truths)
    out = []
    for cause in case.causes:
        truth = truths.get(name_of(cause)) if name_of(cause) not in displaced else None
        for name, estimate in cause["parameters"].items() if truth else ():
            if truth and name in truth and estimate["std"] > 0:
                out.append((estimate["value"] - truth[name]) / estimate["std"])
    return out


def first_day(scored: list[Scored]) -> dict[str, Any] | None:
    """Of the sessions with a whole mistake; None where there are none."""
    cases = [c for c in scored if any("mistake" in t for t in c.truths)]
    if not cases:
        return None
    outcomes = {c.name: outcome(c) for c in cases}
    kinds = sorted({str(t["mistake"]) for c in cases for t in c.truths if "mistake" in t})
    small = [(c, t) for c in cases for t in c.truths if "mistake" not in t and "refused" not in c.said]

    def counts(some: list[Scored]) -> dict[str, int]:
        told = [outcomes[c.name] for c in some]
        return {o: told.count(o) for o in sorted(set(told))}

    return {
        "sessions": len(cases),
        "named_or_refused": rate([outcomes[c.name] in ("named", "refused") for c in cases]).as_json(),
        "misled": rate([outcomes[c.name] in ("misled", "silent") for c in cases]).as_json(),
        "small_cause_found": rate([found(c, t) for c, t in small]).as_json(),
        "outcomes": counts(cases),
        "by_kind": {
            kind: counts([c for c in cases if any(t.get("mistake") == kind for t in c.truths)])
            for kind in kinds
        },
        "wrong": [
            {
                "session": c.name,
                "outcome": outcomes[c.name],
                "true": [name_of(t) for t in c.truths],
                "said": [f"{name_of(x)} ({x.get('probability', math.nan):.2f})" for x in c.causes],
                "verdict": c.said.get("verdict"),
                "where": [w["at"] for w in c.said.get("where", [])[:2]],
            }
            for c in cases
            if outcomes[c.name] not in ("named", "refused")
        ],
    }
