"""Breakdown of the failures: rates by effect, by evidence, by other causes and by robot."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any

from .comparison import Scored, found, identifiable, invented, outside_verdict
from .statistics import rate

MARGINS = (10.0, 30.0, 100.0, 300.0, 1000.0, 10000.0)
"""Bounds of the margin by which a reference that knows the noise prefers a true cause to its nearest rival, in BIC."""
Pair = tuple[Scored, dict[str, Any]]


def breakdown(scored: list[Scored]) -> dict[str, Any]:
    """Rates of identifiable causes that were found, by possible reasons for the others; counts of invented causes."""
    pairs = [
        (c, t) for c in scored if c.kind in ("single", "several") for t in c.truths if identifiable(c, t)
    ]
    outside = [c for c in scored if c.kind == "outside" and identifiable(c, c.truths[0])]
    kinds = sorted({_kind(c) for c in outside})
    return {
        "found_by_effect": _by(pairs, lambda c, t: str(t["effect"])),
        "found_by_margin": _by(pairs, _margin_bin),
        "found_by_number_of_causes": _by(pairs, lambda c, _: str(len(c.truths))),
        "found_by_robot": _by(pairs, lambda c, _: str(c.answer.get("robot", ""))),
        "invented_by_effect": dict(
            Counter(
                str(x["effect"]) for c in scored if c.kind not in ("outside", "mixed") for x in invented(c)
            ).most_common()
        ),
        "outside_by_kind": {
            kind: {
                key: rate([outside_verdict(c)[key] for c in outside if _kind(c) == kind]).as_json()
                for key in ("met", "abstained", "right_place", "confidently_wrong")
            }
            for kind in kinds
        },
    }


def _kind(case: Scored) -> str:
    """What an effect outside the vocabulary is called in the answer."""
    return str(case.truths[0].get("kind", case.truths[0]["effect"]))


def _by(pairs: Iterable[Pair], key: Callable[[Scored, dict[str, Any]], str]) -> dict[str, Any]:
    groups: dict[str, list[bool]] = {}
    for case, truth in pairs:
        groups.setdefault(key(case, truth), []).append(found(case, truth))
    return {name: rate(groups[name]).as_json() for name in sorted(groups)}


def _margin_bin(case: Scored, truth: dict[str, Any]) -> str:
    margin = truth.get("margin", case.answer.get("margin"))
    if margin is None:
        return "not known"
    low = max((m for m in MARGINS if m <= margin), default=0.0)
    high = min((m for m in MARGINS if m > margin), default=None)
    return f"{low:5.0f} to {high:.0f}" if high is not None else f"{low:5.0f} and more"
