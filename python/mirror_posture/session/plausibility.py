"""What a session says against itself: units, sizes and ids that cannot be meant, judged before any estimate.

Each check compares numbers that must agree in size: commands with encoders, points with the robot's reach, the focal
length with the picture. An error is what no real robot, camera or room can have; a warning what hardly any has.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .errors import Problems, SessionError

if TYPE_CHECKING:
    from ..robot import Robot
    from .types import Floats, Session

SAME_COMMAND = 1e-4
"""rad (m): commands of one posture that differ by more are of different postures; text of few digits rounds below it."""
LONGEST_REACH_M = 50.0
"""Sum of the origins' lengths from the root to a link: beyond it they are in mm."""
SHORTEST_REACH_M, BOARD_SHARE = 0.005, 0.2
"""A robot is larger than this, and than this share of the board that it carries."""
LEAST_PICTURE_PX = 16
FOCAL_SHARE = (0.1, 100.0)
"""Focal length in widths of the picture: below the first a lens sees 157° and more, fisheyes have 0.3."""
UNSET = 0.02
"""A principal point nearer to the first pixel than this share of the picture's sides is a zero that nobody set."""
ASPECT = 3.0
"""fx and fy of real cameras differ by a few per cent."""
FAR_POINT = 4.0
"""Points farther from where they are measured than so many times the robot's reach are in mm."""
NOISY_POINT = 0.1
"""Noise of points beyond this share of the robot's reach hides whatever is wrong."""
DEGREES, MILLI = (40.0, 80.0), (700.0, 1400.0)
"""Slopes of encoder over command, or of command over encoder, that say that one of both is in degrees, or in milliradians."""
LEAST_MOTION = 0.02
"""rad (m): joints that move less say nothing of their encoders' unit."""
LEAST_ROWS = 5
FAR_ENCODER = 0.5
"""rad (m): an encoder that typically reads so far from its command is an odd zero, worth a warning."""
BOARDS_TRIED = 200
LEAST_CORNERS = 8
"""A homography goes through four points; fewer than this show little of whether it is the right one."""
BENT, MOSTLY = 0.1, 0.8
"""Misfit of a board's corners to a plane's image, as a share of the board's size in the picture: lenses and mirrors bend it by a
few hundredths. Where this share of the boards is beyond it, the corners' numbers are others."""
NEARER = 0.5
"""Light from the board to the camera goes at least straight. A picture of the board that is larger than it would be at this share of the
straight distance is of a board whose square, or of a camera whose focal length, is in another unit."""
LEAST_FACING = 0.1
"""Cosine between the board's face and what the camera sees of it in the mirror: both must look at the mirror."""


def check_plausible(session: Session, problems: Problems) -> list[str]:
    """All checks; what cannot be meant goes to `problems`, what is odd is returned as warnings."""
    warnings: list[str] = []
    reach_m = robot_reach_m(session.robot)
    with problems.kept():
        _reach(session, reach_m)
    with problems.kept():
        warnings += _camera(session)
    with problems.kept():
        _boards(session)
    with problems.kept():
        _board_distance(session)
    with problems.kept():
        _postures(session)
    with problems.kept():
        warnings += _encoders(session)
    with problems.kept():
        _points(session, reach_m)
    if not problems.found:
        warnings += _facing(session)
    return warnings


def robot_reach_m(robot: Robot) -> float:
    """The longest way from the root to a link along the joints' origins, and along the travel of prismatic ones."""
    ways: dict[str, float] = {}
    for joint in robot.joints:
        travel = max(abs(joint.lower), abs(joint.upper)) if joint.kind == "prismatic" else 0.0
        step = float(np.linalg.norm(joint.parent_from_joint[:3, 3])) + (
            travel if np.isfinite(travel) else 0.0
        )
        ways[joint.child_link] = ways.get(joint.parent_link, 0.0) + step
    return max(ways.values(), default=0.0)


