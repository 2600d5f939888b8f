"""Chooses viewpoints that show board and markers and have enough parallax; predicted from the model before
anything moves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ..arguments import checked_arguments
from ..arrays import Floats
from ..measurement import MeasureOptions, NothingMeasuredError, measure
from ..mirror import IDEAL_MIRROR
from ..optics import see_in_mirror
from ..robots.protocol import ImagePoints, Look
from ..shapes.reach import outermost_points
from ..viewpoint import View
from .observation import USUAL_NOISE_PX
from .target import Target

YAWS_RAD = tuple(math.radians(x) for x in (0, -5, 5, -10, 10, -15, 15, -20, 20, -25, 25))
PITCHES_RAD = tuple(math.radians(x) for x in (0, -5, 5, -10, 10, -15, 15))
MARGIN_PX = 12.0
"""Nearer to the picture's edge nothing is planned: a ball would be cut."""
STAND_STD_RAD = math.radians(1.0)
"""Error of a stand that is turned by hand. The mirror's picture turns twice as far."""
RISK = 2.0
"""How much worse a set of views is for each view that is sure to lose a marker over the picture's edge: a look is spent on it."""
STEEPEST_RAD = math.radians(60.0)
"""A board that is turned farther from the mirror is not planned."""
RISK_TAKEN = 0.1
"""A view with a larger probability of losing a marker is not taken while the mirror can be farther away."""
FARTHER = (1.25, 1.5, 1.8)
BEYOND_REACH = (1.2, 1.5, 1.9, 2.4, 3.0)
"""If the mirror cannot be at its usual distance: its distance, in multiples of the body's reach towards it."""
CLEARANCE_M = 0.02
"""Of every link's origin and shape and every ball's surface from the glass."""
USUAL_VIEWS = 3
EASE = 0.1
"""How much better (a part of the deviation) a view turned by the farthest angle must be to be taken before one straight ahead."""
PITCH_APART_RAD = math.radians(5.0)
"""Of three views or more one has another pitch than the others by at least this: yaw alone leaves one direction of the
camera–board transform nearly unseen."""


def _scene(target: Target) -> tuple[Floats, Floats]:
    """`camera_from_link` of root, camera, board and markers' links; corners and markers in the camera's frame, m."""
    metadata = target.nominal.metadata
    assert metadata.board is not None
    links = [metadata.root, target.camera_link, target.board_link, *(m.link for m in metadata.markers)]
    poses = target.nominal.robot.link_poses(target.positions[None], links)[0]
    camera_from = np.linalg.inv(poses[1]) @ poses
    board = camera_from[2]
    corners = metadata.board.corner_in_board_m @ board[:3, :3].T + board[:3, 3]
    return camera_from, np.concatenate([corners, camera_from[3:, :3, 3]])


def _body(target: Target) -> tuple[Floats, Floats]:
    """Where the robot is, in the camera's frame: points of it, and how far from each the glass must stay, m.

    Every link's origin, and the outermost points of its shapes where the URDF has shapes whose files are found.
    """
    robot, metadata = target.nominal.robot, target.nominal.metadata
    names = robot.link_names
    poses = robot.link_poses(target.positions[None], [target.camera_link, *names])[0]
    camera_from = dict(zip(names, np.linalg.inv(poses[0]) @ poses[1:], strict=True))
    radius = {m.link: 0.5 * m.diameter_m for m in metadata.markers}
    shapes = outermost_points(target.nominal.robot_file)
    points = [camera_from[name][None, :3, 3] for name in names]
    clearance_m = [np.array([CLEARANCE_M + radius.get(name, 0.0)]) for name in names]
    for name, shape in shapes.items():
        if name in camera_from:
            points.append(shape @ camera_from[name][:3, :3].T + camera_from[name][:3, 3])
            clearance_m.append(np.full(len(shape), CLEARANCE_M))
    return np.concatenate(points), np.concatenate(clearance_m)


def reach_m(target: Target) -> float:
    """How far the body at the target reaches towards the mirror, from the board's centre, m; at least the clearance."""
    camera_from, _ = _scene(target)
    body, clearance_m = _body(target)
    normal = camera_from[0, :3, :3] @ View().normal_in_root
    return float((body @ normal + clearance_m).max() - normal @ camera_from[2, :3, 3])


@dataclass(frozen=True)
class Prospect:
    """A view that shows the whole board and all markers, with the pixels at which it should."""

    view: View
    points: ImagePoints
    risk: float
    """The probability that the stand's error puts a marker or a corner over the picture's edge."""


