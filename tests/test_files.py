"""Files of every format, with every command: the same numbers, and one line per mistake."""

import gzip
import os
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from tertia import cli

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"
DATA = Path(os.environ.get("TERTIA_DATA", ROOT.parent / "shared" / "data"))
# how a table is written in each format, by others
WRITERS: dict[str, Callable[[pl.DataFrame, Path], object]] = {
    ".csv": lambda table, path: table.write_csv(path),
    ".csv.gz": lambda table, path: path.write_bytes(gzip.compress(table.write_csv().encode())),
    ".parquet": lambda table, path: table.write_parquet(path),
    ".arrow": lambda table, path: table.write_ipc(path),
    ".feather": lambda table, path: table.write_ipc(path, compression="zstd"),
    ".jsonl": lambda table, path: table.write_ndjson(path),
    ".ndjson": lambda table, path: table.write_ndjson(path),
    ".jsonl.gz": lambda table, path: path.write_bytes(gzip.compress(table.write_ndjson().encode())),
}
READERS: dict[str, Callable[[Path], pl.DataFrame]] = {
    ".parquet": pl.read_parquet,
    ".arrow": pl.read_ipc,
    ".feather": pl.read_ipc,
    ".jsonl": lambda path: pl.read_ndjson(path, infer_schema_length=None),
    ".csv": lambda path: pl.read_csv(path, infer_schema_length=None),
    ".json": lambda path: pl.read_json(path, infer_schema_length=None),
}


class Run(NamedTuple):
    code: int
    out: str
    err: str


def run(*arguments: object) -> Run:
    told = [str(argument) for argument in arguments]
    result = CliRunner().invoke(cli.app, told, catch_exceptions=False)
    return Run(result.exit_code, result.stdout, result.stderr)


class Command(NamedTuple):
    """A command on an example: what it reads, what else it is told, and a column of numbers."""

    name: str
    file: str
    options: tuple[object, ...]
    number: str


COMMANDS = {
    "bearing": Command(
        "bearing", "bearings.csv", ("--column", "bearing_deg", "--by", "target"), "bearing_deg"
    ),
    "fuse": Command(
        "fuse",
        "radars.csv",
        ("--sensor-column", "radar", "--sigma", "0.1", "--alpha", "0", "--acceleration-sigma", "0"),
        "azimuth_deg",
    ),
    "locate": Command(
        "locate", "measurements.csv", ("--stations", EXAMPLES / "stations.toml"), "azimuth_deg"
    ),
    "trajectory": Command(
        "trajectory", "measurements.csv", ("--stations", EXAMPLES / "stations.toml"), "azimuth_deg"
    ),
    "track": Command(
        "track", "air_plots.csv", ("--radars", EXAMPLES / "air_radars.toml"), "range_m"
    ),
    "evaluate": Command(
        "evaluate", "air_truth.csv", ("--truth", EXAMPLES / "air_truth.csv"), "east_m"
    ),
}
every_command = pytest.mark.parametrize("command", COMMANDS.values(), ids=list(COMMANDS))


def table(command: Command) -> pl.DataFrame:
    """Return what the command reads, with numbers as numbers."""
    frame = pl.read_csv(EXAMPLES / command.file, infer_schema_length=None)
    return frame.rename({"target": "track"}) if command.name == "evaluate" else frame


def results(path: Path, command: Command, folder: Path, suffix: str = ".parquet") -> pl.DataFrame:
    """Return what the command writes; the run must succeed."""
    output = folder / f"results{suffix}"
    done = run(command.name, path, *command.options, "--output", output)
    assert done.code == 0, done.err
    return READERS[suffix](output)


def alike(one: pl.DataFrame, other: pl.DataFrame, what: str) -> None:
    """Check that two tables hold the same numbers and the same text."""
    assert one.columns == other.columns, what
    assert one.height == other.height, what
    for name in one.columns:
        left, right = (
            frame[name].cast(pl.Float64, strict=False) if is_number else frame[name].cast(pl.String)
            for is_number in [other[name].dtype.is_numeric()]
            for frame in (one, other)
        )
        assert left.is_null().to_list() == right.is_null().to_list(), (what, name)
        if left.dtype == pl.Float64:
            np.testing.assert_array_equal(left.drop_nulls(), right.drop_nulls(), f"{what} {name}")
        else:
            assert left.to_list() == right.to_list(), (what, name)


@every_command
def test_every_format_gives_the_same_numbers(command: Command, tmp_path: Path) -> None:
    found = {}
    for suffix, write in WRITERS.items():
        path = tmp_path / f"in[1]{suffix}"
        write(table(command), path)
        found[suffix] = results(path, command, tmp_path)
    assert found[".csv"].height > 1
    for suffix, one in found.items():
        alike(one, found[".parquet"], suffix)


@every_command
def test_every_format_is_written(command: Command, tmp_path: Path) -> None:
    path = tmp_path / "in.parquet"
    table(command).write_parquet(path)
    whole = results(path, command, tmp_path)
    for suffix in READERS:
        alike(results(path, command, tmp_path, suffix), whole, suffix)
