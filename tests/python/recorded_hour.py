"""A stranger's hour without its pictures: what was planned and detected in it, kept in `first_hour/`, so that its commands run in seconds.

`hour_in_document.py OUT NAME WAY --write` keeps a new one. Its detections stand for the detector, blank pictures for the camera's, a moving
pattern for the film; every command is the product's own.
"""

from __future__ import annotations

import csv
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pyarrow.csv

from mirror_posture.robots import ImagePoints, Look, Nominal

FOLDER = Path(__file__).parent / "first_hour"
SMALL = (160, 120)
"""Of the film's pictures."""
PIXEL_DIGITS, STD_DIGITS = 4, 5


@dataclass(frozen=True)
class RecordedHour:
    """What was kept of an hour."""

    folder: Path

    @property
    def rows(self) -> list[dict[str, float]]:
        """The commands of its frames."""
        table = pyarrow.csv.read_csv(self.folder / "frames.csv").to_pylist()
        unsaid = ("frame", "posture", "time_s", "image")
        return [
            {name: value for name, value in row.items() if name not in unsaid and not name.startswith("measured:")}
            for row in table
        ]  # fmt: skip

    def detected(self, nominal: Nominal) -> list[ImagePoints]:
        """What was found in each picture."""
        board, names = nominal.metadata.board, nominal.marker_names
        assert board is not None
        found = []
        for _ in self.rows:
            corners, balls = board.columns * board.rows, len(names)
            found.append(
                ImagePoints(
                    np.full((corners, 2), np.nan),
                    np.zeros(corners, bool),
                    np.full((balls, 2), np.nan),
                    np.zeros(balls, bool),
                )
            )
        for row in pyarrow.csv.read_csv(self.folder / "detections.csv").to_pylist():
            points = found[row["frame"]]
            of_board = row["target"] == "board"
            index = row["index"] if of_board else names.index(row["target"])
            (points.board_px if of_board else points.marker_px)[index] = row["u"], row["v"]
            (points.board_seen if of_board else points.marker_seen)[index] = True
        return found

    def detector(self, nominal: Nominal) -> Iterator[ImagePoints]:
        """One after the other."""
        return iter(self.detected(nominal))

    def write_blank_pictures(self, folder: Path, size_px: tuple[int, int]) -> None:
        """A picture a frame, named as a camera's would be."""
        folder.mkdir()
        blank = cv2.imencode(".png", np.zeros((size_px[1], size_px[0], 3), dtype=np.uint8))[1].tobytes()
        for number in range(len(self.rows)):
            (folder / f"{number:04d}.png").write_bytes(blank)


class Pattern:
    """A world for `strangers_hour.recorded` that shows a pattern which moves when the joints do."""

    def __init__(self, hour: RecordedHour) -> None:
        self.rows = hour.rows
        self.views: list[Mapping[str, float]] = [{}] * len(self.rows)
        rough = np.random.default_rng(3).integers(0, 255, (SMALL[1] // 8, SMALL[0] // 8, 3), dtype=np.uint8)
        self._pattern = cv2.resize(rough, SMALL, interpolation=cv2.INTER_CUBIC)

    def picture(self, joints: Mapping[str, float], view: Mapping[str, float]) -> np.ndarray:
        """Shifted by the joints."""
        shift = [round(40.0 * value) for value in joints.values()]
        return np.roll(self._pattern, (sum(shift), sum(shift[::2])), axis=(0, 1))


def keep(session: Path, detected: Path, name: str) -> None:
    """Keeps an hour's frames, plan and detections (`detected` is the session that `detect --out` wrote) under a name."""
    folder = FOLDER / name
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    shutil.copy(session / "frames.csv", folder)
    with (detected / "detections.csv").open(newline="", encoding="utf-8") as stream:
        header, *rows = csv.reader(stream)
    # A ten-thousandth of a pixel is far below the noise.
    lines = [
        ",".join(header),
        *(
            f"{f},{t},{i},{float(u):.{PIXEL_DIGITS}f},{float(v):.{PIXEL_DIGITS}f},{float(s):.{STD_DIGITS}f}"
            for f, t, i, u, v, s in rows
        ),
    ]
    (folder / "detections.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    if name.endswith("-folder"):
        (folder / "plan").mkdir()
        for file in ("postures.csv", "views.csv", "plan.json"):
            shutil.copy(session / "plan" / file, folder / "plan")


def as_if_detected(look: Look, points: ImagePoints) -> Look:
    """The look with what was found in its picture."""
    return replace(look, points=points)
