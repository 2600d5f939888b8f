"""`mirror-posture capture`: the pictures of a plan, taken by themselves when all is still and sharp."""

from __future__ import annotations

import time
import webbrowser
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Any

import typer

from ..output import ExitCode, JsonOption, Output

ORDER = 7
PANEL = "Setting up"


def command(
    session: Annotated[
        Path, typer.Argument(help="A session's folder, as `init` makes it.", show_default=False)
    ],
    source: Annotated[
        str, typer.Option(help="webcam:0, rtsp://ADDRESS, a film, or a folder of pictures.")
    ] = "webcam:0",
    plan: Annotated[
        Path | None,
        typer.Option(
            help="Folder of a plan, or its postures.csv; by default `plan` in the session's folder."
        ),
    ] = None,
    robot: Annotated[
        str | None, typer.Option(help="A driver that moves the robot: dynamixel, feetech. By default you do.")
    ] = None,
    servos: Annotated[
        Path | None, typer.Option(help="With a driver: which servo is which joint (TOML).")
    ] = None,
    robot_class: Annotated[str | None, typer.Option(help="A driver of your own, MODULE:CLASS.")] = None,
    page: Annotated[
        bool | None,
        typer.Option(help="Whether a page is served to look at; by default for cameras and streams."),
    ] = None,
    port: Annotated[int, typer.Option(help="Of the page; 0: any that is free.", min=0, max=65535)] = 0,
    browser: Annotated[bool, typer.Option(help="Whether the page is opened in the browser.")] = True,
    still_s: Annotated[float, typer.Option(help="For how long all must have stood still.", min=0.1)] = 0.8,
    least_balls: Annotated[int, typer.Option(help="How many balls a picture must show.", min=0)] = 1,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the session's frames.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Take the pictures of a plan into a session, automatically, when everything is still and board and
    balls are found.

    A page on this machine alone (127.0.0.1, a secret address) shows the live picture, the detections, the
    next posture and how many are left. Move the robot (or let a driver move it), and turn the mirror when
    the page asks for it. Each picture is on disk at once, and the same command continues after an
    interruption.

    Pictures of a folder that are named by their frame, as 0012.png, are used as they are.

    Example: `mirror-posture capture my-session --source webcam:0`

    Next: `mirror-posture check my-session`, then `mirror-posture diagnose my-session --out diagnosis`
    """
    output = Output(as_json)
    from ..._core import MirrorPostureError
    from ...capture import Capture, CaptureOptions, Recorder, open_source, state_of
    from ...capture.server import CaptureServer
    from ...capture.sources import place_of
    from ...plan import read_plan
    from ...plan.table import POSTURES
    from ...robots import Nominal
    from ._robots import open_robot, refuse_others_options

    nominal = Nominal.load(session)
    if nominal.camera is None or nominal.metadata.board is None:
        raise MirrorPostureError(f"{session}: has no camera or no [board]; mirror-posture init writes them")
    plan = plan or session / "plan"
    rows = plan / POSTURES if plan.suffix != ".csv" or plan.is_dir() else plan
    frames = read_plan(rows, nominal.robot)
    if not frames:
        raise MirrorPostureError(f"{rows}: has no rows; needed one for each picture; plan once more")
    if robot_class and robot is None:
        robot = "own"
    given = {name for name, value in (("servos", servos), ("robot_class", robot_class)) if value is not None}
    refuse_others_options(robot, given)
    with ExitStack() as stack:
        eye = open_source(source, nominal.camera)
        serve = eye.live if page is None else page
        if robot is not None and not serve:
            raise MirrorPostureError(
                "--robot: a robot is moved only while a person watches the page; leave out --no-page"
            )
        recorder = Recorder(session, frames, overwrite)
        # Before the robot is opened: it need not be, where nothing can be recorded.
        recorder.begin(place_of(eye))
        stack.callback(recorder.close)
        if recorder.taken:
            output.say(f"going on: {len(recorder.taken)} of {len(frames)} pictures are there")
        machine = None
        if robot is not None:
            settings: dict[str, Any] = {
                "robot": robot, "servos": servos, "eye": _no_eye, "hide": [], "robot_class": robot_class, "session": session,
            }  # fmt: skip
            machine = stack.enter_context(open_robot(settings, nominal, output.say))
        capture = Capture(
            nominal, frames, eye, recorder, CaptureOptions(still_s, least_balls, serve), machine, output.say
        )
        stack.callback(capture.close)
        if serve:
            server = CaptureServer(capture, port)
            stack.callback(server.close)
            output.say(f"the page: {server.address}")
            if browser:
                webbrowser.open(server.address)
        try:
            while capture.step():
                if eye.live or serve:
                    time.sleep(0.01)
        except KeyboardInterrupt:
            if recorder.taken:
                output.warn(
                    f"{len(recorder.taken)} of {len(frames)} pictures are kept in {session}/images, {session}/frames.csv; the same "
                    "command continues"
                )
            raise
        state = state_of(capture)
        if serve:
            # The page still has to show how it ended.
            time.sleep(1.0)
    for frame, why in state["skipped"].items():
        output.warn(f"frame {frame} is left out: {why}")
    if state["stage"] == "failed":
        raise MirrorPostureError(state["message"])
    output.say(
        f"{state['message']}: {len(state['taken'])} of {len(frames)} pictures in {session}/images, {session}/frames.csv"
    )
    left = len(frames) - len(state["taken"])
    if left and state["taken"]:
        output.say(
            f"the same command continues with {'the one that is' if left == 1 else f'the {left} that are'} left"
        )
    output.say(f"next: mirror-posture diagnose {session}")
    output.result(
        {"session": session, "taken": state["taken"], "skipped": state["skipped"], "planned": len(frames)}
    )
    if not state["taken"]:
        raise typer.Exit(ExitCode.NOTHING)


def _no_eye() -> Any:
    """The driver only moves the robot: the pictures come from the source."""
    from ...robots import NoLookError

    raise NoLookError("capture takes the pictures itself")
