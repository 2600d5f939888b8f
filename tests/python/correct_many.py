"""Corrections of a G1 and an SO-101 to targets drawn at random, in the twin and in MuJoCo, each with a wrong zero at two joints.

    python tests/python/correct_many.py [COUNT] [--plan]

With --plan the targets are postures of a plan of each robot, and the viewpoints the plan's; else proposed ones. Of each it prints the stop, and the farthest marker before and after. An end that is neither within 1 mm nor a refusal
with its reason is a failure.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from mirror_lab.robots import HiddenEffect, TwinOptions, TwinRobot
from mirror_lab.robots.mujoco import MujocoOptions, MujocoRobot
from mirror_posture import MirrorPostureError
from mirror_posture.correct import CorrectOptions, correct, make_target, views_of_plan
from mirror_posture.plan import PlanOptions, make_plan, read_plan, write_plan
from test_correct_real_bodies import BODIES, mounted

SPREAD_RAD, HIDDEN_RAD = 0.25, 0.05


def one(name: str, simulated: str, seed: int, plan: Path | None) -> str:
    """Runs one correction; returns what came of it."""
    random = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        nominal = mounted(name, Path(folder))
        _, root, _, posture, _ = BODIES[name]
        limits = nominal.joint_limits
        found = None
        if plan is None:
            posture = {
                joint: float(
                    np.clip(
                        q + random.uniform(-SPREAD_RAD, SPREAD_RAD),
                        limits[joint].lower + 0.1,
                        limits[joint].upper - 0.1,
                    )
                )
                for joint, q in posture.items()
            }
        else:
            # The viewpoints ask for the hand; a plan's posture may have been taken for the forearm alone.
            for row in random.permutation(read_plan(plan / "postures.csv", nominal.robot)):
                try:
                    found = views_of_plan(make_target(nominal, row.commanded, CorrectOptions()), plan, {})
                except MirrorPostureError:
                    continue
                posture = row.commanded
                break
            else:
                return "refused: no posture of the plan shows the hand in two viewpoints"
        wrong = random.choice(sorted(posture), 2, replace=False)
        hidden = [
            HiddenEffect(
                "joint_offset",
                f"joint:{joint}",
                {"offset_rad": float(random.uniform(0.2, 1.0) * HIDDEN_RAD * random.choice([-1, 1]))},
            )
            for joint in wrong
        ]
        robot: TwinRobot | MujocoRobot
        if simulated == "twin":
            robot = TwinRobot(hidden, TwinOptions(pictures=False, seed=seed), nominal)
        else:
            robot = MujocoRobot(hidden, MujocoOptions(way="pixels", seed=seed), nominal)
        q = nominal.robot.positions(posture)
        with robot:
            try:
                target = make_target(nominal, posture, CorrectOptions())
                options = CorrectOptions()
                if found is not None:
                    options = CorrectOptions(views=found.usual, further_views=found.further)
                outcome = correct(robot, posture, options)
            except MirrorPostureError as error:
                return f"refused: {' '.join(str(error).split())[:160]}"
            truth = robot.marker_truth_m()
            robot.command(posture)
            uncorrected = robot.marker_truth_m()
        wanted = {
            m: nominal.robot.points(q, root, link)[0]
            for m, link in zip(target.markers, target.marker_links, strict=True)
        }
        before, after = (
            max(float(np.linalg.norm(now[m] - wanted[m])) for m in wanted) for now in (uncorrected, truth)
        )
        told = "converged" if outcome.converged else f"stopped: {outcome.stop.sentence}"
        if outcome.converged and after > 1e-3:
            told = "WRONG: " + told
        return f"{len(outcome.looks)} looks, {1e3 * before:.1f} -> {1e3 * after:.2f} mm, {told}"


def main() -> None:
    """Prints a line for each correction."""
    words = [word for word in sys.argv[1:] if word != "--plan"]
    count = int(words[0]) if words else 5
    for name in BODIES:
        with tempfile.TemporaryDirectory() as folder:
            plan = None
            if "--plan" in sys.argv:
                plan = Path(folder) / "plan"
                mounted(name, Path(folder))
                made = make_plan(folder, PlanOptions(postures=24))
                write_plan(made, plan)
                print(
                    f"{name}: {len(made.mirrors)} viewpoints, the mirror {made.distance_m:.2f} m before the board"
                )
            for simulated in ("twin", "mujoco"):
                for seed in range(count):
                    print(f"{name} {simulated} {seed}: {one(name, simulated, seed, plan)}", flush=True)


if __name__ == "__main__":
    main()
