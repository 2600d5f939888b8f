"""A second encoder as witness: the fit never sees it, and the right cause predicts it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the session comes from the blind simulator")

from typer.testing import CliRunner

from mirror_lab.blind.body import Body
from mirror_lab.blind.simulate import Options, simulate
from mirror_lab.blind.write import write_session
from mirror_posture.cli.app import app
from mirror_posture.diagnosis import diagnose


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A joint with a wrong gear ratio, and an encoder at its output and at another joint; noise of 1 mrad, zero off by 5 mrad."""
    options = Options(frames=(120, 121), plain_noise=True)
    case = simulate("case", "small", ["gear_ratio"], np.random.default_rng(21), options)
    joint = case.answer["causes"][0]["at"].removeprefix("joint:")
    poses = Body(case.robot, case.truth, case.gravity).run(case.plan.commands)
    folder = write_session(case, tmp_path_factory.mktemp("encoder") / "case")
    other = next(j for j in case.robot.commanded if j != joint and np.ptp(case.plan.commands.of(j)) > 0.1)
    rng = np.random.default_rng(0)
    lines = (folder / "frames.csv").read_text(encoding="utf-8").splitlines()
    read = [
        poses.theta_rad[case.plan.posture_of_frame, case.robot.commanded.index(j)]
        + rng.normal(0.005, 1e-3, len(case.plan.posture_of_frame))
        for j in (joint, other)
    ]
    lines = [lines[0] + f",measured:{joint},measured:{other}"] + [
        f"{line},{a:.6f},{b:.6f}" for line, a, b in zip(lines[1:], *read, strict=True)
    ]
    (folder / "frames.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder, joint


def test_the_named_cause_predicts_the_encoder_that_no_fit_saw(session: tuple[Path, str]) -> None:
    folder, joint = session
    found = diagnose(folder)
    assert [c.at for c in found.causes] == [f"joint:{joint}"]
    there, elsewhere = found.document["encoder_witness"]
    assert there["joint"] == joint and there["named"] and not elsewhere["named"]
    assert there["after_zero_free"] < 0.3 * there["before_zero_free"]
    assert there["after_zero_free"] == pytest.approx(1e-3, rel=0.5)
    # Where nothing is named the prediction is the command: noise and the encoder's zero are left.
    assert elsewhere["before"] == elsewhere["after"] == pytest.approx(np.hypot(5e-3, 1e-3), rel=0.15)


def test_the_command_shows_the_witness(session: tuple[Path, str]) -> None:
    done = CliRunner().invoke(app, ["diagnose", str(session[0])])
    assert done.exit_code == 0 and "Encoders that took no part in the fit" in done.output


def test_encoders_that_read_what_is_predicted_are_no_rows() -> None:
    from mirror_posture.diagnosis.formatting import ENCODER_COLUMNS, telling_encoders

    still = {"joint": "a"} | dict.fromkeys(ENCODER_COLUMNS, 4e-6)
    told = still | {"joint": "b", "after_zero_free": 6e-6}
    assert telling_encoders([still, told]) == [told]


def test_errors_of_all_causes_at_a_joint_are_predicted_together_and_what_is_unexplained_predicts_nothing() -> (
    None
):
    from types import SimpleNamespace
    from typing import Any

    from mirror_posture.diagnosis.encoders import encoder_witness

    q = np.array([0.0, 0.2, 0.4, 0.6])
    frames = SimpleNamespace(
        frame=np.array([3, 5, 7, 9]), posture=np.arange(4), joint_names=("a", "b"), commanded=np.stack([q, q], axis=1),
        measured_names=("a", "b"), measured=np.stack([q + 0.03, q + 0.01], axis=1),
    )  # fmt: skip
    session: Any = SimpleNamespace(frames=frames)

    def signature(cause: int | None, at: str, fitted: float) -> dict[str, Any]:
        points = [{"frame": frame, "fitted": fitted} for frame in (3, 5, 7)]
        return {"cause": cause, "at": at, "points": points}

    both = [signature(0, "joint:a", 0.02), signature(1, "joint:a<-joint:b", 0.01)]
    document = {"signatures": [*both, signature(None, "joint:b", 0.01), signature(2, "link:c", 1.0)]}
    at_a, at_b = encoder_witness(session, document)
    assert at_a["named"] and at_a["before"] == pytest.approx(0.03) and at_a["after"] < 1e-12
    assert not at_b["named"] and at_b["before"] == at_b["after"] == pytest.approx(0.01)
