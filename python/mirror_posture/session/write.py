"""A session written as a folder: all of it or nothing."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.csv
import tomli_w

from ..arguments import checked_arguments
from ..formats import Section
from ..formats.session_keys import (
    BOARD,
    CAMERA_MOUNT,
    FORMAT,
    FRAMES,
    MARKERS,
    MIRROR,
    NOISE,
    POINTS,
    VERSION,
)  # fmt: skip
from ..marker import Marker
from ..mirror import Mirror
from ..output_files import new_file, new_folder
from .accelerometers import accelerometer_columns
from .camera_info import dump_camera_info
from .errors import SessionError
from .frames import MEASURED
from .load import load_session
from .metadata import FILE, RESERVED_TARGET
from .replaced import copy_meshes, copy_pictures, keep_others
from .states import states_table
from .tables import SUFFIXES
from .types import Session, Views

TableFormat = Literal["csv", "parquet"]


@checked_arguments
def write_session(
    session: Session,
    folder: str | os.PathLike[str],
    *,
    tables: TableFormat = "csv",
    overwrite: bool = False,
) -> Path:
    """Writes a session as a folder that `load_session` reads back to the same arrays, bit for bit.

    It is written to a temporary folder, read back, and then renamed, so that an existing folder is complete. Pictures
    and the model's shapes (`meshes/`) are copied; keys of session.toml that the format does not know are kept. With
    `overwrite` files of the folder that are not the format's stay (notes, plan, diagnosis); those of the format are
    replaced, and where the folder held another session its `images/` and `meshes/` go too. Returns the folder.

    Raises `SessionError` if the folder exists and `overwrite` is False, and for a session that `load_session` would
    refuse (an undefined number, frame numbers that fall, a picture outside the folder): nothing is written then.
    """
    folder = Path(folder)

    def fill(target: Path) -> None:
        keep_others(session, folder, target)
        try:
            write_session_files(session, target, tables)
            load_session(target)
        except (SessionError, pa.ArrowInvalid, IndexError) as error:
            told = str(error).replace(f"{target}{os.sep}", "")
            raise SessionError(
                folder, f"nothing was written, because the session could not be read again: {told}"
            ) from None

    replace_folder(folder, fill, overwrite)
    return folder


@checked_arguments
def write_detections(session: Session, file: str | os.PathLike[str]) -> Path:
    """Writes the detections table of a session alone, as CSV or Parquet by its name, in one step."""
    file = Path(file)
    if file.suffix not in SUFFIXES:
        raise SessionError(file, f"got the ending {file.suffix!r}, needed one of {', '.join(SUFFIXES)}")
    with new_file(file) as part:
        write_table(detections_table(session), part)
    return file


def write_table(table: pa.Table, file: Path) -> None:
    """Writes a table as CSV or Parquet by the file's name; numbers keep all their digits."""
    if file.suffix == ".parquet":
        from pyarrow import parquet

        parquet.write_table(table, file)
    else:
        pyarrow.csv.write_csv(
            table, file, pyarrow.csv.WriteOptions(quoting_style="needed", quoting_header="needed")
        )


def frames_table(session: Session) -> pa.Table:
    """The frames table with the columns of the format."""
    frames = session.frames
    columns: dict[str, Any] = {"frame": frames.frame, "posture": frames.posture}
    if frames.time_s is not None:
        columns["time_s"] = frames.time_s
    if frames.image is not None:
        columns["image"] = pa.array([name or "" for name in frames.image], pa.string())
    columns |= {name: frames.commanded[:, i] for i, name in enumerate(frames.joint_names)}
    columns |= {MEASURED + name: frames.measured[:, i] for i, name in enumerate(frames.measured_names)}
    columns |= accelerometer_columns(frames)
    return pa.table(columns)


