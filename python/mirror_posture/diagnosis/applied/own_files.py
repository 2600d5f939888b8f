"""What was found, written into copies of the files in which people keep it, each with its patch."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..._core import MirrorPostureError
from ...output_files import write_file
from ...session import Session
from ..result import Diagnosis
from .apply import ROBOT, parts_of
from .lerobot import patch_lerobot
from .own_mjcf import patch_own_mjcf
from .own_urdf import patch_own_urdf, patch_text
from .ur_calibration import patch_ur_calibration
from .urdf import Urdf
from .xml_text import read_xml


@dataclass(frozen=True)
class OwnFile:
    """A user's file: its corrected copy, the patch beside it, and what became of the causes that concern it."""

    file: Path
    patch: Path
    told: tuple[str, ...]


def write_own_files(
    session: Session,
    found: Diagnosis,
    folder: Path,
    *,
    urdf: Path | None = None,
    mjcf: Path | None = None,
    lerobot: Path | None = None,
    ur: Path | None = None,
    motors: str = "feetech",
) -> tuple[OwnFile, ...]:
    """Writes corrected copies of a user's files into the folder that `apply_diagnosis` writes (its `also`), and a patch for each.

    The user's files themselves stay as they are. `git apply` or `patch` in their own folder makes the change there.

    Raises:
        MirrorPostureError: a file that is missing or another robot's; two files of one name.
    """
    causes = [part for cause in found.causes for part in parts_of(cause)]
    written = []
    taken = {path.name for path in folder.iterdir()}
    for own in (urdf, mjcf, lerobot, ur):
        if own is None:
            continue
        if not own.is_file():
            raise MirrorPostureError(f"{own}: there is no such file")
        # A session keeps its own robot.urdf under that name.
        out = folder / (own.name if own.name not in taken else f"own-{own.name}")
        if out.exists():
            raise MirrorPostureError(f"{out}: is there already; rename {own}")
        if own is urdf:
            before = Urdf(read_xml(session.robot_file))
            changed = patch_own_urdf(own, before, Urdf(read_xml(folder / ROBOT)), out)
            told = tuple(f"joint {name}" for name in changed)
        elif own is mjcf:
            told = _lines(patch_own_mjcf(own, causes, out))
        elif own is ur:
            before = Urdf(read_xml(session.robot_file))
            told = patch_ur_calibration(own, before, Urdf(read_xml(folder / ROBOT)), out)
        else:
            told = _lines(patch_lerobot(own, causes, out, motors))
        patch = folder / f"{out.name}.patch"
        before_text, after_text = (path.read_bytes().decode("utf-8") for path in (own, out))
        write_file(patch, patch_text(before_text, after_text, own.name).encode("utf-8"))
        written.append(OwnFile(out, patch, told))
    return tuple(written)


def _lines(told: dict[tuple[str, str], str]) -> tuple[str, ...]:
    return tuple(f"{effect} at {place}: {what}" for (effect, place), what in told.items())
