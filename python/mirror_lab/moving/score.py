"""The score of diagnoses of sessions in motion: causes found with their places, false causes, parameters,
unseen motions.

In addition to the strict counts there are those of identifiable causes. A true cause with `rivals` in its
answer (other laws of its joint's position that these pictures do not clearly separate from it, according to
the reference) is not identifiable. A false cause does not count if the diagnosis itself gives the true one
as an alternative with at least `REAL` of the named one's probability.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..blind.made_of import check_results
from ..blind.seal import unseal

UNSEEN_FLOORS = 1.2
REAL = 0.1
"""Share of the probability of the named cause; an alternative with less does not count."""
TOLD = {
    "latency_s": ("latency", 0.002, False),
    "stiffness_scale_error": ("gains", 0.10, True),
    "damping_scale_error": ("gains", 0.10, True),
    "viscous_nms_per_rad": ("friction", 0.15, True),
    "friction_nm": ("friction", 0.15, True),
}
"""Parameter: its group, the error allowed, and whether that is a share of the true value."""

Key = tuple[str, str]


@dataclass
class Score:
    """Counts as (right, of); errors by group; and one line a case."""

    singles: list[bool] = field(default_factory=list)
    singles_shown: list[bool] = field(default_factory=list)
    singles_or_named_beside: list[bool] = field(default_factory=list)
    singles_identifiable: list[bool] = field(default_factory=list)
    empty_alarmed: list[bool] = field(default_factory=list)
    several_found: list[bool] = field(default_factory=list)
    several_invented: list[bool] = field(default_factory=list)
    several_identifiable_found: list[bool] = field(default_factory=list)
    several_told: list[bool] = field(default_factory=list)
    several_denied: list[bool] = field(default_factory=list)
    named: list[tuple[float, bool]] = field(default_factory=list)
    within: dict[str, list[bool]] = field(default_factory=dict)
    covered: list[bool] = field(default_factory=list)
    unseen: list[float] = field(default_factory=list)
    lines: list[tuple[str, str, str, str]] = field(default_factory=list)

    def rows(self) -> list[tuple[str, str, str]]:
        """A table: what, how many, share."""
        out = [
            _row("one cause: found with its place", self.singles),
            _row("one cause: found, or named as its alternative", self.singles_or_named_beside),
            _row("one cause, larger than the diagnosis says was hidden: found", self.singles_shown),
            _row("one identifiable cause: found with its place", self.singles_identifiable),
            _row("no cause: false alarm", self.empty_alarmed),
            _row("two or three causes: found", self.several_found),
            _row("two or three causes, identifiable: found", self.several_identifiable_found),
            _row("two or three causes: found, or told as an alternative with real odds", self.several_told),
            _row("causes named where there are two or three: invented", self.several_invented),
            _row("the same, and the true one not told with real odds", self.several_denied),
        ]
        for least, most in ((0.9, 1.01), (0.5, 0.9), (0.0, 0.5)):
            within = [right for probability, right in self.named if least <= probability < most]
            out.append(_row(f"named with probability {least} to {min(most, 1.0)}: right", within))
        for group, allowed in (("latency", "2 ms"), ("gains", "10 %"), ("friction", "15 %")):
            out.append(_row(f"{group} within {allowed}", self.within.get(group, [])))
        out.append(_row("95 % intervals that hold the truth", self.covered))
        near = [ratio <= UNSEEN_FLOORS for ratio in self.unseen]
        out.append(_row(f"unseen motion within {UNSEEN_FLOORS} noise floors", near))
        return out

    def to_tree(self) -> dict[str, Any]:
        """As JSON."""
        return {
            "rows": [{"what": what, "count": count, "share": share} for what, count, share in self.rows()],
            "cases": [
                dict(zip(("case", "truth", "told", "unseen"), line, strict=True)) for line in self.lines
            ],
        }


def score(cases: Path, results: Path) -> Score:
    """Opens the answers of the cases that have a diagnosis, and compares. Raises `BlindError` for a broken seal, and for the result of
    another session."""
    out = Score()
    with_result = [p.parent.name for p in results.glob("case-*/diagnosis.json")]
    check_results(cases, results, sorted(with_result))
    for answer_file in sorted((cases / "answers").glob("case-*.json")):
        name = answer_file.stem
        told_file = results / name / "diagnosis.json"
        if not told_file.is_file():
            continue
        answer = unseal(answer_file, cases / name / "seal.json")
        _one(out, answer, json.loads(told_file.read_text(encoding="utf-8")))
    return out


def _one(out: Score, answer: Mapping[str, Any], told: Mapping[str, Any]) -> None:
    truth = {(c["effect"], c["at"]): c for c in answer["causes"]}
    causes = {(c["effect"], c["at"]): c for c in told["causes"]}
    beside = {(a["effect"], a["at"]) for c in told["causes"] for a in c["alternatives"]}
    hits = [key in causes for key in truth]
    if not truth:
        out.empty_alarmed.append(bool(causes))
    elif len(truth) == 1:
        out.singles += hits
        out.singles_shown += [
            key in causes for key, cause in truth.items() if not _hidden(cause, told.get("limits", []))
        ]
        out.singles_or_named_beside += [key in causes or key in beside for key in truth]
        out.singles_identifiable += [key in causes for key, c in truth.items() if not c.get("rivals")]
    else:
        told_for = {key: _told_for(cause, truth) for key, cause in causes.items()}
        out.several_found += hits
        out.several_identifiable_found += [key in causes for key, c in truth.items() if not c.get("rivals")]
        out.several_told += [key in causes or key in told_for.values() for key in truth]
        out.several_invented += [key not in truth for key in causes]
        out.several_denied += [key not in truth and told_for[key] is None for key in causes]
    out.named += [(float(c["probability"]), key in truth) for key, c in causes.items()]
    for key in truth.keys() & causes.keys():
        _parameters(out, truth[key], causes[key]["parameters"])
    gap = told["gap"]
    ratio = gap["checked"][0]["after_m"] / gap["noise_floor_m"] if gap.get("checked") else float("nan")
    if np.isfinite(ratio):
        out.unseen.append(float(ratio))
    out.lines.append((answer["id"], _names(answer["causes"]), _names(told["causes"]), f"{ratio:.2f} floors"))


def _told_for(cause: Mapping[str, Any], truth: Mapping[Key, Any]) -> Key | None:
    """The true cause that a diagnosis gives as a probable alternative of a false one."""
    least = REAL * float(cause["probability"])
    for other in cause["alternatives"]:
        key = (other["effect"], other["at"])
        if key in truth and float(other["probability"]) >= least and float(other["probability"]) > 0.0:
            return key
    return None


def _hidden(cause: Mapping[str, Any], limits: Sequence[Mapping[str, Any]]) -> bool:
    """Whether the diagnosis itself reports that so small a cause is not identifiable in this motion."""
    for entry in limits:
        if (entry["effect"], entry["at"]) == (cause["effect"], cause["at"]):
            sizes = {name: size for name, size in entry["parameters"].items() if name in cause}
            return bool(sizes) and all(
                size is None or abs(cause[name]) < size for name, size in sizes.items()
            )
    return False


def _parameters(out: Score, truth: Mapping[str, Any], told: Mapping[str, Mapping[str, float]]) -> None:
    for name, estimate in told.items():
        if name not in truth:
            continue
        true, value, std = float(truth[name]), float(estimate["value"]), float(estimate["std"])
        out.covered.append(abs(value - true) <= 1.96 * std)
        if name in TOLD:
            group, allowed, relative = TOLD[name]
            # The error of a gain is compared with the gain.
            whole = 1.0 + true if name.endswith("scale_error") else true
            error = abs(value - true) / (abs(whole) if relative else 1.0)
            out.within.setdefault(group, []).append(error <= allowed)


def _names(causes: Sequence[Mapping[str, Any]]) -> str:
    return ", ".join(f"{c['effect']}@{c['at']}" for c in causes) or "none"


def _row(what: str, right: Sequence[bool]) -> tuple[str, str, str]:
    return what, f"{sum(right)} of {len(right)}", f"{100.0 * sum(right) / len(right):.0f} %" if right else "–"
