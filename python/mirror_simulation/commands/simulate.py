"""`mirror-posture simulate`: the session executed in MuJoCo, as the model is and with each cause added."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from mirror_posture.cli.output import JsonOption, Output, SessionArgument

ORDER = 75
PANEL = "Diagnosis"


def command(
    session: SessionArgument,
    diagnosis: Annotated[
        Path | None,
        typer.Option(
            "--with", help="diagnosis.json, or the folder that `diagnose --out` wrote: its causes are added."
        ),
    ] = None,
    model: Annotated[
        Path | None, typer.Option(help="Your own MJCF or URDF of the robot; the session's URDF by default.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for simulation.json, staircase.png and the patched model.xml."),
    ] = None,
    held_out: Annotated[
        bool,
        typer.Option(
            "--held-out",
            help="Also diagnose each half of the posture space, and report the simulator's gap on the other half.",
        ),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Execute a session in MuJoCo and compare: how far is the simulator from the observations, before and
    after?

    MuJoCo moves the robot from command to command and lets it come to rest. The mirror turns the simulated
    body into predicted image points. With a diagnosis, its causes are added to the model one by one (plays
    as hinges, springs, friction, offsets, mounts), and the gap is computed after each: the staircase. The
    patched model has a comment at each change.

    Example: `mirror-posture simulate my-session --with diagnosis --out simulated`
    """
    output = Output(as_json)
    from mirror_posture import MirrorPostureError
    from mirror_posture.diagnosis import Diagnosis
    from mirror_posture.output_files import new_folder
    from mirror_posture.session import load_session

    try:
        from ..simulate import simulate
        from ..simulate.picture import draw_staircase
    except ModuleNotFoundError as error:
        if error.name != "mujoco":
            raise
        raise MirrorPostureError("MuJoCo is not installed: pip install 'mirror-posture[mujoco]'") from None

    loaded = load_session(session)
    found = None if diagnosis is None else Diagnosis.load(diagnosis)
    total = 1 + (0 if found is None else len(found.causes))
    with output.counting("simulated", total) as count:
        done = 0

        def one_more(_: str) -> None:
            nonlocal done
            done += 1
            count(done)

        simulation = simulate(loaded, model=model, found=found, progress=one_more)
    if held_out:
        from ..simulate.held_out import held_out_gap
        from ..simulate.staircase import without_left_out

        counted = loaded if found is None else without_left_out(loaded, found)
        output.say("each half of the postures is diagnosed, and the other half simulated")
        simulation = replace(simulation, held_out=held_out_gap(counted, model))
    for note in simulation.notes:
        output.warn(note)
    if out is not None:
        with new_folder(out, ("simulation.json", "model.xml", "staircase.png")) as part:
            document = json.dumps(simulation.to_tree(), indent=1, allow_nan=False) + "\n"
            (part / "simulation.json").write_text(document, encoding="utf-8")
            (part / "model.xml").write_text(simulation.model_xml, encoding="utf-8")
            draw_staircase(simulation, part / "staircase.png")
    output.table(
        f"Simulated against seen: {simulation.model_file}",
        ("~added", "RMS px", "RMS mm", "~what was changed"),
        [
            (
                stair.added or "the model as it is",
                _told(stair.gap.rms_px, 1.0),
                _told(stair.gap.rms_m, 1e3),
                stair.what if stair.added else "",
            )
            for stair in simulation.stairs
        ],
        caption=_caption(simulation.told_after_px, simulation.told_after_m),
    )
    if simulation.held_out is not None:
        away = simulation.held_out
        output.table(
            "Held out: causes found on one half of the postures, gap on the other half",
            ("~", "RMS px", "RMS mm"),
            [
                ("the model as it is", _told(away.before_px, 1.0), _told(away.before_m, 1e3)),
                ("with the causes", _told(away.after_px, 1.0), _told(away.after_m, 1e3)),
            ],
            caption=f"{away.postures} postures; causes: "
            + "; ".join(", ".join(causes) or "none" for causes in away.causes),
        )
    last = simulation.stairs[-1].gap
    output.table(
        "Marker by marker, " + ("with all causes" if len(simulation.stairs) > 1 else "as the model is"),
        ("*marker", "RMS px", "RMS mm"),
        [
            (name, _told(px, 1.0), _told(m, 1e3))
            for name, px, m in zip(
                simulation.marker_names, last.marker_rms_px, last.marker_rms_m, strict=True
            )
        ],
    )
    if out is not None:
        output.say(f"written: {out / 'simulation.json'}, {out / 'staircase.png'}, {out / 'model.xml'}")
    elif found is None:
        output.say("add --with DIAGNOSIS to see how far each cause closes the gap in this simulator")
    output.result(simulation.to_tree())


def _told(value: float | None, scale: float) -> str:
    return "–" if value is None or value != value else f"{scale * value:.3f}"


def _caption(after_px: float | None, after_m: float | None) -> str:
    told = [f"{_told(after_px, 1.0)} px"] if after_px is not None else []
    told += [f"{_told(after_m, 1e3)} mm"] if after_m is not None else []
    return (
        f"the diagnosis told {', '.join(told)} with its causes, on postures held out of its fit"
        if told
        else ""
    )
