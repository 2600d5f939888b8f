"""The gap in the simulator that the user runs: MuJoCo executes a session, cause by cause (extra `mujoco`)."""

from .gap import SimulatedGap, simulated_gap
from .staircase import Simulation, Stair, can_hold, simulate

__all__ = ["SimulatedGap", "Simulation", "Stair", "can_hold", "simulate", "simulated_gap"]
