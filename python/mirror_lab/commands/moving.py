"""`mirror-posture moving`: sessions in motion whose causes are withheld, their diagnosis, its score, and
comparison with other tools."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Annotated

import typer

from mirror_posture._core import MirrorPostureError
from mirror_posture.cli.output import JsonOption, Output
from mirror_posture.counted import counted

ORDER = 91
PANEL = "Diagnosis"

group = typer.Typer(help="Check the diagnosis of motions on sessions whose causes nobody told it.")


@group.command()
def make(
    out: Annotated[Path, typer.Argument(help="Folder for the sessions; the answers go to its `answers`.")],
    cases: Annotated[int, typer.Option(min=1, help="How many sessions.")] = 20,
    seed: Annotated[int, typer.Option(min=0, help="The same seed makes the same sessions.")] = 0,
    robot: Annotated[
        list[str] | None,
        typer.Option(
            help="`small`, `random`, `ur10` (these three by default) or `two-arms` (14 joints); may be repeated."
        ),
    ] = None,
    least: Annotated[int, typer.Option(min=0, max=3, help="Least number of causes.")] = 0,
    most: Annotated[int, typer.Option(min=0, max=3, help="Largest number of causes.")] = 3,
    seconds: Annotated[float, typer.Option(min=4.0, max=120.0, help="Of motion in each session.")] = 20.0,
    effect: Annotated[
        list[str] | None, typer.Option(help="Draw causes of these effects only; may be repeated.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Make moving sessions: pinocchio's dynamics under servos of their own, the mirror's light, noise, rolling shutters.

    Beside each session lies the user's MJCF (`model.xml`) and a second motion of the same body (`…-unseen`).

    Example: `mirror-posture moving make moving --cases 20`
    """
    output = Output(as_json)

    from ..moving.make import ROBOTS, make_cases

    try:
        made = make_cases(out, cases, seed, tuple(robot or ROBOTS), (least, most), seconds, effect or ())
    except ValueError as error:
        raise MirrorPostureError(str(error)) from None
    output.say(
        f"written: {counted(len(made), 'session')} in {out}; `mirror-posture moving run {out}` diagnoses them"
    )
    output.result([str(folder) for folder in made])


@group.command()
def run(
    cases: Annotated[Path, typer.Argument(help="Folder that `moving make` wrote.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder for the diagnoses; `results` in it by default.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Diagnose the sessions, each by the command `diagnose`; finished ones are kept.

    Example: `mirror-posture moving run moving`
    """
    output = Output(as_json)
    results = out or cases / "results"
    folders = sorted(p for p in cases.glob("case-*") if p.is_dir() and not p.name.endswith("-unseen"))
    if not folders:
        raise MirrorPostureError(f"{cases}: has no session (case-0000, ...): make some with `moving make`")
    from ..blind import BlindError
    from ..blind.made_of import begin_results

    done = [p.name for p in folders if (results / p.name / "diagnosis.json").is_file()]
    try:
        begin_results(cases, results, done, [p.name for p in folders if p.name not in done])
    except BlindError as error:
        raise MirrorPostureError(str(error)) from None
    failed = []
    for number, folder in enumerate(folders, start=1):
        target = results / folder.name
        if folder.name in done:
            continue
        command = [
            sys.executable, "-m", "mirror_posture", "diagnose", str(folder), "--model", str(folder / "model.xml"),
            "--check", str(folder.with_name(f"{folder.name}-unseen")), "--out", str(target),
        ]  # fmt: skip
        ended = subprocess.run(command, capture_output=True, text=True, check=False)
        if ended.returncode:
            failed.append(folder.name)
            output.warn(f"{folder.name}: {ended.stderr.strip()[-300:]}")
        output.say(f"{number} of {len(folders)}: {folder.name}")
    output.result({"diagnosed": len(folders) - len(failed), "failed": failed})


@group.command()
def score(
    cases: Annotated[Path, typer.Argument(help="Folder that `moving make` wrote.")],
    results: Annotated[
        Path | None, typer.Option(help="Folder of the diagnoses; `results` in it by default.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Open the answers and score the diagnoses.

    Example: `mirror-posture moving score moving`
    """
    output = Output(as_json)
    from ..blind import BlindError
    from ..moving.score import score as scored

    try:
        found = scored(cases, results or cases / "results")
    except BlindError as error:
        raise MirrorPostureError(str(error)) from None
    if not found.lines:
        raise MirrorPostureError(
            f"{results or cases / 'results'}: has no diagnosis of a case with an answer in {cases / 'answers'}; `moving make` and `moving run` "
            "write them"
        )
    output.table("Case by case", ("~case", "~truth", "~told", "unseen motion"), found.lines)
    output.table("Score", ("~what", "count", "share"), found.rows())
    output.result(found.to_tree())


@group.command()
def peers(
    session: Annotated[Path, typer.Argument(help="A session in motion, with `model.xml` in it or given.")],
    unseen: Annotated[Path, typer.Argument(help="Another motion of the same robot.")],
    model: Annotated[
        Path | None, typer.Option(help="The MJCF; `model.xml` of the session by default.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """The same session by the diagnosis, by `mujoco.sysid`, and as a table of errors by joint: the result of each.

    Example: `mirror-posture moving peers moving/case-0001 moving/case-0001-unseen`
    """
    output = Output(as_json)

    try:
        from ..moving.peers import compare
    except ImportError as error:
        raise MirrorPostureError(
            f"a comparison needs the diagnosis of motions and mujoco.sysid ({error}): pip install 'mirror-posture[mujoco]' 'mujoco[sysid]>=4'"
        ) from error
    told, before, floor = compare(session, unseen, model or session / "model.xml")
    output.table(
        f"Unseen motion: {before:.3f} px with the model as it is, {floor:.3f} px of noise",
        ("*tool", "~says", "CPU, s", "unseen motion, px"),
        [(t.tool, t.says, f"{t.cpu_s:.1f}", f"{t.unseen_px:.3f}") for t in told],
    )
    output.result({"before_px": before, "noise_floor_px": floor, "tools": [vars(t) for t in told]})
