"""LeRobot datasets, versions 2.1 and 3: Parquet tables and films."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet

from .._core import MirrorPostureError
from ..input_files import given_text
from .films import film_pictures
from .recording import JointLog, Recording

INFO = Path("meta/info.json")
SUFFIX = ".pos"
"""LeRobot's names of motors end so."""


def is_dataset(source: Path) -> bool:
    """Whether a folder is a LeRobot dataset."""
    return (source / INFO).is_file()


def read_dataset(folder: Path, *, image: str | None, episode: int, degrees: bool) -> Recording:
    """One episode: `action` is what was commanded, `observation.state` what was measured.

    Raises:
        MirrorPostureError: a version that is not known, an episode or a camera that is not there, missing columns.
    """
    try:
        info = json.loads(given_text(folder / INFO, "LeRobot's info.json"))
    except (ValueError, RecursionError) as error:
        raise MirrorPostureError(f"{folder / INFO}: is no JSON: {error}") from None
    version = str(info.get("codebase_version", "")) if isinstance(info, dict) else ""
    if not version.startswith(("v2", "v3")):
        raise MirrorPostureError(f"{folder}: got version {version!r}, needed LeRobot's v2.1 or v3.0")
    features: dict[str, Any] = info["features"]
    films = [name for name, feature in features.items() if feature.get("dtype") == "video"]
    key = _chosen(folder, films, image)
    if not 0 <= episode < int(info["total_episodes"]):
        raise MirrorPostureError(
            f"{folder}: got episode {episode}, needed 0 to {int(info['total_episodes']) - 1}"
        )
    if version.startswith("v2"):
        where = {"episode_chunk": episode // int(info.get("chunks_size", 1000)), "episode_index": episode}
        table_file = folder / info["data_path"].format(**where)
        film = folder / info["video_path"].format(video_key=key, **where)
        start, end = 0.0, np.inf
    else:
        row = _episode_row(folder, episode)
        table_file = folder / info["data_path"].format(
            chunk_index=row["data/chunk_index"], file_index=row["data/file_index"]
        )
        film = folder / info["video_path"].format(
            video_key=key,
            chunk_index=row[f"videos/{key}/chunk_index"],
            file_index=row[f"videos/{key}/file_index"],
        )
        start, end = float(row[f"videos/{key}/from_timestamp"]), float(row[f"videos/{key}/to_timestamp"])
    for file in (table_file, film):
        if not file.is_file():
            raise MirrorPostureError(f"{file}: the file is missing; download the dataset with its films")
    table = pyarrow.parquet.read_table(table_file)
    if "episode_index" in table.column_names:
        table = table.filter(pc.equal(table["episode_index"], episode))
    # Half a frame: a time stamp of the film that is rounded differently belongs to the episode all the same.
    half = 0.5 / float(info["fps"])
    return Recording(
        _joints(folder, table, features, degrees),
        lambda: (
            (time - start, picture)
            for time, picture in film_pictures(film, max(0.0, start - half), end - half)
        ),
        None,
        f"{folder}, episode {episode}",
    )


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


def _episode_row(folder: Path, episode: int) -> dict[str, Any]:
    for file in sorted((folder / "meta" / "episodes").rglob("*.parquet")):
        table = pyarrow.parquet.read_table(file)
        found = table.filter(pc.equal(table["episode_index"], episode)).to_pylist()
        if found:
            return dict(found[0])
    raise MirrorPostureError(f"{folder}: meta/episodes has no episode {episode}")


def _joints(folder: Path, table: pa.Table, features: dict[str, Any], degrees: bool) -> JointLog:
    for name in ("timestamp", "observation.state"):
        if name not in table.column_names:
            raise MirrorPostureError(f"{folder}: its table has no column {name!r}")
    names = _names(folder, features, "observation.state")
    factor = np.pi / 180.0 if degrees else 1.0
    state = factor * np.array(table["observation.state"].to_pylist(), dtype=np.float64)
    time = np.array(table["timestamp"].to_pylist(), dtype=np.float64)
    if "action" in table.column_names and _names(folder, features, "action") == names:
        action = factor * np.array(table["action"].to_pylist(), dtype=np.float64)
        return JointLog(time, names, action, state, commanded=True)
    return JointLog(time, names, state)


def _names(folder: Path, features: dict[str, Any], key: str) -> tuple[str, ...]:
    names = features.get(key, {}).get("names")
    # v2 datasets have {"motors": [...]}, v3 a list.
    if isinstance(names, dict):
        names = next(iter(names.values()))
    if not isinstance(names, list):
        raise MirrorPostureError(f"{folder}: meta/info.json does not name the motors of {key}")
    return tuple(str(name).removesuffix(SUFFIX) for name in names)
