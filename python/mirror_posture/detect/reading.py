"""Reads pictures, and says in one line why one cannot be read.

Pixels are used as stored: a picture is never rotated by its EXIF tag, because the camera file describes
stored pixels. The tag is kept, to name it if a picture's size does not fit.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
from PIL import Image, JpegImagePlugin, UnidentifiedImageError

from .._core import plain_png
from ..arguments import checked_arguments
from ..input_files import PICTURE_SUFFIXES, read_regular, reason
from ..picture_files import MOST_PIXELS
from ..short_repr import ShortRepr
from .recoded import Codec
from .types import DetectionError

Picture = npt.NDArray[np.uint8]

MIN_SIDE_PX = 16
LARGEST_LEVEL = 65535
"""Of a grey picture of 16 bits."""
LARGEST_PICTURE = 1_000_000_000
"""Bytes of a picture's file at most: more than 150 million pixels of 48 bits have."""

SAMPLINGS_PX = {0: (1, 1), 1: (2, 1), 2: (2, 2)}
"""Pixels across and down that share a colour, by Pillow's number of a JPEG's sampling."""
STEPS = 64
"""Coefficients of a JPEG's block."""

EXIF_ORIENTATION = 0x0112
EXIF_TURNS = {
    2: "mirrored left-right",
    3: "turned by 180°",
    4: "mirrored up-down",
    5: "mirrored and turned by 90°",
    6: "turned by 90°",
    7: "mirrored and turned by 90°",
    8: "turned by 90°",
}

_Turn = Image.Transpose
TURNED_BACK = {
    2: _Turn.FLIP_LEFT_RIGHT, 3: _Turn.ROTATE_180, 4: _Turn.FLIP_TOP_BOTTOM, 5: _Turn.TRANSPOSE, 6: _Turn.ROTATE_90, 7: _Turn.TRANSVERSE,
    8: _Turn.ROTATE_270,
}  # fmt: skip
"""What undoes the turn that a viewer makes."""


@dataclass(frozen=True, eq=False, repr=False)
class PictureFile(ShortRepr):
    """A picture's pixels as stored, BGR `(H, W, 3)` uint8, and properties of its file.

    `exif_turn`: how a viewer would show it ("" as stored). `chroma_step_px`: pixels that share a colour,
    across and down: (2, 2) in a JPEG of 4:2:0. `quantisation_step`: mean step of a JPEG's ten finest
    coefficients of brightness, levels: about 2 at quality 92, 13 at 50; 0 where nothing is lost. `codec`:
    how a JPEG in colour was coded.
    """

    pixels: Picture
    exif_turn: str = ""
    chroma_step_px: tuple[int, int] = (1, 1)
    quantisation_step: float = 0.0
    codec: Codec | None = None


@checked_arguments
def read_picture(path: Path | str) -> Picture:
    """A picture as BGR `(H, W, 3)` uint8, as stored (EXIF turns are not applied).

    Raises `DetectionError` naming the file for one that is missing, empty, broken (also half broken), too large or no picture.
    """
    return read_picture_file(path).pixels