def prospects(
    target: Target,
    start: View,
    yaws_rad: Sequence[float] = YAWS_RAD,
    pitches_rad: Sequence[float] = PITCHES_RAD,
) -> list[Prospect]:
    """The views around the mirror's distance of `start` that show the board and all of the target's markers."""
    nominal = target.nominal
    metadata, camera = nominal.metadata, nominal.camera
    assert metadata.board is not None and camera is not None
    camera_from, points = _scene(target)
    board = camera_from[2]
    corners = points[: nominal.corner_count]
    body, clearance_m = _body(target)
    glass = (metadata.mirror or IDEAL_MIRROR).glass
    size = np.array(camera.size_px)
    wanted = [len(corners) + index for index in target.marker_indices]
    needed = [*range(len(corners)), *wanted]
    found = []
    for yaw, pitch in product(yaws_rad, pitches_rad):
        view = View(yaw, pitch, start.distance_m)
        normal = camera_from[0, :3, :3] @ view.normal_in_root
        distance = float(normal @ board[:3, 3]) + view.distance_m
        if distance <= 0.0 or float(normal @ board[:3, 2]) < math.cos(STEEPEST_RAD):
            continue
        seen = see_in_mirror(camera, distance * normal, points, **glass)
        pixels = np.where(seen.valid[:, None], seen.pixels_px, -1.0)
        inside = seen.valid & np.all((pixels > MARGIN_PX) & (pixels < size - 1 - MARGIN_PX), axis=1)
        # No part of the robot may reach into the glass, whether it is observed or not.
        if not inside[needed].all() or (body @ normal + clearance_m).max() > distance:
            continue
        edge = np.minimum(pixels, size - 1 - pixels)[needed].min() - MARGIN_PX
        # The image of a point near the camera lies along the mirror's normal, at twice the distance: it turns as the normal does.
        shift = camera.fx_px * STAND_STD_RAD
        risk = 0.5 * math.erfc(float(edge) / shift / math.sqrt(2.0))
        marker_seen = np.zeros(len(metadata.markers), dtype=bool)
        marker_seen[target.marker_indices] = True
        found.append(
            Prospect(
                view,
                ImagePoints(
                    pixels[: len(corners)],
                    inside[: len(corners)],
                    np.where(marker_seen[:, None], pixels[len(corners) :], 0.0),
                    marker_seen,
                ),
                risk,
            )
        )
    return found


def predicted_std_m(target: Target, sets: Sequence[Sequence[Prospect]]) -> Floats:
    """For each set of views the largest deviation of any marker's position along its worst axis, m.

    Infinite where a marker could not be measured, for example with nearly parallel rays. All sets are
    measured in one batch.
    """
    noise = target.nominal.metadata.noise.pixel_std_px or USUAL_NOISE_PX
    commanded = target.by_name(target.positions)
    looks, posture = [], []
    for number, views in enumerate(sets):
        looks += [Look(commanded, 0.0, points=prospect.points) for prospect in views]
        posture += [number] * len(views)
    worst = np.zeros(len(sets))
    try:
        found = measure(
            target.nominal.session(looks, posture),
            MeasureOptions("maximum-likelihood", corner_noise_px=noise, marker_noise_px=noise),
        ).markers
    except NothingMeasuredError:
        return np.full(len(sets), np.inf)
    spread = np.sqrt(np.linalg.eigvalsh(found.covariance_m2)[:, -1])
    np.maximum.at(worst, found.posture, np.where(found.measured, spread, np.inf))
    return worst


@checked_arguments
def propose_views(
    target: Target, count: int, kept: Sequence[View] = (), start: View | None = None
) -> list[View]:
    """`count` views, best first: board and markers visible, and the markers' worst predicted deviation as
    small as possible, with a penalty for the risk that a marker leaves the picture.

    Starts with `kept`, or otherwise with the best pair; then adds one view at a time that helps most. Among
    nearly equal ones the view that is turned less is chosen. The third differs in pitch if the first two do
    not. The mirror is as far away as in `start`, or farther (all views alike) if the markers do not fit
    into the picture. Fewer are returned if the model sees fewer (none, if the markers are not visible in
    this mirror).
    """
    start = start or View()
    best = _proposal(target, count, kept, start)
    for factor in () if kept else FARTHER:
        if best.risk <= RISK_TAKEN and len(best.views) >= count:
            break
        other = _proposal(target, count, kept, replace(start, distance_m=factor * start.distance_m))
        if len(other.views) > len(best.views) or other.cost < best.cost:
            best = other
    if not kept and (not best.views or reach_m(target) > start.distance_m):
        # A robot of another size than the usual one, or one that reaches towards its mirror.
        for factor in BEYOND_REACH:
            far = replace(start, distance_m=factor * max(reach_m(target), start.distance_m))
            other = _proposal(target, count, kept, far)
            better = len(other.views) > len(best.views) or other.cost < best.cost
            if better:
                best = other
            elif best.risk <= RISK_TAKEN and len(best.views) >= count:
                break
    return best.views


