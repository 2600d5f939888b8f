"""Fuzz targets of the session's parsers: mangled files load or are refused with one line, never anything else."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mirror_posture import MirrorPostureError, load_session
from session_folder import FILES, write_folder

SETTINGS = settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)

# Tokens that mean something to one of the parsers, so that mangling gets past the first check.
TOKENS = [
    b"", b"\n", b",", b"\"", b"\x00", b"\xff\xfe", b"nan", b"-inf", b"1e999", b"9" * 40, b"-1", b"0x10", b"[", b"]",
    b"{", b"}", b"=", b": ", b"&a *a", b"!!python/object:os.system", b"true", b"null", b"2020-01-01", b"\xef\xbb\xbf",
    b"<", b"/>", b"&lol;", b"board", b"measured:", "ä".encode(), b"'''", b"1_000", b"\r",
]  # fmt: skip


@st.composite
def mangled(draw: st.DrawFn, original: bytes) -> bytes:
    """The bytes with up to four places cut out, doubled or replaced by a token."""
    text = original
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(text)))
        end = min(len(text), start + draw(st.integers(0, 30)))
        token = draw(st.sampled_from(TOKENS) | st.binary(max_size=8))
        text = draw(
            st.sampled_from(
                [
                    text[:start] + token + text[end:],
                    text[:start],
                    text[:end] + text[start:],
                    text[:start] + token + text[start:],
                ]
            )
        )
    return text


def loads_or_refuses(folder: Path) -> None:
    try:
        session = load_session(folder)
    except MirrorPostureError as error:
        assert "\n" not in str(error)
        return
    for array in (session.frames.commanded, session.mirror_view.board_px, session.mirror_view.marker_px):
        assert np.isfinite(array).all()


@pytest.mark.parametrize("name", sorted(FILES))
@SETTINGS
@given(data=st.data())
def test_mangled_file(name: str, tmp_path: Path, data: st.DataObject) -> None:
    folder = write_folder(tmp_path / "session")
    (folder / name).write_bytes(data.draw(mangled(FILES[name].encode())))
    loads_or_refuses(folder)


@pytest.mark.parametrize("stem", ["frames", "detections", "points"])
@SETTINGS
@given(data=st.data())
def test_mangled_parquet(stem: str, tmp_path: Path, data: st.DataObject) -> None:
    folder = write_folder(tmp_path / "session")
    buffer = io.BytesIO()
    pyarrow.parquet.write_table(pyarrow.csv.read_csv(folder / f"{stem}.csv"), buffer)
    (folder / f"{stem}.csv").unlink()
    (folder / f"{stem}.parquet").write_bytes(data.draw(mangled(buffer.getvalue())))
    loads_or_refuses(folder)
