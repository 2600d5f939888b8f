"""Any real robot, by hand: it prints what to command and waits for the picture in a folder.

A person or a script moves the robot and saves a picture; how the picture gets into the folder (a cable, a
card, a network share) does not matter. A file that is still being written is not read.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from .._core import MirrorPostureError
from ..input_files import PICTURE_SUFFIXES
from ..viewpoint import View
from .base import RobotBase
from .errors import LostRobotError, NoLookError
from .nominal import Nominal
from .protocol import JointLimits, Look, Positions

LEAST_CHANGE_RAD = 1e-6
"""Joints that change less are not printed: no servo is that fine."""
BROKEN_AFTER_S = 5.0
"""A file that has not grown for this long and cannot be read is reported, once."""


@dataclass(frozen=True)
class ByHandOptions:
    """How long to wait, and for what."""

    longest_wait_s: float | None = None
    """For a picture; None waits until one comes, or Ctrl-C."""
    still_s: float = 0.5
    """A file is complete when its size and date have not changed for this long, and it can be read."""
    poll_s: float = 0.1


@dataclass(frozen=True)
class _Stamp:
    """Distinguishes a file from its next version of the same name."""

    name: str
    size: int
    modified_ns: int


class ByHandRobot(RobotBase):
    """A robot that a person commands; it can turn in front of its mirror (`TurnsView`), by the person's
    hands.

    Pictures in the folder from before the last command or turn are not used, because they show another
    posture. `say` prints a line; `limits` narrows the joints to those that can be commanded at all.
    """

    def __init__(
        self,
        nominal: Nominal,
        pictures: str | os.PathLike[str],
        options: ByHandOptions | None = None,
        *,
        limits: Mapping[str, JointLimits] | None = None,
        start: Positions | None = None,
        say: Callable[[str], object] = print,
        name: str = "by hand",
    ) -> None:
        super().__init__(nominal, name=name, limits=limits, start=start)
        self.folder = Path(pictures)
        self.options = options or ByHandOptions()
        self._say = say
        if not self.folder.is_dir():
            raise MirrorPostureError(
                f"{self.folder}: is no folder; make it, and save the robot's pictures there"
            )
        self._view = View()
        self._view_told = False
        self._last: dict[str, float] | None = None
        self._known = self._stamps()

    @property
    def view(self) -> View:
        """The requested pose of the mirror."""
        return self._view

    def turn(self, view: View) -> None:
        """Prints how to turn the stand, and returns at once: the next picture shows it."""
        self._check_open()
        self._tell_posture()
        self._view, self._view_told = view, True
        side = "right" if view.yaw_rad >= 0.0 else "left"
        lean = "towards" if view.pitch_rad >= 0.0 else "away from"
        self._say(
            f"TURN   the robot {abs(math.degrees(view.yaw_rad)):.0f}° to its {side} of squarely before the mirror; mirror's top "
            f"{abs(math.degrees(view.pitch_rad)):.0f}° {lean} it; board {1000.0 * view.distance_m:.0f} mm from the mirror. Move no joint."
        )
        self._known = self._stamps()

    def _move(self, positions: dict[str, float]) -> Positions:
        last = self._last
        changed = {
            joint: position
            for joint, position in positions.items()
            if last is None or abs(position - last[joint]) > LEAST_CHANGE_RAD
        }
        self._last = positions
        if not changed:
            self._say("MOVE   nothing: the robot stays as it is")
        for joint, position in changed.items():
            unit = self._unit(joint, position)
            before = "" if last is None else f"   (was {self._unit(joint, last[joint])})"
            self._say(f"MOVE   {joint:<24} to {unit}{before}")
        self._known = self._stamps()
        return {}

    def _unit(self, joint: str, position: float) -> str:
        kind = next(j.kind for j in self.nominal.robot.joints if j.name == joint)
        if kind == "prismatic":
            return f"{1000.0 * position:+9.3f} mm"
        return f"{math.degrees(position):+9.3f}°  {position:+.5f} rad"

    def _tell_posture(self) -> None:
        # Nobody knows where the robot stands before the first line says it: a posture of zeros is told as well.
        if self._last is None:
            self._move(dict(self.commanded))

    def _look(self) -> Look:
        self._tell_posture()
        if not self._view_told:
            self.turn(self._view)
        self._say(f"LOOK   when it stands still, save a picture in {self.folder}")
        file, picture = self._wait()
        self._say(f"       took {file.name}")
        return Look(self.commanded, self._now_s(), view=self._view, picture_bgr=picture)

    def _rest(self) -> None:
        self._say("REST   bring the robot into a safe posture and take its torque off")

    # Waiting for a file.

    def _stamps(self) -> frozenset[_Stamp]:
        stamps = set()
        try:
            with os.scandir(self.folder) as entries:
                for entry in entries:
                    # Copying tools write under hidden or other names first, and rename at the end.
                    if entry.name.startswith(".") or Path(entry.name).suffix.lower() not in PICTURE_SUFFIXES:
                        continue
                    try:
                        status = entry.stat()
                    except FileNotFoundError:
                        continue
                    stamps.add(_Stamp(entry.name, status.st_size, status.st_mtime_ns))
        except OSError as error:
            raise LostRobotError(
                f"{self.folder}: the folder of pictures cannot be read any more ({error.strerror or error}); put it back and resume"
            ) from None
        return frozenset(stamps)

    def _wait(self) -> tuple[Path, npt.NDArray[np.uint8]]:
        # OpenCV takes long to load; a robot without looks does not need it.
        from ..detect import DetectionError, read_picture

        options, began = self.options, time.monotonic()
        since: dict[_Stamp, float] = {}
        broken: dict[_Stamp, str] = {}
        told: set[str] = set()
        while True:
            now = time.monotonic()
            fresh = self._stamps() - self._known
            since = {stamp: since.get(stamp, now) for stamp in fresh}
            whole = [
                stamp for stamp in fresh if now - since[stamp] >= options.still_s and stamp not in broken
            ]
            # The newest: a second picture replaces the first.
            for stamp in sorted(whole, key=lambda s: s.modified_ns, reverse=True):
                file = self.folder / stamp.name
                try:
                    picture = read_picture(file)
                except DetectionError as error:
                    broken[stamp] = str(error)
                    continue
                if stamp not in self._stamps():
                    break  # it was written again while it was read
                self._known = self._known | fresh
                return file, picture
            for stamp, why in broken.items():
                if stamp in fresh and now - since[stamp] > BROKEN_AFTER_S and stamp.name not in told:
                    told.add(stamp.name)
                    self._say(f"       {why}")
            if options.longest_wait_s is not None and now - began > options.longest_wait_s:
                raise NoLookError(
                    f"{self.name}: no picture came into {self.folder} within {options.longest_wait_s:g} s"
                    + "".join(f"; {why}" for why in broken.values())
                )
            time.sleep(options.poll_s)
