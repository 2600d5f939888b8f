"""First-order effect of a change on what is seen: shared place Jacobians instead of a chain for each
hypothesis.

A hypothesis changes the body by a small twist or shift of some bodies in each posture. A point x that
hangs on a body which turns by δω about o moves by δω × (x − o); in the camera, whose frame may move too,

    δp = Rᵀ (δx − δo_c − δω_c × (x − o_c))

and the residual by its Jacobian times δp.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .kinematics import Chain, Change, moments, rotations, skeleton_of, turns
from .reference import Reference

Array = NDArray[np.float64]


class Linear:
    """A model about which changes are taken to first order."""

    def __init__(self, ref: Reference, change: Change, planes: Array) -> None:
        self.ref, self.change, self.planes = ref, change, planes
        self.at: Chain = ref.settled(change)
        self.posture_points = ref.posture_points(self.at, change)
        self.points = self.posture_points[ref.of_frame]
        self.residual = ref.residual(self.points, planes, change)
        self.jacobian = ref.point_jacobian(self.points, planes, change, self.residual)
        robot = ref.robot
        self.camera, self.board = robot.index[robot.camera_link], robot.index[robot.board_link]
        self.markers = [robot.index[f"{m}_marker"] for m in robot.markers]
        self.turn = self.at.rotation[self.camera] @ rotations(change.camera_turn_rad[None])
        self.eye = self.at.position_m[self.camera] + self.at.rotation[self.camera] @ change.camera_shift_m
        self.world = self.posture_points @ np.swapaxes(self.turn, 1, 2) + self.eye[:, None]

    def column(self, moved: Change, whole: bool) -> Array:
        """What `moved` adds to the residual: (F, 2K) with `whole`, else the markers' rows only, (F, 2M)."""
        ref, first = self.ref, 0 if whole else self.ref.count
        shift = self._point_shift(moved, first)[ref.of_frame]
        if whole and self._optics_differ(moved):
            points = self.points + shift
            old = self.change
            if moved.board_scale != old.board_scale or _camera_moved(moved, old) or _board_moved(moved, old):
                points = ref.posture_points(self.at, moved)[ref.of_frame] + shift
            return ref.residual(points, self.planes, moved) - self.residual
        rows = self.jacobian[:, first:]
        return (rows @ shift[..., None])[..., 0].reshape(len(rows), -1)

    def _optics_differ(self, moved: Change) -> bool:
        old = self.change
        return (
            moved.focal != old.focal
            or moved.k1 != old.k1
            or moved.glass_m != old.glass_m
            or moved.curvature_per_m != old.curvature_per_m
            or moved.board_scale != old.board_scale
            or not np.array_equal(moved.center_px, old.center_px)
            or _camera_moved(moved, old)
            or _board_moved(moved, old)
        )

    def _point_shift(self, moved: Change, first: int) -> Array:
        """(P, points from `first` on, 3) in the camera, of what the body does."""
        ref = self.ref
        above, count = skeleton_of(ref.robot).above, ref.count
        world = np.zeros((len(self.world), self.world.shape[1] - first, 3))
        eye = np.zeros((len(world), 3))
        sight = np.zeros((len(world), 3))
        still = True
        for body, turn, origin, slide in self._twists(moved):
            for k, target in enumerate(self.markers):
                if above[body, target]:
                    world[:, count - first + k] += _moved(self.world[:, count + k], turn, origin, slide)
            if first == 0 and above[body, self.board]:
                for k in range(count):
                    world[:, k] += _moved(self.world[:, k], turn, origin, slide)
            if above[body, self.camera]:
                eye += _moved(self.eye, turn, origin, slide)
                sight += turn if turn is not None else 0.0
                still = False
        if not still:
            world -= eye[:, None] + np.cross(sight[:, None], self.world[:, first:] - self.eye[:, None])
        result: Array = world @ self.turn
        return result

    def _twists(self, moved: Change) -> list[tuple[int, Array | None, Array, Array | None]]:
        """Body, turn (P, 3) and what it is about (P, 3), slide (P, 3): all in the root's frame."""
        ref, robot, at, old = self.ref, self.ref.robot, self.at, self.change
        out: list[tuple[int, Array | None, Array, Array | None]] = []
        for joint, angle in moved.joint_rad.items():
            before = old.joint_rad.get(joint)
            if angle is before:
                continue
            body = robot.body_of_joint(joint)
            axis = moved.axis.get(body, robot.bodies[body].axis)
            by = angle if before is None else angle - before
            out.append((body, by[:, None] * (at.rotation[body] @ axis), at.position_m[body], None))
        for k, y in enumerate(moved.yields):
            more = y.compliance - (old.yields[k].compliance if k < len(old.yields) else 0.0)
            if more == 0:
                continue
            moment = moments(robot, at, ref.gravity, y.body, y.pivot_m) @ y.axis
            pivot = at.position_m[y.body] + at.rotation[y.body] @ y.pivot_m
            out.append((y.body, (more * moment)[:, None] * (at.rotation[y.body] @ y.axis), pivot, None))
        for body, origin in moved.origin_m.items():
            before_m = old.origin_m.get(body)
            if origin is before_m:
                continue
            by_m = origin if before_m is None else origin - before_m
            parent = robot.bodies[body].parent
            out.append((body, None, at.position_m[body], at.rotation[parent] @ by_m))
        for body, axis in moved.axis.items():
            before_axis = old.axis.get(body, robot.bodies[body].axis)
            if axis is before_axis:
                continue
            joint = robot.bodies[body].joint
            angle = ref.commands.of(joint) + moved.joint_rad.get(joint, 0.0)
            between = np.swapaxes(turns(before_axis, angle), 1, 2) @ turns(axis, angle)
            small = np.stack([between[:, 2, 1], between[:, 0, 2], between[:, 1, 0]], axis=1)
            out.append((body, (at.rotation[body] @ small[..., None])[..., 0], at.position_m[body], None))
        return out


def _camera_moved(moved: Change, old: Change) -> bool:
    return not (
        np.array_equal(moved.camera_turn_rad, old.camera_turn_rad)
        and np.array_equal(moved.camera_shift_m, old.camera_shift_m)
    )


def _board_moved(moved: Change, old: Change) -> bool:
    return not (
        np.array_equal(moved.board_turn_rad, old.board_turn_rad)
        and np.array_equal(moved.board_shift_m, old.board_shift_m)
    )


def _moved(x: Array, turn: Array | None, origin: Array, slide: Array | None) -> Array:
    out = np.zeros_like(x) if slide is None else slide
    return out if turn is None else out + np.cross(turn, x - origin)
