"""The causes of a moving session: what each effect is in the simulator, its parameters, where its search begins.

`q` is a joint's position, `u` what its servo is told, `k` and `d` the servo's stiffness and damping as the model has them.

| effect | place | law |
| --- | --- | --- |
| `latency` | `camera` | a picture stamped t shows the body of t - latency_s |
| `servo_lag` | joint | the servo is told u filtered: T du'/dt = u - u' |
| `servo_gain` | joint | k (1 + stiffness_scale_error), d (1 + damping_scale_error) |
| `viscous_friction` | joint | a torque -viscous_nms_per_rad dq/dt |
| `coulomb_friction` | joint | a torque -friction_nm sign(dq/dt), and as much to break loose |
| `reflected_inertia` | joint | the motor's inertia, as the joint feels it, is larger by inertia_kgm2 |
| `torque_limit` | joint | the servo gives at most limit_nm |
| `velocity_limit` | joint | what the servo is told changes by at most limit_rad_per_s |
| `joint_offset`, `gear_ratio`, `joint_compliance`, `backlash` | joint | as of a still session, of the torque that gravity and the motion put on the joint |
| `marker_mount`, `camera_mount`, `board_mount` | marker, camera, board | as of a still session |
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirror_posture.arrays import Floats

Key = tuple[str, str]
"""An effect and its place."""
Causes = dict[Key, tuple[float, ...]]
"""The parameters of each cause that a model has."""

SHIFT = ("dx_m", "dy_m", "dz_m")
POSE = ("rx_rad", "ry_rad", "rz_rad", *SHIFT)


@dataclass(frozen=True)
class Effect:
    """An effect of the vocabulary of motion; `in_rollout`: the simulator must run again when it changes."""

    name: str
    kind: str
    """Whom it concerns: `robot`, `setup` or `camera`."""
    parameters: tuple[str, ...]
    in_rollout: bool = False
    needs_servo: bool = False
    """Whether it can only be estimated if the model contains the servo."""
    is_limit: bool = False
    """A limit does nothing until it is reached: it has no derivative at the nominal model, and is tried at sizes."""


EFFECTS = {
    effect.name: effect
    for effect in (
        Effect("latency", "camera", ("latency_s",)),
        Effect("servo_lag", "robot", ("time_constant_s",), in_rollout=True),
        Effect("servo_gain", "robot", ("stiffness_scale_error", "damping_scale_error"), True, True),
        Effect("viscous_friction", "robot", ("viscous_nms_per_rad",), True, True),
        Effect("coulomb_friction", "robot", ("friction_nm",), True, True),
        Effect("reflected_inertia", "robot", ("inertia_kgm2",), True, True),
        Effect("torque_limit", "robot", ("limit_nm",), True, True, True),
        Effect("velocity_limit", "robot", ("limit_rad_per_s",), True, False, True),
        Effect("joint_offset", "robot", ("offset_rad",)),
        Effect("gear_ratio", "robot", ("scale_error",)),
        Effect("joint_compliance", "robot", ("compliance_rad_per_nm",)),
        Effect("backlash", "robot", ("width_rad",)),
        Effect("marker_mount", "setup", SHIFT),
        Effect("camera_mount", "setup", POSE),
        Effect("board_mount", "setup", POSE),
    )
}


@dataclass(frozen=True)
class Hypothesis:
    """An effect at a place: one step of each parameter, its bounds, and the values at which it is first
    tried."""

    effect: Effect
    at: str
    step: tuple[float, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    starts: tuple[tuple[float, ...], ...]
    usual: tuple[float, ...]
    """How large each parameter usually is where the effect is there: the scale of its prior."""

    @property
    def key(self) -> Key:
        """Effect and place by name."""
        return self.effect.name, self.at

    def clipped(self, values: Floats) -> tuple[float, ...]:
        """Values within their bounds."""
        return tuple(float(v) for v in np.clip(values, self.lower, self.upper))


@dataclass(frozen=True)
class JointScale:
    """What is usual of a joint in the nominal motion."""

    stiffness: float
    damping: float
    armature: float
    friction: float
    torque: float
    """The largest of its servo, N m."""
    torque_sizes: tuple[float, ...]
    """Limits at which its torque is tried, rising, N m."""
    speed: float
    """The largest commanded, rad/s."""
    has_servo: bool


def gains(values: tuple[float, ...]) -> tuple[float, float]:
    """Factors of a servo's stiffness and damping from the parameters (s, l) in which they are fitted.

    What a servo lags behind its command is, to first order, `load / k + (d / k) dq/dt`: linear in its softness `1 / k`, larger
    by a factor 1 + s, and in its lag `d / k`, larger by 1 + l.
    """
    softness, lag = values
    return 1.0 / (1.0 + softness), (1.0 + lag) / (1.0 + softness)


def told(key: Key, values: tuple[float, ...], covariance: Floats) -> tuple[list[float], list[float]]:
    """Reported parameters and their standard deviations, from the fitted ones and their covariance."""
    if key[0] != "servo_gain":
        return list(values), np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist()
    stiffness, damping = gains(values)
    by_fitted = np.array([[-(stiffness**2), 0.0], [-damping * stiffness, stiffness]])
    spread = by_fitted @ covariance @ by_fitted.T
    return [stiffness - 1.0, damping - 1.0], np.sqrt(np.maximum(np.diag(spread), 0.0)).tolist()


LIMIT_SHARES = (0.4, 0.55, 0.7, 0.85)
"""Shares of a joint's largest speed at which its limit is tried."""
MILDEST_LEVEL = 0.98
"""Share of the time that a joint's torque is below the mildest limit that is tried: the maximum may be a
single jerk, which gives no information."""
TIGHTEST, FINER = 0.35, 0.95
"""The tightest limit of torque tried, in units of the mildest, and each in units of the previous one: with
a limit that is off by more than two or three per cent a limb falls at another moment, and the residuals do
not show how far it is off."""


