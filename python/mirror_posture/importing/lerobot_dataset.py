"""LeRobot datasets, versions 2.1 and 3: Parquet tables and films."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from .._core import MirrorPostureError
from ..arrays import Floats
from ..input_files import given_text, path_inside
from ..session.errors import SessionError
from ..session.tables import Table, open_table
from .bounds import MOST_POSITIONS, counted_pictures
from .films import film_pictures
from .recording import JointLog, Recording

INFO = Path("meta/info.json")
TIME, STATE, ACTION = "timestamp", "observation.state", "action"
PATTERN = re.compile(r"(?:[^{}]|\{\w+(?::0?\d{1,2}d)?\})*")
EXAMPLE = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
SUFFIX = ".pos"
"""LeRobot's names of motors end so."""


def is_dataset(source: Path) -> bool:
    """Whether a folder is a LeRobot dataset."""
    return (source / INFO).is_file()


def read_dataset(folder: Path, *, image: str | None, episode: int, degrees: bool) -> Recording:
    """One episode: `action` are the commands, `observation.state` the measurements.

    Raises:
        MirrorPostureError: an unknown version, an episode or a camera that does not exist, missing columns.
    """
    try:
        info = json.loads(given_text(folder / INFO, "LeRobot's info.json"))
    except (ValueError, RecursionError) as error:
        raise MirrorPostureError(f"{folder / INFO}: is no JSON: {error}") from None
    version = str(info.get("codebase_version", "")) if isinstance(info, dict) else ""
    if not version.startswith(("v2", "v3")):
        raise MirrorPostureError(f"{folder}: got version {version!r}, needed LeRobot's v2.1 or v3.0")
    try:
        joints, film, start, end = _episode(folder, info, image, episode, degrees)
        # Half a frame: a time stamp of the film that is rounded differently still belongs to the episode.
        half = 0.5 / float(info["fps"])
    except MirrorPostureError:
        raise
    # Whatever stands in place of a number, a name or a list.
    except (
        KeyError,
        TypeError,
        AttributeError,
        ValueError,
        IndexError,
        ArithmeticError,
        StopIteration,
        pa.ArrowException,
    ) as error:
        raise MirrorPostureError(
            f"{folder}: {INFO} or its tables are not as LeRobot's v2.1 and v3.0 have them ({type(error).__name__}: {error})"
        ) from None
    return Recording(
        joints,
        lambda: counted_pictures(
            (
                (time - start, picture)
                for time, picture in film_pictures(film, max(0.0, start - half), end - half)
            ),
            str(film),
        ),
        None,
        f"{folder}, episode {episode}",
    )


