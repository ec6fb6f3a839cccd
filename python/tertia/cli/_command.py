"""What all commands have in common: results for machines, and ends that are no errors of theirs."""

import contextlib
import errno
import functools
import inspect
import json
import math
import os
import sys
from collections.abc import Callable, Iterator
from typing import Annotated, Any

import numpy as np
import typer

from tertia.cli._terminal import FAILED, INTERRUPTED, note

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EPIPE)
_Json = Annotated[
    bool,
    typer.Option("--json", help="Print what is told as JSON on stdout; all else goes to stderr."),
]


def command(function: Callable[..., Any]) -> Callable[..., None]:
    """Return a command that ends in one line where it is interrupted.

    If the function returns something, the command has the option --json, which prints that.
    """
    told = inspect.signature(function)
    machine = told.return_annotation is not None

    @functools.wraps(function)
    def run(**options: Any) -> None:
        as_json = options.pop("json", False)
        try:
            if not as_json:
                function(**options)
            else:
                with contextlib.redirect_stdout(sys.stderr):
                    found = function(**options)
                typer.echo(json.dumps(_plain(found), ensure_ascii=False, allow_nan=False))
        except KeyboardInterrupt:
            note("tertia: interrupted")
            raise typer.Exit(INTERRUPTED) from None

    if machine:
        option = inspect.Parameter(
            "json", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=_Json
        )
        parameters = [*told.parameters.values(), option]
        run.__signature__ = told.replace(parameters=parameters)  # type: ignore[attr-defined]
        run.__annotations__ = function.__annotations__ | {"json": _Json}
    return run


@contextlib.contextmanager
def written_out() -> Iterator[None]:
    """End in one line where what is printed cannot be written, silently where nobody reads it."""
    try:
        try:
            yield
        finally:
            sys.stdout.flush()
    except OSError as error:
        if error.errno not in _FULL:
            raise
        # what is left in the buffer must not fail again
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if error.errno != errno.EPIPE:
            note(f"tertia: cannot write the output: {error.strerror}")
        sys.exit(FAILED)


def _plain(value: Any) -> Any:
    """Return numbers, texts, lists and dictionaries that JSON has; None in place of nan."""
    if isinstance(value, dict):
        return {str(key): _plain(part) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(part) for part in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    # dates
    return str(value)
