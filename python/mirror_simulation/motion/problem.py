"""Residuals of a session in motion as a function of its causes, and their columns.

A cause changes a joint's position at each moment: for its servo the simulator computes the change; for its
zero, gear, spring and play a law does; for a latency it follows from the speed. One Jacobian that all
hypotheses share turns changes of positions into changes of images.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mirror_posture import MirrorPostureError
from mirror_posture.arrays import Floats, Mask
from mirror_posture.session import Session

from .effects import Causes, Hypothesis, Key, of_joint, of_setup
from .motions import Motion
from .positions import positions
from .recording import Recording, recording_of
from .rollouts import Rollouts
from .scales import scales_of
from .view import Places, View

POSITION_STEP = 1e-5
WEAK_SHARE = 1e-3
"""A picture whose information of a joint is below this share of the usual shows nothing of it."""
MOST_AHEAD = 44
"""Motions simulated ahead of their use: fewer than are kept."""
FAR_RAD = 0.03
"""If joints are farther than this from the nominal model, images are no longer linear around it."""


class Problem:
    """A moving session, its simulator and its hypotheses."""

    def __init__(self, session: Session, model_file: Path | None = None) -> None:
        self.recording: Recording = recording_of(session)
        self.session, self.model_file = session, model_file
        self.rollouts = Rollouts(self.recording, model_file)
        self.joints = self.rollouts.joints
        self.columns_of = np.array([session.robot.position_names.index(name) for name in self.joints])
        nominal = self.rollouts.nominal()
        self.scales = scales_of(self.rollouts)
        self.view = View(self.recording, self.places({}, nominal))
        moves = self._moving_joints()
        bare = [name for name, scale in self.scales.items() if name in moves and not scale.has_servo]
        if bare:
            # Then it is unknown how a joint follows its log, and every other cause would absorb that.
            raise MirrorPostureError(
                f"the model has no position servos at {', '.join(bare)}, so it is unknown how they follow their log; give the MJCF "
                "that your simulator runs, with its servos (--model)"
            )
        self.hypotheses: dict[Key, Hypothesis] = {}
        for name, scale in self.scales.items():
            if name in moves:
                self.hypotheses |= {h.key: h for h in of_joint(name, scale)}
        self.hypotheses |= {h.key: h for h in of_setup(session.marker_names)}
        self._by_position: Floats | None = None
        self._from_nominal: dict[tuple[object, ...], Floats | None] = {}
        self._kept: dict[tuple[object, ...], Places | None] = {}

    def _moving_joints(self) -> set[str]:
        """The joints whose positions change the observations."""
        robot, out = self.session.robot, set()
        for marker in self.view.marker_links:
            for step in robot.chain(self.view.links[0], marker):
                out.add(step.joint)
        for step in robot.chain(*self.view.links):
            out.add(step.joint)
        return out

    def places(self, causes: Causes, motion: Motion) -> Places:
        """The joint positions when markers and board are seen."""
        recording = self.recording
        markers, board = positions(
            self.rollouts, causes, motion, recording.marker_time_s, recording.board_time_s
        )
        count = len(self.session.robot.position_names)
        all_markers, all_board = np.zeros((*markers.shape[:2], count)), np.zeros((len(board), count))
        all_markers[..., self.columns_of], all_board[..., self.columns_of] = markers, board
        return Places(all_markers, all_board)

    def residuals(self, several: Sequence[Causes]) -> list[Floats | None]:
        """Whitened residuals (F, markers, 2) of each set of causes; None where the simulation diverges."""
        return [
            None
            if motion is None
            else self.view.whitened(self.view.residual_px(self.places(causes, motion), causes))
            for causes, motion in zip(several, self.rollouts.motions(several), strict=True)
        ]

    def large_changes(self, several: Sequence[Causes]) -> list[Floats | None]:
        """As `changes` from the model as it is, through the optics: for what moves the images too far to be linear.

        What each does to the joints is kept, so that asking again costs no simulation.
        """
        nominal = self.rollouts.nominal()
        here = self.places({}, nominal)
        fresh = [causes for causes in several if _key(causes) not in self._kept]
        for causes, motion in zip(fresh, self.rollouts.motions(fresh), strict=True):
            there = None if motion is None else self.places(causes, motion)
            self._kept[_key(causes)] = (
                None if there is None else Places(there.markers - here.markers, there.board - here.board)
            )
        base = self.view.whitened(self.view.residual_px(here, {}))
        out: list[Floats | None] = []
        for causes in several:
            moved = self._kept[_key(causes)]
            if moved is None:
                out.append(None)
                continue
            there = Places(here.markers + moved.markers, here.board + moved.board)
            out.append(base - self.view.whitened(self.view.residual_px(there, causes)))
        return out

    def by_position(self) -> Floats:
        """(F, markers, 2, joints): whitened images by joint positions, at the nominal model."""
        if self._by_position is None:
            nominal = self.places({}, self.rollouts.nominal())
            base = self.view.residual_px(nominal, {})
            parts = []
            for column in self.columns_of:
                markers, board = nominal.markers.copy(), nominal.board.copy()
                markers[..., column] += POSITION_STEP
                board[..., column] += POSITION_STEP
                parts.append((base - self.view.residual_px(Places(markers, board), {})) / POSITION_STEP)
            self._by_position = self.view.whitened(np.stack(parts, axis=-1))
        return self._by_position

    def changes(self, base: Causes, several: Sequence[Causes]) -> list[Floats | None]:
        """Whitened change of the prediction (F, markers, 2) from `base` to each set of causes.

        Linear in the positions, except for what moves camera, board or markers, and for models whose joints
        are far from the nominal.
        """
        (here_motion,) = self.rollouts.motions([base])
        if here_motion is None:
            return [None] * len(several)
        here = self.places(base, here_motion).markers
        far = self._is_far(here)
        jacobian = self.by_position()
        out: list[Floats | None] = []
        at_base: Floats | None = None
        # From the nominal model each hypothesis is computed once, whatever images are left out in between.
        known = self._from_nominal if not base else {}
        fresh = [causes for causes in several if _key(causes) not in known]
        simulated = dict(zip(map(_key, fresh), self.rollouts.motions(fresh), strict=True))
        for causes in several:
            key = _key(causes)
            through = far or any(
                key[0].endswith("_mount") and causes.get(key) != base.get(key) for key in {*causes, *base}
            )
            if not through and key in known:
                moved = known[key]
            else:
                motion = simulated[key]
                if motion is not None and through:
                    if at_base is None:
                        at_base = self.view.whitened(
                            self.view.residual_px(self.places(base, here_motion), base)
                        )
                    there = self.view.whitened(self.view.residual_px(self.places(causes, motion), causes))
                    out.append(at_base - there)
                    continue
                moved = None
                if motion is not None:
                    moved = (self.places(causes, motion).markers - here)[..., self.columns_of]
                if not base:
                    known[key] = moved
            out.append(None if moved is None else np.einsum("fmij,fmj->fmi", jacobian, moved))
        return out

    def _is_far(self, here: Floats) -> bool:
        nominal = self.places({}, self.rollouts.nominal()).markers
        return bool(np.abs(here - nominal)[self.view.seen].max(initial=0.0) > FAR_RAD)

    def columns(
        self, base: Causes, keys: Sequence[Key], *, central: bool = True
    ) -> tuple[list[tuple[Key, int]], Floats]:
        """Derivatives of the prediction by a step of each parameter of the causes `keys`, by central differences.

        Not `central`: to one side, from `base`, at half the simulations: enough for a first look.

        Returns which parameter each column is of, and the columns (F, markers, 2, P). A parameter at a bound is differenced to
        one side; one whose simulation diverges has a column of zeros.
        """
        of, ahead, behind = self._differenced(base, keys, central)
        changes = self.changes(base, [*ahead, *behind])
        empty = np.zeros((*self.view.seen.shape, 2))
        columns = [
            empty if up is None or down is None else up - down
            for up, down in zip(changes[: len(of)], changes[len(of) :], strict=True)
        ]
        return of, np.stack(columns, axis=-1) if columns else empty[..., None][..., :0]

    def _differenced(
        self, base: Causes, keys: Sequence[Key], central: bool
    ) -> tuple[list[tuple[Key, int]], list[Causes], list[Causes]]:
        """Parameters, and the causes ahead of and behind each, whose predictions are differenced."""
        of, ahead, behind = [], [], []
        for key in keys:
            h = self.hypotheses[key]
            values = base.get(key, (0.0,) * len(h.step))
            for k, step in enumerate(h.step):
                up, down = list(values), list(values)
                up[k] += 0.5 * step
                down[k] -= 0.5 * step
                if not central or down[k] < h.lower[k]:
                    up[k], down[k] = values[k] + step, values[k]
                of.append((key, k))
                ahead.append({**base, key: tuple(up)})
                behind.append({**base, key: tuple(down)} if any(down) or key in base else dict(base))
        return of, ahead, behind

    def ahead(self, several: Sequence[tuple[Causes, Sequence[Key]]], *, central: bool) -> None:
        """Simulates together what `columns` of several models and causes need: all cores are used."""
        wanted: list[Causes] = []
        for base, keys in several:
            _, ahead, behind = self._differenced(base, keys, central)
            wanted += [base, *ahead, *behind]
        self.rollouts.motions(wanted[:MOST_AHEAD])

    def leave_out(self, false: Mask) -> None:
        """Leaves out these images (F, markers) as false and no others; all columns must be computed again."""
        self.view.leave_out(false)
        self._by_position = None

    def begin_at(self, first: int) -> None:
        """Counts no picture before this one; columns must be computed again."""
        if first != self.view.first:
            self.view.begin_at(first)
            self._by_position = None

    def leave_out_false(self, causes: Causes) -> None:
        """Leaves out the images that lie far from the marker's place in those before and after, given a
        model with causes.

        A wrong model is wrong in neighbouring pictures too, so none of its errors is hidden.
        """
        self.leave_out(np.zeros_like(self.view.false))
        self.leave_out(self.view.false_among(self.errors_px(causes)))

    def errors_px(self, causes: Causes) -> Floats:
        """(F, markers, 2): observed minus predicted, px, with the mirror from the board's reflection."""
        (motion,) = self.rollouts.motions([causes])
        assert motion is not None
        return self.view.residual_px(self.places(causes, motion), causes)

    def rms(self, causes: Causes) -> tuple[float, float]:
        """RMS distance of image and prediction, px; and as a length at the marker, m, across the line of sight."""
        seen = self.view.seen
        errors = np.linalg.norm(self.errors_px(causes), axis=2)
        metres = errors * self.view.metres_per_px(self.places({}, self.rollouts.nominal()))
        return float(np.sqrt((errors[seen] ** 2).mean())), float(np.sqrt((metres[seen] ** 2).mean()))

    def floor_px(self, noise_scale: float) -> float:
        """The RMS distance that noise alone leaves, px."""
        return noise_scale * float(np.sqrt(self.view.variance_px2[self.view.seen].mean()))

    def joint_error(self, causes: Causes, j: int) -> Floats:
        """(F,): the error of joint `joints[j]` by each picture alone, rad; NaN where it shows nothing of it.

        `e = Jᵀr / JᵀJ`, J the joint's column and r the picture's whitened residuals.
        """
        (residual,) = self.residuals([causes])
        assert residual is not None
        column = self.by_position()[..., j]
        seen = self.view.seen[..., None]
        power = (np.where(seen, column, 0.0) ** 2).sum(axis=(1, 2))
        pull = np.where(seen, column * residual, 0.0).sum(axis=(1, 2))
        weak = power <= (WEAK_SHARE * np.median(power[power > 0.0]) if (power > 0.0).any() else 0.0)
        return np.asarray(np.where(weak, np.nan, pull / np.where(weak, 1.0, power)))


def _key(causes: Causes) -> tuple[object, ...]:
    return tuple(sorted(causes.items()))