def detections_table(session: Session) -> pa.Table:
    """The detections table; it has the column `via` only if something was seen directly."""
    names = np.array([RESERVED_TARGET, *session.marker_names])
    parts = [_rows_of(view) for view in (session.mirror_view, session.direct_view)]
    way = np.repeat([0, 1], [len(part[0]) for part in parts])
    row, target, index, pixel, std = (np.concatenate(both) for both in zip(*parts, strict=True))
    order = np.lexsort((index, target, way, row))
    row, target, index, pixel, std, way = (array[order] for array in (row, target, index, pixel, std, way))
    columns: dict[str, Any] = {
        "frame": session.frames.frame[row],
        "target": pa.array(names).take(pa.array(target)),
        "index": index,
        "u": pixel[:, 0],
        "v": pixel[:, 1],
    }
    if session.direct_view.any_seen:
        columns["via"] = pa.array(["mirror", "direct"]).take(pa.array(way))
    if len(std) and (std > 0.0).all():
        columns["std_px"] = std
    return pa.table(columns)


def _rows_of(view: Views) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Frame row, target (0 the board, 1 + marker), index, pixel and its deviation (0 unknown) of everything seen."""
    board_row, corner = np.nonzero(view.board_seen)
    marker_row, marker = np.nonzero(view.marker_seen)
    return (
        np.concatenate([board_row, marker_row]),
        np.concatenate([np.zeros_like(corner), marker + 1]),
        np.concatenate([corner, np.zeros_like(marker)]),
        np.concatenate([view.board_px[view.board_seen], view.marker_px[view.marker_seen]]),
        np.concatenate(
            [_masked(view.board_std_px, view.board_seen), _masked(view.marker_std_px, view.marker_seen)]
        ),
    )


def _masked(values: np.ndarray | None, seen: np.ndarray) -> np.ndarray:
    return np.zeros(int(seen.sum())) if values is None else values[seen]


def points_table(session: Session) -> pa.Table:
    """The points table with the columns of the format."""
    points = session.points
    if points is None:
        raise SessionError(session.folder, "has no measured points to write")
    row, marker = np.nonzero(points.seen)
    xyz = points.point_m[points.seen]
    return pa.table(
        {
            "frame": session.frames.frame[row],
            "marker": pa.array([session.marker_names[m] for m in marker], pa.string()),
            **{axis: xyz[:, i] for i, axis in enumerate("xyz")},
        }
    )


def metadata_tree(session: Session) -> dict[str, Any]:
    """session.toml of a session: its original content, overwritten by the session's own values."""
    raw = deepcopy(dict(session.metadata))
    tree: dict[str, Any] = {"format": FORMAT, "version": VERSION, "robot": "robot.urdf"}
    if session.camera is not None:
        tree["camera"] = "camera.yaml"
    tree["root"] = session.root_link
    gravity = [float(g) for g in session.gravity_m_per_s2]
    # A value that was given in another unit is written in the format's.
    tree["gravity"] = (
        {"vector": gravity, "unit": "m/s^2"} if isinstance(raw.get("gravity"), dict) else gravity
    )

    def put(section: Section, values: dict[str, Any] | None) -> None:
        """A section with the session's values; None removes it."""
        if values is not None and (told := _with_values(section, raw.get(section.name, {}), values)):
            tree[section.name] = told

    put(
        CAMERA_MOUNT,
        None
        if session.camera_link is None
        else {
            "link": session.camera_link,
            "tolerance_m": session.camera_tolerance_m,
            "tolerance_rad": session.camera_tolerance_rad,
        },
    )
    board = session.board
    put(
        BOARD,
        None
        if board is None
        else {
            "link": board.link,
            "corners": [board.columns, board.rows],
            "square": board.square_m,
            "pattern": board.pattern,
            "marker_size": board.marker_size_m,
            "dictionary": board.dictionary,
            "tolerance_m": board.tolerance_m,
            "tolerance_rad": board.tolerance_rad,
        },
    )
    if session.markers:
        raw_markers = {entry.get("name"): entry for entry in raw.get("markers", [])}
        tree["markers"] = [_marker_tree(m, raw_markers.get(m.name, {})) for m in session.markers]
    mirror = session.mirror
    put(MIRROR, None if mirror is None else mirror_keys(mirror))
    put(NOISE, {"pixel_std": session.noise.pixel_std_px, "point_std": session.noise.point_std_m})
    put(POINTS, None if session.points is None else {"frame": session.points.frame_link})
    if "frames" in raw or not session.frames.ordered:
        put(FRAMES, {"ordered": session.frames.ordered})
    known = {"camera", "camera_mount", "board", "markers", "mirror", "noise", "points", "frames"}
    tree |= {key: value for key, value in raw.items() if key not in tree and key not in known}
    return tree


