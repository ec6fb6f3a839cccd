"""Common behaviour of all commands: JSON output, error messages and exit codes."""

import contextlib
import errno
import functools
import inspect
import json
import math
import os
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import polars as pl
import typer

from tertia.cli.files.read import TIME_FORMAT
from tertia.cli.terminal import settings
from tertia.cli.terminal.options import input_file, option
from tertia.cli.terminal.say import FAILED, INTERRUPTED, WRONG_USAGE, fail, note
from tertia.tables import ColumnError, RecordError, RecordWarning

# options that name output files
_RESULTS = ("output", "plot_file", "measurements", "targets")
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EPIPE)
_Json = Annotated[
    bool,
    option("Print the results as JSON on stdout, and everything else on stderr.", "--json"),
]


_TimeFormat = Annotated[
    str | None,
    option(
        "Format of times, such as %d.%m.%Y %H:%M:%S; by default seconds, times of day or ISO 8601.",
        "--time-format",
        metavar="FORMAT",
    ),
]
_Settings = Annotated[
    Path | None,
    input_file(
        "File of options, .toml; options of the command line take precedence.",
        "--settings",
        is_eager=True,
        callback=settings.use,
    ),
]


def command(function: Callable[..., Any]) -> Callable[..., None]:
    """Return a command that reports each error in one line, also if it is interrupted.

    All commands have --settings and --time-format. If the function returns something, the command
    has the option --json, which prints the result.
    """
    signature = inspect.signature(function)
    machine = signature.return_annotation is not None

    @functools.wraps(function)
    def run(**options: Any) -> None:
        as_json = options.pop("json", False)
        options.pop("settings")
        time_format = TIME_FORMAT.set(options.pop("time_format"))
        try:
            with _mistakes():
                _keep_measurements(options)
                if not as_json:
                    function(**options)
                    return
                with contextlib.redirect_stdout(sys.stderr):
                    found = function(**options)
            typer.echo(json.dumps(_plain(found), ensure_ascii=False, allow_nan=False))
        except KeyboardInterrupt:
            note("tertia: interrupted")
            raise typer.Exit(INTERRUPTED) from None
        finally:
            TIME_FORMAT.reset(time_format)

    common = {"time_format": (_TimeFormat, None), "settings": (_Settings, None)}
    added = common | ({"json": (_Json, False)} if machine else {})
    parameters = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=kind)
        for name, (kind, default) in added.items()
    ]
    run.__signature__ = signature.replace(  # type: ignore[attr-defined]
        parameters=[*signature.parameters.values(), *parameters]
    )
    run.__annotations__ = function.__annotations__ | {name: one[0] for name, one in added.items()}
    return run


def _keep_measurements(options: Mapping[str, Any]) -> None:
    """Refuse a result that would overwrite an input."""
    given = dict.fromkeys(options.get("files") or [options.get("file")], "measurements")
    given |= {options.get(name): name for name in ("tracks", "truth", "bearings")}
    for result in (options.get(name) for name in _RESULTS):
        for path, what in given.items():
            # a name that is too long is reported when it is used
            with contextlib.suppress(OSError):
                if isinstance(result, Path) and isinstance(path, Path) and result.samefile(path):
                    fail(f"cannot write {result}: it contains the {what}", WRONG_USAGE)


@contextlib.contextmanager
def _mistakes() -> Iterator[None]:
    """Print warnings about records, and exit with a one-line message after an error.

    The records have been checked at this point, so an error of the library is due to an option.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("always", UserWarning)
        show, said = warnings.showwarning, set[str]()

        def say(message: Any, category: type[Warning], *where: Any, **more: Any) -> None:
            if issubclass(category, RecordWarning):
                note(str(message))
            elif category is not UserWarning:
                show(message, category, *where, **more)
            elif str(message) not in said:
                # a warning of the library, perhaps about each of many targets
                said.add(str(message))
                note(str(message))

        warnings.showwarning = say
        try:
            yield
        except ColumnError as error:
            fail(str(error), WRONG_USAGE)
        except (RecordError, np.linalg.LinAlgError, ImportError) as error:
            fail(str(error))
        except OSError as error:
            # an error without a file name belongs to a pipe
            if error.filename is None:
                raise
            fail(f"cannot use {error.filename}: {error.strerror}")
        except ValueError as error:
            fail(str(error), WRONG_USAGE)


@contextlib.contextmanager
def written_out() -> Iterator[None]:
    """Exit with a message if output cannot be written, but silently if the pipe was closed."""
    try:
        try:
            yield
        finally:
            sys.stdout.flush()
    except OSError as error:
        if error.errno not in _FULL:
            raise
        # the rest of the buffer must not cause the same error again
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if error.errno != errno.EPIPE:
            note(f"tertia: cannot write the output: {error.strerror}")
        sys.exit(FAILED)


def _plain(value: Any) -> Any:
    """Return a value as numbers, texts, lists and dictionaries for JSON; nan becomes None."""
    if isinstance(value, pl.DataFrame):
        value = value.to_dicts()
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
