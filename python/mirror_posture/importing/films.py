"""A film or a folder of pictures, with a CSV of the joints."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from .._core import MirrorPostureError
from ..picture_files import MOST_PIXELS
from ..session.detections import refuse_twice
from ..session.lines import told_by_line
from ..session.tables import open_table
from .bounds import checked_size, counted_pictures, opened
from .joint_csv import TIME, joint_csv
from .recording import Picture, Recording

FILMS = (".mp4", ".mkv", ".avi", ".mov", ".webm")
"""Endings of films."""
CONTAINERS = "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi"
"""As ffmpeg calls those that are read."""
IMAGE = "image"


def read_film(file: Path, joints_file: Path, degrees: bool, time: str = TIME) -> Recording:
    """A film whose own time stamps count, with the joints' CSV; both start at their own zero."""
    return Recording(
        joint_csv(joints_file, degrees, time),
        lambda: counted_pictures(film_pictures(file), str(file)),
        None,
        str(file),
    )


def film_pictures(file: Path, start_s: float = 0.0, end_s: float = np.inf) -> Iterator[tuple[float, Picture]]:
    """Pictures of a film with their time stamps in it, s, between two times.

    Raises:
        MirrorPostureError: PyAV is not installed, or the file is no film.
    """
    try:
        import av
    except ImportError:
        raise MirrorPostureError(
            f"{file}: films need the package av: pip install 'mirror-posture[import]'"
        ) from None
    try:
        # Opened here, and of these kinds only: a list of other places to read is a film to the library too.
        with (
            opened(file, "a film") as data,
            av.open(data, options={"format_whitelist": CONTAINERS}) as container,
        ):
            stream = container.streams.video[0]
            checked_size(stream.codec_context.width, stream.codec_context.height, str(file))
            # A film may change its size on the way.
            stream.codec_context.options = {"max_pixels": str(MOST_PIXELS)}
            stream.thread_type = "AUTO"
            if start_s > 0.0 and stream.time_base is not None:
                container.seek(int(start_s / stream.time_base), stream=stream)
            for picture in container.decode(stream):
                time = float(picture.time or 0.0)
                if time >= end_s:
                    return
                if time >= start_s:
                    yield time, picture.to_ndarray(format="bgr24")
    except (av.FFmpegError, IndexError, ValueError, MemoryError) as error:
        raise MirrorPostureError(f"{file}: is no film that can be read: {error}") from None


def read_pictures(folder: Path, joints_file: Path, degrees: bool, time: str = TIME) -> Recording:
    """A folder of pictures with the times of `times.csv` (`image, time_s`) in it, or of their names in seconds."""
    from ..detect import list_pictures, read_picture

    files = list_pictures(folder)
    table = folder / "times.csv"
    if os.path.lexists(table):
        with told_by_line(table):
            rows = open_table(table)
            rows.require(IMAGE, TIME)
            codes, texts = rows.texts(IMAGE)
            refuse_twice(rows, codes, "the picture")
            times = dict(zip((texts[code] for code in codes), rows.numbers(TIME), strict=True))
        if missing := [file.name for file in files if file.name not in times]:
            raise MirrorPostureError(f"{table}: has no row for the picture {missing[0]}")
        stamped = [(float(times[file.name]), file) for file in files]
    else:
        try:
            stamped = [(float(file.stem), file) for file in files]
        except ValueError:
            raise MirrorPostureError(
                f"{folder}: the pictures' names are no times in seconds; add times.csv with the columns image, time_s"
            ) from None
    stamped.sort()
    return Recording(
        joint_csv(joints_file, degrees, time),
        lambda: ((time, read_picture(file)) for time, file in stamped),
        None,
        str(folder),
    )
