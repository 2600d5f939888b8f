"""What a detection needs to know and what it gives back: plain frozen dataclasses, units in their names.

Pixels are `(u, v)` with (0, 0) at the centre of the top-left pixel. Board corners are in the order of the session
format, `index = iy * corners_x + ix`; the board frame has z out of the printed face.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from .._core import MirrorPostureError

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
# A picture's pixels, of whatever type OpenCV gave them.
Pixels = npt.NDArray[Any]
Via = Literal["mirror", "direct"]
CentreKind = Literal["outline_centroid", "region_centroid"]

CHESSBOARD = "chessboard"
CHARUCO = "charuco"


class DetectionError(MirrorPostureError):
    """Input that detection cannot work with: what was got, what is needed, and the fix."""


@dataclass(frozen=True)
class BoardSpec:
    """The printed board: inner corners along x and y, side of a square in m."""

    corners_x: int
    corners_y: int
    square_m: float
    pattern: str = CHESSBOARD
    marker_size_m: float | None = None
    dictionary: str | None = None

    def __post_init__(self) -> None:
        if self.corners_x < 3 or self.corners_y < 3:
            raise DetectionError(
                f"board corners = [{self.corners_x}, {self.corners_y}]: detection needs at least 3 inner corners each way; "
                "count the points where four squares meet, not the squares"
            )
        if not (math.isfinite(self.square_m) and self.square_m > 0.0):
            raise DetectionError(f"board square = {self.square_m}: needs a positive side in m")
        if self.pattern not in (CHESSBOARD, CHARUCO):
            raise DetectionError(
                f"board pattern = {self.pattern!r}: valid are {CHESSBOARD!r} and {CHARUCO!r}"
            )
        if self.pattern == CHARUCO:
            if self.marker_size_m is None or self.dictionary is None:
                raise DetectionError(
                    'a "charuco" board needs marker_size (m) and dictionary (such as "DICT_4X4_50")'
                )
            if not 0.0 < self.marker_size_m < self.square_m:
                raise DetectionError(
                    f"board marker_size = {self.marker_size_m}: must lie between 0 and the square's side {self.square_m}"
                )

    @property
    def corner_count(self) -> int:
        return self.corners_x * self.corners_y

    def points_in_board_m(self) -> FloatArray:
        """Corner positions in the board frame, `(N, 3)` in m, origin at the board's centre."""
        index = np.arange(self.corner_count)
        x = (index % self.corners_x - (self.corners_x - 1) / 2.0) * self.square_m
        y = (index // self.corners_x - (self.corners_y - 1) / 2.0) * self.square_m
        return np.stack([x, y, np.zeros(self.corner_count)], axis=1)


@dataclass(frozen=True)
class ColorSpec:
    """A marker's colour as a box in HSV: hue in degrees (circular), saturation and value in 0..1."""

    hue_deg: float
    hue_tolerance_deg: float
    min_saturation: float = 0.5
    min_value: float = 0.25

    def __post_init__(self) -> None:
        if not (math.isfinite(self.hue_deg) and 0.0 <= self.hue_deg < 360.0):
            raise DetectionError(f"color hue = {self.hue_deg}: needs degrees in [0, 360)")
        if not (math.isfinite(self.hue_tolerance_deg) and 0.0 < self.hue_tolerance_deg <= 180.0):
            raise DetectionError(f"color hue_tolerance = {self.hue_tolerance_deg}: needs degrees in (0, 180]")
        for name, value in (("min_saturation", self.min_saturation), ("min_value", self.min_value)):
            if not (math.isfinite(value) and 0.0 <= value <= 1.0):
                raise DetectionError(f"color {name} = {value}: needs a number in [0, 1] (not 0 to 255)")


@dataclass(frozen=True)
class MarkerSpec:
    """A coloured ball: name, diameter in m (0 for an ideal point), colour."""

    name: str
    diameter_m: float
    color: ColorSpec


@dataclass(frozen=True)
class CameraSpec:
    """The camera's intrinsics as OpenCV uses them: `K` (3, 3), distortion (none, 4, 5 or 8 numbers), size in px."""

    matrix: FloatArray
    distortion: FloatArray
    width_px: int
    height_px: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "matrix", np.asarray(self.matrix, dtype=np.float64).reshape(3, 3))
        object.__setattr__(self, "distortion", np.asarray(self.distortion, dtype=np.float64).reshape(-1))
        if not (np.isfinite(self.matrix).all() and np.isfinite(self.distortion).all()):
            raise DetectionError("camera: a number of the camera matrix or of the distortion is not finite")
        if len(self.distortion) not in (0, 4, 5, 8):
            raise DetectionError(
                f"camera: distortion has {len(self.distortion)} numbers; needed none, 4 or 5 (plumb_bob) or 8 (rational_polynomial)"
            )
        if self.matrix[0, 0] <= 0.0 or self.matrix[1, 1] <= 0.0:
            raise DetectionError(
                "camera: the focal lengths camera_matrix[0][0] and [1][1] must be positive (px)"
            )

    @property
    def focal_px(self) -> float:
        return float(np.sqrt(self.matrix[0, 0] * self.matrix[1, 1]))


