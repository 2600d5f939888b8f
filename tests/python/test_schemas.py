"""The schemas take what the readers take, and refuse what they refuse; each key is tried with values of every kind."""

from __future__ import annotations

import copy
import json
import math
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import tomli_w
import yaml

import mirror_posture as mp
from mirror_posture.diagnosis import Diagnosis
from mirror_posture.reference import pages, schemas, write_reference
from mirror_posture.robots import Nominal
from mirror_posture.robots.servo_config import load_config
from mirror_posture.session.camera_info import load_camera_info
from mirror_posture.session.metadata import load_metadata
from session_folder import CAMERA, SESSION
from test_pages import rich_document

try:
    import tomllib
except ImportError:  # pragma: no cover
    import tomli as tomllib

TRIED: tuple[Any, ...] = (
    *(True, "", " ", "x", "charuco", "unknown", "known", "board", [], {}, [1], [7, 4], [7, 101], [7, True], [7, 4, 2]),
    *(-1, 0, 1, 2, 4, 252, 253, -1.0, 0.0, 1e-9, 0.25, 0.499, 0.5, 1.0, 1.5, 3.0, 4.0, 19.9, 20.5, 180.5, 359.5, 1e7),
    *(math.inf, [0.0, 0.0, -9.81], [0.0, 0.0, "g"], "hold", "off", {"link": "x"}, [{"name": "a", "link": "b"}]),
)  # fmt: skip
"""Values of every kind; whole numbers as floats are not among those that are tried where a whole one is needed: a schema takes 7.0."""
GONE = object()


def variants(document: Any) -> Iterator[tuple[str, Any]]:
    """The document with one part taken away, replaced, or added."""
    places = list(_places(document, ()))
    for place in places:
        for value in (GONE, *TRIED):
            changed = copy.deepcopy(document)
            parent = changed
            for step in place[:-1]:
                parent = parent[step]
            if value is GONE:
                del parent[place[-1]]
            else:
                parent[place[-1]] = copy.deepcopy(value)
            yield f"{'.'.join(map(str, place))} = {value!r}", changed


def some(document: Any, step: int) -> list[tuple[str, Any]]:
    """One of so many of the variants (they are of 43 kinds: each place gets others); all of them with STEP=1 in the environment."""
    return list(variants(document))[:: min(step, int(os.environ.get("STEP", step)))]


def _places(part: Any, above: tuple[Any, ...]) -> Iterator[tuple[Any, ...]]:
    items = part.items() if isinstance(part, dict) else enumerate(part) if isinstance(part, list) else ()
    for key, value in items:
        yield (*above, key)
        yield from _places(value, (*above, key))


def compare(
    name: str,
    documents: list[tuple[str, Any]],
    read: Callable[[Any], object],
    beyond: Callable[[str], bool] = lambda message: False,
) -> tuple[int, int]:
    """Reads each document and validates it; how many were taken and refused. `beyond` are messages of what no schema can say."""
    validator = jsonschema.Draft202012Validator(schemas()[name])
    taken = refused = 0
    for what, document in documents:
        try:
            read(document)
            message = None
        except mp.MirrorPostureError as error:
            message = str(error)
        valid = validator.is_valid(document)
        if message is not None and beyond(message) and valid:
            continue
        if _whole_as_float(document, what) and valid and message is not None:
            continue
        assert valid == (message is None), f"{what}: the schema says {valid}, the reader {message!r}"
        taken, refused = taken + valid, refused + (not valid)
    return taken, refused


def _whole_as_float(document: Any, what: str) -> bool:
    value = what.rpartition(" = ")[2]
    return value.endswith(".0") or value == "10000000.0"


def test_session_toml(tmp_path: Path) -> None:
    document = tomllib.loads(SESSION)
    document["board"] |= {
        "marker_size": 0.01,
        "dictionary": "DICT_4X4_50",
        "tolerance_m": 0.003,
        "tolerance_rad": 0.02,
    }
    document["camera_mount"] |= {"tolerance_m": 0.003}
    document["markers"][0]["tolerance_m"] = 0.0
    document["frames"] = {"ordered": False}
    moon = document | {"gravity": {"vector": [0.0, 0.0, -162.0], "unit": "cm/s^2"}}

    def read(tree: Any) -> object:
        (tmp_path / "session.toml").write_bytes(tomli_w.dumps(tree).encode())
        return load_metadata(tmp_path)

    def beyond(message: str) -> bool:
        return any(
            words in message for words in ("got a length of", "is given twice", "needed less than the square")
        )

    assert read(document) and read(moon)
    documents = [
        ("as it is", document),
        *some(document, 5),
        *((w, d) for w, d in variants(moon) if w.startswith("gravity")),
    ]
    taken, refused = compare("session", documents, read, beyond)
    assert taken > 50 and refused > 300


