"""One session: the diagnosis compared with the truth, by the rules of the score."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

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
    """One session: its answer, its diagnosis, and how the two compare."""

    name: str
    answer: dict[str, Any]
    said: dict[str, Any]
    seconds: float | None = None
    cpu_seconds: float | None = None
    true_closed: float | None = None
    """The share of the gap that the named causes truly close, where it can be computed."""
    judged: bool = True
    """Whether the judge's own model closes the gap with the true causes."""

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
            return "outside" if len(self.truths) == 1 else "mixed"
        return "single" if len(self.truths) == 1 else "several"


def name_of(cause: dict[str, Any]) -> str:
    return f"{cause['effect']}@{cause['at']}"


def identifiable(case: Scored, truth: dict[str, Any]) -> bool:
    return bool(truth.get("identifiable", case.answer.get("identifiable", False)))


def rivals_of(case: Scored, truth: dict[str, Any]) -> list[str]:
    return list(truth.get("rivals", case.answer.get("rivals", [])))


def true_names(case: Scored) -> set[str]:
    """Names of the true causes, of their side effects (the droop of a sticking servo), and of what is there beside them: small
    errors, mounts by hand, and zeros of all joints that are a little off."""
    beside = [x for t in case.truths for x in t.get("tolerated", [])]
    beside += [*case.answer.get("small", []), *case.answer.get("setup", [])]
    if "zeros_rad" in case.answer:
        beside.append({"effect": "geometry", "at": "robot"})
    return {name_of(t) for t in [*case.truths, *beside]}


def found(case: Scored, truth: dict[str, Any]) -> bool:
    return name_of(truth) in {name_of(c) for c in case.causes}


def found_or_tied(case: Scored, truth: dict[str, Any]) -> bool:
    """Named, or a rival of it named, or it named as an alternative."""
    named = {name_of(c) for c in case.causes}
    alternatives = {name_of(a) for c in case.causes for a in c.get("alternatives", [])}
    return name_of(truth) in named | alternatives or bool(named & set(rivals_of(case, truth)))


def invented(case: Scored) -> list[dict[str, Any]]:
    """Named causes that are neither true, nor tolerated, nor a rival of a true one."""
    fine = true_names(case)
    for t in case.truths:
        fine |= set(rivals_of(case, t))
    return [c for c in case.causes if name_of(c) not in fine]


OTHER_LAWS = {"backlash", "stiction", "joint_compliance", "link_bending", "drift", "geometry", "pairing"}
"""Effects whose true law differs slightly from the vocabulary's here: play that widens, springs that stiffen, links that bend off
their middle, drift that bows, a spread of few draws, whole frames."""


def normalised_errors(case: Scored, only: Callable[[str], bool] = lambda effect: True) -> list[float]:
    """(value − truth) / std of each parameter of each cause that was found and carries a deviation."""
    out = []
    truths = {name_of(t): _with_zero(case, t) for t in case.truths}
    for c in case.causes:
        truth = truths.get(name_of(c)) if only(str(c["effect"])) else None
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


def _with_zero(case: Scored, truth: dict[str, Any]) -> dict[str, Any]:
    """A wrong zero of a joint whose zero was set by hand is the sum of both."""
    zero = case.answer.get("zeros_rad", {}).get(str(truth["at"]).removeprefix("joint:"), 0.0)
    if truth["effect"] != "joint_offset" or not isinstance(truth.get("offset_rad"), int | float):
        return truth
    return {**truth, "offset_rad": truth["offset_rad"] + zero}


def outside_verdict(case: Scored) -> dict[str, bool]:
    truth = case.truths[0]
    verdict = case.said.get("verdict")
    where = _places(case)
    # The place of a coupling without a name is the driven joint.
    at = truth["at"].split("<-")[0]
    same = {at} | {c["at"] for c in case.causes if c["at"].split("<-")[0] == at}
    rivals = set(rivals_of(case, truth))
    named = {name_of(c) for c in case.causes}
    right_place = bool(where) and where[0].split("<-")[0] in same
    met = (verdict in ("unknown", "partial") and right_place) or bool(named & rivals)
    false = [c for c in case.causes if name_of(c) not in rivals | true_names(case)]
    wrong = verdict == "explained" and any(c.get("probability", 1.0) >= CONFIDENT for c in false)
    return {
        "met": met,
        "abstained": verdict in ("unknown", "partial"),
        "right_place": right_place,
        "confidently_wrong": wrong,
        "false_cause": any(c.get("probability", 1.0) >= CONFIDENT for c in false),
    }


def mixed_verdict(case: Scored) -> dict[str, bool]:
    """An effect from outside the vocabulary beside causes of it: the place of what has no name is told, no other cause is, and not
    that all is explained."""
    (truth,) = (t for t in case.truths if t["effect"] == "unknown")
    at = truth["at"].split("<-")[0]
    named = {t["at"] for t in case.truths if t is not truth} | {c["at"] for c in case.answer.get("setup", [])}
    right_place = at in {place.split("<-")[0] for place in _unnamed(case, named)[:2]}
    mimics = set(rivals_of(case, truth)) & {name_of(c) for c in case.causes}
    false = any(c.get("probability", 1.0) >= CONFIDENT for c in invented(case))
    verdict = case.said.get("verdict")
    return {
        "met": (verdict in ("unknown", "partial") and right_place) or bool(mimics),
        "false_cause": false,
        "confidently_wrong": verdict == "explained" and not mimics,
    }


def _places(case: Scored) -> list[str]:
    """The places of `where`, largest share first. Beside mounts by hand, which have the largest: those of what has no name, or
    else those that are no mount's."""
    if "setup" not in case.answer:
        return [w["at"] for w in case.said.get("where", [])]
    return _unnamed(case, {c["at"] for c in case.answer["setup"]})


def _unnamed(case: Scored, known: set[str]) -> list[str]:
    """The places of `where` of what has no name, or else those that are not `known`."""
    where = case.said.get("where", [])
    unnamed = [w["at"] for w in where if w.get("depends_on")]
    return unnamed or [w["at"] for w in where if w["at"] not in known | {"robot"}]
