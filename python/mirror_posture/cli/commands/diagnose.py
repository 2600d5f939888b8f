"""`mirror-posture diagnose`: where the model is wrong, by which effect, and how far the gap shrinks."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..._core import MirrorPostureError
from ..detected import load_detected
from ..output import JsonOption, Output

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from ...diagnosis import Diagnosis
    from ...session import Session

ORDER = 60
PANEL = "Diagnosis"
NEXT_POSTURES = "next-postures.csv"
OWN_FILES = ("diagnosis.json", "report.html", "pictures", NEXT_POSTURES)
"""What --out writes: of an earlier run in the same folder nothing of it stays."""


def command(
    sessions: Annotated[
        list[Path], typer.Argument(help="The session's folder; several are diagnosed one by one.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for diagnosis.json, report.html and pictures/; of several sessions one folder each."
        ),
    ] = None,
    check: Annotated[
        list[Path] | None,
        typer.Option(help="Another session (other postures), predicted with nothing of it fitted."),
    ] = None,
    without: Annotated[
        list[str] | None,
        typer.Option(
            "--without", "--leave-out", help="An effect that the vocabulary shall lack, `backlash` say."
        ),
    ] = None,
    withhold: Annotated[
        list[str] | None,
        typer.Option(help="`marker:NAME`: a marker that the fit does not see and that it must then predict."),
    ] = None,
    most_causes: Annotated[int, typer.Option(help="Causes that are looked for at most.", min=1)] = 6,
    model: Annotated[
        Path | None,
        typer.Option(
            help="Of a session in motion: the MJCF (or URDF) that your simulator runs, with its servos (extra `mujoco`)."
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            help="Address of a Dask scheduler (`tcp://HOST:8786`) whose workers diagnose (extra `fleet`)."
        ),
    ] = None,
    tls: Annotated[
        tuple[Path, Path, Path] | None,
        typer.Option(
            help="For a `tls://` scheduler: the authority's certificate, one's own, and its key (PEM).",
            metavar="CA CERT KEY",
        ),
    ] = None,
    rerun: Annotated[
        Path | None,
        typer.Option(help="Write a recording (.rrd) for the Rerun viewer as well (extra `rerun`)."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Say where the model is wrong, which effect causes it, and how far the gap shrinks.

    Every effect of the vocabulary is tried at every place; those that the evidence carries are fitted together. The gap
    is told on postures whose whole region was held out. What these postures cannot tell apart is named as alternatives.

    Verdicts: `none` the model is as good as the noise allows; `explained` the causes close the gap; `partial` they
    shrink it and something is left; `unknown` no effect explains it. A session with pictures only is detected first.

    Exit code 0 for every verdict, 1 where the session cannot be meant or is too small to diagnose.

    Example: `mirror-posture diagnose my-session --out diagnosis --check my-other-session`

    Next: `mirror-posture apply my-session diagnosis --out better-session`
    """
    output = Output(as_json)
    from ...diagnosis.run import DiagnosisInterrupted
    from ...session.motion import is_moving

    others = [
        load_detected(output, folder, points_suffice=True)
        for folder in (check or () if scheduler is None else ())
    ]
    afar: Iterator[Diagnosis] | None = None
    if scheduler is not None:
        from ...fleet import OPEN_LINE, Tls, diagnose_on_fleet, is_open

        if is_open(scheduler):
            output.warn(OPEN_LINE.format(scheduler))
        afar = diagnose_on_fleet(
            sessions,
            scheduler,
            without=without or (),
            check=check or (),
            withhold=withhold or (),
            most_causes=most_causes,
            tls=None if tls is None else Tls(*tls),
        )
    if rerun is not None and (len(sessions) > 1 or afar is not None):
        raise MirrorPostureError(
            "--rerun: got several sessions or a fleet, needed one session, diagnosed here"
        )
    documents: list[Mapping[str, Any]] = []
    for folder in sessions:
        loaded = load_detected(output, folder, points_suffice=True)
        if afar is None and is_moving(loaded):
            target = (
                None
                if out is None
                else out
                if len(sessions) == 1
                else out / (folder.name or folder.resolve().name)
            )
            documents.append(_in_motion(output, loaded, folder, model, others, most_causes, target))
            continue
        if model is not None:
            raise MirrorPostureError(
                f"--model: {folder} is no session in motion (states.csv, and pictures while joints move); for still postures diagnose "
                "without it, then `mirror-posture simulate --model`"
            )
        try:
            found = (
                next(afar)
                if afar is not None
                else _diagnosed(
                    output,
                    loaded,
                    without=without or (),
                    check=others,
                    withhold=withhold or (),
                    most_causes=most_causes,
                    markers=rerun is not None,
                )
            )
        except DiagnosisInterrupted as interrupted:
            _show(output, folder, interrupted.found)
            if out is not None:
                target = out if len(sessions) == 1 else out / (folder.name or folder.resolve().name)
                write_results(output, loaded, interrupted.found, target)
            if as_json:
                output.result(interrupted.found.document)
            raise
        except MirrorPostureError as error:
            raise MirrorPostureError(f"{folder}: {error}") from error
        _show(output, folder, found)
        if out is not None:
            target = out if len(sessions) == 1 else out / (folder.name or folder.resolve().name)
            write_results(output, loaded, found, target)
        if rerun is not None:
            from ...diagnosis.rerun_recording import write_recording

            output.say(f"written: {write_recording(loaded, found, rerun)}; look at it with `rerun {rerun}`")
        documents.append(found.document)
    if as_json:
        output.result(documents[0] if len(documents) == 1 else documents)


