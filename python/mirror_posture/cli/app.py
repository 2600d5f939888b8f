"""The application: finds the commands, and converts every error to one line and an exit code."""

from __future__ import annotations

import os
import sys
import warnings
from typing import Annotated, Any

import typer

from .._core import MirrorPostureError
from .lazy_commands import LazyCommands
from .output import ExitCode, Output
from .streams import end, make_patient

_HELP = """
Measure, correct and diagnose a robot's posture in a flat mirror.

A *session* is a folder: the robot's model, its camera, and the pictures (or image points) of a sequence of
postures before a mirror. `mirror-posture demo` makes one and goes through all the steps in a minute.

Exit codes: 0 fine; 1 the input is invalid (one line says where and why); 2 the command was called wrongly;
3 nothing could be measured, or the target was not reached; 4 a fault of this program; 130 stopped with Ctrl-C.
"""

_DEBUG_VARIABLE = "MIRROR_POSTURE_DEBUG"


class _Commands(LazyCommands):
    """The commands; errors end here."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except MirrorPostureError as error:
            self._end(error, getattr(error, "exit_code", ExitCode.INPUT), str(error))
        except KeyboardInterrupt as error:
            self._end(error, ExitCode.STOPPED, "stopped")
        except OSError as error:
            place = f"{error.filename}: " if error.filename else ""
            told = error.strerror or str(error)
            if isinstance(error, (FileExistsError, NotADirectoryError)):
                told = "is a file, or lies in one, needed a folder; give another name"
            self._end(error, ExitCode.INPUT, f"{place}{told}")
        except (typer.Exit, typer.Abort):
            raise
        except Exception as error:
            # Usage errors of the argument parser print themselves, with the help that fits.
            if hasattr(error, "exit_code") and hasattr(error, "show"):
                raise
            text = " ".join(f"{type(error).__name__}: {error}".split())
            self._end(error, ExitCode.FAULT, f"a fault of this program ({text}); --debug shows where")

    @staticmethod
    def _end(error: BaseException, code: int, message: str) -> None:
        if _debug():
            raise error
        Output.current().fail(message, error, code)
        raise typer.Exit(code)


def _debug() -> bool:
    return bool(os.environ.get(_DEBUG_VARIABLE))


app = typer.Typer(
    name="mirror-posture",
    cls=_Commands,
    help=_HELP,
    rich_markup_mode="markdown",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(asked: bool) -> None:
    if asked:
        from .. import __version__

        print(f"mirror-posture {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    debug: Annotated[
        bool, typer.Option("--debug", help=f"Show the traceback of an error (also {_DEBUG_VARIABLE}=1).")
    ] = False,
    version: Annotated[
        bool, typer.Option("--version", help="Show the version.", callback=_version, is_eager=True)
    ] = False,
) -> None:
    if debug:
        os.environ[_DEBUG_VARIABLE] = "1"


def main() -> None:
    """Entry point of the command `mirror-posture`."""
    out = make_patient()
    # Pillow's, of pictures within the limit that holds here: the process is this command's own.
    warnings.filterwarnings("ignore", message="Image size .* exceeds limit")
    code: int | str | None = 0
    try:
        app()
    except SystemExit as error:
        code = error.code
    finally:
        why = end(out)
    if why is not None:
        print(
            f"error: standard output: cannot be written ({why}); files are written all the same",
            file=sys.stderr,
        )
    sys.exit(code or (int(ExitCode.INPUT) if why is not None else 0))
