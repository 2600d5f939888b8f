"""`mirror-posture reproduce`: the paper's experiments in simulation, compared with the paper's results."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mirror_posture.cli.output import JsonOption, Output
from mirror_posture.counted import counted

if TYPE_CHECKING:
    from ..reproduce import Experiment

ORDER = 80
PANEL = "Start here"


def command(
    out: Annotated[
        Path, typer.Option(help="Folder for the figures, report.html, report.md, reproduce.json.")
    ],
    pictures: Annotated[
        bool,
        typer.Option(
            "--pictures", help="Draw every look and detect in it (seconds each), in place of pixel noise."
        ),
    ] = False,
    noise: Annotated[
        float | None,
        typer.Option(
            help="Pixel noise: standard deviation of corners and balls, px.  [default: 0.2]",
            show_default=False,
        ),
    ] = None,
    only: Annotated[
        str | None,
        typer.Option(help="Some of fig7,fig8,fig9,fig10,fig11,table1,fig13,fig14, with commas between."),
    ] = None,
    trials: Annotated[
        int | None,
        typer.Option(
            help="Repetitions of every measurement; the paper's by default (with pictures 5, one correction).",
            min=2,
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of all noise.", min=0)] = 0,
    as_json: JsonOption = False,
) -> None:
    """Repeat the paper's experiments in simulation, and compare the results with the paper's.

    Figs. 7 to 9 test virtual rays, 10 and 11 marker positions, Table I is the uncorrected hand, Figs. 13 and 14 correct it. Each
    figure is drawn as the paper has it; what is beyond the paper is marked so. Each figure is written when it is finished: Ctrl-C keeps what is done.

    Example: `mirror-posture reproduce --out paper --only fig7,fig9`
    """
    output = Output(as_json)
    from mirror_posture._core import MirrorPostureError

    from ..reproduce import NAMES, Experiments, Options, document, rows, write

    if pictures and noise is not None:
        raise MirrorPostureError(
            "got --pictures and --noise; needed one of them (pictures have their sensor's noise)"
        )
    asked = NAMES if only is None else tuple(name.strip().lower() for name in only.split(",") if name.strip())
    options = Options(
        pictures=pictures,
        trials=trials,
        seed=seed,
        only=asked,
        **({} if noise is None else {"noise_px": noise}),
    )
    done: list[Experiment] = []
    for experiment in Experiments(options, output.counting).each():
        done.append(experiment)
        write(out, options, done)
        output.say(f"{experiment.label}: {experiment.title}: {_verdict(experiment)}")
    output.table(
        "What the paper found, and what was found here",
        ("*figure", "~what", "~the paper", "~here", "*"),
        rows(done),
    )
    files = ", ".join(str(out / name) for name in ("report.html", "report.md", "reproduce.json"))
    output.say(f"written: {files}, {counted(sum(len(e.pictures) for e in done), 'picture')}")
    output.result(document(options, done))


def _verdict(experiment: Experiment) -> str:
    failed = [claim.what for claim in experiment.claims if claim.status == "does not hold"]
    return f"does not hold: {'; '.join(failed)}" if failed else "holds"
