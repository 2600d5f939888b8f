"""A validator of `diagnosis.json`, written from the public format's table alone: it knows nothing of what writes or reads it."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

VERDICTS = {"insufficient", "none", "explained", "partial", "unknown"}
KINDS = {"robot", "setup", "camera", "mirror", "data"}
PLACE = re.compile(
    r"(joint:[^<]+(<-joint:.+|<->joint:.+)?|link:.+|marker:[^<]+(<-link:.+|<->marker:.+)?|camera|board|mirror|robot|data)"
)
COUNTS = ("frames", "postures", "points")
GAPS = ("before_m", "after_m", "noise_floor_m", "before_px", "after_px", "noise_floor_px")
NEAR = 1e-9


def faults(tree: dict[str, Any]) -> list[str]:
    """What of a document, version 2, is not as the format says; one line each."""
    out: list[str] = []

    def need(ok: bool, what: str) -> bool:
        if not ok:
            out.append(what)
        return ok

    def each(key: str, holder: dict[str, Any], check: Callable[[str, Any], None]) -> None:
        if need(isinstance(holder.get(key), list), f"{key}: needed a list"):
            for k, entry in enumerate(holder[key]):
                check(f"{key}[{k}]", entry)

    need(tree.get("format") == "mirror-posture/diagnosis", "format")
    need(tree.get("version") == 2 and tree.get("version") is not True, "version")
    verdict = tree.get("verdict")
    need(verdict in VERDICTS, "verdict")

    def named(name: str, entry: Any) -> bool:
        return need(
            isinstance(entry, dict)
            and isinstance(entry.get("effect"), str)
            and isinstance(entry.get("at"), str)
            and PLACE.fullmatch(entry["at"]) is not None,
            f"{name}: needed an effect at a place",
        )

    def cause(name: str, entry: Any) -> None:
        if not named(name, entry):
            return
        need(entry.get("kind") in KINDS, f"{name}.kind")
        need(_share(entry.get("probability")), f"{name}.probability")
        need("stability" in entry, f"{name}.stability: missing")
        need(entry.get("stability") is None or _share(entry["stability"]), f"{name}.stability")
        for parameter, value in entry.get("parameters", {"": None}).items():
            told = isinstance(value, dict) and _number(value.get("value")) and _number(value.get("std"))
            need(told and value["std"] >= 0, f"{name}.parameters.{parameter}")
        total = entry.get("probability", 0.0)
        for rival in entry.get("alternatives", ()):
            if named(f"{name}.alternatives", rival) and need(
                _share(rival.get("probability")), f"{name}.alternatives"
            ):
                total += rival["probability"]
        need(isinstance(entry.get("alternatives"), list), f"{name}.alternatives: needed a list")
        need(_number(total) and total <= 1 + NEAR, f"{name}: probabilities sum to {total}")

    each("causes", tree, cause)
    causes = tree.get("causes") if isinstance(tree.get("causes"), list) else []
    need(not (verdict in ("none", "unknown", "insufficient") and causes), f"{verdict} with causes")
    need(not (verdict == "explained" and not causes), "explained by nothing")

    def where(name: str, entry: Any) -> None:
        need(isinstance(entry, dict) and isinstance(entry.get("at"), str), f"{name}.at")
        need(_share(entry.get("share"), 1e-6), f"{name}.share")

    each("where", tree, where)
    shares = [w.get("share", 0) for w in tree.get("where", []) if isinstance(w, dict)]
    need(shares == sorted(shares, reverse=True), "where: not the largest first")

    def gap_of(gap: dict[str, Any]) -> None:
        for key in GAPS:
            need(key in gap and (gap[key] is None or _positive(gap[key])), f"gap.{key}")
        need(gap.get("closed") is None or _number(gap["closed"]), "gap.closed")
        ends = gap.get("closed_ci95")
        need(
            ends is None or (len(ends) == 2 and all(map(_number, ends)) and ends[0] <= ends[1]),
            "gap.closed_ci95",
        )
        need(isinstance(gap.get("held_out_postures"), int), "gap.held_out_postures")

        def step(name: str, entry: Any) -> None:
            for key in ("rms_m", "rms_px"):
                need(key in entry and (entry[key] is None or _positive(entry[key])), f"{name}.{key}")

        each("steps", gap, step)
        steps = gap.get("steps") or [{}]
        added = [entry.get("added", "") for entry in steps]
        told = [f"{c.get('effect')}@{c.get('at')}" for c in causes if isinstance(c, dict)]
        need(added == [None, *told], f"gap.steps: got {added}, needed null and {told}")
        for key, entry, whole in (("rms_m", steps[0], "before_m"), ("rms_m", steps[-1], "after_m")):
            if verdict != "insufficient":
                need(entry.get(key) == gap.get(whole), f"gap.steps: {entry.get(key)} is not gap.{whole}")
        for entry in gap.get("checked", ()):
            for key in ("before_m", "after_m"):
                need(entry.get(key) is None or _positive(entry[key]), f"gap.checked.{key}")
            if "ground" in entry:
                need(_positive(entry["ground"]["after_m"]), "gap.checked.ground.after_m")
                need(entry["ground"]["after_m"] < entry["after_m"], "gap.checked.ground is no better")
            if "left_out" in entry:
                points, given, boards = (
                    entry["left_out"][key] for key in ("points", "points_given", "boards")
                )
                need(0 <= points <= given and points + boards > 0, "gap.checked.left_out")

    if need(isinstance(tree.get("gap"), dict), "gap"):
        gap_of(tree["gap"])

    if need(isinstance(tree.get("data"), dict), "data"):
        data = tree["data"]
        for what in COUNTS:
            given, used = data.get(f"{what}_given"), data.get(f"{what}_used")
            counts = isinstance(given, int) and isinstance(used, int)
            need(counts and 0 <= used <= given, f"data.{what}: {used} of {given}")

        def left(name: str, entry: Any) -> None:
            need(isinstance(entry.get("frame"), int) and bool(entry.get("target")), name)
            need(entry.get("deviations") is None or _positive(entry["deviations"]), f"{name}.deviations")
            need(bool(entry.get("why")), f"{name}.why")

        each("left_out", data, left)

    seen: set[tuple[str, str]] = set()

    def limit(name: str, entry: Any) -> None:
        if not named(name, entry):
            return
        place = (entry["effect"], entry["at"])
        need(place not in seen, f"{name}: {place} twice")
        seen.add(place)
        sizes = entry.get("parameters")
        need(
            isinstance(sizes, dict) and all(size is None or _positive(size) for size in sizes.values()),
            f"{name}.parameters",
        )

    each("limits", tree, limit)
    need(verdict == "insufficient" or tree.get("interrupted") is True or bool(seen), "limits: none told")

    def posture(name: str, entry: Any) -> None:
        need(isinstance(entry, dict) and all(map(_number, entry.values())), name)

    each("next_postures", tree, posture)
    return out


def _number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _positive(value: Any) -> bool:
    return _number(value) and value > 0


def _share(value: Any, beyond: float = 0.0) -> bool:
    return _number(value) and -beyond <= value <= 1 + beyond
