"""Reading of tables, recordings, sensors and plans from files."""

from __future__ import annotations

import codecs
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import polars as pl

from tertia import io
from tertia.cli.files import asterix
from tertia.cli.files.text import (
    Dialect,
    damage,
    foreign,
    has_strange_names,
    json_of,
    read_text,
    too_long,
)
from tertia.cli.terminal.say import WRONG_USAGE, fail, reading
from tertia.geo import LocalFrame, SystemPlane
from tertia.tables._described import REPORTS, Description, description
from tertia.tables._parts import AGAIN, Part, Source
from tertia.tables._sensors import Sensors
from tertia.tables._track import Recording, recording_of

if TYPE_CHECKING:
    from tertia.flightplan import FlightPlan
    from tertia.location import Station
    from tertia.tracker import Radar

JSON_LINES = (".jsonl", ".ndjson")
ARROW = (".arrow", ".feather")
# compressed files that Polars decompresses while it reads
_PACKED = (".gz", ".zst")
# binary formats, which have no blank rows
_BINARY = {".parquet": "Parquet", **dict.fromkeys(ARROW, "Arrow IPC")}
# flight plans in messages of ICAO
_MESSAGES = (".fpl", ".txt")
_ROWS_AT_ONCE = 2**17


# format of times in tables, from the option --time-format of all commands
TIME_FORMAT: ContextVar[str | None] = ContextVar("time_format", default=None)


def kind_of(path: Path) -> str:
    """Return the extension of a file name in lower case, without that of its compression."""
    suffix = path.suffix.lower()
    return path.with_suffix("").suffix.lower() if suffix in _PACKED else suffix


def has_lines(path: Path) -> bool:
    """Return whether a file has uncompressed lines of CSV or JSON, according to its name."""
    packed = path.suffix.lower() in _PACKED
    return not packed and kind_of(path) not in {*_BINARY, *asterix.SUFFIXES, ".json"}


def tables(*paths: Path) -> Source:
    """Return the tables in files."""
    return _all(paths)


def batches(
    path: Path, columns: Sequence[str], optional: Sequence[str] = ()
) -> Iterator[pl.DataFrame]:
    """Yield some columns of a file in batches of rows; nothing for formats without batches.

    Columns that are `optional` may be missing.

    Errors are those of Polars.
    """
    _refuse_pipe(path)
    kind = kind_of(path)
    if kind == ".parquet":
        rows = pl.scan_parquet(path, glob=False)
    elif kind in ARROW:
        rows = pl.scan_ipc(path, glob=False)
    elif kind == ".csv" and has_lines(path) and Dialect.of(path).is_plain:
        rows = pl.scan_csv(path, infer_schema=False, glob=False)
        header = rows.collect_schema().names()
        if any(name.endswith(AGAIN) for name in header) or has_strange_names(header):
            return
        # blank lines are not rows
        rows = rows.filter(~pl.all_horizontal(pl.all().is_null()))
    else:
        return
    there = [name for name in optional if name in rows.collect_schema()]
    wanted = rows.select(list(dict.fromkeys([*columns, *there])))
    yield from wanted.collect_batches(chunk_size=_ROWS_AT_ONCE, maintain_order=True)


def plots(*paths: Path) -> Source:
    """Return the plots in files: tables, or recordings in ASTERIX."""
    return _all(paths, asterix.plots)


def estimates(*paths: Path) -> Source:
    """Return estimates with their sigmas: tables, or system tracks in ASTERIX."""
    return _all(paths, asterix.tracks)


def truth(path: Path) -> Source:
    """Return the truth in a file: a table, or a recording in ASTERIX."""
    return _all([path], asterix.truth)


