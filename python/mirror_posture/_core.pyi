"""Typed stub of the compiled core; checked against the module by mypy's stubtest."""

import os
from collections.abc import Mapping, Sequence
from typing import Any, Literal, final

import numpy as np
import numpy.typing as npt

_Array = npt.NDArray[np.float64]
_Mask = npt.NDArray[np.bool_]

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
    def link_poses(self, positions: npt.ArrayLike, links: Sequence[str]) -> _Array: ...
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
    def up_in_link(
        self,
        positions: npt.ArrayLike,
        link: str,
        gravity_in_held_link: npt.ArrayLike,
        held_link: str,
        errors: Sequence[tuple[str, npt.ArrayLike, npt.ArrayLike]],
    ) -> _Array: ...

def rms_angles(a: npt.ArrayLike, b: npt.ArrayLike) -> tuple[float, float]: ...

@final
class PictureMaker:
    """Renders a robot in front of a mirror by ray tracing, with the truth of what it rendered."""

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

@final
class Camera:
    def __new__(
        cls,
        size_px: tuple[int, int],
        focal_px: tuple[float, float],
        center_px: tuple[float, float],
        distortion_model: str = "none",
        distortion: Sequence[float] = ...,
    ) -> Camera: ...
    @property
    def size_px(self) -> tuple[int, int]: ...
    @property
    def focal_px(self) -> tuple[float, float]: ...
    @property
    def center_px(self) -> tuple[float, float]: ...
    @property
    def distortion(self) -> list[float]: ...
    def project(self, points_in_camera_m: npt.ArrayLike) -> _Array: ...
    def unproject(self, pixels_px: npt.ArrayLike) -> _Array: ...

@final
class Rig:
    def __new__(
        cls,
        camera: Camera,
        corners: tuple[int, int],
        square_m: float,
        camera_from_board: npt.ArrayLike,
        camera_from_board_covariance: npt.ArrayLike | None = None,
        glass_thickness_m: float = 0.0,
        refractive_index: float = ...,
    ) -> Rig: ...
    def estimate_mirrors(
        self,
        corners_px: npt.ArrayLike,
        estimator: str = "maximum_likelihood",
        noise_px: float | None = None,
        loss: str = "squared",
    ) -> Mirrors: ...

@final
class Mirrors:
    def __len__(self) -> int: ...
    @property
    def valid(self) -> _Mask: ...
    @property
    def reasons(self) -> dict[int, str]: ...
    @property
    def normals(self) -> _Array: ...
    @property
    def offsets_m(self) -> _Array: ...
    @property
    def covariances_m2(self) -> _Array: ...
    @property
    def measurement_covariances_m2(self) -> _Array: ...
    @property
    def foot_by_camera_from_board(self) -> _Array: ...
    @property
    def camera_from_virtual(self) -> _Array: ...
    @property
    def rms_px(self) -> _Array: ...
    @property
    def noise_px(self) -> _Array: ...

@final
class PlanarPoses:
    def __len__(self) -> int: ...
    @property
    def valid(self) -> _Mask: ...
    @property
    def reasons(self) -> dict[int, str]: ...
    @property
    def camera_from_pattern(self) -> _Array: ...
    @property
    def covariances(self) -> _Array: ...
    @property
    def rms_px(self) -> _Array: ...
    @property
    def noise_px(self) -> _Array: ...
    @property
    def alternative_rms_px(self) -> _Array: ...

@final
class VirtualRays:
    def __len__(self) -> int: ...
    @property
    def valid(self) -> _Mask: ...
    @property
    def reasons(self) -> dict[int, str]: ...
    @property
    def origins_m(self) -> _Array: ...
    @property
    def directions(self) -> _Array: ...
    @property
    def covariances(self) -> _Array: ...

@final
class Markers:
    def __len__(self) -> int: ...
    @property
    def valid(self) -> _Mask: ...
    @property
    def reasons(self) -> dict[int, str]: ...
    @property
    def points_in_camera_m(self) -> _Array: ...
    @property
    def covariances_m2(self) -> _Array: ...
    @property
    def measurement_covariances_m2(self) -> _Array: ...
    @property
    def point_by_camera_from_board(self) -> _Array: ...
    @property
    def parallax_rad(self) -> _Array: ...
    @property
    def rms_ray_distance_m(self) -> _Array: ...
    @property
    def rms_px(self) -> _Array: ...
    @property
    def chi_squared(self) -> _Array: ...

