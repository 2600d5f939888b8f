"""The camera: pinhole or fisheye with lens distortion; points to pixels and pixels to rays in batches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _core
from ._core import MirrorPostureError
from .arrays import Floats

__all__ = ["Camera"]


@dataclass(frozen=True)
class Camera:
    """A camera with lens distortion, pinhole or fisheye.

    Optical frame with z forward, x right, y down; pixel (0, 0) is the centre of the top-left pixel.
    `distortion_model` is `none`, `plumb_bob` (k1 k2 p1 p2 k3), `rational_polynomial` (k1 k2 p1 p2 k3 k4 k5
    k6) or `equidistant` (k1 k2 k3 k4: the fisheye of Kannala and Brandt, for points in front of the
    camera), in OpenCV's meaning.

    Raises `MirrorPostureError` for invalid parameters: sizes and focal lengths must be above 0, there must
    be as many finite coefficients as the lens model has. Pixels beyond where the distortion can be inverted
    have no ray.
    """

    size_px: tuple[int, int]
    """Width and height of the picture."""
    focal_px: tuple[float, float]
    center_px: tuple[float, float]
    """The principal point."""
    distortion_model: str = "none"
    distortion: tuple[float, ...] = ()
    name: str = "camera"

    def __post_init__(self) -> None:
        try:
            width, height = (int(n) for n in self.size_px)
            fx, fy = (float(n) for n in self.focal_px)
            cx, cy = (float(n) for n in self.center_px)
            coefficients = tuple(float(k) for k in self.distortion)
            if (width, height) != tuple(self.size_px) or width <= 0 or height <= 0:
                raise ValueError
        except (TypeError, ValueError, OverflowError):
            raise MirrorPostureError(
                f"camera: got size {self.size_px!r}, focal lengths {self.focal_px!r}, centre {self.center_px!r}, distortion "
                f"{self.distortion!r}; needed two whole numbers above 0, two numbers, two numbers, a list of numbers (px)"
            ) from None
        object.__setattr__(self, "size_px", (width, height))
        object.__setattr__(self, "focal_px", (fx, fy))
        object.__setattr__(self, "center_px", (cx, cy))
        object.__setattr__(self, "distortion", coefficients)
        core = _core.Camera(
            self.size_px, self.focal_px, self.center_px, self.distortion_model, list(coefficients)
        )
        object.__setattr__(self, "_core", core)

    @classmethod
    def from_matrix(
        cls,
        matrix_px: npt.ArrayLike,
        distortion: npt.ArrayLike | Sequence[float],
        size_px: tuple[int, int],
        name: str = "camera",
    ) -> Camera:
        """From OpenCV's camera matrix (3, 3) and its 0, 4, 5 or 8 distortion coefficients.

        Raises `MirrorPostureError` for another shape or number of coefficients, and for a matrix with other entries than
        fx, fy, cx, cy and 1: a skew, or a transposed matrix.
        """
        try:
            matrix = np.asarray(matrix_px, dtype=np.float64).reshape(3, 3)
            coefficients = np.asarray(distortion, dtype=np.float64).reshape(-1).tolist()
        except (TypeError, ValueError) as error:
            raise MirrorPostureError(
                f"camera: needed a camera matrix (3, 3) and a list of coefficients ({error})"
            ) from None
        if len(coefficients) == 4:
            coefficients.append(0.0)
        model = {0: "none", 5: "plumb_bob", 8: "rational_polynomial"}.get(len(coefficients))
        if model is None:
            raise MirrorPostureError(
                f"camera: distortion has {len(coefficients)} numbers; needed none, 4 or 5 (plumb_bob) or 8 (rational_polynomial)"
            )
        if matrix[0, 1] or matrix[1, 0] or matrix[2].tolist() != [0.0, 0.0, 1.0]:
            raise MirrorPostureError(
                f"camera: matrix {matrix.tolist()}; needed [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], without skew"
            )
        focal, center = (matrix[0, 0], matrix[1, 1]), (matrix[0, 2], matrix[1, 2])
        return cls(size_px, focal, center, model, tuple(coefficients), name)

    def __getstate__(self) -> dict[str, Any]:
        # The compiled camera and cached values are created again.
        return {name: getattr(self, name) for name in self.__dataclass_fields__}

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            object.__setattr__(self, name, value)
        self.__post_init__()

    @property
    def core(self) -> _core.Camera:
        """The compiled camera."""
        return self._core  # type: ignore[attr-defined, no-any-return]

    @property
    def width_px(self) -> int:
        """Width of the picture."""
        return self.size_px[0]

    @property
    def height_px(self) -> int:
        """Height of the picture."""
        return self.size_px[1]

    @property
    def fx_px(self) -> float:
        """Focal length along u."""
        return self.focal_px[0]

    @property
    def fy_px(self) -> float:
        """Focal length along v."""
        return self.focal_px[1]

    @property
    def cx_px(self) -> float:
        """Principal point, u."""
        return self.center_px[0]

    @property
    def cy_px(self) -> float:
        """Principal point, v."""
        return self.center_px[1]

    @property
    def mean_focal_px(self) -> float:
        """The geometric mean of both focal lengths."""
        return float(np.sqrt(self.fx_px * self.fy_px))

    @cached_property
    def matrix_px(self) -> Floats:
        """The camera matrix (3, 3)."""
        return np.array([[self.fx_px, 0.0, self.cx_px], [0.0, self.fy_px, self.cy_px], [0.0, 0.0, 1.0]])

    @cached_property
    def opencv_distortion(self) -> Floats:
        """The coefficients as OpenCV's pinhole functions take them; five zeros where there are none.

        Raises `MirrorPostureError` for a fisheye, which those functions do not know.
        """
        if self.distortion_model == "equidistant":
            raise MirrorPostureError(
                f"camera {self.name!r}: its lens is equidistant (a fisheye); needed plumb_bob or rational_polynomial here"
            )
        return np.array(self.distortion or (0.0,) * 5)

    def project(self, points_in_camera_m: npt.ArrayLike) -> Floats:
        """Pixels (N, 2) of points (N, 3) in the camera frame, m; a point behind the camera is an error."""
        return self.core.project(points_in_camera_m)

    def unproject(self, pixels_px: npt.ArrayLike) -> Floats:
        """Unit directions (N, 3) of the rays of pixels (N, 2)."""
        return self.core.unproject(pixels_px)
