"""`mirror-posture plan`: postures and viewpoints for this robot, mirror and room, and what they will show."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..._core import MirrorPostureError
from ...counted import counted
from ..output import JsonOption, Output
from ..values import joint_values, package_folders
from ..values import mirror_size as wanted_size

if TYPE_CHECKING:
    from ...plan import Plan
    from ...plan.telling import Rival, Tells

ORDER = 6
PANEL = "Setting up"
MOST_TWINS = 12


def command(
    session: Annotated[
        Path, typer.Argument(help="A session's folder, as `init` makes it.", show_default=False)
    ],
    out: Annotated[
        Path | None, typer.Option(help="Folder for the plan; by default `plan` in the session's folder.")
    ] = None,
    postures: Annotated[int, typer.Option(help="How many postures.")] = 36,
    views: Annotated[int, typer.Option(help="How many ways the mirror (or the robot) is turned.")] = 3,
    mirror_size: Annotated[
        str | None,
        typer.Option(help="Of the mirror, width x height, cm. [default: as session.toml says, else 40x60]"),
    ] = None,
    mirror_at: Annotated[
        str | None,
        typer.Option(
            help="Its centre X,Y,Z in the root's frame, m. [default: as session.toml says, else the plan chooses]"
        ),
    ] = None,
    fixed: Annotated[
        bool, typer.Option("--fixed", help="The mirror hangs on a wall and is not turned: one view.")
    ] = False,
    same_postures: Annotated[
        bool,
        typer.Option(
            "--same-postures", help="Each posture in every view, so that `measure` can triangulate."
        ),
    ] = False,
    table: Annotated[
        float | None,
        typer.Option(
            help="Height of table or floor in the root's frame, m. By default the robot's lowest point."
        ),
    ] = None,
    clearance_mm: Annotated[
        float | None,
        typer.Option(help="Of the robot from itself and the table; three times that from the glass."),
    ] = None,
    home: Annotated[
        list[str] | None,
        typer.Option(
            help="JOINT=DEGREES (a joint that slides: JOINT=12mm): one that is not at 0 at home. Repeat it."
        ),
    ] = None,
    hold: Annotated[list[str] | None, typer.Option(help="A joint that stays at home. Repeat it.")] = None,
    real_balls: Annotated[
        bool, typer.Option("--real-balls", help="A ball may be seen directly, beside the mirror.")
    ] = False,
    noise_px: Annotated[
        float | None,
        typer.Option(help="Of a corner or a ball's centre; by default as session.toml says, else 0.15."),
    ] = None,
    package: Annotated[
        list[str] | None, typer.Option(help="NAME=FOLDER of a ROS package whose meshes the URDF names.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Of the postures that are drawn.", min=0)] = 0,
    judge: Annotated[
        bool,
        typer.Option(
            "--judge",
            help="Plan nothing: judge the plan that is there, after its rows, a mount or a tolerance were changed.",
        ),
    ] = False,
    overwrite: Annotated[
        bool,
        typer.Option(
            "--overwrite", help="Replace a plan of which some pictures are taken; they fit no plan then."
        ),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Plan postures and views for this robot, mirror and room, and predict what they will show, before any
    picture is taken.

    Every posture is within the joints' limits, clear of the robot itself, the table and the glass, also on
    the path from the previous one. Board and balls are visible in the mirror's frame. No real ball is in
    the picture beside its reflection. Every joint arrives from both sides, under loads of both signs.
    Collisions need `pip install "mirror-posture[mujoco]"`.

    Writes postures.csv (for `capture`), views.csv (the mirror's places), plan.json and plan.png. Look at
    the picture.

    You may edit postures.csv: `--judge` says for each row why it cannot be taken, and what the rows show
    now.

    Example: `mirror-posture plan my-session --mirror-size 40x60`

    Next: `mirror-posture capture my-session`, or `mirror-posture render rehearsal --template my-session
    --meshes --plan my-session/plan`
    """
    output = Output(as_json)
    from ...new_session import parse_vector
    from ...plan import PlanOptions, judge_plan, make_plan, write_plan
    from ...plan.table import POSTURES, document
    from ...robots import Nominal

    folder = out or session / "plan"
    if judge:
        plan, wrong = judge_plan(session, folder)
        say_plan(output, plan)
        output.result({"plan": folder, "cannot be taken": wrong, **document(plan)})
        if wrong:
            raise MirrorPostureError(
                f"{folder / POSTURES}: {len(wrong)} of {len(plan.view)} rows cannot be taken: {'; '.join(wrong)}"
            )
        output.say(f"every row of {folder / POSTURES} can be taken")
        return
    if not overwrite:
        _refuse_half_taken(session, folder)
    width, height = wanted_size(mirror_size)
    options = PlanOptions(
        mirror_width_m=width,
        mirror_height_m=height,
        mirror_at_m=None if mirror_at is None else parse_vector(mirror_at, "--mirror-at"),
        mirror_fixed=fixed,
        views=1 if fixed else views,
        postures=postures,
        same_postures=same_postures,
        table_m=table,
        clearance_m=None if clearance_mm is None else clearance_mm / 1000.0,
        home=joint_values(home or [], "--home", Nominal.load(session).robot),
        held=tuple(hold or ()),
        real_balls_allowed=real_balls,
        packages=package_folders(package or ()),
        noise_px=noise_px,
        seed=seed,
    )
    plan = make_plan(session, options, say=output.say)
    write_plan(plan, folder)
    say_plan(output, plan)
    output.say(f"written: {folder}/postures.csv, views.csv, plan.json; look at {folder}/plan.png")
    output.say(f"next: mirror-posture capture {session}" + (f" --plan {out}" if out is not None else ""))
    output.result({"plan": folder, **document(plan)})


