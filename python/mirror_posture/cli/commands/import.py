"""`mirror-posture import`: converts an existing recording into a session."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ...counted import counted
from ..output import JsonOption, Output

ORDER = 8
PANEL = "Setting up"


def command(
    source: Annotated[
        Path,
        typer.Argument(
            help="A bag (.mcap, .bag, ROS 2 folder), a LeRobot dataset, a film, or a folder of pictures.",
            show_default=False,
        ),
    ],
    session: Annotated[
        Path, typer.Argument(help="A session's folder, as `init` makes it.", show_default=False)
    ],
    joints: Annotated[
        Path | None,
        typer.Option(help="With a film or pictures: CSV with time_s and a column for each joint."),
    ] = None,
    time: Annotated[
        str | None,
        typer.Option(
            help="The column of time in it, time_s by default, with its unit where that is not s: stamp=ms (us, ns).",
            show_default=False,
        ),
    ] = None,
    joint: Annotated[
        list[str] | None, typer.Option(help="THEIRS=OURS: the recording's name of a joint and the URDF's.")
    ] = None,
    degrees: Annotated[
        bool, typer.Option("--degrees", help="The recording's joints are in degrees.")
    ] = False,
    image: Annotated[
        str | None,
        typer.Option(help="Topic of the pictures, or the dataset's camera, where there are several."),
    ] = None,
    joints_topic: Annotated[str | None, typer.Option(help="Topic of the joint states.")] = None,
    commands_topic: Annotated[
        str | None, typer.Option(help="Topic of the commands, as JointState, where they were recorded.")
    ] = None,
    episode: Annotated[
        int | None,
        typer.Option(help="Episode of a LeRobot dataset; the first, 0, by default.", show_default=False),
    ] = None,
    offset_s: Annotated[
        float | None,
        typer.Option(
            help="Pictures' clock minus joints' clock, s. Found by default: pictures change when joints move."
        ),
    ] = None,
    tolerance: Annotated[
        float, typer.Option(help="At rest, no joint moves further than this, rad (m).")
    ] = 0.003,
    rest_s: Annotated[float, typer.Option(help="Shortest moment of rest, s.")] = 0.5,
    overwrite: Annotated[
        bool,
        typer.Option(
            "--overwrite", help="Replace the session's frames, and the pictures of an earlier import."
        ),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Convert a recording into a session: its moments of rest become postures, each with its sharpest
    picture.

    The clocks of joints and pictures are aligned by comparing how much the pictures change with how far the
    joints move, and the result is printed. Needs `pip install "mirror-posture[import]"` for bags and films.

    Example: `mirror-posture import recording.mcap my-session`

    Next: `mirror-posture check my-session`, then `mirror-posture diagnose my-session --out diagnosis`
    """
    output = Output(as_json)
    from ..._core import MirrorPostureError
    from ...importing import import_recording, read_recording

    names = {}
    for entry in joint or ():
        theirs, equals, ours = entry.partition("=")
        if not (theirs and equals and ours):
            raise MirrorPostureError(f"--joint: got {entry!r}, needed THEIRS=OURS")
        names[theirs] = ours
    recording = read_recording(
        source,
        joints_file=joints,
        joints_topic=joints_topic,
        commands_topic=commands_topic,
        image=image,
        episode=episode,
        degrees=degrees,
        time=time,
    )
    done = import_recording(
        recording,
        session,
        joint_names=names,
        offset_s=offset_s,
        tolerance=tolerance,
        least_s=rest_s,
        overwrite=overwrite,
        degrees=degrees,
    )
    for text in done.warnings:
        output.warn(text)
    output.say(
        f"{counted(done.frames, 'frame')} of {counted(done.rests, 'moment')} of rest: {session}/frames.csv, {session}/images"
    )
    output.say(
        f"pictures' clock minus joints' clock: {done.offset_s:+.2f} s (correlation {done.clock.match:.2f})"
    )
    output.say(f"next: mirror-posture detect {session}")
    output.result(
        {
            "session": session,
            "frames": done.frames,
            "rests": done.rests,
            "offset_s": done.offset_s,
            "clock_correlation": done.clock.match,
            "warnings": list(done.warnings),
        }
    )
