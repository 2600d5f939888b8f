"""The capture's states: wait until all is still and sharp, look what is in the picture, take it, go on to the next posture.

```
          start                    still, sharp, board and a ball found
WAITING ────────▶ MOVING ⇄ STILL ─────────────────────────────────────▶ (taken) ─▶ next posture
   ▲                │ another view is next           a robot's driver: COMMANDING before each
   │                ▼                                any error of it: rest, FAILED
   └──────────── TURN_MIRROR                         pause: nothing moves, nothing is taken
```
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence

import numpy as np

from .._core import MirrorPostureError
from ..counted import counted
from ..plan.table import PlannedFrame
from ..robots import CommandedRobot, Nominal
from ..robots.nominal import detect_look
from ..robots.protocol import ImagePoints, Look
from .recorder import Recorder
from .sources import FilmSource, Shot, Source, drop_stale, place_of
from .stage import CaptureOptions, Stage
from .stillness import Stillness

ACTIONS = ("start", "pause", "turned", "skip", "again", "finish")
PATIENCE_S = 2.0
"""How long an action waits for a picture that is being processed."""
LOOK_EVERY_S = 1.0
"""For a film or a camera: interval of the detections."""


class Capture:
    """Takes a plan's pictures from a source into a session's folder. `step` does one thing and can be called from any thread."""

    def __init__(
        self,
        nominal: Nominal,
        plan: Sequence[PlannedFrame],
        source: Source,
        recorder: Recorder,
        options: CaptureOptions | None = None,
        robot: CommandedRobot | None = None,
        say: Callable[[str], None] | None = None,
    ) -> None:
        self.nominal, self.plan, self.recorder = nominal, list(plan), recorder
        self.options = options or CaptureOptions()
        self.source, self.robot, self._say = source, robot, say or (lambda _: None)
        self._lock = threading.RLock()
        self.stillness = Stillness()
        self.skipped: dict[int, str] = {}
        """Planned frames without a picture, and why."""
        self.stage = Stage.WAITING if self.options.ask else Stage.MOVING
        self.message = ""
        self.found: ImagePoints | None = None
        """In the picture that was processed last."""
        self.last: Shot | None = None
        """The picture that was read last."""
        self._looked_s = -np.inf
        self._waypoint = -1
        """Of the plan's rows the last one that the robot was sent to."""
        self._asked: deque[str] = deque()
        self._measured: dict[str, float] = {}
        first = self.current
        # A capture that goes on where it was stopped begins with the view of its next posture.
        self._view = first.view if first is not None else 0
        recorder.begin(place_of(source))
        self._film = source.mark if isinstance(source, FilmSource) else ""
        if isinstance(source, FilmSource) and (film_s := recorder.go_on_in(self._film)) is not None:
            self._go_on(source, film_s)

    def _go_on(self, film: FilmSource, time_s: float) -> None:
        """Goes on behind the last picture that was taken of a film: what stands there is taken already."""
        shot = film.skip_to(time_s)
        if shot is not None:
            self.stillness.see(shot.picture, shot.time_s)
            self.stillness.take(shot.picture)

    @property
    def current(self) -> PlannedFrame | None:
        """The planned frame that is to be taken next; None at the end."""
        left = (f for f in self.plan if f.frame not in self.recorder.taken and f.frame not in self.skipped)
        return next(left, None)

    def step(self) -> bool:
        """Reads a picture and takes the next action; False when the capture has ended."""
        with self._lock:
            while self._asked:
                self._act(self._asked.popleft())
            if self.stage in (Stage.FINISHED, Stage.FAILED):
                return False
            try:
                return self._step()
            except MirrorPostureError as error:
                self._fail(str(error))
                return False

    def _step(self) -> bool:
        current = self.current
        if current is None:
            return self._end(self._through_in_words())
        shot = self.source.read()
        if shot is None:
            return self._end(f"the source has no more pictures; {self._left_in_words()}")
        self.last = shot
        if self.source.stills:
            return self._take_still(shot)
        still_s = self.stillness.see(shot.picture, shot.time_s)
        if self.stage in (Stage.WAITING, Stage.PAUSED):
            self._look(current, shot)
            return True
        if current.view != self._view:
            if self.options.ask:
                self.stage = Stage.TURN_MIRROR
                self._look(current, shot)
                return True
            self._view = current.view
        if self.robot is not None and self._waypoint < self.plan.index(current):
            self._command(self.robot)
            return True
        if still_s < self.options.still_s or not self.stillness.moved:
            self.stage = Stage.MOVING
            self.message = "" if self.stillness.moved else "this one is taken; go on to the next posture"
            self._look(current, shot)
            return True
        self.stage = Stage.STILL
        if not self.stillness.is_sharp(shot.picture):
            self.message = "the picture is blurred"
            return True
        if not self._look(current, shot):
            return True
        trouble = self._trouble()
        if trouble:
            self.message = trouble
            return True
        self.stillness.take(shot.picture)
        self._record(current, shot)
        return True

    def _take_still(self, shot: Shot) -> bool:
        """A picture of a folder: of the planned frame given by its name."""
        frame = next((f for f in self.plan if f.frame == shot.number), None)
        if frame is None:
            raise MirrorPostureError(
                f"{shot.name}: the plan has no frame {shot.number}; it has {len(self.plan)}, name the pictures by their frames"
            )
        if frame.frame in self.recorder.taken:
            return True
        self._look(frame, shot, now=True)
        trouble = self._trouble()
        if trouble:
            self.skipped[frame.frame] = trouble
            self._say(f"{shot.name}: not taken: {trouble}")
            return True
        self._record(frame, shot)
        return True

    def _look(self, frame: PlannedFrame, shot: Shot, now: bool = False) -> bool:
        """Looks for board and balls, not more often than `LOOK_EVERY_S`; whether it did."""
        if not now and abs(shot.time_s - self._looked_s) < LOOK_EVERY_S:
            return False
        self._looked_s = shot.time_s
        camera = self.nominal.camera
        height, width = shot.picture.shape[:2]
        if camera is not None and (width, height) != camera.size_px:
            raise MirrorPostureError(
                f"{shot.name or 'the source'}: gives pictures of {width} x {height}, camera.yaml is of "
                f"{camera.width_px} x {camera.height_px}; calibrate the camera at this resolution"
            )
        look = Look(frame.commanded, shot.time_s, picture_bgr=shot.picture)
        self.found = detect_look(self.nominal, look).points
        return True

    def _trouble(self) -> str:
        """Why the picture processed last cannot be taken; empty where it can."""
        found = self.found
        if found is None:
            return "nothing was looked for"
        if not found.board_seen.any():
            return next(
                (r for r in found.reasons if r.startswith("board")), "the board is not found in the mirror"
            )
        if int(found.marker_seen.sum()) < self.options.least_markers:
            return "; ".join(r for r in found.reasons if not r.startswith("board")) or "no ball is found"
        return ""

    def _record(self, frame: PlannedFrame, shot: Shot) -> None:
        self.recorder.add(frame, shot.picture, shot.time_s, self._measured, self._film)
        balls = int(self.found.marker_seen.sum()) if self.found is not None else 0
        self.message = f"taken: posture {frame.frame}, board and {counted(balls, 'ball')}"
        self._say(f"frame {frame.frame}: board and {balls} of {len(self.nominal.marker_names)} balls")
        if self.current is None:
            self._end(self._through_in_words())
        elif self.stage is Stage.STILL:
            self.stage = Stage.MOVING

    def _command(self, robot: CommandedRobot) -> None:
        """Sends the robot to the plan's next row, left out or taken already or not: only from row to row the way is known to be free."""
        frame = self.plan[self._waypoint + 1]
        self.stage = Stage.COMMANDING
        arrival = robot.command({n: v for n, v in frame.commanded.items() if n in robot.joint_names})
        self._measured = {name: float(value) for name, value in arrival.measured.items()}
        self._waypoint += 1
        drop_stale(self.source)
        self.stillness.restart()
        self.stage = Stage.MOVING

    def _end(self, message: str) -> bool:
        self.stage, self.message = Stage.FINISHED, message
        self._rest()
        return False

    def _fail(self, message: str) -> None:
        self.stage, self.message = Stage.FAILED, message
        self._rest()

    def _rest(self) -> None:
        if self.robot is not None:
            try:
                self.robot.rest()
            except MirrorPostureError as error:
                self.message += f"; the robot did not come to rest: {error}"

    def _left(self) -> int:
        return sum(1 for f in self.plan if f.frame not in self.recorder.taken)

    def _left_in_words(self) -> str:
        return f"{counted(self._left(), 'posture is', 'postures are')} not taken"

    def _through_in_words(self) -> str:
        if not self._left():
            return "all postures of the plan are taken"
        return f"the plan is through; {self._left_in_words()}"

    def do(self, action: str) -> str:
        """An action of the user: start, pause, turned, skip, again, finish. Returns what was done.

        While a driver moves the robot it takes effect when that movement has ended. Raises
        `MirrorPostureError` for anything else.
        """
        if action not in ACTIONS:
            raise MirrorPostureError(f"got {action!r}, needed one of {', '.join(ACTIONS)}")
        if not self._lock.acquire(timeout=PATIENCE_S):
            self._asked.append(action)
            return "done as soon as this movement has ended"
        try:
            return self._act(action)
        finally:
            self._lock.release()

    def _act(self, action: str) -> str:
        current = self.current
        if self.stage in (Stage.FINISHED, Stage.FAILED):
            return "the capture has ended"
        if action in ("start", "turned"):
            # After a pause neither the mirror nor the posture is another one: what stood before it is taken already.
            if current is not None and (action == "turned" or self.stage is Stage.WAITING):
                self._view = current.view
            self.stage, self.message = Stage.MOVING, ""
            if action == "turned":
                self.stillness.moved = True
            return "going on"
        if action == "pause":
            self.stage = Stage.PAUSED
            return "paused: nothing moves, nothing is taken"
        if action == "skip":
            if current is not None:
                self.skipped[current.frame] = "left out by hand"
            return "left out"
        if action == "again":
            last = self.recorder.last
            if last is None or self.robot is not None:
                return (
                    "nothing was taken yet"
                    if self.robot is None
                    else "a robot does not go back; capture again at the end"
                )
            self.recorder.drop(last)
            self.stillness.moved = True
            return f"posture {last} is to be taken again"
        self._end(f"finished by hand; {self._left_in_words()}")
        return "finished"

    def close(self) -> None:
        """Brings the robot to rest and lets go of the source and the session's folder."""
        with self._lock:
            if self.stage not in (Stage.FINISHED, Stage.FAILED):
                self._rest()
            self.source.close()
            self.recorder.close()
