"""The command line, as tests run it and read what it prints."""

import re
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import polars as pl
from typer.testing import CliRunner

from tertia import cli


class Run(NamedTuple):
    """Exit code and what was printed."""

    code: int
    out: str
    err: str


def run(*arguments: object) -> Run:
    """Run `tertia` in this process."""
    result = CliRunner().invoke(cli.app, [str(part) for part in arguments], catch_exceptions=False)
    return Run(result.exit_code, result.stdout, result.stderr)


def succeed(*arguments: object) -> Run:
    """Run `tertia`, which must succeed."""
    done = run(*arguments)
    assert done.code == 0, done.err
    return done


def table(out: str) -> list[list[str]]:
    """Return the cells of the printed table, header first."""
    lines = [line for line in out.splitlines() if line.startswith("  ") and line.strip()]
    rows = [re.split(r"\s{2,}", line.strip()) for line in lines]
    return [row for row in rows if len(row) > 1]


def assert_column(found: pl.Series, expected: npt.ArrayLike) -> None:
    """Check a column to the last bit; it is null where the number is unknown."""
    numbers = np.asarray(expected, dtype=np.float64)
    known = np.isfinite(numbers)
    assert found.is_not_null().to_list() == known.tolist()
    np.testing.assert_array_equal(found.drop_nulls().to_numpy(), numbers[known])
