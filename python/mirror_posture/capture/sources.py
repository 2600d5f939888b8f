"""Sources of pictures: a camera of this machine, a stream, a film, a folder of pictures."""

from __future__ import annotations

import re
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
import numpy.typing as npt

from .._core import MirrorPostureError
from ..camera import Camera
from ..importing.films import FILMS

Picture = npt.NDArray[np.uint8]

LOST_AFTER = 50
"""Pictures in a row that a camera may fail to give."""
STALE_PICTURES = 5
"""Pictures that a camera's driver has buffered, at most."""
WAITED_S = 0.01
"""A stream's picture that took longer to come was waited for: its reader has buffered no more."""
SAME_TIME_S = 1e-6
"""Times of a film nearer to each other are of one picture."""
LONGEST_SKIP_S = 0.5
"""A stream that comes faster than it can be read never has nothing buffered."""


@dataclass(frozen=True, eq=False)
class Shot:
    """A picture, BGR, and its time, s; `number` is the planned frame given by its name, if any."""

    picture: Picture
    time_s: float
    name: str = ""
    number: int | None = None


class Source(Protocol):
    """Gives pictures one after the other."""

    stills: bool
    """True: each picture is independent, taken at rest; False: they are successive, as in a film."""
    live: bool
    """True: it never ends, and does not wait for the reader."""

    def read(self) -> Shot | None:
        """The next picture; None at the end. Raises `MirrorPostureError` where none comes any more."""
        ...

    def close(self) -> None:
        """Lets go of it."""
        ...


class CameraSource:
    """A webcam (by its number) or a stream (by its address): always the newest picture."""

    stills, live = False, True

    def __init__(self, where: int | str, camera: Camera | None, option: str = "--source") -> None:
        self._name = f"{option} {shown_source(where)}"
        self._capture, self._stream = cv2.VideoCapture(where), isinstance(where, str)
        if not self._capture.isOpened():
            hint = "is it plugged in, and free?" if isinstance(where, int) else "is the address right?"
            raise MirrorPostureError(f"{self._name}: cannot be opened; {hint}")
        # Of a stream `read` leaves out what is buffered: FFmpeg does not know this setting.
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        if camera is not None and isinstance(where, int):
            self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, camera.width_px)
            self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, camera.height_px)
        self._start = time.monotonic()

    def read(self) -> Shot:
        for _ in range(LOST_AFTER):
            good, picture = self._capture.retrieve() if self._grab_newest() else (False, None)
            if good:
                return Shot(np.asarray(picture, dtype=np.uint8), time.monotonic() - self._start)
            time.sleep(0.02)
        raise MirrorPostureError(f"{self._name}: gives no pictures any more")

    def _grab_newest(self) -> bool:
        """Grabs a picture; of a stream those are left out that its reader has buffered."""
        begin = before = time.monotonic()
        while self._capture.grab():
            now = time.monotonic()
            if not self._stream or now - before > WAITED_S or now - begin > LONGEST_SKIP_S:
                return True
            before = now
        return False

    def close(self) -> None:
        self._capture.release()


class FilmSource:
    """A film; its own time counts, however fast it is read."""

    stills, live = False, False

    def __init__(self, file: Path) -> None:
        self._capture = cv2.VideoCapture(str(file))
        if not self._capture.isOpened():
            raise MirrorPostureError(f"--source {file}: is no film that can be read")
        # Pixels as stored, as `import` and the camera file have them: a phone's film has a tag that turns it.
        self._capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
        self.place, self._name, self._count = file, file.name, 0
        self.mark = f"{file.name}, {file.stat().st_size} bytes"
        """What tells it from other films when a capture goes on in it."""

    def read(self) -> Shot | None:
        return self._retrieve() if self._capture.grab() else None

    def skip_to(self, time_s: float) -> Shot | None:
        """Passes over all before this time of its own, s; the picture of that time, None where it ends before."""
        while self._capture.grab():
            # Both come from the same decoder: the picture's own time comes out again to the last digit.
            if float(self._capture.get(cv2.CAP_PROP_POS_MSEC)) / 1000.0 >= time_s - SAME_TIME_S:
                return self._retrieve()
            self._count += 1
        return None

    def _retrieve(self) -> Shot | None:
        good, picture = self._capture.retrieve()
        if not good:
            return None
        # Of the picture that was grabbed: before, it is that of the picture before it.
        time_s = float(self._capture.get(cv2.CAP_PROP_POS_MSEC)) / 1000.0
        self._count += 1
        return Shot(np.asarray(picture, dtype=np.uint8), time_s, f"{self._name}, picture {self._count}")

    def close(self) -> None:
        self._capture.release()


class FolderSource:
    """A folder of pictures, in the order of the numbers in their names.

    If each name is one number, as `0012.png`, it is the number of the planned frame.
    """

    stills, live = True, False

    def __init__(self, folder: Path) -> None:
        from ..detect import list_pictures

        self.place = folder
        self._files = sorted(list_pictures(folder), key=lambda file: (_numbers(file.stem), file.name))
        self._numbered = all(re.fullmatch(r"\d+", file.stem) for file in self._files)
        self._next = 0

    def read(self) -> Shot | None:
        from ..detect import read_picture

        if self._next >= len(self._files):
            return None
        file = self._files[self._next]
        self._next += 1
        number = int(file.stem) if self._numbered else self._next - 1
        return Shot(np.asarray(read_picture(file), dtype=np.uint8), float(self._next - 1), file.name, number)

    def close(self) -> None:
        pass


def open_source(text: str, camera: Camera | None) -> Source:
    """`webcam`, `webcam:N`, an address (`rtsp://…`, `http://…`), a film or a folder.

    Raises:
        MirrorPostureError: it cannot be opened.
    """
    name, _, rest = text.partition(":")
    if name == "webcam":
        if rest and not rest.isdecimal():
            raise MirrorPostureError(f"--source: got {text!r}, needed webcam:NUMBER, as in webcam:0")
        return CameraSource(int(rest or 0), camera)
    if re.match(r"(rtsp|rtsps|http|https|udp)://", text):
        return CameraSource(text, camera)
    path = Path(text)
    if path.is_dir():
        return FolderSource(path)
    if path.is_file() and path.suffix.lower() in FILMS:
        return FilmSource(path)
    raise MirrorPostureError(
        f"--source: got {text!r}, needed webcam:0, rtsp://ADDRESS, a film ({', '.join(FILMS)}) or a folder of pictures"
    )


def place_of(source: Source) -> Path | None:
    """The film or folder that a source reads; None of a camera."""
    return source.place if isinstance(source, (FilmSource, FolderSource)) else None


def drop_stale(source: Source) -> None:
    """Reads away what a live source has buffered: it was taken before now."""
    for _ in range(STALE_PICTURES if source.live else 0):
        source.read()


def shown_source(where: int | str) -> str:
    """A source without the password in its address."""
    return f"webcam:{where}" if isinstance(where, int) else re.sub(r"//[^/@]*@", "//…@", where)


def _numbers(name: str) -> list[Any]:
    """A name cut so that 9 comes before 10."""
    return [
        # `isdigit` takes a superscript too, which is no number to `int`.
        (0, int(part), "") if part.isdecimal() else (1, 0, part)
        for part in re.split(r"(\d+)", name)
        if part
    ]
