"""What a session can show: could another effect at another place make the same pixels, within the noise?

The truth's noise-free pixels are fitted by every hypothesis of the vocabulary: first to first order, with
each frame's
mirror plane (three parameters) projected out, then the best few by Gauss and Newton on the exact model,
planes included. With σ the noise that the session truly has,

    BIC(h) = Σ ‖clean − predicted(h)‖² / σ² + k(h) ln(n)

is what a reference that knows the noise expects of h. A cause is *detectable* when the model without it is
worse by more than
`MARGIN`, and *identifiable* when every other effect at any place is. This is code of its own: it shares
nothing with the diagnosis, and knows what a diagnosis cannot (the noise, and the pixels without it).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .hypotheses import Hypothesis, all_hypotheses
from .kinematics import Chain, Change, rotations, settled_chain
from .optics import Lens, Mirror, apparent
from .robots import Robot
from .truth import Commands

if TYPE_CHECKING:
    from .make import Case

Array = NDArray[np.float64]

MARGIN = 10.0
"""Twice the logarithm of the odds at which one hypothesis is called clearly better: 150 to 1."""
REFINED = 8
"""Rivals that are refined on the exact model after the first-order screening."""
GAUSS_NEWTON_STEPS = 5
PLANE_STEP = 1e-6
REMAINDER = 30.0
"""χ² above which what a hypothesis leaves of an effect shows: of an effect outside the vocabulary, a mimic
leaves less."""


@dataclass
class Reference:
    """A session's geometry and pixels, and the model that predicts them."""

    robot: Robot
    gravity: Array
    commands: Commands
    of_frame: NDArray[np.int_]
    lens: Lens
    board_points: Array
    corners_px: Array
    blobs_px: Array
    corner_std_px: float
    blob_std_px: float

    def __post_init__(self) -> None:
        self.count = self.board_points.shape[0]
        px = np.concatenate([self.corners_px, self.blobs_px], axis=1)
        self.seen = np.isfinite(px).all(axis=-1)
        self.observed = np.where(self.seen[..., None], px, 0.0)
        std = np.concatenate(
            [np.full(self.count, self.corner_std_px), np.full(px.shape[1] - self.count, self.blob_std_px)]
        )
        self.weight = self.seen[..., None] / std[None, :, None]
        self.size = 2 * int(self.seen.sum())

    def points(self, change: Change) -> Array:
        """Board corners and markers (F, C + M, 3) m in the camera."""
        at = settled_chain(self.robot, self.commands, change, self.gravity)
        return self._points(at, change)[self.of_frame]

    def _points(self, at: Chain, change: Change) -> Array:
        robot = self.robot
        camera, board = robot.index[robot.camera_link], robot.index[robot.board_link]
        markers = [robot.index[f"{m}_marker"] for m in robot.markers]
        turn = at.rotation[camera]
        origin = at.position_m[camera] + turn @ change.camera_shift_m
        turn = turn @ rotations(change.camera_turn_rad[None])
        corners = at.position_m[board][:, None] + np.einsum(
            "pij,cj->pci", at.rotation[board], self.board_points * (1 + change.board_scale)
        )
        arms = np.stack([at.position_m[m] for m in markers], axis=1)
        return np.einsum("pji,pcj->pci", turn, np.concatenate([corners, arms], axis=1) - origin[:, None])

    def project(self, points: Array, planes: Array, change: Change) -> Array:
        """Pixels (F, K, 2); `planes` (F, 3) are the feet of the perpendiculars from the camera to the
        mirrors."""
        frames, count = points.shape[:2]
        lens = Lens(
            self.lens.focal_px * (1 + change.focal),
            self.lens.center_px + change.center_px,
            self.lens.distortion + np.array([change.k1, 0, 0, 0, 0]),
            self.lens.size_px,
        )
        distance = np.linalg.norm(planes, axis=1)
        normal = planes / distance[:, None]
        if change.glass_m == 0 and change.curvature_per_m == 0:
            gap = distance[:, None] - np.einsum("fi,fki->fk", normal, points)
            return lens.image(self._outline(points + 2 * gap[..., None] * normal[:, None]))
        index = np.repeat(np.arange(frames), count)
        # A pane thinner than nothing has no path: by symmetry of the small effect, extrapolate from a thick
        # one.
        glass = abs(change.glass_m)
        mirror = Mirror(normal[index], distance[index], glass, 1.52, np.full(2, change.curvature_per_m))
        seen = apparent(mirror, points.reshape(-1, 3)).reshape(frames, count, 3)
        if change.glass_m < 0:
            gap = distance[:, None] - np.einsum("fi,fki->fk", normal, points)
            seen = 2 * (points + 2 * gap[..., None] * normal[:, None]) - seen
        return lens.image(self._outline(seen))

    def _outline(self, seen: Array) -> Array:
        """Markers moved to where the centre of a ball's outline, an ellipse, lies: as if it were nearer by
        r²/z."""
        radius = self.robot.marker_diameter_m / 2
        first = self.count - (self.count + len(self.robot.markers) - seen.shape[1])
        seen = seen.copy()
        seen[:, first:, 2] -= radius**2 / seen[:, first:, 2]
        return seen

    def residual(self, points: Array, planes: Array, change: Change) -> Array:
        """(F, 2K), whitened, 0 where nothing was seen."""
        r = (self.observed - self.project(points, planes, change)) * self.weight
        return np.where(self.seen[..., None], r, 0.0).reshape(len(points), -1)

    def plane_basis(self, points: Array, planes: Array, change: Change, r: Array) -> tuple[Array, Array]:
        """Jacobian (F, 2K, 3) of the residual by the planes, and an orthonormal basis of it."""
        columns = []
        for k in range(3):
            moved = planes.copy()
            moved[:, k] += PLANE_STEP
            columns.append((self.residual(points, moved, change) - r) / PLANE_STEP)
        jacobian = np.stack(columns, axis=-1)
        return jacobian, np.linalg.qr(jacobian)[0]


