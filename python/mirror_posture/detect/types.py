"""Input and output of detection: plain frozen dataclasses, units in their names.

Pixels are `(u, v)` with (0, 0) at the centre of the top-left pixel. Board corners are in the order of the
session format, `index = iy * corners_x + ix`; the board frame has z out of the printed face.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from .._core import MirrorPostureError
from ..board import Board
from ..camera import Camera
from ..marker import ColorRange, Marker
from ..short_repr import ShortRepr

FloatArray = npt.NDArray[np.float64]
# A picture's pixels, of any type that OpenCV gives.
Pixels = npt.NDArray[Any]
Via = Literal["mirror", "direct"]
CentreKind = Literal["outline_centroid", "region_centroid"]

LEAST_CORNERS = 3
"""The fewest inner corners each way of a board that the detectors find."""


class DetectionError(MirrorPostureError):
    """Input that detection cannot process: what was given, what is required, and the fix."""


def check_board(board: Board) -> None:
    """Raises `DetectionError` for a board that is too small to be found by its pattern."""
    if min(board.corners) < LEAST_CORNERS:
        raise DetectionError(
            f"board corners = {list(board.corners)}: detection needs at least {LEAST_CORNERS} inner corners each way; "
            "count the points where four squares meet, not the squares"
        )


def color_of(marker: Marker) -> ColorRange:
    """The marker's colour. Raises `DetectionError` where it has none."""
    if marker.color is None:
        raise DetectionError(
            f"marker {marker.name!r} has no color, and pictures need one; add in session.toml "
            "color = { hue = …, hue_tolerance = …, min_saturation = …, min_value = … }"
        )
    return marker.color


@dataclass(frozen=True)
class PredictedMarker:
    """Where a marker is expected: centre and how far off that may be, in px; its expected radius if known."""

    name: str
    pixel_px: tuple[float, float]
    search_radius_px: float
    ball_radius_px: float | None = None


@dataclass(frozen=True, eq=False, repr=False)
class BoardPrediction(ShortRepr):
    """What is known of the board beforehand. Either may be missing.

    `corners_px`: expected pixels of all corners, `(N, 2)`. `camera_from_board`: the board's pose before the camera (4, 4), from
    the robot model: it settles a mirrored view's labels, since only one labelling agrees with a reflection.
    """

    corners_px: FloatArray | None = None
    camera_from_board: FloatArray | None = None


@dataclass(frozen=True)
class DetectionSetup:
    """What to look for: the board (or None), the markers, the camera (or None: no calibrated gate).

    Raises `DetectionError` for a board with fewer than 3 corners each way, or a marker without a colour.
    """

    board: Board | None = None
    markers: tuple[Marker, ...] = ()
    camera: Camera | None = None

    def __post_init__(self) -> None:
        if self.board is not None:
            check_board(self.board)
        for marker in self.markers:
            color_of(marker)


@dataclass(frozen=True, eq=False, repr=False)
class BoardView(ShortRepr):
    """One view of the board in one picture; `ok` is the mask, `reason` says why not.

    `corners_px` `(N, 2)` and `covariances_px2` `(N, 2, 2)` are in the order of the session format. They are kept for a refused view
    (so that an overlay can show it) and are None where nothing was found. `visible` `(N,)` is False for corners that were not measured (hidden, or not read of a ChArUco board): their numbers are 0.
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
        result: FloatArray | None = np.sqrt(0.5 * np.trace(self.covariances_px2, axis1=1, axis2=2))
        return result


@dataclass(frozen=True)
class Ellipse:
    """An outline in the picture: centre, half axes (px), angle of the major axis from +u towards +v (rad)."""

    center_px: tuple[float, float]
    semi_major_px: float
    semi_minor_px: float
    angle_rad: float


@dataclass(frozen=True, eq=False, repr=False)
class MarkerView(ShortRepr):
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