def read_picture_file(path: Path | str) -> PictureFile:
    """A picture with the properties of its file. Raises as `read_picture`; the size is checked before
    anything is decoded."""
    file = Path(path)
    try:
        content = read_regular(file, LARGEST_PICTURE)
    except FileNotFoundError:
        raise DetectionError(f"{file}: the picture is missing; put it there or correct its path") from None
    # ValueError: a null character in the path.
    except (OSError, ValueError) as error:
        raise DetectionError(f"{file}: the picture cannot be read: {reason(error)}") from None
    if not content:
        raise DetectionError(f"{file}: the picture is empty (0 bytes); take or copy it again")
    known = file.suffix.lower() in PICTURE_SUFFIXES
    try:
        picture = Image.open(io.BytesIO(content))
    except Image.DecompressionBombError:
        raise DetectionError(
            f"{file}: the picture has far more than {MOST_PIXELS // 10**6} million pixels"
        ) from None
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError):
        kind = "broken" if known else "no picture (known: PNG, JPEG, BMP, TIFF, WebP)"
        raise DetectionError(f"{file}: the picture is {kind}; take or copy it again") from None
    _check_size(*picture.size, str(file))
    try:
        # A plain PNG has no tags, for which Pillow would decode it.
        pixels: npt.NDArray[np.generic] | None = plain_png(content) if picture.format == "PNG" else None
        orientation = 1 if pixels is not None else picture.getexif().get(EXIF_ORIENTATION, 1)
        turn = EXIF_TURNS.get(orientation, "")
        if pixels is None:
            pixels = (
                _jpeg(content, str(file))
                if _is_plain_jpeg(picture)
                else _bgr(_as_stored(picture, orientation), str(file))
            )
    # Decoders fail with errors of many kinds, broken metadata included.
    except DetectionError:
        raise
    except (OSError, ValueError, SyntaxError, IndexError, TypeError, EOFError, MemoryError) as error:
        detail = " ".join(str(error).split())
        raise DetectionError(f"{file}: the picture is broken ({detail}); take or copy it again") from None
    step = (2, 2) if _is_lossy_webp(content) else _chroma_step(picture)
    return PictureFile(
        as_picture(pixels, str(file)), turn, step, _quantisation_step(picture), _codec(picture)
    )


def _is_plain_jpeg(picture: Image.Image) -> bool:
    return isinstance(picture, JpegImagePlugin.JpegImageFile) and picture.mode in ("RGB", "L")


def _jpeg(content: bytes, name: str) -> Picture:
    """A JPEG by libjpeg-turbo, strictly: Pillow returns a scratched one as if nothing were wrong."""
    import simplejpeg

    try:
        pixels: Picture = simplejpeg.decode_jpeg(content, "BGR", strict=True)
    except ValueError as error:
        raise DetectionError(
            f"{name}: the picture is broken in part ({' '.join(str(error).split())}); take or copy it again"
        ) from None
    return pixels


def _as_stored(picture: Image.Image, orientation: int) -> Image.Image:
    """Pillow turns a TIFF by its tag as it loads it, and then the tag is gone: that is turned back."""
    picture.load()
    if orientation in TURNED_BACK and picture.getexif().get(EXIF_ORIENTATION, 1) != orientation:
        return picture.transpose(TURNED_BACK[orientation])
    return picture


def _bgr(picture: Image.Image, name: str) -> npt.NDArray[np.generic]:
    if picture.mode in ("I;16", "I;16B", "I;16L"):
        return np.asarray(picture).astype(np.uint16)
    if picture.mode == "I":
        # Grey of 32 bits, in which 16 are stored. Pillow's own conversion would cut off all above 255.
        levels = np.asarray(picture)
        least, most = int(levels.min()), int(levels.max())
        if least < 0 or most > LARGEST_LEVEL:
            raise DetectionError(
                f"{name}: has grey levels from {least} to {most}; needed 0 to {LARGEST_LEVEL}; save it with 8 or 16 bits"
            )
        return levels.astype(np.uint16)
    if picture.mode == "F":
        return np.asarray(picture)
    if picture.mode in ("1", "L"):
        return np.asarray(picture.convert("L"))
    rgb = picture if picture.mode == "RGB" else picture.convert("RGB")
    return cv2.cvtColor(np.asarray(rgb), cv2.COLOR_RGB2BGR)


def _is_lossy_webp(content: bytes) -> bool:
    """Whether a file is a WebP of the lossy kind, which always keeps colour at half of the resolution (RFC 9649)."""
    if content[:4] != b"RIFF" or content[8:12] != b"WEBP":
        return False
    at = 12
    while at + 8 <= len(content):
        kind = content[at : at + 4]
        if kind in (b"VP8 ", b"VP8L"):
            return kind == b"VP8 "
        # Chunks have even lengths.
        length = int.from_bytes(content[at + 4 : at + 8], "little")
        at += 8 + length + length % 2
    return False


