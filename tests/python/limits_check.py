"""Whether the limits of a diagnosis are true: causes are put in at 0.5, 1 and 2 times their limit, and counted where they are told.

    python tests/python/limits_check.py --sessions 20 --seed 5 [--by-hand]

Each session is simulated without a cause by the blind check's own bodies, mirrors and noise, which share nothing with the diagnosis, and
diagnosed: that gives the limits. Then the same session is simulated again (same robot, postures, mirrors and noise) with one cause
at a drawn place, of a drawn multiple of its limit, and diagnosed. A cause counts as *named* where effect and place are among the causes,
as *told* where they are among the causes or their alternatives, and as *seen* where anything but the set-up is told at all. What is claimed:
of 1 times the limit 95 % would be told, of 2 times practically all; of half, hardly any need be.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import mirror_posture as mp
from mirror_lab.blind.effects import VOCABULARY, Scene
from mirror_lab.blind.errors import NoPlaceError
from mirror_lab.blind.simulate import Options, simulate
from mirror_lab.blind.truth import Commands, Truth
from mirror_lab.blind.write import write_session

MULTIPLES = (0.5, 1.0, 2.0)
SETUP = {"board_mount", "camera_mount", "marker_mount", "geometry"}
Put = Callable[[Scene, Truth, str, dict[str, float]], None]


def _angle(law: Callable[[dict[str, float], Commands, str], np.ndarray]) -> Put:
    def put(scene: Scene, truth: Truth, at: str, p: dict[str, float]) -> None:
        joint = at.removeprefix("joint:").split("<-")[0]
        truth.servo.append((joint, lambda c: law(p, c, at)))

    return put


def _marker(scene: Scene, truth: Truth, at: str, p: dict[str, float]) -> None:
    body = scene.robot.index[f"{at.removeprefix('marker:')}_marker"]
    truth.origin_shift_m[body] = np.array([p.get(f"d{k}_m", 0.0) for k in "xyz"])


def _length(scene: Scene, truth: Truth, at: str, p: dict[str, float]) -> None:
    following = scene.robot.next_body(scene.robot.index[at.removeprefix("link:")])
    if following is None:
        raise NoPlaceError(at)
    truth.origin_shift_m[following] = np.array([p.get(f"d{k}_m", 0.0) for k in "xyz"])


def _set(name: str, parameter: str) -> Put:
    return lambda scene, truth, at, p: setattr(truth, name, p[parameter])


PUT: dict[str, Put] = {
    "joint_offset": _angle(lambda p, c, at: np.full(len(c.q_rad), p["offset_rad"])),
    "gear_ratio": _angle(lambda p, c, at: p["scale_error"] * c.of(at.removeprefix("joint:"))),
    "drift": _angle(lambda p, c, at: p["rate_rad_per_s"] * c.time_s),
    "joint_coupling": _angle(lambda p, c, at: p["coupling"] * c.of(at.split("<-joint:")[1])),
    "gear_eccentricity": _angle(
        lambda p, c, at: (
            p.get("sin_rad", 0.0) * np.sin(c.of(at.removeprefix("joint:")))
            + p.get("cos_rad", 0.0) * (np.cos(c.of(at.removeprefix("joint:"))) - 1)
        )
    ),
    "marker_mount": _marker,
    "link_length": _length,
    "camera_focal": _set("focal_scale", "scale_error"),
    "board_scale": _set("board_scale", "scale_error"),
    "mirror_curvature": lambda scene, truth, at, p: setattr(
        truth, "curvature_per_m", np.full(2, p["curvature_per_m"])
    ),
}
"""Effects whose law is the vocabulary's in the simulated body as well, and what changes the true machine."""
NOT_BY_HAND = {"marker_mount", "joint_offset"}
"""Of a hand-made set-up these are a part, told as such."""


@dataclass
class Trial:
    effect: str
    at: str
    multiple: float
    named: bool
    told: bool
    seen: bool


