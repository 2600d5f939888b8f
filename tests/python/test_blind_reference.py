"""What identifiability is judged with: first-order columns against central differences of the exact model."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="blind sessions need MuJoCo")

from mirror_lab.blind.fitting import fit, screen
from mirror_lab.blind.hypotheses import all_hypotheses
from mirror_lab.blind.kinematics import Change
from mirror_lab.blind.linear import Linear
from mirror_lab.blind.reference import Reference, reference_of
from mirror_lab.blind.simulate import Case, Options, simulate


@pytest.fixture(scope="module")
def case() -> Case:
    options = Options(frames=(60, 61), simple_laws=True)
    return simulate("case", "small", ["joint_compliance"], np.random.default_rng(3), options)


@pytest.fixture(scope="module")
def ref(case: Case) -> Reference:
    return reference_of(case)


def test_first_order_columns_are_the_derivative_of_the_exact_model(case: Case, ref: Reference) -> None:
    """About a robot that already yields, turns and whose camera is off; every hypothesis of the vocabulary."""
    everything = all_hypotheses(case.robot, case.plan.commands, case.gravity)
    planes = case.mirror.normal * case.mirror.distance_m[:, None]
    base = Change()
    base.add_joint("r_elbow", np.full(len(case.plan.commands.q_rad), 0.02))
    base.camera_turn_rad, base.camera_shift_m = np.array([0.01, -0.005, 0.002]), np.array([1e-3, 0, -1e-3])
    linear = Linear(ref, base, planes)
    seen: set[str] = set()
    for h in everything:
        if h.effect in ("backlash", "stiction"):
            continue  # not smooth in their width: their columns are secants by intent
        seen.add(h.effect)
        for k, step in enumerate(h.steps):
            p = np.zeros(len(h.steps))
            p[k] = 0.1 * step
            plus, minus = base.copy(), base.copy()
            h.apply(plus, p)
            h.apply(minus, -p)
            exact = (
                ref.residual(ref.points(plus), planes, plus) - ref.residual(ref.points(minus), planes, minus)
            ) / (0.2 * step)
            got = linear.column(plus, True) / (0.1 * step)
            np.testing.assert_allclose(got, exact, atol=2e-3 * np.abs(exact).max() + 1e-9, err_msg=h.name)
    assert len(seen) == 17


def test_the_truth_fits_and_is_screened_first(case: Case, ref: Reference) -> None:
    (cause,) = case.answer["causes"]
    name = f"{cause['effect']}@{cause['at']}"
    everything = all_hypotheses(case.robot, case.plan.commands, case.gravity)
    empty = fit(ref, [], case.mirror.normal * case.mirror.distance_m[:, None])
    ranked = screen(ref, empty, everything)[0]
    assert name in {h.name for _, h in ranked[:3]}
    own = fit(ref, [next(h for h in everything if h.name == name)], empty.planes)
    assert own.chi2 < 1e-3 * empty.chi2
    assert own.parameters[0][0] == pytest.approx(cause["compliance_rad_per_nm"], rel=0.01)
