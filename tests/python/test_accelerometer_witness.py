"""An accelerometer as witness: the fit never sees it, the right cause predicts it, and a wrong one does not.

What the sensors read comes from MuJoCo's own kinematics of the body as it really stands, turned by a mounting of 1° and
with noise; markers come from the blind check's simulator, or from the hidden bodies in NumPy.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="what the sensors read comes from MuJoCo")

import mujoco
from typer.testing import CliRunner

from mirror_lab.blind.body import Body
from mirror_lab.blind.simulate import Options, simulate
from mirror_lab.blind.write import write_session
from mirror_lab.robots.hidden import HiddenBody, HiddenEffect
from mirror_posture.cli.app import app
from mirror_posture.diagnosis import Cause, Diagnosis, Estimate, diagnose
from mirror_posture.diagnosis.accelerometers import accelerometer_witness
from mirror_posture.session import load_session
from tracked_session import JOINTS, write_tracked

NOISE_M_PER_S2 = 0.02
MOUNT_RAD = np.deg2rad(1.0)
NOISE_RAD = NOISE_M_PER_S2 / 9.81 * np.sqrt(2.0)
"""Two axes across the direction each have the noise; the one along it is of no account."""
LINKS = ("r_forearm", "l_forearm")


def readings(model: object, data: object, bodies: list[str], mount_about: np.ndarray) -> np.ndarray:
    """(bodies, 3): the specific force in each body's frame, by MuJoCo, as a sensor reads that is mounted askew."""
    mujoco.mj_kinematics(model, data)
    quaternion, mount = np.zeros(4), np.zeros(9)
    mujoco.mju_axisAngle2Quat(quaternion, mount_about / np.linalg.norm(mount_about), MOUNT_RAD)
    mujoco.mju_quat2Mat(mount, quaternion)
    up = -model.opt.gravity  # type: ignore[attr-defined]
    inside = [data.body(name).xmat.reshape(3, 3).T @ up for name in bodies]  # type: ignore[attr-defined]
    return np.array([mount.reshape(3, 3) @ force for force in inside])


def add_columns(folder: Path, force: Mapping[str, np.ndarray], seed: int = 0) -> Path:
    """Noise on the readings (F, 3) by link, and all of it into the frames table; every 9th frame was not read."""
    rng = np.random.default_rng(seed)
    header, *lines = (folder / "frames.csv").read_text(encoding="utf-8").splitlines()
    for link, values in force.items():
        header += "".join(f",accelerometer:{link}:{axis}" for axis in "xyz")
        noisy = values + rng.normal(0.0, NOISE_M_PER_S2, values.shape)
        lines = [
            line + (",,," if row % 9 == 4 else "".join(f",{v:.6f}" for v in noisy[row]))
            for row, line in enumerate(lines)
        ]
    (folder / "frames.csv").write_text("\n".join([header, *lines]) + "\n", encoding="utf-8")
    return folder


def tracked(
    folder: Path, actual: Callable[[dict[str, float]], dict[str, float]], truth_urdf: str | None = None
) -> Path:
    """The embedded robot's right arm, tracked; sensors on both forearms in the postures in which they really are."""
    write_tracked(folder, 7, actual, truth_urdf)
    spec = mujoco.MjSpec.from_string(truth_urdf or (folder / "robot.urdf").read_text(encoding="utf-8"))
    spec.compiler.fusestatic = False
    spec.compiler.boundmass, spec.compiler.boundinertia, spec.compiler.balanceinertia = 1e-4, 1e-8, True
    model = spec.compile()
    data = mujoco.MjData(model)
    table = np.genfromtxt(folder / "frames.csv", delimiter=",", names=True)
    force = []
    for row in table:
        for joint, position in actual({j: float(row[j]) for j in JOINTS}).items():
            data.joint(joint).qpos = position
        force.append(readings(model, data, list(LINKS), np.array([1.0, 2.0, -1.0])))
    return add_columns(folder, dict(zip(LINKS, np.stack(force, axis=1), strict=True)))


