"""The twin: the embedded robot (or any session's) with hidden effects, in front of a traced mirror or in
exact pixels.

With pictures a look is rendered and detected, as on a real robot; without, it takes milliseconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from mirror_posture._core import MirrorPostureError
from mirror_posture.mirror import FLOAT_GLASS_INDEX
from mirror_posture.robots.base import RobotBase
from mirror_posture.robots.nominal import Nominal
from mirror_posture.robots.protocol import Look, Positions
from mirror_posture.viewpoint import View

from .hidden import HiddenBody, HiddenEffect
from .pixels import MirrorInRoot, exact_points, lens_of
from .stand import SimulatedStand

if TYPE_CHECKING:
    from mirror_posture.render import MirrorPlane, PictureOptions
    from mirror_posture.shapes.mesh_pictures import MeshPainter

MIRROR_MARGIN_M = 0.06
"""Between what has to be seen and the mirror's edge: half a ball, the board's rim."""
USUAL_DISTANCE_M = 0.3
"""Up to this distance the mirror has the default size of pictures."""
WALL_M = 2.0
"""Of the mirror before a twin with meshes, either way: as large as needed."""
SECONDS_A_COMMAND = 1.0
SECONDS_A_LOOK = 0.5
"""The twin's time, on which a drift depends: duration of a servo's motion and of a picture."""


@dataclass(frozen=True)
class TwinOptions:
    """How a twin takes its looks."""

    pictures: bool = True
    """False: exact pixels with noise, no rendering and no detection."""
    meshes: bool = False
    """True: pictures by MuJoCo's renderer, with the robot's meshes and a mirror without glass or noise; False: traced ray by ray, glass and all, with
    its primitive shapes only."""
    noise_px: float = 0.1
    """Of exact pixels: standard deviation, one axis."""
    view: View = field(default_factory=View)
    """The first view."""
    stand_error_rad: float = 0.0
    """Error of a stand that is turned by hand (standard deviation of yaw and of pitch)."""
    glass_thickness_m: float | None = None
    """Of the real mirror; None: as the nominal session has it."""
    curvature_per_m: float = 0.0
    """Of the real mirror; positive is concave."""
    camera: PictureOptions | None = None
    """How pictures are taken (blur, noise, samples); None: as by default. The mirror's make is told above."""
    seed: int = 0


