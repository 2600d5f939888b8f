"""Effects that a user defines: a basis as a Python function, compared by the core with those of the
vocabulary."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from .._core import GapRecording, MirrorPostureError
from ..arrays import Floats
from ..short_repr import ShortRepr

ALL = "*"
"""`joint:*`, `link:*`, `marker:*`: every such place that the session can show."""
LEAST_WEIGHT = 1e-12
"""A basis below this in every frame does nothing; with `*`, such places are left out."""


@dataclass(frozen=True, eq=False, repr=False)
class PlaceQuantities(ShortRepr):
    """What a basis may depend on at one place: arrays with the frames first, as the diagnosis itself reads them."""

    at: str
    """The place, `joint:r_elbow`."""
    time_s: Floats
    """(F,) s since the first frame."""
    positions: Mapping[str, Floats]
    """(F,) commanded position of every movable joint by name, rad (m)."""
    _tables: Mapping[str, Any] = field(repr=False)
    _joint: int | None = field(repr=False)
    _marker: int | None = field(repr=False)

    @property
    def position(self) -> Floats:
        """(F,) commanded position of the joint (of a link: of the joint that moves it), rad (m)."""
        return self._of_joint("position")

    @property
    def direction(self) -> Floats:
        """(F,) sign of the joint's last commanded change; 0 before the first and where the rows are not in order."""
        return self._of_joint("direction")

    @property
    def torque_nm(self) -> Floats:
        """(F,) torque that gravity puts on the joint at the nominal posture, N m; positive pushes the position upward."""
        return self._of_joint("torque_nm")

    @property
    def moment_nm(self) -> Floats:
        """(F, 3) moment of gravity on the link about its middle, in its frame, N m."""
        return self._of_joint("moment_nm")

    @property
    def down(self) -> Floats:
        """(F, 3) direction of gravity in the frame of the marker's mount."""
        if self._marker is None:
            raise MirrorPostureError(f"{self.at}: has no mount; `down` is told at markers")
        return np.array(self._tables["down"][:, self._marker])

    def _of_joint(self, name: str) -> Floats:
        if self._joint is None:
            raise MirrorPostureError(f"{self.at}: has no joint of its own; take `positions`, by joint name")
        # A copy, so that a basis that writes into it changes nothing else.
        return np.array(self._tables[name][:, self._joint])


Basis = Callable[[PlaceQuantities], npt.ArrayLike]


@dataclass(frozen=True)
class OwnEffect:
    """An effect that the vocabulary lacks: `change at the place = Σ_p parameter_p · weight_p(frame)`.

    At a `joint:` the change is one of its position, rad (m); at a `marker:` a shift along the parameter's
    axis (`x`, `y`, `z` of the link that carries its mount), m; at a `link:` a turn about it (`rx`, `ry`,
    `rz`) in the link's middle, rad; at `camera` either, all six. `axes` names one axis for each parameter,
    and is empty at joints.

    `basis` is called once for each place with its `PlaceQuantities` and returns the weights, (F,
    parameters), or (F,) for one parameter. Loads are those of the nominal postures.
    """

    name: str
    at: str | Sequence[str]
    """A place, several, or all of a kind (`joint:*`)."""
    basis: Basis
    parameters: tuple[str, ...]
    """Names with their units as suffix, `stretch_rad`."""
    prior_std: tuple[float, ...]
    """The usual size of each parameter (prior standard deviation); ten times as much is rejected."""
    axes: tuple[str, ...] = ()
    words: str = "an effect of one's own"
    """What happens, in a sentence, for the report."""

    def __post_init__(self) -> None:
        count = len(self.parameters)
        if isinstance(self.parameters, str) or count == 0:
            raise MirrorPostureError(
                f"own effect {self.name}: got parameters {self.parameters!r}, needed a tuple of names"
            )
        if len(self.prior_std) != count:
            raise MirrorPostureError(
                f"own effect {self.name}: got {len(self.prior_std)} prior_std, needed {count}, one a parameter"
            )
        if self.axes and len(self.axes) != count:
            raise MirrorPostureError(
                f"own effect {self.name}: got {len(self.axes)} axes, needed {count}, one a parameter, or none at joints"
            )


