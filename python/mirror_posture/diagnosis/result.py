"""What a diagnosis says, as frozen dataclasses around the JSON of the public format."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from dataclasses import fields as fields_of
from pathlib import Path
from typing import Any, TypeGuard, TypeVar

import numpy as np
import numpy.typing as npt

from .._core import MirrorPostureError
from ..input_files import read_text, reason
from ..output_files import is_whole
from ..short_repr import ShortRepr

LARGEST_DOCUMENT = 256_000_000
"""Bytes of diagnosis.json at most; with all panels of a large session it has some millions."""
PLAIN = {"float", "int", "str", "bool", "None"}
FORMAT, VERSION = "mirror-posture/diagnosis", 2
VERSIONS = (1, 2)
"""Those that are read; the last is what `diagnose` writes."""
VERDICTS = ("insufficient", "none", "explained", "partial", "unknown")
Floats = npt.NDArray[np.float64]
Kind = TypeVar("Kind")


@dataclass(frozen=True)
class Estimate:
    """A parameter in the unit that its name says, with one standard deviation."""

    value: float
    std: float


@dataclass(frozen=True)
class Alternative:
    """A rival that these postures cannot tell from a cause."""

    effect: str
    at: str
    probability: float


@dataclass(frozen=True)
class Member:
    """One small error of a group (`geometry`), as the single effect that it would be: `joint_offset`, `axis_tilt`,
    `link_length` or `marker_mount`; the value is in the unit that the parameter's name says."""

    effect: str
    at: str
    parameter: str
    value: float
    std: float


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
    members: tuple[Member, ...] = ()
    """Of a group (`geometry`): its small errors one by one."""
    kind: str = ""
    """Whom it concerns: `robot`, `setup`, `camera`, `mirror` or `data`."""
    frames: tuple[int, ...] = ()
    """Of a mistake in some frames only (`markers_swapped`): their numbers."""
    stability: float | None = None
    """Share of resamples of the postures, the search included, in which the same cause comes out; None where it was not
    resampled."""


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
    """A place with its share of the gap's variance; `depends_on` says on what an unexplained part there depends."""

    at: str
    share: float
    depends_on: str | None = None


@dataclass(frozen=True)
class Checked:
    """Another session, predicted with nothing of it fitted but its own mirrors: RMS distance before and after, m (None where
    no marker can be compared)."""

    session: str
    before_m: float | None
    after_m: float | None


@dataclass(frozen=True)
class Witness:
    """A marker that was withheld from the fit, predicted by it: RMS distance before and after, m."""

    marker: str
    before_m: float | None
    after_m: float | None


@dataclass(frozen=True)
class Step:
    """The held-out gap once the cause `added` (`effect@place`; None: the nominal model) is there beside those before it: RMS
    in m and px, each None where there is nothing to compare."""

    added: str | None
    rms_m: float | None
    rms_px: float | None = None


@dataclass(frozen=True)
class Gap:
    """RMS distance between predicted and observed markers, on postures whose whole region was held out of the fit; None where
    there is nothing to compare."""

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
    """As causes are added one by one in the order told, the nominal model first; empty in a document of version 1."""


@dataclass(frozen=True)
class Limit:
    """The largest size of an effect at a place that these postures would have hidden (95 %), by parameter, each alone; None:
    they would hide any size of it."""

    effect: str
    at: str
    parameters: Mapping[str, float | None]


@dataclass(frozen=True)
class Ranked:
    """A hypothesis of the first look: log Bayes factor against the nominal model, by the score test."""

    effect: str
    at: str
    log_bayes: float


@dataclass(frozen=True, eq=False, repr=False)
class Signature(ShortRepr):
    """The error at a place that each posture shows by itself (`error`, with `std`) and what the cause says (`fitted`).

    Arrays (K,), one value a posture; `unit` (rad or m) is that of error, std and fitted. `cause` is an index into the
    causes, or None for the part that no cause explains, of which `fitted` is the free-form error.
    """

    at: str
    unit: str
    cause: int | None
    frame: npt.NDArray[np.int64]
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
    frame: npt.NDArray[np.int64]
    values: Floats
    error: Floats
    std: Floats
    fitted: Floats


