"""Pictures of a robot before a mirror, with their truth: sessions for tests, demonstrations and teaching.

The pictures are traced ray by ray by the core, glass and all; nothing here or there projects a point, so that
what measures in the pictures is tested by something that shares no formula with it.
"""

from __future__ import annotations

import colorsys
import json
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ._core import MirrorPostureError, PictureMaker
from .arguments import checked_arguments
from .camera import Camera
from .input_files import LARGEST_MODEL, given_text
from .mirror import FLOAT_GLASS_INDEX, Mirror
from .robot import Robot
from .session.camera_info import load_camera_info
from .session.metadata import Metadata, load_metadata
from .session.types import Frames, Session, Views
from .session.write import replace_folder, write_session_files
from .short_repr import ShortRepr
from .viewpoint import View as View

Floats = npt.NDArray[np.float64]
Positions = Mapping[str, float]
LinkPoses = Mapping[str, Floats]

EMBEDDED_FOLDER = Path(__file__).parent / "embedded"
"""The embedded robot: robot.urdf, camera.yaml, session.toml."""

TRUTH_FILE = "truth.json"
TRUTH_CONVENTIONS = (
    "n points away from the camera: the mirror's front face is n.x = d_front_m, its silver n.x = d_silver_m, in the optical frame, m; "
    "pixels are those of the refracted way through glass and silver, (0, 0) the centre of the top-left pixel; corners in the order "
    "index = iy * nx + ix; px is the ray through a ball's centre, outline_centroid_px the centre of area of its whole picture, "
    "visible_centroid_px of what is not hidden; joints are actual positions, commands are in frames.csv"
)

SECONDS_A_FRAME = 2.0
"""Time from picture to picture that frames.csv tells."""
BALL_SATURATION, BALL_VALUE = 0.94, 0.85
"""The balls' paint, as saturation and value of their marker's hue."""


@dataclass(frozen=True)
class MirrorPlane:
    """The front face of a mirror in the root's frame: centre (m) and unit normal from the robot to the mirror."""

    center_in_root_m: tuple[float, float, float]
    normal_in_root: tuple[float, float, float]


@dataclass(frozen=True)
class PictureOptions:
    """How the mirror is made, and how the camera takes its pictures."""

    glass_thickness_m: float = 0.003
    refractive_index: float = FLOAT_GLASS_INDEX
    curvature_per_m: float = 0.0
    """Positive is concave as the camera sees it."""
    mirror_width_m: float = 0.42
    mirror_height_m: float = 0.36
    ghosts: bool = True
    """Whether the front face's reflection and the second one off the silver are drawn."""
    samples: int = 2
    """Rays of a pixel are samples², and edge_samples² where there is an edge."""
    edge_samples: int = 4
    motion_px: tuple[float, float] = (0.0, 0.0)
    """How far the picture moves while the shutter is open."""
    blur_px: float = 0.55
    """Standard deviation of the Gaussian blur of lens and focus."""
    exposure: float = 1.0
    full_well_electrons: float | None = 9000.0
    """Electrons of a pixel at full white, whose square root is the noise; None for pictures without noise."""
    read_noise_electrons: float = 12.0
    gamma: float = 2.2
    jpeg_quality: int | None = None
    """1 to 100: pictures as after JPEG compression; None for none."""
    floor_m: float = -0.122
    """Height of the table in the root's frame."""


@dataclass(frozen=True, eq=False, repr=False)
class Drawn(ShortRepr):
    """A picture and its truth."""

    picture: npt.NDArray[np.uint8]
    """(H, W, 3), RGB."""
    truth: dict[str, Any]
    """Plain values: `mirror`, `camera_from_board`, `corners_px`, `corners_visible`, `markers`; see `TRUTH_CONVENTIONS`."""


