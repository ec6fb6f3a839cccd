"""Limits of indicators, from a TOML file."""

from __future__ import annotations

from pathlib import Path

from tertia.cli.terminal.say import fail
from tertia.cli.terminal.settings import document_of
from tertia.metrics._indicators import LIMITED

# keys of the file, and the indicators that they limit
_UNITS = {"data_age": "_s", "pair_time_offset": "_s", "rmse": "_m", "large_error": "_m"}
_KEYS = {f"{name}{_UNITS.get(name, '')}": name for name in (*LIMITED, "large_error")}


def read_limits(path: Path | None) -> dict[str, float]:
    """Return the limits in a file by the names of their indicators; `source` is ignored."""
    if path is None:
        return {}
    document = document_of(path)
    document.pop("source", None)
    known = f"it may have {', '.join(_KEYS)} and source"
    for key, value in document.items():
        if key not in _KEYS:
            fail(f"{path} has {key!r}; {known}")
        if isinstance(value, bool) or not isinstance(value, int | float) or not value >= 0:
            fail(f"{path}: {key} is {value!r}; it must be a number that is not negative")
    return {_KEYS[key]: float(value) for key, value in document.items()}
