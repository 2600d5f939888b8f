"""Are the pictures what they claim to be? The board's reflections tested against the model, and against the usual mistakes.

A board whose place before the camera is known has three freedoms in a mirror (the plane) and shows six (its pose): the other three are a test. As
the session says it, the reflections of a right session fit a mirror to the noise. Where they do not, each usual mistake is tried exactly: pictures
mirrored or turned by a driver, a board mounted or counted turned, a camera file of another resolution, another board. Only one that explains the
views far better than the session as it stands, markers included, is named.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from ._core import MirrorPostureError
from .board import Board
from .camera import Camera
from .mirror import FLOAT_GLASS_INDEX, IDEAL_MIRROR, Rig, estimate_mirrors
from .optics import see_in_mirror
from .session.types import Session
from .short_repr import ShortRepr

Floats = npt.NDArray[np.float64]
PixelMap = Callable[[Floats, float, float], Floats]

MOST_VIEWS = 24
"""Views that are looked at, spread over the session: a mistake of this kind is in all of them."""
LEAST_NOISE_PX = 0.05
LEAST_MARKER_PX = 2.0
"""Residuals below these are as good as none when two readings are compared, px."""
SUSPICIOUS_DEVIATIONS = 2.0
"""RMS of the board's residual, in deviations of the noise, above which the usual mistakes are tried. Hand-made mounts leave up to 10."""
EXPLAINED_DEVIATIONS = 20.0
"""A reading that leaves more than this, in deviations of the noise, explains nothing."""
NO_MIRROR_PX = 1000.0
"""Stands for the residual where no mirror explains a view at all."""
SUSPICIOUS_MARKERS = 0.05
"""Median distance of the markers from the model's, as a share of the picture's width, above which it may be doubted."""
LEAST_GAIN = 8.0
"""How many times smaller the residuals (board times markers) must be for a mistake to be named; squared for two mistakes at once."""
WORSE = 1.5
"""No residual of a named reading may be larger than this many times the session's own."""
LEAST_SCALE = 0.04
"""Factors of board or camera nearer to 1 than this are a matter of calibration, not of a mistake."""
LARGEST_FACTOR = 4.0


@dataclass(frozen=True, eq=False, repr=False)
class Reading(ShortRepr):
    """One way to read a session: what was done to pictures, labels, board and camera, and how to put it right."""

    name: str
    said: str = ""
    fix: str = ""
    mistakes: int = 0
    pixels: str = "as they are"
    labels: str = "as they are"
    board_from_meant: Floats = field(default_factory=lambda: np.eye(4))
    camera_from_meant: Floats = field(default_factory=lambda: np.eye(4))
    camera_factor: float = 1.0
    focal_factor: float = 1.0
    square_factor: float = 1.0


@dataclass(frozen=True)
class Fit:
    """How well a reading explains the views: medians over them, px; infinite where it explains fewer than half."""

    reading: Reading
    board_rms_px: float
    marker_px: float | None

    def gain_over(self, other: Fit, noise_px: float) -> float:
        """How many times smaller this fit's residuals are, board times markers."""
        gain = min(max(other.board_rms_px, noise_px), NO_MIRROR_PX) / max(self.board_rms_px, noise_px)
        if self.marker_px is not None and other.marker_px is not None:
            gain *= max(other.marker_px, LEAST_MARKER_PX) / max(self.marker_px, LEAST_MARKER_PX)
        return gain


@dataclass(frozen=True)
class ViewCheck:
    """What the check says. `mistake` is empty where none is named; `as_it_stands` is the session's own fit."""

    as_it_stands: Fit
    noise_px: float
    mistake: str = ""
    readings: tuple[Reading, ...] = ()


def check_views(session: Session) -> ViewCheck | None:
    """Tests a session's views of the board in the mirror; None where there is nothing to test (no board, camera or view).

    Raises `MirrorPostureError` for numbers that make no camera or board.
    """
    views = _Views.of(session)
    if views is None:
        return None
    own = views.fit(Reading("as it stands"))
    noise = max(LEAST_NOISE_PX, _noise_px(session) * math.sqrt(2.0))
    width = views.camera.size_px[0]
    doubted = own.board_rms_px > SUSPICIOUS_DEVIATIONS * noise or (
        own.marker_px is not None and own.marker_px > SUSPICIOUS_MARKERS * width
    )
    if not doubted:
        return ViewCheck(own, noise)
    fits = [views.fit(reading) for reading in _readings(views)]
    fits += views.best_factors()
    better = [fit for fit in fits if _explains(fit, own, noise)]
    if not better:
        return ViewCheck(own, noise)
    least = min(fit.reading.mistakes for fit in better)
    simple = [fit for fit in better if fit.reading.mistakes == least]
    best = max(simple, key=lambda fit: fit.gain_over(own, noise))
    # What explains the views as well as the best one cannot be told from it.
    equal = [fit for fit in simple if best.gain_over(fit, noise) < WORSE and fit is not best]
    return ViewCheck(own, noise, _said(own, best, equal), (best.reading, *(fit.reading for fit in equal)))


