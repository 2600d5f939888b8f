"""The installed package: typed, complete, of one binary for all Python versions."""

from __future__ import annotations

import importlib.metadata
from importlib.resources import files

import pytest

import mirror_posture
from mirror_posture import _core


def test_the_package_is_typed_and_carries_its_data() -> None:
    package = files("mirror_posture")
    for name in ("py.typed", "_core.pyi", "embedded/robot.urdf", "embedded/camera.yaml"):
        assert package.joinpath(name).is_file(), name


def test_one_binary_serves_all_python_versions() -> None:
    assert _core.__file__.endswith(".abi3.so") or _core.__file__.endswith(".pyd")


def test_everything_exported_is_there_and_documented() -> None:
    for name in mirror_posture.__all__:
        thing = getattr(mirror_posture, name)
        if not name.startswith("__"):
            assert thing.__doc__, f"{name} has no docstring"


def test_the_installed_distribution_has_the_version_of_the_core() -> None:
    try:
        version = importlib.metadata.version("mirror-posture")
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("run from the sources, not from an installed wheel")
    assert version == mirror_posture.__version__ == _core.__version__
