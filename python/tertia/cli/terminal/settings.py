"""Default options of commands, read from a file."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import typer

from tertia.cli.terminal.say import WRONG_USAGE, fail, reading
from tertia.tables._text import toml_of

# names of the files of measurements, which are arguments and not options
_FILES = ("file", "files")
_NONE = ("--settings", "--help")


def document_of(path: Path) -> dict[str, Any]:
    """Return the contents of a TOML file; exit with a message if it cannot be read."""
    try:
        with reading(path):
            return toml_of(path)
    except ValueError as error:
        fail(f"cannot read {path}: {error}")


def use(context: typer.Context, path: Path | None) -> Path | None:
    """Make the settings in a file the defaults of a command, first those in a table of its name."""
    if path is None:
        return None
    document = document_of(path)
    group = context.parent.command if context.parent else None
    commands: Mapping[str, Any] = getattr(group, "commands", {})
    own = document.get(str(context.info_name), {})
    if not isinstance(own, Mapping):
        fail(f"{path}: {context.info_name} is not a table of options", WRONG_USAGE)
    known = _options(context.command)
    # an option that only other commands have is ignored
    elsewhere = {*commands, *(name for one in commands.values() for name in _options(one))}
    common = {
        name: value for name, value in document.items() if name in known or name not in elsewhere
    }
    found = dict(context.default_map or {})
    for name, value in {**common, **own}.items():
        if name not in known:
            listed = ", ".join(sorted(known))
            fail(
                f"{path}: {name} is not an option of {context.info_name}; it has {listed}",
                WRONG_USAGE,
            )
        several = known[name].multiple or known[name].nargs == -1
        one = [value] if several and not isinstance(value, list) else value
        found[str(known[name].name)] = one
    context.default_map = found
    return path


def _options(command: Any) -> dict[str, Any]:
    """Return the parameters of a command by the names that a file may give."""
    return {
        option.removeprefix("--"): one
        for one in command.params
        for option in (*one.opts, *one.secondary_opts)
        if (option.startswith("--") or option in _FILES) and option not in _NONE
    }
