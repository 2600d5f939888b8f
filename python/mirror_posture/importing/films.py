"""A film or a folder of pictures, with a CSV of the joints beside it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv

from .._core import MirrorPostureError
from .recording import Floats, JointLog, Picture, Recording

FILMS = (".mp4", ".mkv", ".avi", ".mov", ".webm")
TIME, IMAGE, MEASURED = "time_s", "image", "measured:"


def read_film(file: Path, joints_file: Path, degrees: bool) -> Recording:
    """A film whose own time stamps count, with the joints' CSV; both start at their own zero."""
    return Recording(joint_csv(joints_file, degrees), lambda: film_pictures(file), None, str(file))


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
        with av.open(str(file)) as container:
            stream = container.streams.video[0]
            stream.thread_type = "AUTO"
            if start_s > 0.0 and stream.time_base is not None:
                container.seek(int(start_s / stream.time_base), stream=stream)
            for picture in container.decode(stream):
                time = float(picture.time or 0.0)
                if time >= end_s:
                    return
                if time >= start_s:
                    yield time, picture.to_ndarray(format="bgr24")
    except (av.FFmpegError, IndexError) as error:
        raise MirrorPostureError(f"{file}: is no film that can be read: {error}") from None


def read_pictures(folder: Path, joints_file: Path, degrees: bool) -> Recording:
    """A folder of pictures with the times of `times.csv` (`image, time_s`) in it, or of their names in seconds."""
    from ..detect import list_pictures, read_picture

    files = list_pictures(folder)
    if not files:
        raise MirrorPostureError(f"{folder}: holds no pictures")
    table = folder / "times.csv"
    if table.is_file():
        columns = _csv(table)
        if IMAGE not in columns or TIME not in columns:
            raise MirrorPostureError(f"{table}: needed the columns image and time_s")
        names = [str(name) for name in columns[IMAGE].to_pylist()]
        times = dict(zip(names, _numbers(table, columns, TIME), strict=True))
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
        joint_csv(joints_file, degrees),
        lambda: ((time, read_picture(file)) for time, file in stamped),
        None,
        str(folder),
    )


def joint_csv(file: Path, degrees: bool) -> JointLog:
    """A CSV with `time_s` and a column for each joint, optionally `measured:<joint>`, rad (or degrees) and m.

    Raises:
        MirrorPostureError: no such file, no `time_s`, a cell that is no number.
    """
    columns = _csv(file)
    if TIME not in columns:
        raise MirrorPostureError(f"{file}: has no column time_s; it has {', '.join(columns)}")
    names = tuple(name for name in columns if name != TIME and not name.startswith(MEASURED))
    if not names:
        raise MirrorPostureError(f"{file}: has no column for a joint")
    factor = np.pi / 180.0 if degrees else 1.0
    position = factor * np.stack([_numbers(file, columns, name) for name in names], axis=1)
    measured = None
    if all(MEASURED + name in columns for name in names):
        measured = factor * np.stack([_numbers(file, columns, MEASURED + name) for name in names], axis=1)
    return JointLog(_numbers(file, columns, TIME), names, position, measured, commanded=True)


def _csv(file: Path) -> dict[str, pa.ChunkedArray]:
    try:
        table = pyarrow.csv.read_csv(file)
    except (OSError, pa.ArrowInvalid) as error:
        raise MirrorPostureError(f"{file}: cannot be read as CSV: {error}") from None
    return dict(zip((str(name).strip() for name in table.column_names), table.columns, strict=True))


def _numbers(file: Path, columns: dict[str, pa.ChunkedArray], name: str) -> Floats:
    try:
        values = np.array(columns[name].cast(pa.float64()).to_numpy(), dtype=np.float64)
    except pa.ArrowInvalid as error:
        raise MirrorPostureError(f"{file}, column {name!r}: {error}") from None
    bad = np.flatnonzero(~np.isfinite(values))
    if len(bad):
        raise MirrorPostureError(f"{file}, row {bad[0] + 1}, column {name!r}: needed a finite number")
    return values
