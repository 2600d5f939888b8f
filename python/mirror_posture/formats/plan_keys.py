"""plan.json: every key. `plan` writes it, `correct --plan` reads it, and people may edit it in between."""

from __future__ import annotations

from .collections import Named, Texts
from .keys import Flag, Number, Numbers, Section, Text, Whole

FORMAT, VERSION = "mirror-posture/plan", 1
MOST_VIEWS, MOST_POSTURES = 15, 1000


def _above_0(name: str, what: str, unit: str, null: bool = False) -> Number:
    return Number(name=name, what=what, unit=unit, above=0.0, null=null)


def _angle(name: str, what: str) -> Number:
    return Number(name=name, what=what, unit="rad")


def _vector(name: str, what: str, unit: str = "", null: bool = False) -> Numbers:
    return Numbers(name=name, what=what, unit=unit, count=3, null=null)


def _count(name: str, what: str) -> Whole:
    return Whole(name=name, what=what, at_least=0)


VIEW = Section(
    name="views",
    what="An orientation and place of the mirror; the column `view` of views.csv counts them from 0.",
    keys=(
        _angle("yaw_rad", "Turned about the vertical."),
        _angle("pitch_rad", "Leaning."),
        _vector("center_in_root_m", "The glass's centre, in the root's frame.", "m"),
        _vector("normal_in_root", "Its unit normal, away from the robot."),
        _vector("up_in_root", "Along its height, square to the normal."),
    ),
    repeated=True,
    closed=True,
)
MIRROR = Section(
    name="mirror",
    what="The mirror that was planned for.",
    keys=(
        _above_0("width_m", "Of the glass.", "m"),
        _above_0("height_m", "Of the glass.", "m"),
        _above_0("distance_from_board_m", "Straight before the board.", "m"),
    ),
    sections=(VIEW,),
    closed=True,
    given=("views",),
)
TWIN = Section(
    name="twins",
    what="Another cause that these pictures show alike.",
    keys=(
        Text(name="cause", what="`effect@place`."),
        Number(
            name="apart_from",
            what="The size, in the effect's unit, from which both can be separated; null: at no size.",
            at_least=0.0,
            null=True,
        ),
    ),
    repeated=True,
    closed=True,
)
TELLS = Section(
    name="tells",
    what="The predicted detection limits of one cause.",
    keys=(
        Text(name="effect", what="As a diagnosis names it."),
        Text(name="at", what="Its place, `joint:NAME` for instance."),
        Named(
            name="parameters",
            what="By name, the size from which it is found surely; null: at no size.",
            each=Number(name="", what="", at_least=0.0, null=True),
        ),
    ),
    sections=(TWIN,),
    repeated=True,
    closed=True,
    given=("twins",),
)
OPTIONS = Section(
    name="options",
    what="The options of the plan: postures are checked with them again when the plan is read. null: as in session.toml, or otherwise as `plan` chooses.",
    keys=(
        _above_0("mirror_width_m", "Of the glass.", "m", null=True),
        _above_0("mirror_height_m", "Of the glass.", "m", null=True),
        _vector("mirror_at_m", "The given place of its centre, in the root's frame.", "m", null=True),
        Flag(name="mirror_fixed", what="Whether it hangs, and is not turned."),
        Whole(name="views", what="How many ways it is turned.", at_least=1, at_most=MOST_VIEWS),
        Whole(name="postures", what="How many were asked for.", at_least=2, at_most=MOST_POSTURES),
        Flag(name="same_postures", what="Whether each view has the same postures."),
        Number(name="table_m", what="Height of the table or floor.", unit="m", null=True),
        _above_0("clearance_m", "Between the robot and itself or the table.", "m", null=True),
        Named(
            name="home",
            what="Joints at other positions than 0, rad (m).",
            each=Number(name="", what=""),
        ),
        Texts(name="held", what="Joints that stay at home."),
        Flag(name="real_balls_allowed", what="Whether a ball may be seen directly, beside its reflection."),
        Named(
            name="packages",
            what="Folders of the ROS packages whose meshes the URDF names.",
            each=Text(name="", what="", needs="a folder (text)"),
        ),
        _above_0("noise_px", "Of a corner or a ball's centre, one axis.", "px", null=True),
        _count("seed", "Of the random postures."),
    ),
    closed=True,
)
TOP = Section(
    name="",
    what="A plan, as `mirror-posture plan` writes it.",
    keys=(
        Text(name="format", what="What the file is.", one_of=(FORMAT,)),
        Whole(name="version", what="Of the format.", one_of=(VERSION,)),
        _count("frames", "Pictures that are planned."),
        Texts(name="joints", what="Those that move, in the order of postures.csv's columns."),
        _above_0("noise_px", "That it was planned with.", "px"),
        _count("frames_asked", "Pictures that were asked for."),
        Named(
            name="markers",
            what="In how many pictures each ball is seen.",
            each=Whole(name="", what="", at_least=0),
        ),
        _count("drawn", "Random postures that were tried."),
        Named(
            name="not_taken",
            what="By reason, how many of them cannot be taken.",
            each=Whole(name="", what="", at_least=0),
        ),
        Texts(name="not_checked", what="Pairs of links that are not compared, since they overlap at home."),
        Texts(name="warnings", what="What `plan` warned of."),
    ),
    sections=(MIRROR, TELLS, OPTIONS),
    closed=True,
    given=("mirror", "tells", "options"),
)
NOT_IN_A_SCHEMA = (
    "a joint of `home` or `held` that the robot lacks",
    "7.0 where a whole number is needed",
    "postures.csv and views.csv that do not fit each other or the robot",
)
"""What the reader refuses beyond the schema."""
