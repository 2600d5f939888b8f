"""A measurement as tables: one row a marker of a posture, and one row a marker over all postures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from .._core import MirrorPostureError
from ..output_files import new_file
from ..session.write import write_table

if TYPE_CHECKING:
    from .types import Measurement

AXES = "xyz"


def marker_table(measurement: Measurement) -> pa.Table:
    """One row for each marker of a posture, in the frame of the session's root link: measured and modelled.

    `x_m, y_m, z_m` and `std_x_m, …` (one axis), `cov_xy_m2, …`, `model_x_m, …`, `distance_m` between the
    two, `camera_x_m, …` in the camera frame of the posture. A marker that is not measured has empty cells
    and a `reason`.
    """
    markers = measurement.markers
    measured = markers.measured
    names = np.array(measurement.marker_names, dtype=object)

    def masked(values: np.ndarray) -> pa.Array:
        return pa.array(values, pa.float64(), mask=~measured)

    covariance = markers.covariance_in_root_m2
    columns: dict[str, Any] = {
        "posture": markers.posture,
        "marker": pa.array(list(names[markers.marker]), pa.string()),
        "views": markers.views,
    }
    for i, axis in enumerate(AXES):
        columns[f"{axis}_m"] = masked(markers.point_in_root_m[:, i])
    for i, axis in enumerate(AXES):
        columns[f"std_{axis}_m"] = masked(np.sqrt(covariance[:, i, i]))
    for i, j in ((0, 1), (0, 2), (1, 2)):
        columns[f"cov_{AXES[i]}{AXES[j]}_m2"] = masked(covariance[:, i, j])
    for i, axis in enumerate(AXES):
        columns[f"model_{axis}_m"] = pa.array(markers.model_in_root_m[:, i])
    columns["distance_m"] = masked(markers.distance_m)
    for i, axis in enumerate(AXES):
        columns[f"camera_{axis}_m"] = masked(markers.point_in_camera_m[:, i])
    columns["reason"] = pa.array([reason or "" for reason in markers.reason], pa.string())
    return pa.table(columns)


def write_marker_table(measurement: Measurement, file: Path) -> None:
    """Writes `marker_table` as CSV or Parquet, by the file's name."""
    if file.suffix not in (".csv", ".parquet"):
        raise MirrorPostureError(f"{file}: got the ending {file.suffix!r}, needed .csv, .parquet or .json")
    with new_file(file) as part:
        write_table(marker_table(measurement), part)


@dataclass(frozen=True)
class MarkerSummary:
    """One marker over all postures."""

    marker: str
    measured: int
    postures: int
    std_m: float | None
    """Median of one standard deviation of the length of the position's error."""
    distance_rms_m: float | None
    """Root mean square distance from the model."""
    distance_max_m: float | None
    offset_in_root_m: tuple[float, float, float] | None
    """Mean of measured minus model."""


def summarise(measurement: Measurement) -> list[MarkerSummary]:
    """One row a marker, over all postures in which any view shows it."""
    markers = measurement.markers
    rows = []
    for index, name in enumerate(measurement.marker_names):
        mine = markers.marker == index
        good = mine & markers.measured
        if not good.any():
            rows.append(MarkerSummary(name, 0, int(mine.sum()), None, None, None, None))
            continue
        distance = markers.distance_m[good]
        offset = (markers.point_in_root_m - markers.model_in_root_m)[good].mean(axis=0)
        rows.append(
            MarkerSummary(
                name,
                int(good.sum()),
                int(mine.sum()),
                float(np.median(markers.std_m[good])),
                float(np.sqrt((distance**2).mean())),
                float(distance.max()),
                (float(offset[0]), float(offset[1]), float(offset[2])),
            )
        )
    return rows


def document(measurement: Measurement) -> dict[str, Any]:
    """The measurement as plain values for JSON, every covariance included."""
    markers, mirrors = measurement.markers, measurement.mirrors
    names = measurement.marker_names
    points = []
    for k in range(len(markers)):
        good = bool(markers.measured[k])
        points.append(
            {
                "posture": markers.posture[k],
                "marker": names[markers.marker[k]],
                "views": markers.views[k],
                "point_in_root_m": markers.point_in_root_m[k] if good else None,
                "covariance_in_root_m2": markers.covariance_in_root_m2[k] if good else None,
                "point_in_camera_m": markers.point_in_camera_m[k] if good else None,
                "model_in_root_m": markers.model_in_root_m[k],
                "distance_m": markers.distance_m[k] if good else None,
                "reason": markers.reason[k],
            }
        )
    frames = [
        {
            "measured": bool(mirrors.measured[row]),
            "normal_in_camera": mirrors.normal[row] if mirrors.measured[row] else None,
            "distance_m": mirrors.distance_m[row] if mirrors.measured[row] else None,
            "foot_covariance_m2": mirrors.foot_covariance_m2[row] if mirrors.measured[row] else None,
            "corner_rms_px": mirrors.corner_rms_px[row] if mirrors.measured[row] else None,
            "reason": mirrors.reason[row],
        }
        for row in range(len(mirrors.reason))
    ]
    return {
        "estimator": measurement.estimator,
        "corner_noise_px": measurement.corner_noise_px,
        "marker_noise_px": measurement.marker_noise_px,
        "camera_from_nominal_camera": measurement.camera_from_nominal_camera,
        "camera_from_board_covariance": measurement.camera_from_board_covariance,
        "chi_squared": measurement.chi_squared,
        "degrees_of_freedom": measurement.degrees_of_freedom,
        "summary": summarise(measurement),
        "markers": points,
        "mirrors": frames,
    }
