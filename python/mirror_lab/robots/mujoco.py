"""Any URDF or MJCF as a commanded robot: MuJoCo's dynamics, servos with finite gains, plays, friction, springs.

Needs the extra `mujoco`. It sees its mirror in one of three ways: MuJoCo's own renderer (a reflecting plane, where
there is an OpenGL), the package's traced pictures, or exact pixels with noise.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt

from mirror_posture._core import MirrorPostureError
from mirror_posture.mirror import FLOAT_GLASS_INDEX
from mirror_posture.robots.base import RobotBase
from mirror_posture.robots.errors import NotSettledError
from mirror_posture.robots.nominal import Nominal
from mirror_posture.robots.protocol import JointLimits, Look, Positions
from mirror_posture.viewpoint import View

from .hidden import HiddenEffect
from .pixels import MirrorInRoot, exact_points, lens_of
from .stand import SimulatedStand

try:
    import mujoco
except ImportError:
    raise MirrorPostureError(
        "MuJoCo is not installed; install the extra: pip install 'mirror-posture[lab,mujoco]'"
    ) from None

from .mujoco_model import ServoOptions, build, frame_of, read_spec

if TYPE_CHECKING:
    from mirror_posture.render import Painter
    from mirror_posture.shapes.mujoco_picture import MirrorRenderer

Floats = npt.NDArray[np.float64]
Way = Literal["pixels", "traced", "rendered", "auto"]

MOVE_S = 0.4
"""From command to command, along a path of least jerk."""
CONTROL_STEPS = 5
"""Simulation steps between two commands of the servos: 200 Hz."""
SETTLED_RAD_PER_S = 2e-5
CREEPING_RAD_PER_S = 1e-3
"""A part that moves more slowly than this after the longest wait counts as at rest: its load hardly exceeds its friction."""
SETTLE_CHECK_S = 0.05
SETTLE_LONGEST_S = 5.0


@dataclass(frozen=True)
class MujocoOptions:
    """The robot's construction, and its way to take pictures."""

    servo: ServoOptions = field(default_factory=ServoOptions)
    way: Way = "pixels"
    """`auto`: `rendered` where there is an OpenGL and the nominal mirror has no glass, else `traced`."""
    noise_px: float = 0.1
    """Of exact pixels: standard deviation, one axis."""
    view: View = field(default_factory=View)
    stand_error_rad: float = 0.0
    """Error of a stand that is turned by hand (standard deviation of yaw and of pitch)."""
    glass_thickness_m: float | None = None
    """Of the real mirror; None: as the nominal session has it. MuJoCo's own renderer has no glass."""
    encoders: bool = False
    """Whether `command` reports measured positions, those of the motors: encoders do not see a play or a spring behind them."""
    seed: int = 0