def elbow_off(q: dict[str, float]) -> dict[str, float]:
    return q | {"r_elbow": q["r_elbow"] + 0.06}


def roll_off(q: dict[str, float]) -> dict[str, float]:
    return q | {"r_shoulder_roll": q["r_shoulder_roll"] + 0.06}


def elbow_ratio(q: dict[str, float]) -> dict[str, float]:
    return q | {"r_elbow": 1.05 * q["r_elbow"]}


@pytest.mark.parametrize(
    "actual, effect, at",
    [
        (elbow_off, "joint_offset", "r_elbow"),
        (roll_off, "joint_offset", "r_shoulder_roll"),
        (elbow_ratio, "gear_ratio", "r_elbow"),
    ],
    ids=["elbow offset", "shoulder offset", "elbow ratio"],
)
def test_the_named_cause_predicts_the_accelerometer(
    actual: Callable[[dict[str, float]], dict[str, float]], effect: str, at: str, tmp_path: Path
) -> None:
    found = diagnose(tracked(tmp_path / "session", actual))
    assert [(c.effect, c.at) for c in found.causes] == [(effect, f"joint:{at}")]
    right, left = found.document["accelerometer_witness"]
    assert right["link"] == "r_forearm" and right["named"] and not left["named"]
    assert right["frames"] == 80  # of 90: every ninth was not read
    assert right["median_m_per_s2"] == pytest.approx(9.81, rel=2e-3)
    assert not [w for w in found.warnings if "accelerometer" in w]
    # As read, the mounting of 1° is left.
    assert right["before_rad"] > 0.03 and right["after_rad"] == pytest.approx(MOUNT_RAD, rel=0.25)
    assert right["after_mount_free_rad"] == pytest.approx(NOISE_RAD, rel=0.15)
    if (effect, at) == ("joint_offset", "r_elbow"):
        # The zero of the sensor's own joint turns the sensor by a constant, as its mounting does.
        assert right["before_mount_free_rad"] == pytest.approx(right["after_mount_free_rad"], rel=1e-9)
    else:
        assert right["before_mount_free_rad"] > 3.0 * right["after_mount_free_rad"]
    # The other arm hangs all the time, and nothing is named there.
    assert left["before_rad"] == left["after_rad"]
    assert left["before_mount_free_rad"] == left["after_mount_free_rad"] == pytest.approx(NOISE_RAD, rel=0.15)


def made_up(effect: str, at: str, **parameters: float) -> Diagnosis:
    """A diagnosis that nobody made, with one cause."""
    values = {name: Estimate(value, 1e-4) for name, value in parameters.items()}
    empty = Diagnosis.from_document(
        {
            "format": "mirror-posture/diagnosis", "version": 1, "verdict": "explained", "causes": [], "where": [],
            "gap": {"before_m": 1.0, "after_m": 1.0, "noise_floor_m": 1.0},
        }
    )  # fmt: skip
    return replace(empty, causes=(Cause(effect, at, 1.0, values),))


def test_a_wrong_cause_does_not_shrink_it(tmp_path: Path) -> None:
    session = load_session(tracked(tmp_path / "session", roll_off))

    def figures(at: str, offset_rad: float) -> dict[str, float]:
        found = made_up("joint_offset", f"joint:{at}", offset_rad=offset_rad)
        return accelerometer_witness(session, found).entries[0]

    right = figures("r_shoulder_roll", 0.06)
    assert right["after_rad"] < 0.5 * right["before_rad"]
    assert right["after_mount_free_rad"] == pytest.approx(NOISE_RAD, rel=0.15)
    for wrong in (
        figures("r_shoulder_roll", -0.06),
        figures("r_shoulder_pitch", 0.06),
        figures("r_elbow", 0.06),
    ):
        assert wrong["named"] and wrong["after_rad"] > 0.95 * wrong["before_rad"]
        assert wrong["after_mount_free_rad"] > 0.95 * wrong["before_mount_free_rad"] > 3.0 * NOISE_RAD
    elsewhere = figures("l_elbow", 0.06)
    assert not elsewhere["named"] and elsewhere["after_rad"] == elsewhere["before_rad"]