def _reach(session: Session, reach_m: float) -> None:
    if reach_m > LONGEST_REACH_M:
        raise SessionError(
            session.robot_file.name,
            f"got a reach of {reach_m:g} m from the root to the farthest link, needed at most {LONGEST_REACH_M:g} m: "
            "are the origins in mm?",
        )
    board = session.board
    board_m = float(np.hypot(*board.corners)) * board.square_m if board else 0.0
    least_m = max(SHORTEST_REACH_M, BOARD_SHARE * board_m)
    if reach_m < least_m:
        than = f"a fifth of its board's {board_m:.3g} m" if board_m > 0.0 else "any robot"
        raise SessionError(
            session.robot_file.name,
            f"got a reach of {reach_m:.3g} m from the root to the farthest link, smaller than {than}; needed origins in m: were they divided "
            "by 1000, or is the board's square in another unit?",
        )


def _camera(session: Session) -> list[str]:
    camera = session.camera
    if camera is None:
        return []
    name = str(session.metadata.get("camera", "camera.yaml"))
    width, height = camera.width_px, camera.height_px
    if min(width, height) < LEAST_PICTURE_PX:
        raise SessionError(
            name, f"got a picture of {width} × {height} px, needed at least {LEAST_PICTURE_PX} px a side"
        )
    for key, focal in (("fx", camera.fx_px), ("fy", camera.fy_px)):
        share = focal / max(width, height)
        if not FOCAL_SHARE[0] <= share <= FOCAL_SHARE[1]:
            raise SessionError(
                name,
                f"camera_matrix: got {key} = {focal:g} px for a picture of {width} × {height} px, needed from "
                f"{FOCAL_SHARE[0] * max(width, height):g} to {FOCAL_SHARE[1] * max(width, height):g} px: is it in mm?",
            )
    if not 1.0 / ASPECT <= camera.fx_px / camera.fy_px <= ASPECT:
        raise SessionError(
            name,
            f"camera_matrix: got fx = {camera.fx_px:g} and fy = {camera.fy_px:g} px, needed about the same",
        )
    centre = (camera.cx_px / width, camera.cy_px / height)
    if not all(-1.0 <= c <= 2.0 for c in centre):
        raise SessionError(
            name,
            f"camera_matrix: got the principal point ({camera.cx_px:g}, {camera.cy_px:g}) px, needed one near the middle of "
            f"the picture of {width} × {height} px",
        )
    if all(abs(c) < UNSET for c in centre):
        raise SessionError(
            name,
            f"camera_matrix: got the principal point ({camera.cx_px:g}, {camera.cy_px:g}) px, the picture's corner: was it never "
            f"set? Needed one near the middle of the picture of {width} × {height} px",
        )
    if not all(0.0 <= c <= 1.0 for c in centre):
        return [f"{name}: the principal point ({camera.cx_px:g}, {camera.cy_px:g}) px is outside the picture"]
    return []


def _postures(session: Session) -> None:
    """Frames of one posture have one command, of the joints that move what is measured."""
    frames, robot = session.frames, session.robot
    ends = [link for link in (session.camera_link, session.board and session.board.link) if link]
    if session.points is not None:
        ends.append(session.root_link)
    links = [*ends, *(marker.link for marker in session.markers)]
    between = {
        step.joint for a in ends[:1] or [session.root_link] for b in links for step in robot.chain(a, b)
    }
    drivers = {joint.position for joint in robot.joints if joint.name in between}
    columns = [
        i
        for i, name in enumerate(frames.joint_names)
        if name in robot.position_names and robot.position_index(name) in drivers
    ]
    _, first, of = np.unique(frames.posture, return_index=True, return_inverse=True)
    other = np.abs(frames.commanded[:, columns] - frames.commanded[first[of]][:, columns]) > SAME_COMMAND
    rows = np.flatnonzero(other.any(axis=1))
    if len(rows):
        row = int(rows[0])
        column = columns[int(np.flatnonzero(other[row])[0])]
        before = int(first[of[row]])
        raise SessionError(
            "frames.csv" if not (session.folder / "frames.parquet").exists() else "frames.parquet",
            f"got {frames.commanded[row, column]:g} in posture {frames.posture[row]}, whose first row {before + 1} has "
            f"{frames.commanded[before, column]:g}; needed one command for all frames of a posture, or postures of their own "
            f"({len(rows)} rows differ)",
            row=row + 1,
            column=frames.joint_names[column],
        )