class MujocoRobot(SimulatedStand, RobotBase):
    """A robot in MuJoCo that can turn before its mirror (`TurnsView`).

    `model` is a URDF or MJCF (by default the nominal URDF) with the nominal session's joints, and a body or site for each
    of its links that the session names (camera, board, markers). A free root joint is taken out: the root stands still.
    """

    def __init__(
        self,
        hidden: Sequence[HiddenEffect] = (),
        options: MujocoOptions | None = None,
        nominal: Nominal | None = None,
        *,
        model: str | os.PathLike[str] | None = None,
        limits: Mapping[str, JointLimits] | None = None,
        name: str = "mujoco",
    ) -> None:
        nominal = nominal or Nominal.load()
        super().__init__(nominal, name=name, limits=limits)
        self.options = options or MujocoOptions()
        metadata = nominal.metadata
        if metadata.board is None or metadata.camera_link is None:
            raise MirrorPostureError(
                f"{nominal.folder}: a robot before a mirror needs [camera_mount] and [board]"
            )
        spec = read_spec(Path(model) if model is not None else nominal.robot_file)
        way = self._way()
        if way == "rendered":
            from mirror_posture.shapes.mujoco_picture import dress

            dress(spec, nominal)
        gravity = np.asarray(metadata.gravity_m_per_s2, dtype=float)
        # All joints of the nominal model are held by servos, those that may not be commanded as well.
        held = tuple(nominal.joint_limits)
        self._true = build(spec, held, metadata.root, gravity, hidden, self.options.servo)
        self.model, self.data = self._true.model, mujoco.MjData(self._true.model)
        self._lens = lens_of(nominal) if way == "pixels" else None
        self._painter: Painter | None = None
        self._renderer: MirrorRenderer | None = None
        if way == "rendered":
            from mirror_posture.shapes.mujoco_picture import MirrorRenderer

            self._renderer = MirrorRenderer(self.model, nominal)
        if way == "traced":
            from mirror_posture.render import Painter

            self._painter = Painter.load(nominal.folder)
        self._random = np.random.default_rng(self.options.seed)
        self._looks = 0
        links = {str(metadata.camera_link), metadata.board.link, *(m.link for m in metadata.markers)}
        # The tracer draws every link of the URDF; otherwise only the links that the session names are needed.
        self._links = sorted(links) if way != "traced" else list(nominal.robot.link_names)
        self._held = dict.fromkeys(held, 0.0)
        self._told = self._targets(self._held)
        for joint, index in self._true.qpos.items():
            self.data.qpos[index] = self._told[joint]
        mujoco.mj_forward(self.model, self.data)
        self._board_in_root = self.link_poses()[metadata.board.link][:3, 3].copy()
        self._stand(self.options.view, self.options.stand_error_rad, self._random)
        self._move(dict(self.commanded))

    def link_poses(self) -> dict[str, Floats]:
        """`root_from_link` (4, 4) of the links that a look needs: the true ones."""
        at, turn = frame_of(self.model, self.data, self.nominal.metadata.root)
        poses = {}
        for link in self._links:
            origin, rotation = frame_of(self.model, self.data, link)
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = turn.T @ rotation, turn.T @ (origin - at)
            poses[link] = pose
        return poses

    def marker_truth_m(self) -> dict[str, Floats]:
        """The true places of the balls in the root's frame, m: for tests and figures; a robot does not know them."""
        poses = self.link_poses()
        return {marker.name: poses[marker.link][:3, 3] for marker in self.nominal.metadata.markers}

    def _way(self) -> Way:
        way = self.options.way
        if way == "auto":
            from mirror_posture.shapes.mujoco_picture import opengl_is_there

            claimed = self.nominal.metadata.mirror
            glass = 0.0 if claimed is None else claimed.glass_thickness_m
            return "rendered" if glass == 0.0 and opengl_is_there() else "traced"
        if way not in ("pixels", "traced", "rendered"):
            raise MirrorPostureError(f"way: got {way!r}, needed one of pixels, traced, rendered, auto")
        return way

    def _targets(self, positions: Positions) -> dict[str, float]:
        """The commands that the servos really receive."""
        time_s, errors = float(self.data.time), self._true.servo_errors
        return {
            joint: q + sum(error(positions, time_s) for error in errors.get(joint, ()))
            for joint, q in positions.items()
        }

    def _move(self, positions: dict[str, float]) -> Positions:
        model, data = self.model, self.data
        self._held = self._held | positions
        start, goal = self._told, self._targets(self._held)
        servo = np.array([self._true.actuator[joint] for joint in goal])
        begin, end = (np.array([told[joint] for joint in goal]) for told in (start, goal))
        if not np.array_equal(begin, end):
            periods = max(1, round(MOVE_S / (CONTROL_STEPS * model.opt.timestep)))
            for share in np.linspace(0.0, 1.0, periods + 1)[1:]:
                data.ctrl[servo] = begin + share**3 * (10 - 15 * share + 6 * share**2) * (end - begin)
                mujoco.mj_step(model, data, CONTROL_STEPS)
        data.ctrl[servo] = end
        self._told = goal
        self._settle()
        mujoco.mj_forward(model, data)
        if not self.options.encoders:
            return {}
        return {joint: float(data.qpos[self._true.qpos[joint]]) for joint in self.joint_names}

    def _settle(self) -> None:
        model, data = self.model, self.data
        before, rate = data.qpos.copy(), np.inf
        for _ in range(round(SETTLE_LONGEST_S / SETTLE_CHECK_S)):
            mujoco.mj_step(model, data, round(SETTLE_CHECK_S / model.opt.timestep))
            if not np.isfinite(data.qpos).all():
                raise NotSettledError(
                    f"{self.name}: the simulation became unstable; use softer servos (a larger droop_rad)"
                )
            rate = np.abs(data.qpos - before).max(initial=0.0) / SETTLE_CHECK_S
            if rate < SETTLED_RAD_PER_S:
                return
            before = data.qpos.copy()
        if rate < CREEPING_RAD_PER_S and np.abs(data.qvel).max(initial=0.0) < CREEPING_RAD_PER_S:
            return
        moving = [
            model.joint(j).name for j in range(model.njnt) if abs(data.qvel[model.jnt_dofadr[j]]) > 1e-4
        ]
        raise NotSettledError(
            f"{self.name}: still moved after {SETTLE_LONGEST_S:g} s ({', '.join(moving) or 'slowly'})",
            joints=tuple(moving),
        )

    def _look(self) -> Look:
        self._looks += 1
        poses, claimed = self.link_poses(), self.nominal.metadata.mirror
        glass = self.options.glass_thickness_m
        if glass is None:
            glass = 0.0 if claimed is None else claimed.glass_thickness_m
        index = FLOAT_GLASS_INDEX if claimed is None else claimed.refractive_index
        normal = self._real_view.normal_in_root
        if self._lens is not None:
            distance = float(normal @ self._board_in_root) + self._real_view.distance_m
            mirror = MirrorInRoot(normal, distance, glass, index)
            points = exact_points(
                self.nominal, self._lens, poses, mirror, self.options.noise_px, self._random
            )
            return Look(self.commanded, self._now_s(), view=self._view, points=points)
        if self._renderer is not None:
            at, turn = frame_of(self.model, self.data, self.nominal.metadata.root)
            center = at + turn @ (self._board_in_root + self._real_view.distance_m * normal)
            picture = self._renderer.picture(self.data, center, turn @ normal)
        else:
            assert self._painter is not None
            from mirror_posture.render import PictureOptions, view_planes

            drawn = self._painter.draw(
                poses,
                view_planes([self._real_view], self._board_in_root)[0],
                PictureOptions(glass_thickness_m=glass, refractive_index=index),
                seed=self.options.seed * 100_003 + self._looks,
            )
            picture = np.ascontiguousarray(drawn.picture[..., ::-1])
        return Look(self.commanded, self._now_s(), view=self._view, picture_bgr=picture)

    def _rest(self) -> None:
        # A simulated body needs no stop.
        return

    def _close(self) -> None:
        if self._renderer is not None:
            self._renderer.close()

    def _now_s(self) -> float:
        return float(self.data.time)
