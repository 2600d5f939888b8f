"""Reads a plan: whether another posture may be held with its mirrors in its room, and what it would show."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .._core import MirrorPostureError
from ..arrays import Floats
from ..formats import plan_keys
from ..formats.check import problems
from ..input_files import LARGEST_TEXT, given_text
from ..robots.nominal import Nominal
from ..rotations import reflected
from .candidates import sift
from .choose import between, path_blocked
from .options import MirrorPlace, PlanOptions, turned_mirrors
from .room import Room, room_of
from .setting import Setting, read_setting
from .sight import scene_of
from .simple import planned_mirrors
from .table import DOCUMENT, VIEWS, PlannedFrame

NEEDED = "the plan.json of `mirror-posture plan`"
SAME_TURN_RAD = 1e-6
SAME_PLACE_M = 1e-6
MORE_YAWS_DEG, MORE_PITCHES_DEG = range(-24, 25, 6), range(-16, 17, 4)
"""Ways to turn the mirror for one posture: a plan tries fewer, for thousands."""


@dataclass(frozen=True, eq=False)
class PlannedRoom:
    """The mirrors of a plan, and what the robot must keep clear of in front of them."""

    setting: Setting
    options: PlanOptions
    room: Room
    mirrors: tuple[MirrorPlace, ...]
    """In the root's frame: in each way in which the plan turns it, then turned about its centre in others; one where it is fixed."""
    warnings: tuple[str, ...]
    ignored: tuple[str, ...] = ()
    """Pairs of links that are not compared."""

    def collision(self, positions: Floats, start: Floats | None = None) -> str | None:
        """What a posture (nq,) runs into, itself or the table, or the straight way to it from `start`; None where both are free."""
        self.room.take(positions)
        trouble = self.room.collision()
        if trouble is not None:
            pairs = () if self.room.body is None else sorted(map(sorted, self.room.body.touching()))
            return f"it {trouble}" + (f" ({' and '.join(pairs[0])})" if pairs else "")
        if start is not None:
            trouble = path_blocked(self.setting, self.room, None, start, positions)
        return None if trouble is None else f"on the way there it {trouble}"

    def takeable(
        self,
        mirrors: Sequence[MirrorPlace],
        positions: Floats,
        markers: Sequence[int],
        start: Floats | None = None,
    ) -> tuple[list[int], Counter[str]]:
        """In front of which of these mirrors (in the root's frame) a posture (nq,) can be held with these
        markers visible, and why not for others.

        With `start`, the glass must also be clear of the straight path from there, because the mirror may
        be in place already.
        """
        if not mirrors:
            return [], Counter()
        places = [self.in_base(mirror) for mirror in mirrors]
        any_order = np.random.default_rng(0)
        found = sift(self.setting, places, self.room, self.options, positions[None], 1, any_order)
        reasons = Counter(found.reasons)
        names = [marker.name for marker in self.setting.nominal.metadata.markers]
        good = []
        for view, seen in zip(found.view.tolist(), found.markers, strict=True):
            unseen = [names[index] for index in markers if not seen[index]]
            if unseen:
                reasons[f"{', '.join(unseen)} is not to be seen in the mirror, or hidden by the robot"] += 1
            else:
                good.append(view)
        for posture in () if start is None else between(self.room.steps, start, positions):
            self.room.take(posture)
            touched = [view for view in good if not self.room.glass_free(places[view])]
            reasons["it comes too near to the glass on the way there"] += len(touched)
            good = [view for view in good if view not in touched]
        return good, +reasons

    def in_base(self, mirror: MirrorPlace) -> MirrorPlace:
        """A mirror of the root's frame, in the frame of the robot's first link."""
        return mirror.moved(self.setting.base_from_root[:3, :3], self.setting.base_from_root[:3, 3])

    @property
    def told_place(self) -> bool:
        """Whether the mirror's place was given; then it stays there."""
        return self.options.mirror_fixed or self.options.mirror_at_m is not None

    def moved(
        self, mirror: MirrorPlace, positions: Floats, markers: Sequence[int], farther: float
    ) -> MirrorPlace:
        """A mirror at a multiple of the planned distance, slid within its plane so that the board and these
        markers of a posture are around its middle. A mirror whose place was given stays there.
        """
        if self.told_place:
            return mirror
        scene, place = scene_of(self.setting, positions[None]), self.in_base(mirror)
        base_from_camera = np.linalg.inv(scene.camera_from_base[0])
        points = np.concatenate([scene.corners[0], scene.markers[0, list(markers)]])
        eye, points = base_from_camera[:3, 3], points @ base_from_camera[:3, :3].T + base_from_camera[:3, 3]
        normal, corners = place.normal_in_root, len(scene.corners[0])
        away_m = (farther - 1.0) * float((place.center_in_root_m - points[:corners].mean(axis=0)) @ normal)
        center = place.center_in_root_m + away_m * normal
        image = reflected(points, normal, center @ normal) - eye
        met = eye + image * (((center - eye) @ normal) / (image @ normal))[:, None]
        aside = (met - center) @ np.stack([place.right_in_root, place.up_in_root]).T
        right, up = 0.5 * (aside.min(axis=0) + aside.max(axis=0))
        shift = away_m * mirror.normal_in_root + right * mirror.right_in_root + up * mirror.up_in_root
        return replace(mirror, center_in_root_m=mirror.center_in_root_m + shift)


