"""The command line `mirror-posture`: one file a command, in `commands/`."""

from .app import app, main

__all__ = ["app", "main"]
