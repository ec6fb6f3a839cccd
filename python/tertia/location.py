"""Location: positions from the measurements of several stations at one instant, without outliers.

Measurements are ranges, azimuths, elevations and range differences, in any mixture, in the plane or
in space. The position minimises the sum of a loss of the whitened residuals `(measured - predicted)
/ sigma`: half the square, or Tukey's biweight (Beaton, Tukey 1974), which gives no weight to
residuals above 4.685. Azimuths and elevations are in radians; azimuths are clockwise from north;
positions are local east, north and up in metres.

The covariance is that of the linearised problem. If the error is not small compared with the
distances, the true covariance is larger and the position is biased: see docs/location.md.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    finite,
    integer,
    positive,
    radians,
    samples,
    scalar_or_array,
    threads,
)
from tertia.sensors import (
    ANGLES,
    KINDS,
    ByKind,
    Kind,
    Station,
    angle_sigma,
    by_kind,
    stack_stations,
)

__all__ = [
    "Accuracy",
    "ByKind",
    "Kind",
    "Location",
    "LocationMethod",
    "LocationStatus",
    "Station",
    "accuracy_map",
    "locate",
]

LocationMethod: TypeAlias = Literal[
    "robust", "least-squares", "lenth-mle", "lenth-huber", "lenth-andrews"
]

_LENTH = {"lenth-mle", "lenth-huber", "lenth-andrews"}
# with as many degrees of freedom, two faults still leave a majority
_REDUNDANCY = 3


class LocationStatus(enum.IntEnum):
    """Whether an instant was located: OK, which is 0 and false, or why not."""

    OK = 0
    TOO_FEW = 1
    NO_INTERSECTION = 2
    SINGULAR = 3
    AMBIGUOUS = 4
    AT_STATION = 5
    NOT_CONVERGED = 6

    @property
    def message(self) -> str:
        """What happened, as a sentence."""
        return _MESSAGES[self]


_MESSAGES = {
    LocationStatus.OK: "the target was located",
    LocationStatus.TOO_FEW: "there are fewer measurements than coordinates",
    LocationStatus.NO_INTERSECTION: (
        "the measurements do not meet: bearings are parallel, diverge or meet behind a station, "
        "or ranges are too short or too long"
    ),
    LocationStatus.SINGULAR: (
        "the geometry leaves a direction undetermined: stations and target are in line, or all "
        "measurements change alike"
    ),
    LocationStatus.AMBIGUOUS: (
        "two positions explain the measurements (almost) equally well; give initial, or measure "
        "something else"
    ),
    LocationStatus.AT_STATION: (
        "the position is at a station, or straight above one that measures angles"
    ),
    LocationStatus.NOT_CONVERGED: "no minimum was reached",
}


@dataclass(frozen=True, slots=True, eq=False)
class Location:
    """A position, with the residuals and outliers of the measurements.

    Attributes
    ----------
    position : ndarray of shape (..., D)
        The position in metres; nan where there is none.
    covariance : ndarray of shape (..., D, D)
        Covariance of the position; variances are infinite if sigma is unknown and there is no
        redundancy.
    residual : ByKind
        Whitened residuals of all measurements.
    outlier : ByKind
        Measurements that were treated as faults; none for least squares.
    degrees_of_freedom : int or ndarray of shape (...)
        Number of measurements minus number of coordinates.
    statistic : float or ndarray of shape (...)
        Sum of all squared residuals, faults included.
    pvalue : float or ndarray of shape (...)
        Probability of a larger sum of squares if there are no faults; nan if sigma was estimated. A
        small p-value means that a measurement or a sigma is wrong.
    dop : float or ndarray of shape (...)
        Dilution of precision: the square root of the trace of the covariance for measurements with
        sigma 1. In metres per metre, or metres per radian; nan for mixtures of both.
    measurement_sigma : float, ndarray of shape (...) or None
        The common standard deviation of the measurements where it was estimated.
    status : LocationStatus or ndarray of int, shape (...)
        OK, which is 0, or why there is no position.
    """

    position: FloatArray
    covariance: FloatArray
    residual: ByKind
    outlier: ByKind
    degrees_of_freedom: int | IntArray
    statistic: float | FloatArray
    pvalue: float | FloatArray
    dop: float | FloatArray
    measurement_sigma: float | FloatArray | None
    status: LocationStatus | IntArray

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations of the coordinates, of shape (..., D)."""
        return np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1))

    @property
    def success(self) -> bool | BoolArray:
        """Whether there is a position, of shape (...)."""
        known: bool | BoolArray = scalar_or_array(np.asarray(self.status) == 0)
        return known

    def __repr__(self) -> str:
        """Show position and sigma where there is no batch."""
        if self.position.ndim > 1:
            found, count = np.count_nonzero(self.success), np.size(self.success)
            return f"Location(batch {self.position.shape[:-1]}, {found} of {count} located)"
        pairs = zip(self.position, self.sigma, strict=True)
        listed = ", ".join(f"{value:.6g} ± {sigma:.3g}" for value, sigma in pairs)
        count = int(self.degrees_of_freedom) + self.position.size
        return f"Location([{listed}], {self.outlier.count} of {count} faulty)"


