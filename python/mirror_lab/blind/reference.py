"""A session's geometry and noise-free pixels, and the model that predicts them: the input of the
identifiability reference."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .kinematics import Chain, Change, rotations, settled_chain
from .optics import Lens, Mirror, apparent
from .robots import Robot, board_points
from .truth import Commands

if TYPE_CHECKING:
    from .simulate import Case

Array = NDArray[np.float64]

PLANE_STEP = 1e-6
POINT_STEP_M = 1e-6


@dataclass
class Reference:
    """A session's geometry and pixels, and the model that predicts them."""

    robot: Robot
    gravity: Array
    commands: Commands
    of_frame: NDArray[np.int_]
    lens: Lens
    board_points: Array
    corners_px: Array
    blobs_px: Array
    corner_std_px: float
    blob_std_px: float

    def __post_init__(self) -> None:
        self.count = self.board_points.shape[0]
        px = np.concatenate([self.corners_px, self.blobs_px], axis=1)
        self.seen = np.isfinite(px).all(axis=-1)
        self.observed = np.where(self.seen[..., None], px, 0.0)
        std = np.concatenate(
            [np.full(self.count, self.corner_std_px), np.full(px.shape[1] - self.count, self.blob_std_px)]
        )
        self.weight = self.seen[..., None] / std[None, :, None]
        self.size = 2 * int(self.seen.sum())

    def settled(self, change: Change) -> Chain:
        """The chain as the changed model has it."""
        return settled_chain(self.robot, self.commands, change, self.gravity)

    def points(self, change: Change) -> Array:
        """Board corners and markers (F, C + M, 3) m in the camera."""
        return self.posture_points(self.settled(change), change)[self.of_frame]

    def posture_points(self, at: Chain, change: Change) -> Array:
        """The same once a posture, (P, C + M, 3)."""
        robot = self.robot
        camera, board = robot.index[robot.camera_link], robot.index[robot.board_link]
        markers = [robot.index[f"{m}_marker"] for m in robot.markers]
        turn = at.rotation[camera]
        origin = at.position_m[camera] + turn @ change.camera_shift_m
        turn = turn @ rotations(change.camera_turn_rad[None])
        printed = self.board_points * (1 + change.board_scale)
        mounted = printed @ rotations(change.board_turn_rad[None])[0].T + change.board_shift_m
        corners = at.position_m[board][:, None] + np.einsum("pij,cj->pci", at.rotation[board], mounted)
        arms = np.stack([at.position_m[m] for m in markers], axis=1)
        result: Array = (np.concatenate([corners, arms], axis=1) - origin[:, None]) @ turn
        return result

    def project(self, points: Array, planes: Array, change: Change) -> Array:
        """Pixels (F, K, 2); `planes` (F, 3) are the feet of the perpendiculars from the camera to the
        mirrors."""
        frames, count = points.shape[:2]
        lens = Lens(
            self.lens.focal_px * (1 + change.focal),
            self.lens.center_px + change.center_px,
            self.lens.distortion + np.array([change.k1, 0, 0, 0, 0]),
            self.lens.size_px,
        )
        distance = np.linalg.norm(planes, axis=1)
        normal = planes / distance[:, None]
        if change.glass_m == 0 and change.curvature_per_m == 0:
            gap = distance[:, None] - np.einsum("fi,fki->fk", normal, points)
            return lens.image(self._outline(points + 2 * gap[..., None] * normal[:, None]))
        index = np.repeat(np.arange(frames), count)
        # A pane thinner than nothing has no path: by symmetry of the small effect, extrapolate from a thick
        # one.
        glass = abs(change.glass_m)
        mirror = Mirror(normal[index], distance[index], glass, 1.52, np.full(2, change.curvature_per_m))
        seen = apparent(mirror, points.reshape(-1, 3)).reshape(frames, count, 3)
        if change.glass_m < 0:
            gap = distance[:, None] - np.einsum("fi,fki->fk", normal, points)
            seen = 2 * (points + 2 * gap[..., None] * normal[:, None]) - seen
        return lens.image(self._outline(seen))

    def _outline(self, seen: Array) -> Array:
        """Markers moved to where the centre of a ball's outline, an ellipse, lies: as if it were nearer by
        r²/z."""
        radius = self.robot.marker_diameter_m / 2
        first = self.count - (self.count + len(self.robot.markers) - seen.shape[1])
        seen = seen.copy()
        seen[:, first:, 2] -= radius**2 / seen[:, first:, 2]
        return seen

    def residual(self, points: Array, planes: Array, change: Change) -> Array:
        """(F, 2K), whitened, 0 where nothing was seen."""
        r = (self.observed - self.project(points, planes, change)) * self.weight
        return np.where(self.seen[..., None], r, 0.0).reshape(len(points), -1)

    def plane_basis(self, points: Array, planes: Array, change: Change, r: Array) -> tuple[Array, Array]:
        """Jacobian (F, 2K, 3) of the residual by the planes, and an orthonormal basis of it."""
        columns = []
        for k in range(3):
            moved = planes.copy()
            moved[:, k] += PLANE_STEP
            columns.append((self.residual(points, moved, change) - r) / PLANE_STEP)
        jacobian = np.stack(columns, axis=-1)
        return jacobian, np.linalg.qr(jacobian)[0]

    def point_jacobian(self, points: Array, planes: Array, change: Change, r: Array) -> Array:
        """(F, C + M, 2, 3): how the residual of each point goes with the point's place in the camera."""
        columns = []
        for k in range(3):
            moved = points.copy()
            moved[..., k] += POINT_STEP_M
            columns.append((self.residual(moved, planes, change) - r) / POINT_STEP_M)
        return np.stack(columns, axis=-1).reshape(*points.shape[:2], 2, 3)


def clean_pixels(case: Case) -> tuple[Array, Array, Array]:
    """Noise-free corners (F, C, 2) and blobs (F, M, 2) where the measured ones were seen, NaN elsewhere, and the
    mirrors' planes (F, 3); rows paired as they were measured."""
    seen = [np.asarray(np.isfinite(px).all(-1)) for px in (case.corners_px, case.blobs_px)]
    corners, blobs = case.clean_corners_px, case.clean_blobs_px
    planes = case.mirror.normal * case.mirror.distance_m[:, None]
    if case.truth.pairing is not None:
        first, last, shift = case.truth.pairing
        source = np.arange(len(corners))
        source[first : min(last, len(corners) - 4) + 1] += shift
        corners, blobs, planes = corners[source], blobs[source], planes[source]
    return (
        np.where(seen[0][..., None], corners, np.nan),
        np.where(seen[1][..., None], blobs, np.nan),
        planes,
    )


def reference_of(case: Case) -> Reference:
    """The reference of a simulated case: its noise-free pixels, where its measured ones were seen."""
    corners, blobs, _ = clean_pixels(case)
    return Reference(
        case.robot,
        case.gravity,
        case.plan.commands,
        case.plan.posture_of_frame,
        case.nominal_lens,
        board_points(case.robot),
        corners,
        blobs,
        case.noise.corner_px,
        case.noise.blob_px,
    )
