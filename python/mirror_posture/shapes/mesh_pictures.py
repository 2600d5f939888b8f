"""Renders any robot with its meshes in front of a mirror of finite size, by MuJoCo: a quick preview, or the
pictures of a session.

MuJoCo's mirror is a front-surface one without glass. For pictures with glass, ghosts and blur see
`mirror_posture.render`.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
import numpy.typing as npt

from .._core import MirrorPostureError
from ..arrays import Floats
from ..mirror import IDEAL_MIRROR
from ..picture_files import encoded_picture
from ..robots.nominal import Nominal
from ..session.types import Frames
from ..session.write import replace_folder, write_session_files
from .body import flat_spec, place
from .mujoco_picture import EDGE_SAMPLES, FINER, MirrorRenderer, dress
from .of_links import COARSE_FOLDER, shapes_of_links

GREYS = (0.72, 0.62, 0.5)
"""Colours of successive links, so that neighbours can be distinguished."""


@dataclass(frozen=True, eq=False)
class MeshFrame:
    """A picture to be rendered: the command, rad (m), and the mirror in front of the robot, in the root's
    frame."""

    posture: int
    commanded: Mapping[str, float]
    center_in_root_m: Floats
    normal_in_root: Floats


class MeshPainter:
    """Draws one robot: made once, used for any posture and mirror. `preview` draws a picture in a fraction of the time, with rough edges.

    Raises `MirrorPostureError` without MuJoCo, an OpenGL, a camera, a chessboard or balls to draw.
    """

    def __init__(
        self,
        nominal: Nominal,
        mirror_size_m: tuple[float, float],
        preview: bool = False,
    ) -> None:
        if any(marker.diameter_m <= 0.0 for marker in nominal.metadata.markers):
            raise MirrorPostureError(f"{nominal.folder}: a marker of diameter 0 cannot be drawn")
        shapes, self.missing = shapes_of_links(nominal.robot_file, kind="visual")
        self._nominal, self._links = nominal, list(nominal.robot.link_names)
        spec = flat_spec(shapes, self._links)
        for number, geom in enumerate(spec.geoms):
            geom.contype = geom.conaffinity = 0
            geom.rgba = [*[GREYS[number % len(GREYS)]] * 3, 1.0]
        finer, samples = (1, 0) if preview else (FINER, EDGE_SAMPLES)
        dress(spec, nominal, (0.5 * mirror_size_m[0], 0.5 * mirror_size_m[1]), finer, samples)
        try:
            self._model = spec.compile()
        except ValueError as error:
            raise MirrorPostureError(
                f"{nominal.robot_file}: MuJoCo refuses its shapes: {' '.join(str(error).split())}"
            ) from None
        self._data = mujoco.MjData(self._model)
        self._renderer = MirrorRenderer(self._model, nominal, finer)

    def draw(
        self, positions: Mapping[str, float], center_in_root_m: Floats, normal_in_root: Floats
    ) -> npt.NDArray[np.uint8]:
        """The camera's picture, BGR, with the joints there (rad, m; others at 0) and the mirror's centre there."""
        robot = self._nominal.robot
        q = robot.positions({name: [value] for name, value in positions.items()})
        q = np.zeros((1, len(robot.position_names))) if not len(q) else q
        poses = robot.link_poses(q, self._links)[0]
        root = np.linalg.inv(poses[self._links.index(self._nominal.metadata.root)])
        return self.draw_links(
            dict(zip(self._links, root @ poses, strict=True)), center_in_root_m, normal_in_root
        )

    def draw_links(
        self,
        root_from_link: Mapping[str, Floats],
        center_in_root_m: npt.ArrayLike,
        normal_in_root: npt.ArrayLike,
    ) -> npt.NDArray[np.uint8]:
        """The same with given link poses (4, 4): from a simulator, or a body with errors."""
        poses = np.array([root_from_link[name] for name in self._links])
        place(self._model, self._data, self._links, poses)
        return self._renderer.picture(
            self._data, np.asarray(center_in_root_m, dtype=float), np.asarray(normal_in_root, dtype=float)
        )

    def close(self) -> None:
        """Frees the OpenGL context."""
        self._renderer.close()


def render_meshes_session(
    folder: Path,
    nominal: Nominal,
    frames: Sequence[MeshFrame],
    mirror_size_m: tuple[float, float],
    *,
    offsets_rad: Mapping[str, float] | None = None,
    overwrite: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> list[str]:
    """Writes a session with a picture of each frame; `offsets_rad` are not in its model. Returns the meshes
    that were not found.

    The session says that its mirror has no glass, as MuJoCo renders it; truth.json contains the joints.
    Whole or not at all.
    """
    offsets = dict(offsets_rad or {})
    for name in [*offsets, *(name for frame in frames for name in frame.commanded)]:
        nominal.robot.position_index(name)
    names = tuple(sorted({name for frame in frames for name in frame.commanded}))
    images = tuple(f"images/{number:04d}.png" for number in range(len(frames)))
    commanded = [[frame.commanded.get(name, 0.0) for name in names] for frame in frames]
    session = nominal.with_frames(
        Frames(
            frame=np.arange(len(frames)),
            posture=np.array([frame.posture for frame in frames]),
            joint_names=names,
            commanded=np.array(commanded).reshape(len(frames), len(names)),
            image=images,
        )
    )
    session = replace(session, mirror=replace(session.mirror or IDEAL_MIRROR, glass_thickness_m=0.0))
    painter = MeshPainter(nominal, mirror_size_m)

    def fill(part: Path) -> None:
        if (nominal.folder / COARSE_FOLDER).is_dir():
            shutil.copytree(nominal.folder / COARSE_FOLDER, part / COARSE_FOLDER)
        (part / "images").mkdir()
        told = []
        for number, frame in enumerate(frames):
            actual = {
                name: frame.commanded.get(name, 0.0) + offsets.get(name, 0.0) for name in {*names, *offsets}
            }
            picture = painter.draw(actual, frame.center_in_root_m, frame.normal_in_root)
            (part / images[number]).write_bytes(encoded_picture(picture, images[number]))
            told.append({"frame": number, "joints_rad": dict(sorted(actual.items()))})
            if progress is not None:
                progress(number + 1, len(frames))
        (part / "truth.json").write_text(
            json.dumps({"offsets_rad": offsets, "frames": told}, indent=1), encoding="utf-8"
        )
        write_session_files(replace(session, folder=part), part)

    try:
        replace_folder(folder, fill, overwrite, nominal.folder)
    finally:
        painter.close()
    return painter.missing