def _all(paths: Sequence[Path], of_asterix: Callable[[Path], Part] | None = None) -> Source:
    """Return the parts in files, at least one with rows; recordings in ASTERIX are converted."""
    parts = [
        of_asterix(one) if of_asterix and kind_of(one) in asterix.SUFFIXES else _table(one)
        for one in paths
    ]
    if not any(part.table.height for part in parts):
        listed = " and ".join(map(str, paths))
        fail(f"{listed} {'is' if len(paths) == 1 else 'are'} empty")
    return parts


def _table(path: Path) -> Part:
    """Return the table in a file, with times in the format of the option."""
    return replace(_rows(path), time_format=TIME_FORMAT.get())


def _rows(path: Path) -> Part:
    """Return the table in a file; columns of CSV remain text, for example 007."""
    _refuse_pipe(path)
    kind, frame = kind_of(path), _frame(path)
    if kind in _BINARY:
        return Part(frame, str(path), path.stem)
    if kind in JSON_LINES:
        return Part(frame, str(path), path.stem, 1)
    # blank lines of CSV files are not rows
    there = frame.select(~pl.all_horizontal(pl.all().is_null())).to_series()
    first = 2 + Dialect.of(path).comments
    if there.all():
        return Part(frame, str(path), path.stem, first)
    return Part(frame.filter(there), str(path), path.stem, first, there.arg_true().to_numpy())


def _refuse_pipe(path: Path) -> None:
    """Exit with an error if a path is not that of a file on a disk, which is read several times."""
    if str(path) == "-" or (path.exists() and not path.is_file() and not path.is_dir()):
        fail(
            f"cannot read {path}: it is standard input or a pipe; only tertia track --stream reads "
            "these: write the rows to a file first",
            WRONG_USAGE,
        )


def _frame(path: Path) -> pl.DataFrame:
    kind = kind_of(path)
    if path.is_dir():
        fail(f"cannot read {path}: it is a folder")
    if kind in asterix.SUFFIXES:
        fail(
            f"cannot read {path}: only tertia track, report and audit read ASTERIX, and tertia "
            "evaluate as the truth"
        )
    if kind == ".json":
        fail(f"cannot read {path}: tables are read from CSV, Parquet, Arrow or JSON lines")
    try:
        if kind in JSON_LINES:
            contents = path.read_bytes().removeprefix(codecs.BOM_UTF8)
            return pl.read_ndjson(contents, infer_schema_length=None)
        if kind in ARROW:
            with path.open("rb") as file:
                return pl.read_ipc(file)
        if kind in _BINARY:
            return pl.read_parquet(path, glob=False)
        other = foreign(path)
        if other is not None:
            fail(f"cannot read {path}: {other}")
        return read_text(path)
    except FileNotFoundError:
        fail(f"there is no file {path}", WRONG_USAGE)
    except OSError as error:
        if path.exists() and path.stat().st_size == 0:
            fail(f"{path} is empty")
        fail(f"cannot read {path}: {error.strerror or str(error).splitlines()[0]}")
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException) as error:
        _say_why(path, str(error).partition("\n")[0])


def _say_why(path: Path, error: str) -> NoReturn:
    """Exit with a message that says why Polars cannot read a file."""
    if path.stat().st_size == 0:
        fail(f"{path} is empty")
    kind, wrong = kind_of(path), damage(path)
    if wrong is not None:
        fail(f"cannot read {path}: {wrong}")
    reason = None if kind in {*_BINARY, *JSON_LINES} else too_long(path)
    if reason is not None:
        fail(f"cannot read {path}: {reason}")
    if kind in _BINARY:
        fail(f"cannot read {path}: it is not in {_BINARY[kind]} format, or is cut off: {error}")
    if kind in JSON_LINES and path.suffix.lower() not in _PACKED:
        for number, line in enumerate(path.read_bytes().splitlines(), start=1):
            text = line.decode("utf-8", "replace")
            if text.strip() and not isinstance(json_of(text), dict):
                fail(f"{path}, line {number}: each line must be a JSON object with the columns")
    fail(f"cannot read {path}: {error}")