@dataclass(frozen=True)
class PredictedMarker:
    """Where a marker is expected: centre and how far off that may be, in px; its expected radius if known."""

    name: str
    pixel_px: tuple[float, float]
    search_radius_px: float
    ball_radius_px: float | None = None


@dataclass(frozen=True)
class BoardPrediction:
    """What is known of the board beforehand. Either may be missing.

    `corners_px`: expected pixels of all corners, `(N, 2)`. `camera_from_board`: the board's pose before the camera (4, 4), from
    the robot model: it settles a mirrored view's labels, since only one labelling agrees with a reflection.
    """

    corners_px: FloatArray | None = None
    camera_from_board: FloatArray | None = None


@dataclass(frozen=True)
class DetectionSetup:
    """What to look for: the board (or None), the markers, the camera (or None: no calibrated gate)."""

    board: BoardSpec | None = None
    markers: tuple[MarkerSpec, ...] = ()
    camera: CameraSpec | None = None


@dataclass(frozen=True)
class BoardView:
    """One view of the board in one picture; `ok` is the mask, `reason` says why not.

    `corners_px` `(N, 2)` and `covariances_px2` `(N, 2, 2)` are in the order of the session format. They are kept for a refused view
    (so that an overlay can show it) and are None where nothing was found. `visible` `(N,)` is False for corners that were not measured (ChArUco): their numbers are 0.
    """

    ok: bool
    reason: str
    via: Via
    corners_px: FloatArray | None = None
    covariances_px2: FloatArray | None = None
    visible: npt.NDArray[np.bool_] | None = None
    residual_rms_px: float | None = None
    residual_limit_px: float | None = None
    method: str = ""
    attempts: tuple[str, ...] = ()
    corners_x: int = 0

    @property
    def grid_px(self) -> FloatArray | None:
        """The corners as a grid `(corners_y, corners_x, 2)`, where all of them were measured and labelled; else None."""
        if not self.ok or self.corners_px is None or self.corners_x == 0:
            return None
        if self.visible is not None and not self.visible.all():
            return None
        return self.corners_px.reshape(-1, self.corners_x, 2)

    @property
    def std_px(self) -> FloatArray | None:
        """Standard deviation of one axis of each corner, px: the root of half the covariance's trace."""
        if self.covariances_px2 is None:
            return None
        return np.sqrt(0.5 * np.trace(self.covariances_px2, axis1=1, axis2=2))


@dataclass(frozen=True)
class Ellipse:
    """An outline in the picture: centre, half axes (px), angle of the major axis from +u towards +v (rad)."""

    center_px: tuple[float, float]
    semi_major_px: float
    semi_minor_px: float
    angle_rad: float


