"""Which module may import which, read from the sources: functions' imports count as well."""

from __future__ import annotations

import ast
import functools
import re
import sys
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

import pytest

import mirror_posture

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

PYTHON = Path(__file__).resolve().parents[2] / "python"
PRODUCT = PYTHON / "mirror_posture"
LAB = PYTHON / "mirror_lab"
SIMULATION = PYTHON / "mirror_simulation"


@functools.cache
def tree(file: Path) -> ast.Module:
    return ast.parse(file.read_text(encoding="utf-8"))


@functools.cache
def imports(file: Path) -> set[str]:
    """Full names of the modules that a file imports, at its top or in a function."""
    inside = file.relative_to(PYTHON).with_suffix("").parts
    package = inside[:-1]
    found: set[str] = set()
    for node in ast.walk(tree(file)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        if isinstance(node, ast.ImportFrom):
            above = package[: len(package) - (node.level - 1)] if node.level else ()
            base = ".".join((*above, *(node.module or "").split("."))).strip(".")
            found |= {base} | {f"{base}.{alias.name}" for alias in node.names}
    return found


def within(name: str, package: str) -> bool:
    return name == package or name.startswith(package + ".")


@pytest.mark.parametrize("file", sorted(PRODUCT.rglob("*.py")), ids=lambda f: str(f.relative_to(PRODUCT)))
@pytest.mark.parametrize("other", ["mirror_lab", "mirror_simulation"])
def test_the_product_imports_nothing_of_the_other_distributions(file: Path, other: str) -> None:
    wrong = {name for name in imports(file) if within(name, other)}
    assert not wrong
    text = file.read_text(encoding="utf-8")
    assert f'import_module("{other}' not in text and f"{other}." not in text


@pytest.mark.parametrize("file", sorted(PRODUCT.rglob("*.py")), ids=lambda f: str(f.relative_to(PRODUCT)))
def test_the_product_executes_no_simulator(file: Path) -> None:
    """MuJoCo reads models and draws meshes here; steps in time are those of `mirror_simulation`."""
    called = {node.attr for node in ast.walk(tree(file)) if isinstance(node, ast.Attribute)}
    assert not called & {"mj_step", "mj_step1", "mj_step2", "rollout"}


@pytest.mark.parametrize(
    "file", sorted(SIMULATION.rglob("*.py")), ids=lambda f: str(f.relative_to(SIMULATION))
)
def test_the_simulation_imports_only_public_parts_of_the_product(file: Path) -> None:
    """Of the native module only a type; nothing of the judge that counts how often it is right."""
    outside = {name for name in imports(file) if not within(name, "mirror_simulation")}
    private = {
        name for name in outside if name.startswith("mirror_posture.") and re.search(r"\._(?!_)", name)
    }
    assert private <= {"mirror_posture._core", "mirror_posture._core.Measured"}
    assert not {name for name in outside if within(name, "mirror_lab")}


@pytest.mark.parametrize("file", sorted(LAB.rglob("*.py")), ids=lambda f: str(f.relative_to(LAB)))
def test_the_lab_imports_nothing_of_the_diagnosis(file: Path) -> None:
    wrong = {name for name in imports(file) if within(name, "mirror_posture.diagnosis")}
    assert not wrong
    # The one comparison of it with other tools has it at its side.
    if file != LAB / "moving" / "peers.py":
        assert not {name for name in imports(file) if within(name, "mirror_simulation")}


def test_this_reader_of_imports_sees_what_it_should() -> None:
    assert "mirror_posture.session.load_session" in imports(PRODUCT / "measurement" / "run.py") | imports(
        PRODUCT / "cli" / "commands" / "check.py"
    )
    assert "mirror_lab.blind.make" in imports(LAB / "commands" / "blind.py")
    assert "mirror_posture.session.load_session" in imports(SIMULATION / "commands" / "simulate.py")
    assert "mj_step" in (SIMULATION / "simulate" / "motion.py").read_text(encoding="utf-8")


POSIX_ONLY = {"fcntl", "grp", "pty", "pwd", "resource", "termios", "tty"}
"""Modules that Windows has not."""
POSIX_CALLS = {
    "fork",
    "getuid",
    "geteuid",
    "killpg",
    "setsid",
    "mkfifo",
    "chown",
    "O_NONBLOCK",
    "O_DIRECTORY",
    "O_NOFOLLOW",
    "SIGKILL",
    "SIGHUP",
    "SIGALRM",
}


def test_nothing_runs_on_posix_systems_alone() -> None:
    """Such a module is imported only where its absence is caught, such a name is asked for with `getattr` or after a test for it."""
    wrong = []
    for file in sorted(PYTHON.rglob("*.py")):
        nodes = list(ast.walk(tree(file)))
        guarded = {
            id(inner)
            for node in nodes
            if isinstance(node, ast.Try)
            for part in node.body
            for inner in ast.walk(part)
        }
        for node in nodes:
            names = {alias.name for alias in node.names} if isinstance(node, ast.Import) else set()
            if isinstance(node, ast.ImportFrom) and node.module:
                names.add(node.module)
            called = (
                isinstance(node, ast.Attribute)
                and isinstance(node.value, ast.Name)
                and node.value.id in ("os", "signal")
            )
            if (names & POSIX_ONLY and id(node) not in guarded) or (called and node.attr in POSIX_CALLS):
                wrong.append(f"{file.relative_to(PYTHON)}:{node.lineno}")
    assert not wrong


@pytest.mark.parametrize(
    ("folder", "needs"), [(LAB, []), (SIMULATION, ["mujoco>=3.3"])], ids=["lab", "simulation"]
)
def test_all_distributions_have_one_version(folder: Path, needs: list[str]) -> None:
    project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["dynamic"] == ["version", "dependencies"] and "version" not in project
    workspace = tomllib.loads((PYTHON.parent / "Cargo.toml").read_text(encoding="utf-8"))["workspace"]
    assert workspace["package"]["version"] == mirror_posture.__version__
    try:
        assert version(project["name"]) == mirror_posture.__version__
        # Entry points without a wheel say nothing of what they require.
        assert requires(project["name"]) in (None, [f"mirror-posture=={mirror_posture.__version__}", *needs])
    except PackageNotFoundError:
        pytest.skip("run from the sources, not from installed wheels")


@functools.cache
def graph(top: Path) -> dict[str, set[str]]:
    """The modules of a package and which of them each imports, in functions too; imports for types alone do not count."""
    files = {}
    for file in top.rglob("*.py"):
        name = ".".join(file.relative_to(PYTHON).with_suffix("").parts).removesuffix(".__init__")
        files[name] = file
    return {name: {m for m in _modules(file) if m in files and m != name} for name, file in files.items()}


def _modules(file: Path) -> set[str]:
    """Modules that a file imports: `from package import module` counts for the module, not for the package."""
    package = file.relative_to(PYTHON).parts[:-1]
    found: set[str] = set()

    def read(node: ast.AST) -> None:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test):
                continue
            if isinstance(child, ast.Import):
                found.update(alias.name for alias in child.names)
            if isinstance(child, ast.ImportFrom):
                above = package[: len(package) - (child.level - 1)] if child.level else ()
                base = ".".join((*above, *((child.module or "").split("."))))
                base = base.strip(".")
                for alias in child.names:
                    inside = PYTHON.joinpath(*base.split("."), alias.name)
                    whole = inside.with_suffix(".py").is_file() or inside.is_dir()
                    found.add(f"{base}.{alias.name}" if whole else base)
            read(child)

    read(tree(file))
    return found


