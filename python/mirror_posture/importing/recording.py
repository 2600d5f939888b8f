"""The common form of all recordings: a log of the joints, and pictures with their times."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .._core import MirrorPostureError
from ..arrays import Floats
from ..camera import Camera

Picture = npt.NDArray[Any]
Pictures = Callable[[], Iterator[tuple[float, Picture]]]
"""A function that restarts the film: time in seconds and picture, BGR (H, W, 3) uint8, in the order of the
times."""


@dataclass(frozen=True, eq=False)
class JointLog:
    """Joint positions by time: `time_s` (N,), rising; `position` (N, J), rad (m). `commanded` says whether
    they are commands."""

    time_s: Floats
    names: tuple[str, ...]
    position: Floats
    measured: Floats | None = None
    """(N, J) readings of the encoders in addition to the commands; None where there is only one of the two."""
    commanded: bool = False
    others: tuple[str, ...] = ()
    """Columns that are left out: those that hold no numbers, and measurements of only some of the joints."""

    def __post_init__(self) -> None:
        if len(self.time_s) < 2 or self.position.shape != (len(self.time_s), len(self.names)):
            raise MirrorPostureError(
                f"the log of the joints: got {len(self.time_s)} rows for {len(self.names)} joints, needed two or more rows of positions"
            )
        for values in (self.time_s, self.position, *(() if self.measured is None else (self.measured,))):
            if not np.isfinite(values).all():
                raise MirrorPostureError(
                    "the log of the joints: a time or a position is not finite; mend the recording"
                )
        falls = np.flatnonzero(np.diff(self.time_s) <= 0.0)
        if len(falls):
            raise MirrorPostureError(
                f"the log of the joints: row {falls[0] + 2} is not later than the one before ({self.time_s[falls[0] + 1]:g} s after "
                f"{self.time_s[falls[0]]:g} s); sort it by time"
            )


@dataclass(frozen=True, eq=False)
class Recording:
    """A recording: the joints, the pictures, the camera if the recording contains it, and the sources of
    all."""

    joints: JointLog
    pictures: Pictures
    camera: Camera | None
    source: str
