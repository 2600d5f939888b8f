"""`mirror-posture blind`: make sessions whose effect is withheld, have them diagnosed, open the answers,
score."""

from __future__ import annotations

import itertools
import json
import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mirror_posture._core import MirrorPostureError
from mirror_posture.cli.output import JsonOption, Output
from mirror_posture.counted import counted

if TYPE_CHECKING:
    from concurrent.futures import Executor, Future

ORDER = 90
PANEL = "Diagnosis"
CORES = os.cpu_count() or 1

group = typer.Typer(help="Check the diagnosis on sessions whose effect nobody told it.")


@contextmanager
def _told() -> Iterator[None]:
    """The blind package does not depend on this one: its errors are converted here."""
    from ..blind import BlindError

    try:
        yield
    except BlindError as error:
        raise MirrorPostureError(str(error)) from error
    except ModuleNotFoundError as error:
        if error.name == "mujoco":
            raise MirrorPostureError(
                "blind sessions need MuJoCo: pip install 'mirror-posture[lab,mujoco]'"
            ) from error
        raise


@group.command()
def make(
    out: Annotated[Path, typer.Argument(help="Folder for the sessions; the answers go to its `answers`.")],
    cases: Annotated[int, typer.Option(min=1, help="How many sessions.")] = 20,
    seed: Annotated[int, typer.Option(min=0, help="The same seed makes the same sessions.")] = 0,
    robot: Annotated[
        list[str] | None,
        typer.Option(
            help="`small`, `random`, `g1`, `talos`, `ur10` (these five by default), `panda`, `tiago`, `baxter`, `icub`, `romeo`, "
            "`kinova`, `z1`, or a URDF or MJCF with the mounts in it; may be repeated."
        ),
    ] = None,
    least: Annotated[int, typer.Option(min=0, max=4, help="Least number of causes.")] = 0,
    most: Annotated[int, typer.Option(min=0, max=4, help="Largest number of causes.")] = 4,
    outside: Annotated[
        float | None,
        typer.Option(
            min=0,
            max=1,
            help="Share with an effect outside the vocabulary; 0.15 by default, none where the set-up is by hand.",
        ),
    ] = None,
    outside_beside: Annotated[
        float,
        typer.Option(
            min=0,
            max=1,
            help="Share of the sessions with causes that have an effect outside the vocabulary beside them.",
        ),
    ] = 0.0,
    effect: Annotated[str | None, typer.Option(help="Only sessions with this single effect.")] = None,
    frames: Annotated[
        tuple[int, int], typer.Option(help="Least and largest number of frames of a session.")
    ] = (120, 310),
    pictures: Annotated[
        bool, typer.Option("--pictures", help="Pictures instead of image points: they go through detection.")
    ] = False,
    renderer: Annotated[
        str,
        typer.Option(
            help="What draws pictures: `own`, or `mitsuba` (a real pane with its ghosts; a minute a frame)."
        ),
    ] = "own",
    setup: Annotated[
        str,
        typer.Option(
            help="`exact`, or `by-hand`: board, camera and markers 3 mm and 1° off, joint zeros 0.15°; some sessions state it."
        ),
    ] = "exact",
    mistakes: Annotated[
        bool,
        typer.Option(
            "--mistakes",
            help="Whole mistakes of a first day: one, two at once, or one beside a small cause; slips too.",
        ),
    ] = False,
    accidents: Annotated[
        bool,
        typer.Option(
            "--accidents",
            help="One accident of the log or of names a session, for which the vocabulary has no single word.",
        ),
    ] = False,
    noise_told: Annotated[
        bool, typer.Option("--noise-told/--noise-unknown", help="Whether sessions state their noise.")
    ] = True,
    rest_deg: Annotated[
        float,
        typer.Option(
            min=0,
            max=5,
            help="How far joints rest from their logged positions, in each posture by itself, degrees (one standard deviation).",
        ),
    ] = 0.0,
    imperfect: Annotated[
        float,
        typer.Option(
            min=0,
            max=5,
            help="Small errors of every joint and link beside the causes; 1 is a kit of hobby servos (0.3° each).",
        ),
    ] = 0.0,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes at once; all cores by default.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Draw robots, postures, causes and noise; simulate; seal the answers.

    Bodies are MuJoCo's, the light's path is exact, and nothing is shared with the diagnosis.

    Example: `mirror-posture blind make blind-set --cases 20 --seed 7`
    """
    output = Output(as_json)
    if renderer not in ("own", "mitsuba"):
        raise MirrorPostureError(f"--renderer: got {renderer!r}; known are own and mitsuba")
    if setup not in ("exact", "by-hand"):
        raise MirrorPostureError(f"--setup: got {setup!r}; known are exact and by-hand")
    if pictures and (mistakes or accidents or setup == "by-hand"):
        raise MirrorPostureError(
            "--pictures: mistakes, accidents and hand-made set-ups are made of image points only; leave it out, or them"
        )
    if mistakes and accidents:
        raise MirrorPostureError(
            "--accidents: a session has one of these or --mistakes, not both; leave one out"
        )
    with _told():
        from ..blind.make import make_cases
        from ..blind.simulate import Options

        options = Options(
            causes=(least, most),
            outside_share=(0.0 if setup == "by-hand" else 0.15) if outside is None else outside,
            outside_beside=outside_beside,
            pictures=pictures,
            frames=frames,
            renderer=renderer,
            by_hand=setup == "by-hand",
            mistakes=mistakes,
            accidents=accidents,
            noise_told=noise_told,
            rest_rad=math.radians(rest_deg),
            imperfect=imperfect,
        )
        if robot:
            options = replace(options, robots=tuple(robot))
        plan = None
        if effect is not None:
            kinds = options.robots
            plan = [(f"case-{i:04d}", kinds[i % len(kinds)], [effect]) for i in range(cases)]
        with output.counting("making", cases) as count:
            made = make_cases(
                out, cases, seed, options, plan, workers or CORES, lambda _, left: count(cases - left)
            )
    output.table(
        f"{counted(len(made), 'session')} in {out}", ["*", "*"], [("answers, sealed", str(out / "answers"))]
    )
    output.result({"sessions": [str(p) for p in made], "answers": str(out / "answers")})


@group.command()
def run(
    cases: Annotated[Path, typer.Argument(help="Folder of sealed sessions.")],
    results: Annotated[Path, typer.Argument(help="Folder for the results; what is there is not done again.")],
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes at once; all cores by default.")
    ] = None,
    leave_out: Annotated[
        str | None, typer.Option(help="Diagnose with a vocabulary that lacks this effect.")
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            help="Address of a Dask scheduler (`tcp://HOST:8786`): its workers diagnose (extra `fleet`)."
        ),
    ] = None,
    tls: Annotated[
        tuple[Path, Path, Path] | None,
        typer.Option(
            help="For a `tls://` scheduler: the authority's certificate, one's own, and its key (PEM).",
            metavar="CA CERT KEY",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Diagnose every session that has no result yet.

    Runs on all cores, or on a fleet. After a stop, call it again: finished sessions are kept.

    Example: `mirror-posture blind run blind-set blind-results`
    """
    output = Output(as_json)
    with _told():
        from mirror_posture.fleet import (
            OPEN_LINE,
            Tls,
            checked_effects,
            diagnose_folder,
            diagnose_packed,
            is_open,
            on_fleet,
            pack,
        )

        from ..blind.on_this_machine import on_this_machine
        from ..blind.runner import Diagnosed, run_sessions, sessions_to_do, timed

        without = checked_effects([leave_out] if leave_out else [])
        here = partial(timed, partial(diagnose_folder, without=without))
        there = partial(timed, partial(diagnose_packed, without=without))

        def submit(pool: Executor, session: Path) -> Future[Diagnosed]:
            return pool.submit(there, pack(session)) if scheduler else pool.submit(here, session)

        if scheduler and is_open(scheduler):
            output.warn(OPEN_LINE.format(scheduler))
        certificates = None if tls is None else Tls(*tls)
        where = partial(on_fleet, scheduler, certificates) if scheduler else partial(on_this_machine, workers)
        with output.counting("diagnosing", len(sessions_to_do(cases, results))) as count:
            done = itertools.count(1)
            report = run_sessions(cases, results, submit, where, lambda *_: count(next(done)), leave_out)
    for name in report.failed:
        output.warn(f"{name}: the diagnosis failed; see {results / name / 'failure.json'}")
    rows = [
        ("diagnosed now", str(report.done)),
        ("before", str(report.before)),
        ("failed", str(len(report.failed))),
    ]
    output.table(f"results in {results}", ["*", "*"], rows)
    output.result({"done": report.done, "before": report.before, "failed": report.failed})


@group.command()
def score(
    cases: Annotated[Path, typer.Argument(help="Folder of sealed sessions.")],
    results: Annotated[Path, typer.Argument(help="Folder of their results.")],
    out: Annotated[Path, typer.Option(help="Folder for score.json and score.html.")] = Path("blind-score"),
    leave_out: Annotated[str | None, typer.Option(help="The effect that the diagnosis lacked.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Open the seals and report how often the diagnosis was right.

    Example: `mirror-posture blind score blind-set blind-results --out blind-score`
    """
    output = Output(as_json)
    with _told():
        from ..blind.score import score as score_of
        from ..blind.score_page import BY_HAND, FIRST_DAY, TARGETS, write_page
        from ..blind.whole_file import write_whole

        result = score_of(cases, results, leave_out)
        out.mkdir(parents=True, exist_ok=True)
        write_whole(out / "score.json", json.dumps(result, indent=1) + "\n")
        write_page(result, out / "score.html")
    rows = [(text, f"{result[key]['hits']} / {result[key]['of']}") for key, (text, _, _) in TARGETS.items()]
    for part, titles in ((result["by_hand"], BY_HAND), (result["first_day"], FIRST_DAY)):
        rows += [(text, f"{part[key]['hits']} / {part[key]['of']}") for text, key in titles if part]
    if result["by_hand"]:
        within = result["by_hand"]["mounts"]["within_95"]
        rows.append(("Mounts within the claimed 95 %", f"{within['hits']} / {within['of']}"))
    output.table(f"{counted(result['sessions'], 'session')}; page in {out / 'score.html'}", ["*", "*"], rows)
    output.result(result)
