"""Single records of a recording: measured beside commanded positions, and a message's picture."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from mirror_posture import MirrorPostureError
from mirror_posture.importing import JointLog, read_recording
from mirror_posture.importing.bags import _picture as bag_picture
from mirror_posture.importing.bags import _with_commands as with_commands
from mirror_posture.importing.joint_csv import joint_csv


def test_measured_columns_count_for_all_joints_or_are_told_as_left_out(tmp_path: Path) -> None:
    file = tmp_path / "log.csv"
    file.write_text("time_s,a,b,measured:a,measured:b\n0,1,2,1.1,2.1\n1,1,2,1.1,2.1\n")
    log = joint_csv(file, False)
    assert log.measured is not None and log.measured.tolist() == [[1.1, 2.1]] * 2 and log.others == ()
    file.write_text("time_s,a,b,measured:a,measured:c\n0,1,2,1.1,2.1\n1,1,2,1.1,2.1\n")
    log = joint_csv(file, False)
    assert log.names == ("a", "b") and log.measured is None and log.others == ("measured:a", "measured:c")


def test_a_measurement_goes_with_the_last_command_that_was_given_by_then() -> None:
    times = np.array([0.0, 1.0, 2.0])
    commands = JointLog(times, ("b", "a"), np.array([[10.0, 0.0], [11.0, 1.0], [12.0, 2.0]]))
    measured = JointLog(np.array([-0.5, 0.0, 0.9, 1.0, 5.0]), ("a", "c", "b"), np.arange(15.0).reshape(5, 3))
    log = with_commands(measured, commands)
    assert log.names == ("a", "b") and log.time_s.tolist() == [0.0, 0.9, 1.0, 5.0]
    assert log.position.tolist() == [[0.0, 10.0], [0.0, 10.0], [1.0, 11.0], [2.0, 12.0]]
    assert log.measured is not None and log.measured[:, 1].tolist() == [5.0, 8.0, 11.0, 14.0]


@pytest.mark.parametrize("encoding", ["rgb8", "rgba8", "bgr8", "bgra8", "mono8"])
def test_pictures_of_a_bag_have_their_colours_in_the_order_of_opencv(encoding: str) -> None:
    blue, green, red = 200, 120, 30
    cell = {"r": red, "g": green, "b": blue, "a": 255, "m": 99}
    letters = "m" if encoding == "mono8" else encoding[:-1]
    # Rows have bytes at their end that are no pixels.
    row = [cell[letter] for letter in letters] * 3 + [7, 7]
    message = SimpleNamespace(encoding=encoding, width=3, height=2, step=len(row), data=bytes(row * 2))
    picture = bag_picture(Path("a.bag"), message)
    assert picture.shape == (2, 3, 3)
    wanted = [99, 99, 99] if encoding == "mono8" else [blue, green, red]
    assert (picture == wanted).all()


def test_logs_are_read_as_others_write_them(tmp_path: Path) -> None:
    file = tmp_path / "log.csv"

    def read(text: str, **how: object) -> JointLog:
        file.write_text(text, encoding="utf-8")
        return joint_csv(file, False, **how)  # type: ignore[arg-type]

    plain = read("time_s,a,b\n0.0,1.5,2\n0.5,1.25,3\n")
    for text, how in (
        ("time_s;a;b\n0,0;1,5;2\n0,5;1,25;3\n", {}),
        ("time_s\ta\tb\n0.0\t1.5\t2\n0.5\t1.25\t3\n", {}),
        ("stamp,a,b\n0,1.5,2\n500,1.25,3\n", {"time": "stamp=ms"}),
        ("stamp,a,b,note\n0,1.5,2,go\n0.5,1.25,3,\n", {"time": "stamp"}),
    ):
        log = read(text, **how)
        assert log.names == ("a", "b") and log.others == (("note",) if "note" in text else ())
        np.testing.assert_allclose(log.time_s, plain.time_s)
        np.testing.assert_array_equal(log.position, plain.position)
    # What is between the cells is told by the commas of the head, whatever a name contains.
    assert read("time_s,a,left;b\n0,1.5,2\n1,1.5,2\n").names == ("a", "left;b")
    # A joint with a broken cell is no note.
    with pytest.raises(MirrorPostureError, match=r"log.csv, row 2 \(line 3\), column 'b': got 'x'"):
        read("time_s;a;b\n0;1,5;2\n1;1,25;x\n")
    with pytest.raises(MirrorPostureError, match="--time COLUMN says which"):
        read("stamp,a\n0,1\n1,2\n")
    with pytest.raises(MirrorPostureError, match="needed COLUMN or COLUMN=UNIT"):
        read("stamp,a\n0,1\n1,2\n", time="stamp=minutes")


@pytest.mark.parametrize(("unit", "each"), [("ms", 10**3), ("us", 10**6), ("ns", 10**9)])
def test_unix_times_are_read_in_every_unit(unit: str, each: int, tmp_path: Path) -> None:
    """Before, the limit of seconds was asked of the numbers as they stand, and refused all of them."""
    file = tmp_path / "log.csv"
    file.write_text("stamp,a\n" + "".join(f"{1764455000 * each + i * each // 10},0.1\n" for i in range(4)))
    seconds = joint_csv(file, False, f"stamp={unit}").time_s
    np.testing.assert_allclose(seconds - 1764455000, [0.0, 0.1, 0.2, 0.3], atol=1e-6)
    # What is too large for a time in seconds still is.
    file.write_text(f"stamp,a\n0,0.1\n{2 * 10**12 * each},0.1\n")
    with pytest.raises(MirrorPostureError, match=r"row 2 \(line 3\), column 'stamp': got .* at most 1e\+"):
        joint_csv(file, False, f"stamp={unit}")


def test_errors_of_a_log_name_its_file_and_row(tmp_path: Path) -> None:
    file = tmp_path / "log.csv"
    for text, told in (
        ("time_s,a\n", "log.csv: got 0 rows of positions, needed two or more"),
        (
            "time_s,a\n0,0\n2.4,0\n2.4,0\n",
            "log.csv, row 3 (line 4): is not later than the row before (2.4 s after 2.4 s); two rows at the same time: remove one",
        ),
        (
            "time_s,a\n0,0\n2.4,0\n2.2,0\n",
            "log.csv, row 3 (line 4): is not later than the row before (2.2 s after 2.4 s); sort the rows by time",
        ),
    ):
        file.write_text(text)
        with pytest.raises(MirrorPostureError) as refused:
            joint_csv(file, False)
        assert str(refused.value).startswith(told)


def test_the_line_of_a_log_with_blank_lines_is_that_of_the_file(tmp_path: Path) -> None:
    file = tmp_path / "log.csv"
    for text in ("time_s,a\n\n0,0\n\n\n1,x\n", "time_s;a\n\n0;0,5\n\n\n1;x\n"):
        file.write_text(text)
        with pytest.raises(MirrorPostureError, match=r"log.csv, row 2 \(line 6\), column 'a': got 'x'"):
            joint_csv(file, False)
    file.write_text("time_s,a\n\n2,0\n\n1,0\n")
    link = tmp_path / "elsewhere" / "log.csv"
    link.parent.mkdir()
    link.symlink_to(file)
    for named in (file, link):
        with pytest.raises(MirrorPostureError, match=r"log.csv, row 2 \(line 5\): is not later"):
            joint_csv(named, False)


def test_commands_that_go_with_no_states_are_named(tmp_path: Path) -> None:
    states = JointLog(np.array([5.0, 6.0]), ("a", "b"), np.zeros((2, 2)), source="x.bag, topic /states")
    other = JointLog(np.array([5.0, 6.0]), ("c", "d"), np.zeros((2, 2)), source="x.bag, topic /commands")
    with pytest.raises(MirrorPostureError) as told:
        with_commands(states, other)
    assert str(told.value).startswith(
        "x.bag, topic /commands: commands none of the joints that x.bag, topic /states has"
    )
    assert "got c, d, needed one or more of a, b; give --commands-topic" in str(told.value)
    late = JointLog(np.array([9.0, 10.0]), ("a", "d"), np.zeros((2, 2)), source="x.bag, topic /commands")
    with pytest.raises(MirrorPostureError) as told:
        with_commands(states, late)
    assert str(told.value).startswith("x.bag, topic /commands: begins at 9 s, needed a command before")
    assert "x.bag, topic /states (5 to 6 s)" in str(told.value) and "leave out" in str(told.value)


def test_options_of_another_kind_and_a_missing_source_name_the_fix(tmp_path: Path) -> None:
    """Before, `--time` was passed over for bags and datasets."""
    (tmp_path / "set/meta").mkdir(parents=True)
    (tmp_path / "set/meta/info.json").write_text('{"codebase_version": "v1"}')
    (tmp_path / "a.mcap").write_text("")
    for source in (tmp_path / "set", tmp_path / "a.mcap"):
        with pytest.raises(MirrorPostureError, match="--time is of another kind of recording; leave it out"):
            read_recording(source, time="stamp=fortnights")
    with pytest.raises(
        MirrorPostureError, match=r"nowhere.mcap: there is no such file or folder; needed .mcap, .bag, "
    ):
        read_recording(tmp_path / "nowhere.mcap")
