"""session.toml: every key."""

from __future__ import annotations

import math

from ..board import CHESSBOARD, PATTERNS
from .keys import Flag, Number, Numbers, Section, Text, Whole, Wholes

FORMAT = "mirror-posture/session"
VERSION = 1
MOUNTS = ("known", "unknown")
MOST_MARKERS = 1000
MOST_CORNERS = 100
"""Largest number of corners of a side; larger ones are typing errors, which would use all memory."""
STANDARD_GRAVITY = 9.80665
GRAVITY_UNITS = {"m/s^2": 1.0, "cm/s^2": 1e-2, "mm/s^2": 1e-3, "g": STANDARD_GRAVITY}
LONGEST_SHUTTER_S = 0.5
LARGEST_SQUARE_M, LARGEST_MARKER_M, THICKEST_GLASS_M = 0.5, 0.5, 0.05
"""Beyond these a length is in mm."""
FLOAT_GLASS_INDEX = 1.52
"""Refractive index of the glass that mirrors are made of."""
LARGEST_INDEX = 3.0
"""Diamond has 2.4."""
SMALLEST_MIRROR_M, LARGEST_MIRROR_M = 0.02, 10.0
"""Width and height; beyond these they are in another unit."""
SMALLEST_PIXEL_STD, SMALLEST_POINT_STD_M = 1e-6, 1e-9
"""Below these rounding is larger: nothing would agree with anything."""
LARGEST_PIXEL_STD, LARGEST_POINT_STD_M, LARGEST_TOLERANCE_M = 20.0, 0.05, 0.5
"""Beyond these values the noise would hide any error of a robot: the unit is another."""

