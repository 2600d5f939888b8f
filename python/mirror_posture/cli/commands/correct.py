"""`mirror-posture correct`: a robot moves its joints until its markers are where the model wants them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..._core import MirrorPostureError
from ...counted import counted
from ..output import ExitCode, JsonOption, Output
from ..told_correction import progress_of_looks, sliding_joints, tell_outcome
from ..values import given_options, joint_values

if TYPE_CHECKING:
    from ...correct import CorrectOptions, Outcome, Target
    from ...robots import CommandedRobot, Nominal

ORDER = 50
PANEL = "Correction"
MILLIMETRES = 1000.0
REPEATED = ("joint", "marker", "hold", "view", "turn_by", "hide")
"""Options that may be given several times."""


def command(
    context: typer.Context,
    robot: Annotated[
        str, typer.Argument(help="twin, mujoco, by-hand, dynamixel, feetech; `own` with --robot-class.")
    ],
    out: Annotated[
        Path,
        typer.Option(help="Folder that is made: the session, outcome.json, convergence.png, overlay.png."),
    ],
    joint: Annotated[
        list[str] | None,
        typer.Option(help="Target: JOINT=DEGREES (or 0.26rad, 12mm); several times, or with commas."),
    ] = None,
    target: Annotated[
        Path | None, typer.Option(help="Target from a file: TOML or JSON, `joint = position`, rad.")
    ] = None,
    session: Annotated[
        Path | None,
        typer.Option(help="Folder with session.toml, URDF, camera.yaml; the embedded robot by default."),
    ] = None,
    marker: Annotated[
        list[str] | None,
        typer.Option(help="Marker to be brought to its target; by default one of each limb."),
    ] = None,
    hold: Annotated[list[str] | None, typer.Option(help="Joint that is not moved.")] = None,
    gain: Annotated[
        float, typer.Option(help="λ, above 0 and at most 1; the paper's smooth one is 0.2.")
    ] = 0.8,
    tolerance_mm: Annotated[float, typer.Option(help="ε: how near is near enough, mm.")] = 1.0,
    looks: Annotated[int, typer.Option(help="The most looks.", min=1)] = 20,
    jacobian: Annotated[
        str, typer.Option(help="reference (the paper's), current, or broyden.")
    ] = "reference",
    damping: Annotated[
        float | None, typer.Option(help="μ of the damped pseudo-inverse, m/rad; by default from the noise.")
    ] = None,
    estimator: Annotated[
        str, typer.Option(help="As in `measure`; `joint` where the camera's mount is not known to 0.2 mm.")
    ] = "maximum-likelihood",
    view: Annotated[
        list[str] | None,
        typer.Option(help="YAW,PITCH of a viewpoint, degrees; at least two. By default they are proposed."),
    ] = None,
    plan: Annotated[
        Path | None,
        typer.Option(
            help="Instead: the folder of a `plan`: its mirror, placed where the target is seen and free."
        ),
    ] = None,
    turn_by: Annotated[
        list[str] | None,
        typer.Option(
            help="Instead: JOINT=DEGREES[,JOINT=DEGREES] of a viewpoint, for a robot on its own legs or waist."
        ),
    ] = None,
    views: Annotated[int, typer.Option(help="How many viewpoints are proposed for a look.", min=2)] = 3,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with what --out holds.")] = False,
    hide: Annotated[
        list[str] | None,
        typer.Option(help="twin, mujoco: hidden effect, as in joint_offset@joint:r_elbow:offset_rad=0.04."),
    ] = None,
    pictures: Annotated[
        bool, typer.Option(help="twin, mujoco: whether looks are pictures, or exact pixels with noise.")
    ] = True,
    meshes: Annotated[
        bool,
        typer.Option(
            "--meshes", help="twin: pictures with the robot's meshes, before a mirror without glass."
        ),
    ] = False,
    noise_px: Annotated[float, typer.Option(help="twin, mujoco: noise of exact pixels, px.", min=0.0)] = 0.1,
    stand_error_deg: Annotated[
        float, typer.Option(help="twin, mujoco: error of a stand that is turned by hand, degrees.", min=0.0)
    ] = 0.5,
    seed: Annotated[int, typer.Option(help="twin, mujoco: seed.", min=0)] = 0,
    inbox: Annotated[Path | None, typer.Option(help="by-hand: the folder where pictures are saved.")] = None,
    servos: Annotated[
        Path | None, typer.Option(help="dynamixel, feetech: which servo is which joint (TOML).")
    ] = None,
    camera: Annotated[int, typer.Option(help="dynamixel, feetech: number of the camera.", min=0)] = 0,
    robot_class: Annotated[
        str | None, typer.Option(help="A robot of your own, MODULE:CLASS, called with the nominal session.")
    ] = None,
    feed_forward: Annotated[
        Path | None,
        typer.Option(
            help="diagnosis.json (or its folder): the first command compensates for the causes found; play is approached from its side."
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Move a robot's joints until its markers are where its model wants them, and state why it ended.

    Each look takes pictures from several viewpoints and measures the markers in the mirror. Then the
    command either commands a step `Δθ = λ J⁺ (p_ref − p_now)`, looks again, or stops: converged (with the
    measurement's uncertainty), stalled, diverging, marker lost, inconsistent readings, limit reached,
    budget spent, each with its evidence.

    The folder is a session that grows while it runs: whatever ends it, nothing captured is lost, and
    `--resume` continues. Ctrl-C, SIGTERM and SIGHUP bring the robot to rest, and the message says whether
    torque is on. Exit code 0 converged, 3 ended otherwise, 130 stopped with Ctrl-C.

    The mirror's pose is proposed, or given (--view), or found with a plan's mirror and room (--plan
    my-session/plan): then the target is visible past the robot, clear of the glass, with a free path to it.

    Example: `mirror-posture correct twin --out corrected --joint
    r_shoulder_pitch=-30,r_shoulder_roll=50,r_elbow=45 --hide joint_offset@joint:r_elbow:offset_rad=0.06`

    Next: `mirror-posture diagnose corrected`, which says why the posture was wrong
    """
    given = dict(locals())
    output = Output(as_json)
    from ._robots import refuse_others_options

    refuse_others_options(robot, named := given_options(context))
    # A recording keeps all that was asked for.
    settings: dict[str, Any] = {
        name: []
        if value is None and name in REPEATED
        else str(value.resolve())
        if isinstance(value, Path)
        else value
        for name, value in given.items()
        if name not in ("context", "out", "resume", "as_json")
    }
    outcome, options = _run(output, out, settings, named if resume else None)
    written = _pictures(out, outcome, options)
    tell_outcome(output, outcome, sliding_joints(out), written)
    output.result(
        {"stop": {"sentence": outcome.stop.sentence, **asdict(outcome.stop)}, **_rest(outcome), "folder": out}
    )
    if outcome.stop.kind == "interrupted":
        raise typer.Exit(ExitCode.STOPPED)
    if not outcome.converged:
        raise typer.Exit(ExitCode.NOTHING)


