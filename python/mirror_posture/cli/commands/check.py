"""`mirror-posture check`: is this folder a session?"""

from __future__ import annotations

from ..output import JsonOption, Output, SessionArgument

ORDER = 10
PANEL = "Sessions"


def command(session: SessionArgument, as_json: JsonOption = False) -> None:
    """Check a session's folder and say what is in it.

    Every table is read and validated as all other commands do it. The first thing that cannot be meant is named with
    its file, row and fix.

    Example: `mirror-posture check my-session`
    """
    output = Output(as_json)
    from ...session import load_session

    loaded = load_session(session)
    frames, seen, direct = loaded.frames, loaded.mirror_view, loaded.direct_view
    pictures = sum(name is not None for name in frames.image or ())
    summary = {
        "session": str(session),
        "frames": len(frames),
        "postures": len(set(frames.posture.tolist())),
        "joints_commanded": len(frames.joint_names),
        "joints_measured": len(frames.measured_names),
        "accelerometers": list(frames.accelerometer_links),
        "markers": list(loaded.marker_names),
        "pictures": pictures,
        "detected": loaded.detected,
        "boards_in_mirror": int(seen.board_seen.any(axis=1).sum()),
        "markers_in_mirror": int(seen.marker_seen.sum()),
        "points_seen_directly": int(direct.board_seen.sum() + direct.marker_seen.sum()),
        "points_measured_otherwise": 0 if loaded.points is None else int(loaded.points.seen.sum()),
        "warnings": list(loaded.warnings),
    }
    for warning in loaded.warnings:
        output.warn(warning)
    rows = [
        (key.replace("_", " "), ", ".join(value) if isinstance(value, list) else str(value))
        for key, value in summary.items()
        if key != "warnings"
    ]
    output.table(f"{session} is a session", ["*", "~"], rows)
    output.result(summary)
