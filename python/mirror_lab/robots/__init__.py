"""Simulated robots with hidden effects, behind the protocol of `mirror_posture.robots`.

`TwinRobot` draws its looks or computes exact pixels; `mirror_lab.robots.mujoco` (extra `mujoco`) has MuJoCo's dynamics.
"""

from .hidden import HiddenBody, HiddenEffect
from .twin import TwinOptions, TwinRobot

__all__ = ["HiddenBody", "HiddenEffect", "TwinOptions", "TwinRobot"]