@dataclass(frozen=True, slots=True, eq=False)
class Accuracy:
    """The accuracy of positions from given stations, before anything is measured.

    Attributes
    ----------
    covariance : ndarray of shape (..., D, D)
        Covariance of a least-squares position; variances are infinite where it is not determined.
    dop : float or ndarray of shape (...)
        See `Location`.
    """

    covariance: FloatArray
    dop: float | FloatArray

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations of the coordinates, of shape (..., D)."""
        return np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1))

    @property
    def drms(self) -> float | FloatArray:
        """Distance root mean square: root of the sum of the variances, of shape (...)."""
        total: float | FloatArray = scalar_or_array(
            np.sqrt(np.trace(self.covariance, axis1=-2, axis2=-1))
        )
        return total

    def __repr__(self) -> str:
        """Show the number of positions."""
        return f"Accuracy(batch {self.covariance.shape[:-2]})"


def locate(
    stations: Sequence[Station] | npt.ArrayLike,
    *,
    range: npt.ArrayLike | None = None,  # noqa: A002  # that is what it is
    azimuth: npt.ArrayLike | None = None,
    elevation: npt.ArrayLike | None = None,
    range_difference: npt.ArrayLike | None = None,
    range_sigma: npt.ArrayLike | None = None,
    azimuth_sigma: npt.ArrayLike | None = None,
    elevation_sigma: npt.ArrayLike | None = None,
    range_difference_sigma: npt.ArrayLike | None = None,
    method: LocationMethod = "robust",
    redundancy: int = _REDUNDANCY,
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
        The range of each station except the first, minus that of the first, in metres. Their errors
        are assumed to be independent.
    range_sigma, azimuth_sigma, elevation_sigma : array_like of shape (..., K), optional
        Standard deviations in place of those of the stations.
    range_difference_sigma : array_like of shape (..., K - 1), optional
        Standard deviations of the range differences.
    method : {"robust", "least-squares", "lenth-mle", "lenth-huber", "lenth-andrews"}
        "robust": Tukey's biweight with at least `redundancy` degrees of freedom, otherwise least
        squares; "least-squares": always; the others are Lenth's (1981) estimators, for azimuths in
        the plane only.
    redundancy : int
        Smallest number of degrees of freedom with which outliers are searched for. With one, a
        fault cannot be attributed to a measurement; with two, rarely.
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

    Notes
    -----
    Leading axes are broadcast against each other. If only one kind is measured and none of its
    standard deviations is given, a common one is estimated: by least squares from the residuals,
    robustly from their median size.

    The start is the best of the points where a minimal set of measurements agrees. Tukey's biweight
    (4.685) is minimised from there and from the result of eight Huber steps (1.345), and the better
    result is kept. Other starts are tried as well; two minima whose likelihoods differ by less than
    a factor of 20 are an error. Faults have weight 0. The robust covariance is `0.963 (J' W J)^-1`,
    which for normal errors is 5 % larger than that of least squares, plus `6 q (1 - q) d d'` for
    each measurement that is a fault with probability q, where d is the change of the position if it
    is left out. Cost O(M) per step, about ten steps.

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
    """
    places, axes, sigmas = stack_stations(stations)
    k, d = places.shape[-2:]
    given: dict[Kind, tuple[npt.ArrayLike | None, npt.ArrayLike | None]] = {
        "range": (range, range_sigma),
        "azimuth": (azimuth, azimuth_sigma),
        "elevation": (elevation, elevation_sigma),
        "range_difference": (range_difference, range_difference_sigma),
    }
    measured = {
        kind: (
            checked(value, kind, k, degrees=degrees),
            _deviations(sigma, sigmas.get(kind), kind, k, degrees=degrees),
        )
        for kind, (value, sigma) in given.items()
        if value is not None
    }
    if not measured:
        raise ValueError("nothing was measured; give range, azimuth, elevation or range_difference")
    if d == 2 and "elevation" in measured:
        raise ValueError("elevation needs stations with three coordinates")
    _require_deviations(measured)
    if method in _LENTH:
        _require_lenth(measured, d, method)
    start = None if initial is None else finite(initial, "initial")
    if start is not None and start.shape[-1:] != (d,):
        raise ValueError(f"initial has shape {start.shape}; it must be (..., {d})")
    batch = _batch(places, measured, start)
    values = np.full((*batch, len(KINDS), k), np.nan)
    deviations = np.full((*_sigma_batch(measured), len(KINDS), k), np.nan)
    for kind, (value, sigma) in measured.items():
        at, first = KINDS.index(kind), int(kind == "range_difference")
        values[..., at, first:] = value
        deviations[..., at, first:] = sigma
    result = _core.locate(
        _matched(places, batch, 2),
        None if axes is None else _matched(axes, batch, 3),
        values,
        _matched(deviations, batch, 2),
        None if start is None else _matched(start, batch, 1),
        method,
        integer(redundancy, "redundancy", 1),
        threads(n_threads),
    )
    location = location_of(result, tuple(measured), estimated=_is_unknown(measured))
    if isinstance(location.status, LocationStatus):
        _raise(location.status)
    return location