@dataclass(frozen=True)
class MarkerView:
    """One marker in one picture; `ok` is the mask, `reason` says why not.

    `pixel_px` is the centre of the kind `center_kind` (the outline's centroid: where a sphere is off the axis, its own centre lies
    nearer to the principal point). `sphere_center_px` is the image of the sphere's centre from the cone of rays that touch it, where
    the camera is known.
    """

    name: str
    ok: bool
    reason: str
    pixel_px: tuple[float, float] | None = None
    covariance_px2: FloatArray | None = None
    center_kind: CentreKind = "outline_centroid"
    sphere_center_px: tuple[float, float] | None = None
    outline: Ellipse | None = None
    visible_fraction: float | None = None
    region_area_px: int = 0
    region_centroid_px: tuple[float, float] | None = None
    residual_rms_px: float | None = None

    @property
    def std_px(self) -> float | None:
        """Standard deviation of one axis of the centre, px."""
        if self.covariance_px2 is None:
            return None
        return float(np.sqrt(0.5 * np.trace(self.covariance_px2)))


@dataclass(frozen=True)
class PictureDetections:
    """All that was seen in one picture, masked views included."""

    source: str
    width_px: int
    height_px: int
    boards: tuple[BoardView, ...]
    markers: tuple[MarkerView, ...]
    error: str = ""
    warnings: tuple[str, ...] = field(default_factory=tuple)

    @property
    def ok(self) -> bool:
        """The picture was read (its views may still be masked)."""
        return not self.error

    def to_json(self) -> dict[str, Any]:
        """The detections as JSON-able dictionaries, numbers finite or null."""
        return {
            "source": self.source,
            "width_px": self.width_px,
            "height_px": self.height_px,
            "error": self.error,
            "warnings": list(self.warnings),
            "boards": [_board_json(view) for view in self.boards],
            "markers": [_marker_json(view) for view in self.markers],
        }

    def rows(self, frame: int) -> list[dict[str, Any]]:
        """Rows of `detections.csv` for this picture: only what is not masked, `std_px` and `center` added."""
        rows: list[dict[str, Any]] = []
        for board in self.boards:
            if not board.ok or board.corners_px is None or board.std_px is None:
                continue
            for index, (u, v) in enumerate(board.corners_px):
                if board.visible is not None and not board.visible[index]:
                    continue
                rows.append(
                    {
                        "frame": frame,
                        "target": "board",
                        "index": index,
                        "u": float(u),
                        "v": float(v),
                        "via": board.via,
                        "std_px": float(board.std_px[index]),
                        "center": "",
                    }
                )
        for marker in self.markers:
            if not marker.ok or marker.pixel_px is None:
                continue
            rows.append(
                {
                    "frame": frame,
                    "target": marker.name,
                    "index": 0,
                    "u": float(marker.pixel_px[0]),
                    "v": float(marker.pixel_px[1]),
                    "via": "mirror",
                    "std_px": marker.std_px,
                    "center": marker.center_kind,
                }
            )
        return rows


def _listed(array: npt.NDArray[Any] | None) -> Any:
    return None if array is None else array.tolist()


def _board_json(view: BoardView) -> dict[str, Any]:
    return {
        "ok": view.ok,
        "reason": view.reason,
        "via": view.via,
        "corners_px": _listed(view.corners_px),
        "std_px": _listed(view.std_px),
        "visible": _listed(view.visible),
        "residual_rms_px": view.residual_rms_px,
        "residual_limit_px": view.residual_limit_px,
        "method": view.method,
        "attempts": list(view.attempts),
    }


def _marker_json(view: MarkerView) -> dict[str, Any]:
    return {
        "name": view.name,
        "ok": view.ok,
        "reason": view.reason,
        "pixel_px": None if view.pixel_px is None else list(view.pixel_px),
        "std_px": view.std_px,
        "center_kind": view.center_kind,
        "sphere_center_px": None if view.sphere_center_px is None else list(view.sphere_center_px),
        "visible_fraction": view.visible_fraction,
        "region_area_px": view.region_area_px,
        "region_centroid_px": None if view.region_centroid_px is None else list(view.region_centroid_px),
        "residual_rms_px": view.residual_rms_px,
    }