@dataclass(frozen=True, eq=False, repr=False)
class Tabulated(ShortRepr):
    """A user's effect with its weights in one session, as input of the core."""

    name: str
    words: str
    parameters: list[tuple[str, float, str | None]]
    places: list[tuple[str, Floats]]


def tabulate(
    effects: Sequence[OwnEffect], recording: GapRecording, *, other: bool = False
) -> list[Tabulated]:
    """Calls each basis at each of its places. In an `other` session the places that it does not have are left out.

    Raises:
        MirrorPostureError: a place that is not there, a basis of the wrong shape or with numbers that are not finite.
    """
    if not effects:
        return []
    tables = recording.quantities()
    positions = {name: tables["position"][:, i].copy() for i, name in enumerate(tables["joint_names"])}
    told = []
    for effect in effects:
        places = []
        for at, everywhere in _places(effect, tables):
            quantities = _quantities(at, tables, positions)
            if quantities is None:
                if other:
                    continue
                raise MirrorPostureError(
                    f"own effect {effect.name}: got the place {at!r}, needed one of {', '.join(_valid(tables))}"
                )
            weights = _weights(effect, quantities)
            if (everywhere or other) and not np.any(np.abs(weights) > LEAST_WEIGHT):
                continue
            places.append((at, weights))
        if not places:
            if other:
                continue
            raise MirrorPostureError(
                f"own effect {effect.name}: its basis is 0 in every frame at every place of {effect.at!r}"
            )
        axes: tuple[str | None, ...] = effect.axes or (None,) * len(effect.parameters)
        parameters = list(zip(effect.parameters, map(float, effect.prior_std), axes, strict=True))
        told.append(Tabulated(effect.name, effect.words, parameters, places))
    return told


def _places(effect: OwnEffect, tables: Mapping[str, Any]) -> list[tuple[str, bool]]:
    """Places by name, and whether they denote all of their kind."""
    given = [effect.at] if isinstance(effect.at, str) else list(effect.at)
    out: list[tuple[str, bool]] = []
    for at in given:
        kind, _, name = at.partition(":")
        if name == ALL:
            out += [(place, True) for place in _valid(tables) if place.startswith(kind + ":")]
        else:
            out.append((at, False))
    return out


def _valid(tables: Mapping[str, Any]) -> list[str]:
    seen = [i for i, of in enumerate(tables["seen"]) if of]
    return [
        *(f"joint:{tables['joint_names'][i]}" for i in seen),
        *(f"link:{tables['link_names'][i]}" for i in seen),
        *(f"marker:{name}" for name in tables["marker_names"]),
        "camera",
    ]


def _quantities(
    at: str, tables: Mapping[str, Any], positions: Mapping[str, Floats]
) -> PlaceQuantities | None:
    if at not in _valid(tables):
        return None
    kind, _, name = at.partition(":")
    joint = {"joint": "joint_names", "link": "link_names"}.get(kind)
    return PlaceQuantities(
        at=at,
        time_s=tables["time_s"].copy(),
        positions=positions,
        _tables=tables,
        _joint=tables[joint].index(name) if joint else None,
        _marker=tables["marker_names"].index(name) if kind == "marker" else None,
    )


def _weights(effect: OwnEffect, quantities: PlaceQuantities) -> Floats:
    where = f"own effect {effect.name} at {quantities.at}"
    try:
        weights = np.asarray(effect.basis(quantities), dtype=float)
    except (TypeError, ValueError) as error:
        raise MirrorPostureError(f"{where}: its basis failed: {type(error).__name__}: {error}") from error
    needed = (len(quantities.time_s), len(effect.parameters))
    if weights.shape == needed[:1] and needed[1] == 1:
        weights = weights[:, None]
    if weights.shape != needed:
        raise MirrorPostureError(
            f"{where}: got a basis of shape {weights.shape}, needed {needed} (frames, parameters)"
        )
    if not np.isfinite(weights).all():
        frame = int(np.argwhere(~np.isfinite(weights))[0, 0])
        raise MirrorPostureError(f"{where}: got a weight that is not finite in row {frame} of the frames")
    return np.ascontiguousarray(weights)
