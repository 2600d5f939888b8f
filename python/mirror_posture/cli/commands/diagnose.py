"""`mirror-posture diagnose`: where the model is wrong, by which effect, and how far the gap shrinks."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..._core import MirrorPostureError
from ..detected import load_detected
from ..output import JsonOption, Output
from ..told_diagnosis import OWN_FILES, show_diagnosis, write_results

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from ...diagnosis import Diagnosis
    from ...session import Session

ORDER = 60
PANEL = "Diagnosis"


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
        typer.Option(help="Another session (other postures) that is only predicted, not fitted."),
    ] = None,
    without: Annotated[
        list[str] | None,
        typer.Option(
            "--without",
            "--leave-out",
            help="An effect to leave out of the vocabulary, for example `backlash`.",
        ),
    ] = None,
    withhold: Annotated[
        list[str] | None,
        typer.Option(help="`marker:NAME`: a marker that takes no part in the fit and is then predicted."),
    ] = None,
    most_causes: Annotated[int, typer.Option(help="Largest number of causes.", min=1)] = 6,
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

    Every effect of the vocabulary is tried at every place; those that the evidence supports are fitted together. The gap
    is measured on held-out regions of posture space. Causes that these postures cannot separate are named as alternatives.

    Verdicts: `none`: the model is as good as the noise allows; `explained`: the causes close the gap; `partial`: they
    shrink it and a remainder is left; `unknown`: no effect explains it; `insufficient`: too little evidence. In a session
    with pictures only, board and balls are detected first.

    Exit code 0 for every verdict, 1 where the session is invalid or too small to diagnose.

    Example: `mirror-posture diagnose my-session --out diagnosis --check my-other-session`

    Next: `mirror-posture apply my-session diagnosis --out better-session`
    """
    output = Output(as_json)
    from ...diagnosis.run import DiagnosisInterrupted
    from ...session.motion import is_moving

    targets = _targets(sessions, out)
    others = [
        load_detected(output, folder, points_suffice=True)
        for folder in (check or () if scheduler is None else ())
    ]
    afar: Iterator[Diagnosis] | None = None
    if scheduler is not None:
        from ...fleet import OPEN_LINE, Tls, diagnose_on_fleet, is_open, require_address

        require_address(scheduler)
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
    for folder, target in zip(sessions, targets, strict=True):
        loaded = _loaded(output, folder, alone=len(sessions) == 1)
        if afar is None and is_moving(loaded):
            _refuse_in_motion(folder, {"--without": without, "--withhold": withhold, "--rerun": rerun})
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
            show_diagnosis(output, folder, interrupted.found)
            if target is not None:
                write_results(output, loaded, interrupted.found, target)
            if as_json:
                output.result(interrupted.found.document)
            raise
        except MirrorPostureError as error:
            raise MirrorPostureError(f"{folder}: {error}") from error
        show_diagnosis(output, folder, found)
        if target is not None:
            write_results(output, loaded, found, target)
        if rerun is not None:
            from ...diagnosis.rerun_recording import write_recording

            output.say(f"written: {write_recording(loaded, found, rerun)}; look at it with `rerun {rerun}`")
        documents.append(found.document)
    if as_json:
        output.result(documents[0] if len(documents) == 1 else documents)


def _loaded(output: Output, folder: Path, *, alone: bool) -> Session:
    """One of the sessions; of several the error says which."""
    from ...session import SessionError

    try:
        return load_detected(output, folder, points_suffice=True)
    except SessionError as error:
        if alone:
            raise
        raise MirrorPostureError(f"{folder}: {error}") from error


def _targets(sessions: list[Path], out: Path | None) -> list[Path | None]:
    """Where each session's results are written: of several each into a folder of its own."""
    if out is None or len(sessions) == 1:
        return [out] * len(sessions)
    targets: dict[Path, Path] = {}
    for folder in sessions:
        # Not `Path.name`, which of `.` and `..` is no name; a link keeps its own.
        target = out / os.path.basename(os.path.abspath(folder))
        other = targets.setdefault(target, folder)
        if other is not folder:
            raise MirrorPostureError(
                f"--out: got {other} and {folder}, whose results would both be in {target}; "
                "needed folders of different names: diagnose them one by one, or rename one"
            )
    return list(targets)


def _refuse_in_motion(folder: Path, options: Mapping[str, object]) -> None:
    """Refuses options that the diagnosis of a session in motion does not have: they would change nothing."""
    for option, value in options.items():
        if value:
            raise MirrorPostureError(
                f"{option}: {folder} is a session in motion, and its diagnosis has no such option; needed sessions of still postures, or "
                "leave it out"
            )


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
    from ...output_files import new_folder
    from ..plugins import MOTION_GROUP, plugins

    point = next(iter(plugins(MOTION_GROUP).values()), None)
    try:
        diagnose_motion = None if point is None else point.load()
    except ModuleNotFoundError as error:
        if error.name != "mujoco":
            raise
        diagnose_motion = None
    if diagnose_motion is None:
        raise MirrorPostureError(
            f"{folder}: is a session in motion; pip install 'mirror-posture[mujoco]' installs its diagnosis"
        )
    output.say(f"{folder}: in motion; MuJoCo follows its log, hypothesis by hypothesis")
    found: Diagnosis
    try:
        found, write_page = diagnose_motion(session, model=model, check=others, most_causes=most_causes)
    except MirrorPostureError as error:
        raise MirrorPostureError(f"{folder}: {error}") from error
    show_diagnosis(output, folder, found)
    if out is not None:
        with new_folder(out, (*OWN_FILES, "model.xml")) as part:
            (part / "diagnosis.json").write_text(found.to_json(), encoding="utf-8")
            write_page(part)
        output.say(
            f"written: {out / 'diagnosis.json'}, {out / 'report.html'}, {out / 'model.xml'}, {out / 'pictures'}"
        )
    return found.document


def _diagnosed(output: Output, session: Session, **options: Any) -> Diagnosis:
    """The diagnosis, with its progress on stderr if that is a terminal."""
    from ...diagnosis import diagnose

    with output.working("diagnosing") as told:
        return diagnose(
            session,
            progress=lambda stage, found: told(f"{stage}, {found} found" if found else stage),
            **options,
        )