@dataclass(frozen=True, eq=False, repr=False)
class Field(ShortRepr):
    """What is left on average of corners and markers over the image, or of corners over the board: the signature of optics.

    Over the image, `at_points` (K, 2) are px and residuals (K, 2) px, seen less predicted. Over the board, `at_points` are m
    in its frame and residuals (K, 3) m, each corner's displacement. `of` names what was averaged at each
    place, `corners` or `markers`, and `count` (K,) how often; `size` (2,) is that of the image, or of the board's corners. `with_cause` is None where there is no cause to take away.
    """

    at: str
    over: str
    unit: str
    cause: int | None
    size: Floats
    at_points: Floats
    of: tuple[str, ...]
    count: npt.NDArray[np.int64]
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


@dataclass(frozen=True)
class Diagnosis:
    """Where the model is wrong, by which effect, and how far the gap shrinks."""

    verdict: str
    sentence: str
    causes: tuple[Cause, ...]
    where: tuple[Place, ...]
    gap: Gap
    next_postures: tuple[Mapping[str, float], ...] = ()
    """Commanded postures, joint name to rad (m), that would tell the rivals apart best."""
    warnings: tuple[str, ...] = ()
    noise: Mapping[str, float] = field(default_factory=dict)
    """Estimated noise, one axis: corners and markers in px, points in m, as the names say."""
    trace: tuple[str, ...] = ()
    ranking: tuple[Ranked, ...] = ()
    signatures: tuple[Signature, ...] = ()
    tracks: tuple[Track, ...] = ()
    """Signatures of errors with a direction."""
    fields: tuple[Field, ...] = ()
    """Signatures of lens, board and mirror."""
    witness: tuple[Witness, ...] = ()
    markers: tuple[SeenMarker, ...] = ()
    """Posture by posture, where they were asked for (`markers=True`)."""
    data: Data = Data()
    """What of the data was used, and what was left out."""
    limits: tuple[Limit, ...] = ()
    """What could have been seen: one entry for each effect and place; empty in a document of version 1."""
    interrupted: bool = False
    """Whether it was stopped before its end, and tells only what was found so far: no gap, no limits, rivals not weighed."""
    document: Mapping[str, Any] = field(default_factory=dict, repr=False)
    """The JSON tree as the core gave it, with all that the format does not know."""

    @classmethod
    def from_document(cls, tree: Mapping[str, Any]) -> Diagnosis:
        """A diagnosis from its JSON tree. Raises `MirrorPostureError` for a tree of another format."""
        version = tree.get("version")
        if tree.get("format") != FORMAT or isinstance(version, bool) or version not in VERSIONS:
            raise MirrorPostureError(
                f"got format {tree.get('format')!r} version {version!r}, needed {FORMAT!r} version "
                f"{' or '.join(map(str, VERSIONS))}"
            )
        if tree.get("verdict") not in VERDICTS:
            raise MirrorPostureError(
                f"verdict: got {tree.get('verdict')!r}, needed one of {', '.join(VERDICTS)}"
            )
        try:
            _check_containers(tree)
            return cls(
                verdict=tree["verdict"],
                sentence=tree.get("sentence", ""),
                causes=tuple(_cause(entry) for entry in tree["causes"]),
                where=tuple(_known(Place, entry) for entry in tree["where"]),
                gap=_gap(tree["gap"]),
                next_postures=tuple(dict(entry) for entry in tree.get("next_postures", ())),
                warnings=tuple(tree.get("warnings", ())),
                noise=dict(tree.get("noise", {})),
                trace=tuple(tree.get("trace", ())),
                ranking=tuple(_known(Ranked, entry) for entry in tree.get("ranking", ())),
                signatures=tuple(_signature(entry) for entry in tree.get("signatures", ())),
                tracks=tuple(_track(entry) for entry in tree.get("tracks", ())),
                fields=tuple(_field(entry) for entry in tree.get("fields", ())),
                markers=tuple(_known(SeenMarker, entry) for entry in tree.get("markers", ())),
                data=_data(tree.get("data", {})),
                limits=tuple(_limit(entry) for entry in tree.get("limits", ())),
                witness=tuple(_known(Witness, entry) for entry in tree.get("witness", ())),
                interrupted=tree.get("interrupted") is True,
                document=dict(tree),
            )
        except (KeyError, TypeError, AttributeError, ValueError, OverflowError) as error:
            raise MirrorPostureError(
                f"is no diagnosis of version {version}: {type(error).__name__}: {error}"
            ) from None

    @classmethod
    def load(cls, file: str | os.PathLike[str]) -> Diagnosis:
        """Reads `diagnosis.json`, or the folder that `mirror-posture diagnose --out` wrote.

        Raises `MirrorPostureError`, which names the file and what is wrong with it.
        """
        path = Path(file)
        if path.is_dir():
            path = path / "diagnosis.json"
        try:
            if not is_whole(path.parent):
                raise MirrorPostureError(
                    f"{path.parent}: was cut off while its files were replaced; run `mirror-posture diagnose` again"
                )
            tree = json.loads(read_text(path, LARGEST_DOCUMENT))
        except FileNotFoundError:
            raise MirrorPostureError(
                f"{path}: the file is missing; `mirror-posture diagnose` writes it"
            ) from None
        except (OSError, ValueError, RecursionError) as error:
            raise MirrorPostureError(f"{path}: cannot be read as JSON ({reason(error)})") from None
        if not isinstance(tree, Mapping):
            raise MirrorPostureError(f"{path}: got a {type(tree).__name__}, needed an object")
        try:
            return cls.from_document(tree)
        except MirrorPostureError as error:
            raise MirrorPostureError(f"{path}: {error}") from None

    def to_json(self) -> str:
        """The diagnosis as the public format has it."""
        return json.dumps(self.document, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


LISTS = (
    "causes",
    "where",
    "next_postures",
    "warnings",
    "trace",
    "ranking",
    "signatures",
    "tracks",
    "fields",
    "witness",
    "limits",
    "markers",
)
OF_CAUSES: dict[str, type] = {"alternatives": list, "members": list, "frames": list, "parameters": Mapping}


def _check_containers(tree: Mapping[str, Any]) -> None:
    """Refuses texts and objects where lists are needed: they would be read letter by letter, key by key."""
    if not isinstance(tree.get("sentence", ""), str):
        raise TypeError(f"sentence: got {tree['sentence']!r:.80}, needed a text")
    lists: list[tuple[str, Any, type]] = [(name, tree[name], list) for name in LISTS if name in tree]
    for cause in filter(_is_mapping, tree["causes"]):
        lists += [(name, cause[name], kind) for name, kind in OF_CAUSES.items() if name in cause]
    gap, data = tree.get("gap"), tree.get("data")
    if _is_mapping(gap):
        lists += [
            (f"gap.{name}", gap[name], list)
            for name in ("checked", "steps", "closed_ci95")
            if gap.get(name) is not None
        ]
    if _is_mapping(data) and "left_out" in data:
        lists.append(("data.left_out", data["left_out"], list))
    for name, value, kind in lists:
        if not isinstance(value, kind):
            raise TypeError(f"{name}: got {value!r:.80}, needed {'a list' if kind is list else 'an object'}")
    for name in ("trace", "warnings"):
        if not all(isinstance(line, str) for line in tree.get(name, ())):
            raise TypeError(f"{name}: got {tree[name]!r:.80}, needed texts")
    for numbers in (tree.get("noise", {}), *tree.get("next_postures", ())):
        if not _is_mapping(numbers) or not all(_is_of(value, ["float"]) for value in numbers.values()):
            raise TypeError(f"noise and next_postures: got {numbers!r:.80}, needed objects of numbers")
    interval = gap.get("closed_ci95") if _is_mapping(gap) else None
    if interval is not None and (len(interval) != 2 or not all(_is_of(end, ["float"]) for end in interval)):
        raise TypeError(f"gap.closed_ci95: got {interval!r:.80}, needed two numbers")


def _is_mapping(value: Any) -> TypeGuard[Mapping[str, Any]]:
    return isinstance(value, Mapping)


def _known(kind: type[Kind], entry: Mapping[str, Any]) -> Kind:
    """A dataclass from the keys that it knows, numbers and texts checked; a newer core may say more."""
    known = {f.name: str(f.type) for f in fields_of(kind)}  # type: ignore[arg-type]
    for name, needed in known.items():
        if name in entry and not _is_of(entry[name], needed.split(" | ")):
            raise TypeError(f"{kind.__name__.lower()}.{name}: got {entry[name]!r:.80}, needed {needed}")
    return kind(**{key: value for key, value in entry.items() if key in known})


def _is_of(value: Any, kinds: Sequence[str]) -> bool:
    """Whether a value is of one of the kinds, as far as they are plain ones."""
    if value is None:
        return "None" in kinds or not PLAIN.issuperset(kinds)
    if not PLAIN.issuperset(kinds):
        return True
    if isinstance(value, bool):
        return "bool" in kinds
    if isinstance(value, (int, float)):
        return ("float" in kinds or ("int" in kinds and isinstance(value, int))) and math.isfinite(value)
    return isinstance(value, str) and "str" in kinds


def _cause(entry: Mapping[str, Any]) -> Cause:
    parameters = {name: _known(Estimate, value) for name, value in entry["parameters"].items()}
    alternatives = tuple(_known(Alternative, value) for value in entry.get("alternatives", ()))
    members = tuple(_known(Member, value) for value in entry.get("members", ()))
    return _known(
        Cause,
        {
            **entry,
            "parameters": parameters,
            "alternatives": alternatives,
            "members": members,
            "frames": tuple(entry.get("frames", ())),
        },
    )


def _data(entry: Mapping[str, Any]) -> Data:
    left_out = tuple(_known(LeftOut, value) for value in entry.get("left_out", ()))
    return _known(Data, {**entry, "left_out": left_out})


def _gap(entry: Mapping[str, Any]) -> Gap:
    interval = entry.get("closed_ci95")
    return _known(
        Gap,
        {
            **entry,
            "closed_ci95": None if interval is None else tuple(interval),
            "checked": tuple(_known(Checked, value) for value in entry.get("checked", ())),
            "steps": tuple(_known(Step, value) for value in entry.get("steps", ())),
        },
    )


def _limit(entry: Mapping[str, Any]) -> Limit:
    for name, size in entry["parameters"].items():
        if not _is_of(size, ("float", "None")):
            raise TypeError(f"limit.{name}: got {size!r:.80}, needed a number or null")
    return _known(Limit, {**entry, "parameters": dict(entry["parameters"])})


def _signature(entry: Mapping[str, Any]) -> Signature:
    points = entry["points"]

    def column(name: str) -> Floats:
        return np.array([point[name] for point in points], dtype=float)

    names = ("position", "torque_nm", "direction", "time_s", "error", "std", "fitted")
    return Signature(
        at=entry["at"],
        unit=entry["unit"],
        cause=entry.get("cause"),
        other=entry.get("other"),
        other_position=column("other_position") if entry.get("other") else None,
        frame=np.array([point["frame"] for point in points], dtype=np.int64),
        **{name: column(name) for name in names},
    )


def _track(entry: Mapping[str, Any]) -> Track:
    points, components, against = entry["points"], entry["components"], entry["against"]

    def table(name: str, columns: int) -> Floats:
        return np.array([point[name] for point in points], dtype=float).reshape(len(points), columns)

    return Track(
        at=entry["at"],
        what=entry["what"],
        unit=entry["unit"],
        cause=entry.get("cause"),
        components=tuple(components),
        against=tuple(axis["name"] for axis in against),
        against_units=tuple(axis["unit"] for axis in against),
        frame=np.array([point["frame"] for point in points], dtype=np.int64),
        values=table("against", len(against)),
        **{name: table(name, len(components)) for name in ("error", "std", "fitted")},
    )


def _field(entry: Mapping[str, Any]) -> Field:
    points = entry["points"]
    axes = 2 if entry["over"] == "image" else 3

    def table(name: str, columns: int) -> Floats:
        return np.array([point[name] for point in points], dtype=float).reshape(len(points), columns)

    return Field(
        at=entry["at"],
        over=entry["over"],
        unit=entry["unit"],
        cause=entry.get("cause"),
        size=np.array(entry["size"], dtype=float),
        at_points=table("at", 2),
        of=tuple(point["of"] for point in points),
        count=np.array([point["count"] for point in points], dtype=np.int64),
        without=table("without", axes),
        std=table("std", axes),
        with_cause=table("with", axes) if points and "with" in points[0] else None,
    )
