"""The command line, as tests run it and read what it prints."""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
import polars as pl
from typer import testing
from typer.main import get_command

from tertia import cli, metrics

# all commands are built once, as that takes longer than most of them do
testing._get_command = cache(get_command)

Write: TypeAlias = Callable[..., Path]


class Run(NamedTuple):
    """Exit code and what was printed."""

    code: int
    out: str
    err: str


def run(*arguments: object) -> Run:
    """Run `tertia` in this process."""
    words = [str(part) for part in arguments]
    result = testing.CliRunner().invoke(cli.app, words, catch_exceptions=False)
    return Run(result.exit_code, result.stdout, result.stderr)


def succeed(*arguments: object) -> Run:
    """Run `tertia`, which must succeed."""
    done = run(*arguments)
    assert done.code == 0, done.err
    return done


def assert_refused(done: Run, message: str) -> None:
    """Check that nothing was printed but one line on stderr, with this message."""
    assert done.code in {1, 2}
    assert done.out == ""
    assert message in done.err
    assert done.err.count("\n") == 1


def result(command: str, *arguments: object, folder: Path) -> pl.DataFrame:
    """Return what a command writes, with full precision; it must succeed."""
    output = folder / "result.parquet"
    succeed(command, *arguments, "--output", output)
    return pl.read_parquet(output)


def rows_of(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a file that a command wrote."""
    if path.suffix == ".json":
        rows: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))
        return rows
    return {".csv": pl.read_csv, ".parquet": pl.read_parquet}[path.suffix](path).to_dicts()


def writer(folder: Path, header: str, name: str, rows: Sequence[str] = ()) -> Write:
    """Return what writes rows below a header to a file."""

    def write(rows: Sequence[str] = rows, header: str = header, name: str = name) -> Path:
        path = folder / name
        path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
        return path

    return write


def cell(value: float) -> str:
    """Return a number in a file of CSV; empty if it is unknown."""
    return "" if np.isnan(value) else repr(float(value))


def wide(
    times: npt.ArrayLike, names: Sequence[str], values: Mapping[str, Any], extra: str = ""
) -> list[str]:
    """Return rows of CSV of times, sensors and their measurements of all kinds, (steps, K)."""
    return [
        ",".join([f"{time}", name, *(cell(v[i, k]) for v in values.values())]) + extra
        for i, time in enumerate(np.asarray(times))
        for k, name in enumerate(names)
    ]


def indicators(tracks: pl.DataFrame, truth: pl.DataFrame, **options: float) -> Any:
    """Return the library's indicators of the updates of tracks in a table."""
    rows = tracks.filter(pl.col("confirmed") & pl.col("plot").is_not_null())
    updates = SimpleNamespace(
        time=rows["time_s"].to_numpy(),
        track=rows["track"].to_numpy(),
        position=rows.select("east_m", "north_m").to_numpy(),
    )
    places = truth.select("east_m", "north_m").to_numpy()
    targets = truth["target"].to_numpy().astype(str)
    true = metrics.Truth(truth["time_s"].to_numpy(), targets, places)
    return metrics.indicators(updates, true, **options)


def table(out: str) -> list[list[str]]:
    """Return the cells of the printed table, header first."""
    lines = [line for line in out.splitlines() if line.startswith("  ") and line.strip()]
    rows = [re.split(r"\s{2,}", line.strip()) for line in lines]
    return [row for row in rows if len(row) > 1]


def covariance_of(frame: pl.DataFrame, axes: Sequence[str]) -> npt.NDArray[np.float64]:
    """Return the covariances of positions in a table, (N, D, D)."""
    covariance = np.zeros((len(frame), len(axes), len(axes)))
    for i, a in enumerate(axes):
        covariance[:, i, i] = frame[f"{a}_sigma_m"].to_numpy() ** 2
        for j, b in enumerate(axes[:i]):
            covariance[:, i, j] = covariance[:, j, i] = frame[f"covariance_{b}_{a}_m2"].to_numpy()
    return covariance


def assert_column(found: pl.Series, expected: npt.ArrayLike) -> None:
    """Check a column to the last bit; it is null where the number is unknown."""
    numbers = np.asarray(expected, dtype=np.float64)
    known = np.isfinite(numbers)
    assert found.is_not_null().to_list() == known.tolist()
    np.testing.assert_array_equal(found.drop_nulls().to_numpy(), numbers[known])