@dataclass
class Fit:
    """A fitted set of hypotheses: parameters, planes, χ² and BIC of the noise-free data."""

    hypotheses: list[Hypothesis]
    parameters: list[Array]
    planes: Array
    chi2: float
    bic: float


def _changed(hypotheses: Sequence[Hypothesis], parameters: Sequence[Array]) -> Change:
    change = Change()
    for h, p in zip(hypotheses, parameters, strict=True):
        h.apply(change, p)
    return change


def _columns(
    ref: Reference, hypotheses: list[Hypothesis], parameters: list[Array], planes: Array, r: Array
) -> Array:
    """Jacobian (F, 2K, n) of the residual by all parameters, by forward differences."""
    columns = []
    for i, h in enumerate(hypotheses):
        for k, step in enumerate(h.steps):
            moved = [p.copy() for p in parameters]
            moved[i][k] += step
            change = _changed(hypotheses, moved)
            columns.append((ref.residual(ref.points(change), planes, change) - r) / step)
    return np.stack(columns, axis=-1)


def _without(basis: Array, columns: Array) -> Array:
    return columns - np.einsum("fkp,fp...->fk...", basis, np.einsum("fkp,fk...->fp...", basis, columns))


def fit(ref: Reference, hypotheses: list[Hypothesis], planes: Array, start: list[Array] | None = None) -> Fit:
    """Gauss–Newton over the hypotheses' parameters and all planes, with step halving."""
    parameters = start or [np.zeros(len(h.steps)) for h in hypotheses]
    change = _changed(hypotheses, parameters)
    points = ref.points(change)
    r = ref.residual(points, planes, change)
    chi2 = float(np.sum(r**2))
    for _ in range(GAUSS_NEWTON_STEPS):
        jacobian, basis = ref.plane_basis(points, planes, change, r)
        delta = np.zeros(0)
        target = r
        if hypotheses:
            columns = _columns(ref, hypotheses, parameters, planes, r)
            flat = _without(basis, columns).reshape(-1, columns.shape[-1])
            scale = np.maximum(np.linalg.norm(flat, axis=0), 1e-12)
            delta = -np.linalg.lstsq(flat / scale, _without(basis, r).ravel(), rcond=1e-9)[0] / scale
            target = r + columns @ delta
        normal = np.einsum("fki,fkj->fij", jacobian, jacobian) + 1e-12 * np.eye(3)
        move = -np.linalg.solve(normal, np.einsum("fki,fk->fi", jacobian, target)[..., None])[..., 0]
        share, improved = 1.0, False
        for _ in range(6):
            cut = (
                np.split(delta * share, np.cumsum([len(h.steps) for h in hypotheses])[:-1])
                if hypotheses
                else []
            )
            trial = [p + d for p, d in zip(parameters, cut, strict=True)]
            trial_change = _changed(hypotheses, trial)
            trial_points = ref.points(trial_change)
            trial_planes = planes + share * move
            trial_r = ref.residual(trial_points, trial_planes, trial_change)
            trial_chi2 = float(np.sum(trial_r**2))
            if trial_chi2 < chi2:
                improved = True
                break
            share /= 2
        if not improved:
            break
        gain = chi2 - trial_chi2
        parameters, planes, points, change, r, chi2 = (
            trial,
            trial_planes,
            trial_points,
            trial_change,
            trial_r,
            trial_chi2,
        )
        if gain < 0.05:
            break
    number = sum(len(h.steps) for h in hypotheses)
    return Fit(hypotheses, parameters, planes, chi2, chi2 + number * float(np.log(ref.size)))