def refuse_mistakes(session: Session) -> ViewCheck | None:
    """The check of a session's views. Raises `MirrorPostureError` that names the mistake and the fix, where there is one."""
    checked = check_views(session)
    if checked is not None and checked.mistake:
        raise MirrorPostureError(f"{session.folder}: {checked.mistake}")
    return checked


def _explains(fit: Fit, own: Fit, noise: float) -> bool:
    if not fit.board_rms_px <= min(WORSE * max(own.board_rms_px, noise), EXPLAINED_DEVIATIONS * noise):
        return False
    if own.marker_px is not None and fit.marker_px is not None and math.isfinite(own.marker_px):
        if fit.marker_px > WORSE * max(own.marker_px, LEAST_MARKER_PX):
            return False
    return fit.gain_over(own, noise) >= LEAST_GAIN**fit.reading.mistakes


def _said(own: Fit, best: Fit, equal: list[Fit]) -> str:
    stands = (
        f"{own.board_rms_px:.2f} px RMS"
        if math.isfinite(own.board_rms_px)
        else "no mirror at all explains them"
    )
    text = (
        f"{best.reading.said}: read so, the board's reflections fit a mirror to {best.board_rms_px:.2f} px RMS, as they stand: {stands}; "
        f"{best.reading.fix}"
    )
    for other in equal:
        text += f"; or {other.reading.said} (cannot be told apart here): {other.reading.fix}"
    return text


# What a driver does to a picture of width w and height h, and that done back: from the pixels given to those meant.
_PIXELS: dict[str, PixelMap] = {
    "as they are": lambda p, w, h: p,
    "mirrored left-right": lambda p, w, h: np.stack([w - 1 - p[..., 0], p[..., 1]], axis=-1),
    "mirrored up-down": lambda p, w, h: np.stack([p[..., 0], h - 1 - p[..., 1]], axis=-1),
    "turned by 180°": lambda p, w, h: np.stack([w - 1 - p[..., 0], h - 1 - p[..., 1]], axis=-1),
    "turned by 90° to the right": lambda p, w, h: np.stack([p[..., 1], h - 1 - p[..., 0]], axis=-1),
    "turned by 90° to the left": lambda p, w, h: np.stack([w - 1 - p[..., 1], p[..., 0]], axis=-1),
}
_FLIPS = ("mirrored left-right", "mirrored up-down")
_QUARTERS = ("turned by 90° to the right", "turned by 90° to the left")
_FLIP_FIX = {
    "mirrored left-right": "switch the driver's mirroring off, or mirror the pictures back (u becomes W - 1 - u), and detect again",
    "mirrored up-down": "switch the driver's flip off, or mirror the pictures back (v becomes H - 1 - v), and detect again",
    "turned by 180°": "switch the driver's rotation off, or turn the pictures back by 180°, and detect again",
    "turned by 90° to the right": "turn the pictures back by 90° to the left, and detect again",
    "turned by 90° to the left": "turn the pictures back by 90° to the right, and detect again",
}


def _turned_board(quarters: int) -> Floats:
    c, s = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)][quarters % 4]
    turn = np.eye(4)
    turn[:2, :2] = [[c, -s], [s, c]]
    return turn


# A camera body's frame (x forward, z up) in its optical frame (z forward, x right): REP 103.
_OPTICAL_FROM_BODY = np.array([[0.0, -1.0, 0, 0], [0.0, 0, -1.0, 0], [1.0, 0, 0, 0], [0, 0, 0, 1.0]])


