"""The plan as files: postures.csv in the columns of frames.csv, views.csv, plan.json."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from .._core import MirrorPostureError
from ..formats.plan_keys import FORMAT, VERSION
from ..output_files import new_folder
from ..robot import Robot
from ..session.errors import choices
from ..session.tables import open_table
from ..session.write import write_table
from .run import Plan

POSTURES, VIEWS, DOCUMENT, PICTURE = "postures.csv", "views.csv", "plan.json", "plan.png"
FILES = (POSTURES, VIEWS, DOCUMENT, PICTURE)


@dataclass(frozen=True)
class PlannedFrame:
    """A row of a plan: its posture's number, the view, and the commanded joints, rad (m)."""

    frame: int
    posture: int
    view: int
    commanded: dict[str, float]


def write_plan(plan: Plan, folder: Path) -> None:
    """Writes postures.csv, views.csv, plan.json and plan.png into a folder, all or none of them."""
    from .picture import draw_plan

    with new_folder(folder, owned=FILES) as part:
        names = plan.setting.joint_names
        columns: dict[str, Any] = {
            "frame": np.arange(len(plan.view)),
            "posture": plan.posture,
            **{name: plan.positions[:, k] for name, k in zip(names, plan.setting.moving, strict=True)},
        }
        still = [
            (k, name)
            for k, name in enumerate(plan.setting.nominal.robot.position_names)
            if name not in names and abs(plan.setting.home[k]) > 0.0
        ]
        columns |= {name: np.full(len(plan.view), plan.setting.home[k]) for k, name in still}
        write_table(pa.table(columns), part / POSTURES)
        rows = [plan.mirrors[v] for v in plan.view]
        write_table(
            pa.table(
                {
                    "frame": np.arange(len(plan.view)),
                    "view": plan.view,
                    "yaw_rad": [m.yaw_rad for m in rows],
                    "pitch_rad": [m.pitch_rad for m in rows],
                    **{
                        f"center_{axis}_m": [float(m.center_in_root_m[i]) for m in rows]
                        for i, axis in enumerate("xyz")
                    },
                    **{
                        f"normal_{axis}": [float(m.normal_in_root[i]) for m in rows]
                        for i, axis in enumerate("xyz")
                    },
                }
            ),
            part / VIEWS,
        )
        (part / DOCUMENT).write_text(json.dumps(document(plan), indent=1, allow_nan=False), encoding="utf-8")
        draw_plan(plan, part / PICTURE)


def document(plan: Plan) -> dict[str, Any]:
    """The plan's predictions as JSON; a size that is never detected is null."""

    def size(value: float) -> float | None:
        return value if math.isfinite(value) else None

    return {
        "format": FORMAT,
        "version": VERSION,
        "frames": len(plan.view),
        "joints": list(plan.setting.joint_names),
        "mirror": {
            "width_m": plan.mirrors[0].width_m,
            "height_m": plan.mirrors[0].height_m,
            "distance_from_board_m": plan.distance_m,
            "views": [
                {
                    "yaw_rad": m.yaw_rad,
                    "pitch_rad": m.pitch_rad,
                    "center_in_root_m": m.center_in_root_m.tolist(),
                    "normal_in_root": m.normal_in_root.tolist(),
                    "up_in_root": m.up_in_root.tolist(),
                }
                for m in plan.mirrors
            ],
        },
        "noise_px": plan.setting.noise_px,
        "tells": [
            {
                "effect": one.effect,
                "at": one.at,
                "parameters": {name: size(value) for name, value in one.parameters.items()},
                "twins": [{"cause": twin.name, "apart_from": size(twin.apart_from)} for twin in one.twins],
            }
            for one in plan.tells
        ],
        "frames_asked": plan.options.postures * (len(plan.mirrors) if plan.options.same_postures else 1),
        "markers": {
            marker.name: int(plan.markers[:, index].sum())
            for index, marker in enumerate(plan.setting.nominal.metadata.markers)
        },
        "drawn": plan.drawn,
        "not_taken": plan.not_taken,
        "not_checked": list(plan.ignored_pairs),
        "warnings": list(plan.warnings),
        "options": {
            **asdict(plan.options),
            "packages": {k: str(v) for k, v in plan.options.packages.items()},
        },
    }


def read_plan(file: Path, robot: Robot) -> list[PlannedFrame]:
    """The rows of postures.csv, with the views of views.csv beside it (0 where there is none).

    Raises:
        MirrorPostureError: no such file, a column that is missing or is no joint, a cell that is no number.
    """
    columns = numbers_of(file)
    for name in ("frame", "posture"):
        if name not in columns:
            raise MirrorPostureError(f"{file}: has no column {name!r}; mirror-posture plan writes it")
    for name in ("frame", "posture"):
        _check_whole(file, name, columns[name])
    if len(set(columns["frame"])) < len(columns["frame"]):
        raise MirrorPostureError(f"{file}: a frame stands there twice; needed each once")
    joints = [name for name in columns if name not in ("frame", "posture")]
    if unknown := [name for name in joints if name not in robot.position_names]:
        raise MirrorPostureError(
            f"{file}: got columns of {choices(unknown)}, needed joints of this robot that move by themselves: "
            f"{choices(robot.position_names)}; is it the plan of another robot? Plan once more with mirror-posture plan"
        )
    beside = file.parent / VIEWS
    views = dict.fromkeys(columns["frame"], 0.0)
    if beside.is_file():
        table = numbers_of(beside)
        if "frame" not in table or "view" not in table:
            raise MirrorPostureError(f"{beside}: needed the columns frame and view")
        _check_whole(beside, "view", table["view"])
        views |= dict(zip(table["frame"], table["view"], strict=True))
    return [
        PlannedFrame(
            int(frame), int(columns["posture"][row]), int(views[frame]), {name: columns[name][row] for name in joints}
        )
        for row, frame in enumerate(columns["frame"])
    ]  # fmt: skip


def _check_whole(file: Path, column: str, values: list[float]) -> None:
    for row, value in enumerate(values):
        if value != int(value) or not 0 <= value < 2**53:
            raise MirrorPostureError(
                f"{file}, row {row + 1}, column {column!r}: got {value:g}, needed a whole number from 0 on"
            )


def numbers_of(file: Path) -> dict[str, list[float]]:
    """The columns of a table of finite numbers. Raises `MirrorPostureError`, which names file, row and column."""
    if not file.exists():
        raise MirrorPostureError(f"{file}: there is no such file; mirror-posture plan writes it")
    table = open_table(file)
    return {name: table.numbers(name).tolist() for name in table.columns}
