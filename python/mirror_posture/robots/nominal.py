"""The nominal session of a robot: its model, and looks collected into sessions that `measure` reads."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from .._core import MirrorPostureError
from ..camera import Camera
from ..mirror import FLOAT_GLASS_INDEX, Mirror
from ..robot import Robot
from ..session.camera_info import load_camera_info
from ..session.metadata import Metadata, load_metadata
from ..session.types import Frames, Session, Views
from .protocol import ImagePoints, JointLimits, Look

EMBEDDED_FOLDER = Path(__file__).parent.parent / "embedded"
"""The embedded robot: robot.urdf, camera.yaml, session.toml."""


@dataclass(frozen=True)
class Nominal:
    """A session without frames: robot, camera, board, markers and mirror, from session.toml."""

    folder: Path
    """Where session.toml, the URDF and camera.yaml are; a whole session will do as well."""
    metadata: Metadata
    robot: Robot
    camera: Camera | None

    @classmethod
    def load(cls, folder: str | os.PathLike[str] = EMBEDDED_FOLDER) -> Nominal:
        """Reads a folder's session.toml and the files that it names; the embedded robot by default.

        Raises `SessionError` (a `MirrorPostureError`) that names the file, what was given and the fix.
        """
        folder = Path(folder)
        metadata = load_metadata(folder)
        camera = None
        if metadata.camera is not None:
            camera = load_camera_info(folder / metadata.camera, metadata.camera)
        return cls(folder, metadata, Robot.from_urdf(folder / metadata.robot), camera)

    def with_mirror(self, glass_thickness_m: float, refractive_index: float = FLOAT_GLASS_INDEX) -> Nominal:
        """The same with another belief of the mirror; a thickness of 0 m is a front-surface mirror."""
        model = Mirror(glass_thickness_m, refractive_index)
        return replace(self, metadata=replace(self.metadata, mirror=model))

    @property
    def robot_file(self) -> Path:
        """The nominal URDF."""
        return self.folder / self.metadata.robot

    @property
    def marker_names(self) -> tuple[str, ...]:
        """Names of the markers, in the order of all marker arrays."""
        return tuple(marker.name for marker in self.metadata.markers)

    @property
    def corner_count(self) -> int:
        """How many corners the board has; 0 without a board."""
        board = self.metadata.board
        return 0 if board is None else board.corner_count

    @cached_property
    def joint_limits(self) -> dict[str, JointLimits]:
        """The URDF's limits of each joint that moves by itself."""
        return {
            joint.name: JointLimits(joint.lower, joint.upper)
            for joint in self.robot.joints
            if joint.name in self.robot.position_names
        }

    def session(self, looks: Sequence[Look], posture: Sequence[int]) -> Session:
        """The looks as a session, one frame each; `posture` numbers them: looks of one posture share a number.

        Looks with pictures only give a session without detections: see `detect_look`.

        Raises `MirrorPostureError` for no look, or numbers that do not match.
        """
        if not looks or len(looks) != len(posture):
            raise MirrorPostureError(
                f"got {len(looks)} looks and {len(posture)} posture numbers, needed at least one look and a number for each"
            )
        names = tuple(name for name in self.robot.position_names if any(name in k.commanded for k in looks))
        measured = tuple(name for name in names if all(name in look.measured for look in looks))
        frames = Frames(
            frame=np.arange(len(looks)),
            posture=np.asarray(posture, dtype=np.int64),
            joint_names=names,
            commanded=np.array([[look.commanded.get(name, 0.0) for name in names] for look in looks]),
            measured_names=measured,
            measured=np.array([[look.measured[name] for name in measured] for look in looks]),
            time_s=np.array([look.time_s for look in looks]),
        )
        return self.with_frames(
            frames, self._views(looks), detected=all(look.points is not None for look in looks)
        )

    def with_frames(
        self, frames: Frames, mirror_view: Views | None = None, *, detected: bool = False
    ) -> Session:
        """The session of these frames; by default nothing is detected yet."""
        metadata, empty = (
            self.metadata,
            Views.empty(len(frames), self.corner_count, len(self.metadata.markers)),
        )
        camera_tolerance_m, camera_tolerance_rad = metadata.camera_tolerance
        return Session(
            folder=self.folder,
            robot_file=self.robot_file,
            robot=self.robot,
            root_link=metadata.root,
            gravity_m_per_s2=metadata.gravity_m_per_s2,
            frames=frames,
            markers=metadata.markers,
            mirror_view=mirror_view or empty,
            direct_view=replace(empty),
            camera=self.camera,
            camera_link=metadata.camera_link,
            board=metadata.board,
            mirror=metadata.mirror,
            noise=metadata.noise,
            camera_tolerance_m=camera_tolerance_m,
            camera_tolerance_rad=camera_tolerance_rad,
            detected=detected,
            metadata=metadata.raw,
        )

    def _views(self, looks: Sequence[Look]) -> Views:
        views = Views.empty(len(looks), self.corner_count, len(self.metadata.markers))
        board_std, marker_std = np.zeros(views.board_seen.shape), np.zeros(views.marker_seen.shape)
        claimed = [False, False]
        for row, look in enumerate(looks):
            points = look.points
            if points is None:
                continue
            views.board_px[row], views.board_seen[row] = points.board_px, points.board_seen
            views.marker_px[row], views.marker_seen[row] = points.marker_px, points.marker_seen
            if points.board_std_px is not None:
                board_std[row], claimed[0] = points.board_std_px, True
            if points.marker_std_px is not None:
                marker_std[row], claimed[1] = points.marker_std_px, True
        return replace(
            views,
            board_std_px=board_std if claimed[0] else None,
            marker_std_px=marker_std if claimed[1] else None,
        )


def detect_look(nominal: Nominal, look: Look) -> Look:
    """The look with the image points of its picture; as it is where it has image points, or no picture.

    Raises `DetectionError` for a marker without a colour or a picture of another size than the camera's.
    """
    if look.points is not None or look.picture_bgr is None:
        return look
    # OpenCV takes longer to load than a loop without pictures runs.
    from ..detect import detect_picture, predictions_from_session, setup_from_session, with_detections

    session = nominal.session([look], [0])
    found = detect_picture(
        look.picture_bgr, setup_from_session(session), predictions_from_session(session)[0]
    )
    seen = with_detections(session, {0: found}).mirror_view
    reasons = [f"board: {board.reason}" for board in found.boards if not board.ok]
    reasons += [f"{marker.name}: {marker.reason}" for marker in found.markers if not marker.ok]
    points = ImagePoints(
        board_px=seen.board_px[0],
        board_seen=seen.board_seen[0],
        marker_px=seen.marker_px[0],
        marker_seen=seen.marker_seen[0],
        board_std_px=None if seen.board_std_px is None else seen.board_std_px[0],
        marker_std_px=None if seen.marker_std_px is None else seen.marker_std_px[0],
        reasons=tuple(reasons),
    )
    return replace(look, points=points)