def read_planned_room(folder: Path, nominal: Nominal) -> PlannedRoom:
    """The mirrors and the room of a plan's folder, for the robot of a session.

    Raises:
        MirrorPostureError: no plan there, one that is broken (file, row and column, or key), or one of another robot.
    """
    options = read_options(folder / DOCUMENT).before(nominal.metadata.mirror)
    rows = planned_mirrors(folder, nominal)
    setting = read_setting(nominal, options)
    room, ignored, warnings = room_of(setting, options, np.random.default_rng(options.seed))
    up_in_root = setting.base_from_root[:3, :3].T @ setting.up
    if not rows:
        raise MirrorPostureError(f"{folder / 'postures.csv'}: has no rows; needed a plan of some postures")
    places: dict[int, MirrorPlace] = {}
    for row, center, normal in rows:
        length = float(np.linalg.norm(normal))
        if abs(length - 1.0) > SAME_TURN_RAD:
            raise MirrorPostureError(
                f"{folder / VIEWS}: frame {row.frame}: the normal has length {length:.6g}, needed 1"
            )
        up = up_in_root - (up_in_root @ normal) * normal
        if np.linalg.norm(up) < SAME_TURN_RAD:
            raise MirrorPostureError(
                f"{folder / VIEWS}: frame {row.frame}: the mirror lies flat, needed an upright one"
            )
        place = MirrorPlace(center, normal, up / np.linalg.norm(up), *options.mirror_size_m)
        # One mirror stands for all rows of its view: a row changed by hand would be judged before another mirror.
        _check_same(folder / VIEWS, row, place, places.setdefault(row.view, place))
    mirrors = tuple(places[view] for view in sorted(places))
    forward = setting.base_from_root[:3, :3].T @ setting.forward
    others = turned_mirrors(
        options, mirrors[0].center_in_root_m, forward, up_in_root, MORE_YAWS_DEG, MORE_PITCHES_DEG
    )
    if not options.mirror_fixed:
        mirrors += tuple(one for one in others if all(_apart(one, mirror) for mirror in mirrors))
    return PlannedRoom(setting, options, room, mirrors, tuple(warnings), tuple(ignored))


def _check_same(file: Path, row: PlannedFrame, place: MirrorPlace, first: MirrorPlace) -> None:
    for name, limit, got, needed in (
        ("center_{}_m", SAME_PLACE_M, place.center_in_root_m, first.center_in_root_m),
        ("normal_{}", SAME_TURN_RAD, place.normal_in_root, first.normal_in_root),
    ):
        for axis, a, b in zip("xyz", got, needed, strict=True):
            if abs(a - b) > limit:
                raise MirrorPostureError(
                    f"{file}: frame {row.frame}, column {name.format(axis)!r}: got {a:.9g}, needed {b:.9g} as in the first row of view "
                    f"{row.view}; write the same mirror in all rows of a view, or give this row a view of its own"
                )


def _apart(one: MirrorPlace, other: MirrorPlace) -> bool:
    return float(np.linalg.norm(one.normal_in_root - other.normal_in_root)) > SAME_TURN_RAD


def read_options(file: Path) -> PlanOptions:
    """What a plan was made for, as its plan.json keeps it.

    Raises:
        MirrorPostureError: no such file, no JSON, or a key that is missing, mistyped or of another kind; it names the key and what is needed.
    """
    try:
        tree = json.loads(given_text(file, NEEDED, LARGEST_TEXT))
    except (ValueError, RecursionError) as error:
        told = " ".join(str(error).split())[:200]
        raise MirrorPostureError(
            f"{file}: cannot be read ({told}); needed {NEEDED}; plan once more"
        ) from None
    if wrong := list(problems(plan_keys.TOP, tree)):
        more = f" (and {len(wrong) - 1} more of its keys)" if len(wrong) > 1 else ""
        raise MirrorPostureError(f"{file}: {wrong[0]}{more}; mend it, or plan once more")
    told = tree["options"]
    at = told["mirror_at_m"]
    changed = {
        "mirror_at_m": None if at is None else tuple(map(float, at)),
        "home": {name: float(value) for name, value in told["home"].items()},
        "held": tuple(told["held"]),
        "packages": {name: Path(folder) for name, folder in told["packages"].items()},
    }
    return PlanOptions(**{**told, **changed})
