"""`mirror-posture apply`: the causes of a diagnosis written back into the model."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from ..output import JsonOption, Output, SessionArgument
from ..values import package_folders, xacro_arguments

ORDER = 70
PANEL = "Diagnosis"


RELATIVE = re.compile(r'\bfile(?:name)?\s*=\s*"(?!package:|model:|file:|https?:|/)[^"]')
"""A file that is named by a path relative to the naming one."""


def command(
    session: SessionArgument,
    diagnosis: Annotated[
        Path, typer.Argument(help="diagnosis.json, or the folder that `diagnose --out` wrote.")
    ],
    out: Annotated[
        Path,
        typer.Option(help="Folder for the corrected session: a session itself, with the same observations."),
    ],
    urdf: Annotated[
        Path | None,
        typer.Option(help="Your own URDF, or the xacro that it is made of: the numbers in it that change."),
    ] = None,
    mjcf: Annotated[
        Path | None, typer.Option(help="Your own MJCF: meshes, geoms, sites and comments stay.")
    ] = None,
    lerobot: Annotated[
        Path | None, typer.Option(help="Your LeRobot calibration (.json): homing offsets, in ticks.")
    ] = None,
    ur: Annotated[
        Path | None, typer.Option(help="Your Universal Robots calibration (.yaml): the joints' origins.")
    ] = None,
    ros2_control: Annotated[
        Path | None,
        typer.Option(
            help="Your file with <ros2_control>: offsets and reductions of its transmissions. Instead of --urdf."
        ),
    ] = None,
    motors: Annotated[
        str, typer.Option(help="Make of the motors of --lerobot: feetech or dynamixel.")
    ] = "feetech",
    xacro_arg: Annotated[
        list[str] | None, typer.Option(help="NAME=VALUE with which the xacro is expanded. Repeat it.")
    ] = None,
    package: Annotated[
        list[str] | None, typer.Option(help="NAME=FOLDER of a ROS package that the xacro names.")
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace the folder where it is there.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Write the result of `diagnose` back: a corrected robot, camera and session.

    Zeros, links, axes and mounts go into robot.urdf, whose names and comments stay; focal length, principal
    point and lens into camera.yaml; squares and glass into session.toml. Play, friction, springs and gear
    ratios, which a URDF cannot represent, go into robot.mjcf.xml for MuJoCo. Causes that no file can
    represent are named, with what to do instead.

    In your own files only the numbers that must change are changed: a corrected copy and a .patch are
    written to the folder, and your files are not changed. In xacro it is the property, argument or origin
    on which the joint alone depends. The controller's files (--lerobot, --ros2-control) and the models
    (--urdf, --mjcf, --ur) correct the same error: use one of them. A diagnosis of another session is
    refused.

    The folder is a session with the same observations: diagnose it again to see what is left.

    Example: `mirror-posture apply my-session diagnosis --out better-session --urdf my_robot.urdf`

    Next: `mirror-posture diagnose better-session --out what-is-left`
    """
    output = Output(as_json)
    from ..._core import MirrorPostureError
    from ...diagnosis import Diagnosis
    from ...diagnosis.applied import OwnFile, apply_diagnosis, twice_told, write_own_files
    from ...diagnosis.applied.apply import rows_for_people
    from ...session import load_session

    if lerobot is None and motors != "feetech":
        raise MirrorPostureError(
            f"--motors: got {motors!r} without --lerobot, whose motors it tells; add --lerobot FILE"
        )
    if urdf is None and (xacro_arg or package):
        raise MirrorPostureError(
            "--xacro-arg, --package: without --urdf they change nothing; add --urdf FILE, or leave them out"
        )
    loaded = load_session(session)
    found = Diagnosis.load(diagnosis)
    own: list[OwnFile] = []

    def also(part: Path) -> None:
        # In the same transaction: one refused file of the user's, and nothing is written.
        written = write_own_files(
            loaded, found, part, urdf=urdf, mjcf=mjcf, lerobot=lerobot, ur=ur, ros2_control=ros2_control,
            motors=motors, xacro_arguments=xacro_arguments(xacro_arg or ()), packages=package_folders(package or ()),
        )  # fmt: skip
        own.extend(replace(one, file=out / one.file.name, patch=out / one.patch.name) for one in written)

    applied = apply_diagnosis(loaded, found, out, overwrite=overwrite, also=also)
    if applied.written:
        output.table(
            f"Written to {applied.folder}",
            ("~cause", "~parameters ± one std", "*file", "~what"),
            rows_for_people(applied),
        )
    else:
        output.say(f"the diagnosis names no cause: {applied.folder} holds the model as it was")
    for entry in own:
        output.say(f"written: {entry.file}, {entry.patch}")
        for line in entry.told or ("nothing of what was found belongs into it",):
            output.say(f"  {line}")
        source = next(
            (file for file in (urdf, mjcf) if file is not None and file.name == entry.file.name), None
        )
        if source is not None and entry.told and RELATIVE.search(entry.file.read_text(encoding="utf-8")):
            output.say(
                f"  the files that it names lie beside {source}; to change it there: patch {source} {entry.patch}"
            )
    for joint in twice_told(own):
        output.warn(
            f"{joint} correct the same joint: a model or its controller, not both, or it counts twice"
        )
    output.result(
        {
            "folder": applied.folder,
            "written": [
                {"effect": w.cause.effect, "at": w.cause.at, "file": w.file, "what": w.what}
                for w in applied.written
            ],
            "own_files": [
                {"file": entry.file, "patch": entry.patch, "told": list(entry.told)} for entry in own
            ],
        }
    )
