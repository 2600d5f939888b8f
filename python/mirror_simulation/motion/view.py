"""What the mirror shows of a moving body: markers at joint positions to whitened residuals of their images.

The mirror of each picture is measured from the board's reflection, its foot f with covariance S (the corners' noise). Where
camera and board move against each other the plane that the same corners tell moves too, f(X) = f0 + F log(X0⁻¹ X) for
X = camera_from_board. The plane is a nuisance: the residuals r of the markers' images (seen less predicted) have the covariance

    C = σ² I + J S Jᵀ,   J = ∂image/∂f,

and are whitened by the inverse of its Cholesky factor, picture by picture.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

import numpy as np

from mirror_posture import MirrorPostureError
from mirror_posture.arrays import Floats, Mask
from mirror_posture.measurement import MeasureOptions
from mirror_posture.measurement.inputs import core_input
from mirror_posture.optics import ball_center_pixels, see_in_mirror
from mirror_posture.rotations import pose_of
from mirror_posture.short_repr import ShortRepr

from ..simulate.gap import CORNER_NOISE_PX
from ..simulate.mounts import turn_of_mount
from .effects import Causes
from .false_images import false_images
from .recording import Recording

TWIST_STEP = 1e-4
"""rad, m: step of the differences by which a mirror's foot moves with the camera relative to the board."""
KEPT_PER_MARKER = 6
"""Poses of each marker that are cached: what a cause does not move is needed repeatedly."""
HIDDEN = 1e6
"""px²: the variance of a marker that was not seen."""


@dataclass(frozen=True, eq=False, repr=False)
class Places(ShortRepr):
    """Joint positions at which things were seen: markers (F, markers, nq) and board (F, nq), in the robot's order."""

    markers: Floats
    board: Floats


