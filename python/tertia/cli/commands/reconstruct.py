"""`tertia reconstruct`: positions, velocities and accelerations over time."""

from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import typer

from tertia.cli.commands import positions
from tertia.cli.files import maps, read, write
from tertia.cli.terminal import options as opt
from tertia.cli.terminal.options import option
from tertia.cli.terminal.say import WRONG_USAGE, fail, working
from tertia.location import LIGHT
from tertia.sensors import Bias
from tertia.tables._positions import Located
from tertia.tables._reconstruct import paths_of
from tertia.trajectory import Order, Smoother, Spatial, Trajectory

if TYPE_CHECKING:
    pass

EXAMPLES = (
    "tertia reconstruct measurements.csv --sensors stations.toml --output track.csv",
    "tertia reconstruct measurements.csv --sensors stations.toml --bias azimuth --plot track.png",
    "tertia reconstruct plots.parquet --sensors radars.csv --by target --order temporal-first",
)
_BIASED = ("range", "azimuth", "elevation")


def reconstruct(
    files: opt.Recordings,
    *,
    sensors: opt.SensorFile,
    column: opt.ColumnNames = None,
    by: opt.By = None,
    tolerance: Annotated[
        float, option("Seconds within which measurements form an instant.", metavar="SECONDS")
    ] = 0.0,
    spatial: Annotated[Spatial, option("Estimator of the position at an instant.")] = "robust",
    order: Annotated[
        Order, option("Whether to locate or to smooth over time first.")
    ] = "spatial-first",
    smoother: Annotated[Smoother, option("Smoother over time.")] = "rts",
    window: Annotated[int, option("Number of instants in a local polynomial, odd.")] = 13,
    degree: Annotated[str, option("Degree of the local polynomials, or adaptive.")] = "adaptive",
    jerk: Annotated[
        float | None, option("Intensity of the white jerk for rts in m²/s⁵; by default estimated.")
    ] = None,
    bias: Annotated[
        str | None,
        option(
            "Kinds with unknown constant biases: range, azimuth, elevation.", metavar="KIND[,KIND]"
        ),
    ] = None,
    propagation_speed: opt.PropagationSpeed = LIGHT,
    propagation_speed_sigma: opt.PropagationSpeedSigma = None,
    wind_sigma: opt.WindSigma = None,
    height: Annotated[
        float | None,
        option(
            "Height of all targets in metres, if the sensors have heights; on the earth, "
            "above the ellipsoid. Heights that change are in the column target_height_m."
        ),
    ] = None,
    height_sigma: Annotated[
        float | None, option("Standard deviation of the heights in metres, if rows have no other.")
    ] = None,
    initial: Annotated[
        str | None,
        option(
            "A position near the start of the path in metres, if two mirror images fit.",
            metavar="EAST,NORTH[,UP]",
        ),
    ] = None,
    n_threads: opt.Threads = None,
    output: opt.MapOutput = None,
    measurements: opt.MeasurementOutput = None,
    plot_file: opt.PlotFile = None,
) -> dict[str, Any]:
    """Reconstruct a path from ranges, azimuths, elevations, range differences or arrival times.

    One row per sensor and time, with range_m, azimuth_deg, elevation_deg, range_difference_m or
    arrival_time_s; or one per measurement, with kind and value. Measurements with equal times, or
    within --tolerance, form an instant.
    """
    write.check_suffixes(output, plot_file, measurements, maps=maps.SUFFIXES)
    options: dict[str, Any] = {"degree": _degree(degree), "bias": _bias(bias)}
    stations = read.read_stations(sensors)
    maps.check(output, stations)
    with working("Reconstructing") as over:
        found = paths_of(
            read.tables(*files),
            sensors=stations,
            columns=opt.column_names(column),
            by=by or [],
            tolerance=tolerance,
            spatial=spatial,
            order=order,
            smoother=smoother,
            window=window,
            jerk=jerk,
            propagation_speed=propagation_speed,
            propagation_speed_sigma=propagation_speed_sigma,
            wind_sigma=wind_sigma,
            height=height,
            height_sigma=height_sigma,
            initial=positions.start(initial, stations.dimension),
            n_threads=n_threads,
            progress=over,
            **options,
        )
    said = (positions.say_speed, lambda one: _say_motion(one.result), _say_errors)
    positions.print_all(found, by or [], said, propagation_speed)
    if maps.is_map(output):
        maps.write([_line(one) for one in found.targets], output, "line")
    positions.write_tables(found, output, measurements)
    write.save_groups(found.targets, plot_file, positions.draw, positions.FIGURE_SIZE)
    return {"sensors": found.sensors.to_dicts()}


def _bias(text: str | None) -> Bias | None:
    kinds = [part.strip() for part in (text or "").split(",") if part.strip()]
    for kind in kinds:
        if kind not in _BIASED:
            fail(f"--bias has {kind!r}; it must be of {', '.join(_BIASED)}", WRONG_USAGE)
    unknown: dict[str, Any] = {f"{kind}_sigma": np.inf for kind in kinds}
    return Bias(**unknown) if kinds else None


def _degree(text: str) -> int | Literal["adaptive"]:
    if text == "adaptive":
        return "adaptive"
    try:
        return int(text)
    except ValueError:
        fail(f"--degree is {text!r}; it must be adaptive or a whole number", WRONG_USAGE)


def _say_motion(path: Trajectory) -> None:
    if path.mirror_image is not None:
        typer.echo(
            "  the path is above the sensors; its mirror image below them fits as well "
            "(see --initial)"
        )
    if path.smoothed is None:
        return
    if wandering := float(path.smoothed.acceleration_noise):
        typer.echo(
            f"  acceleration noise {wandering:.3g} (estimated; the velocity changes at random)"
        )
        return
    jerk, sigma = float(path.smoothed.jerk), float(path.smoothed.jerk_sigma)
    error = sigma / jerk if sigma and jerk else sigma
    said = "given" if error == 0 else f"estimated, relative error {error:.0%}"
    if not np.isfinite(error):
        said = "estimated, but the measurements hardly determine it"
    typer.echo(f"  jerk {jerk:.3g} ({said})")


def _say_errors(one: Located[Trajectory]) -> None:
    """Print what is known of the errors, and a note if the sigmas include no systematic ones."""
    if (relative := one.result.relative_range_sigma) is not None:
        large = f"of large ranges, sigma is {relative:.0%}"
        typer.echo(f"  errors of ranges grow with the range; {large}")
    if one.result.height_bias is not None:
        value, sigma = one.result.height_bias, one.result.height_bias_sigma
        typer.echo(f"  bias of the heights {value:.3g} ± {sigma:.3g} m")
    if one.result.systematic == "not included":
        typer.echo(
            "  systematic errors are not included: no instant has redundant measurements that "
            "would show them"
        )


def _line(one: Located[Trajectory]) -> maps.Feature | None:
    """Return a path as a line on a map."""
    keys = one.target.keys.row(0, named=True) if one.target.keys.width else {}
    counts = one.rows.select("measurement_count", "outlier_count").sum().row(0, named=True)
    return maps.feature(one.rows, one.target.name or "path", {**keys, **counts})