def screen(ref: Reference, base: Fit, candidates: Sequence[Hypothesis]) -> list[tuple[float, Hypothesis]]:
    """To first order about `base`: BIC of base and each candidate, best first; the base's own parameters
    are free."""
    change = _changed(base.hypotheses, base.parameters)
    points = ref.points(change)
    r = ref.residual(points, base.planes, change)
    _, basis = ref.plane_basis(points, base.planes, change, r)
    left = _without(basis, r)
    own = None
    if base.hypotheses:
        columns = _without(basis, _columns(ref, base.hypotheses, base.parameters, base.planes, r))
        own = np.linalg.qr(columns.reshape(-1, columns.shape[-1]))[0]
        left = (left.ravel() - own @ (own.T @ left.ravel())).reshape(left.shape)
    out = []
    frames = len(r)
    own_rows = None if own is None else own.reshape(*r.shape, -1)
    for h in candidates:
        # A body's hypothesis leaves the corners alone: only the markers' rows are differenced.
        part = slice(0, None) if h.optical else slice(2 * ref.count, None)
        columns = np.empty((frames, r[:, part].shape[1], len(h.steps)))
        for k, step in enumerate(h.steps):
            p = np.zeros(len(h.steps))
            p[k] = step
            moved = _changed([*base.hypotheses, h], [*base.parameters, p])
            columns[..., k] = (_part_residual(ref, moved, base.planes, h.optical) - r[:, part]) / step
        # `left` is already free of the nuisances, so the inner products need the columns' nuisance part
        # only once.
        shared = np.swapaxes(basis[:, part], 1, 2) @ columns
        normal = np.einsum("fka,fkb->ab", columns, columns) - np.einsum("fpa,fpb->ab", shared, shared)
        pull = np.einsum("fka,fk->a", columns, left[:, part])
        if own_rows is not None:
            mixed = np.einsum("fkp,fka->pa", own_rows[:, part], columns)
            normal = normal - mixed.T @ mixed
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-24))
        scaled = normal / np.outer(scale, scale)
        chi2 = float(
            np.sum(left**2)
            - pull / scale @ np.linalg.pinv(scaled, rcond=1e-9, hermitian=True) @ (pull / scale)
        )
        number = sum(len(x.steps) for x in base.hypotheses) + len(h.steps)
        out.append((chi2 + number * float(np.log(ref.size)), h))
    return sorted(out, key=lambda pair: pair[0])


def _part_residual(ref: Reference, change: Change, planes: Array, whole: bool) -> Array:
    points = ref.points(change)
    if whole:
        return ref.residual(points, planes, change)
    k = ref.count
    px = ref.project(points[:, k:], planes, change)
    r = (ref.observed[:, k:] - px) * ref.weight[:, k:]
    return np.where(ref.seen[:, k:, None], r, 0.0).reshape(len(points), -1)


def reference_of(case: Case) -> Reference:
    """The reference of a simulated case: its noise-free pixels, where its measured ones were seen."""
    from .make import board_points

    measured = np.isfinite(case.corners_px).all(-1), np.isfinite(case.blobs_px).all(-1)
    corners, blobs = case.clean_corners_px, case.clean_blobs_px
    if case.truth.pairing is not None:
        first, last, shift = case.truth.pairing
        source = np.arange(len(corners))
        source[first : min(last, len(corners) - 4) + 1] += shift
        corners, blobs = corners[source], blobs[source]
    return Reference(
        case.robot,
        case.gravity,
        case.plan.commands,
        case.plan.posture_of_frame,
        case.nominal_lens,
        board_points(case.robot),
        np.where(measured[0][..., None], corners, np.nan),
        np.where(measured[1][..., None], blobs, np.nan),
        case.noise.corner_px,
        case.noise.blob_px,
    )


def judge(case: Case) -> dict[str, Any]:
    """`detectable`, `identifiable` and `rivals` for the answer: of a single cause, or of each of several."""
    ref = reference_of(case)
    causes = case.answer["causes"]
    start = case.mirror.normal * case.mirror.distance_m[:, None]
    if case.truth.pairing is not None:
        first, last, shift = case.truth.pairing
        source = np.arange(len(start))
        source[first : min(last, len(start) - 4) + 1] += shift
        start = start[source]
    empty = fit(ref, [], start)
    report: dict[str, Any] = {"nominal_chi2": empty.chi2, "residuals": ref.size}
    if not causes:
        best = screen(ref, empty, all_hypotheses(case.robot, case.plan.commands, case.gravity))[0]
        report["distraction"] = {"best": best[1].name, "gain": empty.bic - best[0]}
        return report
    friction = {c["at"].removeprefix("joint:"): c["friction_nm"] for c in causes if "friction_nm" in c}
    everything = all_hypotheses(case.robot, case.plan.commands, case.gravity, friction)
    if len(causes) == 1:
        return report | _judge_single(ref, empty, everything, causes[0])
    return report | _judge_several(ref, empty, everything, causes)


