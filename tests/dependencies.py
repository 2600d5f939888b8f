"""What the wheel needs from elsewhere, with an extra of pyproject.toml: so it can be installed while the wheel is still compiled.

`python tests/dependencies.py test` prints it line by line, as pip reads it.
"""

from __future__ import annotations

import sys
from pathlib import Path

try:
    import tomllib
except ImportError:  # Python 3.10
    from pip._vendor import tomli as tomllib  # type: ignore[no-redef]

OURS = "mirror-posture"


def main() -> None:
    extra = sys.argv[1]
    root = Path(__file__).resolve().parents[1]
    project = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    needed = [*project["dependencies"], *project["optional-dependencies"][extra]]
    print("\n".join(one for one in needed if not one.startswith(OURS)))


if __name__ == "__main__":
    main()