def test_a_tilted_axis_is_predicted_by_the_corrected_urdf(tmp_path: Path) -> None:
    """The tilt is written into the real URDF by hand: x of the roll axis (−1, 0, 0) turned towards z by 0.1."""
    nominal = (Path(__file__).parents[2] / "python/mirror_posture/embedded/robot.urdf").read_text("utf-8")
    head, tail = nominal.split('<joint name="r_shoulder_roll"', 1)
    axis = f"{-np.cos(0.1):.12f} 0 {np.sin(0.1):.12f}"
    assert '<axis xyz="-1 0 0"/>' in tail
    real = head + '<joint name="r_shoulder_roll"' + tail.replace('xyz="-1 0 0"', f'xyz="{axis}"', 1)
    found = diagnose(tracked(tmp_path / "session", lambda q: q, real))
    assert [c.effect for c in found.causes] == ["axis_tilt"]
    right = found.document["accelerometer_witness"][0]
    assert right["before_mount_free_rad"] > 3.0 * NOISE_RAD
    assert right["after_mount_free_rad"] == pytest.approx(NOISE_RAD, rel=0.15)


def test_a_twisted_link_is_predicted_by_the_corrected_urdf(tmp_path: Path) -> None:
    """The upper arm is twisted: the elbow's origin is turned about x, across its axis y and the arm."""
    nominal = (Path(__file__).parents[2] / "python/mirror_posture/embedded/robot.urdf").read_text("utf-8")
    head, tail = nominal.split('<joint name="r_elbow"', 1)
    assert '<origin xyz="0 0 -0.044"/>' in tail
    turned = tail.replace('<origin xyz="0 0 -0.044"/>', '<origin xyz="0 0 -0.044" rpy="0.1 0 0"/>', 1)
    found = diagnose(tracked(tmp_path / "session", lambda q: q, head + '<joint name="r_elbow"' + turned))
    assert [(c.effect, c.at) for c in found.causes] == [("link_twist", "link:r_upper_arm")]
    right = found.document["accelerometer_witness"][0]
    assert right["before_mount_free_rad"] > 3.0 * NOISE_RAD
    assert right["after_mount_free_rad"] == pytest.approx(NOISE_RAD, rel=0.15)


@pytest.mark.parametrize(
    "hidden",
    [
        [HiddenEffect("link_bending", "link:r_upper_arm", {"compliance_rad_per_nm": 0.6})],
        [
            HiddenEffect("joint_compliance", "joint:r_shoulder_pitch", {"compliance_rad_per_nm": 0.3}),
            HiddenEffect("axis_tilt", "joint:r_elbow", {"tilt_1_rad": 0.05, "tilt_2_rad": -0.03}),
        ],
    ],
    ids=["bending", "compliance and tilt"],
)
def test_what_yields_under_load_is_predicted_posture_by_posture(
    hidden: list[HiddenEffect], tmp_path: Path
) -> None:
    folder = write_tracked(tmp_path / "session", 11, hidden=hidden)
    nominal = load_session(folder)
    body = HiddenBody(
        nominal.robot_file.read_text("utf-8"), nominal.root_link, nominal.gravity_m_per_s2, hidden
    )
    force = []
    for q in nominal.frames.commanded:
        body.move(dict(zip(nominal.frames.joint_names, q, strict=True)))
        force.append(-body.link_poses()["r_forearm"][:3, :3].T @ nominal.gravity_m_per_s2)
    found = diagnose(add_columns(folder, {"r_forearm": np.array(force)}))
    assert {(c.effect, c.at) for c in found.causes} == {(one.effect, one.at) for one in hidden}
    (witness,) = found.document["accelerometer_witness"]
    for way in ("", "_mount_free"):
        assert witness[f"before{way}_rad"] > 2.5 * NOISE_RAD
        assert witness[f"after{way}_rad"] == pytest.approx(NOISE_RAD, rel=0.15)


