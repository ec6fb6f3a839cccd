"""Positions from the measurements of one instant."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import (
    BoolArray,
    FloatArray,
    common_batch,
    finite,
    flag,
    integer,
    lies_between,
    scalar_or_array,
    spread,
    threads,
)
from tertia.location._arrivals import LIGHT, Arrivals, read_arrivals
from tertia.location._bias import Given, given_biases, said
from tertia.location._common import included, without_common
from tertia.location._doubts import doubt_numbers
from tertia.location._explained import warn_if_explained
from tertia.location._height import anywhere, azimuths_alone, read_height, without_height
from tertia.location._posterior import locate_posterior
from tertia.location._readers import checked, correlation_of, deviations, require_kinds
from tertia.location._result import Location, LocationMethod, LocationStatus, location_of
from tertia.location._scene import Scene
from tertia.location._sides import warn_if_mirrored
from tertia.location._speed import Speed
from tertia.location._wind import Wind, read_medium
from tertia.sensors import Bias, Kind, Station
from tertia.sensors._kinds import KINDS
from tertia.sensors._sensors import stack_stations, survey_sigmas

_LENTH = {"lenth-mle", "lenth-huber", "lenth-andrews"}
# with as many degrees of freedom, two faults still leave a majority
_REDUNDANCY = 3
# odds of faults are part of their loss, and two of five arrivals tell a fault mostly
_REDUNDANCY_OF_ARRIVALS = 2
# least share of an error of each kind of measurement that residuals show: below it, mean redundancy
# numbers mean that errors are hardly checked (Förstner 1987)
_CHECKED = 0.1
# of variances, with which angles that are taken for degrees still fit
_MOST_GROWTH = 25.0


def locate(
    stations: Sequence[Station] | npt.ArrayLike,
    *,
    range: npt.ArrayLike | None = None,  # noqa: A002  # that is what it is
    azimuth: npt.ArrayLike | None = None,
    elevation: npt.ArrayLike | None = None,
    range_difference: npt.ArrayLike | None = None,
    arrival_time: npt.ArrayLike | None = None,
    range_sigma: npt.ArrayLike | None = None,
    azimuth_sigma: npt.ArrayLike | None = None,
    elevation_sigma: npt.ArrayLike | None = None,
    range_difference_sigma: npt.ArrayLike | None = None,
    arrival_time_sigma: npt.ArrayLike | None = None,
    bias: Bias | None = None,
    range_difference_correlation: float = 0.5,
    propagation_speed: npt.ArrayLike = LIGHT,
    propagation_speed_sigma: float | None = None,
    wind_sigma: float | None = None,
    multipath: bool = True,
    height: npt.ArrayLike | None = None,
    height_sigma: npt.ArrayLike | None = None,
    method: LocationMethod = "robust",
    max_range: float | None = None,
    pooled: bool = False,
    redundancy: int | None = None,
    initial: npt.ArrayLike | None = None,
    degrees: bool = False,
    n_threads: int | None = None,
) -> Location:
    """Locate a target from the measurements of several stations at the same instant.

    Parameters
    ----------
    stations : sequence of K Station, or array_like of shape (..., K, D)
        The stations, or their positions in metres, with D = 2 or 3.
    range : array_like of shape (..., K), optional
        Ranges in metres; nan where one is missing. Near a station, noise may make a range negative,
        by at most 5 `range_sigma`.
    azimuth : array_like of shape (..., K), optional
        Azimuths in radians, clockwise from north; nan where one is missing.
    elevation : array_like of shape (..., K), optional
        Elevations in radians above the horizon, only if D = 3; nan where one is missing.
    range_difference : array_like of shape (..., K - 1), optional
        For each station except the first, its range minus the range of the first station, in
        metres.
    arrival_time : array_like of shape (..., K), optional
        Time at which the signal of one event arrived at each station, in seconds or as NumPy's
        datetimes or timedeltas (``datetime64[ns]``); nan where it did not arrive. Seconds since
        1970 have a resolution of only 0.2 µs, in which light travels 70 m; datetimes in nanoseconds
        are used at their full resolution. The time of emission is unknown and is estimated.
    range_sigma, azimuth_sigma, elevation_sigma : array_like of shape (..., K), optional
        Standard deviations in metres and radians, instead of those of the stations. Those of
        missing measurements may be nan.
    range_difference_sigma : array_like of shape (..., K - 1), optional
        Standard deviations of the range differences in metres.
    arrival_time_sigma : array_like of shape (..., K), optional
        Standard deviations of the times of arrival in seconds.
    bias : Bias, optional
        Systematic errors that replace those of the stations: the same for all stations, or one for
        each of K. Their values are subtracted, and their sigmas are part of the covariance. If an
        azimuth bias depends on the direction, as after `registration.calibrate`, its value and
        sigma at the measured azimuth are used. With `Bias()` there are no systematic errors. If
        neither the call nor the stations state a bias, sigmas are increased as much as
        inconsistencies between the stations require; without inconsistencies they are not increased
        (see Notes).
    range_difference_correlation : float
        Correlation of the errors of range differences. Use 0.5 if all range differences contain the
        error of the first station, and this error has the same variance as the errors of the other
        stations. Use 0 if the errors of the range differences are independent. The variance of the
        common error is this fraction of the smallest variance of a range difference.
    propagation_speed : array_like of shape (...)
        Speed of the signal in metres per second, by default the speed of light.
    propagation_speed_sigma : float, optional
        Standard deviation of the speed, whose error is the same at all instants of the call. Sound
        in air is 1 % faster if it is 6 °C warmer. The speed is then estimated with the positions,
        from times of arrival, ranges and range differences, all of which the given speed converts
        to distances; the covariance includes the error of the speed. By default, the speed is taken
        as exact, as with 0, with one exception: a speed of at most 100 km/s, as of sound, is
        estimated with a standard deviation of 2 % if the method is "robust" and the measurements of
        several instants clearly contradict it.
    wind_sigma : float, optional
        Standard deviation of each horizontal component of a wind that carries the signals, in
        metres per second, such as 5 for sound in the open. The wind is the same at all instants of
        the call. It is then estimated with the positions, and the covariance includes its error.
        This is for times of arrival without measurements of other kinds. By default, the air is
        still, as with 0, with one exception: a wind with components of 5 m/s is estimated if the
        signals are sound in air and the measurements of several instants clearly contradict still
        air.
    multipath : bool
        Whether outliers are assumed to be late 20 times as often as early, as with multipath; if
        False, both are equally likely. This applies to times of arrival, and to range differences
        if they are correlated.
    height, height_sigma : array_like of shape (...), optional
        Last coordinate of the target in metres and its standard deviation, only if D = 3. A given
        height is used like the other measurements. Azimuths alone do not determine the height: at
        an instant with azimuths only and no `height`, up is nan with an infinite variance, and east
        and north are estimated in the plane.
    method : {"robust", "least-squares", "lenth-mle", "lenth-huber", "lenth-andrews", "posterior"}
        "robust": Tukey's biweight is used if there are at least `redundancy` degrees of freedom,
        otherwise least squares. "least-squares": least squares are always used. The other methods
        are only for azimuths in the plane. "lenth-mle", "lenth-huber" and "lenth-andrews" are the
        estimators of Lenth (1981). "posterior" gives the expected position, and is for two or more
        bearings whose sigma is known only roughly or not at all.
    max_range : float, optional
        Largest distance of the target from the nearest station in metres, for the method
        "posterior", which requires it. All positions within this distance have the same prior
        probability.
    pooled : bool
        Whether the standard deviations are only relative. One factor for each kind, which may be
        below 1, is then estimated from the whole batch. If no standard deviations are given, the
        common standard deviation is estimated from the whole batch.
    redundancy : int, optional
        Smallest number of degrees of freedom at which outliers are searched for; by default it is 2
        if there are times of arrival, and 3 otherwise. With one degree of freedom, the faulty
        measurement cannot be identified; with two, this is rarely possible for angles and ranges.
        If such instants of a batch have outliers and no angles, the covariance allows for each
        measurement that may be the faulty one.
    initial : array_like of shape (..., D), optional
        A position near the target. If several positions fit the measurements, it determines which
        of them is returned.
    degrees : bool
        Whether the angles and their standard deviations in this call are in degrees.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    Location
        Position, covariance, residuals and faults. In a batch, the position of an instant that
        cannot be located is nan, and `status` gives the reason.

    Raises
    ------
    ValueError
        If a shape is wrong, a number is outside its domain, or a standard deviation is missing. For
        a single instant, also if the target cannot be located: there are too few measurements,
        bearings do not intersect, two positions fit the measurements equally well, or the target is
        at a station.
    numpy.linalg.LinAlgError
        For a single instant, if the geometry leaves a direction undetermined.
    TypeError
        If an argument has the wrong type.

    Warns
    -----
    UserWarning
        If most angles contradict each other when read as radians, but agree when read as degrees,
        or if most measurements would agree in another unit, or with another zero or direction.
        If stations without names that measure azimuths lie along a path in their order.
        If most instants of a batch are ambiguous, and the stations are near a level plane.

    Notes
    -----
    Leading axes are broadcast against each other. If only one kind is measured and no standard
    deviation is given, one common standard deviation is estimated from the residuals. The robust
    method estimates this deviation from the median of the absolute residuals.

    **Times of arrival.** In the model `c t = b + |p - s| + e`, the additional unknown b is the time
    of emission times the speed; its prior is flat. The model is equivalent to one of range
    differences relative to any of the stations, with their full covariance. Range differences that
    have a common error are treated as times of arrival, of which the one at the first station is 0.
    If the first station is faulty, all range differences are marked as outliers. The loss for times
    of arrival is `-ln` of a density in which 99 of 100 arrivals have normal noise, and one in a
    hundred is a fault of up to 50 sigma. A residual is a fault if it is late by more than 3.9 sigma
    or early by more than 4.6 sigma. The covariance is `(J' W J)^-1` with the weights of that loss,
    plus a term for doubtful measurements, which is given below. If more than one in a hundred
    arrivals of a batch is faulty, the actual fraction of faults is used in the density.
    `Station.position_sigma` contributes to the errors of all measurements of a station, unless the
    sigma of the measurements is to be estimated.

    **Minimisation.** The search starts at the best of the points where a minimal set of
    measurements agrees, or at the median of the positions that are determined by single stations.
    From there, up to eight Huber steps (1.345) lead to the point from which Tukey's biweight
    (4.685) is minimised. Other starting points are tried as well. If two minima are found whose
    likelihoods differ by less than a factor of 20, the position is ambiguous, which is an error.
    In a batch without a stated `bias`, whose stations are near one plane or line and do not move,
    the instants together may show on which side of it the targets are; the likelihoods are then
    multiplied by the odds of the sides. Instants that remain ambiguous have no position.
    Faults have the weight 0. The robust covariance is `0.963 (J' W J)^-1`, which for normal errors
    is 5 % larger than the covariance of least squares, plus `6 q (1 - q) d d'` for each measurement
    that is a fault with probability q, where d is the change of the position if that measurement is
    left out. The cost for M measurements is O(M) per step, and about ten steps are needed.

    **Systematic errors** (`bias=None`). In a batch, the variances of each kind are multiplied by a
    factor that is estimated from the residuals of at most 256 instants (restricted maximum
    likelihood; Patterson, Thompson 1971). They are increased further to allow for the uncertainty
    of this factor. If errors are correlated over time, the instants count as fewer independent
    instants. For a single instant, the variances are increased if its own residuals, including
    those of outliers, fail a test with a significance of 10 %. The covariance is then that of a
    mixture: for each common factor of the sigmas, outliers and position are determined anew, and
    weighted by their restricted likelihood. If nothing contradicts the stated sigmas, they are not
    increased.
    If three or more stations of a single instant have the same name, they are one sensor at several
    places. Its systematic error is then the same at all places, and position and covariance are
    averaged over the values that the measurements leave possible.
    An error that all stations share causes no inconsistency. If the residuals of a batch are
    significantly smaller than stated (at 99 %), the missing part of the variance is attributed to
    an error that all stations share, and this error is added to the covariance. If the common error
    can be larger, state it in `bias`. If the stated sigmas are half of the true ones, this is
    detected in fewer than half of all single instants with one or two degrees of freedom. The 95 %
    ellipse then contains the target in 73 % of the instants with one degree of freedom and in 78 %
    of those with two, instead of 53 % without the increase. It is therefore better to locate such
    instants as a batch.

    **Large errors.** If the standard deviation is not small compared with the distance to the
    nearest station, the 95 % ellipse is extended along its axes to the points at which the
    likelihood falls below its limit (Bates, Watts 1988). If there is no such point, the status is
    ILL_CONDITIONED.

    Examples
    --------
    Five direction finders, one of which has an error of half a radian:

    >>> import numpy as np
    >>> from tertia.location import locate
    >>> places = [[0, 0], [1000, 0], [2000, 0], [0, 2000], [2000, 2000]]
    >>> bearings = [0.7864, 0.0010, 5.4968, 2.3551, 3.4261]
    >>> fix = locate(places, azimuth=bearings, azimuth_sigma=0.002)
    >>> fix
    Location([1001.02 ± 2.03, 999.061 ± 3.12], 1 of 5 faulty)
    >>> fix.outlier.azimuth
    array([False, False, False, False,  True])

    An explosion that is heard by five stations, whose clocks are accurate to 5 ms:

    >>> times = [13.355, 12.787, 14.654, 13.834, 15.012]
    >>> heard = locate(places, arrival_time=times, arrival_time_sigma=0.005, propagation_speed=340)
    >>> heard
    Location([699.393 ± 1.23, 899.734 ± 1.01], 0 of 5 faulty)
    >>> round(heard.emission_time, 2)
    10.0
    """
    places, axes, sigmas = stack_stations(stations)
    k, d = places.shape[-2:]
    own = given_biases(bias, stations, k)
    given: dict[Kind, tuple[npt.ArrayLike | None, npt.ArrayLike | None]] = {
        "range": (range, range_sigma),
        "azimuth": (azimuth, azimuth_sigma),
        "elevation": (elevation, elevation_sigma),
        "range_difference": (range_difference, range_difference_sigma),
    }
    correlation = correlation_of(range_difference_correlation)
    measured: _Measured = {}
    for kind, (value, sigma) in given.items():
        if value is not None:
            random = deviations(sigma, sigmas.get(kind), kind, k, value, degrees=degrees)
            seen = checked(value, kind, k, sigma=random, degrees=degrees)
            measured[kind] = own.corrected(kind, seen), own.widened(kind, random, measured=seen)
    arrivals = None
    if arrival_time is not None:
        known = sigmas.get("arrival_time")
        arrivals = read_arrivals(arrival_time, arrival_time_sigma, known, propagation_speed, k)
        measured["arrival_time"] = _timed(arrivals, own)
    differences = "range_difference" in measured and correlation > 0
    timed = differences or arrivals is not None
    usual = _REDUNDANCY_OF_ARRIVALS if timed else _REDUNDANCY
    require_kinds(measured, d, shared=differences)
    unknown = _is_unknown(measured)
    _require_method(method, measured, d, start := _start(initial, d), max_range)
    _require_deviations(measured, unknown=unknown)
    level = read_height(height, height_sigma, d)
    speed, wind = read_medium(
        propagation_speed,
        (propagation_speed_sigma, wind_sigma),
        measured,
        robust=method == "robust",
        unknown=unknown,
    )
    if level is not None and unknown:
        raise ValueError("height is given; then the standard deviations must be, too")
    batch = _batch(places, measured, start, level)
    lacks = _lacks_height(measured, d) if level is None else None
    level = level if lacks is None else anywhere(places, lacks)
    values, stated = _by_station(measured, batch, k)
    pools = flag(pooled, "pooled")
    free = own.free(tuple(measured))
    rows = (
        _matched(places, batch, 2),
        None if axes is None else _matched(axes, batch, 3),
        values,
        _matched(stated, batch, 2),
        survey_sigmas(stations),
        None if level is None else _matched(level, batch, 1),
    )
    if method == "posterior":
        location = locate_posterior(
            *rows[:5], max_range=max_range, pooled=pools, free=free, n_threads=threads(n_threads)
        )
        return _checked(location, places)
    grows = np.full_like(free, pools) if pools or unknown else free
    solver = partial(
        _solver,
        rows,
        (
            None if start is None else _matched(start, batch, 1),
            (method, integer(usual if redundancy is None else redundancy, "redundancy", 1)),
            (flag(multipath, "multipath"), correlation),
        ),
        (
            pools,
            (speed.relative, wind.relative, (speed.as_stated, wind.as_stated)),
            threads(n_threads),
        ),
    )
    common, rows, grows = without_common(
        stations if math.prod(batch) == 1 and not (pools or unknown) else (),
        (measured, own),
        (rows, grows),
        solver,
    )
    solve = solver(grows)
    *result, (growth, factor, redundancies, missing), found = solve(*rows[2:4])
    nearly = partial(_nearly_as_stated, solve, pools or unknown)
    is_meant = not doubt_numbers(result, *rows[2:4], nearly, degrees=degrees)
    speed, wind, arrivals = _in_medium((speed, wind), found, rows[2].shape, arrivals)
    if (
        is_meant
        and (method == "robust" and free.any() and max(growth) > 1)
        and not (pools or unknown or speed.relative)
    ):
        warn_if_explained(rows, (result[0], None, result[3]))
    unit = 1.0 if arrivals is None else arrivals.speed
    location = included(
        common,
        own,
        location_of(
            tuple(result),
            tuple(measured),
            estimated=unknown,
            arrivals=arrivals,
            speed=speed,
            wind=wind,
            systematic=said(
                free,
                tells=not lies_between(result[-1][1], -np.inf, 0.0)
                and min(redundancies) >= _CHECKED,
            ),
            bias=own.found(
                _stated(measured, arrivals),
                [each + shared for each, shared in zip(growth, missing, strict=True)],
            ),
            scene=Scene(
                *rows[:2],
                speed.scaled(rows[2], KINDS) if wind.values is None else wind.values,
                rows[3] if unknown else _grown(speed.scaled(rows[3], KINDS), grows, growth),
                outlier=result[3],
                unit=unit,
                surveys=rows[4],
                height=rows[5],
                correlation=correlation,
                pooled=pools,
            ),
        ),
    )
    if pools and unknown:
        location = _with_sigma(location, factor[KINDS.index(next(iter(measured)))], unit)
    return _checked(location if lacks is None else without_height(location, lacks), places)


def _with_sigma(location: Location, factor: float, unit: FloatArray | float) -> Location:
    """Return a location with the sigma that all measurements have in common."""
    sigma = np.broadcast_to(np.sqrt(factor) / unit, np.shape(location.statistic))
    return replace(location, measurement_sigma=scalar_or_array(np.array(sigma)))


def _in_medium(
    medium: tuple[Speed, Wind],
    found: tuple[Any, Any],
    shape: tuple[int, ...],
    arrivals: Arrivals | None,
) -> tuple[Speed, Wind, Arrivals | None]:
    """Return speed and wind as the core found them, and the arrivals of signals of this speed."""
    speed, wind = medium[0].found(*found[0]), medium[1].found(found[1], shape)
    return speed, wind, None if arrivals is None else arrivals.at(speed.scale)


def _solver(
    rows: tuple[Any, ...], first: tuple[Any, ...], last: tuple[Any, ...], grows: BoolArray
) -> Callable[[FloatArray, FloatArray], Any]:
    """Return what solves for measurements and sigmas other than those of `rows`."""
    return partial(_solved, rows, (*first, grows.ravel().tolist(), *last))


def _solved(
    rows: tuple[Any, ...], options: tuple[Any, ...], values: FloatArray, sigmas: FloatArray
) -> Any:
    """Return the result of the core for measurements and sigmas other than those of `rows`."""
    places, axes, _, _, surveys, height = rows
    return _core.locate(places, axes, values, sigmas, surveys, height, *options)


def _nearly_as_stated(
    solve: Callable[..., Any], relative: bool, values: FloatArray, sigmas: FloatArray
) -> Any:
    """Return the result of the core, None if it needs much larger sigmas than those stated."""
    *result, (growth, *_), _ = solve(values, sigmas)
    return result if relative or max(growth) < _MOST_GROWTH else None


_Measured: TypeAlias = dict[Kind, tuple[FloatArray, FloatArray]]


def _lacks_height(measured: _Measured, d: int) -> BoolArray | None:
    """Return at which instants nothing determines the height; None if at none."""
    if d == 2:
        return None
    alone = azimuths_alone({kind: value for kind, (value, _) in measured.items()})
    return alone if alone.any() else None


def _start(initial: npt.ArrayLike | None, d: int) -> FloatArray | None:
    if initial is None:
        return None
    start = finite(initial, "initial")
    if start.shape[-1:] != (d,):
        raise ValueError(f"initial has shape {start.shape}; it must be (..., {d})")
    return start


def _require_deviations(measured: _Measured, *, unknown: bool) -> None:
    """Raise an error if a standard deviation is missing and is not to be estimated."""
    if unknown:
        return
    for kind, (value, sigma) in measured.items():
        if lies_between(sigma, -np.inf, np.inf):
            continue
        missing = np.isnan(sigma)
        if missing.any() and (missing := missing & ~np.isnan(value)).any():
            station = int(np.argwhere(missing)[0, -1]) + int(kind == "range_difference")
            raise ValueError(
                f"{kind}_sigma of station {station} is missing; it is estimated only where one "
                "kind is measured and none of its standard deviations is given"
            )


def _timed(arrivals: Arrivals, own: Given) -> tuple[FloatArray, FloatArray]:
    """Return times of arrival in metres, corrected for the clocks' biases, and their sigmas."""
    unit = arrivals.speed[..., np.newaxis]
    kind: Kind = "arrival_time"
    return own.corrected(kind, arrivals.value, unit), own.widened(kind, arrivals.sigma, unit)