def view_planes(views: Iterable[View], board_in_root_m: npt.ArrayLike) -> tuple[MirrorPlane, ...]:
    """The mirror of each view: its plane `n·x = n·board + distance`, centred before the board.

    `board_in_root_m` is the board's centre, (3,), m.
    """
    board = np.asarray(board_in_root_m, dtype=float)
    planes = []
    for view in views:
        if not (view.distance_m > 0.0 and math.isfinite(view.yaw_rad) and math.isfinite(view.pitch_rad)):
            raise MirrorPostureError(f"{view}: needed finite angles and a distance above 0 m")
        level = math.cos(view.pitch_rad)
        normal = np.array(
            [level * math.cos(view.yaw_rad), level * math.sin(view.yaw_rad), math.sin(view.pitch_rad)]
        )
        center = board + view.distance_m * normal
        planes.append(MirrorPlane(tuple(center.tolist()), tuple(normal.tolist())))
    return tuple(planes)


@dataclass(frozen=True)
class Painter:
    """Draws one robot with one camera: made once, used for any posture and mirror."""

    folder: Path
    """The folder of the template: session.toml, robot.urdf, camera.yaml."""
    metadata: Metadata
    camera: Camera
    maker: PictureMaker = field(repr=False)

    @classmethod
    def load(cls, folder: str | os.PathLike[str] = EMBEDDED_FOLDER) -> Painter:
        """Reads a template (or a session): the embedded robot by default.

        Raises `MirrorPostureError` for a template without a camera or with a board or marker that cannot be drawn.
        """
        folder = Path(folder)
        metadata = load_metadata(folder)
        if metadata.camera is None or metadata.camera_link is None:
            raise MirrorPostureError(
                f"{folder / 'session.toml'}: has no camera; pictures need `camera` and [camera_mount]"
            )
        camera = load_camera_info(folder / metadata.camera, metadata.camera)
        board = metadata.board
        if board is not None and board.pattern != "chessboard":
            raise MirrorPostureError(
                f"{folder / 'session.toml'}: [board] pattern {board.pattern!r} cannot be drawn, only 'chessboard'"
            )
        balls = []
        for marker in metadata.markers:
            if marker.diameter_m <= 0.0:
                raise MirrorPostureError(
                    f"{folder / 'session.toml'}: marker {marker.name!r} has diameter 0; only balls can be drawn"
                )
            hue = 0.0 if marker.color is None else marker.color.hue_deg / 360.0
            rgb = colorsys.hsv_to_rgb(hue, 0.0 if marker.color is None else BALL_SATURATION, BALL_VALUE)
            balls.append((marker.name, marker.link, marker.diameter_m, list(rgb)))
        maker = PictureMaker(
            given_text(folder / metadata.robot, "the robot's URDF", LARGEST_MODEL),
            size_px=camera.size_px,
            focal_px=camera.focal_px,
            center_px=camera.center_px,
            distortion=list(camera.distortion),
            camera_link=metadata.camera_link,
            board=None if board is None else (board.link, board.columns, board.rows, board.square_m),
            balls=balls,
        )
        return cls(folder, metadata, camera, maker)

    def link_poses(self, positions_rad: Positions) -> dict[str, Floats]:
        """`root_from_link` (4, 4) of each link at these ACTUAL joint positions; joints that are not named are at 0."""
        return self.maker.link_poses(dict(positions_rad))

    @property
    def board_in_root_m(self) -> Floats:
        """The board's centre, (3,), m, with all joints at 0; the camera's where there is no board."""
        board = self.metadata.board
        link = self.metadata.camera_link if board is None else board.link
        return self.link_poses({})[str(link)][:3, 3]

    def draw(
        self, link_poses: LinkPoses, plane: MirrorPlane, options: PictureOptions | None = None, seed: int = 0
    ) -> Drawn:
        """Draws the robot with its links at these poses (`root_from_link`, (4, 4)) before a mirror.

        The poses may come from anywhere, a simulator say: what bends or gives way there is seen in the picture.
        The same input gives the same picture.
        """
        o = options or PictureOptions()
        picture, truth = self.maker.draw(
            dict(link_poses),
            mirror_center_m=list(plane.center_in_root_m),
            mirror_normal=list(plane.normal_in_root),
            glass_thickness_m=o.glass_thickness_m,
            refractive_index=o.refractive_index,
            curvature_per_m=o.curvature_per_m,
            mirror_size_m=(o.mirror_width_m, o.mirror_height_m),
            ghosts=o.ghosts,
            floor_m=o.floor_m,
            grid=o.samples,
            edge_grid=o.edge_samples,
            motion_px=list(o.motion_px),
            blur_px=o.blur_px,
            exposure=o.exposure,
            full_well_electrons=o.full_well_electrons,
            read_noise_electrons=o.read_noise_electrons,
            gamma=o.gamma,
            jpeg_quality=o.jpeg_quality,
            seed=seed,
        )
        return Drawn(picture, truth)


