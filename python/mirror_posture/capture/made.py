"""What a capture notes beside the session: which pictures it made, and where in a film they are.

`capture.json` has for each frame the SHA-256 of its picture, and, of a film, the film and the picture's second in it. It is
written before the picture, so that a kill at any moment leaves no picture that nobody knows.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from ..input_files import LARGEST_TABLE, read_regular
from ..output_files import write_file

MADE = "capture.json"


class Made:
    """The notes of the captures into one folder. A file that is none of theirs counts as no notes."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / MADE
        self._frames: dict[str, dict[str, Any]] = {}
        try:
            tree = json.loads(read_regular(self._file, LARGEST_TABLE))
        except (OSError, ValueError, RecursionError):
            return
        frames = tree.get("frames") if isinstance(tree, dict) else None
        if isinstance(frames, dict):
            self._frames = {name: note for name, note in frames.items() if isinstance(note, dict)}

    def note(self, frame: int, picture: bytes, film: str, film_s: float) -> None:
        """A picture that is to be written next; `film` is empty where it is of none."""
        before = self._frames.get(str(frame), {}).get("sha256")
        # The one before as well: a kill can come before it is replaced.
        digests = [*(before if isinstance(before, list) else [])[-1:], hashlib.sha256(picture).hexdigest()]
        self._frames[str(frame)] = {
            "sha256": digests,
            **({"film": film, "film_s": float(film_s)} if film else {}),
        }
        self._write()

    def begin_anew(self, pictures: Mapping[int, Path]) -> None:
        """The frames are replaced: these pictures may be, by this capture or one that goes on with it, and no film has been begun."""
        anew = {name: {"sha256": note.get("sha256")} for name, note in self._frames.items()}
        for frame, picture in pictures.items():
            anew[str(frame)] = {"sha256": [hashlib.sha256(read_regular(picture, LARGEST_TABLE)).hexdigest()]}
        self._frames = anew
        self._write()

    def made(self, frame: int, picture: Path) -> bool:
        """Whether a capture made the picture, as it is now: one that was changed since is somebody's."""
        digests = self._frames.get(str(frame), {}).get("sha256")
        try:
            found = hashlib.sha256(read_regular(picture, LARGEST_TABLE)).hexdigest()
        except OSError:
            return False
        return isinstance(digests, list) and found in digests

    def last_in(self, film: str, frames: Iterable[int]) -> tuple[int, float] | None:
        """Of these frames the one that lies last in the film, and its second; None where none is of it."""
        found = []
        for frame in frames:
            note = self._frames.get(str(frame), {})
            second = note.get("film_s")
            if note.get("film") == film and isinstance(second, float) and math.isfinite(second):
                found.append((second, frame))
        if not found:
            return None
        second, frame = max(found)
        return frame, second

    def _write(self) -> None:
        write_file(self._file, json.dumps({"frames": self._frames}, indent=1))
