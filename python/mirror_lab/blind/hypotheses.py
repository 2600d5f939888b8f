"""The vocabulary as hypotheses, to decide which causes a session can show: effect, place, and the change by its
parameters.

Each `apply(change, parameters)` adds a cause to a `Change`. Steps are for finite differences.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from .effects import link_tip, transverse_axes
from .kinematics import Chain, Change, Yield, chain, moments
from .robots import Robot
from .truth import Commands

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Hypothesis:
    """One effect at one place; `variant` tells apart laws of one effect (which friction decides the side of
    play)."""

    effect: str
    at: str
    steps: tuple[float, ...]
    apply: Callable[[Change, Array], None]
    optical: bool = False
    """Moves corners too: camera, board, mirror, or a joint of the head."""
    variant: str = ""

    @property
    def name(self) -> str:
        return f"{self.effect}@{self.at}"


PLAY_FRICTION_SHARES = (0.0, 0.1, 0.3, 1.0, np.inf)
"""Friction at a loose joint over the RMS torque of gravity there: which of load and motion decides the
side."""


PATH_STEPS = 12
"""Points of each move at which the load is computed: a load on the way can push a loose joint."""


def path_commands(commands: Commands) -> Commands:
    """The straight moves from posture to posture, from rest at 0, `PATH_STEPS` points each; the last is the
    posture."""
    before = np.vstack([np.zeros(commands.q_rad.shape[1]), commands.q_rad[:-1]])
    share = (np.arange(PATH_STEPS) + 1)[None, :, None] / PATH_STEPS
    q = before[:, None] + share * (commands.q_rad - before)[:, None]
    return Commands(commands.joints, q.reshape(-1, q.shape[-1]), np.repeat(commands.time_s, PATH_STEPS))


def loose_position(q: Array, half: float, load: Array, friction: float) -> Array:
    """Error of a joint with play, at the postures: on the side of its load, or where friction left it
    within the play.

    `q` and `load` follow the path (P · PATH_STEPS,).
    """
    out = np.empty(len(q) // PATH_STEPS)
    held, low, high = 0.0, (q - half).tolist(), (q + half).tolist()
    for i, torque in enumerate(load.tolist()):
        if torque > friction:
            held = high[i]
        elif torque < -friction:
            held = low[i]
        else:
            held = min(max(held, low[i]), high[i])
        if i % PATH_STEPS == PATH_STEPS - 1:
            out[i // PATH_STEPS] = held - q[i]
    return out


def _remembered(q: Array, load: Array, friction: float) -> Callable[[float], Array]:
    """`loose_position` for a half width; the last few results are cached for fits and screenings."""

    @lru_cache(maxsize=6)
    def position(half: float) -> Array:
        return loose_position(q, half, load, friction)

    return position


def _halved(position: Callable[[float], Array]) -> Callable[[Array], Array]:
    return lambda p: position(float(p[0]) / 2)


def all_hypotheses(
    robot: Robot,
    commands: Commands,
    gravity: Array,
    friction_nm: dict[str, float] | None = None,
    only: set[str] | None = None,
) -> list[Hypothesis]:
    """Every effect of the vocabulary at every place of this robot, but `geometry`, `pairing` and `none`.

    `friction_nm` adds play with a known friction at the joints that it names; `only` leaves out joints that it does
    not name.
    """
    path = path_commands(commands)
    nominal = chain(robot, path, Change())
    out: list[Hypothesis] = []
    for j in robot.commanded:
        named = only is None or j in {n.split("<-")[0] for n in only} or _link_of(robot, j) in only
        if named and robot.moves(j):
            out += _joint(robot, commands, gravity, path, nominal, j, (friction_nm or {}).get(j))
    out += _lengths(robot)
    for m in robot.markers:
        out.append(_marker(robot, m))
    return out + _optics()


def _link_of(robot: Robot, joint: str) -> str:
    return f"link:{robot.bodies[robot.body_of_joint(joint)].name}"


def _still(q: Array) -> bool:
    """A joint that is commanded but never moves: only its offset can be told."""
    return bool(np.ptp(q) < 1e-3)


def _joint(
    robot: Robot,
    commands: Commands,
    gravity: Array,
    path: Commands,
    nominal: Chain,
    j: str,
    friction_nm: float | None,
) -> list[Hypothesis]:
    q, body = commands.of(j), robot.body_of_joint(j)
    on_path = path.of(j)
    axis, time = robot.bodies[body].axis, commands.time_s
    at, seen = f"joint:{j}", robot.moves(j)
    head = "camera" in seen or "board" in seen
    moment = moments(robot, nominal, gravity, body)
    load = moment @ axis
    typical = max(float(np.sqrt(np.mean(load**2))), 1e-9)

    def law(
        effect: str,
        steps: tuple[float, ...],
        error: Callable[[Array], Array],
        variant: str = "",
        place: str = at,
    ) -> Hypothesis:
        return Hypothesis(effect, place, steps, lambda c, p: c.add_joint(j, error(p)), head, variant)

    offset = law("joint_offset", (1e-4,), lambda p: np.full(len(q), p[0]))
    if _still(q):
        return [offset]
    found = [
        offset,
        law("gear_ratio", (1e-4,), lambda p: p[0] * q),
        law("gear_eccentricity", (1e-4, 1e-4), lambda p: p[0] * np.sin(q) + p[1] * (np.cos(q) - 1)),
        law("drift", (1e-6,), lambda p: p[0] * time),
    ]
    frictions = {f"{share:g}": share * typical for share in PLAY_FRICTION_SHARES}
    if friction_nm is not None:
        frictions["known"] = friction_nm
    for name, friction in frictions.items():
        lie = _remembered(on_path, load, friction)
        found.append(law("backlash", (1e-3,), _halved(lie), name))

    held = _remembered(on_path, load, np.inf)

    def stuck(change: Change, p: Array) -> None:
        change.add_joint(j, held(float(p[0])))
        change.yields.append(Yield(body, axis, float(p[1]), np.zeros(3)))

    found.append(Hypothesis("stiction", at, (1e-3, 1e-3 / typical), stuck, head))
    found.append(
        Hypothesis(
            "joint_compliance",
            at,
            (1e-3 / typical,),
            lambda c, p: c.yields.append(Yield(body, axis, float(p[0]), np.zeros(3))),
            head,
        )
    )
    found.append(_tilt(robot, j, body, head))
    for k in robot.commanded:
        of_k = commands.of(k)
        if k != j and not _still(of_k):
            found.append(law("joint_coupling", (1e-4,), _proportional(of_k), place=f"joint:{j}<-joint:{k}"))
    if not head:
        found.append(_bending(robot, body, float(np.sqrt(np.mean(np.sum(moment**2, 1))))))
    return found


def _proportional(x: Array) -> Callable[[Array], Array]:
    return lambda p: p[0] * x


def _tilt(robot: Robot, j: str, body: int, head: bool) -> Hypothesis:
    axis = robot.bodies[body].axis
    helper = np.eye(3)[0] if abs(axis[0]) < 0.8 else np.eye(3)[1]
    u = np.cross(axis, helper)
    u /= np.linalg.norm(u)
    v = np.cross(axis, u)

    def tilt(change: Change, p: Array) -> None:
        real = axis + np.tan(p[0]) * u + np.tan(p[1]) * v
        change.axis[body] = real / np.linalg.norm(real)

    return Hypothesis("axis_tilt", f"joint:{j}", (1e-4, 1e-4), tilt, head)


def _bending(robot: Robot, body: int, typical: float) -> Hypothesis:
    axes, middle = transverse_axes(robot, body), link_tip(robot, body) / 2

    def bend(change: Change, p: Array) -> None:
        change.yields += [Yield(body, a, float(p[0]), middle) for a in axes]

    return Hypothesis("link_bending", f"link:{robot.bodies[body].name}", (1e-3 / max(typical, 1e-9),), bend)


def _shift(change: Change, body: int, p: Array) -> None:
    change.origin_m[body] = change.origin_m.get(body, np.zeros(3)) + p


def _lengths(robot: Robot) -> list[Hypothesis]:
    out = []
    for j in robot.commanded:
        body = robot.body_of_joint(j)
        following = robot.next_body(body)
        if following is not None and robot.bodies[following].parent == body and robot.moves(j):
            head = bool({"camera", "board"} & set(robot.moves(robot.bodies[following].joint)))
            out.append(
                Hypothesis(
                    "link_length",
                    f"link:{robot.bodies[body].name}",
                    (1e-4,) * 3,
                    _shifting(following),
                    head,
                )
            )
    return out


def _shifting(body: int) -> Callable[[Change, Array], None]:
    return lambda change, p: _shift(change, body, p)


def _marker(robot: Robot, m: str) -> Hypothesis:
    body = robot.index[f"{m}_marker"]
    return Hypothesis("marker_mount", f"marker:{m}", (1e-4,) * 3, _shifting(body))


def _optics() -> list[Hypothesis]:
    def mount(c: Change, p: Array) -> None:
        c.camera_turn_rad, c.camera_shift_m = c.camera_turn_rad + p[:3], c.camera_shift_m + p[3:]

    def focal(c: Change, p: Array) -> None:
        c.focal += float(p[0])

    def center(c: Change, p: Array) -> None:
        c.center_px = c.center_px + p

    def radial(c: Change, p: Array) -> None:
        c.k1 += float(p[0])

    def squares(c: Change, p: Array) -> None:
        c.board_scale += float(p[0])

    def pane(c: Change, p: Array) -> None:
        c.glass_m += float(p[0])

    def bowl(c: Change, p: Array) -> None:
        c.curvature_per_m += float(p[0])

    return [
        Hypothesis("camera_mount", "camera", (1e-4,) * 6, mount, True),
        Hypothesis("camera_focal", "camera", (1e-4,), focal, True),
        Hypothesis("camera_center", "camera", (0.05, 0.05), center, True),
        Hypothesis("lens_distortion", "camera", (1e-3,), radial, True),
        Hypothesis("board_scale", "board", (1e-4,), squares, True),
        Hypothesis("mirror_glass", "mirror", (1e-4,), pane, True),
        Hypothesis("mirror_curvature", "mirror", (1e-3,), bowl, True),
    ]