def _degrees(**positions_deg: float) -> dict[str, float]:
    return {name: math.radians(value) for name, value in positions_deg.items()}


DEMO_POSTURES: tuple[Positions, ...] = (
    # The posture of the paper's correction experiment, and five around it that move each joint of both arms.
    _degrees(
        r_shoulder_pitch=-15,
        r_shoulder_roll=85,
        r_elbow=15,
        l_shoulder_pitch=-10,
        l_shoulder_roll=20,
        l_elbow=30,
    ),
    _degrees(
        r_shoulder_pitch=-25,
        r_shoulder_roll=55,
        r_elbow=40,
        l_shoulder_pitch=-20,
        l_shoulder_roll=45,
        l_elbow=15,
    ),
    _degrees(
        r_shoulder_pitch=-5,
        r_shoulder_roll=25,
        r_elbow=10,
        l_shoulder_pitch=-35,
        l_shoulder_roll=30,
        l_elbow=50,
    ),
    _degrees(
        r_shoulder_pitch=-40,
        r_shoulder_roll=40,
        r_elbow=25,
        l_shoulder_pitch=-5,
        l_shoulder_roll=55,
        l_elbow=35,
    ),
    _degrees(
        r_shoulder_pitch=10,
        r_shoulder_roll=65,
        r_elbow=60,
        l_shoulder_pitch=-25,
        l_shoulder_roll=15,
        l_elbow=70,
    ),
    _degrees(
        r_shoulder_pitch=-30,
        r_shoulder_roll=20,
        r_elbow=75,
        l_shoulder_pitch=-15,
        l_shoulder_roll=65,
        l_elbow=5,
    ),
)
DEMO_VIEWS = (
    View(),
    View(yaw_rad=math.radians(15.0)),
    View(yaw_rad=math.radians(-6.0), pitch_rad=math.radians(9.0)),
)
DEMO_OFFSETS_RAD: Positions = _degrees(r_shoulder_roll=2.5, l_elbow=-2.0)
"""What the demonstration hides: how far the actual joint stands from its command."""


