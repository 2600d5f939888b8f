"""The result of a diagnosis, as a frozen dataclass around the JSON of the public format."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .._core import MirrorPostureError
from ..input_files import read_text, reason
from ..output_files import is_whole
from ..short_repr import ShortRepr
from .parsing import read_fields
from .parts import Cause, Data, Field, Gap, Limit, Place, Ranked, SeenMarker, Signature, Track, Witness

LARGEST_DOCUMENT = 256_000_000
"""Bytes of diagnosis.json at most; with all panels of a large session it has some millions."""
FORMAT, VERSION = "mirror-posture/diagnosis", 2
VERSIONS = (1, 2)
"""Those that are read; the last is what `diagnose` writes."""
VERDICTS = ("insufficient", "none", "explained", "partial", "unknown")


@dataclass(frozen=True, repr=False)
class Diagnosis(ShortRepr):
    """Where the model is wrong, by which effect, and how far the gap shrinks."""

    verdict: str
    sentence: str
    causes: tuple[Cause, ...]
    where: tuple[Place, ...]
    gap: Gap
    next_postures: tuple[Mapping[str, float], ...] = ()
    """Commanded postures, joint name to rad (m), that would best separate the alternatives."""
    warnings: tuple[str, ...] = ()
    noise: Mapping[str, float] = field(default_factory=dict)
    """Estimated noise, one axis: corners and markers in px, points in m, as the names say."""
    trace: tuple[str, ...] = ()
    ranking: tuple[Ranked, ...] = ()
    signatures: tuple[Signature, ...] = ()
    tracks: tuple[Track, ...] = ()
    """Signatures of errors with a direction."""
    fields: tuple[Field, ...] = ()
    """Signatures of lens, board and mirror."""
    witness: tuple[Witness, ...] = ()
    markers: tuple[SeenMarker, ...] = ()
    """Posture by posture, if requested (`markers=True`)."""
    data: Data = field(default_factory=Data)
    """Which data were used, and what was left out."""
    limits: tuple[Limit, ...] = ()
    """What could have been seen: one entry for each effect and place; empty in a document of version 1."""
    prismatic_joints: tuple[str, ...] = ()
    """Prismatic joints: their parameters are in m where names say rad."""
    interrupted: bool = False
    """Whether it was stopped before its end and contains a partial result: no gap, no limits, alternatives
    not compared."""
    document: Mapping[str, Any] = field(default_factory=dict, repr=False)
    """The JSON tree as the core gave it, with all that the format does not know."""

    @classmethod
    def from_document(cls, tree: Mapping[str, Any]) -> Diagnosis:
        """A diagnosis from its JSON tree. Raises `MirrorPostureError` for a tree of another format."""
        version = tree.get("version")
        if tree.get("format") != FORMAT or isinstance(version, bool) or version not in VERSIONS:
            raise MirrorPostureError(
                f"got format {tree.get('format')!r} version {version!r}, needed {FORMAT!r} version "
                f"{' or '.join(map(str, VERSIONS))}"
            )
        if tree.get("verdict") not in VERDICTS:
            raise MirrorPostureError(
                f"verdict: got {tree.get('verdict')!r}, needed one of {', '.join(VERDICTS)}"
            )
        try:
            sliding = {f"joint:{name}" for name in tree.get("prismatic_joints", ())}
            return cls(**read_fields(cls, {"sentence": "", **tree}, sliding=sliding), document=dict(tree))
        except (KeyError, TypeError, AttributeError, ValueError, OverflowError) as error:
            raise MirrorPostureError(
                f"is no diagnosis of version {version}: {type(error).__name__}: {error}"
            ) from None

    @classmethod
    def load(cls, file: str | os.PathLike[str]) -> Diagnosis:
        """Reads `diagnosis.json`, or the folder that `mirror-posture diagnose --out` wrote.

        Raises `MirrorPostureError`, which names the file and what is wrong with it.
        """
        path = Path(file)
        if path.is_dir():
            path = path / "diagnosis.json"
        try:
            if not is_whole(path.parent):
                raise MirrorPostureError(
                    f"{path.parent}: was cut off while its files were replaced; run `mirror-posture diagnose` again"
                )
            tree = json.loads(read_text(path, LARGEST_DOCUMENT))
        except FileNotFoundError:
            raise MirrorPostureError(
                f"{path}: the file is missing; `mirror-posture diagnose` writes it"
            ) from None
        except (OSError, ValueError, RecursionError) as error:
            raise MirrorPostureError(f"{path}: cannot be read as JSON ({reason(error)})") from None
        if not isinstance(tree, Mapping):
            raise MirrorPostureError(f"{path}: got a {type(tree).__name__}, needed an object")
        try:
            return cls.from_document(tree)
        except MirrorPostureError as error:
            raise MirrorPostureError(f"{path}: {error}") from None

    def to_json(self) -> str:
        """The diagnosis as the public format has it."""
        return json.dumps(self.document, indent=1, allow_nan=False, ensure_ascii=False) + "\n"
