"""`tertia trajectory`: positions, velocities and accelerations along time."""

import re
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

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
from tertia.cli._terminal import WRONG_USAGE, fail, tracked
from tertia.sensors import Bias, Kind, Station
from tertia.trajectory import Order, Smoother, Spatial, Trajectory, reconstruct

if TYPE_CHECKING:
    from matplotlib.figure import FigureBase

EXAMPLES = (
    "tertia trajectory measurements.csv --stations stations.toml --output track.csv",
    "tertia trajectory measurements.csv --stations stations.toml --biases azimuth --plot track.png",
    "tertia trajectory plots.parquet --stations radars.csv --by target --order temporal-first",
)
_BIASED: tuple[Kind, ...] = ("range", "azimuth", "elevation")
_BIAS = "bias"
# how their columns begin, and their units
_VELOCITY, _ACCELERATION = ("velocity_", "m_s"), ("acceleration_", "m_s2")
_PANELS_HEIGHT = 8.0


@dataclass(frozen=True, slots=True)
class _Options:
    """How to reconstruct, in the words of the library."""

    order: Order
    spatial: Spatial
    smoother: Smoother
    window: int
    degree: int | Literal["adaptive"]
    jerk: float | None
    biases: tuple[Kind, ...]

    def named(self, **changes: Any) -> dict[str, Any]:
        """Return them as the library takes them."""
        options = asdict(replace(self, **changes))
        estimated: dict[str, Any] = {f"{kind}_sigma": None for kind in options.pop("biases")}
        return {**options, "bias": Bias(**estimated)}


@dataclass(frozen=True, slots=True)
class _Reconstructed:
    """A target, its trajectory, and what its measurements have to do with it."""

    record: Record
    names: list[str]
    result: Trajectory
    judged: pl.DataFrame


def trajectory(
    files: Measured,
    *,
    stations: StationFile,
    time_column: TimeColumn = "time_s",
    station_column: StationColumn = "station",
    by: By = None,
    method: Annotated[Spatial, typer.Option(help="How to locate an instant.")] = "robust",
    order: Annotated[
        Order, typer.Option(help="Locate instants, then smooth along time; or the reverse.")
    ] = "spatial-first",
    smoother: Annotated[Smoother, typer.Option(help="How to smooth along time.")] = "rts",
    window: Annotated[int, typer.Option(help="Instants per local polynomial, odd.")] = 13,
    degree: Annotated[
        str, typer.Option(help="Degree of the local polynomials, or adaptive.")
    ] = "adaptive",
    jerk: Annotated[
        float | None,
        typer.Option(help="Intensity of the white jerk for rts in m²/s⁵; by default fitted."),
    ] = None,
    biases: Annotated[
        str,
        typer.Option(
            metavar="KIND[,KIND]",
            help="Estimate constant biases of the stations: range, azimuth, elevation.",
        ),
    ] = "",
    output: PositionFile = None,
    measurements: MeasurementFile = None,
    plot_file: PlotFile = None,
) -> dict[str, Any]:
    """Reconstruct a trajectory from ranges, azimuths, elevations or range differences.

    One row per station and time, with range_m, azimuth_deg, elevation_deg or range_difference_m;
    or one per measurement, with kind and value. Measurements of equal times make an instant.
    """
    columns = Columns(time_column, station_column, list(dict.fromkeys(by or [])))
    check_columns(columns, _result_columns())
    wanted = _kinds(biases)
    options = _Options(order, method, smoother, window, _degree(degree), jerk, wanted)
    _check(options)
    _tables.check_suffixes(output, plot_file, measurements, maps=_maps.SUFFIXES)
    sites = read_stations(stations)
    _maps.check(output, sites.places, stations)
    records = by_target(read_measurements(files, columns, sites), columns, sites)
    found = [_reconstruct(one, sites, options) for one in tracked(records, "Reconstructing")]

    summaries = [_summary(one) for one in found]
    _positions.print_summary(pl.concat(summaries), columns.by, text=(_BIAS,))
    _positions.say_origin(sites)
    for one in found:
        _say(one)
    if output is not None and _maps.is_map(output):
        _maps.write([_line(one, sites, columns) for one in found], output, "line")
    elif output is not None:
        _tables.write(pl.concat([_rows(one, sites, columns) for one in found]), output)
    if measurements is not None:
        tables = [_positions.measurement_rows(one.judged, one.record, columns) for one in found]
        _tables.write(pl.concat(tables), measurements)
    if plot_file is not None:
        _draw(found, sites, columns, plot_file)
    return {"stations": pl.concat(summaries).to_dicts()}


def _result_columns() -> set[str]:
    space = np.zeros((0, 3, 3))
    motion = {
        *_positions.coordinates(space[..., 0], space, *_VELOCITY),
        *_positions.coordinates(space[..., 0], space, *_ACCELERATION),
    }
    return {*_positions.result_columns(), *motion, _BIAS}


def _kinds(text: str) -> tuple[Kind, ...]:
    kinds = [part.strip() for part in text.split(",") if part.strip()]
    for kind in kinds:
        if kind not in _BIASED:
            fail(f"--biases has {kind!r}; it must be of {', '.join(_BIASED)}", WRONG_USAGE)
    return cast("tuple[Kind, ...]", tuple(dict.fromkeys(kinds)))