def _run(
    output: Output, out: Path, settings: dict[str, Any], resumed_with: set[str] | None
) -> tuple[Outcome, CorrectOptions]:
    """Runs a correction, or goes on with one; then `resumed_with` are the names of the options that were given."""
    from ...correct import Recorder, correct, make_target
    from ...correct.recorded import read_header
    from ...robots import Nominal, ending_signals
    from ._robots import open_robot, read_posture

    recorder = None
    if resumed_with is not None:
        # What is refused touches nothing of the folder.
        begun = read_header(out).get("settings")
        if not isinstance(begun, dict):
            raise MirrorPostureError(
                f"--resume: {out} was begun from Python, without the options of this command; go on with it from there (Recorder.resume)"
            )
        asked, settings = settings, begun
        changed = [
            f"{name if name == 'robot' else '--' + name.replace('_', '-')} {settings.get(name)}, not {asked[name]}"
            for name in asked
            if name in resumed_with and asked[name] != settings.get(name)
        ]
        if changed:
            raise MirrorPostureError(
                f"--resume: {out} was begun with {', and with '.join(changed)}; leave that away, or begin anew with another --out"
            )
        recorder, header = Recorder.resume(out)
        output.say(f"going on with {counted(len(recorder.past().looks), 'picture')} in {out}")
        posture = {str(name): float(value) for name, value in header["posture"].items()}
        nominal = recorder.nominal
    else:
        posture = {} if settings["target"] is None else read_posture(Path(settings["target"]))
        nominal = Nominal.load(settings["session"]) if settings["session"] else Nominal.load()
        posture |= joint_values(settings["joint"], "--joint", nominal.robot)
        if not posture:
            raise MirrorPostureError("no target: needed --joint JOINT=DEGREES, or --target FILE")
    _one_way_of_looking(settings)
    options = build_options(settings, nominal)
    options.check()
    with progress_of_looks(output) as (say, on_look, on_picture), ending_signals():
        with open_robot(settings, nominal, say) as machine:
            ahead = _ahead(output, settings, machine, posture)
            if recorder is None:
                # An impossible target must not leave a folder that blocks the next attempt.
                target = make_target(nominal, posture, options)
                target.corrector(options)
                if settings["plan"] is not None:
                    settings["planned"] = _planned(output, settings, machine, target)
                    options = build_options(settings, nominal)
                recorder = Recorder.start(
                    out, nominal, machine.joint_names, {"settings": settings, "posture": posture}
                )
            outcome = correct(
                machine,
                posture,
                options,
                recorder=recorder,
                command_for_posture=ahead,
                on_look=on_look,
                on_picture=on_picture,
            )
        if (standing := getattr(machine, "standing", None)) is not None:
            output.say(f"{machine.name}: {standing.sentence}")
    return outcome, options