def trials(seed: int, options: Options, each: int = 1, multiples: Sequence[float] = MULTIPLES) -> list[Trial]:
    """One session's limits, and for each multiple `each` causes put in at it."""
    rng = np.random.default_rng([seed, 1])
    kind = str(rng.choice(list(options.robots)))
    with tempfile.TemporaryDirectory() as folder:
        empty = _diagnosed([], kind, seed, options, Path(folder) / "empty")
        usable = [
            limit
            for limit in empty["limits"]
            if limit["effect"] in PUT and not (options.by_hand and limit["effect"] in NOT_BY_HAND)
        ]
        effects = sorted({limit["effect"] for limit in usable})
        out = []
        for multiple in multiples:
            for k in range(each):
                effect = str(rng.choice(effects))
                mine = [
                    (x, n, size)
                    for x in usable
                    if x["effect"] == effect
                    for n, size in x["parameters"].items()
                    if size is not None and size < LARGEST.get(n, np.inf)
                ]
                if not mine:
                    continue
                limit, name, size = mine[int(rng.integers(len(mine)))]
                value = multiple * size * float(rng.choice([-1.0, 1.0]))
                at = str(limit["at"])

                def put(_: Any, scene: Scene, truth: Truth) -> dict[str, Any]:
                    PUT[effect](scene, truth, at, {name: value})  # noqa: B023
                    return {"effect": effect, "at": at}  # noqa: B023

                VOCABULARY["put_in"] = put
                try:
                    said = _diagnosed(["put_in"], kind, seed, options, Path(folder) / f"{multiple}-{k}")
                except NoPlaceError:
                    continue
                finally:
                    del VOCABULARY["put_in"]
                out.append(_trial(said, effect, at, multiple))
    return out


LARGEST = {"offset_rad": 0.1, "dx_m": 0.02, "dy_m": 0.02, "dz_m": 0.02}
"""Beyond these no law is linear, and a limit is not a figure to be checked."""


def _trial(said: dict[str, Any], effect: str, at: str, multiple: float) -> Trial:
    names = {(c["effect"], c["at"]) for c in said["causes"]}
    rivals = {(a["effect"], a["at"]) for c in said["causes"] for a in c["alternatives"]}
    seen = said["verdict"] in ("partial", "unknown") or any(c["effect"] not in SETUP for c in said["causes"])
    own = (effect, at)
    return Trial(effect, at, multiple, own in names, own in names | rivals, seen or own in names)


def _diagnosed(draws: list[str], kind: str, seed: int, options: Options, folder: Path) -> dict[str, Any]:
    """The same seed makes the same session, whatever is put in: a cause that is put in draws no random number."""
    case = simulate("case", kind, draws, np.random.default_rng(seed), options)
    document = mp.diagnose(write_session(case, folder)).document
    return json.loads(json.dumps(document))


def shares(done: list[Trial]) -> dict[float, dict[str, tuple[int, int]]]:
    """By multiple: how many were named, told and seen, of how many."""
    return {
        m: {
            what: (sum(getattr(t, what) for t in done if t.multiple == m), sum(t.multiple == m for t in done))
            for what in ("named", "told", "seen")
        }
        for m in MULTIPLES
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--each", type=int, default=1, help="causes at each multiple of each session")
    parser.add_argument("--by-hand", action="store_true")
    asked = parser.parse_args()
    options = Options(
        robots=("small", "random", "ur10"),
        frames=(90, 130),
        plain_noise=True,
        simple_laws=True,
        by_hand=asked.by_hand,
    )
    done: list[Trial] = []
    for k in range(asked.sessions):
        done += trials(1000 * asked.seed + k, options, asked.each)
        print(k + 1, shares(done), flush=True)
    for t in done:
        if t.multiple >= 1.0 and not t.told:
            print("not told:", t)


if __name__ == "__main__":
    main()
