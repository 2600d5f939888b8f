"""A world for a stranger's first hour: a robot with faults before a mirror, by MuJoCo's own reading of the URDF and its own renderer.

Of the product it uses only the mirror's and the board's looks (`mujoco_picture`): where limbs are is MuJoCo's kinematics.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import mujoco
import numpy as np
import pyarrow.csv

from mirror_posture.robots import Nominal
from mirror_posture.shapes.mujoco_picture import MirrorRenderer, dress

Commands = Mapping[str, float]
Faults = Callable[[Commands], dict[str, float]]
"""From what was commanded to where the joints go, rad."""


def plan_rows(folder: Path) -> list[dict[str, float]]:
    """The rows of a plan's postures.csv."""
    table = pyarrow.csv.read_csv(folder / "plan" / "postures.csv")
    return table.to_pylist()


class World:
    """Renders a session's robot, with its meshes, before the mirror of its plan."""

    def __init__(self, folder: Path, packages: Mapping[str, Path] | None = None, finer: int = 2) -> None:
        text = (folder / "robot.urdf").read_text()
        for name, path in (packages or {}).items():
            text = text.replace(f"package://{name}", str(path))
        text = re.sub(r"<mujoco>.*?</mujoco>", "", text, flags=re.DOTALL)
        settings = '<mujoco><compiler strippath="false" discardvisual="false" fusestatic="false" balanceinertia="true" boundmass="1e-6" boundinertia="1e-9"/></mujoco></robot>'
        spec = mujoco.MjSpec.from_string(text.replace("</robot>", settings))
        for geom in spec.geoms:
            geom.contype = geom.conaffinity = 0
        self.plan = json.loads((folder / "plan" / "plan.json").read_text())
        self.views = pyarrow.csv.read_csv(folder / "plan" / "views.csv").to_pylist()
        self.rows = plan_rows(folder)
        nominal = Nominal.load(folder)
        dress(spec, nominal, (self.plan["mirror"]["width_m"] / 2, self.plan["mirror"]["height_m"] / 2), finer)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.root = nominal.metadata.root
        self.renderer = MirrorRenderer(self.model, nominal, finer)

    def picture(self, joints: Mapping[str, float], view: Mapping[str, float]) -> np.ndarray:
        """The camera's picture (BGR) with the joints there."""
        for name, value in joints.items():
            self.data.qpos[self.model.joint(name).qposadr[0]] = value
        mujoco.mj_forward(self.model, self.data)
        body = self.model.body(self.root).id
        turn, shift = self.data.xmat[body].reshape(3, 3), self.data.xpos[body]
        center = turn @ np.array([view[f"center_{a}_m"] for a in "xyz"]) + shift
        return self.renderer.picture(self.data, center, turn @ np.array([view[f"normal_{a}"] for a in "xyz"]))

    def frames(self, faults: Faults) -> Iterator[tuple[int, dict[str, float], np.ndarray]]:
        """Each row of the plan: its number, the commands, the picture; with a camera's noise."""
        random = np.random.default_rng(1)
        for row, view in zip(self.rows, self.views, strict=True):
            commands = {name: value for name, value in row.items() if name not in ("frame", "posture")}
            clean = self.picture(faults(commands), view)
            noisy = clean + random.normal(0.0, 1.5, clean.shape)
            yield int(row["frame"]), commands, np.clip(noisy, 0, 255).astype(np.uint8)

    def close(self) -> None:
        """Frees the OpenGL context."""
        self.renderer.close()
