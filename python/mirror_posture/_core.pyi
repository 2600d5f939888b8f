"""Typed stub of the compiled core; checked against the module by mypy's stubtest."""

import os
from collections.abc import Mapping, Sequence
from typing import Any, Literal, final

import numpy as np
import numpy.typing as npt

_Array = npt.NDArray[np.float64]

__version__: str

class MirrorPostureError(Exception): ...

@final
class Robot:
    @staticmethod
    def from_urdf_file(path: str | os.PathLike[str]) -> Robot: ...
    @staticmethod
    def from_urdf_str(text: str) -> Robot: ...
    @property
    def name(self) -> str: ...
    @property
    def link_names(self) -> list[str]: ...
    @property
    def joint_names(self) -> list[str]: ...
    @property
    def position_names(self) -> list[str]: ...
    @property
    def masses_kg(self) -> _Array: ...
    @property
    def coms_in_link_m(self) -> _Array: ...
    @property
    def joint_kinds(self) -> list[Literal["revolute", "continuous", "prismatic", "fixed"]]: ...
    @property
    def joint_parent_links(self) -> list[int]: ...
    @property
    def joint_axes(self) -> _Array: ...
    @property
    def joint_limits(self) -> _Array: ...
    @property
    def parent_from_joint(self) -> _Array: ...
    @property
    def joint_positions(self) -> list[int | None]: ...
    @property
    def joint_multipliers(self) -> _Array: ...
    @property
    def joint_offsets(self) -> _Array: ...
    def link_index(self, name: str) -> int: ...
    def joint_index(self, name: str) -> int: ...
    def position_index(self, name: str) -> int: ...
    def chain_joints(self, link_a: str, link_b: str) -> list[int]: ...
    def chain_signs(self, link_a: str, link_b: str) -> list[float]: ...
    def forward_kinematics(self, positions: npt.ArrayLike) -> _Array: ...
    def joint_twists(self, positions: npt.ArrayLike) -> _Array: ...
    def points(
        self, positions: npt.ArrayLike, in_link: str, link: str, point_in_link_m: npt.ArrayLike
    ) -> _Array: ...
    def point_jacobians(
        self, positions: npt.ArrayLike, in_link: str, link: str, point_in_link_m: npt.ArrayLike
    ) -> _Array: ...
    def gravity_torques(
        self, positions: npt.ArrayLike, gravity_in_held_link: npt.ArrayLike, held_link: str
    ) -> _Array: ...
    def gravity_moments(
        self, positions: npt.ArrayLike, gravity_in_held_link: npt.ArrayLike, held_link: str
    ) -> _Array: ...
class PictureMaker:
    """Draws a robot before a mirror by tracing rays, and tells the truth of what it drew."""

    def __new__(
        cls,
        urdf: str,
        *,
        size_px: tuple[int, int],
        focal_px: tuple[float, float],
        center_px: tuple[float, float],
        distortion: Sequence[float],
        camera_link: str,
        board: tuple[str, int, int, float] | None,
        balls: Sequence[tuple[str, str, float, Sequence[float]]],
    ) -> PictureMaker: ...
    @property
    def skipped_meshes(self) -> list[str]: ...
    def link_poses(self, positions: Mapping[str, float]) -> dict[str, npt.NDArray[np.float64]]: ...
    def draw(
        self,
        link_poses: Mapping[str, npt.ArrayLike],
        *,
        mirror_center_m: Sequence[float],
        mirror_normal: Sequence[float],
        glass_thickness_m: float,
        refractive_index: float,
        curvature_per_m: float,
        mirror_size_m: tuple[float, float],
        ghosts: bool,
        floor_m: float,
        grid: int,
        edge_grid: int,
        motion_px: Sequence[float],
        blur_px: float,
        exposure: float,
        full_well_electrons: float | None,
        read_noise_electrons: float,
        gamma: float,
        jpeg_quality: int | None,
        seed: int,
    ) -> tuple[npt.NDArray[np.uint8], dict[str, Any]]: ...