def accuracy_map(
    stations: Sequence[Station] | npt.ArrayLike,
    grid: npt.ArrayLike,
    *,
    kinds: Sequence[Kind] | None = None,
    range_sigma: npt.ArrayLike | None = None,
    azimuth_sigma: npt.ArrayLike | None = None,
    elevation_sigma: npt.ArrayLike | None = None,
    range_difference_sigma: npt.ArrayLike | None = None,
    degrees: bool = False,
    n_threads: int | None = None,
) -> Accuracy:
    """Return the covariance that positions would have, before anything is measured.

    Parameters
    ----------
    stations : sequence of K Station, or array_like of shape (K, D)
        The stations, or their positions alone.
    grid : array_like of shape (..., D)
        Positions of the target in metres.
    kinds : sequence of {"range", "azimuth", "elevation", "range_difference"}, optional
        Kinds that are measured; by default those with a standard deviation.
    range_sigma, azimuth_sigma, elevation_sigma : array_like of shape (K,), optional
        Standard deviations in place of those of the stations.
    range_difference_sigma : array_like of shape (K - 1,), optional
        Standard deviations of range differences (see `locate`).
    degrees : bool
        Whether the angles and their standard deviations given here are in degrees.
    n_threads : int, optional
        Threads to use; by default one for small tasks and all cores for large ones.

    Returns
    -------
    Accuracy
        Covariance and dilution of precision of every position. The variances are infinite where the
        measurements do not determine the position, or it is at a station.

    Raises
    ------
    ValueError
        A wrong shape, a standard deviation that is missing or not positive, or a kind that does
        not exist.
    TypeError
        An argument of the wrong type.

    Examples
    --------
    >>> from tertia.location import Station, accuracy_map
    >>> radars = [Station([0, 0], range_sigma=10.0), Station([3000, 0], range_sigma=10.0)]
    >>> accuracy_map(radars, [[1500, 1500], [1500, 0]]).sigma
    array([[10., 10.],
           [inf, inf]])
    """
    places, axes, own = stack_stations(stations)
    if places.ndim != 2:
        raise ValueError("stations must have one position each")
    points = finite(grid, "grid")
    k, d = places.shape
    if points.shape[-1:] != (d,):
        raise ValueError(f"grid has shape {points.shape}; it must be (..., {d})")
    given = dict(
        zip(
            KINDS,
            (range_sigma, azimuth_sigma, elevation_sigma, range_difference_sigma),
            strict=True,
        )
    )
    deviations = np.full((1, len(KINDS), k), np.nan)
    for kind in _chosen(kinds, given, own):
        sigma = _deviations(given[kind], own.get(kind), kind, k, degrees=degrees)
        if sigma.ndim > 1:
            raise ValueError(f"{kind}_sigma has shape {sigma.shape}; it must have no batch")
        if kinds is not None and np.all(np.isnan(sigma)):
            raise ValueError(f"{kind}_sigma is missing")
        first = int(kind == "range_difference")
        deviations[0, KINDS.index(kind), first:] = sigma
    if d == 2 and not np.all(np.isnan(deviations[0, 2])):
        raise ValueError("elevation needs stations with three coordinates")
    if np.all(np.isnan(deviations)):
        raise ValueError("no standard deviation is given; nothing would be measured")
    covariance, dop = _core.location_accuracy(
        places[np.newaxis],
        None if axes is None else axes[np.newaxis],
        deviations,
        np.ascontiguousarray(points),
        threads(n_threads),
    )
    return Accuracy(covariance, scalar_or_array(dop))