class TwinRobot(SimulatedStand, RobotBase):
    """A robot of a nominal session with hidden effects, that can turn before its mirror (`TurnsView`).

    Its session's root link must be the URDF's root when it takes pictures: the tracer draws from there.
    """

    def __init__(
        self,
        hidden: Sequence[HiddenEffect] = (),
        options: TwinOptions | None = None,
        nominal: Nominal | None = None,
        *,
        name: str = "twin",
    ) -> None:
        nominal = nominal or Nominal.load()
        metadata = nominal.metadata
        body = HiddenBody(
            nominal.robot_file.read_text(encoding="utf-8"), metadata.root, metadata.gravity_m_per_s2, hidden
        )
        # Joints above the root (the legs of a torso) do not move the links below it.
        limits = {joint: limit for joint, limit in nominal.joint_limits.items() if joint in body.theta}
        super().__init__(nominal, name=name, limits=limits)
        self.options, self.body = options or TwinOptions(), body
        if metadata.board is None:
            raise MirrorPostureError(
                f"{nominal.folder}: has no [board]; a twin looks into a mirror, which needs one"
            )
        self._lens = lens_of(nominal)
        self._random = np.random.default_rng(self.options.seed)
        self._board_in_root = self.body.link_poses()[metadata.board.link][:3, 3].copy()
        self._time_s = 0.0
        self._looks = 0
        self._painter = self._meshes = None
        if self.options.pictures:
            if metadata.root != nominal.robot.link_names[0]:
                raise MirrorPostureError(
                    f"{nominal.folder}: a twin with pictures needs root = {nominal.robot.link_names[0]!r} (the URDF's root), "
                    f"got {metadata.root!r}; use pictures=False"
                )
            if self.options.meshes:
                self._meshes = self._mesh_painter(nominal)
            else:
                from mirror_posture.render import Painter

                self._painter = Painter.load(nominal.folder)
        self._stand(self.options.view, self.options.stand_error_rad, self._random)
        self.body.move(self.commanded)

    def _mesh_painter(self, nominal: Nominal) -> MeshPainter:
        claimed, glass = nominal.metadata.mirror, self.options.glass_thickness_m
        if (glass or 0.0) > 0.0 or (claimed is not None and claimed.glass_thickness_m > 0.0):
            raise MirrorPostureError(
                f"{nominal.folder}: a twin with meshes looks into a mirror without glass; needed glass_thickness = 0 in [mirror], or "
                "meshes=False"
            )
        from mirror_posture.shapes.mesh_pictures import MeshPainter

        return MeshPainter(nominal, (WALL_M, WALL_M))

    def marker_truth_m(self) -> dict[str, np.ndarray]:
        """The true places of the balls in the root's frame, m: for tests and figures; a robot does not know them."""
        poses = self.body.link_poses()
        return {marker.name: poses[marker.link][:3, 3].copy() for marker in self.nominal.metadata.markers}

    def _move(self, positions: dict[str, float]) -> Positions:
        self._time_s += SECONDS_A_COMMAND
        self.body.move(positions, self._time_s)
        return {}

    def _look(self) -> Look:
        self._time_s += SECONDS_A_LOOK
        self._looks += 1
        poses = self.body.link_poses()
        metadata, options = self.nominal.metadata, self.options
        claimed = metadata.mirror
        glass = options.glass_thickness_m
        if glass is None:
            glass = 0.0 if claimed is None else claimed.glass_thickness_m
        index = FLOAT_GLASS_INDEX if claimed is None else claimed.refractive_index
        if self._meshes is not None:
            from mirror_posture.render import view_planes

            plane = view_planes([self._real_view], self._board_in_root)[0]
            picture_bgr = self._meshes.draw_links(poses, plane.center_in_root_m, plane.normal_in_root)
            return Look(self.commanded, self._time_s, view=self._view, picture_bgr=picture_bgr)
        if self._painter is not None:
            from mirror_posture.render import PictureOptions, view_planes

            plane = view_planes([self._real_view], self._board_in_root)[0]
            picture = options.camera or PictureOptions()
            width_m, height_m = self._mirror_size_m(poses, plane)
            drawn = self._painter.draw(
                poses,
                plane,
                replace(
                    picture,
                    mirror_width_m=max(picture.mirror_width_m, width_m),
                    mirror_height_m=max(picture.mirror_height_m, height_m),
                    glass_thickness_m=glass,
                    refractive_index=index,
                    curvature_per_m=options.curvature_per_m,
                ),
                seed=options.seed * 100_003 + self._looks,
            )
            picture_bgr = np.ascontiguousarray(drawn.picture[..., ::-1])
            return Look(self.commanded, self._time_s, view=self._view, picture_bgr=picture_bgr)
        normal = self._real_view.normal_in_root
        distance = float(normal @ self._board_in_root) + self._real_view.distance_m
        mirror = MirrorInRoot(normal, distance, glass, index, options.curvature_per_m)
        points = exact_points(self.nominal, self._lens, poses, mirror, options.noise_px, self._random)
        return Look(self.commanded, self._time_s, view=self._view, points=points)

    def _mirror_size_m(self, poses: dict[str, np.ndarray], plane: MirrorPlane) -> tuple[float, float]:
        """Width and height of a mirror that shows board and balls: the points at which the light meets its plane, and a margin."""
        metadata = self.nominal.metadata
        assert metadata.board is not None and metadata.camera_link is not None
        if self._real_view.distance_m <= USUAL_DISTANCE_M:
            return 0.0, 0.0
        normal, centre = np.asarray(plane.normal_in_root), np.asarray(plane.center_in_root_m)
        eye = poses[metadata.camera_link][:3, 3]
        board = poses[metadata.board.link]
        corners = metadata.board.corner_in_board_m @ board[:3, :3].T + board[:3, 3]
        balls = [poses[marker.link][:3, 3] for marker in metadata.markers]
        points = np.vstack([corners, *balls])
        near, far = normal @ (centre - eye), np.maximum((centre - points) @ normal, 0.0)
        share = (near / (near + far))[:, None]
        met = eye + share * (points - eye) - centre
        level = np.cross([0.0, 0.0, 1.0], normal)
        level /= np.linalg.norm(level)
        width, height = (
            2.0 * (float(np.abs(met @ axis).max()) + MIRROR_MARGIN_M)
            for axis in (level, np.cross(normal, level))
        )
        return width, height

    def _rest(self) -> None:
        # A simulated body needs no stop.
        return

    def _now_s(self) -> float:
        return self._time_s