def _readings(views: _Views) -> Iterator[Reading]:
    nx, ny = views.board.corners
    pixels = [*_FLIPS, "turned by 180°", *(_QUARTERS if views.square_picture else ())]
    for name in pixels:
        one = Reading(name, f"the pictures are {name}", _FLIP_FIX[name], 1, pixels=name)
        # Turned back, a flipped view's labels change hands: the detector took the board for a mirrored one. Which axis it reversed is told by
        # the dark square beyond corner 0, if the counts differ in parity.
        swaps = ("as they are",) if name not in _FLIPS else _natural_swaps(nx, ny)
        for labels in dict.fromkeys(("as they are", *swaps)):
            yield replace(one, labels=labels)
        # The same, and the board counted from the other end.
        if name in _FLIPS:
            for labels in ("reversed in x", "reversed in y"):
                if labels not in swaps:
                    yield replace(
                        one,
                        labels=labels,
                        mistakes=2,
                        said=f"{one.said}, and the board is mounted turned by 180°",
                    )
    for quarters in (2,) if nx != ny else (1, 2, 3):
        yield Reading(
            f"board turned by {90 * quarters}°",
            f"the board is mounted, or its corners are counted, turned by {90 * quarters}° against the URDF",
            f"turn the board, or its link [board] link, by {90 * quarters}° about its z axis",
            1,
            board_from_meant=_turned_board(quarters),
        )
    if nx != ny:
        for quarters in (1, 3):
            yield Reading(
                f"board turned by {90 * quarters}°",
                f"the board is mounted turned by {90 * quarters}° against the URDF",
                f"turn the board, or its link [board] link, by {90 * quarters}° about its z axis",
                1,
                board_from_meant=_turned_board(quarters),
            )
    for axis in ("x", "y"):
        yield Reading(
            f"labels reversed in {axis}",
            f"the corners are counted against the board's {axis} axis (as OpenCV counts a board seen directly)",
            f"count them along it: index = iy * {nx} + ix from the corner at -x, -y, z out of the printed face",
            1,
            labels=f"reversed in {axis}",
        )
    yield Reading(
        "camera body",
        "[camera_mount] link is the camera's body (x forward), not its optical frame (z forward, x right, y down)",
        "name the optical frame's link, or add one to the URDF, turned by rpy = -pi/2, 0, -pi/2 against the body",
        1,
        camera_from_meant=_OPTICAL_FROM_BODY,
    )


def _natural_swaps(nx: int, ny: int) -> tuple[str, ...]:
    if nx % 2 == ny % 2:
        return ("reversed in x", "reversed in y")
    return ("reversed in y",) if nx % 2 == 1 else ("reversed in x",)


