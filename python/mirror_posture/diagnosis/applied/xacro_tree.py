"""A robot written in xacro: its files as text, and the URDF into which the package `xacro` expands them."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from xml.parsers.expat import ExpatError

from ..._core import MirrorPostureError
from .xml_text import XmlText, read_xml

MOST_FILES = 200
PACKAGE_FILE = "package.xml"


def is_xacro(text: str) -> bool:
    """Whether a robot's file is xacro that was not expanded yet."""
    return "xmlns:xacro" in text and ("<xacro:" in text or "${" in text or "$(" in text)


class XacroTree:
    """A xacro file with the files that it includes.

    `sources` are the texts by file, the main one first. `arguments` are those of the command line (`NAME:=VALUE`). `$(find NAME)` is the
    folder that `packages` gives, else the folder above the file whose package.xml has that name, else what ROS finds.

    Raises:
        MirrorPostureError: the package `xacro` is missing, or the file cannot be expanded.
    """

    def __init__(
        self,
        main: Path,
        arguments: Mapping[str, str] | None = None,
        packages: Mapping[str, Path] | None = None,
    ) -> None:
        self.main = main.absolute()
        self._arguments, self._packages = dict(arguments or {}), dict(packages or {})
        self.sources: dict[Path, str] = {self.main: read_xml(self.main)}
        xacro = _xacro()
        xacro.all_includes.clear()
        self.expand({})
        for name in list(dict.fromkeys(xacro.all_includes))[:MOST_FILES]:
            file = Path(name).absolute()
            if file not in self.sources:
                self.sources[file] = read_xml(file)

    def expand(self, edited: Mapping[Path, str]) -> str:
        """The URDF of the files with some of their texts replaced.

        Raises:
            MirrorPostureError: xacro refuses them, with its words.
        """
        xacro = _xacro()
        texts = {file: text.removeprefix("\ufeff") for file, text in {**self.sources, **edited}.items()}
        said = io.StringIO()
        try:
            with _replaced(xacro, texts, self._find), contextlib.redirect_stderr(said):
                document = xacro.process_file(str(self.main), mappings=dict(self._arguments))
        # xacro's own errors are of many kinds; each is an answer about the user's file.
        except (Exception, SystemExit) as error:
            where = next((str(name) for name in reversed(xacro.filestack or []) if name), str(self.main))
            words = str(error)
            if "substitution argument" in words:
                words += "; give it: --xacro-arg NAME=VALUE"
            if isinstance(error, ExpatError):
                words = f"is no XML: {error}"
            raise MirrorPostureError(
                f"{where}: xacro cannot expand it: {' '.join(words.split()) or type(error).__name__}"
            ) from None
        text: str = document.toxml()
        return text

    def _find(self, package: str) -> str:
        if package in self._packages:
            return str(self._packages[package].absolute())
        for above in self.main.parents:
            file = above / PACKAGE_FILE
            if file.is_file() and _package_name(file) == package:
                return str(above)
        try:
            from ament_index_python.packages import get_package_share_directory  # type: ignore[import-not-found, unused-ignore]

            return str(get_package_share_directory(package))
        except Exception:
            raise MirrorPostureError(
                f"package {package!r} is not found; give its folder: --package {package}=FOLDER"
            ) from None


def _package_name(file: Path) -> str:
    name = next((e for e in XmlText(read_xml(file), str(file)).elements if e.tag == "name"), None)
    found = None if name is None else re.search(r"<name[^>]*>\s*([^<\s]+)\s*</name>", read_xml(file))
    return found[1] if found else ""


def _xacro() -> Any:
    try:
        import xacro  # type: ignore[import-untyped, import-not-found, unused-ignore]
    except ImportError:
        raise MirrorPostureError("xacro files need: pip install 'mirror-posture[xacro]'") from None
    return xacro


@contextlib.contextmanager
def _replaced(xacro: Any, texts: Mapping[Path, str], find: Any) -> Iterator[None]:
    """xacro with these texts in place of the files, and with this search for packages: it offers no way to give either."""
    from xacro import substitution_args

    parse, found = xacro.parse, substitution_args._eval_find

    def parse_text(given: Any, filename: str | None = None) -> Any:
        file = None if filename is None else Path(filename).absolute()
        return parse(texts.get(file) if given is None and file is not None else given, filename)

    xacro.parse, substitution_args._eval_find = parse_text, find
    functions = substitution_args._eval_dict
    before = functions["find"]
    functions["find"] = find
    try:
        yield
    finally:
        xacro.parse, substitution_args._eval_find, functions["find"] = parse, found, before