@pytest.mark.parametrize(
    "scale, words",
    [(1.0 / 9.81, "in another unit"), (-1.0, "turn the sign"), (1.0, "")],
    ids=["g", "down", "right"],
)
def test_a_reading_of_the_wrong_length_or_side_is_told(scale: float, words: str, tmp_path: Path) -> None:
    session = load_session(tracked(tmp_path / "session", elbow_off))
    frames = replace(
        session.frames, accelerometer_m_per_s2=scale * session.frames.accelerometer_m_per_s2[:, :1],
        accelerometer_links=LINKS[:1], accelerometer_read=session.frames.accelerometer_read[:, :1],
    )  # fmt: skip
    witness = accelerometer_witness(
        replace(session, frames=frames), made_up("joint_offset", "joint:r_elbow", offset_rad=0.06)
    )
    assert [words in told for told in witness.warnings] == ([True] if words else [])


@pytest.fixture(scope="module")
def in_the_mirror(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str, list[str]]:
    """A blind session with a wrong gear ratio; sensors on the link that the joint moves, and on one that it does not."""
    case = simulate(
        "case",
        "small",
        ["gear_ratio"],
        np.random.default_rng(21),
        Options(frames=(120, 121), plain_noise=True),
    )
    joint = case.answer["causes"][0]["at"].removeprefix("joint:")
    moved = case.robot.bodies[case.robot.body_of_joint(joint)].name
    body = Body(case.robot, case.truth, case.gravity)
    theta = body.run(case.plan.commands).theta_rad
    links = [moved, {"l": "r", "r": "l"}[moved[0]] + moved[1:]]
    force = []
    for posture in theta:
        body.data.qpos[[body.address[j] for j in case.robot.commanded]] = posture
        force.append(
            readings(body.model, body.data, [f"L:{link}" for link in links], np.array([0.0, 1.0, 1.0]))
        )
    of_frame = np.stack(force, axis=1)[:, case.plan.posture_of_frame]
    folder = write_session(case, tmp_path_factory.mktemp("accelerometer") / "case")
    return add_columns(folder, dict(zip(links, of_frame, strict=True))), joint, links


def test_seen_in_the_mirror_alone(in_the_mirror: tuple[Path, str, list[str]]) -> None:
    folder, joint, links = in_the_mirror
    found = diagnose(folder)
    assert [c.at for c in found.causes] == [f"joint:{joint}"]
    there, elsewhere = found.document["accelerometer_witness"]
    assert there["link"] == links[0] and there["named"] and not elsewhere["named"]
    assert there["after_mount_free_rad"] < 0.6 * there["before_mount_free_rad"]
    assert there["after_mount_free_rad"] == pytest.approx(NOISE_RAD, rel=0.25)
    assert elsewhere["before_rad"] == elsewhere["after_rad"]
    assert elsewhere["after_mount_free_rad"] == pytest.approx(NOISE_RAD, rel=0.25)


def test_the_command_and_the_page_show_the_witness(
    in_the_mirror: tuple[Path, str, list[str]], tmp_path: Path
) -> None:
    done = CliRunner().invoke(app, ["diagnose", str(in_the_mirror[0]), "--out", str(tmp_path / "out")])
    assert done.exit_code == 0 and "Accelerometers that took no part in the fit" in done.output
    page = next((tmp_path / "out").rglob("*.html")).read_text(encoding="utf-8")
    assert f"accelerometer on link {in_the_mirror[2][0]}" in page