@final
class PointBatch:
    @property
    def valid(self) -> _Mask: ...
    @property
    def reasons(self) -> dict[int, str]: ...
    @property
    def points_in_camera_m(self) -> _Array: ...

def planar_poses(
    camera: Camera,
    corners: tuple[int, int],
    square_m: float,
    corners_px: npt.ArrayLike,
    noise_px: float | None = None,
    loss: str = "squared",
) -> PlanarPoses: ...
def virtual_rays(
    mirrors: Mirrors, mirror_rows: npt.NDArray[np.int64], pixels_px: npt.ArrayLike, noise_px: float
) -> VirtualRays: ...
def triangulate(
    mirrors: Mirrors,
    mirror_rows: npt.NDArray[np.int64],
    pixels_px: npt.ArrayLike,
    noise_px: float,
    triangulator: str = "maximum_likelihood",
    least_parallax_rad: float | None = None,
) -> Markers: ...
def two_view_markers(
    camera: Camera,
    board_in_camera_m: npt.ArrayLike,
    reflected_boards_m: npt.ArrayLike,
    pixels_px: npt.ArrayLike,
    least_parallax_rad: float | None = None,
) -> PointBatch: ...

@final
class MeasureInput:
    def __new__(
        cls,
        *,
        camera: Camera,
        board_corners: tuple[int, int],
        square_m: float,
        diameters_m: Sequence[float],
        glass_thickness_m: float,
        refractive_index: float,
        posture: Sequence[int],
        camera_from_board: npt.ArrayLike,
        board_px: npt.ArrayLike,
        board_seen: npt.ArrayLike,
        marker_px: npt.ArrayLike,
        marker_seen: npt.ArrayLike,
        direct_px: npt.ArrayLike,
        direct_seen: npt.ArrayLike,
    ) -> MeasureInput: ...
    @property
    def mirrors_refused(self) -> list[str | None]: ...
    def ladder(
        self,
        estimator: str,
        *,
        corner_noise_px: float | None = None,
        marker_noise_px: float,
        least_parallax_rad: float,
        camera_from_board_covariance: npt.ArrayLike | None = None,
    ) -> Measured: ...
    def joint(
        self,
        *,
        corner_noise_px: float,
        marker_noise_px: float,
        least_parallax_rad: float,
        camera_from_board_covariance: npt.ArrayLike | None = None,
    ) -> Measured: ...

@final
class Measured:
    @property
    def mirror_reason(self) -> list[str | None]: ...
    @property
    def foot_m(self) -> _Array: ...
    @property
    def foot_covariance_m2(self) -> _Array: ...
    @property
    def corner_rms_px(self) -> _Array: ...
    @property
    def posture(self) -> npt.NDArray[np.int64]: ...
    @property
    def marker(self) -> npt.NDArray[np.int64]: ...
    @property
    def marker_reason(self) -> list[str | None]: ...
    @property
    def point_in_camera_m(self) -> _Array: ...
    @property
    def point_covariance_m2(self) -> _Array: ...
    @property
    def point_chi_squared(self) -> _Array: ...
    @property
    def point_degrees_of_freedom(self) -> npt.NDArray[np.int64]: ...
    @property
    def camera_from_nominal_camera(self) -> _Array: ...
    @property
    def camera_from_board_covariance(self) -> _Array | None: ...
    @property
    def chi_squared(self) -> float | None: ...
    @property
    def degrees_of_freedom(self) -> int | None: ...

@final
class CheckedViews:
    @property
    def board_rms_px(self) -> float: ...
    @property
    def marker_px(self) -> float | None: ...
    @property
    def noise_px(self) -> float: ...
    @property
    def mistake(self) -> str: ...
    @property
    def readings(self) -> list[tuple[str, str, str, str, float]]: ...

