"""`mirror-posture check`: is this folder a session?"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..output import JsonOption, Output, SessionArgument
from ..values import required_ending

if TYPE_CHECKING:
    from ...session import Session
    from ...session.facts import Fact

ORDER = 10
PANEL = "Sessions"
PICTURES_TRIED = 6
"""Pictures of a session without detections in which the board is looked for."""


def command(
    session: SessionArgument,
    page: Annotated[
        Path | None, typer.Option(help="Write a page for a browser as well: one .html file, no network.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Check a session's folder and list its content.

    Every table is read and validated as by all other commands. All errors are named, each with its file,
    row and fix. Unusual findings are warnings, and a table compares the session with usual values. The
    board's views (of some pictures, where nothing is detected yet) are tested for pictures that are
    mirrored, rotated, of another board or of another camera.

    Example: `mirror-posture check my-session`

    Next: `mirror-posture measure my-session`, or `mirror-posture diagnose my-session --out diagnosis`
    """
    output = Output(as_json)
    from ..._core import MirrorPostureError
    from ...session import SessionError, load_session
    from ...session.facts import facts
    from ...view_check import refuse_mistakes

    required_ending(page, "--page", (".html",))
    try:
        loaded = load_session(session)
    except SessionError as error:
        for problem in error.problems[1:][::-1]:
            output.problem(str(problem))
        if page is not None:
            _write_page(output, page, session, problems=[str(p) for p in error.problems or (error,)])
        raise
    frames, seen, direct = loaded.frames, loaded.mirror_view, loaded.direct_view
    pictures = sum(name is not None for name in frames.image or ())
    summary = {
        "session": str(session),
        "frames": len(frames),
        "postures": len(set(frames.posture.tolist())),
        "joints_commanded": len(frames.joint_names),
        "joints_measured": len(frames.measured_names),
        "accelerometers": list(frames.accelerometer_links),
        "markers": list(loaded.marker_names),
        "pictures": pictures,
        "detected": loaded.detected,
        "boards_in_mirror": int(seen.board_seen.any(axis=1).sum()),
        "markers_in_mirror": int(seen.marker_seen.sum()),
        "points_seen_directly": int(direct.board_seen.sum() + direct.marker_seen.sum()),
        "points_measured_otherwise": 0 if loaded.points is None else int(loaded.points.seen.sum()),
        "warnings": list(loaded.warnings),
    }
    for warning in loaded.warnings:
        output.warn(warning)
    found = facts(loaded)
    try:
        refuse_mistakes(loaded if loaded.detected else _some_detected(loaded))
    except MirrorPostureError as error:
        if page is not None:
            _write_page(output, page, session, problems=[str(error)], warnings=loaded.warnings, facts=found)
        raise
    rows = [(key.replace("_", " "), _in_words(value)) for key, value in summary.items() if key != "warnings"]
    output.table(f"{session} is a session", ["*", "~"], rows)
    output.table(
        "What is plausible, and what is not",
        ("*", "~what", "~here", "~usual"),
        [("plausible" if fact.plausible else "unusual", fact.what, fact.got, fact.usual) for fact in found],
    )
    if page is not None:
        _write_page(output, page, session, warnings=loaded.warnings, facts=found, summary=rows)
    output.result(summary | {"facts": found})


def _in_words(value: object) -> str:
    if isinstance(value, list):
        return ", ".join(value)
    return {True: "yes", False: "no"}[value] if isinstance(value, bool) else str(value)


def _write_page(
    output: Output,
    file: Path,
    session: Path,
    *,
    problems: Sequence[str] = (),
    warnings: Sequence[str] = (),
    facts: Sequence[Fact] = (),
    summary: Sequence[tuple[str, str]] = (),
) -> None:
    from ..._core import __version__
    from ...output_files import write_file
    from ...pages import render

    values: dict[str, Any] = {
        "version": __version__,
        "session": session.resolve().name,
        "problems": problems,
        "warnings": warnings,
        "facts": facts,
        "odd": bool(warnings) or not all(fact.plausible for fact in facts),
        "summary": [(name, value) for name, value in summary if value],
    }
    output.say(f"written: {write_file(file, render('mirror_posture.pages', 'check.html.j2', values))}")


def _some_detected(session: Session) -> Session:
    """A session of pictures with a few of them detected, spread over it."""
    from ...detect import (
        DetectionError,
        detect_pictures,
        predictions_from_session,
        setup_from_session,
        with_detections,
    )

    with_picture = [row for row, file in enumerate(session.image_files) if file is not None]
    if not with_picture or session.board is None or session.camera is None:
        return session
    step = max(1, -(-len(with_picture) // PICTURES_TRIED))
    rows = with_picture[::step]
    expected = predictions_from_session(session)
    found = detect_pictures(
        [file for row in rows if (file := session.image_files[row]) is not None],
        setup_from_session(session),
        [expected[row] for row in rows],
    )
    if all(picture.error for picture in found):
        raise DetectionError(found[0].error)
    for row, picture in zip(rows, found, strict=True):
        if picture.error:
            Output.current().warn(f"frame {session.frames.frame[row]}: {picture.error}")
    return with_detections(session, dict(zip(rows, found, strict=True)))
