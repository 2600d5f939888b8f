"""The common form of all recordings: a log of the joints, and pictures with their times."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..arrays import Floats
from ..camera import Camera
from ..counted import counted
from ..session.errors import SessionError

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
    source: str = "the log of the joints"
    """The file (or the topic) that it was read from, as errors name it."""

    def __post_init__(self) -> None:
        if len(self.time_s) < 2 or self.position.shape != (len(self.time_s), len(self.names)):
            raise SessionError(
                self.source,
                f"got {counted(len(self.time_s), 'row')} of positions, needed two or more; record the joints "
                "while the pictures are taken",
            )
        for values in (self.time_s, self.position, *(() if self.measured is None else (self.measured,))):
            if not np.isfinite(values).all():
                raise SessionError(self.source, "a time or a position is not finite; mend the recording")
        falls = np.flatnonzero(np.diff(self.time_s) <= 0.0)
        if len(falls):
            before, here = self.time_s[falls[0] : falls[0] + 2]
            why = "two rows at the same time: remove one" if here == before else "sort the rows by time"
            raise SessionError(
                self.source,
                f"is not later than the row before ({here:.10g} s after {before:.10g} s); {why}",
                row=int(falls[0]) + 2,
            )


@dataclass(frozen=True, eq=False)
class Recording:
    """A recording: the joints, the pictures, the camera if the recording contains it, and the sources of
    all."""

    joints: JointLog
    pictures: Pictures
    camera: Camera | None
    source: str
    warnings: tuple[str, ...] = ()
    """What was odd when it was read, and was left out."""