def torque_sizes(torque: Floats) -> tuple[float, ...]:
    """Limits of torque at which a joint is tried, rising, from what its servo gives throughout a motion."""
    mildest = float(np.quantile(np.abs(torque), MILDEST_LEVEL))
    count = int(np.log(TIGHTEST) / np.log(FINER)) + 1
    return tuple(mildest * FINER**k for k in reversed(range(count)))


def of_joint(name: str, scale: JointScale) -> list[Hypothesis]:
    """The hypotheses at a joint that moves."""
    place = f"joint:{name}"

    def one(
        effect: str, step: float, usual: float, lower: float = -np.inf, upper: float = np.inf
    ) -> Hypothesis:
        return Hypothesis(EFFECTS[effect], place, (step,), (lower,), (upper,), ((step,),), (usual,))

    def limit(effect: str, largest: float, sizes: tuple[float, ...]) -> Hypothesis:
        starts = tuple((size,) for size in sizes)
        bounds = (0.05 * largest,), (1.5 * largest,)
        return Hypothesis(EFFECTS[effect], place, (0.02 * largest,), *bounds, starts, (0.5 * largest,))

    out = [
        one("servo_lag", 0.005, 0.03, 0.0, 0.5),
        one("joint_offset", 0.005, 0.02, -1.0, 1.0),
        one("gear_ratio", 0.005, 0.03, -0.5, 0.5),
        one("backlash", 0.01, 0.03, 0.0, 0.5),
        limit("velocity_limit", scale.speed, tuple(share * scale.speed for share in LIMIT_SHARES)),
    ]
    if scale.torque > 0.0:
        out.append(one("joint_compliance", 0.01 / scale.torque, 0.03 / scale.torque, 0.0))
    if scale.has_servo:
        damping = max(scale.damping, 0.005 * scale.stiffness)
        inertia = max(0.1 * scale.armature, 1e-6)
        out += [
            Hypothesis(
                EFFECTS["servo_gain"],
                place,
                (0.05, 0.05),
                (-0.9, -0.95),
                (20.0, 20.0),
                ((0.05, 0.05),),
                (1.0, 1.0),
            ),
            one("viscous_friction", 0.05 * damping, damping, -0.9 * scale.damping),
            one("coulomb_friction", 0.05 * scale.torque, 0.5 * scale.torque, -scale.friction),
            one("reflected_inertia", inertia, 30.0 * inertia, -0.9 * scale.armature),
            limit("torque_limit", scale.torque, scale.torque_sizes),
        ]
    return out


def of_setup(markers: tuple[str, ...]) -> list[Hypothesis]:
    """The hypotheses at camera, board and markers."""
    metre, radian = 0.001, 0.005

    def pose(effect: str, at: str) -> Hypothesis:
        step = (radian,) * 3 + (metre,) * 3
        usual = (0.01,) * 3 + (0.003,) * 3
        return Hypothesis(EFFECTS[effect], at, step, (-0.5,) * 6, (0.5,) * 6, (step,), usual)

    def shift(name: str) -> Hypothesis:
        step = (metre,) * 3
        return Hypothesis(
            EFFECTS["marker_mount"], f"marker:{name}", step, (-0.2,) * 3, (0.2,) * 3, (step,), (0.004,) * 3
        )

    out = [Hypothesis(EFFECTS["latency"], "camera", (0.002,), (-0.5,), (0.5,), ((0.002,),), (0.02,))]
    out += [shift(name) for name in markers]
    return [*out, pose("camera_mount", "camera"), pose("board_mount", "board")]
