"""Input files, read within limits: only regular files inside their folder, of plausible size.

A named pipe would block forever, a link could expose another's file, and a few kilobytes of YAML aliases
expand to gigabytes: each is refused before anything of it is read.
"""

from __future__ import annotations

import os
import stat
import sys
from pathlib import Path
from typing import IO, Any

from ._core import MirrorPostureError

if sys.version_info >= (3, 11):
    import tomllib
else:  # pragma: no cover
    import tomli as tomllib

PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".pgm", ".ppm")
LARGEST_TEXT = 1_000_000
"""Bytes of a text of keys (TOML, YAML) at most: the largest known ones have some ten thousand."""
LARGEST_MODEL = 64_000_000
"""Bytes of a URDF at most, as in the core."""
LARGEST_TABLE = 256_000_000
"""Largest size of a table, bytes; text cells take about twice as much in memory."""
MOST_YAML_PARTS = 20_000
"""Keys, values and lists of a YAML text at most."""
DEEPEST_YAML = 20
"""Lists and keys within each other at most."""


def path_inside(folder: Path, name: str) -> Path | None:
    """The path of a file that a session names, or None where it leaves the session's folder, by name or by a link."""
    path = Path(name)
    if path.is_absolute() or ".." in path.parts or "\\" in name or "\0" in name:
        return None
    found = folder / path
    try:
        inside = found.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError):
        # A circle of links.
        return None
    return found if inside else None


def read_regular(file: Path, largest: int) -> bytes:
    """The bytes of a regular file.

    Raises:
        OSError: it is missing, cannot be read, is no regular file, or has more than `largest` bytes.
    """
    with open_regular(file, largest) as stream:
        # A file that grows meanwhile is still bounded.
        data = stream.read(largest + 1)
    if len(data) > largest:
        raise OSError(None, f"has more than {largest} bytes, needed at most {largest}")
    return data


def open_regular(file: Path, largest: int) -> IO[bytes]:
    """A regular file, open for reading.

    Raises:
        OSError: as `read_regular`.
    """
    # Without O_NONBLOCK, opening a named pipe waits until something writes to it.
    handle = os.open(file, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    kind = os.fstat(handle)
    if not stat.S_ISREG(kind.st_mode) or kind.st_size > largest:
        os.close(handle)
        raise OSError(
            None,
            f"has {kind.st_size} bytes, needed at most {largest}"
            if stat.S_ISREG(kind.st_mode)
            else "is no regular file (a folder, a pipe or a device); needed a file",
        )
    return os.fdopen(handle, "rb")


def read_text(file: Path, largest: int = LARGEST_TEXT) -> str:
    """The text of a regular file in UTF-8, with or without a byte order mark.

    Raises:
        OSError: as `read_regular`.
        UnicodeDecodeError: it is no UTF-8.
    """
    return read_regular(file, largest).decode("utf-8-sig")


def reason(error: Exception) -> str:
    """The message of a reading error, in one line, without the path."""
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return " ".join(text.split()) or type(error).__name__


def given_text(file: str | os.PathLike[str], needed: str, largest: int = LARGEST_TEXT) -> str:
    """The text of a file that somebody names (an option, an argument); as `read_text`.

    Raises `MirrorPostureError`, which names the file, for what `read_text` refuses.
    """
    try:
        return read_text(Path(file), largest)
    except FileNotFoundError:
        raise MirrorPostureError(f"{os.fspath(file)}: there is no such file; needed {needed}") from None
    # ValueError: a null character in the path, or no UTF-8.
    except (OSError, ValueError) as error:
        raise MirrorPostureError(
            f"{os.fspath(file)}: cannot be read ({reason(error)}); needed {needed}"
        ) from None


def parse_toml(text: str) -> dict[str, Any]:
    """A TOML document as plain values. Raises `ValueError`, in one line, for any other text."""
    try:
        document: dict[str, Any] = tomllib.loads(text)
        return document
    # A very deep or odd document can fail below the parser with errors of Python's own.
    except (ValueError, RecursionError, OverflowError) as error:
        raise ValueError(" ".join(str(error).split())) from None


def parse_yaml(text: str, needed: str, most_parts: int = MOST_YAML_PARTS) -> Any:
    """A YAML document as plain values, in time and memory linear in its size.

    Raises:
        ValueError: no YAML, or YAML with aliases, too many parts or too deep: they can unfold without end, and nothing
            that is read here needs them.
    """
    import yaml

    # libyaml's parser takes a twentieth of the time. What it refuses is told in the words of the one in Python.
    if yaml.__with_libyaml__:
        try:
            return _yaml_by(yaml.CSafeLoader, text, needed, most_parts)
        except _UnfoldingError:
            raise
        except ValueError:
            pass
    return _yaml_by(yaml.SafeLoader, text, needed, most_parts)


def _yaml_by(loader: Any, text: str, needed: str, most_parts: int) -> Any:
    import yaml

    try:
        depth = 0
        for count, event in enumerate(yaml.parse(text, Loader=loader)):
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if isinstance(event, yaml.AliasEvent):
                line = event.start_mark.line + 1 if event.start_mark else 0
                raise _UnfoldingError(
                    f"line {line}: got a YAML alias (*{event.anchor}), needed the value itself"
                )
            if count > most_parts or depth > DEEPEST_YAML:
                raise _UnfoldingError(f"got YAML of very many or deep parts, needed {needed}")
        return yaml.load(text, Loader=loader)
    except _UnfoldingError:
        raise
    # Odd scalars (dates, huge integers) and deep nesting fail with errors of Python's own.
    except (yaml.YAMLError, ValueError, RecursionError, OverflowError) as error:
        raise ValueError(f"is no YAML ({' '.join(str(error).split())}); needed {needed}") from None


class _UnfoldingError(ValueError):
    """YAML that is refused for its size."""