def check_views(
    camera: Camera,
    corners: tuple[int, int],
    square_m: float,
    camera_from_board: npt.ArrayLike,
    board_px: npt.ArrayLike,
    marker_px: npt.ArrayLike,
    marker_seen: npt.ArrayLike,
    marker_in_camera_m: npt.ArrayLike,
    glass_thickness_m: float,
    refractive_index: float,
    noise_px: float,
    gross: bool = False,
) -> CheckedViews: ...

@final
class CorrectionStep:
    @property
    def change(self) -> _Array: ...
    @property
    def at_limit(self) -> list[bool]: ...
    @property
    def mu_m_per_rad(self) -> float: ...
    @property
    def scale(self) -> float: ...

def correction_step(
    jacobian: npt.ArrayLike,
    error_m: npt.ArrayLike,
    covariance_m2: npt.ArrayLike,
    positions: npt.ArrayLike,
    lower: npt.ArrayLike,
    upper: npt.ArrayLike,
    free: Sequence[bool],
    *,
    gain: float,
    largest_step_rad: float,
    mu_m_per_rad: float | None = None,
    step_std_rad: float | None = None,
) -> CorrectionStep: ...

@final
class Corrector:
    def __new__(
        cls,
        robot: Robot,
        *,
        camera_link: str,
        board_link: str,
        markers: Sequence[tuple[str, str]],
        posture: npt.ArrayLike,
        held: Sequence[str],
        start: npt.ArrayLike | None = None,
        gain: float,
        largest_step_rad: float,
        mu_m_per_rad: float | None,
        step_std_rad: float | None,
        jacobian: str,
        tolerance_m: float,
        wrong_converged: float,
        looks: int,
        patience: int,
        least_progress: float,
        divergence: float,
        retries: int,
        largest_gap_m: float,
        play_m: float,
        largest_correction_rad: float,
    ) -> Corrector: ...
    @property
    def target_in_board_m(self) -> _Array: ...
    def narrow(self, joint: str, lower: float, upper: float) -> None: ...
    @property
    def free(self) -> list[bool]: ...
    @property
    def command(self) -> _Array: ...
    @property
    def best_command(self) -> _Array | None: ...
    def records(self) -> str: ...
    def responses(self) -> str: ...
    def observe(
        self,
        measured: Sequence[bool],
        point_in_board_m: npt.ArrayLike,
        covariance_m2: npt.ArrayLike,
        chi_squared: npt.ArrayLike,
        degrees_of_freedom: Sequence[int],
    ) -> str: ...

@final
class SeenInMirror:
    def __len__(self) -> int: ...
    @property
    def valid(self) -> npt.NDArray[np.bool_]: ...
    @property
    def reasons(self) -> dict[int, str]: ...
    @property
    def pixels_px(self) -> _Array: ...
    @property
    def by_point(self) -> _Array: ...
    @property
    def by_foot_point(self) -> _Array: ...
    @property
    def by_thickness(self) -> _Array: ...
    @property
    def by_curvature(self) -> _Array: ...

def see_in_mirror(
    camera: Camera,
    foot_points_m: npt.ArrayLike,
    points_in_camera_m: npt.ArrayLike,
    glass_thickness_m: float,
    refractive_index: float,
    curvature_per_m: float,
) -> SeenInMirror: ...
def ball_centroids(
    camera: Camera, centers_in_camera_m: npt.ArrayLike, diameter_m: float
) -> tuple[_Array, npt.NDArray[np.bool_], dict[int, str]]: ...
def ball_center_pixels(
    camera: Camera, centroids_px: npt.ArrayLike, diameter_m: float, distances_m: npt.ArrayLike
) -> tuple[_Array, npt.NDArray[np.bool_], dict[int, str]]: ...

