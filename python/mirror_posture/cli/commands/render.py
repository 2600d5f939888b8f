"""`mirror-posture render`: pictures of a robot in front of a mirror, with their truth."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..._core import MirrorPostureError
from ...counted import counted
from ..output import JsonOption, Output
from ..values import given_options, joint_values
from ..values import mirror_size as wanted_size

if TYPE_CHECKING:
    from ...robots import Nominal

ORDER = 20
PANEL = "Pictures"
MOST_YAW_DEG, MOST_DISTANCE_MM = 85.0, 20_000.0
"""A mirror that is turned farther shows its back or edge; one that is farther away shows no corner of any board."""
WITH_MESHES = {"plan": "--plan", "joint": "--joint", "preview": "--preview", "mirror_size": "--mirror-size"}
TRACED = {"postures": "--postures", "glass_mm": "--glass", "noise": "--noise", "seed": "--seed"}
WITHOUT_PLAN = {"joint": "--joint", "yaw_deg": "--yaw", "distance_mm": "--distance"}
"""Parameters by what they are an option of."""


def command(
    context: typer.Context,
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
        list[float] | None,
        typer.Option(
            "--yaw",
            help="Turn of the mirror in a view, degrees; once a view.",
            min=-MOST_YAW_DEG,
            max=MOST_YAW_DEG,
        ),
    ] = None,
    distance_mm: Annotated[
        float, typer.Option("--distance", help="Mirror before the board, mm.", min=1.0, max=MOST_DISTANCE_MM)
    ] = 150.0,
    glass_mm: Annotated[
        float, typer.Option("--glass", help="Thickness of the mirror's pane, mm.", min=0.0)
    ] = 3.0,
    offset: Annotated[
        list[str] | None,
        typer.Option(
            help="Hide a joint's zero error from the model: JOINT=DEGREES (a joint that slides: JOINT=2mm); may be given several times."
        ),
    ] = None,
    meshes: Annotated[
        bool,
        typer.Option(
            "--meshes", help="Draw the robot with its meshes, by MuJoCo: any robot; a mirror without glass."
        ),
    ] = False,
    plan: Annotated[
        Path | None,
        typer.Option(help="With --meshes: the folder of a plan, whose postures and views are drawn."),
    ] = None,
    joint: Annotated[
        list[str] | None,
        typer.Option(help="With --meshes: JOINT=DEGREES of one posture of your own. Repeat it."),
    ] = None,
    mirror_size: Annotated[
        str | None,
        typer.Option(
            help="With --meshes: width x height, cm. [default: as the plan has it, or session.toml says, else 40x60]"
        ),
    ] = None,
    preview: Annotated[
        bool, typer.Option("--preview", help="With --meshes: one picture (FOLDER is then a .png), at once.")
    ] = False,
    noise: Annotated[bool, typer.Option(help="Whether the camera has noise.")] = True,
    seed: Annotated[int, typer.Option(help="Seed of the noise.", min=0)] = 0,
    overwrite: Annotated[bool, typer.Option(help="Replace a folder that is there.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Draw a robot before a mirror and write a session with the pictures' truth.

    The pictures are traced ray by ray, glass, ghosts, blur and noise included: what you measure in them can be compared
    with truth.json. Use it to try a mirror, a camera or a posture before you build it, and to test.

    With `--meshes` any robot is drawn as it looks, hidden parts and a mirror of finite size included (`pip install
    "mirror-posture[mujoco]"`): a plan's pictures, or a preview of one posture in a second.

    Example: `mirror-posture render my-session --yaw 0 --yaw 15 --offset r_shoulder_roll=2.5`;
    `mirror-posture render look.png --template my-session --meshes --preview --joint elbow=30`

    Next: `mirror-posture detect my-session`
    """
    output = Output(as_json)
    from ...render import DEMO_POSTURES, DEMO_VIEWS, EMBEDDED_FOLDER, PictureOptions, View, render_session
    from ...robots import Nominal

    _refuse_unused(context, meshes, plan is not None)
    if meshes:
        _with_meshes(
            output, folder, template or EMBEDDED_FOLDER, plan, joint or [], mirror_size, preview, yaw_deg or [0.0], distance_mm,
            offset or [], overwrite,
        )  # fmt: skip
        return
    views = DEMO_VIEWS if not yaw_deg else tuple(View(yaw_rad=math.radians(yaw)) for yaw in yaw_deg)
    views = tuple(View(view.yaw_rad, view.pitch_rad, distance_mm / 1000.0) for view in views)
    options = PictureOptions(glass_thickness_m=glass_mm / 1000.0)
    if not noise:
        options = PictureOptions(
            glass_thickness_m=glass_mm / 1000.0, full_well_electrons=None, read_noise_electrons=0.0
        )
    chosen = DEMO_POSTURES[:postures]
    nominal = Nominal.load(template or EMBEDDED_FOLDER)
    _require_joints(nominal, {name for posture in chosen for name in posture})
    with output.counting("drawing", len(chosen) * len(views)) as count:
        render_session(
            folder,
            chosen,
            views,
            offsets_rad=joint_values(offset or [], "--offset", nominal.robot),
            options=options,
            template=template or EMBEDDED_FOLDER,
            seed=seed,
            overwrite=overwrite,
            progress=lambda done, total: count(done),
        )
    output.say(
        f"{counted(len(chosen) * len(views), 'picture')} of {counted(len(chosen), 'posture')} {'is' if len(chosen) * len(views) == 1 else 'are'} in {folder}, their truth in "
        "truth.json"
    )
    output.say(f"next: mirror-posture detect {folder}")
    output.result({"session": folder, "pictures": len(chosen) * len(views), "postures": len(chosen)})