def _with_values(section: Section, raw: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """A section's original content with the session's values; a key of the format that has none is gone."""
    known: dict[str, Any] = dict.fromkeys(key.name for key in section.keys)
    known |= dict.fromkeys(inner.name for inner in section.sections)
    return {name: value for name, value in {**raw, **known, **values}.items() if value is not None}


def mirror_keys(mirror: Mirror) -> dict[str, Any]:
    """The keys of `[mirror]`; those that are not stated are left out."""
    keys = {
        "glass_thickness": mirror.glass_thickness_m,
        "refractive_index": mirror.refractive_index,
        "width": mirror.width_m,
        "height": mirror.height_m,
        "center": None if mirror.center_in_root_m is None else list(mirror.center_in_root_m),
    }
    return {key: value for key, value in keys.items() if value is not None}


def _marker_tree(marker: Marker, raw: Mapping[str, Any]) -> dict[str, Any]:
    color = marker.color
    values = {
        "name": marker.name,
        "link": marker.link,
        "diameter": marker.diameter_m,
        "mount": "known" if marker.mount_known else "unknown",
        "tolerance_m": marker.tolerance_m,
        "color": None
        if color is None
        else {
            "hue": color.hue_deg,
            "hue_tolerance": color.hue_tolerance_deg,
            "min_saturation": color.min_saturation,
            "min_value": color.min_value,
        },
    }
    return _with_values(MARKERS, raw, values)


def write_session_files(session: Session, target: Path, tables: TableFormat = "csv") -> None:
    """Writes a session's files into a folder that is there; pictures and shapes that lie in it already stay as they are."""
    (target / FILE).write_text(tomli_w.dumps(metadata_tree(session)), encoding="utf-8")
    shutil.copyfile(session.robot_file, target / "robot.urdf")
    if session.camera is not None:
        (target / "camera.yaml").write_text(dump_camera_info(session.camera), encoding="utf-8")
    write_table(frames_table(session), target / f"frames.{tables}")
    if session.detected and (session.camera is not None):
        write_table(detections_table(session), target / f"detections.{tables}")
    if session.points is not None:
        write_table(points_table(session), target / f"points.{tables}")
    if session.states is not None:
        write_table(states_table(session.states), target / f"states.{tables}")
    copy_meshes(session, target)
    copy_pictures(session, target)


def replace_folder(
    folder: Path, fill: Callable[[Path], None], overwrite: bool, source: Path | None = None
) -> None:
    """Fills a temporary folder, then renames it; on any error the place is unchanged.

    `source` is the session that is read for it. Raises `SessionError` for a folder that is there, unless `overwrite` is given; then for
    the source itself, and for a folder with files that is no session: all that is in it would be lost.
    """
    if folder.exists() and not overwrite:
        raise SessionError(folder, "is there already; give another folder, or replace it with --overwrite")
    if source is not None and folder.resolve() == source.resolve():
        raise SessionError(folder, "is the session that is read, and would be replaced; give another folder")
    if folder.is_dir() and any(folder.iterdir()) and not (folder / FILE).exists():
        raise SessionError(
            folder,
            "holds files and is no session: --overwrite would delete them; give another folder, or remove them yourself",
        )
    with new_folder(folder) as new:
        fill(new)
