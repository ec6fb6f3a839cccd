"""Estimation of positions at single instants from the measurements of several stations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import polars as pl

from tertia.geo import LocalFrame, SystemPlane
from tertia.location import LIGHT, Location, LocationMethod
from tertia.location import locate as locate_instants
from tertia.sensors import Station
from tertia.sensors._kinds import STATION_KINDS
from tertia.tables._described import SensorsLike, stations_of
from tertia.tables._doubts import doubt
from tertia.tables._earth import up_at
from tertia.tables._ellipsoid import on_the_earth
from tertia.tables._frames import Table, result
from tertia.tables._groups import Progress, as_names, beside, known
from tertia.tables._measurements import Target, check_tolerance, doubt_instants, read_targets
from tertia.tables._parts import Source, source_of
from tertia.tables._positions import (
    EMISSION,
    PROTECTION_LEVEL,
    REGION,
    Located,
    Positions,
    coordinates,
    covariances,
    errors_of,
    of_instants,
    of_measurements,
    of_sensors,
    of_singles,
    positions_of,
    result_names,
)
from tertia.tables._sensors import Sensors
from tertia.tables._times import Clock

# at a constant height, the coordinate up changes by a few metres per kilometre, so each iteration
# reduces the error to about a hundredth
_ROUNDS = 2
# groups of one instant each above which a common estimate is missed
_FEW = 10
_NO_SIGMAS: dict[str, Any] = {f"{kind}_sigma": None for kind in (*STATION_KINDS, "arrival_time")}


def locate(
    table: Table,
    *,
    sensors: SensorsLike,
    columns: Mapping[str, str] | None = None,
    by: str | Sequence[str] = (),
    tolerance: float = 0.0,
    method: LocationMethod = "robust",
    max_range: float | None = None,
    pooled: bool = False,
    redundancy: int | None = None,
    range_difference_correlation: float = 0.5,
    propagation_speed: float = LIGHT,
    propagation_speed_sigma: float | None = None,
    wind_sigma: float | None = None,
    multipath: bool = True,
    height: float | None = None,
    height_sigma: float | None = None,
    initial: npt.ArrayLike | None = None,
    probability: float | None = None,
    risk: float | None = None,
    n_threads: int | None = None,
) -> Table:
    """Estimate the position of each target at each instant, as `tertia locate` does.

    Parameters
    ----------
    table : DataFrame of Polars or pandas, Table or RecordBatch of pyarrow
        One row per sensor and time, in any order. The columns are `time_s` (seconds or datetimes),
        `sensor`, and any of `range_m`, `azimuth_deg`, `elevation_deg`, `range_difference_m` (range
        minus the range from the first sensor) and `arrival_time_s`; and their sigmas, such as
        `range_sigma_m`, if they differ from those of the sensor. Alternatively, there is one row
        per measurement, with `kind`, `value` and `sigma`. Without `time_s`, all rows of a target
        belong to one instant with the time 0. Times of arrival are seconds from any origin, or
        datetimes, which are read with nanoseconds. Floating-point seconds since 1970 have a
        resolution of only 0.2 µs; as text, they too are read with nanoseconds. The position of a
        moving sensor is in `sensor_east_m`, `sensor_north_m` and, in three dimensions,
        `sensor_up_m`; or, on the earth, in `sensor_latitude_deg`, `sensor_longitude_deg` and
        `sensor_height_m`. Measurements form an instant if their times are equal or differ by at
        most `tolerance`.
    sensors : sequence of Station, DataFrame, or str or Path
        The stations, with the names that the table uses: objects, a table with one row per station
        and the columns of sensors files, or the path of a sensors file in TOML.
    columns : mapping of str to str, optional
        The names that columns have in this table, keyed by their standard names.
    by : str or sequence of str
        Columns whose values identify the targets; by default all rows belong to one target.
    tolerance : float
        Seconds within which measurements belong to one instant, whose time is the mean of theirs.
        An instant has at most one measurement of each kind by each sensor. If it is inf, one
        position is estimated for each target. The measurements of each sensor are first combined
        without their outliers, as in `bearing`. If a sensor has fewer than 40 measurements, those
        that do not fit the position estimated from all sensors are left out; the sigma of the mean
        of the others follows from the stated sigma, and is larger if they scatter more or are
        correlated. If no sigma is stated, or if sensors move, fewer than five measurements of a
        sensor are replaced by their median, with the sigma of a single measurement.
    method : str
        As for `tertia.location.locate`.
    max_range : float, optional
        As for `tertia.location.locate`.
    pooled : bool
        True if the stated sigmas are correct except for a common factor, or if no sigmas are
        stated. This factor, or one common sigma, is then estimated from all instants of a target
        together.
    redundancy : int, optional
        As for `tertia.location.locate`.
    range_difference_correlation, propagation_speed, propagation_speed_sigma, wind_sigma : float
        As for `tertia.location.locate`.
    multipath : bool
        As for `tertia.location.locate`.
    height, height_sigma : float, optional
        Height of all targets in metres, and its standard deviation, for stations in three
        dimensions. If the sensors have latitudes and longitudes, it is the height above the
        ellipsoid, otherwise the up coordinate.
    initial : array_like, optional
        A position near the targets. If several positions fit the measurements, the one near it is
        selected.
    probability : float, optional
        Probability that the region about a position contains the target. If it is given, the result
        has columns that describe the regions, and `cep_m`, the radius of a circle that contains the
        target with a probability of one half.
    risk : float, optional
        Probability that the position error exceeds the protection level. If it is given, the result
        has a column of protection levels.
    n_threads : int, optional
        As for `tertia.location.locate`.

    Returns
    -------
    table of the same kind
        One row for each target and time. The columns are those of `by` and `time_s`; the position
        with its sigmas and covariances (`east_m`, `east_sigma_m`, `covariance_east_north_m2`);
        `emission_time_s` and its sigma, if there are times of arrival; `measurement_count`,
        `degrees_of_freedom`, `pvalue`, `outlier_count` and `outlier_measurement` (the names of the
        outliers); and `status`, which states the reason if there is no position. Unknown values are
        null. If stations with latitudes, longitudes and heights measure only azimuths, the height
        is null, and the latitude and longitude are those of the point at the mean height of the
        stations.

    Raises
    ------
    RecordError
        If a column is missing, a cell cannot be understood, a measurement is impossible or appears
        twice, or a sigma is not stated.
    ValueError, TypeError
        If an option is outside its domain or has the wrong type, or the table is of an unsupported
        kind.

    Examples
    --------
    >>> import polars as pl
    >>> from tertia import tables
    >>> from tertia.sensors import Station
    >>> places = {"A": (0.0, 0.0), "B": (4e3, 0.0), "C": (0.0, 3e3)}
    >>> stations = [Station(p, name=name, range_sigma=1.0) for name, p in places.items()]
    >>> table = pl.DataFrame({"time_s": 0.0, "sensor": list("ABC"), "range_m": [5e3, 3e3, 4e3]})
    >>> tables.locate(table, sensors=stations).select("east_m", "north_m").row(0)
    (4000.0, 3000.0)
    """
    found = locations_of(
        source_of(table),
        sensors=sensors,
        columns=columns,
        by=by,
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
        initial=initial,
        probability=probability,
        risk=risk,
        n_threads=n_threads,
    )
    return result(table, found.rows, as_names(by))


def locations_of(
    source: Source,
    *,
    sensors: SensorsLike,
    columns: Mapping[str, str] | None = None,
    by: str | Sequence[str] = (),
    tolerance: float = 0.0,
    initial: npt.ArrayLike | None = None,
    probability: float | None = None,
    risk: float | None = None,
    progress: Progress[Target] = iter,
    **options: Any,
) -> Positions[Location]:
    """Return the positions of all targets with their measurements, as described in `locate`."""
    stations = stations_of(sensors)
    targets = read_targets(
        source,
        stations,
        columns=columns,
        by=by,
        results=result_names(),
        timed=False,
        tolerance=check_tolerance(tolerance),
    )
    for target in targets:
        doubt_instants(target)
    _doubt_groups(targets, options)
    start = None if initial is None else np.asarray(initial, dtype=np.float64)
    asked = probability, risk

    def estimate(target: Target) -> Located[Location]:
        return _locate(target, stations, start, asked, **options)

    return positions_of(targets, stations, options, estimate, progress)


def _doubt_groups(targets: Sequence[Target], options: Mapping[str, Any]) -> None:
    """Warn if what all instants have in common is estimated from single instants."""
    common = {
        "propagation_speed_sigma": "the speed of the signals",
        "wind_sigma": "the wind",
        "pooled": "the sigma",
    }
    found = [said for name, said in common.items() if options.get(name)]
    if found and len(targets) >= _FEW and all(one.times.size == 1 for one in targets):
        doubt(
            f"{' and '.join(found)} {'are' if found[1:] else 'is'} estimated for each of "
            f"{len(targets)} groups alone, from one instant: without grouping, and with the same "
            "time_s for the rows of an instant or with a tolerance, all instants are used together"
        )


def _locate(
    target: Target,
    stations: Sensors[Station],
    start: Any,
    asked: tuple[float | None, float | None],
    **how: Any,
) -> Located[Location]:
    stated = target.all_sigmas(optional=True)
    # stations without sigmas, which are passed separately
    bare = [replace(one, **_NO_SIGMAS) for one in target.sensors.items]

    def solve(measured: dict[str, Any], sigmas: dict[str, Any]) -> Location:
        options = measured | {f"{kind}_sigma": sigma for kind, sigma in sigmas.items()}
        return _at_height(stations.frame, bare, **options, initial=start, **how)

    with errors_of(target):
        speed = how.get("propagation_speed", LIGHT)
        found = on_the_earth(solve, target.measured(), stated, target.sensors, speed)
        regions = _regions(found, *asked)
    measured = of_measurements(target, found.residual, found.outlier, np.atleast_1d(found.success))
    each = measured if target.singles is None else of_singles(target, measured)
    rows = {
        "time_s": target.moments,
        **coordinates(found.position, found.covariance),
        **target.sensors.geodetic(found.position),
        **covariances(found.covariance),
        **_emission(found, target.arrivals),
        **regions,
        **of_instants(target, measured, found, np.atleast_1d(found.success)),
    }
    table = beside(target.keys, pl.DataFrame(rows))
    return Located(target, found, found, each, table, of_sensors(target, each))


def _at_height(
    frame: LocalFrame | SystemPlane | None,
    stations: Sequence[Station],
    *,
    height: float | None,
    **options: Any,
) -> Location:
    """Locate targets at a given height, which on the earth is measured from the ellipsoid."""
    if height is None or not isinstance(frame, LocalFrame):
        return locate_instants(stations, height=height, **options)
    found = locate_instants(stations, height=height - frame.height, **options)
    for _ in range(_ROUNDS):
        up = up_at(frame, found.position, height)
        up = np.where(np.isfinite(up), up, height - frame.height)
        found = locate_instants(stations, height=up, **options)
    return found


def _emission(found: Location, clock: Clock) -> dict[str, pl.Series]:
    """Return the columns of the emission times if times of arrival were measured."""
    if found.emission_time is None or found.emission_time_sigma is None:
        return {}
    moments = clock.moments(np.asarray(found.emission_time))
    if not clock.dated:
        moments = moments.fill_nan(None)
    sigma = known(np.asarray(found.emission_time_sigma))
    return dict(zip(EMISSION, (moments, sigma), strict=True))


def _regions(
    found: Location, probability: float | None, risk: float | None
) -> dict[str, pl.Series]:
    """Return the columns of regions and protection levels, as far as they were requested."""
    columns: dict[str, Any] = {}
    if probability is not None:
        region = found.region(probability)
        axes = region.semi_major, region.semi_minor, np.degrees(region.orientation)
        columns |= zip(REGION, (region.area, *axes, found.cep()), strict=True)
    if risk is not None:
        columns[PROTECTION_LEVEL] = found.protection_level(risk)
    return {name: known(np.asarray(values)) for name, values in columns.items()}
