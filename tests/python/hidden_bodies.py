"""Random hidden bodies in MuJoCo, corrected by the loop; run it to make the figures of docs/faults.md again.

    MUJOCO_GL=egl python tests/python/hidden_bodies.py --bodies 200

Each body hides two or three effects in the arm (or arms) that the target moves. Whether a target can be reached at all is
found by an optimiser that sees the truth; the loop sees noisy pixels only.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from mirror_lab.robots import HiddenEffect
from mirror_lab.robots.mujoco import MujocoOptions, MujocoRobot
from mirror_posture.correct import CorrectOptions, correct, make_target, propose_views
from mirror_posture.robots import Nominal

NOISE_PX = 0.1
TOLERANCE_M = 0.001
STAND_ERROR_RAD = 0.02
NEAR_LIMIT_SHARE = 0.15
"""Of the targets, those that lie so near to a joint's limit that a hidden offset may put them out of reach."""
Draw = Callable[[np.random.Generator, str], HiddenEffect]
ARM = ("shoulder_pitch", "shoulder_roll", "elbow")
ARM_LINKS = ("upper_arm", "forearm")


def _size(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _signed(rng: np.random.Generator, low: float, high: float) -> float:
    return _size(rng, low, high) * float(rng.choice([-1.0, 1.0]))


def _joint(rng: np.random.Generator, side: str) -> str:
    return f"joint:{side}_{rng.choice(ARM)}"


def _shift(rng: np.random.Generator, low_m: float, high_m: float) -> dict[str, float]:
    v = rng.normal(size=3)
    v *= _size(rng, low_m, high_m) / np.linalg.norm(v)
    return {"dx_m": float(v[0]), "dy_m": float(v[1]), "dz_m": float(v[2])}


def _coupling(rng: np.random.Generator, side: str) -> HiddenEffect:
    one, other = rng.permutation(ARM)[:2]
    at = f"joint:{side}_{one}<-joint:{side}_{other}"
    return HiddenEffect("joint_coupling", at, {"coupling": _signed(rng, 0.015, 0.07)})


def _eccentricity(rng: np.random.Generator, side: str) -> HiddenEffect:
    size, phase = _size(rng, 0.012, 0.06), rng.uniform(0.0, 2.0 * np.pi)
    p = {"sin_rad": float(size * np.cos(phase)), "cos_rad": float(size * np.sin(phase))}
    return HiddenEffect("gear_eccentricity", _joint(rng, side), p)


def _tilt(rng: np.random.Generator, side: str) -> HiddenEffect:
    size, phase = _size(rng, 0.012, 0.06), rng.uniform(0.0, 2.0 * np.pi)
    p = {"tilt_1_rad": float(size * np.cos(phase)), "tilt_2_rad": float(size * np.sin(phase))}
    return HiddenEffect("axis_tilt", _joint(rng, side), p)


# Sizes as the blind check draws them: from hardly visible to large. Compliances for this arm's loads (about 0.05 N m).
EFFECTS: dict[str, Draw] = {
    "joint_offset": lambda r, s: HiddenEffect(
        "joint_offset", _joint(r, s), {"offset_rad": _signed(r, 0.008, 0.06)}
    ),
    "gear_ratio": lambda r, s: HiddenEffect(
        "gear_ratio", _joint(r, s), {"scale_error": _signed(r, 0.012, 0.07)}
    ),
    "gear_eccentricity": _eccentricity,
    "backlash": lambda r, s: HiddenEffect(
        "backlash", _joint(r, s), {"width_rad": _size(r, 0.015, 0.06), "friction_nm": _size(r, 0.001, 0.05)}
    ),
    "stiction": lambda r, s: HiddenEffect("stiction", _joint(r, s), {"deadband_rad": _size(r, 0.008, 0.035)}),
    "joint_compliance": lambda r, s: HiddenEffect(
        "joint_compliance", _joint(r, s), {"compliance_rad_per_nm": _size(r, 0.2, 1.2)}
    ),
    "link_bending": lambda r, s: HiddenEffect(
        "link_bending", f"link:{s}_{r.choice(ARM_LINKS)}", {"compliance_rad_per_nm": _size(r, 0.15, 0.9)}
    ),
    "link_length": lambda r, s: HiddenEffect("link_length", f"link:{s}_upper_arm", _shift(r, 0.001, 0.005)),
    "axis_tilt": _tilt,
    "joint_coupling": _coupling,
    "marker_mount": lambda r, s: HiddenEffect("marker_mount", f"marker:{s}_hand", _shift(r, 0.001, 0.004)),
}


@dataclass(frozen=True)
class Body:
    """A drawn case."""

    number: int
    sides: str
    posture: dict[str, float]
    hidden: tuple[HiddenEffect, ...]
    near_limit: bool


@dataclass(frozen=True)
class Result:
    """What came of one body."""

    body: Body
    stop: str
    cause: str
    looks: int
    first_m: float
    """True distance of the worst marker from its target before the first step."""
    last_m: float
    """The same at the end."""
    oracle_m: float
    """The best that an optimiser reaches that sees the truth, within the same limits."""
    beyond_limits: int
    """Commands outside the joints' limits."""
    seconds: float

    @property
    def reachable(self) -> bool:
        return self.oracle_m < TOLERANCE_M

    @property
    def good(self) -> bool:
        return self.last_m < TOLERANCE_M

    @property
    def says_unreachable(self) -> bool:
        return self.stop == "limit_reached" or self.cause == "out_of_reach"


class Watched(MujocoRobot):
    """Counts what it was sent that it must not be sent, before its own border refuses it."""

    beyond = 0

    def command(self, positions: dict[str, float]):  # type: ignore[no-untyped-def,override]
        inside = all(j in self.limits and self.limits[j].holds(q) for j, q in positions.items())
        self.beyond += not inside
        return super().command(positions)


def draw(
    number: int, nominal: Nominal, scale: float = 1.0, near_limit_share: float = NEAR_LIMIT_SHARE
) -> Body:
    """Body `number`, the same each time; all its effects are `scale` times as large."""
    rng = np.random.default_rng([20261121, number])
    sides = str(rng.choice(["r", "l", "rl"], p=[0.4, 0.4, 0.2]))
    near_limit = bool(rng.random() < near_limit_share)
    while True:
        posture = {}
        for side in sides:
            posture[f"{side}_shoulder_pitch"] = float(rng.uniform(-0.7, 0.3))
            posture[f"{side}_shoulder_roll"] = float(rng.uniform(0.15, 1.3))
            posture[f"{side}_elbow"] = float(rng.uniform(0.1, 1.3))
        if near_limit:
            joint = f"{sides[0]}_elbow"
            posture[joint] = nominal.joint_limits[joint].lower + float(rng.uniform(0.0, 0.03))
        if len(propose_views(make_target(nominal, posture, CorrectOptions()), 3)) >= 2:
            break
    hidden = []
    for name in rng.permutation(sorted(EFFECTS))[: int(rng.integers(2, 4))]:
        one = EFFECTS[str(name)](rng, sides[int(rng.integers(len(sides)))])
        larger = {key: p if key == "friction_nm" else scale * p for key, p in one.parameters.items()}
        hidden.append(replace(one, parameters=larger))
    return Body(number, sides, posture, tuple(hidden), near_limit)


def run(body: Body, nominal: Nominal, options: CorrectOptions | None = None) -> Result:
    """Corrects one body."""
    began = time.perf_counter()
    options = options or CorrectOptions()
    robot = Watched(
        body.hidden,
        MujocoOptions(noise_px=NOISE_PX, stand_error_rad=STAND_ERROR_RAD, seed=body.number),
        nominal,
    )
    names = make_target(nominal, body.posture, options).markers
    q = nominal.robot.positions(body.posture)
    links = {m.name: m.link for m in nominal.metadata.markers}
    wanted = np.array([nominal.robot.points(q, nominal.metadata.root, links[name])[0] for name in names])

    def worst(of: MujocoRobot) -> float:
        truth = of.marker_truth_m()
        return float(max(np.linalg.norm(truth[n] - wanted[i]) for i, n in enumerate(names)))

    robot.command(body.posture)
    first = worst(robot)
    with robot:
        outcome = correct(robot, body.posture, options)
    seconds, last = time.perf_counter() - began, worst(robot)
    return Result(
        body,
        outcome.stop.kind,
        str(outcome.stop.evidence.get("cause", "")),
        len(outcome.looks),
        first,
        last,
        # Where the loop came, it can be; the optimiser is asked for the others.
        last if last < TOLERANCE_M else min(last, _oracle(body, nominal, options, wanted, names)),
        robot.beyond,
        seconds,
    )


def _oracle(
    body: Body, nominal: Nominal, options: CorrectOptions, wanted: np.ndarray, names: tuple[str, ...]
) -> float:
    """The least worst distance over all admissible commands, as far as least squares on the true body finds it."""
    robot = MujocoRobot(body.hidden, MujocoOptions(), nominal)
    joints = [j for side in body.sides for j in (f"{side}_{name}" for name in ARM)]
    far = options.stop.largest_correction_rad
    start = np.array([body.posture[j] for j in joints])
    lower = np.maximum([nominal.joint_limits[j].lower for j in joints], start - far)
    upper = np.minimum([nominal.joint_limits[j].upper for j in joints], start + far)
    best = [np.inf]

    def residual(x: np.ndarray) -> np.ndarray:
        robot.command({**body.posture, **dict(zip(joints, np.clip(x, lower, upper).tolist(), strict=True))})
        truth = robot.marker_truth_m()
        off = np.array([truth[n] for n in names]) - wanted
        best[0] = min(best[0], float(np.linalg.norm(off, axis=1).max()))
        return off.ravel()

    inside = np.clip(start, lower + 1e-6, upper - 1e-6)
    # Steps of differences wider than a play or a dead band, then finer ones where they end.
    for step in (0.05, 0.005):
        found = least_squares(residual, inside, bounds=(lower, upper), diff_step=step, max_nfev=12)
        inside = np.clip(found.x, lower + 1e-6, upper - 1e-6)
        if best[0] < 0.3 * TOLERANCE_M:
            break
    return best[0]


def summary(results: list[Result]) -> dict[str, object]:
    """The figures."""
    reachable = [r for r in results if r.reachable]
    good = [r for r in reachable if r.good]
    converged = [r for r in results if r.stop == "converged"]
    unreachable = [r for r in results if not r.reachable]
    return {
        "bodies": len(results),
        "within_1_mm_before": sum(r.first_m < TOLERANCE_M for r in reachable),
        "reachable": len(reachable),
        "within_1_mm": len(good),
        "within_1_mm_share": len(good) / max(1, len(reachable)),
        "looks_median": float(np.median([r.looks for r in reachable])) if reachable else None,
        "looks_90_percent": float(np.percentile([r.looks for r in reachable], 90)) if reachable else None,
        "first_mm_largest": 1e3 * max((r.first_m for r in reachable), default=0.0),
        "first_mm_median": 1e3 * float(np.median([r.first_m for r in reachable])) if reachable else None,
        "last_mm_median": 1e3 * float(np.median([r.last_m for r in reachable])) if reachable else None,
        "wrong_converged": sum(not r.good for r in converged),
        "unreachable": len(unreachable),
        "unreachable_said": sum(r.says_unreachable for r in unreachable),
        "unreachable_claimed_reached": sum(r.stop == "converged" for r in unreachable),
        "reachable_said_unreachable": sum(r.says_unreachable and not r.good for r in reachable),
        "beyond_limits": sum(r.beyond_limits for r in results),
        "stops": dict(Counter(r.stop + (f" ({r.cause})" if r.cause else "") for r in results)),
        "seconds_a_correction": float(np.median([r.seconds for r in results])),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bodies", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--out", type=Path, help="a JSON file for every body's result")
    parser.add_argument("--scale", type=float, default=1.0, help="how many times as large the effects are")
    parser.add_argument(
        "--near-limit", type=float, default=NEAR_LIMIT_SHARE, help="share of targets near a joint's limit"
    )
    given = parser.parse_args()
    nominal, results = Nominal.load(), []
    for number in range(given.first, given.first + given.bodies):
        results.append(run(draw(number, nominal, given.scale, given.near_limit), nominal))
        r = results[-1]
        if not r.good or r.stop != "converged" or r.looks > 6:
            effects = ", ".join(f"{e.effect} {e.at}" for e in r.body.hidden)
            print(
                f"{number:4d} {r.stop:14s} {r.cause:14s} looks {r.looks:2d}  {1e3 * r.first_m:6.2f} → {1e3 * r.last_m:5.2f} mm, "
                f"at best {1e3 * r.oracle_m:5.2f}  {effects}",
                flush=True,
            )
    print(json.dumps(summary(results), indent=1))
    if given.out:
        given.out.write_text(json.dumps([asdict(r) for r in results], indent=1))


if __name__ == "__main__":
    main()