def _degree(text: str) -> int | Literal["adaptive"]:
    if text == "adaptive":
        return "adaptive"
    try:
        return int(text)
    except ValueError:
        fail(f"--degree is {text!r}; it must be adaptive or a whole number", WRONG_USAGE)


def _check(options: _Options) -> None:
    """Let the library judge the options before the work; biases need the measurements."""
    station = [Station([0.0, 0.0], range_sigma=1.0, azimuth_sigma=1.0)]
    measured: dict[str, Any] = {"range": [[5.0], [6.0], [7.0]], "azimuth": [[0.1], [0.2], [0.3]]}
    try:
        reconstruct(station, [0.0, 1.0, 2.0], **measured, **options.named(biases=()))
    except ValueError as error:
        fail(str(error), WRONG_USAGE)


def _reconstruct(record: Record, sites: Sites, options: _Options) -> _Reconstructed:
    if not record.values:
        fail(f"{record.name}: nothing was measured")
    sigmas = _constant(record, sites)
    told: dict[str, Any] = {str(kind): values for kind, values in record.measured().items()}
    if "range_difference" in sigmas:
        told["range_difference_sigma"] = sigmas["range_difference"][1:]
    try:
        result = reconstruct(sites.stations(sigmas), record.times, **told, **options.named())
    except (ValueError, np.linalg.LinAlgError) as error:
        message = re.sub(r"\bstation (\d+)\b", lambda found: sites.names[int(found[1])], str(error))
        fail(": ".join(filter(None, [record.name, message])))
    judged = _positions.judged(record, sites, result.residual, result.outlier, result.fixes)
    return _Reconstructed(record, sites.names, result, judged)


def _constant(record: Record, sites: Sites) -> dict[Kind, FloatArray]:
    """Return the standard deviation of each station, (K,), or tell which one changes."""
    constant = {}
    for kind, sigma in _positions.all_sigmas(record, sites).items():
        own = np.where(np.isnan(record.values[kind]), np.nan, sigma)
        least, largest = np.fmin.reduce(own), np.fmax.reduce(own)
        changing = np.flatnonzero(largest > least)
        if changing.size:
            fail(
                f"the sigma of the {kind.replace('_', ' ')} of {sites.names[changing[0]]} changes "
                "along time; a trajectory takes one for each station and kind"
            )
        constant[kind] = np.where(np.isnan(least), sigma[0], least)
    return constant


def _summary(one: _Reconstructed) -> pl.DataFrame:
    """Return what is told of each station and kind, with its bias if one was estimated."""
    told = _positions.summary(one.record, one.judged)
    bias = one.result.bias
    if bias is None:
        return told
    texts = {}
    for kind in _BIASED:
        sigmas = getattr(bias, f"{kind}_sigma")
        if np.any(sigmas):
            unit, factor = UNITS[kind]
            values, errors = getattr(bias, kind) / factor, sigmas / factor
            for name, value, error in zip(one.names, values, errors, strict=True):
                if np.isfinite(error):
                    texts[name, kind] = f"{' ± '.join(plot.rounded(value, error))} {unit}"
    keys = told.select("station", "kind").rows()
    return told.with_columns(pl.Series(_BIAS, [texts.get(key) for key in keys], dtype=pl.String))


def _say(one: _Reconstructed) -> None:
    result = one.result
    _positions.say_located(one.record, result.fixes, result.position, result.sigma)
    if result.smoothed is not None:
        jerk, sigma = float(result.smoothed.jerk), float(result.smoothed.jerk_sigma)
        error = sigma / jerk if sigma and jerk else sigma
        told = "given" if error == 0 else f"fitted, relative error {error:.0%}"
        if not np.isfinite(error):
            told = "fitted, but hardly told by the measurements"
        typer.echo(f"  jerk {jerk:.3g} ({told})")


def _rows(one: _Reconstructed, sites: Sites, columns: Columns) -> pl.DataFrame:
    """Return one row per time, null for what is not known."""
    record, result = one.record, one.result
    d = result.position.shape[1]
    parts = [result.covariance[:, i * d : (i + 1) * d, i * d : (i + 1) * d] for i in range(3)]
    told = {
        columns.time: record.moments,
        **_positions.coordinates(result.position, parts[0]),
        **_positions.geodetic(result.position, sites),
        **_positions.coordinates(result.velocity, parts[1], *_VELOCITY),
        **_positions.coordinates(result.acceleration, parts[2], *_ACCELERATION),
        **_positions.covariances(parts[0]),
        **_positions.instants(record, one.judged, result.fixes),
    }
    return _tables.beside(record.keys, pl.DataFrame(told))


def _line(one: _Reconstructed, sites: Sites, columns: Columns) -> _maps.Feature | None:
    """Return a trajectory as a line on a map."""
    rows = _rows(one, sites, columns)
    keys = one.record.keys.row(0, named=True) if one.record.keys.width else {}
    known = rows.select("measured", "outliers").sum().row(0, named=True)
    name = one.record.name or "trajectory"
    return _maps.feature(rows, columns.time, name, {**keys, **known})


def _draw(found: list[_Reconstructed], sites: Sites, columns: Columns, path: Path) -> None:
    stations = sites.stations()

    def draw_one(at: int, figure: "FigureBase") -> None:
        record = found[at].record
        panels = plot.trajectory(
            stations, found[at].result, time=record.moments.to_numpy(), figure=figure
        )
        _positions.name_panels(panels, record, columns)

    _positions.draw(path, [one.record.name for one in found], draw_one, _PANELS_HEIGHT)