@dataclass(frozen=True)
class _Views:
    """Some of a session's views, as arrays."""

    camera: Camera
    board: Board
    camera_from_board: Floats
    board_px: Floats
    """(V, N, 2); NaN where a corner was not seen."""
    marker_px: Floats
    marker_seen: npt.NDArray[np.bool_]
    marker_in_camera_m: Floats
    glass_thickness_m: float
    refractive_index: float

    @classmethod
    def of(cls, session: Session) -> _Views | None:
        camera, board, link = session.camera, session.board, session.camera_link
        if camera is None or board is None or link is None:
            return None
        seen = session.mirror_view
        rows = np.flatnonzero(seen.board_seen.sum(axis=1) >= 4)
        if len(rows) == 0:
            return None
        rows = rows[np.unique(np.linspace(0, len(rows) - 1, min(len(rows), MOST_VIEWS)).round().astype(int))]
        robot, positions = session.robot, session.positions[rows]
        poses = robot.forward_kinematics(positions)
        root_from_camera, root_from_board = (poses[:, robot.link_index(name)] for name in (link, board.link))
        turn, origin = root_from_camera[:, :3, :3], root_from_camera[:, :3, 3]
        markers = [
            np.einsum("nji,nj->ni", turn, poses[:, robot.link_index(marker.link), :3, 3] - origin)
            for marker in session.markers
        ]
        glass = (session.mirror or IDEAL_MIRROR).glass
        return cls(
            camera,
            board,
            np.linalg.solve(root_from_camera, root_from_board).astype(np.float64, copy=False),
            np.where(seen.board_seen[rows, :, None], seen.board_px[rows], np.nan),
            seen.marker_px[rows],
            seen.marker_seen[rows],
            np.stack(markers, axis=1) if markers else np.zeros((len(rows), 0, 3)),
            glass.get("glass_thickness_m", 0.0),
            glass.get("refractive_index", FLOAT_GLASS_INDEX),
        )

    @property
    def square_picture(self) -> bool:
        width, height = self.camera.size_px
        return width == height

    def fit(self, reading: Reading) -> Fit:
        """Medians over the views of the board's residual in the best mirror and of the markers' distances from the model's in that mirror."""
        nx, ny = self.board.corners
        width, height = self.camera.size_px
        board_px = _PIXELS[reading.pixels](self.board_px, width, height)
        if reading.labels != "as they are":
            grid = board_px.reshape(-1, ny, nx, 2)
            grid = grid[:, :, ::-1] if reading.labels.endswith("x") else grid[:, ::-1]
            board_px = np.ascontiguousarray(grid).reshape(board_px.shape)
        camera = self._scaled(reading.camera_factor, reading.focal_factor)
        poses = reading.camera_from_meant @ self.camera_from_board @ reading.board_from_meant
        rms = np.full(len(board_px), np.inf)
        foot = np.full((len(board_px), 3), np.nan)
        _, first, group = np.unique(
            poses.round(9).reshape(len(poses), -1), axis=0, return_index=True, return_inverse=True
        )
        for number, row in enumerate(first):
            mine = np.flatnonzero(group.reshape(-1) == number)
            rig = Rig(
                camera,
                Board(*self.board.corners, self.board.square_m * reading.square_factor),
                poses[row],
                None,
                self.glass_thickness_m,
                self.refractive_index,
            )
            found = estimate_mirrors(rig, board_px[mine])
            rms[mine] = np.where(found.valid, found.rms_px, np.inf)
            foot[mine] = found.foot_points_m
        return Fit(reading, float(np.median(rms)), self._markers_px(reading, camera, foot))

    def _markers_px(self, reading: Reading, camera: Camera, foot: Floats) -> float | None:
        view, marker = np.nonzero(self.marker_seen & np.isfinite(foot).all(axis=1, keepdims=True))
        if len(view) == 0:
            return None
        width, height = self.camera.size_px
        seen = _PIXELS[reading.pixels](self.marker_px, width, height)[view, marker]
        points = self.marker_in_camera_m[view, marker] @ reading.camera_from_meant[:3, :3].T
        expected = see_in_mirror(
            camera,
            foot[view],
            points,
            glass_thickness_m=self.glass_thickness_m,
            refractive_index=self.refractive_index,
        )
        away = np.linalg.norm(expected.pixels_px - seen, axis=1)
        return float(np.median(np.where(expected.valid, away, float(width))))

    def _scaled(self, factor: float, focal_factor: float) -> Camera:
        """The camera of the same picture at another resolution (pixel centres are whole numbers, hence the halves), or with another lens."""
        if factor == 1.0 and focal_factor == 1.0:
            return self.camera
        (fx, fy), (cx, cy), size = self.camera.focal_px, self.camera.center_px, self.camera.size_px
        return replace(
            self.camera,
            size_px=(max(1, round(size[0] * factor)), max(1, round(size[1] * factor))),
            focal_px=(fx * factor * focal_factor, fy * factor * focal_factor),
            center_px=((cx + 0.5) * factor - 0.5, (cy + 0.5) * factor - 0.5),
        )

    def best_factors(self) -> list[Fit]:
        """The best factor of the squares' side, of the camera's resolution and of its focal length, each alone, where it is far from 1."""

        def of_board(factor: float) -> Reading:
            return Reading(
                "another board",
                f"the board is another one: its squares measure {1000.0 * factor * self.board.square_m:.2f} mm, not {1000.0 * self.board.square_m:.2f} mm",
                "measure the printed squares and correct [board] square",
                1,
                square_factor=factor,
            )

        def of_camera(factor: float) -> Reading:
            return Reading(
                "camera of another resolution",
                f"the camera file is another camera's or another resolution's: {factor:.2f} times its focal length and centre fit",
                "give the camera file of this camera at the resolution of these pictures",
                1,
                camera_factor=factor,
            )

        def of_lens(factor: float) -> Reading:
            return Reading(
                "camera of another focal length",
                f"the camera file is another camera's, or the pictures are cropped or zoomed: {factor:.2f} times its focal length fits",
                "give the camera file of this camera as it took these pictures",
                1,
                focal_factor=factor,
            )

        found = []
        for reading in (of_board, of_camera, of_lens):
            factor = _least(lambda log, reading=reading: self.fit(reading(math.exp(log))).board_rms_px)  # type: ignore[misc]
            if factor is not None and abs(math.log(factor)) > LEAST_SCALE:
                found.append(self.fit(reading(factor)))
        return found


def _least(cost: Callable[[float], float]) -> float | None:
    """The factor with the least cost: a coarse search over its logarithm, then golden sections. None where nothing has a finite cost."""
    grid = np.linspace(-math.log(LARGEST_FACTOR), math.log(LARGEST_FACTOR), 25)
    costs = [cost(float(log)) for log in grid]
    best = int(np.argmin(costs))
    if not math.isfinite(costs[best]):
        return None
    low, high = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, len(grid) - 1)])
    golden = (math.sqrt(5.0) - 1.0) / 2.0
    for _ in range(16):
        a, b = high - golden * (high - low), low + golden * (high - low)
        if cost(a) <= cost(b):
            high = b
        else:
            low = a
    return math.exp(0.5 * (low + high))


def _noise_px(session: Session) -> float:
    """Standard deviation of a corner, one axis: as stated, else the detector's median, else a usual one."""
    stated = session.noise.pixel_std_px
    if stated:
        return stated
    claimed = session.mirror_view.board_std_px
    given = np.zeros(0) if claimed is None else claimed[claimed > 0.0]
    return float(np.median(given)) if len(given) else 0.2
