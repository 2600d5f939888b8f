"""MuJoCo executes a session's commands in their order and comes to rest after each; the result is the
body's pose.

Each row moves every joint straight from the last command to the next, waits until nothing moves, and gives
the poses of camera, board and markers in the root's frame. Rows with the same command as the row before are
the same rest.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from mirror_posture import MirrorPostureError
from mirror_posture.arrays import Floats, Integers, Mask
from mirror_posture.session import Session
from mirror_posture.short_repr import ShortRepr

from .model import Simulator, frame_of, needed_links
from .quiet import quiet

Drive = Callable[[Mapping[str, Floats], Floats], Floats]
"""What a faulty drive adds to a joint's command: from all commands (F,) by joint and the time (F,) s to (F,) rad."""

MOVE_S, CHUNK_S, LONGEST_REST_S = 1.0, 0.1, 3.0
"""A second for a move: faster, and the limbs' inertia throws a play over, which the session's own robot may not have done."""
STILL_RAD_PER_S = 5e-4
"""Mean speed over a chunk: friction that holds a load quivers, and goes nowhere."""
RAMP_PARTS = 100


@dataclass(frozen=True, eq=False, repr=False)
class Rest(ShortRepr):
    """Where the simulated body rests in each frame: `root_from_link` (F, 4, 4) by link, and whether all came to rest."""

    root_from_link: Mapping[str, Floats]
    still: Mask


@quiet()
def execute(
    simulator: Simulator,
    session: Session,
    drives: Mapping[str, list[Drive]],
    swapped: Sequence[tuple[str, str]] = (),
) -> Rest:
    """Executes all rows of a session. `swapped` are pairs of joints whose servos get each other's commands.

    Raises:
        MirrorPostureError: the simulation diverges.
    """
    model = simulator.compiled()
    data = mujoco.MjData(model)
    commands = _commands(simulator, session, drives, swapped)
    actuator = _actuators(model, simulator)
    # A servo measures its joint's position times its gear.
    gear = model.actuator_gear[actuator, 0]
    links = needed_links(session)
    place = {link: simulator.stands_for.get(link, link) for link in links}
    frames = len(session.frames)
    poses = {link: np.empty((frames, 4, 4)) for link in links}
    still = np.ones(frames, dtype=bool)
    # Before the first row all joints rest at 0.
    now = np.zeros(len(simulator.joints))
    data.ctrl[actuator] = now
    _settle(model, data)
    for row, target in enumerate(commands):
        if not np.array_equal(target, now):
            for share in np.linspace(0.0, 1.0, RAMP_PARTS + 1)[1:]:
                data.ctrl[actuator] = gear * (now + share * (target - now))
                mujoco.mj_step(model, data, nstep=max(1, int(MOVE_S / RAMP_PARTS / model.opt.timestep)))
            now = target
            still[row] = _settle(model, data)
        elif row:
            still[row] = still[row - 1]
        if not np.isfinite(data.qpos).all() or data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number:
            raise MirrorPostureError(f"frame {session.frames.frame[row]}: the simulation diverges")
        mujoco.mj_kinematics(model, data)
        root_from_world = np.linalg.inv(frame_of(model, data, place[session.root_link]))
        for link in links:
            poses[link][row] = root_from_world @ frame_of(model, data, place[link])
    return Rest(poses, still)


def _commands(
    simulator: Simulator,
    session: Session,
    drives: Mapping[str, list[Drive]],
    swapped: Sequence[tuple[str, str]] = (),
) -> Floats:
    """(F, joints): the command of each servo, faults of its drive included: they act on what the servo gets."""
    positions = dict(zip(session.robot.position_names, session.positions.T, strict=True))
    for first, second in swapped:
        positions[first], positions[second] = positions[second], positions[first]
    times = session.frames.time_s
    time_s = session.frames.frame.astype(float) if times is None else np.asarray(times, float)
    time_s = time_s - time_s[0]
    columns = []
    for name in simulator.joints:
        told = positions[name].astype(float)
        columns.append(told + sum(drive(positions, time_s) for drive in drives.get(name, ())))
    return np.stack(columns, axis=1)


def _actuators(model: mujoco.MjModel, simulator: Simulator) -> Integers:
    """The actuator of each joint that gets its command."""
    names = [simulator.servos[name] for name in simulator.joints]
    return np.array([model.actuator(name).id for name in names], dtype=np.int64)


def _settle(model: mujoco.MjModel, data: mujoco.MjData) -> bool:
    """Steps until nothing moves; False where it still does after the longest time."""
    steps = max(1, int(CHUNK_S / model.opt.timestep))
    before = data.qpos.copy()
    for _ in range(int(LONGEST_REST_S / CHUNK_S)):
        mujoco.mj_step(model, data, nstep=steps)
        if float(np.abs(data.qpos - before).max(initial=0.0)) < STILL_RAD_PER_S * CHUNK_S:
            return True
        before[:] = data.qpos
    return False
