"""`tertia locate`: positions at single instants from the measurements of several stations."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import polars as pl
import typer

from tertia import plot
from tertia._result import counted
from tertia.cli.commands import positions, shapes
from tertia.cli.files import krakensdr, maps, read, write
from tertia.cli.terminal import options as opt
from tertia.cli.terminal.options import option
from tertia.cli.terminal.say import FAILED, working
from tertia.location import LIGHT, Location, LocationMethod
from tertia.sensors import ByKind, Kind
from tertia.tables._groups import group_name
from tertia.tables._locate import locations_of
from tertia.tables._measurements import UNITS
from tertia.tables._parts import Source
from tertia.tables._positions import Located, Positions

if TYPE_CHECKING:
    from matplotlib.figure import FigureBase

EXAMPLES = (
    "tertia locate measurements.csv --sensors stations.toml --output positions.csv",
    "tertia locate bearings.csv --sensors stations.csv --by target --plot positions.png",
    "tertia locate ranges.csv --sensors two.toml --initial 1200,3400 --method least-squares",
    "tertia locate telemetry.csv --sensors towers.csv --method posterior --max-range 5000 --pooled",
    "tertia locate hour.csv --sensors finders.toml --tolerance inf --output position.geojson",
    "tertia locate *.csv --format krakensdr --sensors finders.toml --tolerance inf",
    "tertia locate shots.csv --sensors microphones.toml --propagation-speed 343",
)
# residuals are compared with 1 if they are expected to be larger than this
_NEARLY_ONE = 0.9
# kinds of measurements that are drawn in a picture of one instant
_DRAWN: tuple[Kind, ...] = ("azimuth", "range")


def locate(
    files: opt.Recordings,
    *,
    sensors: opt.SensorFile,
    column: opt.ColumnNames = None,
    by: opt.By = None,
    form: Annotated[
        Literal["table", "krakensdr"],
        option("Format of the files; krakensdr: recordings of the KrakenSDR app.", "--format"),
    ] = "table",
    tolerance: Annotated[
        float,
        option(
            "Seconds within which measurements form an instant; inf: one position per target.",
            metavar="SECONDS",
        ),
    ] = 0.0,
    method: Annotated[LocationMethod, option("Estimator of the position.")] = "robust",
    max_range: Annotated[
        float | None,
        option("For posterior: largest distance of a target in metres.", metavar="METRES"),
    ] = None,
    pooled: Annotated[
        bool,
        option(
            "Only the ratios of the sigmas are known: estimate one factor for all instants.",
            "--pooled",
        ),
    ] = False,
    redundancy: Annotated[
        int | None,
        option(
            "Degrees of freedom needed for an outlier search; by default 3 (arrivals: 2).",
            metavar="N",
        ),
    ] = None,
    range_difference_correlation: Annotated[
        float,
        option(
            "Correlation of the errors of range differences; 0.5: equally accurate sensors.",
            metavar="R",
        ),
    ] = 0.5,
    propagation_speed: opt.PropagationSpeed = LIGHT,
    propagation_speed_sigma: opt.PropagationSpeedSigma = None,
    wind_sigma: opt.WindSigma = None,
    multipath: Annotated[
        bool, option("Assume that outliers of arrival times are mostly late.")
    ] = True,
    height: Annotated[
        float | None,
        option(
            "Height of all targets in metres, if the sensors have heights; on the earth, "
            "above the ellipsoid."
        ),
    ] = None,
    height_sigma: Annotated[
        float | None, option("Standard deviation of the height in metres.")
    ] = None,
    initial: Annotated[
        str | None,
        option(
            "A position near the target in metres, if several fit the measurements.",
            metavar="EAST,NORTH[,UP]",
        ),
    ] = None,
    probability: Annotated[
        float | None,
        option(
            "Write regions with this probability: area, axes, CEP; on maps, outlines.", metavar="P"
        ),
    ] = None,
    risk: Annotated[
        float | None, option("Write protection levels with this risk.", metavar="P")
    ] = None,
    n_threads: opt.Threads = None,
    output: opt.MapOutput = None,
    measurements: opt.MeasurementOutput = None,
    plot_file: opt.PlotFile = None,
) -> dict[str, Any]:
    """Locate a target at every instant from ranges, azimuths, elevations or times of arrival.

    One row per sensor and time, with range_m, azimuth_deg, elevation_deg, range_difference_m or
    arrival_time_s; or one per measurement, with kind and value. Measurements with equal times, or
    within --tolerance, form an instant.
    """
    write.check_suffixes(output, plot_file, measurements, maps=maps.SUFFIXES)
    if form == "krakensdr":
        source: Source = [krakensdr.recording(path) for path in files]
    else:
        source = read.tables(*files)
    stations = read.read_stations(sensors, source)
    maps.check(output, stations)
    with working("Locating") as over:
        found = locations_of(
            source,
            sensors=stations,
            columns=opt.column_names(column),
            by=by or [],
            tolerance=tolerance,
            method=method,
            max_range=max_range,
            pooled=pooled,
            redundancy=redundancy,
            range_difference_correlation=range_difference_correlation,
            propagation_speed=propagation_speed,
            propagation_speed_sigma=propagation_speed_sigma,
            wind_sigma=wind_sigma,
            multipath=multipath,
            height=height,
            height_sigma=height_sigma,
            initial=positions.start(initial, stations.dimension),
            probability=probability,
            risk=risk,
            n_threads=n_threads,
            progress=over,
        )
    said = (_say_expected, _say_sigma, positions.say_speed, _say_bias)
    positions.print_all(found, by or [], said, propagation_speed)
    if maps.is_map(output):
        maps.write(_points(found, by or []), output, "position", shapes.of(found, probability))
    positions.write_tables(found, output, measurements)
    write.save_groups(found.targets, plot_file, _draw, positions.FIGURE_SIZE)
    if not any(np.any(one.result.success) for one in found.targets):
        raise typer.Exit(FAILED)
    return {"sensors": found.sensors.to_dicts()}


def _say_expected(one: Located[Location]) -> None:
    """Print the size of residuals by which sigmas can be judged, if it is much below 1."""
    if one.target.singles is not None or one.result.measurement_sigma is not None:
        return
    rows = one.rows.filter(pl.col("degrees_of_freedom") > 0)
    count = rows.select(pl.col("measurement_count") - pl.col("outlier_count")).sum().item()
    freedom = int(rows["degrees_of_freedom"].sum())
    if count and (expected := np.sqrt(freedom / count)) < _NEARLY_ONE:
        typer.echo(
            f"  residual_rms is about {expected:.2g} if the sigmas are correct: "
            f"{counted(count, 'measurement')} have {counted(freedom, 'degree')} of freedom"
        )


def _say_sigma(one: Located[Location]) -> None:
    """Print the estimated sigma, if it was estimated."""
    if one.result.measurement_sigma is None:
        return
    [kind] = one.target.values
    unit, factor = UNITS[kind]
    sigma = np.asarray(one.result.measurement_sigma)
    known = sigma[np.isfinite(sigma)]
    if known.size:
        stated = one.target.all_sigmas(optional=True)
        how = "as stated, up to a factor that is" if stated else "was not stated:"
        typer.echo(
            f"  sigma of {kind} {how} estimated at each instant, median "
            f"{np.median(known) / factor:.3g} {unit}"
        )


def _say_bias(one: Located[Location]) -> None:
    """Print the systematic errors found from inconsistencies, or a note that none can be found."""
    if one.result.systematic == "not included":
        typer.echo("  systematic errors are not included: there are no redundant measurements")
    if one.result.systematic != "estimated" or one.result.bias is None:
        return
    for kind in one.target.values:
        sigma = getattr(one.result.bias, f"{kind}_sigma", None)
        if sigma is not None and np.any(sigma):
            unit, factor = UNITS[kind]
            typer.echo(
                f"  the stations contradict each other: systematic errors of {kind} are included, "
                f"with a sigma of {np.max(sigma) / factor:.3g} {unit}"
            )


def _points(found: Positions[Any], by: Sequence[str]) -> list[maps.Feature | None]:
    """Return positions as points on a map."""
    rows: pl.DataFrame = found.rows
    return [
        maps.feature(row, group_name(row.select(*by, "time_s")), row.row(0, named=True))
        for row in rows.iter_slices(1)
    ]


def _draw(one: Located[Location], figure: "FigureBase") -> None:
    target, result = one.target, one.result
    stations = target.sensors.items
    if target.times.size > 1 or not np.all(result.success):
        positions.draw(one, figure)
        return
    # draw the azimuths and ranges from which the only position was estimated
    sites = np.arange(len(stations))
    if target.has_places:
        # those of sensors that move, at their places; the others have no measurements
        sites = np.unique(target.rows["site"])
        stations = [
            replace(one, position=one.position[0], axes=np.asarray(one.axes)[0]) for one in stations
        ]
    marks = {kind: getattr(result.outlier, kind) for kind in _DRAWN}
    only = replace(
        result,
        position=result.position[0],
        covariance=result.covariance[0],
        outlier=ByKind(**{k: None if m is None else m[0, sites] for k, m in marks.items()}),
    )
    azimuth, ranges = (
        target.values[kind][0, sites] if kind in target.values else None for kind in _DRAWN
    )
    stations = [stations[site] for site in sites.tolist()]
    ax = plot.location(stations, only, azimuth=azimuth, range=ranges, ax=figure.subplots())
    ax.set_title(": ".join(filter(None, [target.name, ax.get_title()])))
