"""The postures that would separate alternatives, as a frames table to execute."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa

from ..session.write import write_table
from .result import Diagnosis


def write_next_postures(found: Diagnosis, file: Path) -> Path:
    """Writes a frames table (`frame, posture`, one column a joint, rad or m) of the suggested postures, in their order.

    Joints that a posture does not name stay at 0, as in every session. CSV or Parquet by the file's name.
    """
    joints = list(dict.fromkeys(joint for posture in found.next_postures for joint in posture))
    rows = np.arange(len(found.next_postures))
    commanded = {joint: [posture.get(joint, 0.0) for posture in found.next_postures] for joint in joints}
    write_table(pa.table({"frame": rows, "posture": rows, **commanded}), file)
    return file