def _stated(measured: _Measured, arrivals: Arrivals | None) -> dict[Kind, FloatArray]:
    """Return the stated standard deviations; those of times of arrival are in seconds."""
    sigmas = {kind: sigma for kind, (_, sigma) in measured.items()}
    if arrivals is not None:
        sigmas["arrival_time"] = sigmas["arrival_time"] / arrivals.speed[..., np.newaxis]
    return sigmas


def _is_unknown(measured: _Measured) -> bool:
    """Return whether there is only one kind, whose common sigma is to be estimated."""
    return len(measured) == 1 and all(np.isnan(s).all() for _, s in measured.values())


def _require_method(
    method: str, measured: _Measured, d: int, start: FloatArray | None, max_range: float | None
) -> None:
    """Raise an error if the measurements or options do not suit the method."""
    if method in _LENTH:
        _require_lenth(measured, d, method)
    if method == "posterior":
        _require_azimuths(measured, d, method)
        if start is not None:
            raise ValueError(f"method is {method!r}, which does not use initial")
    elif max_range is not None:
        raise ValueError(f"method is {method!r}; max_range is for 'posterior'")


def _require_azimuths(measured: _Measured, d: int, method: str) -> None:
    if d != 2 or set(measured) != {"azimuth"}:
        raise ValueError(f"method is {method!r}; it is for azimuths alone, in the plane")


