"""Own effects: a law that the vocabulary does not have, given as a function, is found at its joint and measured."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import mirror_posture as mp
from mirror_posture import MirrorPostureError
from mirror_posture.diagnosis import OwnEffect, PlaceQuantities
from mirror_posture.diagnosis.own_effects import Basis
from tracked_session import write_tracked

TRUE_PER_RAD = 0.06


def tracked(folder: Path, seed: int, *, wrong: bool = True) -> Path:
    """The elbow's cable gives way with both joints of the shoulder together."""

    def actual(q: dict[str, float]) -> dict[str, float]:
        stretch = TRUE_PER_RAD * q["r_shoulder_pitch"] * q["r_shoulder_roll"]
        return {**q, "r_elbow": q["r_elbow"] + stretch} if wrong else q

    return write_tracked(folder, seed, actual)


def product(at: PlaceQuantities) -> np.ndarray:
    return at.positions["r_shoulder_pitch"] * at.positions["r_shoulder_roll"]


def cable(at: str | tuple[str, ...] = "joint:*", basis: Basis = product) -> OwnEffect:
    return OwnEffect("cable", at, basis, ("stretch_per_rad",), (0.1,), words="the cable gives way")


def test_an_own_effect_explains_what_the_vocabulary_cannot(tmp_path: Path) -> None:
    session = mp.load_session(tracked(tmp_path / "session", 1))
    other = mp.load_session(tracked(tmp_path / "other", 2))
    without = mp.diagnose(session)
    assert without.verdict in ("partial", "unknown"), without.sentence
    found = mp.diagnose(session, effects=[cable()], check=[other])
    assert found.verdict == "explained", found.sentence
    (cause,) = found.causes
    # Tried at every joint, named at the one.
    assert (cause.effect, cause.at, cause.words) == ("cable", "joint:r_elbow", "the cable gives way")
    assert cause.probability > 0.9
    told = cause.parameters["stretch_per_rad"]
    assert abs(told.value - TRUE_PER_RAD) < 3.0 * told.std < 0.1 * TRUE_PER_RAD
    assert found.gap.after_m < 1.05 * found.gap.noise_floor_m < 0.5 * found.gap.before_m
    # Its basis is taken anew in the session on which it is checked.
    (checked,) = found.gap.checked
    assert checked.after_m < 0.5 * checked.before_m
    assert "cable at joint:r_elbow" in found.sentence


def test_an_own_effect_that_is_not_there_is_not_found(tmp_path: Path) -> None:
    session = tracked(tmp_path / "session", 3, wrong=False)
    assert mp.diagnose(session, effects=[cable()]).verdict == "none"


def test_a_basis_sees_what_the_diagnosis_sees(tmp_path: Path) -> None:
    session = mp.load_session(tracked(tmp_path / "session", 4))
    seen: dict[str, PlaceQuantities] = {}

    def look(at: PlaceQuantities) -> np.ndarray:
        seen[at.at] = at
        return product(at)

    shift = OwnEffect(
        "swing",
        "marker:*",
        lambda at: look(at)[:, None] * at.down,
        ("x_m", "y_m", "z_m"),
        (0.01,) * 3,
        ("x", "y", "z"),
    )
    turn = OwnEffect("twist", "link:r_forearm", look, ("twist_rad",), (0.02,), ("rx",))
    mp.diagnose(session, effects=[cable(("joint:r_elbow",), look), shift, turn])
    assert set(seen) == {"joint:r_elbow", "link:r_forearm", "marker:r_hand", "marker:r_forearm"}
    elbow = seen["joint:r_elbow"]
    column = list(session.frames.joint_names).index("r_elbow")
    np.testing.assert_allclose(elbow.position, session.frames.commanded[:, column])
    before = np.concatenate([[0.0], elbow.position[:-1]])
    np.testing.assert_array_equal(elbow.direction, np.sign(elbow.position - before))
    # The torque against the robot's own potential energy, by central differences.
    robot, step = session.robot, 1e-5
    index = list(robot.position_names).index("r_elbow")

    def energy(q: np.ndarray) -> np.ndarray:
        poses = robot.forward_kinematics(q)
        coms = np.einsum("nlij,lj->nli", poses[:, :, :3, :3], robot.core.coms_in_link_m) + poses[:, :, :3, 3]
        return 9.81 * np.einsum("l,nl->n", robot.core.masses_kg, coms[:, :, 2])

    nudge = step * np.eye(len(robot.position_names))[index]
    torque = -(energy(session.positions + nudge) - energy(session.positions - nudge)) / (2.0 * step)
    np.testing.assert_allclose(elbow.torque_nm, torque, atol=1e-7)
    np.testing.assert_allclose(np.linalg.norm(seen["marker:r_hand"].down, axis=1), 1.0)
    with pytest.raises(MirrorPostureError, match="no joint of its own"):
        _ = seen["marker:r_hand"].position
    with pytest.raises(MirrorPostureError, match="no mount"):
        _ = elbow.down


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: cable("joint:nobody"), "needed one of joint:r_shoulder_pitch"),
        (lambda: cable(basis=lambda at: np.ones(3)), r"shape \(3,\), needed \(90, 1\)"),
        (lambda: cable(basis=lambda at: product(at) / 0.0), "not finite in row 0"),
        (lambda: cable(basis=lambda at: 0.0 * product(at)), "is 0 in every frame"),
        (lambda: cable("joint:r_elbow", lambda at: 0.0 * product(at)), "not 0 in every frame"),
        (lambda: cable("marker:r_hand"), "x, y, z"),
        (lambda: cable(basis=lambda at: at.down[:, 0]), "told at markers"),
        (lambda: OwnEffect("backlash", "joint:r_elbow", product, ("a",), (0.1,)), "taken already"),
        (lambda: OwnEffect("cable", "joint:r_elbow", product, ("a",), (0.0,)), "above 0"),
        (lambda: OwnEffect("cable", "joint:r_elbow", product, ("a",), (0.1, 0.2)), "2 prior_std, needed 1"),
        (lambda: OwnEffect("cable", "link:r_forearm", product, ("a",), (0.1,), ("w",)), "needed one of x, y"),
    ],
)
def test_what_cannot_be_meant_is_refused(make: Callable[[], OwnEffect], message: str, tmp_path: Path) -> None:
    session = tracked(tmp_path / "session", 5)
    with np.errstate(all="ignore"), pytest.raises(MirrorPostureError, match=message):
        mp.diagnose(session, effects=[make()])
