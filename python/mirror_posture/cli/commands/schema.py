"""`mirror-posture schema`: the formats as JSON Schema."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from ..._core import MirrorPostureError
from ..output import JsonOption, Output

ORDER = 15
PANEL = "Sessions"
NEEDS_ARGUMENTS = False


def command(
    name: Annotated[
        str,
        typer.Argument(
            help="session, camera, servos-dynamixel, servos-feetech, plan or diagnosis; none lists them."
        ),
    ] = "",
    out: Annotated[
        Path | None, typer.Option(help="Folder for all schemas and the reference pages (Markdown).")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Print the JSON Schema of a format, for editors and other programs.

    The schemas are made from the definitions that the readers check by. Without a name all names are listed.

    Example: `mirror-posture schema session > session.schema.json`
    """
    output = Output(as_json)
    from ...reference import schemas, write_reference

    known = schemas()
    if name and name not in known:
        raise MirrorPostureError(f"got {name!r}, needed one of {', '.join(known)}")
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        files = write_reference(out)
        for file in files:
            output.say(f"written: {file}")
        output.result({"written": files})
    elif not name:
        for each in known:
            output.say(each)
        output.result(list(known))
    else:
        typer.echo(json.dumps(known[name], indent=1, ensure_ascii=False))