def _refuse_half_taken(session: Path, folder: Path) -> None:
    """Raises `MirrorPostureError` where some pictures of the plan in the folder are taken, and not all."""
    from ...capture import Recorder
    from ...plan import read_plan
    from ...plan.table import POSTURES
    from ...robots import Nominal

    if not (folder / POSTURES).is_file():
        return
    try:
        frames = read_plan(folder / POSTURES, Nominal.load(session).robot)
        taken = len(Recorder(session, frames).taken) if frames else 0
    except MirrorPostureError:
        # A plan that cannot be read, or pictures of another one: nothing belongs to this plan.
        return
    if 0 < taken < len(frames):
        raise MirrorPostureError(
            f"{folder}: {taken} of {len(frames)} pictures of this plan are taken; `mirror-posture capture {session}` takes the others; for "
            "another plan give --out, or --overwrite to replace it"
        )


def say_plan(output: Output, plan: Plan) -> None:
    """The predicted detection limits of a plan, and the places of its mirrors."""
    from ...plan.picture import SHOWN, table_rows
    from ...plan.sizes import apart_in_words

    for text in plan.warnings:
        output.warn(text)
    output.table(
        "What this plan can tell: found surely from this size on (* has a twin)",
        ["*joint", *SHOWN.values()],
        table_rows(plan),
        f"with {plan.setting.noise_px:g} px of noise and the set-up's tolerances, one cause at a time",
    )
    # Each pair once, though each of the two has the other as its twin.
    pairs: dict[frozenset[str], tuple[Tells, Rival]] = {}
    for one in plan.tells:
        for twin in one.twins:
            pairs.setdefault(frozenset((one.name, twin.name)), (one, twin))
    twins = list(pairs.values())
    for one, twin in twins[:MOST_TWINS]:
        output.say(f"twins: {one.name} and {twin.name} are told apart {apart_in_words(plan, one, twin)}")
    if len(twins) > MOST_TWINS:
        output.say(f"and {counted(len(twins) - MOST_TWINS, 'more twin')}, in plan.json")
    if plan.setting.carrying_all:
        output.say(
            f"cannot be seen, since they carry camera, board and balls alike: {', '.join(plan.setting.carrying_all)}"
        )
    unseen = [one.name for one in plan.tells if not one.seen]
    if unseen:
        output.say(f"not to be seen: {', '.join(unseen)}")
    turned = ", ".join(
        f"{round(math.degrees(m.yaw_rad)):+d}°/{round(math.degrees(m.pitch_rad)):+d}°" for m in plan.mirrors
    )
    output.say(
        f"{counted(len(plan.view), 'picture')}; the mirror {100 * plan.distance_m:.0f} cm before the board, turned/leaning by {turned}"
    )
    if plan.ignored_pairs:
        output.say(f"not checked, since they touch at home or always: {'; '.join(plan.ignored_pairs)}")