@final
class BallOutline:
    @property
    def centroid_px(self) -> tuple[float, float]: ...
    @property
    def centroid_covariance_px2(self) -> _Array: ...
    @property
    def sphere_center_px(self) -> tuple[float, float]: ...
    @property
    def ellipse(self) -> tuple[float, float, float, float, float]: ...
    @property
    def boundary_px(self) -> _Array: ...
    @property
    def mean_radius_px(self) -> float: ...
    @property
    def arc_fraction(self) -> float: ...
    @property
    def residual_rms_px(self) -> float: ...
    @property
    def blur_px(self) -> float: ...
    @property
    def narrow_blur_px(self) -> float: ...
    @property
    def lens_blur_px(self) -> float: ...
    @property
    def curve_deviations(self) -> float | None: ...
    @property
    def curve_moved_px(self) -> tuple[float, float]: ...

def measure_balls(
    bgr: npt.NDArray[np.uint8],
    circles_px: npt.ArrayLike,
    radii_px: npt.ArrayLike,
    camera: Camera,
    chroma_step_px: tuple[int, int],
    curve: float,
) -> list[BallOutline | None]: ...
def codec_covariances(
    bgr: npt.NDArray[np.uint8],
    circles_px: npt.ArrayLike,
    radii_px: npt.ArrayLike,
    camera: Camera,
    chroma_step_px: tuple[int, int],
    steps: list[list[int]],
    sampling: tuple[int, int],
    blurs_px: list[float | None],
) -> list[list[float] | None]: ...
def measure_blurred_balls(
    bgr: npt.NDArray[np.uint8], expected_px: list[list[float]], camera: Camera, curve: float
) -> list[BallOutline | None]: ...

@final
class PatternGhost:
    @property
    def strength(self) -> float: ...
    @property
    def shift_px(self) -> tuple[float, float]: ...
    @property
    def weakest(self) -> float: ...
    def explained_by(self, ends_px: npt.ArrayLike) -> float: ...

def pattern_ghost(
    light: npt.NDArray[np.float32], models: list[npt.NDArray[np.float32]], reach_px: int
) -> PatternGhost | None: ...
def pattern_curve(
    levels: npt.NDArray[np.uint8],
    pattern: npt.NDArray[np.float32],
    shared_pixels: float,
    ink_px: float,
    sharpening: tuple[npt.NDArray[np.float32], float] | None,
) -> tuple[float, float] | None: ...
def drawn_pattern(
    grid_from_px: npt.NDArray[np.float64] | list[list[float]], first_px: list[float], size: tuple[int, int]
) -> npt.NDArray[np.float32]: ...
def levels_without_ghost(
    light: list[npt.NDArray[np.float32]], part: list[int], ratio: float, levels: npt.NDArray[np.uint8]
) -> npt.NDArray[np.uint8]: ...
def find_rests(
    time_s: npt.ArrayLike, positions: npt.ArrayLike, tolerance: float, least_s: float
) -> _Array: ...
def match_clocks(
    time_s: npt.ArrayLike,
    positions: npt.ArrayLike,
    picture_s: npt.ArrayLike,
    motion: npt.ArrayLike,
    most_s: float,
) -> tuple[float, float, bool]: ...
def plain_png(content: bytes) -> npt.NDArray[np.uint8] | None: ...
def chroma_step(bgr: npt.NDArray[np.uint8]) -> tuple[int, int]: ...
def color_regions(
    bgr: npt.NDArray[np.uint8],
    colors: list[list[float]],
    least_area_px: int,
    most: int,
) -> list[list[tuple[int, tuple[float, float], list[int], npt.NDArray[np.bool_]]]]: ...
def fit_circle_by_consensus(
    points_px: npt.ArrayLike, min_radius_px: float, max_radius_px: float, tolerance_px: float
) -> tuple[float, float, float] | None: ...

_Direction = tuple[str, Literal["rotation", "translation"], list[float], float]

@final
class CameraBoardCalibration:
    @property
    def camera_from_board(self) -> _Array: ...
    @property
    def covariance(self) -> _Array: ...
    @property
    def weakness(self) -> tuple[_Direction, _Direction, _Direction | None, str | None]: ...
    @property
    def views(self) -> npt.NDArray[np.int64]: ...
    @property
    def reasons(self) -> dict[int, str]: ...
    @property
    def normals(self) -> _Array: ...
    @property
    def offsets_m(self) -> _Array: ...
    @property
    def plane_covariances_m2(self) -> _Array: ...
    @property
    def reprojection_mean_px(self) -> float: ...
    @property
    def view_rms_px(self) -> _Array: ...
    @property
    def corner_std_px(self) -> float: ...
    @property
    def determined(self) -> bool: ...