_Measured: TypeAlias = dict[Kind, tuple[FloatArray, FloatArray]]


def checked(value: npt.ArrayLike, kind: str, k: int, *, degrees: bool = False) -> FloatArray:
    """Return measurements, (..., K) or (..., K - 1), within their domain."""
    array = radians(value, kind, degrees=degrees) if kind in ANGLES else samples(value, kind)
    _require_length(array, kind, k)
    with np.errstate(invalid="ignore"):
        if kind == "range":
            wrong, domain = (array <= 0) | np.isinf(array), "a positive number"
        elif kind == "elevation":
            wrong, domain = np.abs(array) > np.pi, "between -pi and pi (radians)"
        else:
            wrong, domain = np.isinf(array), "a finite number"
    bad = np.argwhere(wrong)
    if len(bad):
        place = ", ".join(map(str, bad[0]))
        raise ValueError(f"{kind}[{place}] is {array[tuple(bad[0])]}; it must be {domain}, or nan")
    return array


def _deviations(
    sigma: npt.ArrayLike | None, own: FloatArray | None, kind: str, k: int, *, degrees: bool
) -> FloatArray:
    """Return standard deviations, (..., K) or (..., K - 1), nan where they are unknown."""
    count = k - int(kind == "range_difference")
    if sigma is None:
        return np.full(count, np.nan) if own is None else own
    name = f"{kind}_sigma"
    array = positive(angle_sigma(sigma, name, degrees=degrees), name)
    if array.ndim == 0:
        return np.full(count, array)
    _require_length(array, name, k)
    return array


