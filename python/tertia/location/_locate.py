"""Positions from the measurements of one instant."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import (
    BoolArray,
    FloatArray,
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
from tertia.location._degrees import warn_if_degrees
from tertia.location._height import anywhere, read_height, without_height
from tertia.location._posterior import locate_posterior
from tertia.location._readers import checked, correlation_of, deviations, require_kinds
from tertia.location._result import Location, LocationMethod, LocationStatus, location_of
from tertia.location._scene import Scene
from tertia.sensors import Bias, Kind, Station
from tertia.sensors._kinds import ANGLES, KINDS
from tertia.sensors._sensors import stack_stations, survey_sigmas

_LENTH = {"lenth-mle", "lenth-huber", "lenth-andrews"}
# with as many degrees of freedom, two faults still leave a majority
_REDUNDANCY = 3
# odds of faults are part of their loss, and two of five arrivals tell a fault mostly
_REDUNDANCY_OF_ARRIVALS = 2


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
        The stations, or their positions alone, with D = 2 or 3.
    range : array_like of shape (..., K), optional
        Ranges in metres, nan where there is none.
    azimuth : array_like of shape (..., K), optional
        Azimuths in radians, clockwise from north.
    elevation : array_like of shape (..., K), optional
        Elevations in radians above the horizon, in space only.
    range_difference : array_like of shape (..., K - 1), optional
        The range of each station except the first, minus that of the first, in metres.
    arrival_time : array_like of shape (..., K), optional
        When the signal of one event came to each station, nan where it did not: seconds, or dates
        or differences of NumPy (``datetime64[ns]``). Seconds since 1970 are exact to .2 µs only,
        70 m for light; nanoseconds as dates lose nothing. The emission is unknown, and found.
    range_sigma, azimuth_sigma, elevation_sigma : array_like of shape (..., K), optional
        Standard deviations in place of those of the stations.
    range_difference_sigma : array_like of shape (..., K - 1), optional
        Standard deviations of the range differences.
    arrival_time_sigma : array_like of shape (..., K), optional
        Standard deviations of the times of arrival in seconds.
    bias : Bias, optional
        Systematic errors of the stations, in place of theirs: of all, or of K. Values are
        subtracted, and their sigmas are part of the covariance; `Bias()` trusts the stated sigmas.
        None, of the call and of stations: sigmas grow as far as contradictions between the
        stations demand, and not at all where nothing contradicts (see Notes).
    range_difference_correlation : float
        Correlation of the errors of range differences: .5 if all share the error of the first
        station, which has a variance of its own like the others; 0 if they are independent. The
        common variance is this fraction of the smallest of their variances.
    propagation_speed : array_like of shape (...)
        Speed of the signal in metres per second, by default that of light.
    multipath : bool
        Whether outliers among times of arrival, and among range differences with a correlation, are
        late rather than early (20 to 1), as with multipath. Otherwise both are as
        likely.
    height, height_sigma : array_like of shape (...), optional
        The last coordinate of the target in metres, in space only, and its standard deviation: a
        measurement like the others. Azimuths alone do not determine it: without `height` up is nan,
        its variance infinite, and east and north are those in the plane.
    method : {"robust", "least-squares", "lenth-mle", "lenth-huber", "lenth-andrews", "posterior"}
        "robust": Tukey's biweight with at least `redundancy` degrees of freedom, otherwise least
        squares; "least-squares": always. The others are for azimuths in the plane only: Lenth's
        (1981) estimators, and "posterior", the expected position for two bearings or more whose
        sigma is known roughly or not at all.
    max_range : float, optional
        Of "posterior", which needs it: largest distance of the target from the nearest station, in
        metres. Within it all positions are evenly likely.
    pooled : bool
        Whether standard deviations are relative: the whole batch tells one factor for each kind, or
        the common standard deviation where none is given. It may be below 1.
    redundancy : int, optional
        Smallest number of degrees of freedom with which outliers are searched for: by default 3,
        with times of arrival 2. With one, a fault cannot be attributed to a measurement; with two,
        of angles and ranges rarely.
    initial : array_like of shape (..., D), optional
        A position near the target. It selects one of several positions that fit the measurements.
    degrees : bool
        Whether the angles and their standard deviations given here are in degrees.
    n_threads : int, optional
        Threads to use; by default one for small tasks and all cores for large ones.

    Returns
    -------
    Location
        Position, covariance, residuals and faults. In a batch, an instant without a position has
        nan there, and the reason in `status`.

    Raises
    ------
    ValueError
        A wrong shape, a number outside its domain, or a missing standard deviation. For a single
        instant, also a target that cannot be located: too few measurements, bearings that do not
        intersect, two positions that fit the measurements equally well, or a target at a station.
    numpy.linalg.LinAlgError
        For a single instant, a geometry that leaves a direction undetermined.
    TypeError
        An argument of the wrong type.

    Warns
    -----
    UserWarning
        Angles of which most contradict each other as radians, and fit as degrees.

    Notes
    -----
    Leading axes are broadcast against each other. If only one kind is measured and none of its
    standard deviations is given, a common one is estimated: by least squares from the residuals,
    robustly from their median size.

    The emission b of times of arrival `c t = b + |p - s| + e` is one more unknown, with a flat
    prior. This is the same as the differences to any of the stations with their full covariance.
    Range differences that have a common error are taken as times of arrival, that of the first
    station at 0: if it is the one that is wrong, all differences are marked. Here the loss is `-ln`
    of the density of normal noise and one fault in a hundred, of up to 50 sigma; residuals of more
    than 3.9 sigma, early ones of 4.6, are faults. The covariance is `(J' W J)^-1` with the weights
    of that loss, plus the same term for measurements in doubt. `Station.position_sigma` is part of
    the errors of all measurements of a station, unless their sigma is to be estimated. In a batch
    whose arrivals are wrong more often than one in a hundred, the density is that of their share.

    The start is the best of the points where a minimal set of measurements agrees, or the median of
    the stations' own fixes. Tukey's biweight (4.685) is minimised from the result of up to eight
    Huber steps (1.345) from there. Other starts are tried as well; two minima whose likelihoods
    differ by less than a factor of 20 are an error. Faults have weight 0. The robust covariance is
    `0.963 (J' W J)^-1`, which for normal errors is 5 % larger than that of least squares, plus `6 q
    (1 - q) d d'` for each measurement that is a fault with probability q, where d is the change of
    the position if it is left out. Cost O(M) per step, about ten steps.

    Systematic errors (`bias=None`). In a batch, the variances of a kind grow by the factor of
    restricted maximum likelihood (Patterson, Thompson 1971) that makes the residuals of at most 256
    instants as large as they are, and by what is not known of it; time-correlated errors count as
    fewer instants. A single instant grows where its own residuals fail a test at 10 %. Where
    nothing contradicts, nothing is added. An error that all stations share leaves no contradiction:
    what is stated of a variance but does not scatter in a batch (at 99 %) is taken for one, and
    added to the covariance; only `bias` can tell of a larger one. With one or two degrees of
    freedom, sigmas that are half of what they should be are found in less than half of all instants
    (coverage 67 and 73 % instead of 53 %): locate them as a batch.

    Where the standard deviation is not small compared with the distance to the nearest station, the
    ellipse of 95 % reaches as far as the likelihood along its axes (Bates, Watts 1988); if it has
    no end, the status is ILL_CONDITIONED.

    Examples
    --------
    Five direction finders, one with an error of half a radian:

    >>> import numpy as np
    >>> from tertia.location import locate
    >>> places = [[0, 0], [1000, 0], [2000, 0], [0, 2000], [2000, 2000]]
    >>> bearings = [0.7864, 0.0010, 5.4968, 2.3551, 3.4261]
    >>> fix = locate(places, azimuth=bearings, azimuth_sigma=0.002)
    >>> fix
    Location([1001.02 ± 1.52, 999.061 ± 2.34], 1 of 5 faulty)
    >>> fix.outlier.azimuth
    array([False, False, False, False,  True])

    An explosion, heard by five stations with clocks of 5 ms:

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
    measured = {
        kind: (
            own.corrected(kind, checked(value, kind, k, degrees=degrees)),
            own.widened(kind, deviations(sigma, sigmas.get(kind), kind, k, degrees=degrees)),
        )
        for kind, (value, sigma) in given.items()
        if value is not None
    }
    arrivals = None
    if arrival_time is not None:
        known = sigmas.get("arrival_time")
        arrivals = read_arrivals(arrival_time, arrival_time_sigma, known, propagation_speed, k)
        measured["arrival_time"] = _timed(arrivals, own)
    differences = "range_difference" in measured and correlation > 0
    timed = differences or arrivals is not None
    if redundancy is None:
        redundancy = _REDUNDANCY_OF_ARRIVALS if timed else _REDUNDANCY
    require_kinds(measured, d, shared=differences)
    unknown = _is_unknown(measured)
    start = _start(initial, d)
    _require_method(method, measured, d, start, max_range)
    _require_deviations(measured, unknown=unknown)
    level = read_height(height, height_sigma, d)
    if level is not None and unknown:
        raise ValueError("height is given; then the standard deviations must be, too")
    flat = level is None and d > 2 and set(measured) == {"azimuth"}
    if flat:
        level = anywhere(places)
    batch = _batch(places, measured, start, level)
    values = np.full((*batch, len(KINDS), k), np.nan)
    stated = np.full((*_sigma_batch(measured), len(KINDS), k), np.nan)
    for kind, (value, sigma) in measured.items():
        at, first = KINDS.index(kind), int(kind == "range_difference")
        values[..., at, first:] = value
        stated[..., at, first:] = sigma
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
        return _checked(location)
    grows = np.full_like(free, pools) if pools or unknown else free
    solve = partial(
        _solved,
        rows,
        (
            None if start is None else _matched(start, batch, 1),
            (method, integer(redundancy, "redundancy", 1)),
            (flag(multipath, "multipath"), correlation),
            grows.ravel().tolist(),
            pools,
            threads(n_threads),
        ),
    )
    result = solve(*rows[2:4])
    if not degrees and any(kind in measured for kind in ANGLES):
        warn_if_degrees(result[:-1], *rows[2:4], lambda *others: solve(*others)[:-1])
    growth, factor, _, common = result[-1]
    location = location_of(
        result[:-1],
        tuple(measured),
        estimated=unknown,
        arrivals=arrivals,
        systematic=said(free, tells=not lies_between(result[-2][1], -np.inf, 0.0)),
        bias=own.found(
            _stated(measured, arrivals),
            [each + shared for each, shared in zip(growth, common, strict=True)],
        ),
        scene=Scene(
            *rows[:3],
            rows[3] if unknown else _grown(rows[3], grows, growth),
            outlier=result[3],
            unit=1.0 if arrivals is None else arrivals.speed,
            surveys=rows[4],
            height=rows[5],
            correlation=correlation,
            pooled=pools,
        ),
    )
    if pools and unknown:
        common = np.sqrt(factor[KINDS.index(next(iter(measured)))])
        unit = 1.0 if arrivals is None else arrivals.speed
        sigma = np.broadcast_to(common / unit, np.shape(location.statistic))
        location = replace(location, measurement_sigma=scalar_or_array(np.array(sigma)))
    return _checked(without_height(location) if flat else location)


def _solved(
    rows: tuple[Any, ...], options: tuple[Any, ...], values: FloatArray, sigmas: FloatArray
) -> Any:
    """Return what the core finds with other measurements and sigmas than those of `rows`."""
    places, axes, _, _, surveys, height = rows
    return _core.locate(places, axes, values, sigmas, surveys, height, *options)


_Measured: TypeAlias = dict[Kind, tuple[FloatArray, FloatArray]]


def _start(initial: npt.ArrayLike | None, d: int) -> FloatArray | None:
    if initial is None:
        return None
    start = finite(initial, "initial")
    if start.shape[-1:] != (d,):
        raise ValueError(f"initial has shape {start.shape}; it must be (..., {d})")
    return start


def _require_deviations(measured: _Measured, *, unknown: bool) -> None:
    """Fail where a standard deviation is missing, and not to be estimated."""
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
    """Return times of arrival without what the clocks are fast, in metres, and their sigmas."""
    unit = arrivals.speed[..., np.newaxis]
    kind: Kind = "arrival_time"
    return own.corrected(kind, arrivals.value, unit), own.widened(kind, arrivals.sigma, unit)


def _stated(measured: _Measured, arrivals: Arrivals | None) -> dict[Kind, FloatArray]:
    """Return the standard deviations, those of arrivals in seconds."""
    sigmas = {kind: sigma for kind, (_, sigma) in measured.items()}
    if arrivals is not None:
        sigmas["arrival_time"] = sigmas["arrival_time"] / arrivals.speed[..., np.newaxis]
    return sigmas


def _is_unknown(measured: _Measured) -> bool:
    """Whether the common standard deviation of the only kind is to be estimated."""
    return len(measured) == 1 and all(np.isnan(s).all() for _, s in measured.values())


def _require_method(
    method: str, measured: _Measured, d: int, start: FloatArray | None, max_range: float | None
) -> None:
    """Fail where a method does not fit the measurements, or an option the method."""
    if method in _LENTH:
        _require_lenth(measured, d, method)
    if method == "posterior":
        _require_azimuths(measured, d, method)
        if start is not None:
            raise ValueError(f"method is {method!r}, which weighs all positions; without initial")
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
    try:
        return np.broadcast_shapes(*shapes.values())
    except ValueError:
        listed = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
        raise ValueError(f"the batches do not fit together: {listed}") from None


def _sigma_batch(measured: _Measured) -> tuple[int, ...]:
    shapes = [sigma.shape[:-1] for _, sigma in measured.values()]
    return np.broadcast_shapes(*shapes) if any(shapes) else ()


def _grown(sigmas: FloatArray, grows: BoolArray, growth: Sequence[float]) -> FloatArray:
    """Return the standard deviations with what the contradictions add."""
    if growth.count(1.0) == len(growth):
        return sigmas
    grown: FloatArray = sigmas * np.sqrt(np.where(grows, np.reshape(growth, (-1, 1)), 1.0))
    return grown


def _matched(array: FloatArray, batch: tuple[int, ...], axes: int) -> FloatArray:
    """Return rows for each element of the batch, or the only one."""
    tail = array.shape[array.ndim - axes :]
    if array.size == math.prod(tail):
        return array.reshape(1, *tail)
    return spread(array, (*batch, *tail))


def _checked(location: Location) -> Location:
    """Return it; fail where a single instant was not located."""
    status = location.status
    if status is LocationStatus.SINGULAR:
        raise np.linalg.LinAlgError(status.message)
    if isinstance(status, LocationStatus) and status:
        raise ValueError(status.message)
    return location
