"""Writing a session: what is read back is what was written, bit for bit, and a failure leaves the place as it was."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from mirror_posture import Mirror, MirrorPostureError, SessionError, load_session
from mirror_posture.session import Noise, Session, Views, write_detections, write_session
from mirror_posture.session.replaced import MESHES
from mirror_posture.shapes.of_links import COARSE_FOLDER
from session_folder import DATA, FRAMES, SESSION, write_folder


def assert_same(a: Session, b: Session) -> None:
    for part in ("frames", "mirror_view", "direct_view", "points"):
        one, other = getattr(a, part), getattr(b, part)
        assert (one is None) == (other is None), part
        for field in dataclasses.fields(one) if one is not None else ():
            x, y = getattr(one, field.name), getattr(other, field.name)
            if isinstance(x, np.ndarray):
                np.testing.assert_array_equal(x, y, err_msg=f"{part}.{field.name}")
            else:
                assert x == y, f"{part}.{field.name}"
    for name in ("root_link", "camera", "camera_link", "board", "markers", "mirror", "noise", "detected"):
        assert getattr(a, name) == getattr(b, name), name
    np.testing.assert_array_equal(a.gravity_m_per_s2, b.gravity_m_per_s2)
    assert a.robot_file.read_bytes() == b.robot_file.read_bytes()


pixels = st.floats(-0.5, 599.0, allow_nan=False)
joints = st.floats(-1.9, 1.9, allow_nan=False)


@st.composite
def views(draw: st.DrawFn, template: Views) -> Views:
    """Any views of the template's sizes; what is not seen holds 0, as it does when it is read."""
    board_seen = draw(npst.arrays(bool, template.board_seen.shape))
    marker_seen = draw(npst.arrays(bool, template.marker_seen.shape))
    board = draw(npst.arrays(float, template.board_px.shape, elements=pixels))
    marker = draw(npst.arrays(float, template.marker_px.shape, elements=pixels))
    std = [
        draw(npst.arrays(float, seen.shape, elements=st.floats(1e-6, 10.0))) * seen
        for seen in (board_seen, marker_seen)
    ]
    return Views(
        board * board_seen[..., None], board_seen, marker * marker_seen[..., None], marker_seen, *std
    )


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data(), tables=st.sampled_from(["csv", "parquet"]))
def test_round_trip(tmp_path: Path, data: st.DataObject, tables: str) -> None:
    session = load_session(write_folder(tmp_path / "in"))
    frames = dataclasses.replace(
        session.frames,
        frame=np.cumsum(data.draw(npst.arrays(np.int64, 3, elements=st.integers(1, 1000)))),
        posture=np.arange(3),
        commanded=data.draw(npst.arrays(float, (3, 2), elements=joints)),
        time_s=data.draw(st.none() | st.just(np.array([0.0, 1 / 3, 2e9 / 7]))),
        ordered=data.draw(st.booleans()),
    )
    session = dataclasses.replace(
        session,
        frames=frames,
        mirror_view=data.draw(views(session.mirror_view)),
        direct_view=data.draw(views(session.direct_view)),
    )
    if not (session.mirror_view.any_seen or session.direct_view.any_seen):
        return  # no row says a standard deviation
    write_session(session, tmp_path / "out", tables=tables, overwrite=True)
    assert_same(load_session(tmp_path / "out"), session)


def test_keys_that_the_format_does_not_know_survive(tmp_path: Path) -> None:
    text = SESSION + '\n[operator]\nname = "Zoë \\u0007"\nwhen = 2024-05-01T10:00:00Z\n'
    session = load_session(write_folder(tmp_path / "in", session=text))
    write_session(session, tmp_path / "out")
    assert load_session(tmp_path / "out").metadata["operator"] == session.metadata["operator"]


def test_what_was_taken_away_is_not_written(tmp_path: Path) -> None:
    told = SESSION.replace(
        'link = "camera_optical"', 'link = "camera_optical"\ntolerance_m = 0.002\ntolerance_rad = 0.01'
    )
    told = told.replace("square = 0.014", "square = 0.014\ntolerance_m = 0.003\ntolerance_rad = 0.02")
    told = told.replace("diameter = 0.0116", "diameter = 0.0116\ntolerance_m = 0.001\nglued_by = 'Zoë'")
    told = told.replace("refractive_index = 1.52", "width = 0.4\nheight = 0.6\ncenter = [0.5, 0.0, 0.1]")
    session = load_session(write_folder(tmp_path / "in", session=told))
    assert session.board and session.mirror and session.mirror.center_in_root_m and session.noise != Noise()
    session = dataclasses.replace(
        session,
        camera_tolerance_m=None,
        camera_tolerance_rad=None,
        board=dataclasses.replace(session.board, tolerance_m=None, tolerance_rad=None),
        markers=tuple(dataclasses.replace(m, color=None, tolerance_m=None) for m in session.markers),
        mirror=Mirror(0.003),
        noise=Noise(),
    )
    write_session(session, tmp_path / "out")
    better = load_session(tmp_path / "out")
    assert_same(better, session)
    assert (better.camera_tolerance_m, better.camera_tolerance_rad) == (None, None)
    assert [marker["glued_by"] for marker in better.metadata["markers"]] == ["Zoë", "Zoë"]


def test_refuses_to_write_over_a_folder(tmp_path: Path) -> None:
    session = load_session(write_folder(tmp_path / "in"))
    with pytest.raises(SessionError, match="is there already"):
        write_session(session, tmp_path / "in")