def _episode(
    folder: Path, info: dict[str, Any], image: str | None, episode: int, degrees: bool
) -> tuple[JointLog, Path, float, float]:
    """The joints of an episode, its film, and from when to when it is in it."""
    features: dict[str, Any] = info["features"]
    films = [name for name, feature in features.items() if feature.get("dtype") == "video"]
    key = _chosen(folder, films, image)
    if not 0 <= episode < int(info["total_episodes"]):
        raise MirrorPostureError(
            f"{folder}: got episode {episode}, needed 0 to {int(info['total_episodes']) - 1}"
        )
    if str(info["codebase_version"]).startswith("v2"):
        where = {"episode_chunk": episode // int(info.get("chunks_size", 1000)), "episode_index": episode}
        table_file = _named(folder, info["data_path"], where)
        film = _named(folder, info["video_path"], {**where, "video_key": key})
        start, end = 0.0, np.inf
    else:
        row = _episode_row(folder, episode, key)
        of_film = {
            "video_key": key,
            "chunk_index": int(row[f"videos/{key}/chunk_index"]),
            "file_index": int(row[f"videos/{key}/file_index"]),
        }
        of_data = {"chunk_index": int(row["data/chunk_index"]), "file_index": int(row["data/file_index"])}
        table_file = _named(folder, info["data_path"], of_data)
        film = _named(folder, info["video_path"], of_film)
        start, end = float(row[f"videos/{key}/from_timestamp"]), float(row[f"videos/{key}/to_timestamp"])
    for file in (table_file, film):
        if not file.is_file():
            raise MirrorPostureError(f"{file}: the file is missing; download the dataset with its films")
    columns = ("episode_index", TIME, STATE, ACTION)
    table = open_table(table_file, only=columns, most_cells=MOST_POSITIONS)
    if "episode_index" in table.columns:
        table = table.only(table.integers("episode_index") == episode)
    return _joints(folder, table, features, degrees), film, start, end


def _named(folder: Path, pattern: str, where: dict[str, Any]) -> Path:
    """A file that info.json names by a pattern with places for numbers."""
    if not PATTERN.fullmatch(pattern):
        raise MirrorPostureError(f"{folder / INFO}: got the path {pattern!r}, needed one such as {EXAMPLE}")
    name = pattern.format(**where)
    if path_inside(folder, name) is None:
        raise MirrorPostureError(
            f"{folder / INFO}: the file {name!r} is not in the dataset's folder, by its name or by a link; copy it there "
            "(cp -rL copies what links lead to)"
        )
    return folder / name


def _chosen(folder: Path, films: list[str], image: str | None) -> str:
    if image is not None:
        fitting = [name for name in films if name in (image, f"observation.images.{image}")]
    else:
        fitting = films
    if len(fitting) != 1:
        raise MirrorPostureError(
            f"{folder}: needed --image, one of its cameras: {', '.join(films) or 'none'}"
        )
    return fitting[0]


def _episode_row(folder: Path, episode: int, key: str) -> dict[str, Any]:
    columns = (
        *("episode_index", "data/chunk_index", "data/file_index"),
        *(f"videos/{key}/{name}" for name in ("chunk_index", "file_index", "from_timestamp", "to_timestamp")),
    )
    for file in sorted((folder / "meta" / "episodes").rglob("*.parquet")):
        table = open_table(_named(folder, str(file.relative_to(folder)), {}), only=columns)
        table.require(*columns)
        found = np.flatnonzero(table.integers("episode_index") == episode)
        if len(found):
            return {name: table.columns[name][int(found[0])].as_py() for name in columns}
    raise MirrorPostureError(f"{folder}: meta/episodes has no episode {episode}")


def _joints(folder: Path, table: Table, features: dict[str, Any], degrees: bool) -> JointLog:
    table.require(TIME, STATE)
    names = _names(folder, features, STATE)
    factor = np.pi / 180.0 if degrees else 1.0
    state = factor * _rows(table, STATE, len(names))
    time = table.numbers(TIME)
    if ACTION in table.columns and _names(folder, features, ACTION) == names:
        actions = factor * _rows(table, ACTION, len(names))
        return JointLog(time, names, actions, state, commanded=True, source=table.name)
    return JointLog(time, names, state, source=table.name)


def _rows(table: Table, column: str, width: int) -> Floats:
    """A column of lists as (rows, width)."""
    lists = table.columns[column]
    values = (
        lists.flatten() if pa.types.is_nested(lists.type) and not pa.types.is_struct(lists.type) else lists
    )
    if len(lists) and (
        lists.null_count or not (np.asarray(pc.list_value_length(lists)) == width).all() or values.null_count
    ):
        raise SessionError(table.name, f"needed {width} numbers in every row", column=column)
    return np.asarray(values.cast(pa.float64())).reshape(len(lists), width)


def _names(folder: Path, features: dict[str, Any], key: str) -> tuple[str, ...]:
    names = features.get(key, {}).get("names")
    # v2 datasets have {"motors": [...]}, v3 a list.
    if isinstance(names, dict):
        names = next(iter(names.values()))
    if not isinstance(names, list) or len(set(map(str, names))) < len(names):
        raise MirrorPostureError(f"{folder}: meta/info.json does not name the motors of {key}, each once")
    return tuple(str(name).removesuffix(SUFFIX) for name in names)
