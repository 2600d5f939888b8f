"""File names made from the names of joints, markers and meshes, which may contain anything."""

from __future__ import annotations

import hashlib
import re

MOST = 80
"""Characters that are kept: with a hash and endings far below the 255 bytes that file systems take."""
RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?")
"""Names that are devices on Windows, whatever their ending."""


def file_name_of(name: str) -> str:
    """A file name, without its ending, for a name that may hold anything; different names have different ones.

    Small letters, digits, `_`, `-` and dots inside are kept; anything else becomes `_`, and then a part of the name's SHA-256 keeps it
    apart from others: also from those that differ in capitals only, which are one file on many systems.
    """
    kept = re.sub(r"[^a-z0-9_.-]+", "_", name.lower())[:MOST].strip("._-")
    if kept and kept == name and not RESERVED.fullmatch(kept):
        return name
    mark = hashlib.sha256(name.encode("utf-8", "surrogatepass")).hexdigest()[:8]
    # In front: a device's name is one with any ending.
    return f"{mark}-{kept}".rstrip("-")