class View:
    """The pictures of a moving session. `seen` (F, markers) are the images that count."""

    def __init__(self, recording: Recording, nominal: Places) -> None:
        session = recording.session
        assert session.camera is not None and session.board is not None and session.camera_link is not None
        self.session, self.camera = session, session.camera
        self.links = [session.camera_link, session.board.link]
        self.marker_links = [marker.link for marker in session.markers]
        self.noise_px = session.noise.pixel_std_px or CORNER_NOISE_PX
        self._marker_from_mount = [self._turned_mount(link) for link in self.marker_links]
        self._moving = [self._columns_between(link) for link in self.marker_links]
        self._relative: OrderedDict[tuple[object, ...], Floats] = OrderedDict()
        camera_site, board_site = (self._carrier(link) for link in self.links)
        self.camera_beside_board = camera_site == board_site
        camera_from_board = self._camera_from_board(nominal.board, {})
        self.foot_m, covariance, usable = self._feet(camera_from_board)
        self.board_from_camera = np.linalg.inv(camera_from_board)
        by_twist = np.zeros((*self.foot_m.shape, 6))
        for k in range(6):
            twist = np.zeros(6)
            twist[k] = TWIST_STEP
            ahead, _, good = self._feet(camera_from_board @ pose_of(twist[:3], twist[3:]))
            usable &= good
            by_twist[:, :, k] = (ahead - self.foot_m) / TWIST_STEP
        self.foot_by_twist = np.where(usable[:, None, None], by_twist, 0.0)
        self.seen = session.mirror_view.marker_seen & usable[:, None]
        self.image_px = session.mirror_view.marker_px.copy()
        predicted, by_foot, good = self._predict(nominal, {})
        self.seen &= good
        if not self.seen.any():
            raise MirrorPostureError(
                f"{session.folder}: no picture shows board and marker in the mirror together"
            )
        self._centre_balls(nominal)
        self.false = self.false_among(self.image_px - predicted)
        self._shown, self.first = self.seen.copy(), 0
        self.seen &= ~self.false
        if not self.seen.any():
            raise MirrorPostureError(
                f"{session.folder}: all images of markers are false: none fits those before and after it"
            )
        self._by_foot, self._covariance = by_foot, covariance
        self.whitening = self._whitening(by_foot, covariance)

    def _carrier(self, link: str) -> str:
        """The link next to the last joint that moves a link."""
        robot = self.session.robot
        index = robot.link_index(link)
        while (joint := robot.links[index].parent_joint) is not None and robot.joints[joint].kind == "fixed":
            index = robot.link_index(robot.joints[joint].parent_link)
        return robot.link_names[index]

    def _turned_mount(self, link: str) -> Floats:
        """From the frame in which a marker's mount is given to that of its link (3, 3): the mount's is that of the link to which the
        marker's link is fixed."""
        parent_from_marker = turn_of_mount(self.session.robot, link)
        return np.eye(3) if parent_from_marker is None else parent_from_marker.T

    def _camera_from_board(self, board_positions: Floats, causes: Causes) -> Floats:
        poses = self.session.robot.link_poses(board_positions, self.links)
        camera, board = self._moved(poses[:, 0], poses[:, 1], causes)
        return np.asarray(np.linalg.inv(camera) @ board)

    def _moved(self, camera: Floats, board: Floats, causes: Causes) -> tuple[Floats, Floats]:
        """Camera and board (N, 4, 4) in the root's frame, with their mounts' causes."""
        values = causes.get(("board_mount", "board"))
        if values is not None:
            mount = pose_of(np.array(values[:3]), np.array(values[3:]))
            if self.camera_beside_board:
                camera = board @ mount @ np.linalg.inv(board) @ camera
            board = board @ mount
        values = causes.get(("camera_mount", "camera"))
        if values is not None:
            camera = camera @ pose_of(np.array(values[:3]), np.array(values[3:]))
        return camera, board

    def _feet(self, camera_from_board: Floats) -> tuple[Floats, Floats, Mask]:
        done = core_input(self.session, camera_from_board).ladder(
            "maximum_likelihood",
            corner_noise_px=self.noise_px,
            marker_noise_px=self.noise_px,
            least_parallax_rad=MeasureOptions().least_parallax_rad,
        )
        good = np.array([reason is None for reason in done.mirror_reason], dtype=bool)
        foot, covariance = np.asarray(done.foot_m).copy(), np.asarray(done.foot_covariance_m2).copy()
        foot[~good], covariance[~good] = (0.0, 0.0, 1.0), np.eye(3)
        return foot, covariance, good

    def _predict(self, places: Places, causes: Causes) -> tuple[Floats, Floats, Mask]:
        """Images (F, markers, 2), their derivative by the mirror's foot (F, markers, 2, 3), and which have one."""
        frames, markers = places.markers.shape[:2]
        foot = self.foot_m
        moves_board = any(key[0] in ("camera_mount", "board_mount") for key in causes)
        if not self.camera_beside_board or moves_board:
            camera_from_board = self._camera_from_board(places.board, causes)
            foot = foot + np.einsum(
                "fkl,fl->fk", self.foot_by_twist, _log(self.board_from_camera @ camera_from_board)
            )
        points = np.zeros((frames, markers, 3))
        mirror = self.session.mirror
        glass = {} if mirror is None else mirror.glass
        for m, marker in enumerate(self.session.markers):
            moved = causes.get(("marker_mount", f"marker:{marker.name}"), (0.0,) * 3)
            shift = np.append(self._marker_from_mount[m] @ moved, 1.0)
            camera_from_marker = self._camera_from_marker(
                m, places.markers[:, m], causes if moves_board else {}
            )
            points[:, m] = (camera_from_marker @ shift)[:, :3]
        told = see_in_mirror(self.camera, np.repeat(foot, markers, axis=0), points.reshape(-1, 3), **glass)
        good = np.asarray(told.valid).reshape(frames, markers)
        pixels = np.asarray(told.pixels_px).reshape(frames, markers, 2)
        by_foot = np.asarray(told.by_foot_point).reshape(frames, markers, 2, 3)
        return np.where(good[..., None], pixels, 0.0), np.where(good[..., None, None], by_foot, 0.0), good

    def _camera_from_marker(self, m: int, positions: Floats, causes: Causes) -> Floats:
        """(F, 4, 4) of a marker's link, at joint positions (F, nq) and with the mounts' causes; the last ones are remembered."""
        moved = np.ascontiguousarray(positions[:, self._moving[m]])
        key = (m, hash(moved.tobytes()), tuple(causes.items()))
        if key not in self._relative:
            poses = self.session.robot.link_poses(positions, [*self.links, self.marker_links[m]])
            camera, _ = self._moved(poses[:, 0], poses[:, 1], causes)
            self._relative[key] = _inverses(camera) @ poses[:, 2]
        self._relative.move_to_end(key)
        while len(self._relative) > KEPT_PER_MARKER * len(self.marker_links):
            self._relative.popitem(last=False)
        return self._relative[key]

    def _columns_between(self, link: str) -> list[int]:
        """The columns of joint positions on which camera, board and a link depend."""
        robot = self.session.robot
        steps = [*robot.chain(self.links[0], link), *robot.chain(*self.links)]
        joints = {joint.name: joint for joint in robot.joints}
        names = {step.joint for step in steps if joints[step.joint].kind != "fixed"}
        known = list(robot.position_names)
        # A joint that another one moves is not among them.
        return (
            [known.index(name) for name in known if name in names]
            if names <= set(known)
            else [*range(len(known))]
        )

    def _centre_balls(self, nominal: Places) -> None:
        """From the centroids of the balls' images to the images of their centres."""
        for m, marker in enumerate(self.session.markers):
            if marker.diameter_m <= 0.0:
                continue
            poses = self.session.robot.link_poses(nominal.markers[:, m], [self.links[0], marker.link])
            point = (np.linalg.inv(poses[:, 0]) @ poses[:, 1])[:, :3, 3]
            normal = self.foot_m / np.linalg.norm(self.foot_m, axis=1, keepdims=True)
            depth = np.einsum("ni,ni->n", normal, self.foot_m - point)
            path = np.linalg.norm(point + 2.0 * depth[:, None] * normal, axis=1)
            centre = ball_center_pixels(self.camera, self.image_px[:, m], marker.diameter_m, path)
            good = np.asarray(centre.valid)
            self.seen[:, m] &= good
            self.image_px[good, m] = np.asarray(centre.pixels_px)[good]

    def false_among(self, residual_px: Floats) -> Mask:
        """(F, markers): the false ones of all images that count, by the residuals that a model leaves."""
        return false_images(np.where(self.seen[..., None], residual_px, np.nan), self.noise_px)

    def leave_out(self, false: Mask) -> None:
        """Counts all images that the pictures show but these (F, markers), which are false."""
        self.false = false & self._shown
        self.seen = self._shown & ~self.false
        self.seen[: self.first] = False
        self.whitening = self._whitening(self._by_foot, self._covariance)

    def begin_at(self, first: int) -> None:
        """Counts no picture before this one."""
        self.first = first
        self.leave_out(self.false)

    @property
    def variance_px2(self) -> Floats:
        """(F, markers): of both axes of an image together, the mirror's uncertainty included, in units of the stated noise."""
        jacobian = self._by_foot
        return np.asarray(
            2.0 * self.noise_px**2 + np.einsum("fmik,fkl,fmil->fm", jacobian, self._covariance, jacobian)
        )

    def metres_per_px(self, nominal: Places) -> Floats:
        """(F, markers): the size of a pixel at a marker, across the line of sight: the light's path over
        the focal length."""
        out = np.zeros(self.seen.shape)
        normal = self.foot_m / np.linalg.norm(self.foot_m, axis=1, keepdims=True)
        for m, link in enumerate(self.marker_links):
            poses = self.session.robot.link_poses(nominal.markers[:, m], [self.links[0], link])
            point = (np.linalg.inv(poses[:, 0]) @ poses[:, 1])[:, :3, 3]
            depth = np.einsum("ni,ni->n", normal, self.foot_m - point)
            out[:, m] = (
                np.linalg.norm(point + 2.0 * depth[:, None] * normal, axis=1) / self.camera.mean_focal_px
            )
        return out

    def _whitening(self, by_foot: Floats, covariance: Floats) -> Floats:
        """(F, 2 markers, 2 markers): the inverse Cholesky factor of each picture's covariance."""
        frames, markers = self.seen.shape
        jacobian = (by_foot * self.seen[..., None, None]).reshape(frames, 2 * markers, 3)
        total = jacobian @ covariance @ np.swapaxes(jacobian, 1, 2)
        hidden = np.repeat(~self.seen, 2, axis=1)
        diagonal = np.where(hidden, HIDDEN, self.noise_px**2)
        total[:, np.arange(2 * markers), np.arange(2 * markers)] += diagonal
        return np.asarray(np.linalg.inv(np.linalg.cholesky(total)))

    def residual_px(self, places: Places, causes: Causes) -> Floats:
        """(F, markers, 2): seen less predicted, px; 0 where not seen."""
        predicted, _, good = self._predict(places, causes)
        return np.where((self.seen & good)[..., None], self.image_px - predicted, 0.0)

    def deviations(self, places: Places, causes: Causes) -> Floats:
        """(F, markers): how far the images lie from their predictions, in units of the stated noise and the mirror's; NaN without a prediction."""
        predicted, _, good = self._predict(places, causes)
        squares = ((self.image_px - predicted) ** 2).sum(axis=2)
        return np.asarray(np.where(good, np.sqrt(2.0 * squares / self.variance_px2), np.nan))

    def whitened(self, residual_px: Floats) -> Floats:
        """Residuals (F, markers, 2) or columns (F, markers, 2, P) whitened, zeros where not seen."""
        frames, markers = self.seen.shape
        rows = np.where(
            self.seen.reshape(frames, markers, *(1,) * (residual_px.ndim - 2)), residual_px, 0.0
        ).reshape(frames, 2 * markers, -1)
        out = self.whitening @ rows
        return np.asarray(out.reshape(frames, markers, 2, *residual_px.shape[3:]))


def _inverses(poses: Floats) -> Floats:
    """Of rigid poses (N, 4, 4)."""
    out: Floats = poses.copy()
    out[:, :3, :3] = np.swapaxes(poses[:, :3, :3], 1, 2)
    out[:, :3, 3] = -(out[:, :3, :3] @ poses[:, :3, 3:])[:, :, 0]
    return out


def _log(poses: Floats) -> Floats:
    """(N, 6): rotation vector (of small rotations) and translation of poses (N, 4, 4)."""
    r = poses[:, :3, :3]
    axis = 0.5 * np.stack([r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]], axis=1)
    sine = np.linalg.norm(axis, axis=1)
    angle = np.arctan2(sine, 0.5 * (np.trace(r, axis1=1, axis2=2) - 1.0))
    scale = np.where(sine > 1e-9, angle / np.where(sine > 1e-9, sine, 1.0), 1.0)
    return np.concatenate([axis * scale[:, None], poses[:, :3, 3]], axis=1)