def test_all_that_is_wrong_with_session_toml_is_told_at_once(tmp_path: Path) -> None:
    text = (
        SESSION.replace("0.014", "14.0")
        .replace("corners = [3, 2]", "corners = [1, 2]")
        .replace('link = "camera_optical"', "")
    )
    (tmp_path / "session.toml").write_text(text + "\n[frames]\nordered = 1\n", encoding="utf-8")
    with pytest.raises(mp.MirrorPostureError) as caught:
        load_metadata(tmp_path)
    told = [str(problem) for problem in caught.value.problems]  # type: ignore[attr-defined]
    assert len(told) == 4
    for words in ("camera_mount.link is missing", "board.corners", "board.square", "frames.ordered"):
        assert any(words in problem for problem in told), words


@pytest.mark.parametrize("make", ["dynamixel", "feetech"])
def test_servos_toml(make: str, tmp_path: Path) -> None:
    nominal = Nominal.load()
    limit = {"current_a": 0.3, "current_unit_a": 0.00269} if make == "dynamixel" else {"torque_share": 0.4}
    of_make = {"reversed": True} if make == "dynamixel" else {"homing_offset": -85}
    servo = {"id": 3, "zero_counts": 2048, "direction": -1, "lower_rad": -0.3, "upper_rad": 1.8, "counts_per_turn": 4096,
             "model": "X", "firmware": "45", **of_make}  # fmt: skip
    document = {
        "bus": {"port": "/dev/ttyUSB0", "baudrate": 1000000, "speed_rad_per_s": 0.5, "acceleration_rad_per_s2": 5.0,
                "tolerance_rad": 0.05, "at_end": "hold", "end_with_parent": False, **limit},
        "rest": {"r_elbow": 0.0},
        "joints": {"r_elbow": servo},
    }  # fmt: skip

    def read(tree: Any) -> object:
        (tmp_path / "servos.toml").write_bytes(tomli_w.dumps(tree).encode())
        return load_config(tmp_path / "servos.toml", nominal, make)  # type: ignore[arg-type]

    def beyond(message: str) -> bool:
        words = (
            "no such joint",
            "within the limits",
            "nothing is left",
            "in position control",
            "0 would mean no limit",
        )
        return any(word in message for word in words)

    assert read(document)
    taken, refused = compare(f"servos-{make}", [("as it is", document), *some(document, 3)], read, beyond)
    assert taken > 10 and refused > 100


@pytest.mark.parametrize("model", ["plumb_bob", "rational_polynomial"])
def test_the_camera_s_file(model: str, tmp_path: Path) -> None:
    document = yaml.safe_load(CAMERA)
    if model == "rational_polynomial":
        document["distortion_model"] = model
        document["distortion_coefficients"] = [0.01, -0.02, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0, 0.0]

    def read(tree: Any) -> object:
        (tmp_path / "camera.yaml").write_text(yaml.safe_dump(tree), encoding="utf-8")
        return load_camera_info(tmp_path / "camera.yaml")

    # A reader of YAML takes `1.0` as text, too, and refuses lenses that fold: those numbers stay as they are.
    lens = ("distortion_coefficients.data.", "distortion_coefficients.0", "distortion_coefficients.1")
    documents = [(w, d) for w, d in some(document, 5) if not w.startswith(lens) and "camera_name" not in w]
    assert read(document)
    taken, refused = compare(
        "camera", [("as it is", document), *documents], read, lambda message: "lens" in message
    )
    assert taken > 5 and refused > 40


def test_diagnosis_json() -> None:
    document = rich_document()
    for panel in ("signatures", "tracks", "fields"):
        del document[panel]
    documents = [("as it is", document), *some(document, 5)]
    # JSON has no infinity.
    kept = [(w, d) for w, d in documents if not w.endswith("= inf")]
    taken, refused = compare("diagnosis", kept, Diagnosis.from_document)
    assert taken > 30 and refused > 200


def test_the_reference_tells_every_key(tmp_path: Path) -> None:
    files = {file.name for file in write_reference(tmp_path)}
    assert files >= {"session.md", "servos.md", "camera.md", "plan.md", "diagnosis.md", "session.schema.json"}
    for name, schema in schemas().items():
        jsonschema.Draft202012Validator.check_schema(schema)
        assert json.loads((tmp_path / f"{name}.schema.json").read_text(encoding="utf-8")) == schema
        page = pages()[f"{name.partition('-')[0]}.md"]
        for key in _keys(schema):
            assert (
                f"`{key}`" in page
                or f"[{key}]" in page
                or f".{key}]" in page
                or f".{key}`" in page
                or key in ("format", "version", "data", "joints", "points")
            ), key


def _keys(schema: Any) -> Iterator[str]:
    if isinstance(schema, dict):
        yield from schema.get("properties", {})
    for part in schema.values() if isinstance(schema, dict) else schema if isinstance(schema, list) else ():
        yield from _keys(part)
