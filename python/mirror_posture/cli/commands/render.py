"""`mirror-posture render`: pictures of a robot before a mirror, with their truth."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from ..._core import MirrorPostureError
from ..output import JsonOption, Output

ORDER = 20
PANEL = "Pictures"


def command(
    folder: Annotated[Path, typer.Argument(help="The session's folder to be written.", show_default=False)],
    template: Annotated[
        Path | None,
        typer.Option(
            help="Folder with session.toml, robot.urdf, camera.yaml; the embedded robot by default."
        ),
    ] = None,
    postures: Annotated[
        int, typer.Option(help="How many of the demonstration's postures.", min=1, max=6)
    ] = 6,
    yaw_deg: Annotated[
        list[float] | None, typer.Option("--yaw", help="Turn of the mirror in a view, degrees; once a view.")
    ] = None,
    distance_mm: Annotated[float, typer.Option("--distance", help="Mirror before the board, mm.")] = 150.0,
    glass_mm: Annotated[
        float, typer.Option("--glass", help="Thickness of the mirror's pane, mm.", min=0.0)
    ] = 3.0,
    offset: Annotated[
        list[str] | None,
        typer.Option(
            help="Hide a joint's zero error from the model: JOINT=DEGREES; may be given several times."
        ),
    ] = None,
    noise: Annotated[bool, typer.Option(help="Whether the camera has noise.")] = True,
    seed: Annotated[int, typer.Option(help="Seed of the noise.", min=0)] = 0,
    overwrite: Annotated[bool, typer.Option(help="Replace a folder that is there.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Draw a robot before a mirror and write a session with the pictures' truth.

    The pictures are traced ray by ray, glass, ghosts, blur and noise included: what you measure in them can be compared
    with truth.json. Use it to try a mirror, a camera or a posture before you build it, and to test.

    Example: `mirror-posture render my-session --yaw 0 --yaw 15 --offset r_shoulder_roll=2.5`
    """
    output = Output(as_json)
    from ...render import DEMO_POSTURES, DEMO_VIEWS, EMBEDDED_FOLDER, PictureOptions, View, render_session

    views = DEMO_VIEWS if not yaw_deg else tuple(View(yaw_rad=math.radians(yaw)) for yaw in yaw_deg)
    views = tuple(View(view.yaw_rad, view.pitch_rad, distance_mm / 1000.0) for view in views)
    options = PictureOptions(glass_thickness_m=glass_mm / 1000.0)
    if not noise:
        options = PictureOptions(
            glass_thickness_m=glass_mm / 1000.0, full_well_electrons=None, read_noise_electrons=0.0
        )
    chosen = DEMO_POSTURES[:postures]
    with output.counting("drawing", len(chosen) * len(views)) as count:
        render_session(
            folder,
            chosen,
            views,
            offsets_rad=_offsets(offset or []),
            options=options,
            template=template or EMBEDDED_FOLDER,
            seed=seed,
            overwrite=overwrite,
            progress=lambda done, total: count(done),
        )
    output.say(
        f"{len(chosen) * len(views)} pictures of {len(chosen)} postures are in {folder}, their truth in truth.json"
    )
    output.say(f"next: mirror-posture detect {folder}")
    output.result({"session": folder, "pictures": len(chosen) * len(views), "postures": len(chosen)})


def _offsets(given: list[str]) -> dict[str, float]:
    offsets = {}
    for text in given:
        joint, equals, degrees = text.partition("=")
        try:
            offsets[joint] = math.radians(float(degrees))
        except ValueError:
            equals = ""
        if not equals or not math.isfinite(offsets[joint]):
            raise MirrorPostureError(f"--offset: got {text!r}, needed JOINT=DEGREES, as in r_elbow=2.5")
    return offsets