def circles(modules: dict[str, set[str]]) -> list[list[str]]:
    """What is left when modules that import none of the others are taken away, again and again, from both ends."""
    left = {name: set(others) for name, others in modules.items()}
    while True:
        ends = {name for name, others in left.items() if not others & left.keys()}
        ends |= {name for name in left if not any(name in others for others in left.values())}
        if not ends:
            return [sorted(left)] if left else []
        for name in ends:
            del left[name]


def test_the_search_for_circles_finds_one() -> None:
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}) == [["a", "b", "c"]]
    assert circles({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == []


@pytest.mark.parametrize("top", [PRODUCT, LAB, SIMULATION], ids=lambda top: top.name)
def test_no_circle_of_imports(top: Path) -> None:
    assert circles(graph(top)) == []


# Who stands on whom: a package may import those of its own level (never in a circle) and of those before it.
LEVELS = (
    ("_core", "arrays", "board", "camera", "marker", "viewpoint", "pages", "formats"),
    ("mirror", "robot", "triangulate", "calibrate", "optics"),
    ("session",),
    ("view_check", "detect"),
    ("measurement", "robots", "render"),
    ("correct", "diagnosis"),
    ("fleet",),
    ("cli",),
    ("__main__",),
)


def test_no_arrow_points_upward() -> None:
    level = {name: height for height, names in enumerate(LEVELS) for name in names}
    wrong = []
    for name, others in graph(PRODUCT).items():
        own = name.split(".")[1] if "." in name else None
        for other in others:
            part = other.split(".")[1] if "." in other else None
            if own is None or part is None or own == part:
                continue
            if level.get(part, -1) > level.get(own, len(LEVELS)):
                wrong.append(f"{name} -> {other}")
    assert not wrong


def test_correction_and_diagnosis_do_not_import_each_other() -> None:
    modules = graph(PRODUCT)
    for own, other in (("correct", "diagnosis"), ("diagnosis", "correct")):
        for name in modules:
            if within(name, f"mirror_posture.{own}"):
                assert not any(within(m, f"mirror_posture.{other}") for m in modules[name]), name


def test_every_source_can_be_read_in_one_sitting() -> None:
    top = PYTHON.parent
    sources = [
        file for folder in ("crates", "python", "tests", "benches") for file in (top / folder).rglob("*.*")
    ]
    lengths = {
        str(file.relative_to(top)): len(file.read_text(encoding="utf-8").splitlines())
        for file in sources
        if file.suffix in (".rs", ".py")
    }
    assert len(lengths) > 1000
    assert not {file: length for file, length in lengths.items() if length > 500}
