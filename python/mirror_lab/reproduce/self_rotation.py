"""Fig. 14: the same correction while the robot turns itself before the mirror on its own legs."""

from __future__ import annotations

import math
import shutil
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import numpy.typing as npt

from mirror_posture.correct import CorrectOptions, LookReport, MeasureChoice, StepOptions, correct
from mirror_posture.render import EMBEDDED_FOLDER, Painter, PictureOptions, View, view_planes
from mirror_posture.robots import Look
from mirror_posture.session.camera_info import dump_camera_info, load_camera_info

from ..robots import HiddenEffect, TwinOptions, TwinRobot
from .body import MARKER, PLAY_RAD, TARGET_RAD, Body, error_mm
from .claims import Experiment, judged
from .correction import CORRECTIONS, ON_AND_ON, SPARE_LOOKS, EnoughCorrectionsError, not_stopped
from .observation import Told
from .plots import EQ1, OURS, STYLE, png

Floats = npt.NDArray[np.float64]

GAIN = 0.2
SHOWN = 3
"""Fig. 14 shows the initial posture, three corrections and the target."""
HIPS = ("r_hip_yaw", "l_hip_yaw")
FOOT = "r_foot"
TURN_RAD = math.radians(15.0)
VIEW_JOINTS = (tuple((hip, 0.0) for hip in HIPS), tuple((hip, TURN_RAD) for hip in HIPS))
"""The two viewpoints: both hips straight, and both turned by 15°, as the paper's stand is in Fig. 13."""
DRAWN = PictureOptions(samples=1, edge_samples=3, full_well_electrons=None)
"""Enough for a picture for people."""
CLOSE_UP, ZOOM = (575, 245, 225, 110), 2
"""The part of the robot's own picture that is shown (left, top, width, height, px), the forearm, and its magnification."""


class StandingTwin(TwinRobot):
    """A twin that stands on its feet: they and the mirror stay where they are, and the torso turns with the hips.

    It does not turn its mirror: where that stands as the torso sees it follows from the leg's actual joints at each look.
    """

    def __init__(self, hidden: tuple[HiddenEffect, ...], options: TwinOptions) -> None:
        super().__init__(hidden, options)
        # The mirror as the foot has it, with the robot standing straight.
        root_from_foot = self.body.link_poses()[FOOT]
        normal, at = self._plane_in_root(options.view)
        self._normal_in_foot = root_from_foot[:3, :3].T @ normal
        self._point_in_foot = root_from_foot[:3, :3].T @ (at - root_from_foot[:3, 3])

    def _plane_in_root(self, view: View) -> tuple[Floats, Floats]:
        plane = view_planes([view], self._board_in_root)[0]
        return np.array(plane.normal_in_root), np.array(plane.center_in_root_m)

    @property
    def seen_view(self) -> View:
        """The true pose of the mirror relative to the torso."""
        root_from_foot = self.body.link_poses()[FOOT]
        normal = root_from_foot[:3, :3] @ self._normal_in_foot
        point = root_from_foot[:3, :3] @ self._point_in_foot + root_from_foot[:3, 3]
        distance = float(normal @ (point - self._board_in_root))
        return View(
            math.atan2(normal[1], normal[0]), math.asin(float(np.clip(normal[2], -1.0, 1.0))), distance
        )

    def _look(self) -> Look:
        self._real_view = self.seen_view
        # The robot does not know where the mirror stands.
        return replace(super()._look(), view=None)


@dataclass(frozen=True)
class Step:
    """The robot at one correction."""

    error_mm: Floats
    """(3,), true, in the paper's axes."""
    link_poses: dict[str, Floats]
    """`root_from_link` (4, 4), as they really are."""


def hidden() -> tuple[HiddenEffect, ...]:
    """Table I's body, with as much play in the hips that turn it."""
    return (
        *Body().hidden,
        *(HiddenEffect("backlash", f"joint:{hip}", {"width_rad": PLAY_RAD}) for hip in HIPS),
    )


def on_its_legs(options: TwinOptions, told: Told | None = None) -> tuple[list[Step], list[float]]:
    """One correction with λ = 0.2: the robot at each step, and the yaw of the mirror at each picture, rad."""
    robot = StandingTwin(hidden(), options)
    steps: dict[int, Step] = {}
    yaws: list[float] = []

    def on_look(report: LookReport) -> None:
        steps.setdefault(report.steps, Step(error_mm(robot), robot.body.link_poses()))
        if report.steps >= CORRECTIONS:
            raise EnoughCorrectionsError

    def on_picture(_: Look, __: int) -> None:
        yaws.append(robot.seen_view.yaw_rad)
        if told is not None:
            told()

    choice = CorrectOptions(
        step=StepOptions(gain=GAIN),
        stop=replace(ON_AND_ON, looks=CORRECTIONS + 1 + SPARE_LOOKS),
        measure=MeasureChoice("point-pair"),
        markers=(MARKER,),
        view_joints=VIEW_JOINTS,
        extra_views=0,
    )
    with robot, suppress(EnoughCorrectionsError):
        not_stopped(correct(robot, TARGET_RAD, choice, on_look=on_look, on_picture=on_picture))
    return [steps[k] for k in sorted(steps)], yaws


