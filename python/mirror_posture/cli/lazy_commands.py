"""The commands, each built when it is asked for: building all of them takes longer than most starts may."""

from __future__ import annotations

import importlib
import pkgutil
import sys
from collections.abc import Container, Mapping
from functools import cache
from types import ModuleType
from typing import Any

import typer
from typer.core import TyperGroup

from .._core import MirrorPostureError
from . import commands


class LazyCommands(TyperGroup):
    """Every module of `commands` and of other distributions, in the order of their `ORDER`."""

    def list_commands(self, ctx: Any) -> list[str]:
        modules = _all_modules()
        missing = {name: module for name, module in modules.items() if name not in self.commands}
        if missing:
            self.commands.update(_built(missing))
        return list(modules)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name not in self.commands and cmd_name in _own_names():
            self.commands.update(_built({cmd_name: _own_module(cmd_name)}))
        elif cmd_name not in self.commands:
            self.list_commands(ctx)
            _refuse_uninstalled(cmd_name, self.commands)
        return self.commands.get(cmd_name)


def _refuse_uninstalled(name: str, there: Container[str]) -> None:
    from .plugins import EXTRAS

    if name in EXTRAS and name not in there:
        raise MirrorPostureError(
            f"{name}: this command is not installed; pip install 'mirror-posture[{EXTRAS[name]}]'"
        )


def _own_names() -> list[str]:
    names = (found.name for found in pkgutil.iter_modules(commands.__path__))
    return [name.replace("_", "-") for name in names if not name.startswith("_")]


def _own_module(name: str) -> ModuleType:
    return importlib.import_module(f"{commands.__name__}.{name.replace('-', '_')}")


@cache
def _all_modules() -> dict[str, ModuleType]:
    """The modules by the commands' names; of two with one name that of this distribution."""
    from .plugins import COMMAND_GROUP, plugins

    modules = {name: _own_module(name) for name in _own_names()}
    for name, point in plugins(COMMAND_GROUP).items():
        try:
            modules.setdefault(name.replace("_", "-"), point.load())
        except ImportError as error:
            # A broken plug-in takes its own command away, not the others.
            print(
                f"warning: the command {name!r} of {point.value} cannot be loaded: {error}", file=sys.stderr
            )
    return dict(sorted(modules.items(), key=lambda item: item[1].ORDER))


def _built(modules: Mapping[str, ModuleType]) -> Mapping[str, Any]:
    """Each module's `command`, or its `group` of commands, as the argument parser holds it."""
    registry = typer.Typer(rich_markup_mode="markdown", pretty_exceptions_enable=False)
    for name, module in modules.items():
        if hasattr(module, "group"):
            registry.add_typer(module.group, name=name, rich_help_panel=module.PANEL, no_args_is_help=True)
            continue
        registry.command(
            name, rich_help_panel=module.PANEL, no_args_is_help=getattr(module, "NEEDS_ARGUMENTS", True)
        )(module.command)
    built: Mapping[str, Any] = typer.main.get_group(registry).commands
    return built
