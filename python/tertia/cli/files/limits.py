"""Limits of indicators, from a TOML file."""

from __future__ import annotations

import sys
from pathlib import Path

from tertia.cli.terminal.say import fail, reading
from tertia.metrics._indicators import LIMITED
from tertia.tables._text import decoded

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

# keys of the file, and the indicators that they limit
_UNITS = {"data_age": "_s", "pair_time_offset": "_s", "rmse": "_m", "large_error": "_m"}
_KEYS = {f"{name}{_UNITS.get(name, '')}": name for name in (*LIMITED, "large_error")}


def read_limits(path: Path | None) -> dict[str, float]:
    """Return the limits in a file by the names of their indicators; `source` is ignored."""
    if path is None:
        return {}
    try:
        with reading(path):
            document = tomllib.loads(decoded(path.read_bytes()))
    except ValueError as error:
        fail(f"cannot read {path}: {error}")
    document.pop("source", None)
    known = f"it may have {', '.join(_KEYS)} and source"
    for key, value in document.items():
        if key not in _KEYS:
            fail(f"{path} has {key!r}; {known}")
        if isinstance(value, bool) or not isinstance(value, int | float) or not value >= 0:
            fail(f"{path}: {key} is {value!r}; it must be a number that is not negative")
    return {_KEYS[key]: float(value) for key, value in document.items()}
