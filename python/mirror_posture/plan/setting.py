"""The robot in front of its mirror: frames, movable joints, home posture."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .._core import MirrorPostureError
from ..arrays import Floats, Integers
from ..board import Board
from ..camera import Camera
from ..robots.nominal import Nominal
from .options import MirrorPlace, PlanOptions

FROM_THE_END = 0.03
"""Share of a joint's range that is left at either end."""
WIDEST_RAD = 2.5
"""Of a joint without limits, to either side of home."""
NEAR_HOME = (0.15, 0.35, 0.7)
"""Besides postures from the whole ranges some are drawn nearer to home, where more of them are in sight."""
USUAL_NOISE_PX = 0.15
LEVEL_RAD = math.radians(45.0)
SMALLEST_LEVEL = 1e-6
"""Share of a direction that must be level, so that up is another direction."""


@dataclass(frozen=True, eq=False)
class Setting:
    """The start of a plan. Everything is in the frame of the robot's first link, the base."""

    nominal: Nominal
    camera: Camera
    board: Board
    camera_link: str
    home: Floats
    """(nq,)."""
    low: Floats
    high: Floats
    """(nq,): where joints may be sent; both at home for those that are held."""
    moving: Integers
    """Columns of the joints that the plan moves."""
    up: Floats
    forward: Floats
    """From the robot to the mirror, level."""
    base_from_root: Floats
    noise_px: float

    def in_root(self, mirror: MirrorPlace) -> MirrorPlace:
        """A mirror of the base's frame, in the root's frame."""
        turn = self.base_from_root[:3, :3].T
        return mirror.moved(turn, -turn @ self.base_from_root[:3, 3])

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints that the plan moves."""
        return tuple(self.nominal.robot.position_names[k] for k in self.moving)

    @property
    def carrying_all(self) -> tuple[str, ...]:
        """Joints that carry camera, board and balls alike: nothing in the pictures changes with them."""
        robot, first = self.nominal.robot, self.nominal.robot.link_names[0]
        links = [self.camera_link, self.board.link, *(m.link for m in self.nominal.metadata.markers)]
        chains = [{step.joint for step in robot.chain(first, link)} for link in links]
        common = set.intersection(*chains)
        return tuple(name for name in robot.position_names if name in common)

    @property
    def radii_m(self) -> Floats:
        """(M,) of the balls."""
        return np.array([0.5 * marker.diameter_m for marker in self.nominal.metadata.markers])

    def torques_nm(self, positions: Floats) -> Floats:
        """Gravity's torques (N, nq) on the joints in postures (N, nq)."""
        metadata = self.nominal.metadata
        return self.nominal.robot.gravity_torques(positions, metadata.gravity_m_per_s2, metadata.root)


def read_setting(nominal: Nominal, options: PlanOptions) -> Setting:
    """A session's folder, prepared for planning.

    Raises:
        MirrorPostureError: no camera, board or markers; a joint that the robot does not have; no joint between camera and markers; a board that looks away from where the camera looks.
    """
    metadata, robot = nominal.metadata, nominal.robot
    if (
        nominal.camera is None
        or metadata.camera_link is None
        or metadata.board is None
        or not metadata.markers
    ):
        raise MirrorPostureError(
            f"{nominal.folder}: a plan needs a camera, a [board] and [[markers]] in session.toml; "
            "mirror-posture init writes them"
        )
    names = robot.position_names
    for option, joints in (("--home", options.home), ("--hold", options.held)):
        for name in joints:
            robot.position_index(name)  # its error lists the nearest names
            if name not in names:
                raise MirrorPostureError(f"{option}: {name!r} does not move by itself")
    limits = nominal.joint_limits
    low = np.array([limits[name].lower for name in names])
    high = np.array([limits[name].upper for name in names])
    home = np.array([float(options.home.get(name, 0.0)) for name in names])
    for name, value, least, most in zip(names, home, low, high, strict=True):
        if name in options.home and not least <= value <= most:
            raise MirrorPostureError(
                f"--home {name}: got {value:g}, needed {least:g} to {most:g}, its limits"
            )
    home = np.clip(home, low, high)
    low, high = np.maximum(low, home - WIDEST_RAD), np.minimum(high, home + WIDEST_RAD)
    inset = FROM_THE_END * (high - low)
    low, high = np.minimum(low + inset, home), np.maximum(high - inset, home)
    camera_link, board_link = metadata.camera_link, metadata.board.link
    between = {step.joint for m in metadata.markers for step in robot.chain(camera_link, m.link)}
    head = {step.joint for step in robot.chain(camera_link, board_link)}
    moves = {
        joint.position: joint.name
        for joint in robot.joints
        if joint.position is not None and joint.name in between and joint.name not in head
    }
    moving = np.array(sorted(k for k in moves if names[k] not in options.held), dtype=np.int64)
    if not len(moving):
        raise MirrorPostureError(
            f"{nominal.folder}: no joint that may move lies between the camera and a marker; put the balls on other links"
        )
    still = np.setdiff1d(np.arange(len(names)), moving)
    low[still] = high[still] = home[still]
    base = robot.link_names[0]
    poses = robot.link_poses(home[None], [base, metadata.root, camera_link, board_link])[0]
    base_from = np.linalg.inv(poses[0]) @ poses
    gravity = base_from[1, :3, :3] @ np.asarray(metadata.gravity_m_per_s2, dtype=float)
    up = -gravity / np.linalg.norm(gravity)
    looks, faces = base_from[2, :3, 2], base_from[3, :3, 2]
    forward = looks + faces
    if float(looks @ faces) < 0.2:
        angle = math.degrees(math.acos(float(np.clip(looks @ faces, -1, 1))))
        raise MirrorPostureError(
            f"{nominal.folder}: at home the camera and the board's face look {angle:.0f}° apart; no mirror shows the camera the "
            "board's face; turn one of them (init --camera-looks, --board-faces), or give another --home"
        )
    level = forward - (forward @ up) * up
    if np.linalg.norm(level) < SMALLEST_LEVEL * np.linalg.norm(forward):
        raise MirrorPostureError(
            f"{nominal.folder}: at home the camera and the board's face look straight {'up' if forward @ up > 0.0 else 'down'}; needed a "
            "way to one side, which says where a mirror's top is; tilt both a little (init --camera-looks, --board-faces), or give another --home"
        )
    if np.linalg.norm(level) > math.cos(LEVEL_RAD) * np.linalg.norm(forward):
        forward = level
    noise = options.noise_px or metadata.noise.pixel_std_px or USUAL_NOISE_PX
    return Setting(
        nominal, nominal.camera, metadata.board, camera_link, home, low, high, moving,
        up, forward / np.linalg.norm(forward), base_from[1], noise,
    )  # fmt: skip


def draw(setting: Setting, count: int, random: np.random.Generator) -> Floats:
    """Random postures (count, nq) within the limits, home among them."""
    low, high, home = setting.low, setting.high, setting.home
    uniform = low + (high - low) * random.random((count, len(home)))
    scale = random.choice([1.0, *NEAR_HOME], size=(count, 1))
    found: Floats = np.clip(home + scale * (uniform - home), low, high)
    found[0] = home
    return found
