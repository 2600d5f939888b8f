"""How sessions were made, and of which sessions results are: a small `set.json` in the folder of each.

With it, nothing of another set is kept or mixed in silently. That of sessions lies with their answers, since seed and options
tell the answers.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from .errors import BlindError
from .whole_file import write_whole

SET = "set.json"


def begin_set(
    out: Path, seed: int, options: Mapping[str, Any], planned: Mapping[str, Sequence[str]] | None = None
) -> None:
    """Before sessions are made in `out`: stores seed, options, and what is `planned` by session.

    Raises BlindError where sessions are there that were made otherwise. More of the same set, or the rest of one that was
    stopped, is made.
    """
    file = out / "answers" / SET
    new = json.loads(json.dumps({"seed": seed, "options": dict(options), "planned": dict(planned or {})}))
    if any(out.glob("*/seal.json")):
        before = _read(file)
        if before is None:
            raise BlindError(
                f"{out}: has sessions, but not {file}, which tells how they were made; use another folder"
            )
        _same(out, before, new)
        new["planned"] = before.get("planned", {}) | new["planned"]
        if new == before:
            return
    for folder in (out, file.parent):
        folder.mkdir(parents=True, exist_ok=True)
    write_whole(file, json.dumps(new, indent=1) + "\n")


def _same(out: Path, before: dict[str, Any], new: dict[str, Any]) -> None:
    """Raises BlindError where two sets differ in what both tell."""
    pairs = {"seed": (before.get("seed"), new["seed"])}
    old = before.get("options", {})
    pairs |= {name: (old[name], value) for name, value in new["options"].items() if name in old}
    plans = before.get("planned", {}), new["planned"]
    if bool(plans[0]) != bool(plans[1]):
        pairs["plan"] = ("one" if plans[0] else "none", "one" if plans[1] else "none")
    pairs |= {name: (plans[0][name], value) for name, value in plans[1].items() if name in plans[0]}
    for name, (was, is_) in pairs.items():
        if was != is_:
            raise BlindError(
                f"{out}: its sessions were made with {name} {_text(was)}, got {_text(is_)}; use another folder"
            )


def begin_results(
    cases: Path, results: Path, done: Sequence[str], todo: Sequence[str], leave_out: str | None = None
) -> None:
    """Before the sessions `todo` are diagnosed into `results`: stores their seals, and the effect that the vocabulary lacks.

    Raises BlindError where the results that are there, `done`, are of other sessions or of another vocabulary.
    """
    stored = check_results(cases, results, done, leave_out)
    if stored is None and done and leave_out is not None:
        raise BlindError(
            f"{results}: has results, but not {results / SET}, which tells with which vocabulary they were made; use another folder"
        )
    if not todo:
        return
    seals = {name: seal for name, seal in (stored or {}).get("seals", {}).items() if name in done}
    seals |= {name: seal for name in todo if (seal := _seal_of(cases / name)) is not None}
    results.mkdir(parents=True, exist_ok=True)
    write_whole(results / SET, json.dumps({"leave_out": leave_out, "seals": seals}, indent=1) + "\n")


def check_results(
    cases: Path, results: Path, done: Sequence[str], leave_out: str | None = None
) -> dict[str, Any] | None:
    """What is stored of results; None where nothing is.

    Raises BlindError where the result of one of the sessions `done` is of another session or of another vocabulary.
    """
    stored = _read(results / SET)
    if stored is None or not done:
        return stored
    if stored.get("leave_out") != leave_out:
        raise BlindError(
            f"{results}: its results were made with the effect left out {_text(stored.get('leave_out'))}, "
            f"got {_text(leave_out)}; give the same, or use another folder"
        )
    seals = stored.get("seals", {})
    for name in done:
        now = _seal_of(cases / name)
        if now is not None and seals.get(name, now) != now:
            raise BlindError(
                f"{results / name}: is the result of another session than {cases / name}, whose seal differs; use another folder "
                "for the results"
            )
    return stored


def _seal_of(session: Path) -> str | None:
    stored = _read(session / "seal.json")
    return None if stored is None else str(stored.get("sha256"))


def _read(file: Path) -> dict[str, Any] | None:
    if not file.is_file():
        return None
    try:
        stored = json.loads(file.read_text(encoding="utf-8"))
    except ValueError as error:
        raise BlindError(f"{file} is not JSON: {error}") from error
    if not isinstance(stored, dict):
        raise BlindError(f"{file}: got no JSON object, needed one; use another folder")
    return stored


def _text(value: Any) -> str:
    return (
        "none"
        if value is None
        else " ".join(value)
        if isinstance(value, list) and _words(value)
        else str(value)
    )


def _words(values: list[Any]) -> bool:
    return all(isinstance(v, str) for v in values)