TOLERANCE_M = Number(
    name="tolerance_m",
    what="One standard deviation by which the real place may differ from the URDF's; 0: exact; left out: learned from the data.",
    unit="m",
    default=None,
    at_least=0.0,
    below=LARGEST_TOLERANCE_M,
)
TOLERANCE_RAD = Number(
    name="tolerance_rad",
    what="The same of its rotation.",
    unit="rad",
    default=None,
    at_least=0.0,
    below=math.pi,
)
CAMERA_MOUNT = Section(
    name="camera_mount",
    what="The camera's mount; needed with `camera`.",
    keys=(
        Text(
            name="link",
            what="URDF link whose frame is the camera's optical frame: z forward, x right, y down.",
        ),
        TOLERANCE_M,
        TOLERANCE_RAD,
    ),
)
BOARD = Section(
    name="board",
    what="The printed board that the camera sees in the mirror; needs `camera`.",
    keys=(
        Text(
            name="link",
            what="URDF link: origin at the board's centre, x and y in its plane, z out of the printed face.",
        ),
        Wholes(
            name="corners",
            what="Inner corners along x and y: points where four squares meet.",
            count=2,
            at_least=2,
            at_most=MOST_CORNERS,
        ),
        Number(name="square", what="Side of a square.", unit="m", above=0.0, below=LARGEST_SQUARE_M),
        Text(name="pattern", what="What is printed.", default=CHESSBOARD, one_of=PATTERNS),
        Number(
            name="marker_size",
            what="Of a ChArUco board: side of its ArUco markers, less than the square.",
            unit="m",
            default=None,
            above=0.0,
        ),
        Text(
            name="dictionary",
            what="Of a ChArUco board: OpenCV's name of the markers' dictionary, `DICT_4X4_50` say.",
            default=None,
        ),
        TOLERANCE_M,
        TOLERANCE_RAD,
    ),
    rules={
        "if": {"properties": {"pattern": {"const": "charuco"}}, "required": ["pattern"]},
        "then": {"required": ["marker_size", "dictionary"]},
    },
)
COLOR = Section(
    name="color",
    what="The colour by which a ball is found in pictures; without it the ball is not looked for.",
    keys=(
        Number(name="hue", what="Hue.", unit="degrees", at_least=0.0, below=360.0),
        Number(
            name="hue_tolerance",
            what="How far the hue may differ, on either side.",
            unit="degrees",
            above=0.0,
            below=180.0,
        ),
        Number(
            name="min_saturation",
            what="Least saturation, 0 to 1.",
            default=0.0,
            at_least=0.0,
            below=1.0,
        ),
        Number(
            name="min_value", what="Least brightness (value), 0 to 1.", default=0.0, at_least=0.0, below=1.0
        ),
    ),
)
MARKERS = Section(
    name="markers",
    what="A ball, or another point, on a link; its name is the `target` of detections.csv.",
    repeated=True,
    most=MOST_MARKERS,
    keys=(
        Text(name="name", what="Each its own; `board` is taken."),
        Text(name="link", what="URDF link whose origin is the marker's centre."),
        Number(
            name="diameter",
            what="Of the ball; 0 for an ideal point.",
            unit="m",
            default=0.0,
            at_least=0.0,
            below=LARGEST_MARKER_M,
        ),
        Text(
            name="mount",
            what="Whether its place on its link is known; `unknown`: estimated along with the rest.",
            default="known",
            one_of=MOUNTS,
        ),
        TOLERANCE_M,
    ),
    sections=(COLOR,),
    rules={"not": {"properties": {"name": {"const": "board"}}, "required": ["name"]}},
)
MIRROR = Section(
    name="mirror",
    what="What the model assumes of the mirror.",
    keys=(
        Number(
            name="glass_thickness",
            what="Of the glass before the silver; 0 is a front-surface mirror.",
            unit="m",
            default=0.0,
            at_least=0.0,
            below=THICKEST_GLASS_M,
        ),
        Number(
            name="refractive_index",
            what="Of the glass.",
            default=FLOAT_GLASS_INDEX,
            at_least=1.0,
            below=LARGEST_INDEX,
        ),
        Number(
            name="width",
            what="Of what reflects, for `plan` and `render --meshes`; no fit uses it.",
            unit="m",
            default=None,
            at_least=SMALLEST_MIRROR_M,
            below=LARGEST_MIRROR_M,
        ),
        Number(
            name="height",
            what="Likewise.",
            unit="m",
            default=None,
            at_least=SMALLEST_MIRROR_M,
            below=LARGEST_MIRROR_M,
        ),
        Numbers(
            name="center",
            what="The place of its centre in the root's frame, for `plan`; left out: the plan chooses. No fit uses it.",
            unit="m",
            count=3,
            default=None,
        ),
    ),
)
NOISE = Section(
    name="noise",
    what="What is known of the measurement's noise.",
    keys=(
        Number(
            name="pixel_std",
            what="Standard deviation, one axis, of a corner or a ball's centre.",
            unit="px",
            default=None,
            at_least=SMALLEST_PIXEL_STD,
            below=LARGEST_PIXEL_STD,
        ),
        Number(
            name="point_std",
            what="Standard deviation, one axis, of points.csv.",
            unit="m",
            default=None,
            at_least=SMALLEST_POINT_STD_M,
            below=LARGEST_POINT_STD_M,
        ),
    ),
)
POINTS = Section(
    name="points",
    what="Needed with points.csv.",
    keys=(
        Text(
            name="frame",
            what="Link in whose frame x, y, z are given, or `unknown`: a fixed frame whose pose is estimated.",
        ),
    ),
)
FRAMES = Section(
    name="frames",
    what="How the rows of frames.csv are to be read.",
    keys=(
        Flag(
            name="ordered",
            what="Whether the rows are in the order of execution; if not, no direction of motion is known.",
            default=True,
        ),
    ),
)
SHUTTER = Section(
    name="shutter",
    what="Of a camera that sees motion; `time_s` of a frame is when the exposure of its first row begins.",
    keys=(
        Number(
            name="exposure_s",
            what="How long a row is exposed.",
            unit="s",
            default=0.0,
            at_least=0.0,
            below=LONGEST_SHUTTER_S,
        ),
        Number(
            name="readout_s",
            what="From the first row to the last of a rolling shutter.",
            unit="s",
            default=0.0,
            at_least=0.0,
            below=LONGEST_SHUTTER_S,
        ),
    ),
)
GRAVITY = Section(
    name="gravity",
    what="Gravity in another unit, or of another place.",
    keys=(
        Numbers(name="vector", what="In the root link's frame.", count=3),
        Text(name="unit", what="Of the vector.", one_of=tuple(GRAVITY_UNITS)),
    ),
)
GRAVITY_VECTOR = Numbers(
    name="gravity",
    what="In the root link's frame, of a length of about 9.81; a section `[gravity]` can state another unit or place.",
    unit="m/s²",
    count=3,
)
TOP = Section(
    name="",
    what="The session's metadata.",
    keys=(
        Text(name="format", what="What the file is.", one_of=(FORMAT,)),
        Whole(name="version", what="Of the format.", one_of=(VERSION,)),
        Text(name="robot", what="The URDF's file name, inside the folder."),
        Text(name="root", what="URDF link in which gravity is constant and known."),
        Text(
            name="camera",
            what="The camera's file, inside the folder; left out where there are neither pictures nor image points.",
            default=None,
        ),
    ),
    sections=(CAMERA_MOUNT, BOARD, MARKERS, MIRROR, NOISE, POINTS, FRAMES, SHUTTER),
    rules={
        "dependentRequired": {"board": ["camera"], "camera": ["camera_mount"], "camera_mount": ["camera"]}
    },
)
NOT_IN_A_SCHEMA = (
    "two markers of one name",
    "a gravity vector whose length is not about 9.81 m/s² (in a section: above 300 m/s²)",
    "a ChArUco marker that is not smaller than its square",
    "not-a-number, and 7.0 where a whole number is needed",
    "whatever concerns other files: links, joints, paths, tables",
)
"""What the reader refuses beyond the schema."""
