"""The sensitivity of a planned picture: the Jacobian columns of each effect of the vocabulary.

Every effect is a small twist at one place of the chain from camera to marker, times a basis that varies
with the posture: `∂pixel/∂parameter = ∂pixel/∂point · (ω × (p − o) + v) · basis`. The mirror of each frame
(3 parameters) is projected out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..arrays import Floats, Mask
from ..mirror import IDEAL_MIRROR
from ..optics import SeenInMirror, see_in_mirror
from ..robot import Joint
from ..rotations import cross_matrix, rotation_of_vector, tilt_directions
from .causes import Cause, Moment
from .options import MirrorPlace
from .setting import Setting
from .sight import scene_of

Basis = Callable[[Moment], Floats]


@dataclass(frozen=True, eq=False)
class _Place:
    joint: int
    """Index of the joint that the effect moves."""
    bases: tuple[Basis, ...]
    """Each gives the twist (6,), ω and v, in the joint's own frame before its motion, for a moment."""


class Sensitivity:
    """The columns of all causes at a set-up, and the pixels' Jacobian of any frame."""

    def __init__(self, setting: Setting, seconds_a_frame: float, frames: int) -> None:
        self.setting, self.robot = setting, setting.nominal.robot
        metadata = setting.nominal.metadata
        links = list(self.robot.link_names)
        self._parent = [links.index(joint.parent_link) for joint in self.robot.joints]
        self._below = np.eye(len(links), dtype=bool)
        for number, joint in enumerate(self.robot.joints):
            # Links are in depth-first order; joint j carries link j + 1.
            self._below[:, number + 1] |= self._below[:, links.index(joint.parent_link)]
        self._markers = [links.index(marker.link) for marker in metadata.markers]
        self._camera, self._board = links.index(setting.camera_link), links.index(setting.board.link)
        self.causes: list[Cause] = []
        self._places: list[_Place] = []
        self._count = 0
        moves = [
            (number, joint)
            for number, joint in enumerate(self.robot.joints)
            if joint.position in setting.moving and joint.name in self.robot.position_names
        ]
        largest = self._largest_torques()
        for number, joint in moves:
            self._joint(number, joint, seconds_a_frame * frames, largest)
        self.body_columns = self._count
        for marker in metadata.markers:
            self._add("marker_mount", f"marker:{marker.name}", ("dx_m", "dy_m", "dz_m"), (3e-3,) * 3)
        six = ("rx_rad", "ry_rad", "rz_rad", "dx_m", "dy_m", "dz_m")
        self._add("camera_mount", "camera", six, (0.01,) * 3 + (3e-3,) * 3)
        self._add("board_mount", "board", six, (0.01,) * 3 + (3e-3,) * 3)
        self._add("camera_focal", "camera", ("scale_error",), (0.01,))
        self._add("camera_center", "camera", ("du_px", "dv_px"), (3.0, 3.0))
        self._add("lens_distortion", "camera", ("dk1",), (0.02,))
        self._add("board_scale", "board", ("scale_error",), (0.01,))
        self._add("mirror_glass", "mirror", ("thickness_m",), (1e-3,))
        self._add("mirror_curvature", "mirror", ("curvature_per_m",), (0.01,))
        self.width = self._count

    def prior_precision(self) -> Floats:
        """(width,) of the mounts' columns: the session's tolerances, or 3 mm and 1°; 0 for all others."""
        metadata, out = self.setting.nominal.metadata, np.zeros(self.width)
        tolerance: dict[str, tuple[float | None, float | None]] = {
            f"marker:{m.name}": (m.tolerance_m, None) for m in metadata.markers
        }
        tolerance["camera"] = metadata.camera_tolerance
        tolerance["board"] = (self.setting.board.tolerance_m, self.setting.board.tolerance_rad)
        for cause in self.causes:
            if not cause.effect.endswith("_mount"):
                continue
            length, angle = tolerance[cause.at]
            for column, name in zip(
                range(cause.columns.start, cause.columns.stop), cause.parameters, strict=True
            ):
                std = (
                    (np.radians(1.0) if angle is None else angle)
                    if name.endswith("_rad")
                    else (3e-3 if length is None else length)
                )
                out[column] = 1.0 / max(std, 1e-6) ** 2
        return out

    def _largest_torques(self) -> Floats:
        random = np.random.default_rng(0)
        low, high = self.setting.low, self.setting.high
        postures = low + (high - low) * random.random((64, len(low)))
        largest: Floats = np.maximum(np.abs(self.torques(postures)).max(axis=0), 1e-3)
        return largest

    def torques(self, postures: Floats) -> Floats:
        """Gravity's torques (N, nq) on the joints."""
        metadata = self.setting.nominal.metadata
        found: Floats = self.robot.gravity_torques(postures, metadata.gravity_m_per_s2, metadata.root)
        return found

    def _add(self, effect: str, at: str, parameters: tuple[str, ...], typical: tuple[float, ...]) -> None:
        self.causes.append(
            Cause(effect, at, parameters, typical, slice(self._count, self._count + len(parameters)))
        )
        self._count += len(parameters)

    def _joint(self, number: int, joint: Joint, length_s: float, largest: Floats) -> None:
        k, name, link = int(joint.position or 0), joint.name, joint.parent_link
        turns = joint.kind != "prismatic"
        axis = np.asarray(joint.axis, dtype=float)
        along = np.concatenate([axis, np.zeros(3)] if turns else [np.zeros(3), axis])

        def add(
            effect: str, at: str, parameters: tuple[str, ...], typical: tuple[float, ...], *bases: Basis
        ) -> None:
            self._add(effect, at, parameters, typical)
            self._places.append(_Place(number, bases))

        at = f"joint:{name}"
        add("joint_offset", at, ("offset_rad",), (0.035,), lambda m: along)
        add("gear_ratio", at, ("scale_error",), (0.03,), lambda m: along * m.positions[k])
        if turns:
            add(
                "gear_eccentricity", at, ("sin_rad", "cos_rad"), (0.02, 0.02),
                lambda m: along * np.sin(m.positions[k]), lambda m: along * (np.cos(m.positions[k]) - 1.0),
            )  # fmt: skip
        add("backlash", at, ("width_rad",), (0.03,), lambda m: -0.5 * along * m.side[k])
        if largest[k] > 2e-3:
            add(
                "joint_compliance", at, ("compliance_rad_per_nm",), (0.03 / float(largest[k]),),
                lambda m: along * m.torque_nm[k],
            )  # fmt: skip
        add("drift", at, ("rate_rad_per_s",), (0.03 / length_s,), lambda m: along * m.time_s)
        if turns:
            u, v = tilt_directions(axis)

            def tilt(direction: Floats) -> Basis:
                # The axis leans towards `direction`: a turn w of the frame before the motion, and back after it.
                w = np.cross(axis, direction)
                return lambda m: np.concatenate(
                    [w - rotation_of_vector(m.positions[k] * axis) @ w, np.zeros(3)]
                )

            add("axis_tilt", at, ("tilt_1_rad", "tilt_2_rad"), (0.02, 0.02), tilt(u), tilt(v))
        parent_from = np.asarray(joint.parent_from_joint, dtype=float)

        def shift(index: int) -> Basis:
            # Told in the link's frame; the place's frame is the joint's.
            moved = np.concatenate([np.zeros(3), parent_from[:3, :3].T[:, index]])
            return lambda m: moved

        add(
            "link_length",
            f"link:{link}",
            ("dx_m", "dy_m", "dz_m"),
            (3e-3,) * 3,
            *(shift(i) for i in range(3)),
        )

    def jacobian(
        self, moment: Moment, mirror: MirrorPlace, markers: Mask, all_corners: bool = False
    ) -> Floats:
        """Whitened rows (R, width) of a frame with its own mirror projected out; `mirror` in the base's frame."""
        setting = self.setting
        poses = self.robot.link_poses(moment.positions[None], list(self.robot.link_names))[0]
        base_from_camera = poses[self._camera]
        rotation = base_from_camera[:3, :3]
        scene = scene_of(setting, moment.positions[None], all_corners)
        seen = np.flatnonzero(markers)
        in_camera = np.concatenate([scene.corners[0], scene.markers[0][seen]])
        points = in_camera @ rotation.T + base_from_camera[:3, 3]
        corners = len(scene.corners[0])
        owner = [self._board] * corners + [self._markers[m] for m in seen]
        normal = rotation.T @ mirror.normal_in_root
        distance = float(normal @ (rotation.T @ (mirror.center_in_root_m - base_from_camera[:3, 3])))
        view = see_in_mirror(
            setting.camera,
            np.repeat((distance * normal)[None], len(points), axis=0),
            in_camera,
            **(setting.nominal.metadata.mirror or IDEAL_MIRROR).glass,
        )
        by_base_point = view.by_point @ rotation.T
        out = np.zeros((len(points), 2, self.width))
        out[:, :, : self.body_columns] = self._body(moment, poses, points, owner, by_base_point)
        self._setup(out, view, in_camera, by_base_point, poses, seen, corners)
        self._optics(out, view, scene.corners[0], corners)
        weight = np.full(len(points), 1.0 / setting.noise_px)
        if not all_corners:
            weight[:corners] *= np.sqrt(setting.board.corner_count / corners)
        rows = (out * weight[:, None, None]).reshape(-1, self.width)
        nuisance = (view.by_foot_point * weight[:, None, None]).reshape(-1, 3)
        q, _ = np.linalg.qr(nuisance)
        projected: Floats = rows - q @ (q.T @ rows)
        return projected

    def _body(
        self, moment: Moment, poses: Floats, points: Floats, owner: Sequence[int], by_base_point: Floats
    ) -> Floats:
        """The columns (N, 2, ·) of the body's effects: a twist moves everything beyond it in the chain,
        unless the camera is beyond it too."""
        twists = [np.stack([basis(moment) for basis in place.bases]) for place in self._places]
        frames = [
            poses[self._parent[place.joint]] @ self.robot.joints[place.joint].parent_from_joint
            for place in self._places
        ]
        each = [len(twist) for twist in twists]
        turn = np.repeat([frame[:3, :3] for frame in frames], each, axis=0)
        origin = np.repeat([frame[:3, 3] for frame in frames], each, axis=0)
        below = np.repeat([self._below[place.joint + 1] for place in self._places], each, axis=0).astype(
            float
        )
        twist = np.concatenate(twists)
        omega = np.einsum("pij,pj->pi", turn, twist[:, :3])
        v = np.einsum("pij,pj->pi", turn, twist[:, 3:]) - np.cross(omega, origin)
        # ω × p is −[p]× ω.
        moved = -np.einsum("nij,pj->npi", cross_matrix(points), omega) + v
        moved *= (below[:, owner] - below[:, [self._camera]]).T[:, :, None]
        columns: Floats = np.einsum("nij,npj->nip", by_base_point, moved)
        return columns

    def _setup(
        self,
        out: Floats,
        view: SeenInMirror,
        in_camera: Floats,
        by_base_point: Floats,
        poses: Floats,
        seen: npt.NDArray[np.signedinteger[Any]],
        corners: int,
    ) -> None:
        by_point = view.by_point
        for cause in self.causes:
            start = cause.columns.start
            if cause.effect == "marker_mount":
                index = [m.name for m in self.setting.nominal.metadata.markers].index(
                    cause.at.split(":", 1)[1]
                )
                for row, m in enumerate(seen):
                    if m == index:
                        turn = poses[self._markers[m]][:3, :3]
                        out[corners + row, :, start : start + 3] = by_base_point[corners + row] @ turn
            elif cause.effect == "camera_mount":
                # The camera moves: everything moves the other way in its frame.
                out[:, :, start : start + 3] = by_point @ cross_matrix(in_camera)
                out[:, :, start + 3 : start + 6] = -by_point
            elif cause.effect == "board_mount":
                board = slice(0, corners)
                around = in_camera[board] - in_camera[board].mean(axis=0)
                out[board, :, start : start + 3] = -by_point[board] @ cross_matrix(around)
                out[board, :, start + 3 : start + 6] = by_point[board]

    def _optics(self, out: Floats, view: SeenInMirror, corners_in_camera: Floats, corners: int) -> None:
        camera = self.setting.camera
        focal, center = np.array(camera.focal_px), np.array(camera.center_px)
        from_center = view.pixels_px - center
        radius2 = ((from_center / focal) ** 2).sum(axis=1, keepdims=True)
        middle = corners_in_camera.mean(axis=0)
        for cause in self.causes:
            at = cause.columns.start
            if cause.effect == "camera_focal":
                out[:, :, at] = from_center
            elif cause.effect == "camera_center":
                out[:, 0, at] = out[:, 1, at + 1] = 1.0
            elif cause.effect == "lens_distortion":
                out[:, :, at] = from_center * radius2
            elif cause.effect == "board_scale":
                out[:corners, :, at] = np.einsum(
                    "nij,nj->ni", view.by_point[:corners], corners_in_camera - middle
                )
            elif cause.effect == "mirror_glass":
                out[:, :, at] = view.by_thickness
            elif cause.effect == "mirror_curvature":
                out[:, :, at] = view.by_curvature