def read_sensors(path: Path, source: Source = (), *, flat: bool = False) -> Sensors[Any]:
    """Return the radars of a sensors file, as `read_radars` does, and its other sensors."""
    found = _described(path).sensors(source, flat=flat)
    _require_described(path, source, found)
    return found


def read_radars(path: Path, source: Source = (), *, flat: bool = False) -> Sensors[Radar]:
    """Return the radars of a sensors file, completed from recordings; the earth may be flat."""
    described = _described(path)
    if described.has_kinds and described.rows(REPORTS):
        fail(f"{path} has [[{REPORTS}]] tables, which only `tertia track` without --udp can use")
    found = described.radars(source, flat=flat)
    _require_described(path, source, found)
    return found


def read_stations(path: Path, source: Source = ()) -> Sensors[Station]:
    """Return the stations of a sensors file; missing positions are taken from the recordings."""
    return _described(path).stations(source)


def recording(
    files: Sequence[Path] | None, sensors: Path, columns: Mapping[str, str], *, flat: bool
) -> Recording:
    """Return the plots in files, at least one, and the radars that measured them."""
    if not files:
        fail("give files of plots", WRONG_USAGE)
    given = plots(*files)
    return recording_of(given, read_radars(sensors, given, flat=flat), columns)


def _require_described(path: Path, source: Source, sensors: Sensors[Any]) -> None:
    """Exit with an error if recordings have plots of sensors that the file does not describe."""
    for part in source:
        seen = part.table["sensor"].unique().drop_nulls() if part.sensors else ()
        unknown = sorted(name for name in seen if name not in sensors.names)
        if unknown:
            fail(
                f"{part.file} has plots of {', '.join(unknown)}: add [[radar]] tables with these "
                f"names to {path}, with range_sigma_m and azimuth_sigma_deg"
            )


def _described(path: Path) -> Description:
    """Return the description of sensors in TOML, or in the rows of a table."""
    if path.suffix.lower() == ".toml":
        with reading(path):
            return description(path)
    part = _table(path)
    part.require("name")
    return Description(part.table.to_dicts(), str(path))


def plan_frame(
    origin: tuple[float, float] | None, sensors: Sensors[Any]
) -> LocalFrame | SystemPlane | None:
    """Return the frame of plans, at the given origin or at that of the sensors."""
    if origin is None:
        return sensors.frame
    return (SystemPlane if isinstance(sensors.frame, SystemPlane) else LocalFrame)(*origin)


def _messages(
    path: Path,
    frame: LocalFrame | SystemPlane | None,
    fixes: Path | None,
    airways: Path | None,
) -> list[Any]:
    """Return the plans in ICAO messages."""
    if fixes is None:
        fail(f"{path} has messages: give --fixes, a table of name, latitude_deg, longitude_deg")
    if frame is None:
        fail(f"{path} has places on the earth: give --origin, or sensors with a latitude")
    return io.read_fpl(path, fixes=fixes, airways={} if airways is None else airways, frame=frame)


def read_plans(
    path: Path | None,
    origin: tuple[float, float] | None,
    sensors: Sensors[Any],
    *,
    fixes: Path | None = None,
    airways: Path | None = None,
) -> list[FlightPlan]:
    """Return the plans of a file, at least one; their origin is that of the sensors."""
    if path is None:
        return []
    filed = path.suffix.lower() in _MESSAGES
    if not filed and (fixes or airways):
        fail(
            f"--fixes and --airways are only for messages ({', '.join(_MESSAGES)}), not for {path}"
        )
    frame = plan_frame(origin, sensors)
    try:
        with reading(path):
            plans: list[Any] = (
                _messages(path, frame, fixes, airways)
                if filed
                else io.read_plans(path, frame=frame)
            )
    except (ImportError, ValueError) as error:
        fail(str(error))
    if not plans:
        fail(f"{path} has no plans")
    return plans