def _require_length(array: FloatArray, name: str, k: int) -> None:
    count = k - int(name.startswith("range_difference"))
    if array.ndim < 1 or array.shape[-1] != count:
        raise ValueError(
            f"{name} has shape {array.shape}; for {k} stations it must be (..., {count})"
        )


def _require_deviations(measured: _Measured) -> None:
    """Fail where a standard deviation is missing that cannot be estimated."""
    if _is_unknown(measured):
        return
    for kind, (value, sigma) in measured.items():
        missing = ~np.isnan(value) & np.isnan(sigma)
        if np.any(missing):
            station = int(np.argwhere(missing)[0, -1]) + int(kind == "range_difference")
            raise ValueError(
                f"{kind}_sigma of station {station} is missing; it is estimated only where one "
                "kind is measured and none of its standard deviations is given"
            )


def _is_unknown(measured: _Measured) -> bool:
    """Whether the common standard deviation of the only kind is to be estimated."""
    return len(measured) == 1 and all(np.all(np.isnan(s)) for _, s in measured.values())


def _require_lenth(measured: _Measured, d: int, method: str) -> None:
    if d != 2 or set(measured) != {"azimuth"}:
        raise ValueError(f"method is {method!r}; it is for azimuths alone, in the plane")
    sigma = measured["azimuth"][1]
    if not _is_unknown(measured) and np.ptp(sigma) != 0:
        raise ValueError(f"method is {method!r}; it needs the same azimuth_sigma everywhere")


def _batch(places: FloatArray, measured: _Measured, start: FloatArray | None) -> tuple[int, ...]:
    shapes = {"stations": places.shape[:-2]}
    for kind, (value, sigma) in measured.items():
        shapes[kind], shapes[f"{kind}_sigma"] = value.shape[:-1], sigma.shape[:-1]
    if start is not None:
        shapes["initial"] = start.shape[:-1]
    try:
        return np.broadcast_shapes(*shapes.values())
    except ValueError:
        listed = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
        raise ValueError(f"the batches do not fit together: {listed}") from None


def _sigma_batch(measured: _Measured) -> tuple[int, ...]:
    return np.broadcast_shapes(*(sigma.shape[:-1] for _, sigma in measured.values()))


def _matched(array: FloatArray, batch: tuple[int, ...], axes: int) -> FloatArray:
    """Return rows for each element of the batch, or the only one."""
    tail = array.shape[array.ndim - axes :]
    if array.size == int(np.prod(tail)):
        return array.reshape(1, *tail)
    return np.broadcast_to(array, (*batch, *tail))


def _chosen(
    kinds: Sequence[Kind] | None, given: dict[Kind, Any], own: dict[str, FloatArray]
) -> list[Kind]:
    """Return the kinds that are measured."""
    if kinds is None:
        return [kind for kind in KINDS if given[kind] is not None or kind in own]
    for kind in kinds:
        if kind not in KINDS:
            raise ValueError(f"kinds has {kind!r}; it must be one of {', '.join(KINDS)}")
    return list(kinds)


def location_of(
    result: tuple[FloatArray, FloatArray, FloatArray, BoolArray, list[FloatArray]],
    kinds: Sequence[Kind],
    *,
    estimated: bool,
) -> Location:
    position, covariance, residual, outlier, columns = result
    statuses, degrees, statistic, pvalue, dop, sigma = columns
    status: LocationStatus | IntArray = statuses.astype(np.int64)
    if position.ndim == 1:
        status = LocationStatus(int(statuses))

    return Location(
        position,
        covariance,
        by_kind(residual, kinds),
        by_kind(outlier, kinds),
        scalar_or_array(degrees.astype(np.int64)),
        scalar_or_array(statistic),
        scalar_or_array(pvalue),
        scalar_or_array(dop),
        scalar_or_array(sigma) if estimated else None,
        status,
    )


def _raise(status: LocationStatus) -> None:
    if status == LocationStatus.SINGULAR:
        raise np.linalg.LinAlgError(status.message)
    if status:
        raise ValueError(status.message)