def fig14(options: TwinOptions, told: Told | None = None) -> Experiment:
    """The robot in its mirror at each correction, beside the target."""
    steps, yaws = on_its_legs(options, told)
    distances = [float(np.linalg.norm(step.error_mm)) for step in steps]
    turned = math.degrees(max(yaws) - min(yaws))
    claims = (
        judged(
            "the warped posture was corrected",
            "seen in the pictures; λ = 0.2, no numbers",
            f"{', '.join(f'{d:.1f}' for d in distances)} mm over {len(distances) - 1} corrections",
            len(distances) > CORRECTIONS
            and bool(np.all(np.diff(distances) < 0.0))
            and distances[CORRECTIONS] < 0.55 * distances[0],
        ),
        judged(
            "on its own legs",
            "the robot rotated on its own legs to change the viewpoint",
            f"both hips by {math.degrees(TURN_RAD):.0f}°, with {math.degrees(PLAY_RAD):.1f}° of play: the mirror's views differ by {turned:.1f}°; nobody turned stand or mirror",
            turned > 5.0,
        ),
    )
    data: dict[str, Any] = {
        "gain": GAIN,
        "error_mm": [step.error_mm for step in steps],
        "distance_mm": distances,
        "view_yaw_deg": np.degrees(yaws),
    }
    return Experiment(
        "fig14",
        "Correction on its own legs",
        claims,
        data,
        {"fig14.png": _strip(steps)},
        (
            "The robot as its own camera sees it in the mirror (not flipped). Circle: where the hand marker is; cross: where the model "
            "wants it. The paper shows photographs from outside.",
        ),
    )


def _strip(steps: list[Step]) -> bytes:
    """The initial posture, three corrections, the target: five pictures in a row."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    painter = _close_up()
    nominal = painter.link_poses(TARGET_RAD)
    shown = steps[: SHOWN + 1]
    poses = [*(step.link_poses for step in shown), nominal]
    names = ("Initial posture", "1st correction", "2nd correction", "3rd correction")
    titles = [
        f"({letter}) {name}\n{np.linalg.norm(step.error_mm):.1f} mm"
        for letter, name, step in zip("abcd", names, shown, strict=False)
    ]
    titles.append("(e) Target posture\nthe model")
    plane = view_planes([View()], painter.board_in_root_m)[0]
    drawn = [painter.draw(at, plane, DRAWN) for at in poses]
    hands = [one.truth["markers"][MARKER]["mirror"]["px"] for one in drawn]
    height, width = drawn[-1].picture.shape[:2]
    size = 1.25
    with rc_context(STYLE | {"axes.grid": False}):
        figure = Figure(figsize=(size * width / height * len(poses), size + 0.5), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(1, len(poses), squeeze=False)[0]
        for ax, one, hand, title in zip(axes, drawn, hands, titles, strict=True):
            ax.imshow(one.picture, interpolation="bilinear")
            ax.plot(
                *hand, "o", markersize=20, markerfacecolor="none", markeredgecolor=EQ1, markeredgewidth=1.4
            )
            ax.plot(*hands[-1], "+", markersize=16, color=OURS, markeredgewidth=1.8)
            ax.set_title(title, fontsize=9)
            ax.axis("off")
        return png(figure, colours=224)


def _close_up() -> Painter:
    """The embedded robot with a camera that sees `CLOSE_UP` of its picture alone, `ZOOM` times as large."""
    left, top, width, height = CLOSE_UP
    with TemporaryDirectory() as name:
        folder = Path(name)
        for file in ("session.toml", "robot.urdf"):
            shutil.copy(EMBEDDED_FOLDER / file, folder / file)
        whole = load_camera_info(EMBEDDED_FOLDER / "camera.yaml")
        part = replace(
            whole,
            size_px=(ZOOM * width, ZOOM * height),
            focal_px=(ZOOM * whole.fx_px, ZOOM * whole.fy_px),
            # Pixel 0 is the centre of a pixel: its left edge, at -0.5, stays where it is.
            center_px=(
                ZOOM * (whole.cx_px - left + 0.5) - 0.5,
                ZOOM * (whole.cy_px - top + 0.5) - 0.5,
            ),
        )
        (folder / "camera.yaml").write_text(dump_camera_info(part), encoding="utf-8")
        return Painter.load(folder)