def _refuse_unused(context: typer.Context, meshes: bool, planned: bool) -> None:
    """Raises `MirrorPostureError` for options that were given and would change nothing."""
    given = given_options(context)
    for names, unused, why in (
        (WITH_MESHES, not meshes, "without --meshes it changes nothing; add --meshes, or leave it out"),
        (TRACED, meshes, "is of pictures without --meshes; leave it out, or leave out --meshes"),
        (
            WITHOUT_PLAN,
            meshes and planned,
            "the plan has its own postures and mirrors; leave it out, or leave out --plan",
        ),
    ):
        found = [option for name, option in names.items() if name in given]
        if unused and found:
            raise MirrorPostureError(f"{', '.join(found)}: {why}")


def _require_joints(nominal: Nominal, names: set[str]) -> None:
    """Raises `MirrorPostureError` where the demonstration's postures are another robot's."""
    from ...session.errors import another_robots

    has = nominal.robot.position_names
    if lacks := sorted(names - set(has)):
        raise another_robots(
            nominal.robot_file,
            [f"joint {name}" for name in lacks],
            "the demonstration's postures",
            has,
            "Draw your own robot with --meshes, in postures of --joint or --plan",
        )


def _with_meshes(
    output: Output,
    folder: Path,
    template: Path,
    plan: Path | None,
    joint: list[str],
    mirror_size: str | None,
    preview: bool,
    yaw_deg: list[float],
    distance_mm: float,
    offset: list[str],
    overwrite: bool,
) -> None:
    from ...picture_files import write_picture
    from ...plan import PlanOptions
    from ...plan.again import read_options
    from ...plan.simple import mirrors_before, planned_mirrors
    from ...plan.table import DOCUMENT
    from ...robots import Nominal
    from ...shapes.mesh_pictures import MeshFrame, MeshPainter, render_meshes_session

    nominal = Nominal.load(template)
    offsets = joint_values(offset, "--offset", nominal.robot)
    wanted = PlanOptions(*wanted_size(mirror_size))
    if plan is not None and mirror_size is None and (plan / DOCUMENT).is_file():
        # The mirror of the plan: a smaller one would not show what the plan predicts.
        wanted = read_options(plan / DOCUMENT)
    options = wanted.before(nominal.metadata.mirror)
    width, height = options.mirror_size_m
    if plan is not None:
        found = planned_mirrors(plan, nominal)
        frames = [MeshFrame(row.posture, row.commanded, center, normal) for row, center, normal in found]
    else:
        posture = joint_values(joint, "--joint", nominal.robot)
        frames = [
            MeshFrame(0, posture, m.center_in_root_m, m.normal_in_root)
            for m in mirrors_before(
                nominal, options, [math.radians(yaw) for yaw in yaw_deg], distance_mm / 1000.0
            )
        ]
    if preview:
        if folder.suffix.lower() != ".png":
            raise MirrorPostureError(f"--preview: got {folder}, needed a file that ends with .png")
        painter = MeshPainter(nominal, (width, height), preview=True)
        first = frames[0]
        actual = {n: first.commanded.get(n, 0.0) + offsets.get(n, 0.0) for n in {*first.commanded, *offsets}}
        picture = painter.draw(actual, first.center_in_root_m, first.normal_in_root)
        painter.close()
        write_picture(folder, picture)
        missing = painter.missing
        output.say(f"written: {folder}")
        output.result({"picture": folder, "meshes_not_drawn": missing})
    else:
        with output.counting("drawing", len(frames)) as count:
            missing = render_meshes_session(
                folder, nominal, frames, (width, height), offsets_rad=offsets, overwrite=overwrite,
                progress=lambda done, total: count(done),
            )  # fmt: skip
        output.say(
            f"{counted(len(frames), 'picture is', 'pictures are')} in {folder}, the actual joints in truth.json"
        )
        output.say(f"next: mirror-posture detect {folder}")
        output.result({"session": folder, "pictures": len(frames), "meshes_not_drawn": missing})
    if missing:
        output.warn(
            f"{counted(len(missing), 'mesh was', 'meshes were')} not drawn (not found, or trimesh is not installed), as {missing[0]}"
        )
