"""Plots of radars in files: ranges and azimuths, which radar, height, identity."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import polars as pl

from tertia._units import FLIGHT_LEVEL, NAUTICAL_MILE
from tertia.cli import _asterix, _tables
from tertia.cli._measurements import doubt_degrees, numbers_of_names
from tertia.cli._radars import RadarSites
from tertia.cli._terminal import WRONG_USAGE, fail, note
from tertia.tables._track_rows import IDENTITIES, Clock, Identities
from tertia.tracker import NO_IDENTITY, Plots

TIME, AZIMUTH, RADAR = "time_s", "azimuth_deg", "radar"
# columns of which one is taken, the first that is there, and their units
RANGES = {"range_m": 1.0, "range_nm": NAUTICAL_MILE}
HEIGHTS = {"height_m": 1.0, "flight_level": FLIGHT_LEVEL}
DIGITS_TOLD = {16: "hexadecimal digits", 8: "octal digits", 10: "a whole number, 0 or more"}
NAMES = (TIME, AZIMUTH, RADAR, *RANGES, *HEIGHTS, *IDENTITIES)
# as many plots tell whether a unit is right: medians below or above which it hardly is
_DOUBTFUL_COUNT = 20
_LEAST_RANGE = 1000.0
_MOST = {
    "range_nm": (1000.0, "nautical miles", "metres"),
    "height_m": (20_000.0, "metres", "feet"),
    "flight_level": (1000.0, "hundreds of feet", "feet"),
}


@dataclass(frozen=True, slots=True)
class Recording:
    """The plots of all files, in their order, and what their times and identities look like.

    `remarks` are what there is to say of the files.
    """

    plots: Plots
    clock: Clock
    identities: Identities
    remarks: Sequence[str] = ()


def column_names(options: Sequence[str]) -> dict[str, str]:
    """Return the columns that options NAME=COLUMN give, by name."""
    columns: dict[str, str] = {}
    for option in options:
        name, separator, column = option.partition("=")
        if not separator or name not in NAMES or not column:
            names = ", ".join(NAMES)
            fail(f"--column is {option!r}; it must be NAME=COLUMN, NAME of {names}", WRONG_USAGE)
        if name in columns:
            fail(f"--column gives {name} twice", WRONG_USAGE)
        columns[name] = column
    return columns


def open_files(files: Sequence[Path], columns: Mapping[str, str]) -> "list[PlotFile]":
    """Read all files, and find the columns that are given."""
    return [_open(path, columns) for path in files]


def _open(path: Path, columns: Mapping[str, str]) -> "PlotFile":
    needed = {TIME: TIME, AZIMUTH: AZIMUTH, **columns}
    if _tables.kind_of(path) not in _tables.ASTERIX:
        return PlotFile(path, _tables.read(path, needed.values()), columns)
    frame, told, remarks = _asterix.plots_and_radars(path)
    _tables.require_columns(frame, path, needed.values())
    return PlotFile(path, frame, columns, told, remarks)


def told_of_radars(files: "Sequence[PlotFile]") -> _asterix.Told:
    """Return what recordings tell of their radars, the first of them first."""
    return {name: row for one in reversed(files) for name, row in one.told.items()}


def recording_of(opened: "Sequence[PlotFile]", sites: RadarSites) -> Recording:
    """Return the plots of all files, by these radars."""
    files = [one.path for one in opened]
    columns = opened[0].columns
    identities = [one.first_of(IDENTITIES) for one in opened]
    for path, name in zip(files, identities, strict=True):
        if name != identities[0]:
            told = f"{identities[0] or 'no identities'}, {path} {name or 'none'}"
            fail(f"{files[0]} has {told}; one kind of them is told apart")
    rows = _tables.stacked(
        files,
        [_rows(one, sites) for one in opened],
        columns.get(TIME, TIME),
        [],
    )
    doubt_degrees(rows["azimuth"].to_numpy())
    clock = Clock.of(rows["time"])
    radar = rows["radar"].to_numpy()
    plots = Plots(
        clock.seconds(rows["time"]),
        rows["range"].to_numpy(),
        np.radians(rows["azimuth"].to_numpy()) + sites.norths[radar],
        sensor=radar,
        height=rows["height"].to_numpy(),
        identity=rows["identity"].to_numpy(),
    )
    remarks = [remark for one in opened for remark in one.remarks]
    return Recording(plots, clock, Identities(identities[0] or "identity"), remarks)


@dataclass(frozen=True, slots=True)
class PlotFile:
    """A file, how its columns are named there, and what it tells of radars."""

    path: Path
    frame: pl.DataFrame
    columns: Mapping[str, str]
    told: _asterix.Told = field(default_factory=dict)
    remarks: Sequence[str] = ()

    def __getitem__(self, name: str) -> pl.Series:
        return self.frame[self.columns.get(name, name)]

    def has(self, name: str) -> bool:
        """Return whether there is such a column."""
        return self.columns.get(name, name) in self.frame.columns

    def first_of(self, names: Mapping[str, object]) -> str | None:
        """Return the first that is given, or else the first that is there."""
        given = [name for name in names if name in self.columns]
        return next(iter(given or [name for name in names if self.has(name)]), None)

    def numbers(self, name: str) -> pl.Series:
        """Return numbers, nan where missing."""
        return _tables.numbers(self[name], self.path)

    def quantity(self, units: Mapping[str, float]) -> pl.Series:
        """Return one of several columns in the units of the library, nan without any."""
        name = self.first_of(units)
        if name is None:
            return pl.repeat(math.nan, self.frame.height, eager=True, dtype=pl.Float64)
        values = self.numbers(name)
        doubt_unit(name, values)
        return values * units[name]


def _rows(file: PlotFile, sites: RadarSites) -> pl.DataFrame:
    path, frame = file.path, file.frame
    if file.first_of(RANGES) is None:
        wanted = f"{' or '.join(RANGES)}; {_tables.told_columns(frame)}"
        fail(f"{path} has no column {wanted}", WRONG_USAGE)
    rows = pl.DataFrame(
        {
            "time": _tables.times(file[TIME], path),
            "range": file.quantity(RANGES),
            "azimuth": file.numbers(AZIMUTH),
            "radar": _radar_numbers(file, sites),
            "height": file.quantity(HEIGHTS),
            "identity": _identities(file),
        }
    )
    there = _tables.is_row(frame, path)
    nowhere = (there & rows["time"].is_null()).arg_true()
    if len(nowhere):
        fail(f"{_tables.place(path, nowhere[0])}: {file[TIME].name} is missing")
    return rows.filter(there)


def _radar_numbers(file: PlotFile, sites: RadarSites) -> pl.Series:
    names = sites.names
    if file.told:
        _require_known(file, sites)
    if file.has(RADAR):
        told = f"the radars of {sites.path} are"
        return numbers_of_names(file.frame, file.path, file[RADAR].name, names, told)
    if len(names) > 1:
        fail(
            f"{file.path} has no column {RADAR}, but {sites.path} has {len(names)} radars: "
            f"{', '.join(names)}",
            WRONG_USAGE,
        )
    return pl.repeat(0, file.frame.height, eager=True, dtype=pl.Int64)


def _require_known(file: PlotFile, sites: RadarSites) -> None:
    """Fail where a recording has plots of radars that nobody described."""
    unknown = [name for name in file.frame["radar"].unique().sort() if name not in sites.names]
    if unknown:
        fail(
            f"{file.path} has plots of {', '.join(unknown)}: add [[radar]] tables with these names "
            f"to {sites.path}, with range_sigma_m and azimuth_sigma_deg"
        )


def _identities(file: PlotFile) -> pl.Series:
    """Return identities as numbers, -1 where there is none."""
    name = file.first_of(IDENTITIES)
    if name is None:
        return pl.repeat(NO_IDENTITY, file.frame.height, eager=True, dtype=pl.Int64)
    column = file[name]
    if column.dtype.is_float():
        column = _tables.numbers(column, file.path).fill_nan(None).cast(pl.Int64, strict=False)
    text = _tables.without_marks(column.cast(pl.String))
    found = Identities(name).numbers(text)
    wrong = (text.is_not_null() & found.is_null()).arg_true()
    if len(wrong):
        place = _tables.place(file.path, wrong[0])
        kind = DIGITS_TOLD[IDENTITIES[name]]
        fail(f"{place}: {file[name].name} is {text[wrong[0]]!r}; it must be {kind}")
    return found.fill_null(NO_IDENTITY)


def doubt_unit(name: str, values: pl.Series) -> None:
    """Say that a unit looks wrong."""
    known = values.filter(values.is_not_nan()).abs()
    if len(known) < _DOUBTFUL_COUNT:
        return
    typical = float(np.median(known.to_numpy()))
    if name == "range_m" and typical < _LEAST_RANGE:
        note(
            f"half of the ranges are below {typical:.3g}: are they kilometres or nautical miles? "
            "range_m is in metres"
        )
    most, unit, other = _MOST.get(name, (math.inf, "", ""))
    if typical > most:
        note(f"{name} is {typical:.6g} in the median: is it in {other}? It should be in {unit}")