def calibrate_mirror_views(
    camera: Camera,
    corners: tuple[int, int],
    square_m: float,
    corners_px: npt.ArrayLike,
    corner_std_px: float | None,
    loss: str,
    nominal_camera_from_board: npt.ArrayLike | None,
    nominal_covariance: npt.ArrayLike | None,
    gate_px: float,
    glass_thickness_m: float,
    refractive_index: float,
) -> CameraBoardCalibration: ...

@final
class SecondCameraCalibration:
    @property
    def camera_from_board(self) -> _Array: ...
    @property
    def covariance(self) -> _Array: ...
    @property
    def weakness(self) -> tuple[_Direction, _Direction, _Direction | None, str | None]: ...
    @property
    def chi_squared(self) -> float: ...
    @property
    def degrees_of_freedom(self) -> int: ...
    @property
    def snapshot_camera_from_board(self) -> _Array: ...
    @property
    def snapshot_covariances(self) -> _Array: ...
    @property
    def snapshot_chi_squared(self) -> _Array: ...
    @property
    def snapshot_rms_px(self) -> _Array: ...

def calibrate_second_camera(
    robot_camera: Camera,
    second_camera: Camera,
    chest_board: tuple[int, int, float],
    stand_board: tuple[int, int, float],
    stand_in_robot_camera_px: npt.ArrayLike,
    stand_in_second_camera_px: npt.ArrayLike,
    chest_in_second_camera_px: npt.ArrayLike,
) -> SecondCameraCalibration: ...

_ViewArrays = Any
"""An object with board_px (F, corners, 2), board_seen (F, corners), marker_px (F, markers, 2), marker_seen (F, markers)."""

_OwnEffect = Any
"""An object with name, words, parameters [(name, prior_std, axis or None)] and places [(at, weights (F, parameters))]."""

@final
class GapRecording:
    def __new__(
        cls,
        urdf: str,
        header: str,
        frame: npt.NDArray[np.int64],
        posture: npt.NDArray[np.int64],
        time_s: _Array,
        commanded: _Array,
        mirror: _ViewArrays,
        direct: _ViewArrays,
        points: _Array | None = None,
        points_seen: _Mask | None = None,
    ) -> GapRecording: ...
    def diagnose(
        self,
        without: Sequence[str] = ...,
        most_causes: int = 0,
        others: Sequence[tuple[str, GapRecording, Sequence[_OwnEffect]]] = ...,
        own: Sequence[_OwnEffect] = ...,
        markers: bool = False,
        progress: DiagnosisProgress | None = None,
    ) -> str: ...
    def quantities(self) -> dict[str, Any]: ...
    def link_bends(self) -> list[tuple[str, list[float], list[list[float]]]]: ...

@final
class PlannedSession:
    def __new__(cls, recording: GapRecording) -> PlannedSession: ...
    def choose(
        self,
        frames: Sequence[Sequence[int]],
        block: Sequence[int],
        posture: Sequence[int],
        most: Sequence[int],
    ) -> list[int]: ...
    def foresee(
        self,
    ) -> list[tuple[str, str, list[tuple[str, float | None]], list[tuple[str, str, float | None]]]]: ...

@final
class DiagnosisProgress:
    def __new__(cls) -> DiagnosisProgress: ...
    @property
    def stage(self) -> tuple[str, int]: ...
    def so_far(self, recording: GapRecording) -> str: ...

@final
class FeedForward:
    def __new__(
        cls,
        robot: Robot,
        held_link: str,
        gravity_in_held_link_m_per_s2: _Array,
        errors: Sequence[tuple[str, str, float, str | None]],
    ) -> FeedForward: ...
    @property
    def has_way_points(self) -> bool: ...
    @property
    def corrected(self) -> list[int]: ...
    def commands(self, wanted: _Array) -> tuple[_Array, _Array]: ...

def effects() -> list[dict[str, Any]]: ...
def mistakes() -> list[dict[str, Any]]: ...