def _require_lenth(measured: _Measured, d: int, method: str) -> None:
    _require_azimuths(measured, d, method)
    sigma = measured["azimuth"][1]
    if not _is_unknown(measured) and np.ptp(sigma) != 0:
        raise ValueError(f"method is {method!r}; it needs the same azimuth_sigma everywhere")


def _batch(
    places: FloatArray,
    measured: _Measured,
    start: FloatArray | None,
    level: FloatArray | None,
) -> tuple[int, ...]:
    shapes = {"stations": places.shape[:-2]}
    for kind, (value, sigma) in measured.items():
        shapes[kind], shapes[f"{kind}_sigma"] = value.shape[:-1], sigma.shape[:-1]
    if start is not None:
        shapes["initial"] = start.shape[:-1]
    if level is not None:
        shapes["height"] = level.shape[:-1]
    if not any(shapes.values()):
        return ()
    return common_batch(**shapes)


def _by_station(
    measured: _Measured, batch: tuple[int, ...], k: int
) -> tuple[FloatArray, FloatArray]:
    """Return values and sigmas of all kinds, (..., kinds, K); nan where none was measured."""
    values = np.empty((*batch, len(KINDS), k))
    stated = np.empty((*_sigma_batch(measured), len(KINDS), k))
    values.fill(np.nan)
    stated.fill(np.nan)
    for kind, (value, sigma) in measured.items():
        at, first = KINDS.index(kind), int(kind == "range_difference")
        values[..., at, first:] = value
        stated[..., at, first:] = sigma
    return values, stated


