"""The parts of a diagnosis, as frozen dataclasses: causes, the gap, what was left out, panels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..arrays import Floats, Integers
from ..short_repr import ShortRepr


@dataclass(frozen=True)
class Estimate:
    """A parameter in the unit given by its name (of a prismatic joint: m for rad), with one standard
    deviation."""

    value: float
    std: float
    slides: bool = False
    """Whether it is a prismatic joint's; no key of the file."""


@dataclass(frozen=True)
class Alternative:
    """An alternative that these postures cannot separate from a cause."""

    effect: str
    at: str
    probability: float


@dataclass(frozen=True)
class Member:
    """One small error of a group (`geometry`), as a single effect: `joint_offset`, `axis_tilt`,
    `link_length` or `marker_mount`; the value is in the unit given by the parameter's name."""

    effect: str
    at: str
    parameter: str
    value: float
    std: float
    slides: bool = False
    """Whether it is a prismatic joint's; no key of the file."""


@dataclass(frozen=True)
class Cause:
    """An effect at a place. `rms_shift` is the shift of the markers that it makes, px (m where points were measured)."""

    effect: str
    at: str
    probability: float
    parameters: Mapping[str, Estimate]
    alternatives: tuple[Alternative, ...] = ()
    words: str = ""
    rms_shift: float = 0.0
    members: tuple[Member, ...] = field(default=(), repr=False)
    """Of a group (`geometry`): its small errors one by one."""
    kind: str = ""
    """Whom it concerns: `robot`, `setup`, `camera`, `mirror` or `data`."""
    frames: tuple[int, ...] = ()
    """Of a mistake in some frames only (`markers_swapped`): their numbers."""
    stability: float | None = None
    """Stability: share of resamples of the postures in which the same cause is selected again; None where
    it was not resampled."""


@dataclass(frozen=True)
class LeftOut:
    """An observation that was left out: its frame, `board` or a marker's name, how many deviations it was off, and why."""

    frame: int
    target: str
    deviations: float | None = None
    why: str = ""


@dataclass(frozen=True)
class Data:
    """What of the data was given and used; points are observations of markers. Nothing is left out without being listed."""

    frames_given: int = 0
    frames_used: int = 0
    postures_given: int = 0
    postures_used: int = 0
    points_given: int = 0
    points_used: int = 0
    left_out: tuple[LeftOut, ...] = ()


@dataclass(frozen=True)
class Place:
    """A place with its share of the gap's variance; `depends_on` names the variables on which an
    unexplained part there depends."""

    at: str
    share: float
    depends_on: str | None = None


@dataclass(frozen=True)
class Ground:
    """How another session's base turns under the robot's weight beyond what the causes say, `ω = diag(c) M` with the moment M of
    the weight about the root's origin, in its frame: the robot stands on other ground there. `after_m`: RMS distance with the
    causes and this, m; c about x, y and z with standard deviations, rad/(N m)."""

    after_m: float
    yields_rad_per_nm: tuple[float, float, float]
    std_rad_per_nm: tuple[float, float, float]


@dataclass(frozen=True)
class LeftOutThere:
    """What of another session was left out as false, as a diagnosis of it would: observations of markers (of how many), and boards
    that no flat mirror explains."""

    points: int
    points_given: int
    boards: int


@dataclass(frozen=True)
class Checked:
    """Another session, predicted with nothing of it fitted but its own mirrors, or the frame of its points: RMS distance before and
    after, m (None where no marker can be compared). `ground`: where its base yields otherwise than in the first session. `left_out`:
    what is in neither figure, where something is false."""

    session: str
    before_m: float | None
    after_m: float | None
    ground: Ground | None = None
    left_out: LeftOutThere | None = None


@dataclass(frozen=True)
class Witness:
    """A marker that was withheld from the fit, predicted by it: RMS distance before and after, m. `left_out`: what is in neither
    figure, where something is false."""

    marker: str
    before_m: float | None
    after_m: float | None
    left_out: LeftOutThere | None = None


@dataclass(frozen=True)
class Step:
    """The held-out gap with the cause `added` (`effect@place`; None: the nominal model) in addition to
    those before it: RMS in m and px, each None where there is nothing to compare."""

    added: str | None
    rms_m: float | None
    rms_px: float | None = None