def test_a_failure_leaves_the_place_as_it_was(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "in")
    session = load_session(folder)
    session.robot_file.unlink()
    before = sorted(path.name for path in folder.iterdir())
    with pytest.raises(FileNotFoundError):
        write_session(session, folder, overwrite=True)
    assert sorted(path.name for path in folder.iterdir()) == before
    assert [path.name for path in tmp_path.iterdir()] == ["in"]


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_detections_alone_replace_the_table(tmp_path: Path, ending: str) -> None:
    folder = write_folder(tmp_path / "in")
    session = load_session(folder)
    (folder / "detections.csv").unlink()
    write_detections(session, folder / f"detections.{ending}")
    assert_same(load_session(folder), session)
    assert not [path for path in folder.iterdir() if path.name.startswith(".")]


def test_refuses_a_table_of_another_kind(tmp_path: Path) -> None:
    session = load_session(write_folder(tmp_path))
    with pytest.raises(SessionError, match=r"'\.xls'"):
        write_detections(session, tmp_path / "detections.xls")


def with_pictures(folder: Path, text: str = "picture") -> Path:
    """A session with pictures, shapes, and what a user keeps beside it."""
    lines = FRAMES.splitlines()
    rows = [lines[0] + ",image", *(f"{line},images/{n}.png" for n, line in enumerate(lines[1:]))]
    write_folder(folder, frames="\n".join(rows) + "\n")
    for name in ("images", "meshes", "plan", "diagnosis"):
        (folder / name).mkdir()
    for n in range(len(rows) - 1):
        (folder / f"images/{n}.png").write_text(f"{text} {n}")
    for name in (
        "images/left_out.png",
        "meshes/base.coarse.stl",
        "plan/postures.csv",
        "diagnosis/diagnosis.json",
    ):
        (folder / name).write_text(f"{text} {name}")
    (folder / "notes.md").write_text(text)
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()
    }


@pytest.mark.parametrize("tables", ["csv", "parquet"])
def test_a_session_written_over_itself_keeps_what_is_beside_it(tmp_path: Path, tables: str) -> None:
    """Before, meshes, plan, diagnosis and notes were deleted."""
    folder = with_pictures(tmp_path / "s")
    session, before = load_session(folder), contents(folder)
    write_session(session, folder, tables=tables, overwrite=True)
    after = contents(folder)
    written = {f"{stem}.csv" for stem in ("frames", "detections", "points")} | {"session.toml", "camera.yaml"}
    assert {name: data for name, data in before.items() if name not in written} == {
        name: data for name, data in after.items() if name in before and name not in written
    }
    assert sorted(after) == sorted(
        name.replace(".csv", f".{tables}") if name in written else name for name in before
    )
    assert_same(load_session(folder), session)


def test_over_another_session_its_pictures_and_shapes_go_and_notes_stay(tmp_path: Path) -> None:
    session = load_session(with_pictures(tmp_path / "mine", "mine"))
    other = with_pictures(tmp_path / "other", "other")
    shared = tmp_path / "shared.png"
    shared.hardlink_to(other / "images/0.png")
    write_session(session, other, overwrite=True)
    after = contents(other)
    assert after["images/0.png"] == b"mine 0" and after["meshes/base.coarse.stl"].startswith(b"mine")
    assert "images/left_out.png" not in after
    assert after["notes.md"] == b"other" and after["plan/postures.csv"].startswith(b"other")
    # Nothing is written into a file of the old folder that has another name too.
    assert shared.read_text() == "other 0"


def test_shapes_go_along_to_a_new_folder(tmp_path: Path) -> None:
    session = load_session(with_pictures(tmp_path / "in"))
    (tmp_path / "secret").write_text("secret")
    (tmp_path / "in/meshes/out.stl").symlink_to(tmp_path / "secret")
    write_session(session, tmp_path / "out")
    assert [path.name for path in (tmp_path / "out/meshes").iterdir()] == ["base.coarse.stl"]
    assert MESHES == COARSE_FOLDER


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"commanded": np.full((3, 2), np.nan)}, "column 'shoulder': got"),
        ({"frame": np.array([5, 1, 0])}, "needed unique, rising numbers"),
        ({"commanded": np.zeros((2, 2))}, "nothing was written"),
        ({"image": ("../evil.png", None, None)}, "'../evil.png', needed a path inside the session's folder"),
    ],
)
def test_what_could_not_be_read_again_is_not_written(
    tmp_path: Path, changed: dict[str, object], said: str
) -> None:
    """Before, all of it was written, and the picture out of the folder."""
    session = load_session(write_folder(tmp_path / "a" / "in"))
    (tmp_path / "a" / "evil.png").write_text("picture")
    wrong = dataclasses.replace(session, frames=dataclasses.replace(session.frames, **changed))
    (tmp_path / "b").mkdir()
    with pytest.raises(SessionError, match="nothing was written") as refused:
        write_session(wrong, tmp_path / "b" / "out")
    assert said in str(refused.value) and ".part" not in str(refused.value)
    assert not list((tmp_path / "b").iterdir())


def test_a_form_of_tables_that_there_is_none_of_is_refused(tmp_path: Path) -> None:
    """Before, `frames.xlsx` with the text of a CSV."""
    session = load_session(write_folder(tmp_path / "in"))
    with pytest.raises(MirrorPostureError, match="tables: got a str: 'xlsx', needed one of csv, parquet"):
        write_session(session, tmp_path / "out", tables="xlsx")  # type: ignore[arg-type]
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(not (DATA / "sessions").is_dir(), reason=f"the data is not there: {DATA}")
def test_a_stored_session_survives(tmp_path: Path) -> None:
    session = load_session(DATA / "sessions" / "dev-005")
    write_session(session, tmp_path / "out")
    assert_same(load_session(tmp_path / "out"), session)