def _encoders(session: Session) -> list[str]:
    """Encoders that read in another unit than the commands, or far from them."""
    frames = session.frames
    warnings = []
    for index, name in enumerate(frames.measured_names):
        if name not in frames.joint_names:
            continue
        command, measured = frames.commanded[:, frames.joint_names.index(name)], frames.measured[:, index]
        spread = np.array([np.std(command), np.std(measured)])
        column = f"measured:{name}"
        if spread.min() > 0.0 and spread.max() > LEAST_MOTION and len(command) >= LEAST_ROWS:
            steady = np.corrcoef(command, measured)[0, 1] > 0.9
            for (low, high), unit in ((DEGREES, "degrees"), (MILLI, "milliradians or mm")):
                for ratio, guilty in (
                    (spread[1] / spread[0], "the encoder"),
                    (spread[0] / spread[1], "the command"),
                ):
                    if steady and low < ratio < high:
                        raise SessionError(
                            "frames.csv",
                            f"got encoder and command that differ by a factor of {ratio:.3g}, needed both in rad (m): "
                            f"is {guilty} in {unit}?",
                            column=column,
                        )
        if len(command) and np.median(np.abs(measured - command)) > FAR_ENCODER:
            far = float(np.median(np.abs(measured - command)))
            warnings.append(
                f"frames.csv, column {column!r}: the encoder is typically {far:.3g} rad (m) from the command; is its zero another?"
            )
    return warnings


def _points(session: Session, reach_m: float) -> None:
    """Points that no robot of this size could have put there."""
    points = session.points
    if points is None or not points.seen.any() or reach_m <= 0.0:
        return
    std_m = session.noise.point_std_m
    if std_m is not None and std_m > NOISY_POINT * reach_m:
        raise SessionError(
            "session.toml",
            f"noise.point_std: got {std_m:g} m, needed far less than the robot's reach of {reach_m:.3g} m, or nothing would be seen: "
            "is it in mm?",
        )
    at = points.point_m
    known = points.frame_link in session.robot.link_names
    for m, name in enumerate(session.marker_names):
        rows = np.flatnonzero(points.seen[:, m])
        if not len(rows):
            continue
        # In an unknown frame only the motion tells.
        origin = np.zeros(3) if known else np.median(at[rows, m], axis=0)
        distance = np.linalg.norm(at[rows, m] - origin, axis=1)
        # The typical distance: a single wild point is an outlier, which the estimate bears.
        if np.median(distance) > FAR_POINT * reach_m:
            raise SessionError(
                "points.csv",
                f"marker {name!r}: got points typically {np.median(distance):.4g} m from "
                f"{points.frame_link if known else 'their middle'}, of a robot that reaches {reach_m:.3g} m; needed m: are "
                "they in mm?",
                column="x",
            )
        wild = np.flatnonzero(distance > 1000.0 * max(reach_m, 1.0))
        if len(wild):
            raise SessionError(
                "points.csv",
                f"marker {name!r} of frame {session.frames.frame[rows[wild[0]]]}: got a point {distance[wild[0]]:.4g} m away, of a "
                f"robot that reaches {reach_m:.3g} m; mend the cells or leave out the row",
            )


