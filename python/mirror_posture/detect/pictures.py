"""Whole pictures: the board's views and the markers of one picture, or of many on all cores.

OpenCV and NumPy release the interpreter's lock in their heavy parts, so threads share the work and pictures are not copied.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from .._core import chroma_step
from ..arguments import checked_arguments
from ..board import CHARUCO
from ..camera import Camera
from .board import BoardOptions, detect_boards
from .charuco import detect_charuco
from .curve import board_curve
from .drawn import drawn_board
from .ghost import board_ghost
from .ghost_light import Pane
from .hidden import told_hidden
from .marker_choice import SizeBounds
from .marker_judge import MarkerOptions
from .markers import COARSE_COLOUR_STEP, detect_markers
from .pose import board_pose
from .reading import PictureFile, as_picture, read_picture_file
from .refused import size_mistake
from .sharpening import ghost_and_sharpening
from .shown_ball import shown_ball
from .types import (
    BoardPrediction,
    BoardView,
    DetectionError,
    DetectionSetup,
    FloatArray,
    PictureDetections,
    Pixels,
    PredictedMarker,
)

# The robot's limbs in the mirror are at least this part of, and at most this many times, as far away as its board is. A limb seen
# without the mirror is at less than half of that distance.
NEAREST_BALL = 0.55
FARTHEST_BALL = 2.5


@dataclass(frozen=True)
class PicturePrediction:
    """What is expected in one picture."""

    board: BoardPrediction | None = None
    markers: tuple[PredictedMarker, ...] = ()
    """Where markers must be: nothing else is examined."""
    marker_in_camera_m: Mapping[str, FloatArray] = field(default_factory=dict)
    """Where the robot's model has each marker before the camera (3,): a hint for its place and size in the mirror."""


@dataclass(frozen=True)
class DetectionOptions:
    """All limits and choices of detection."""

    board: BoardOptions = field(default_factory=BoardOptions)
    marker: MarkerOptions = field(default_factory=MarkerOptions)


@checked_arguments
def detect_picture(
    picture: Path | str | npt.ArrayLike,
    setup: DetectionSetup,
    prediction: PicturePrediction | None = None,
    options: DetectionOptions | None = None,
    name: str | None = None,
) -> PictureDetections:
    """Detects the board's views and the markers in one picture, a path or a BGR (or grey) array.

    What was not found, or is not reliable, is masked with its reason. Raises `DetectionError` for a picture
    that cannot be read, or has another size than its camera's.
    """
    options = options or DetectionOptions()
    prediction = prediction or PicturePrediction()
    if isinstance(picture, (str, Path)):
        source = name or str(picture)
        file = read_picture_file(picture)
    else:
        source = name or "picture"
        file = PictureFile(as_picture(picture, source))
    bgr = file.pixels
    height, width = bgr.shape[:2]
    _check_size(width, height, setup.camera, source, file.exif_turn)
    warnings: tuple[str, ...] = (
        (
            f"its EXIF tag says that it is shown {file.exif_turn}: pixels are used as stored; the camera file must be of stored pixels too",
        )
        if file.exif_turn
        else ()
    )
    gray = cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY)
    boards = _boards(gray, setup, prediction, options)
    # (Of a ChArUco board a part is enough, as a rule.)
    chessboard = None if setup.board is None or setup.board.pattern == CHARUCO else setup.board
    if chessboard is not None:
        warnings += tuple(filter(None, (told_hidden(view, chessboard) for view in boards)))
    reflection = _reflection_m(boards, setup)
    bounds = _size_bounds(reflection, setup)
    reflected = next((view for view in boards if view.ok and view.via == "mirror"), None)
    mirror = _mirror(reflection, prediction)
    # A decoded frame that was stored without loss: the file no longer says that its colours are coarser. (Only balls' edges ask for it.)
    chroma_step_px = file.chroma_step_px
    if setup.markers and chroma_step_px == (1, 1):
        chroma_step_px = chroma_step(bgr)
    ghost, sharpening_px2, curve = None, 0.0, None
    if setup.markers and chessboard is not None and reflected is not None:
        pane = None
        if mirror is not None and setup.camera is not None:
            pane = Pane(mirror.normal, float(np.linalg.norm(mirror.reflection_m)), setup.camera)
        drawn = drawn_board(gray, reflected, chessboard)
        # Where colour is coarse, edges are read in levels: neither sharpening nor another curve moves them.
        if drawn is not None and chroma_step_px == (1, 1) and file.quantisation_step < COARSE_COLOUR_STEP:
            ghost, sharpening_px2 = ghost_and_sharpening(drawn, pane)
            curve = board_curve(drawn, chessboard, ghost, sharpening_px2)
        elif drawn is not None:
            ghost = board_ghost(drawn, pane)
    markers = detect_markers(
        bgr,
        setup.markers,
        setup.camera,
        prediction.markers,
        bounds,
        options.marker,
        chroma_step_px,
        _expected(mirror, setup, prediction),
        file.quantisation_step,
        ghost,
        file.codec,
        sharpening_px2,
        curve,
    )
    return PictureDetections(source, width, height, boards, markers, warnings=warnings)