def _in_motion(
    output: Output,
    session: Session,
    folder: Path,
    model: Path | None,
    others: list[Session],
    most_causes: int,
    out: Path | None,
) -> Mapping[str, Any]:
    """Diagnoses a session in motion, shows and writes it; returns its document."""
    try:
        from ...motion import diagnose_motion, with_checked
        from ...motion.page import write_motion_report
    except ModuleNotFoundError as error:
        if error.name != "mujoco":
            raise
        raise MirrorPostureError(
            f"{folder}: is a session in motion, and MuJoCo is not installed: pip install 'mirror-posture[mujoco]'"
        ) from None
    from ...output_files import new_folder

    output.say(f"{folder}: in motion; MuJoCo follows its log, hypothesis by hypothesis")
    try:
        done = diagnose_motion(session, model=model, most_causes=min(most_causes, 4))
        done = with_checked(done, others, model)
    except MirrorPostureError as error:
        raise MirrorPostureError(f"{folder}: {error}") from error
    _show(output, folder, done.diagnosis)
    if out is not None:
        with new_folder(out, (*OWN_FILES, "model.xml")) as part:
            (part / "diagnosis.json").write_text(done.diagnosis.to_json(), encoding="utf-8")
            write_motion_report(done, part)
        output.say(
            f"written: {out / 'diagnosis.json'}, {out / 'report.html'}, {out / 'model.xml'}, {out / 'pictures'}"
        )
    return done.diagnosis.document


def _diagnosed(output: Output, session: Session, **options: Any) -> Diagnosis:
    """The diagnosis, with what is being done on stderr where that is a terminal."""
    from ...diagnosis import diagnose

    with output.working("diagnosing") as told:
        return diagnose(
            session,
            progress=lambda stage, found: told(f"{stage}, {found} found" if found else stage),
            **options,
        )


def write_results(output: Output, session: Session, found: Diagnosis, folder: Path) -> None:
    """Writes diagnosis.json, the report with its pictures and the next postures into a folder, and says so."""
    from ...diagnosis.next_postures import write_next_postures
    from ...diagnosis.page import write_report
    from ...output_files import new_folder

    with new_folder(folder, OWN_FILES) as part:
        (part / "diagnosis.json").write_text(found.to_json(), encoding="utf-8")
        write_report(session, found, part)
        if found.next_postures:
            write_next_postures(found, part / NEXT_POSTURES)
    if found.next_postures:
        output.say(
            f"written: {folder / NEXT_POSTURES}, {len(found.next_postures)} postures that would tell the rivals apart"
        )
    output.say(f"written: {folder / 'diagnosis.json'}, {folder / 'report.html'}, {folder / 'pictures'}")


