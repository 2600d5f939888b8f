"""The judge of moving sessions against closed forms, and its score on diagnoses that are known."""

from __future__ import annotations

import ast
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco")
pytest.importorskip("pinocchio")
pytest.importorskip("mirror_lab")

from mirror_lab.blind.seal import seal
from mirror_lab.moving import engine, score, shows
from mirror_lab.moving.engine import Engine, Servos

WHEEL = """<robot name="wheel"><link name="post"/><link name="wheel"><inertial><origin xyz="0 0 0"/><mass value="1"/>
<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hub" type="continuous"><parent link="post"/><child link="wheel"/><axis xyz="0 0 1"/></joint></robot>"""
STIFFNESS, DAMPING, SPEED = 40.0, 1.5, 0.8


def _behind(**changes: float) -> float:
    """How far a wheel on a servo stays behind a ramp, once steady, rad."""
    servos = Servos.ideal(np.array([STIFFNESS]), np.array([DAMPING]), np.array([0.005]))
    for name, value in changes.items():
        getattr(servos, name)[:] = value
    time = np.array([0.0, 1.2])
    track = Engine(WHEEL, ["hub"], np.array([0.0, 0.0, -9.81])).run(time, SPEED * time[:, None], servos)
    return float(SPEED * 1.15 - track.at(np.array([1.15]))[0, 0])


def test_a_ramp_leaves_what_its_law_says() -> None:
    # q falls behind by (d q̇ + F) / k, by T q̇ behind a filter, and by what a speed limit costs since the start.
    assert np.isclose(_behind(), DAMPING * SPEED / STIFFNESS, rtol=2e-3)
    assert np.isclose(_behind(viscous=0.5), (DAMPING + 0.5) * SPEED / STIFFNESS, rtol=2e-3)
    assert np.isclose(_behind(friction=0.3), (DAMPING * SPEED + 0.3) / STIFFNESS, rtol=2e-3)
    assert np.isclose(_behind(lag_s=0.04), SPEED * (DAMPING / STIFFNESS + 0.04), rtol=3e-4)
    limited = DAMPING * 0.5 / STIFFNESS + (SPEED - 0.5) * 1.15
    assert np.isclose(_behind(velocity_limit=0.5), limited, rtol=2e-3)


def test_where_sessions_are_made_nothing_of_the_product_is_imported() -> None:
    folder = Path(engine.__file__).parent
    for name in ("engine", "causes", "make", "shows", "write", "score"):
        tree = ast.parse((folder / f"{name}.py").read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            modules = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            modules += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not any("mirror_posture" in module for module in modules), name


def _case(
    folder: Path,
    number: int,
    truth: list[dict[str, Any]],
    told: list[dict[str, Any]],
    after_m: float = 0.001,
    limits: list[dict[str, Any]] | None = None,
) -> None:
    name = f"case-{number:04d}"
    (folder / name).mkdir(parents=True)
    seal({"id": name, "causes": truth}, folder / "answers" / f"{name}.json", folder / name / "seal.json")
    gap = {"noise_floor_m": 0.001, "checked": [{"session": "u", "before_m": 0.01, "after_m": after_m}]}
    out = folder / "results" / name
    out.mkdir(parents=True)
    (out / "diagnosis.json").write_text(json.dumps({"causes": told, "gap": gap, "limits": limits or []}))


def test_the_score_counts_what_is_right_and_what_is_not(tmp_path: Path) -> None:
    def told(
        effect: str, at: str, beside: list[dict[str, Any]] | None = None, **values: float
    ) -> dict[str, Any]:
        parameters = {name: {"value": value, "std": 0.001} for name, value in values.items()}
        return {
            "effect": effect, "at": at, "probability": 0.6, "parameters": parameters, "alternatives": beside or [],
        }  # fmt: skip

    late = {"effect": "latency", "at": "camera", "latency_s": 0.020}
    rub = {"effect": "coulomb_friction", "at": "joint:a", "friction_nm": 1.0}
    _case(tmp_path, 0, [late], [told("latency", "camera", latency_s=0.021)])
    _case(tmp_path, 1, [late], [told("servo_lag", "joint:a", [{"effect": "latency", "at": "camera"}])], 0.002)
    _case(tmp_path, 2, [], [])
    _case(tmp_path, 3, [], [told("servo_lag", "joint:b")])
    _case(
        tmp_path,
        4,
        [late, rub],
        [told("coulomb_friction", "joint:a", friction_nm=1.3), told("backlash", "joint:a")],
    )
    hides = [{"effect": "coulomb_friction", "at": "joint:a", "parameters": {"friction_nm": 1.2}}]
    _case(tmp_path, 5, [rub], [], limits=hides)
    _case(tmp_path, 6, [{**rub, "friction_nm": 1.3}], [], limits=hides)
    # Named in vain, the true one beside it: with real odds, and with next to none.
    for number, odds in ((7, 0.3), (8, 0.03)):
        beside = [{"effect": "latency", "at": "camera", "probability": odds}]
        named = [told("coulomb_friction", "joint:a"), told("servo_lag", "joint:b", beside)]
        _case(tmp_path, number, [{**late, "rivals": ["servo_lag@joint:b"]}, rub], named)
    found = score.score(tmp_path, tmp_path / "results")
    assert found.several_found[2:] == [False, True] * 2 and found.several_told[2:] == [
        True,
        True,
        False,
        True,
    ]
    assert found.several_invented[2:] == [False, True] * 2
    assert found.several_denied[2:] == [False, False, False, True]
    assert found.several_identifiable_found[2:] == [True, True]
    assert sorted(right for _, right in found.named) == [False] * 5 + [True] * 4
    assert found.singles == [True, False, False, False]
    assert found.singles_or_named_beside == [True, True, False, False]
    # One of them was smaller than what the diagnosis says the motion hides.
    assert found.singles_shown == [True, False, False]
    assert sorted(found.empty_alarmed) == [False, True]
    assert sorted(found.several_found[:2]) == [False, True]
    assert sorted(found.several_invented[:2]) == [False, True]
    assert found.within == {"latency": [True], "friction": [False]} and found.covered == [True, False]
    assert [ratio <= 1.2 for ratio in found.unseen].count(False) == 1
    assert ("one cause: found with its place", "1 of 4", "25 %") in found.rows()


def test_a_play_whose_load_never_turns_is_a_wrong_zero_to_the_judge() -> None:
    time = np.linspace(0.0, 6.0, 180)
    position, px_per_rad = 0.6 * np.sin(2.0 * time), np.full((180, 2, 2), 150.0)
    for load, rivals in ((1.0 + 0.2 * np.cos(time), ["joint_offset@joint:a"]), (np.cos(time), [])):
        bent = shows.Bent(position, load, np.sign(load), px_per_rad)
        play = {"effect": "backlash", "at": "joint:a"}
        assert shows.rivals_of(play, 0.015 * bent.side, bent, 0.2) == rivals
    # A zero of the other sign no play makes; one below the noise anything does.
    bent = shows.Bent(position, 1.0 + 0.2 * np.cos(time), np.ones(180), px_per_rad)
    zero = {"effect": "joint_offset", "at": "joint:a"}
    assert shows.rivals_of(zero, np.full(180, -0.02), bent, 0.2) == []
    assert len(shows.rivals_of(zero, np.full(180, 1e-5), bent, 0.2)) == 3