def why_not_seen(target: Target, start: View) -> str:
    """Why no view shows what is needed: the problem of the view straight ahead, at the distance of the
    body's reach."""
    camera_from, points = _scene(target)
    metadata, camera = target.nominal.metadata, target.nominal.camera
    assert camera is not None
    board = camera_from[2]
    normal = camera_from[0, :3, :3] @ View().normal_in_root
    if float(normal @ board[:3, 2]) < math.cos(STEEPEST_RAD):
        return "the board does not face the mirror: its z axis, out of the printed face, must point along the root's x axis"
    if normal[2] <= 0.0:
        return "the camera looks away from the mirror: its z axis must point along the root's x axis"
    distance_m = BEYOND_REACH[2] * max(reach_m(target), start.distance_m)
    at = float(normal @ board[:3, 3]) + distance_m
    seen = see_in_mirror(camera, at * normal, points, **(metadata.mirror or IDEAL_MIRROR).glass)
    corners = target.nominal.corner_count
    names = ["the board"] * corners + [f"marker {m.name}" for m in metadata.markers]
    wanted = [*range(corners), *(corners + i for i in target.marker_indices)]
    size = np.array(camera.size_px)
    told = []
    for i in wanted:
        x, y = seen.pixels_px[i]
        if not seen.valid[i] or not np.all(
            (seen.pixels_px[i] > MARGIN_PX) & (seen.pixels_px[i] < size - 1 - MARGIN_PX)
        ):
            where = f"at {x:.0f}, {y:.0f} px" if seen.valid[i] else "nowhere"
            told.append(f"{names[i]} ({where} of {size[0]} x {size[1]})")
    shown = "; ".join(dict((t.split(" (")[0], t) for t in told).values())
    return (
        f"straight ahead, {distance_m:.2f} m from the mirror, out of the picture are: {shown}; turn the camera, or choose another "
        "posture or other markers"
        if told
        else "no two views show all of it at once: the picture is too narrow, or the body too near to its edges"
    )


@dataclass(frozen=True)
class _Proposal:
    """Views with the cost and the largest risk of those that a look begins with."""

    views: list[View]
    cost: float = math.inf
    risk: float = math.inf


def best_first(
    target: Target, options: Sequence[Prospect], count: int, kept: Sequence[Prospect] = ()
) -> list[Prospect]:
    """`kept` and others of these views, at most `count`: the best pair first, then one at a time what helps most.

    Empty where no pair measures all markers.
    """
    chosen = list(kept)
    if len(chosen) < 2:
        first = chosen or options
        pairs = [[a, b] for i, a in enumerate(first) for b in (options if chosen else options[i + 1 :])]
        if not pairs:
            return []
        cost = predicted_std_m(target, pairs) * np.array([_effort(pair) for pair in pairs])
        if not np.isfinite(cost).any():
            return []
        chosen = list(pairs[int(np.argmin(cost))])
    while len(chosen) < count:
        rest = [p for p in options if all(p.view != c.view for c in chosen)]
        pitches = [c.view.pitch_rad for c in chosen]
        if max(pitches) - min(pitches) < PITCH_APART_RAD:
            apart = [p for p in rest if abs(p.view.pitch_rad - pitches[0]) >= PITCH_APART_RAD]
            rest = apart or rest
        if not rest:
            break
        sets = [[*chosen, p] for p in rest]
        cost = predicted_std_m(target, sets) * np.array([_effort([p]) for p in rest])
        chosen.append(rest[int(np.argmin(cost))])
    return chosen


def _proposal(target: Target, count: int, kept: Sequence[View], start: View) -> _Proposal:
    options = prospects(target, start)
    seen = [p for view in kept for p in prospects(target, view, (view.yaw_rad,), (view.pitch_rad,))]
    chosen = best_first(target, options, count, seen) if options else []
    if not chosen:
        return _Proposal(list(kept))
    head = chosen[:USUAL_VIEWS]
    views = (list(kept) + [c.view for c in chosen if c.view not in kept])[:count]
    cost = float(predicted_std_m(target, [head])[0]) * _effort(head)
    return _Proposal(views, cost, max(p.risk for p in head))


def _effort(views: Sequence[Prospect]) -> float:
    """The cost of a set of views in addition to its deviation: turning, and the risk of losing markers."""
    farthest = max(max(abs(p.view.yaw_rad), abs(p.view.pitch_rad)) for p in views)
    return (1.0 + EASE * farthest / YAWS_RAD[-1]) * (1.0 + RISK * sum(p.risk for p in views))
