"""`mirror-posture detect`: the board and the balls in a session's pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ...counted import counted
from ..output import (
    ExitCode,
    JsonOption,
    MaxResidualPx,
    MaxResidualSquares,
    Output,
    SessionArgument,
    write_json,
)

ORDER = 30
PANEL = "Pictures"


def command(
    session: SessionArgument,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Write the session with its detections as a new folder; by default into its own folder."
        ),
    ] = None,
    overlays: Annotated[
        bool, typer.Option(help="Write each picture with its detections drawn, to overlays/.")
    ] = True,
    overwrite: Annotated[
        bool, typer.Option(help="Replace detections (or the folder) that are there.")
    ] = False,
    max_residual_px: MaxResidualPx = 1.0,
    max_residual_squares: MaxResidualSquares = 0.02,
    as_json: JsonOption = False,
) -> None:
    """Find the mirrored board and the coloured balls in the pictures of a session.

    Writes detections.csv (image points), detections.json (residuals, and the reason for each refusal) and
    overlays/. A view whose residual is too large, a ball that is mostly hidden and a picture that cannot be
    read are left out with their reason: look at the overlays if something is missing. Where all pictures are refused
    for the same reason (another size than the camera file's, for example) that is an error and nothing is written.

    Example: `mirror-posture detect my-session`

    Next: `mirror-posture measure my-session`, or `mirror-posture diagnose my-session --out diagnosis`
    """
    output = Output(as_json)
    from ...detect import (
        BoardOptions,
        DetectionOptions,
        GateOptions,
        detect_session,
        read_picture,
        with_detections,
        write_overlay,
    )
    from ...detect.refused import told_refusals
    from ...output_files import new_folder
    from ...session import SessionError, load_session, write_detections, write_session
    from ...session.tables import find_table

    loaded = load_session(session)
    if out is not None and out.resolve() == session.resolve():
        out = None
    target = out or session
    if out is None and find_table(session, "detections") is not None and not overwrite:
        raise SessionError(session / "detections.csv", "is there already; add --overwrite to detect again")
    if out is not None and out.exists() and not overwrite:
        raise SessionError(out, "is there already; give another folder, or add --overwrite")
    done: dict[int, object] = {}
    options = DetectionOptions(board=BoardOptions(gate=GateOptions(max_residual_px, max_residual_squares)))
    try:
        found = detect_session(
            loaded,
            options,
            progress=lambda chunks: output.chunks(chunks, "detecting"),
            done=done,  # type: ignore[arg-type]
        )
    except KeyboardInterrupt:
        if done:
            partial = Path(str(session / "detections.partial.csv") if out is None else f"{out}.partial.csv")
            write_detections(with_detections(loaded, done), partial)  # type: ignore[arg-type]
            output.warn(f"{counted(len(done), 'picture was', 'pictures were')} done: {partial}")
        raise
    if out is None:
        other = find_table(session, "detections")
        write_detections(found.session, other or session / "detections.csv")
    else:
        write_session(found.session, out, overwrite=overwrite)
    report = {
        str(loaded.frames.frame[row]): picture.to_json() for row, picture in sorted(found.pictures.items())
    }
    write_json(target / "detections.json", report)
    if overlays:
        with new_folder(target / "overlays", ("[0-9]*.png",)) as part:
            for row in output.progress(sorted(found.pictures), "overlays", len(found.pictures)):
                file = loaded.image_files[row]
                if file is not None and found.pictures[row].ok:
                    name = f"{loaded.frames.frame[row]:04d}.png"
                    write_overlay(part / name, read_picture(file), found.pictures[row])

    rows, refused = [], []
    for row, picture in sorted(found.pictures.items()):
        frame = str(loaded.frames.frame[row])
        board = next((view for view in picture.boards if view.ok), None)
        good = [view for view in picture.markers if view.ok]
        residual = "" if board is None or board.residual_rms_px is None else f"{board.residual_rms_px:.3f}"
        missing = ", ".join(view.name for view in picture.markers if not view.ok)
        rows.append(
            (frame, Path(picture.source).name, "yes" if board else "no", residual, str(len(good)), missing)
        )
        if picture.error:
            refused.append((frame, "picture", picture.error))
        refused += [(frame, "board", view.reason) for view in picture.boards if not view.ok]
        refused += [(frame, view.name, view.reason) for view in picture.markers if not view.ok]
        for text in picture.warnings:
            output.warn(f"frame {frame}: {text}")
    output.table(
        f"{session}: what was found in {counted(len(rows), 'picture')}",
        ("frame", "*picture", "*board", "residual px", "balls", "~not found"),
        rows,
    )
    for (what, reason), frames in _grouped([one for one in refused if one[1] != "picture"]).items():
        output.say(
            f"{what}: {reason} ({'frame' if len(frames) == 1 else 'frames'} {', '.join(frames)})", style="dim"
        )
    for line in told_refusals(loaded, found.pictures):
        output.warn(line)
    boards = sum(row[2] == "yes" for row in rows)
    output.say(
        f"{boards} of {counted(len(rows), 'board')}, {counted(sum(int(row[4]) for row in rows), 'ball')}: {target}/detections.csv"
    )
    if overlays:
        output.say(f"look at: {target}/overlays/")
    output.result(
        {
            "session": target,
            "pictures": len(rows),
            "boards": boards,
            "balls": int(found.session.mirror_view.marker_seen.sum()),
            "refused": [{"frame": int(f), "what": what, "reason": reason} for f, what, reason in refused],
        }
    )
    if boards == 0:
        output.warn("no board was found in any picture: nothing can be measured")
        raise typer.Exit(ExitCode.NOTHING)


def _grouped(refused: list[tuple[str, str, str]]) -> dict[tuple[str, str], list[str]]:
    """Frames by what was refused and why."""
    groups: dict[tuple[str, str], list[str]] = {}
    for frame, what, reason in refused:
        groups.setdefault((what, reason), []).append(frame)
    return groups