def _show(output: Output, folder: Path, found: Diagnosis) -> None:
    from ...diagnosis.formatting import (
        ENCODER_COLUMNS,
        dependence,
        effect_in_words,
        millimetres,
        next_step,
        percent,
        place_in_words,
        steps,
        tell_all,
        telling_encoders,
    )
    from ...diagnosis.limits import line as limits_line

    if output.as_json:
        for warning in found.warnings:
            output.warn(warning)
        return
    output.say(f"{folder}: {found.sentence}", style="bold")
    if found.causes:
        rows = [
            (
                effect_in_words(cause.effect),
                place_in_words(cause.at),
                percent(cause.probability),
                "\n".join(map(str, tell_all(cause))),
                "\n".join(
                    f"{effect_in_words(a.effect)} at {place_in_words(a.at)} ({percent(a.probability)})"
                    for a in cause.alternatives
                ),
            )
            for cause in found.causes
        ]
        output.table(
            "Causes, the one that closes most of the gap first",
            ("*effect", "~at", "probability", "~parameters ± one std", "~alternatives"),
            rows,
        )
    gap = found.gap
    closed = ""
    if gap.closed is not None:
        closed = f"closed {percent(gap.closed)}"
        if gap.closed_ci95 is not None:
            closed += f" (95 %: {percent(gap.closed_ci95[0])} to {percent(gap.closed_ci95[1])})"
    if steps(found):
        closed += f"{'; ' if closed else ''}as the causes are added one by one: {steps(found)}"
    gaps: list[tuple[str, ...]] = [
        (
            "held-out postures of this session",
            millimetres(gap.before_m),
            millimetres(gap.after_m),
            millimetres(gap.noise_floor_m),
        )
    ]
    gaps += [(c.session, millimetres(c.before_m), millimetres(c.after_m), "") for c in gap.checked]
    gaps += [
        (f"marker {w.marker}, withheld", millimetres(w.before_m), millimetres(w.after_m), "")
        for w in found.witness
    ]
    output.table(
        "Gap between prediction and observation, RMS, mm",
        ("~on", "before", "after", "noise floor"),
        gaps,
        caption=closed,
    )
    if found.data.left_out:
        reasons: dict[str, list[int]] = {}
        for left in found.data.left_out:
            reasons.setdefault(left.why, []).append(left.frame)
        output.table(
            f"Left out; used: {found.data.points_used} of {found.data.points_given} observations of markers",
            ("~why", "observations", "frames"),
            [
                (
                    why,
                    str(len(frames)),
                    f"{min(frames)}" if len(set(frames)) == 1 else f"{min(frames)} to {max(frames)}",
                )
                for why, frames in reasons.items()
            ],
            caption="each of them is in diagnosis.json",
        )
    read = found.document.get("encoder_witness", ())
    encoders = telling_encoders(read)
    if encoders:
        output.table(
            "Encoders that no fit saw: RMS of reading less prediction, mrad (a prismatic joint: mm)",
            ("*joint", "before", "after", "before, zero free", "after, zero free"),
            [(e["joint"], *(f"{1e3 * e[key]:.2f}" for key in ENCODER_COLUMNS)) for e in encoders],
            caption=f"{len(read) - len(encoders)} others read what is predicted"
            if len(encoders) < len(read)
            else "",
        )
    accelerometers = found.document.get("accelerometer_witness", ())
    if accelerometers:
        columns = ("before_rad", "after_rad", "before_mount_free_rad", "after_mount_free_rad")
        output.table(
            "Accelerometers that no fit saw: RMS angle between reading and prediction, mrad",
            ("*link", "frames", "before", "after", "before, mount free", "after, mount free"),
            [
                (
                    a["link"],
                    str(a["frames"]),
                    *("" if a[key] is None else f"{1e3 * a[key]:.2f}" for key in columns),
                )
                for a in accelerometers
            ],
        )
    if limits_line(found):
        output.say(limits_line(found))
    for place in found.where:
        if place.depends_on:
            output.say(
                f"unexplained at {place.at} ({percent(place.share)} of the gap): depends on {dependence(place.depends_on)}"
            )
    for warning in found.warnings:
        output.warn(warning)
    output.say(f"next: {next_step(found)}")
