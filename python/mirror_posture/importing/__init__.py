"""Converts existing recordings into sessions: bags, LeRobot datasets, a film or pictures and a log of
joints."""

from .read import read_recording
from .recording import JointLog, Recording
from .rest import Rest, find_rests, match_clocks
from .write import Imported, import_recording

__all__ = [
    "Imported",
    "JointLog",
    "Recording",
    "Rest",
    "find_rests",
    "import_recording",
    "match_clocks",
    "read_recording",
]