@checked_arguments
def render_session(
    folder: str | os.PathLike[str],
    postures: Sequence[Positions] = DEMO_POSTURES,
    views: Sequence[View] = DEMO_VIEWS,
    *,
    offsets_rad: Positions | None = None,
    actual: Callable[[int, Positions], Positions] | None = None,
    link_poses: Callable[[int, Positions], LinkPoses] | None = None,
    options: PictureOptions | None = None,
    model_glass_thickness_m: float | None = None,
    template: str | os.PathLike[str] = EMBEDDED_FOLDER,
    seed: int = 0,
    overwrite: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Draws each posture in each view and writes a session with pictures, and truth.json beside them.

    `postures` are COMMANDED joint positions (rad), frames run posture by posture through the `views`. What is hidden
    from the model comes in one of three ways: `offsets_rad` (actual = commanded + offset), `actual(frame, commanded)`
    (actual positions), or `link_poses(frame, commanded)` (`root_from_link` (4, 4) of each link, from a simulator).
    `model_glass_thickness_m` is what session.toml claims of the mirror; by default the truth.
    `progress(done, total)` is called after each picture. The folder is written whole or not at all; it is returned.

    Raises `MirrorPostureError` for unknown joints, no postures or views, or a folder that is there already.
    """
    if not postures or not views:
        raise MirrorPostureError(
            f"got {len(postures)} postures and {len(views)} views, needed at least one of each"
        )
    if sum(way is not None for way in (offsets_rad, actual, link_poses)) > 1:
        raise MirrorPostureError("got more than one of offsets_rad, actual, link_poses; needed at most one")
    folder = Path(folder)
    options = options or PictureOptions()
    painter = Painter.load(template)
    offsets = dict(offsets_rad or {})
    painter.link_poses(offsets)  # refuses unknown joints before anything is drawn
    planes = view_planes(views, painter.board_in_root_m)
    names = tuple(sorted({name for posture in postures for name in posture}))
    total = len(postures) * len(views)

    def fill(target: Path) -> None:
        (target / "images").mkdir()
        told = []
        for index in range(total):
            posture, view = divmod(index, len(views))
            commanded = {name: float(postures[posture].get(name, 0.0)) for name in names}
            if actual is not None:
                joints: Positions | None = dict(actual(index, commanded))
            elif link_poses is not None:
                joints = None
            else:
                joints = {n: commanded.get(n, 0.0) + offsets.get(n, 0.0) for n in {*names, *offsets}}
            poses = link_poses(index, commanded) if link_poses else painter.link_poses(joints or {})
            drawn = painter.draw(poses, planes[view], options, seed + index)
            image = _image_name(index)
            _write_png(target / image, drawn.picture)
            frame = {"frame": index, "posture": posture, "view": asdict(views[view]), "image": image}
            if joints is not None:
                frame["joints_rad"] = dict(sorted(joints.items()))
            told.append(frame | drawn.truth)
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
        write_session_files(
            _session(painter, target, postures, len(views), names, options, model_glass_thickness_m), target
        )

    replace_folder(folder, fill, overwrite)
    return folder


def _image_name(index: int) -> str:
    return f"images/{index:03d}.png"


def _write_png(file: Path, picture: npt.NDArray[np.uint8]) -> None:
    good, data = cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
    if not good:
        raise MirrorPostureError(f"{file}: the picture could not be encoded as PNG")
    file.write_bytes(data.tobytes())


def _session(
    painter: Painter,
    target: Path,
    postures: Sequence[Positions],
    views: int,
    names: tuple[str, ...],
    options: PictureOptions,
    model_glass_thickness_m: float | None,
) -> Session:
    """The session that the pictures belong to, without detections."""
    count = len(postures) * views
    posture = np.repeat(np.arange(len(postures)), views)
    commanded = np.array([[float(p.get(name, 0.0)) for name in names] for p in postures])
    claimed = options.glass_thickness_m if model_glass_thickness_m is None else model_glass_thickness_m
    metadata = painter.metadata
    empty = Views.empty(count, 0, len(metadata.markers))
    frames = Frames(
        frame=np.arange(count),
        posture=posture,
        joint_names=names,
        commanded=commanded.reshape(len(postures), len(names))[posture],
        time_s=np.arange(count, dtype=np.float64) * SECONDS_A_FRAME,
        image=tuple(_image_name(i) for i in range(count)),
    )
    return Session(
        folder=target,
        robot_file=painter.folder / metadata.robot,
        robot=Robot.from_urdf(painter.folder / metadata.robot),
        root_link=metadata.root,
        gravity_m_per_s2=metadata.gravity_m_per_s2,
        frames=frames,
        markers=metadata.markers,
        mirror_view=empty,
        direct_view=replace(empty),
        camera=painter.camera,
        camera_link=metadata.camera_link,
        board=metadata.board,
        mirror=Mirror(claimed, options.refractive_index),
        noise=metadata.noise,
        detected=False,
    )