def _chroma_step(picture: Image.Image) -> tuple[int, int]:
    if not isinstance(picture, JpegImagePlugin.JpegImageFile) or picture.mode != "RGB":
        return (1, 1)
    # Components as (id, horizontal, vertical, table): the first is the luma.
    layers = picture.layer
    if len(layers) != 3:
        return (1, 1)
    across = max(1, layers[0][1] // max(layers[1][1], 1))
    down = max(1, layers[0][2] // max(layers[1][2], 1))
    # 3 is allowed, and as good as never used: treated as the wider one.
    return 4 if across > 2 else across, 4 if down > 2 else down


def _quantisation_step(picture: Image.Image) -> float:
    tables = picture.quantization if isinstance(picture, JpegImagePlugin.JpegImageFile) else {}
    table = sorted(tables.get(0, ()))
    return float(np.mean(table[:10])) if table else 0.0


def _codec(picture: Image.Image) -> Codec | None:
    """How a JPEG in colour was coded; None for another file, and for an unusual sampling."""
    if not isinstance(picture, JpegImagePlugin.JpegImageFile) or picture.mode != "RGB":
        return None
    sampling = SAMPLINGS_PX.get(JpegImagePlugin.get_sampling(picture))
    # Brightness has the first table, the colours the next one, if there is another.
    tables = [tuple(picture.quantization[number]) for number in sorted(picture.quantization)][:2]
    if sampling is None or not tables or any(len(table) != STEPS or min(table) < 1 for table in tables):
        return None
    return Codec(tables[0], tables[-1], sampling)


def _check_size(width: int, height: int, name: str) -> None:
    if height < MIN_SIDE_PX or width < MIN_SIDE_PX or height * width > MOST_PIXELS:
        raise DetectionError(
            f"{name}: is {width} × {height} px; needed at least {MIN_SIDE_PX} px a side and at most {MOST_PIXELS // 10**6} million pixels"
        )


def as_picture(values: npt.ArrayLike, name: str = "picture") -> Picture:
    """Checks an array and returns it as BGR uint8: accepts grey or BGR(A), 8 or 16 bits, or floats in 0..1."""
    array = np.asarray(values)
    if array.ndim == 3 and array.shape[2] == 1:
        array = array[..., 0]
    if array.ndim not in (2, 3) or (array.ndim == 3 and array.shape[2] not in (3, 4)):
        raise DetectionError(f"{name}: has shape {array.shape}; needed (H, W) grey or (H, W, 3) BGR")
    _check_size(array.shape[1], array.shape[0], name)
    if array.dtype == np.uint16:
        array = (array >> 8).astype(np.uint8)
    elif array.dtype == np.bool_:
        array = array.astype(np.uint8) * np.uint8(255)
    elif np.issubdtype(array.dtype, np.floating):
        if not np.isfinite(array).all():
            raise DetectionError(f"{name}: holds a number that is not finite")
        if array.min() < 0.0 or array.max() > 1.0:
            raise DetectionError(
                f"{name}: floating-point pictures need values in 0..1, got {array.min():.3g} to {array.max():.3g}"
            )
        array = np.rint(array * 255.0).astype(np.uint8)
    elif array.dtype != np.uint8:
        raise DetectionError(f"{name}: has type {array.dtype}; needed uint8, uint16, or floats in 0..1")
    array = np.ascontiguousarray(array)
    if array.ndim == 2:
        return np.repeat(array[..., None], 3, axis=2)
    return np.ascontiguousarray(array[..., :3])


@checked_arguments
def list_pictures(folder: Path | str) -> tuple[Path, ...]:
    """The pictures of a folder, sorted by name. Raises `DetectionError` for a folder that is missing or has none."""
    place = Path(folder)
    if not place.is_dir():
        raise DetectionError(f"{place}: is no folder; give the folder that holds the pictures")
    found = tuple(
        sorted(file for file in place.iterdir() if file.suffix.lower() in PICTURE_SUFFIXES and file.is_file())
    )
    if not found:
        raise DetectionError(f"{place}: holds no pictures (known: {', '.join(PICTURE_SUFFIXES)})")
    return found
