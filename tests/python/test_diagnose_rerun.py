"""The recording for the Rerun viewer."""

from __future__ import annotations

import builtins
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import mirror_posture as mp
from mirror_posture.cli import app
from mirror_posture.diagnosis.rerun_recording import write_recording
from tracked_session import MARKERS, NOISE_M, POSTURES, write_tracked


def with_offset(q: dict[str, float]) -> dict[str, float]:
    return {**q, "r_elbow": q["r_elbow"] + 0.05}


def test_markers_are_told_posture_by_posture(tmp_path: Path) -> None:
    session = mp.load_session(write_tracked(tmp_path / "session", 7, with_offset))
    found = mp.diagnose(session, markers=True)
    assert len(found.markers) == POSTURES * len(MARKERS)
    assert session.points is not None
    for entry in found.markers:
        row, column = entry.frame, session.marker_names.index(entry.marker)
        # A tracker measures the marker itself.
        np.testing.assert_allclose(entry.measured_m, session.points.point_m[row, column], atol=1e-5)
    poses = session.robot.forward_kinematics(session.positions)
    hand = [e for e in found.markers if e.marker == "r_hand"]
    link = session.robot.link_index("r_hand_marker")
    np.testing.assert_allclose([e.before_m for e in hand], poses[:, link, :3, 3], atol=1e-9)
    left = np.linalg.norm([np.subtract(e.measured_m, e.after_m) for e in hand], axis=1)
    was = np.linalg.norm([np.subtract(e.measured_m, e.before_m) for e in hand], axis=1)
    assert np.sqrt(np.mean(left**2)) < 1.1 * np.sqrt(3.0) * NOISE_M < 0.5 * np.sqrt(np.mean(was**2))
    assert mp.diagnose(session).markers == ()


@pytest.mark.filterwarnings("error::Warning")
def test_the_command_writes_a_recording(tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="Rerun's SDK is not installed: the recording is not written")
    folder = write_tracked(tmp_path / "session", 8, with_offset)
    file = tmp_path / "gap.rrd"
    result = CliRunner().invoke(app, ["diagnose", str(folder), "--rerun", str(file), "--json"])
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["verdict"] == "explained"
    assert file.read_bytes()[:3] == b"RRF"
    assert file.stat().st_size > 20_000
    result = CliRunner().invoke(app, ["diagnose", str(folder), str(folder), "--rerun", str(file)])
    assert result.exit_code == 1 and "needed one session" in result.stderr


def rows_of(file: Path) -> dict[str, list[dict[str, Any]]]:
    """What a recording holds, read back by Rerun's own reader: entity to its rows, static ones included."""
    chunk = pytest.importorskip(
        "rerun.chunk", reason="Rerun's SDK has no reader: the recording is not read back"
    )
    rows: dict[str, list[dict[str, Any]]] = {}
    for part in chunk.RrdReader(file).stream():
        rows.setdefault(part.entity_path, []).extend(part.to_record_batch().to_pylist())
    return rows


def test_the_recording_can_be_read_back(tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="Rerun's SDK is not installed: the recording is not written")
    session = mp.load_session(write_tracked(tmp_path / "session", 8, with_offset))
    found = mp.diagnose(session, markers=True)
    rows = rows_of(write_recording(session, found, tmp_path / "gap.rrd"))
    assert found.sentence in rows["/verdict"][0]["TextDocument:text"]
    frames = sorted({entry.frame for entry in found.markers})
    assert session.frames.time_s is not None
    time_s = dict(zip(session.frames.frame.tolist(), session.frames.time_s.tolist(), strict=True))
    moving = {path: part for path, part in rows.items() if any("frame" in row for row in part)}
    for path, part in moving.items():
        timed = [row for row in part if "frame" in row]
        assert {row["frame"] for row in timed} <= set(frames), path
        # No timeline but the robot's own, and both tell the same moment.
        assert all("log_time" not in row and "log_tick" not in row for row in timed), path
        told = [row["time"].total_seconds() for row in timed]
        np.testing.assert_allclose(told, [time_s[row["frame"]] for row in timed], atol=1e-6, err_msg=path)
    seen = {entry.frame: entry for entry in found.markers if entry.marker == "r_hand"}
    for path, key in (("before", "before_m"), ("after", "after_m")):
        told_mm = [row for row in rows[f"/residual/r_hand/{path}_mm"] if "frame" in row]
        assert [row["frame"] for row in told_mm] == sorted(seen)
        for row in told_mm:
            entry = seen[row["frame"]]
            length = 1000.0 * float(np.linalg.norm(np.subtract(entry.measured_m, getattr(entry, key))))
            assert row["Scalars:scalars"] == [pytest.approx(length)]
    assert len(moving["/markers/measured"]) == len(frames)
    (signature,) = found.signatures
    errors = [row for row in rows["/signature/joint/r_elbow/error_rad"] if "frame" in row]
    assert sorted(row["frame"] for row in errors) == sorted(signature.frame.tolist())
    of_frame = dict(zip(signature.frame.tolist(), signature.error, strict=True))
    for row in errors:
        assert row["Scalars:scalars"] == [pytest.approx(of_frame[row["frame"]])]


def test_without_the_sdk_the_error_says_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = builtins.__import__

    def missing(name: str, *rest: Any) -> Any:
        if name == "rerun":
            raise ImportError(name)
        return real(name, *rest)

    session = mp.load_session(write_tracked(tmp_path / "session", 9))
    found = mp.diagnose(session, markers=True)
    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(mp.MirrorPostureError, match=r"pip install 'mirror-posture\[rerun\]'"):
        write_recording(session, found, tmp_path / "gap.rrd")
