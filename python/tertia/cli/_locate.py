"""`tertia locate`: positions of single instants from what several stations measured."""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import polars as pl
import typer

from tertia import plot
from tertia._arrays import FloatArray
from tertia.cli import _maps, _positions, _tables
from tertia.cli._measurements import (
    Columns,
    Record,
    by_target,
    check_columns,
    read_measurements,
    taken,
)
from tertia.cli._options import (
    By,
    Measured,
    MeasurementFile,
    PlotFile,
    PositionFile,
    StationColumn,
    StationFile,
    TimeColumn,
)
from tertia.cli._stations import UNITS, Sites, read_stations
from tertia.cli._terminal import FAILED, WRONG_USAGE, fail, group_name, tracked
from tertia.location import Location, LocationMethod
from tertia.location import locate as locate_instants
from tertia.sensors import ByKind, Kind

if TYPE_CHECKING:
    from matplotlib.figure import FigureBase

EXAMPLES = (
    "tertia locate measurements.csv --stations stations.toml --output positions.csv",
    "tertia locate bearings.csv --stations finders.csv --by target --plot positions.png",
    "tertia locate ranges.csv --stations two.toml --initial 1200,3400 --method least-squares",
)
_PANELS_HEIGHT = 8.0
# what a picture of one instant shows
_DRAWN: tuple[Kind, ...] = ("azimuth", "range")


@dataclass(frozen=True, slots=True)
class _Located:
    """A target, where it was at each time, and what its measurements have to do with it."""

    record: Record
    result: Location
    judged: pl.DataFrame


def locate(
    files: Measured,
    *,
    stations: StationFile,
    time_column: TimeColumn = "time_s",
    station_column: StationColumn = "station",
    by: By = None,
    method: Annotated[LocationMethod, typer.Option(help="How to locate.")] = "robust",
    initial: Annotated[
        str | None,
        typer.Option(
            metavar="EAST,NORTH[,UP]",
            help="A position in metres near the target, where several explain the measurements.",
        ),
    ] = None,
    output: PositionFile = None,
    measurements: MeasurementFile = None,
    plot_file: PlotFile = None,
) -> dict[str, Any]:
    """Locate a target at every instant by ranges, azimuths, elevations or range differences.

    One row per station and time, with range_m, azimuth_deg, elevation_deg or range_difference_m;
    or one per measurement, with kind and value. Measurements of equal times make an instant.
    """
    columns = Columns(time_column, station_column, list(dict.fromkeys(by or [])))
    check_columns(columns, _positions.result_columns())
    _tables.check_suffixes(output, plot_file, measurements, maps=_maps.SUFFIXES)
    sites = read_stations(stations)
    _maps.check(output, sites.places, stations)
    start = None if initial is None else _start(initial, sites)
    records = by_target(read_measurements(files, columns, sites), columns, sites)
    located = [_locate(one, sites, method, start) for one in tracked(records, "Locating")]

    summaries = [_positions.summary(one.record, one.judged) for one in located]
    _positions.print_summary(pl.concat(summaries), columns.by)
    _positions.say_origin(sites)
    for one in located:
        _say(one)
    if output is not None:
        rows = pl.concat([_rows(one, sites, columns) for one in located])
        if _maps.is_map(output):
            _maps.write(_points(rows, columns), output, "position")
        else:
            _tables.write(rows, output)
    if measurements is not None:
        tables = [_positions.measurement_rows(one.judged, one.record, columns) for one in located]
        _tables.write(pl.concat(tables), measurements)
    if plot_file is not None:
        _draw(located, sites, columns, plot_file)
    if not any(np.any(one.result.success) for one in located):
        raise typer.Exit(FAILED)
    return {"stations": pl.concat(summaries).to_dicts()}


def _start(text: str, sites: Sites) -> FloatArray:
    d = sites.places.positions.shape[1]
    try:
        start = np.array([float(part) for part in text.split(",")])
    except ValueError:
        start = np.array([math.nan])
    if start.size != d or not np.all(np.isfinite(start)):
        told = (
            f"--initial is {text!r}; it must be {d} numbers, as many as stations have coordinates"
        )
        fail(told, WRONG_USAGE)
    return start


def _locate(
    record: Record, sites: Sites, method: LocationMethod, start: FloatArray | None
) -> _Located:
    if not record.values:
        fail(f"{record.name}: nothing was measured")
    sigmas = _positions.all_sigmas(record, sites, optional=True)
    # their sigmas are those that are given
    stations = sites.stations(sigmas={})
    options: dict[str, Any] = {str(kind): values for kind, values in record.measured().items()}
    options |= {f"{kind}_sigma": taken(kind, sigma) for kind, sigma in sigmas.items()}
    try:
        result = locate_instants(stations, **options, method=method, initial=start)
    except ValueError as error:
        fail(": ".join(filter(None, [record.name, str(error)])))
    judged = _positions.judged(record, sites, result.residual, result.outlier, result)
    return _Located(record, result, judged)


def _say(one: _Located) -> None:
    result = one.result
    _positions.say_located(one.record, result, result.position, result.sigma)
    if result.measurement_sigma is not None:
        [kind] = one.record.values
        unit, factor = UNITS[kind]
        sigma = np.asarray(result.measurement_sigma)
        known = sigma[np.isfinite(sigma)]
        if known.size:
            typer.echo(
                f"  sigma of {kind} was not stated: estimated at each instant, "
                f"median {np.median(known) / factor:.3g} {unit}"
            )


def _rows(one: _Located, sites: Sites, columns: Columns) -> pl.DataFrame:
    """Return one row per time, null for what is not known."""
    record, result = one.record, one.result
    told = {
        columns.time: record.moments,
        **_positions.coordinates(result.position, result.covariance),
        **_positions.geodetic(result.position, sites),
        **_positions.covariances(result.covariance),
        **_positions.instants(record, one.judged, result),
    }
    return _tables.beside(record.keys, pl.DataFrame(told))


def _point_name(row: dict[str, object], columns: Columns) -> str:
    return group_name([*columns.by, columns.time], [row[n] for n in (*columns.by, columns.time)])


def _points(rows: pl.DataFrame, columns: Columns) -> list[_maps.Feature | None]:
    """Return positions as points on a map."""
    return [
        _maps.feature(rows[at], columns.time, _point_name(row, columns), row)
        for at, row in enumerate(rows.iter_rows(named=True))
    ]


def _draw(located: list[_Located], sites: Sites, columns: Columns, path: Path) -> None:
    stations = sites.stations()

    def draw_one(at: int, figure: "FigureBase") -> None:
        record, result = located[at].record, located[at].result
        if record.times.size == 1 and np.all(result.success):
            _draw_instant(record, result, sites, figure)
            return
        panels = plot.trajectory(stations, result, time=record.moments.to_numpy(), figure=figure)
        _positions.name_panels(panels, record, columns)

    _positions.draw(path, [one.record.name for one in located], draw_one, _PANELS_HEIGHT)


def _draw_instant(record: Record, result: Location, sites: Sites, figure: "FigureBase") -> None:
    """Draw the rays and arcs that the only position was made of."""
    marks = (getattr(result.outlier, kind) for kind in UNITS)
    only = replace(
        result,
        position=result.position[0],
        covariance=result.covariance[0],
        outlier=ByKind(*(None if mark is None else mark[0] for mark in marks)),
    )
    azimuth, ranges = (record.values[kind][0] if kind in record.values else None for kind in _DRAWN)
    ax = plot.location(sites.stations(), only, azimuth=azimuth, range=ranges, ax=figure.subplots())
    ax.set_title(": ".join(filter(None, [record.name, ax.get_title()])))