def _truths(everything: list[Hypothesis], cause: dict[str, Any]) -> list[Hypothesis]:
    return [h for h in everything if h.effect == cause["effect"] and h.at == cause["at"]]


def _judge_single(
    ref: Reference, empty: Fit, everything: list[Hypothesis], cause: dict[str, Any]
) -> dict[str, Any]:
    ranked = [h for _, h in screen(ref, empty, everything)]
    truths = _truths(everything, cause)
    if cause["effect"] in ("geometry", "pairing"):
        best = min((fit(ref, [h], empty.planes) for h in ranked[:3]), key=lambda f: f.bic)
        explained = best.bic < 0.5 * empty.bic
        seen = empty.chi2 > 100
        return {
            "detectable": seen,
            "identifiable": seen and not explained,
            "rivals": [best.hypotheses[0].name] * explained,
        }
    if cause["effect"] == "unknown":
        fits = [fit(ref, [h], empty.planes) for h in _one_per_name(ranked)[:REFINED]]
        seen = empty.chi2 > REMAINDER
        mimics = [f.hypotheses[0].name for f in fits if f.chi2 < REMAINDER]
        return {
            "detectable": seen,
            "identifiable": seen and not mimics,
            "rivals": mimics,
            "closest": [
                {"name": f.hypotheses[0].name, "chi2_left": f.chi2}
                for f in sorted(fits, key=lambda f: f.chi2)[:3]
            ],
        }
    own = min((fit(ref, [h], empty.planes) for h in truths), key=lambda f: f.bic)
    others = [h for h in _one_per_name(ranked) if h not in truths and not _contains(h, cause)][:REFINED]
    fits = [fit(ref, [h], empty.planes) for h in others]
    rivals = [f.hypotheses[0].name for f in sorted(fits, key=lambda f: f.bic) if f.bic - own.bic < MARGIN]
    detectable = empty.bic - own.bic > MARGIN
    return {
        "detectable": detectable,
        "identifiable": detectable and not rivals,
        "rivals": rivals,
        "own_chi2": own.chi2,
        "margin": float(min((f.bic for f in fits), default=np.inf) - own.bic),
    }


def _contains(h: Hypothesis, cause: dict[str, Any]) -> bool:
    """A hypothesis that has the truth's law in it is no rival: a sticking servo droops as a compliant joint
    does."""
    return h.effect == "stiction" and cause["effect"] == "joint_compliance" and h.at == cause["at"]


def _one_per_name(ranked: list[Hypothesis]) -> list[Hypothesis]:
    seen: dict[str, Hypothesis] = {}
    for h in ranked:
        seen.setdefault(h.name, h)
    return list(seen.values())


def _judge_several(
    ref: Reference, empty: Fit, everything: list[Hypothesis], causes: list[dict[str, Any]]
) -> dict[str, Any]:
    """Each cause in turn, with the others in the model: can it be left out, or another take its place?"""
    chosen = []
    for cause in causes:
        ranked = [h for _, h in screen(ref, empty, _truths(everything, cause))]
        chosen.append(ranked[0])
    whole = fit(ref, chosen, empty.planes)
    for i, cause in enumerate(causes):
        for other in _truths(everything, cause):
            if other is not chosen[i] and cause["effect"] == "backlash":
                trial = fit(ref, [*chosen[:i], other, *chosen[i + 1 :]], whole.planes)
                if trial.bic < whole.bic:
                    whole, chosen = trial, list(trial.hypotheses)
    judged = []
    for i, cause in enumerate(causes):
        rest = [h for k, h in enumerate(chosen) if k != i]
        without = fit(ref, rest, whole.planes, [p.copy() for k, p in enumerate(whole.parameters) if k != i])
        names = {h.name for h in chosen}
        candidates = [h for h in everything if h.name not in names and not _contains(h, cause)]
        near = _one_per_name([h for _, h in screen(ref, without, candidates)])[: REFINED // 2]
        start = [*without.parameters]
        fits = [
            fit(ref, [*rest, h], without.planes, [*(p.copy() for p in start), np.zeros(len(h.steps))])
            for h in near
        ]
        rivals = [f.hypotheses[-1].name for f in fits if f.bic - whole.bic < MARGIN]
        detectable = without.bic - whole.bic > MARGIN
        cause["detectable"], cause["identifiable"], cause["rivals"] = (
            detectable,
            detectable and not rivals,
            rivals,
        )
        judged.append(cause["identifiable"])
    return {
        "detectable": all(c["detectable"] for c in causes),
        "identifiable": all(judged),
        "rivals": sorted({r for c in causes for r in c["rivals"]}),
        "own_chi2": whole.chi2,
    }