def _sigma_batch(measured: _Measured) -> tuple[int, ...]:
    shapes = [sigma.shape[:-1] for _, sigma in measured.values()]
    return np.broadcast_shapes(*shapes) if any(shapes) else ()


def _grown(sigmas: FloatArray, grows: BoolArray, growth: Sequence[float]) -> FloatArray:
    """Return the standard deviations, increased as much as the inconsistencies require."""
    if growth.count(1.0) == len(growth):
        return sigmas
    grown: FloatArray = sigmas * np.sqrt(np.where(grows, np.reshape(growth, (-1, 1)), 1.0))
    return grown


def _matched(array: FloatArray, batch: tuple[int, ...], axes: int) -> FloatArray:
    """Return one row for each element of the batch, or a single row for all of them."""
    tail = array.shape[array.ndim - axes :]
    if array.size == math.prod(tail):
        return array.reshape(1, *tail)
    return spread(array, (*batch, *tail))


def _checked(location: Location, places: FloatArray) -> Location:
    """Return the location; raise an error if there is only one instant and it was not located."""
    status = location.status
    warn_if_mirrored(location, places)
    if status is LocationStatus.SINGULAR:
        raise np.linalg.LinAlgError(status.message)
    if isinstance(status, LocationStatus) and status:
        raise ValueError(status.message)
    return location