def _boards(session: Session) -> None:
    """The board is a plane: its corners' image is that of a plane, also in a mirror."""
    board = session.board
    if board is None:
        return
    for view in (session.mirror_view, session.direct_view):
        rows = np.flatnonzero(view.board_seen.sum(axis=1) >= LEAST_CORNERS)
        rows = rows[:: max(1, len(rows) // BOARDS_TRIED)]
        if not len(rows):
            continue
        flat = board.corner_in_board_m[:, :2] / np.abs(board.corner_in_board_m).max()
        misfits = np.array(
            [
                _misfit(flat[seen], px[seen])
                for px, seen in zip(view.board_px[rows], view.board_seen[rows], strict=True)
            ]
        )
        bent = misfits > BENT
        if bent.mean() > MOSTLY:
            raise SessionError(
                "detections.csv",
                f"the board's corners are no image of a plane in {bent.mean():.0%} of the frames (typically "
                f"{min(np.median(misfits), 1.0):.0%} of the board's size off): is corners = [{board.columns}, {board.rows}] right, "
                "and is `index` the corner's number, row by row?",
                column="index",
            )


def _misfit(flat: Floats, px: Floats) -> float:
    """RMS distance of image points from the best homography of a plane's points, as a share of their spread."""
    centred = px - px.mean(axis=0)
    size = float(np.sqrt((centred**2).sum(axis=1).mean()))
    if not size > 0.0:
        return np.inf
    u, v = (centred / size).T
    x, y = flat.T
    one, zero = np.ones_like(x), np.zeros_like(x)
    rows = np.concatenate(
        [
            np.stack([x, y, one, zero, zero, zero, -u * x, -u * y, -u], axis=1),
            np.stack([zero, zero, zero, x, y, one, -v * x, -v * y, -v], axis=1),
        ]
    )
    h = np.linalg.eigh(rows.T @ rows)[1][:, 0].reshape(3, 3)
    image = np.stack([x, y, one], axis=1) @ h.T
    with np.errstate(divide="ignore", invalid="ignore"):
        off = image[:, :2] / image[:, 2:] - np.stack([u, v], axis=1)
    rms = float(np.sqrt((off**2).sum(axis=1).mean()))
    return rms if np.isfinite(rms) else np.inf


def _board_distance(session: Session) -> None:
    """No mirror shows the board nearer than it is: the way over the mirror is longer than the straight one.

    A board of size s shows at most f s / d pixels at a distance of d, less where it is turned away.
    """
    camera, board, link = session.camera, session.board, session.camera_link
    seen = session.mirror_view.board_seen
    rows = np.flatnonzero(seen.sum(axis=1) >= LEAST_CORNERS)
    if camera is None or board is None or link is None or not len(rows):
        return
    poses = session.robot.link_poses(session.positions[rows], [link, board.link])
    camera_in_world = poses[:, 0, :3, 3]
    straight_m = np.linalg.norm(poses[:, 1, :3, 3] - camera_in_world, axis=1)
    spread_px, spread_m = (
        np.array(
            [np.sqrt(np.var(at[here], axis=0).sum()) for at, here in zip(points, seen[rows], strict=True)]
        )
        for points in (
            session.mirror_view.board_px[rows],
            np.broadcast_to(board.corner_in_board_m, (len(rows), *board.corner_in_board_m.shape)),
        )
    )
    shown_m = max(camera.fx_px, camera.fy_px) * spread_m / np.maximum(spread_px, 1e-9)
    if np.median(shown_m / np.maximum(straight_m, 1e-9)) < NEARER:
        raise SessionError(
            "session.toml",
            f"in the mirror the board looks {np.median(shown_m):.3g} m away, nearer than the {np.median(straight_m):.3g} m straight from the "
            f"camera; needed: at least as far. Is its square of {board.square_m:g} m in m, and the camera file that of this camera?",
        )


def _facing(session: Session) -> list[str]:
    """Camera and board both look at the mirror: what the camera sees of the board lies where the board's face looks."""
    camera, board, link = session.camera, session.board, session.camera_link
    if camera is None or board is None or link is None or not session.mirror_view.board_seen.any():
        return []
    robot = session.robot
    poses = robot.link_poses(session.positions, [link, board.link])
    face = np.einsum("fji,fj->fi", poses[:, 0, :3, :3], poses[:, 1, :3, 2])
    seen = session.mirror_view.board_seen
    rows = np.flatnonzero(seen.any(axis=1))
    count = seen[rows].sum(axis=1, keepdims=True)
    pixel = (session.mirror_view.board_px[rows] * seen[rows, :, None]).sum(axis=1) / count
    ray = np.stack(
        [
            (pixel[:, 0] - camera.cx_px) / camera.fx_px,
            (pixel[:, 1] - camera.cy_px) / camera.fy_px,
            np.ones(len(rows)),
        ],
        axis=1,
    )
    cosine = float(np.median((face[rows] * ray).sum(axis=1) / np.linalg.norm(ray, axis=1)))
    if cosine >= LEAST_FACING:
        return []
    return [
        f"session.toml: the board's face and the camera's sight differ by {np.degrees(np.arccos(np.clip(cosine, -1, 1))):.0f}°, "
        f"and both must look at the mirror: does the z axis of {link!r} look forward (x right, y down), and that of "
        f"{board.link!r} out of the printed face?"
    ]
