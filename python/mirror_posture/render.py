"""Sessions with rendered pictures and their truth: for tests, demonstrations and teaching."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from ._core import MirrorPostureError
from .arguments import checked_arguments
from .mirror import Mirror
from .painter import Drawn as Drawn
from .painter import MirrorPlane as MirrorPlane
from .painter import Painter as Painter
from .painter import PictureOptions as PictureOptions
from .painter import Positions
from .painter import view_planes as view_planes
from .picture_files import encoded_picture
from .robots.nominal import EMBEDDED_FOLDER as EMBEDDED_FOLDER
from .session.types import Frames
from .session.write import replace_folder, write_session_files
from .viewpoint import View as View

TRUTH_FILE = "truth.json"
TRUTH_CONVENTIONS = (
    "n points away from the camera: the mirror's front face is n.x = d_front_m, its silver n.x = d_silver_m, in the optical frame, m; "
    "pixels are those of the refracted way through glass and silver, (0, 0) the centre of the top-left pixel; corners in the order "
    "index = iy * nx + ix; px is the ray through a ball's centre, outline_centroid_px the centre of area of its whole picture, "
    "visible_centroid_px of what is not hidden; joints are actual positions, commands are in frames.csv"
)

SECONDS_A_FRAME = 2.0
"""Time between pictures in frames.csv."""


DEMO_JOINTS = (
    "r_shoulder_pitch",
    "r_shoulder_roll",
    "r_elbow",
    "l_shoulder_pitch",
    "l_shoulder_roll",
    "l_elbow",
)
DEMO_POSTURES: tuple[Positions, ...] = tuple(
    dict(zip(DEMO_JOINTS, map(math.radians, degrees), strict=True))
    for degrees in (
        # The posture of the paper's correction experiment, and five around it that move each joint of both arms.
        (-15, 85, 15, -10, 20, 30),
        (-25, 55, 40, -20, 45, 15),
        (-5, 25, 10, -35, 30, 50),
        (-40, 40, 25, -5, 55, 35),
        (10, 65, 60, -25, 15, 70),
        (-30, 20, 75, -15, 65, 5),
    )
)
DEMO_VIEWS = (
    View(),
    View(yaw_rad=math.radians(15.0)),
    View(yaw_rad=math.radians(-6.0), pitch_rad=math.radians(9.0)),
)
DEMO_OFFSETS_RAD: Positions = {"r_shoulder_roll": math.radians(2.5), "l_elbow": math.radians(-2.0)}
"""The hidden errors of the demonstration: actual joint position minus command."""


@checked_arguments
def render_session(
    folder: str | os.PathLike[str],
    postures: Sequence[Positions] = DEMO_POSTURES,
    views: Sequence[View] = DEMO_VIEWS,
    *,
    offsets_rad: Positions | None = None,
    options: PictureOptions | None = None,
    template: str | os.PathLike[str] = EMBEDDED_FOLDER,
    seed: int = 0,
    overwrite: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Renders each posture in each view and writes a session with pictures, and truth.json beside them.

    `postures` are COMMANDED joint positions (rad); frames run posture by posture through the `views`.
    `offsets_rad` are errors that the model does not contain: actual = commanded + offset. For other errors see
    `Painter`. `progress(done, total)` is called after each picture. The folder is written whole or not at
    all; its path is returned.

    Raises `MirrorPostureError` for unknown joints, no postures or views, or an existing folder.
    """
    if not postures or not views:
        raise MirrorPostureError(
            f"got {len(postures)} postures and {len(views)} views, needed at least one of each"
        )
    folder = Path(folder)
    options = options or PictureOptions()
    painter = Painter.load(template)
    offsets = dict(offsets_rad or {})
    painter.link_poses(offsets)  # refuses unknown joints before anything is drawn
    planes = view_planes(views, painter.board_in_root_m)
    names = tuple(sorted({name for posture in postures for name in posture}))
    total = len(postures) * len(views)
    posture_of = np.repeat(np.arange(len(postures)), len(views))
    commands = np.array([[float(p.get(name, 0.0)) for name in names] for p in postures])
    frames = Frames(
        frame=np.arange(total),
        posture=posture_of,
        joint_names=names,
        commanded=commands.reshape(len(postures), len(names))[posture_of],
        time_s=np.arange(total, dtype=np.float64) * SECONDS_A_FRAME,
        image=tuple(_image_name(index) for index in range(total)),
    )

    def fill(target: Path) -> None:
        (target / "images").mkdir()
        told = []
        for index in range(total):
            posture, view = divmod(index, len(views))
            commanded = dict(zip(names, commands[posture].tolist(), strict=True))
            joints = {n: commanded.get(n, 0.0) + offsets.get(n, 0.0) for n in {*names, *offsets}}
            drawn = painter.draw(painter.link_poses(joints), planes[view], options, seed + index)
            image = _image_name(index)
            _write_png(target / image, drawn.picture)
            told.append(
                {
                    "frame": index,
                    "posture": posture,
                    "view": asdict(views[view]),
                    "image": image,
                    "joints_rad": dict(sorted(joints.items())),
                }
                | drawn.truth
            )
            if progress is not None:
                progress(index + 1, total)
        truth = {
            "conventions": TRUTH_CONVENTIONS,
            "offsets_rad": offsets,
            "options": asdict(options),
            "seed": seed,
            "frames": told,
        }
        (target / TRUTH_FILE).write_text(json.dumps(truth, indent=1, allow_nan=False), encoding="utf-8")
        session = replace(
            painter.nominal.with_frames(frames),
            folder=target,
            mirror=Mirror(options.glass_thickness_m, options.refractive_index),
        )
        write_session_files(session, target)

    replace_folder(folder, fill, overwrite, painter.nominal.folder)
    return folder


def _image_name(index: int) -> str:
    return f"images/{index:03d}.png"


def _write_png(file: Path, picture: npt.NDArray[np.uint8]) -> None:
    file.write_bytes(encoded_picture(cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), file))