def _ahead(
    output: Output, settings: dict[str, Any], machine: CommandedRobot, posture: Mapping[str, float]
) -> Callable[[Mapping[str, float]], list[dict[str, float]]] | None:
    """The first commands by feed-forward. They are stored in the settings, so that a resumed correction
    uses them whatever happened to the diagnosis."""
    if settings.get("feed_forward") is None:
        return None
    if "commands" not in settings:
        from ...diagnosis import Diagnosis
        from ...diagnosis.feed_forward import feed_forward

        model = feed_forward(Diagnosis.load(settings["feed_forward"]), machine)
        for cause in model.left_out:
            output.warn(
                f"--feed-forward: no command compensates {cause.effect.replace('_', ' ')} at {cause.at}"
            )
        settings["commands"] = list(model(posture))
    commands: list[dict[str, float]] = settings["commands"]
    return lambda _: commands


def _one_way_of_looking(settings: Mapping[str, Any]) -> None:
    given = [f"--{name.replace('_', '-')}" for name in ("view", "plan", "turn_by") if settings.get(name)]
    if len(given) > 1:
        raise MirrorPostureError(f"{' and '.join(given)}: needed one of them; each says from where to look")


def _planned(
    output: Output, settings: Mapping[str, Any], machine: CommandedRobot, target: Target
) -> dict[str, list[list[float]]]:
    """The plan's viewpoints, stored in the settings, so that a resumed correction uses them whatever
    happened to the plan."""
    from ...correct import views_of_plan
    from ...robots.protocol import TurnsView

    if not isinstance(machine, TurnsView):
        raise MirrorPostureError(
            f"--plan: {machine.name} has no way to turn its mirror; needed --turn-by, or by-hand"
        )
    found = views_of_plan(target, settings["plan"], machine.commanded, settings["views"])
    for text in found.warnings:
        output.warn(text)
    output.say(
        f"{len(found.usual)} viewpoints of the plan's mirror for a look, {len(found.further)} further ones: "
        f"± {MILLIMETRES * found.std_m:.2f} mm along a marker's worst axis is expected"
    )
    return {
        kind: [[v.yaw_rad, v.pitch_rad, v.distance_m] for v in views]
        for kind, views in (("usual", found.usual), ("further", found.further))
    }


def build_options(settings: Mapping[str, Any], nominal: Nominal) -> CorrectOptions:
    """The options of a correction of this robot from the command's settings (which a recording keeps)."""
    from ...correct import CorrectOptions, MeasureChoice, StepOptions, StopOptions
    from ...viewpoint import View

    views = []
    for text in settings["view"]:
        try:
            yaw, _, pitch = text.partition(",")
            views.append(View(math.radians(float(yaw)), math.radians(float(pitch or 0.0))))
        except ValueError:
            raise MirrorPostureError(
                f"--view: got {text!r}, needed YAW,PITCH in degrees, as in 15,0"
            ) from None
    kept, further = tuple(views), None
    if (planned := settings.get("planned")) is not None:
        kept, further = (tuple(View(*numbers) for numbers in planned[kind]) for kind in ("usual", "further"))
    return CorrectOptions(
        step=StepOptions(
            gain=settings["gain"], mu_m_per_rad=settings["damping"], jacobian=settings["jacobian"]
        ),
        stop=StopOptions(tolerance_m=settings["tolerance_mm"] / MILLIMETRES, looks=settings["looks"]),
        measure=MeasureChoice(estimator=settings["estimator"]),
        markers=tuple(settings["marker"]),
        held=tuple(settings["hold"]),
        views=kept or None,
        further_views=further,
        views_a_look=settings["views"],
        view_joints=tuple(
            tuple(joint_values([text], "--turn-by", nominal.robot).items()) for text in settings["turn_by"]
        ),
    )


def _pictures(out: Path, outcome: Outcome, options: CorrectOptions) -> list[Path]:
    from ...correct.figures import plot_convergence, write_before_and_after

    written = [out / "outcome.json"]
    if outcome.looks:
        plot_convergence(outcome, out / "convergence.png", options.stop.tolerance_m)
        written.append(out / "convergence.png")
        if write_before_and_after(out, outcome, out / "overlay.png"):
            written.append(out / "overlay.png")
    return written


def _rest(outcome: Outcome) -> dict[str, Any]:
    return {**{key: value for key, value in asdict(outcome).items() if key != "stop"}, "data": outcome.data}