@dataclass(frozen=True)
class ChosenAnew:
    """The gap if the causes too are selected without the region of postures that they predict (nested
    cross-validation), RMS in m and px. It equals the gap after where the same causes are selected. Without
    `changed` of the `regions` other causes are selected."""

    rms_m: float | None
    rms_px: float | None
    regions: int
    changed: int


@dataclass(frozen=True)
class Gap:
    """RMS distance between predicted and observed markers, on postures whose whole region was held out of the fit of the
    parameters; None where there is nothing to compare. The causes were chosen on all postures: `chosen_anew` is without that."""

    before_m: float | None
    after_m: float | None
    noise_floor_m: float | None
    closed: float | None = None
    closed_ci95: tuple[float, float] | None = None
    before_px: float | None = None
    after_px: float | None = None
    noise_floor_px: float | None = None
    held_out_postures: int = 0
    checked: tuple[Checked, ...] = ()
    steps: tuple[Step, ...] = ()
    """The gap as causes are added one by one in the reported order, the nominal model first; empty in a
    document of version 1."""
    chosen_anew: ChosenAnew | None = None
    """None where nothing is named."""


@dataclass(frozen=True)
class Limit:
    """The largest size of an effect at a place that these postures would have hidden (95 %), by parameter, each alone; None:
    they would hide any size of it."""

    effect: str
    at: str
    parameters: Mapping[str, float | None]
    slides: bool = False
    """Whether it is a prismatic joint's; no key of the file."""


@dataclass(frozen=True)
class Ranked:
    """A hypothesis of the first look: log Bayes factor against the nominal model, by the score test."""

    effect: str
    at: str
    log_bayes: float


@dataclass(frozen=True, eq=False, repr=False)
class Signature(ShortRepr):
    """The error at a place, estimated from each posture separately (`error`, with `std`), and the cause's
    value (`fitted`).

    Arrays (K,), one value for each posture; `unit` (rad or m) is that of error, std and fitted. `cause` is
    an index into the causes, or None for the unexplained part, whose `fitted` is the free-form error.
    """

    at: str
    unit: str
    cause: int | None
    frame: Integers
    position: Floats
    torque_nm: Floats
    direction: Floats
    time_s: Floats
    error: Floats
    std: Floats
    fitted: Floats
    other: str | None = None
    """The other joint on whose position the error depends (`joint:K`), where it does."""
    other_position: Floats | None = None
    """(K,) its commanded position, rad (m)."""


@dataclass(frozen=True, eq=False, repr=False)
class Track(ShortRepr):
    """The error of a marker, a link, a joint's axis or the camera that each posture shows by itself, component by component.

    `error`, `std` and `fitted` are (K, C) arrays in `unit` (`m`, `rad`, or `1` of a ratio), one column a name in
    `components`; `values` is (K, Q), one column a quantity in `against`. `what` is `shift`, `turn`, `tilt` or `focal`. Shifts and
    turns are in the frame of the place: of the mount's link, of the link, of the camera. `cause` as in `Signature`.
    """

    at: str
    what: str
    unit: str
    cause: int | None
    components: tuple[str, ...]
    against: tuple[str, ...]
    against_units: tuple[str, ...]
    frame: Integers
    values: Floats
    error: Floats
    std: Floats
    fitted: Floats


@dataclass(frozen=True, eq=False, repr=False)
class Field(ShortRepr):
    """Mean residuals of corners and markers over the image, or of corners over the board: the signature of
    optics.

    Over the image, `at_points` (K, 2) are px and residuals (K, 2) px, observed minus predicted. Over the
    board, `at_points` are m in its frame and residuals (K, 3) m, each corner's displacement. `of` says what
    was averaged at each place, `corners` or `markers`, and `count` (K,) how many; `size` (2,) is that of
    the image, or of the board's corners. `with_cause` is None where there is no cause to subtract.
    """

    at: str
    over: str
    unit: str
    cause: int | None
    size: Floats
    at_points: Floats
    of: tuple[str, ...]
    count: Integers
    without: Floats
    std: Floats
    with_cause: Floats | None = None


@dataclass(frozen=True)
class SeenMarker:
    """A marker in one posture, in the root link's frame, m: as measured, by the nominal model, by the one with the causes."""

    frame: int
    marker: str
    measured_m: tuple[float, float, float]
    before_m: tuple[float, float, float]
    after_m: tuple[float, float, float]