@checked_arguments
def detect_pictures(
    pictures: Sequence[Path | str | npt.ArrayLike],
    setup: DetectionSetup,
    predictions: Sequence[PicturePrediction | None] | None = None,
    options: DetectionOptions | None = None,
    progress: Callable[[int, int], None] | None = None,
    threads: int | None = None,
) -> tuple[PictureDetections, ...]:
    """Detects in many pictures at once, in the given order; `progress(done, total)` is called as each is
    finished.

    A picture that cannot be used gives detections with `error` set and nothing in them. Raises
    `DetectionError` if there is no picture.
    """
    if len(pictures) == 0:
        raise DetectionError("no pictures given: needed at least one")
    if predictions is not None and len(predictions) != len(pictures):
        raise DetectionError(
            f"{len(predictions)} predictions for {len(pictures)} pictures: needed one each (or None)"
        )

    def one(index: int) -> PictureDetections:
        picture = pictures[index]
        name = str(picture) if isinstance(picture, (str, Path)) else f"picture {index}"
        expected = None if predictions is None else predictions[index]
        try:
            return detect_picture(picture, setup, expected, options, name)
        except DetectionError as error:
            return PictureDetections(name, 0, 0, (), (), error=str(error))

    results: list[PictureDetections | None] = [None] * len(pictures)
    with ThreadPoolExecutor(max_workers=threads or os.cpu_count() or 1) as pool:
        running = {pool.submit(one, index): index for index in range(len(pictures))}
        for done, finished in enumerate(as_completed(running), start=1):
            results[running[finished]] = finished.result()
            if progress is not None:
                progress(done, len(pictures))
    return tuple(result for result in results if result is not None)


def _check_size(width: int, height: int, camera: Camera | None, source: str, exif_turn: str = "") -> None:
    """Refuses a picture of another size than its camera's, and says what the size suggests."""
    mistake = size_mistake(width, height, camera, exif_turn)
    if mistake:
        raise DetectionError(f"{source}: {mistake}")


def _boards(
    gray: Pixels, setup: DetectionSetup, prediction: PicturePrediction, options: DetectionOptions
) -> tuple[BoardView, ...]:
    if setup.board is None:
        return ()
    if setup.board.pattern == CHARUCO:
        return detect_charuco(gray, setup.board, setup.camera, options.board)
    return detect_boards(gray, setup.board, setup.camera, prediction.board, options.board)


def _reflection_m(boards: tuple[BoardView, ...], setup: DetectionSetup) -> FloatArray | None:
    """Centre of the board's reflection in the camera frame (3,), m; None where it is not seen."""
    seen = [view for view in boards if view.ok and view.via == "mirror" and view.corners_px is not None]
    if not seen or setup.board is None or setup.camera is None:
        return None
    corners = seen[0].corners_px
    pose = None if corners is None else board_pose(corners, setup.board, setup.camera, seen[0].visible)
    return None if pose is None else pose.center_in_camera_m


def _size_bounds(reflection_m: FloatArray | None, setup: DetectionSetup) -> dict[str, SizeBounds]:
    """Radii at which each ball can appear in the mirror, from the distance of the board's reflection."""
    if reflection_m is None or setup.camera is None:
        return {}
    distance = float(np.linalg.norm(reflection_m))
    return {
        marker.name: SizeBounds(
            setup.camera.mean_focal_px * 0.5 * marker.diameter_m / (FARTHEST_BALL * distance),
            setup.camera.mean_focal_px
            * 0.5
            * marker.diameter_m
            / (NEAREST_BALL * distance)
            * _off_axis(setup.camera),
        )
        for marker in setup.markers
        if marker.diameter_m > 0.0
    }


@dataclass(frozen=True)
class _Mirror:
    """The plane of a picture's mirror in the camera frame, `n · x = offset`, n away from the camera, and the centre of the board's reflection (3,), m."""

    normal: FloatArray
    offset_m: float
    reflection_m: FloatArray


def _mirror(reflection_m: FloatArray | None, prediction: PicturePrediction) -> _Mirror | None:
    """By the point pair (paper, Eq. 2): the plane half-way between the board's centre and its reflection; None where one of them is not known."""
    board = prediction.board
    if reflection_m is None or board is None or board.camera_from_board is None:
        return None
    centre = np.asarray(board.camera_from_board, dtype=np.float64)[:3, 3]
    apart = reflection_m - centre
    length = float(np.linalg.norm(apart))
    if length < 1e-6:
        return None
    normal = apart / length
    return _Mirror(normal, float(normal @ (0.5 * (reflection_m + centre))), reflection_m)


def _expected(
    mirror: _Mirror | None, setup: DetectionSetup, prediction: PicturePrediction
) -> tuple[PredictedMarker, ...]:
    """Predicted places and sizes of the balls in the mirror of this picture."""
    camera = setup.camera
    if camera is None or mirror is None:
        return ()
    normal, offset = mirror.normal, mirror.offset_m
    found = []
    for marker in setup.markers:
        if marker.name not in prediction.marker_in_camera_m or marker.diameter_m <= 0.0:
            continue
        point = np.asarray(prediction.marker_in_camera_m[marker.name], dtype=np.float64)
        reflected = point + 2.0 * (offset - float(point @ normal)) * normal
        shown = shown_ball(reflected, 0.5 * marker.diameter_m, camera)
        if shown is not None:
            pixel, radius = shown
            found.append(PredictedMarker(marker.name, pixel, float("inf"), radius))
    return tuple(found)


def _off_axis(camera: Camera) -> float:
    """How much larger than in its middle a ball appears at the corner of the picture at most (area's root: cos^-3/2 of the angle)."""
    corner = np.hypot(camera.width_px, camera.height_px) / (2.0 * camera.mean_focal_px)
    return float((1.0 + corner**2) ** 0.75)
