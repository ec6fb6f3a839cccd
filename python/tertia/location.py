"""Location: a position at one instant from what several stations measured, some of it wrong.

Ranges, azimuths, elevations and range differences, in any mixture, in the plane or in space. The
position minimises the sum of a function of the whitened residuals `(measured - predicted) / sigma`:
half the square, or Tukey's biweight (Beaton, Tukey 1974), which leaves measurements out that are
4.685 sigmas off. Azimuths and elevations are radians; azimuths turn clockwise from north; positions
are local east, north and up in metres.

The covariance is that of the linearised problem. Where the error is not small beside the distances,
the true one is larger and the position biased: see docs/location.md.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass, fields
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
    real,
    samples,
    scalar_or_array,
    threads,
)

__all__ = [
    "Accuracy",
    "Kind",
    "Location",
    "LocationMethod",
    "Outliers",
    "Problem",
    "Residuals",
    "Station",
    "accuracy_map",
    "locate",
]

Kind: TypeAlias = Literal["range", "azimuth", "elevation", "range_difference"]
LocationMethod: TypeAlias = Literal[
    "robust", "least-squares", "lenth-mle", "lenth-huber", "lenth-andrews"
]

_KINDS: tuple[Kind, ...] = ("range", "azimuth", "elevation", "range_difference")
_STATION_KINDS = _KINDS[:3]
_LENTH = {"lenth-mle", "lenth-huber", "lenth-andrews"}
# with as many degrees of freedom, two faults still leave a majority
_REDUNDANCY = 3
# of the elements of axes times their transpose, from the identity
_ORTHONORMAL = 1e-9


class Problem(enum.IntEnum):
    """Why an instant has no position; 0, which is false, where it has one."""

    NONE = 0
    TOO_FEW = 1
    NO_INTERSECTION = 2
    SINGULAR = 3
    AMBIGUOUS = 4
    AT_STATION = 5
    NOT_CONVERGED = 6

    @property
    def reason(self) -> str:
        """What is wrong, as a sentence."""
        return _REASONS[self]


_REASONS = {
    Problem.NONE: "there is no problem",
    Problem.TOO_FEW: "there are fewer measurements than coordinates",
    Problem.NO_INTERSECTION: (
        "the measurements do not meet: bearings are parallel, diverge or meet behind a station, "
        "or ranges are too short or too long"
    ),
    Problem.SINGULAR: (
        "the geometry leaves a direction undetermined: stations and target are in line, or all "
        "measurements change alike"
    ),
    Problem.AMBIGUOUS: (
        "two positions explain the measurements (almost) equally well; give initial, or measure "
        "something else"
    ),
    Problem.AT_STATION: "the position is at a station, or straight above one that measures angles",
    Problem.NOT_CONVERGED: "no minimum was reached",
}


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Station:
    """Where a station is, and how well it measures.

    Attributes
    ----------
    position : ndarray of shape (..., 2) or (..., 3)
        East, north and up in metres; leading axes where the station moves.
    range_sigma : float or None
        Standard deviation of its ranges in metres; None: unknown, or it measures none.
    azimuth_sigma, elevation_sigma : float or None
        Those of its angles, in radians.
    name : str or None
        How pictures call it.
    axes : ndarray of shape (..., D, D) or None
        Its own east, north and up as rows, in the coordinates of the frame: azimuths and elevations
        refer to them. None: those of the frame. At another place of the earth they are others, see
        `tertia.geo`.
    """

    position: FloatArray
    range_sigma: float | None
    azimuth_sigma: float | None
    elevation_sigma: float | None
    name: str | None
    axes: FloatArray | None

    def __init__(
        self,
        position: npt.ArrayLike,
        *,
        range_sigma: float | None = None,
        azimuth_sigma: float | None = None,
        elevation_sigma: float | None = None,
        name: str | None = None,
        axes: npt.ArrayLike | None = None,
    ) -> None:
        place = finite(position, "position")
        _require_dimension(place, "position", "(..., 2) or (..., 3)")
        sigmas = {
            "range_sigma": range_sigma,
            "azimuth_sigma": azimuth_sigma,
            "elevation_sigma": elevation_sigma,
        }
        object.__setattr__(self, "position", place)
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "axes", None if axes is None else _axes(axes, place))
        for key, sigma in sigmas.items():
            number = None if sigma is None else float(positive(real(sigma, key), key))
            object.__setattr__(self, key, number)


@dataclass(frozen=True, slots=True, eq=False)
class Residuals:
    """Whitened residuals, `(measured - predicted) / sigma`; None for kinds that were not given.

    Attributes
    ----------
    range, azimuth, elevation : ndarray of shape (..., K) or None
        One for each station; nan where nothing was measured.
    range_difference : ndarray of shape (..., K - 1) or None
        One for each station but the first.
    """

    range: FloatArray | None
    azimuth: FloatArray | None
    elevation: FloatArray | None
    range_difference: FloatArray | None


@dataclass(frozen=True, slots=True, eq=False)
class Outliers:
    """Which measurements have no weight; None for kinds that were not given.

    Attributes
    ----------
    range, azimuth, elevation : ndarray of bool, shape (..., K), or None
        One for each station.
    range_difference : ndarray of bool, shape (..., K - 1), or None
        One for each station but the first.
    """

    range: BoolArray | None
    azimuth: BoolArray | None
    elevation: BoolArray | None
    range_difference: BoolArray | None

    @property
    def count(self) -> int | IntArray:
        """How many there are, of shape (...)."""
        marks = [getattr(self, field.name) for field in fields(self)]
        present = [mark for mark in marks if mark is not None]
        total: int | IntArray = scalar_or_array(
            np.asarray(sum(np.sum(mark, axis=-1) for mark in present))
        )
        return total


@dataclass(frozen=True, slots=True, eq=False)
class Location:
    """A position and what the measurements have to do with it.

    Attributes
    ----------
    position : ndarray of shape (..., D)
        The position in metres; nan where there is a problem.
    covariance : ndarray of shape (..., D, D)
        Its covariance; infinite variances where sigma is unknown and nothing is redundant.
    residuals : Residuals
        The whitened residuals of all measurements.
    outliers : Outliers
        The measurements that were treated as faults; none by least squares.
    degrees_of_freedom : int or ndarray of shape (...)
        Measurements less coordinates.
    chi_square : float or ndarray of shape (...)
        Sum of all squared residuals, faults included.
    p_value : float or ndarray of shape (...)
        Probability of a larger sum without faults; nan where sigma was estimated. A small one says
        that a measurement or a sigma is wrong.
    dilution : float or ndarray of shape (...)
        Dilution of precision: the root of the trace of the covariance that measurements with
        sigma 1 would give. Metres per metre, or metres per radian; nan for mixtures of both.
    measurement_sigma : float, ndarray of shape (...) or None
        The common standard deviation of the measurements where it was estimated.
    problem : Problem or ndarray of int, shape (...)
        Why there is no position; 0 where there is one.
    """

    position: FloatArray
    covariance: FloatArray
    residuals: Residuals
    outliers: Outliers
    degrees_of_freedom: int | IntArray
    chi_square: float | FloatArray
    p_value: float | FloatArray
    dilution: float | FloatArray
    measurement_sigma: float | FloatArray | None
    problem: Problem | IntArray

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations of the coordinates, of shape (..., D)."""
        return np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1))

    @property
    def located(self) -> bool | BoolArray:
        """Whether there is a position, of shape (...)."""
        known: bool | BoolArray = scalar_or_array(np.asarray(self.problem) == 0)
        return known

    def __repr__(self) -> str:
        """Tell position and sigma where there is no batch."""
        if self.position.ndim > 1:
            found, count = np.count_nonzero(self.located), np.size(self.located)
            return f"Location(batch {self.position.shape[:-1]}, {found} of {count} located)"
        pairs = zip(self.position, self.sigma, strict=True)
        listed = ", ".join(f"{value:.6g} ± {sigma:.3g}" for value, sigma in pairs)
        count = int(self.degrees_of_freedom) + self.position.size
        return f"Location([{listed}], {self.outliers.count} of {count} faulty)"


@dataclass(frozen=True, slots=True, eq=False)
class Accuracy:
    """What accuracy stations have at some positions, before anything is measured.

    Attributes
    ----------
    covariance : ndarray of shape (..., D, D)
        Of a position by least squares; infinite variances where it is not determined.
    dilution : float or ndarray of shape (...)
        See `Location`.
    """

    covariance: FloatArray
    dilution: float | FloatArray

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations of the coordinates, of shape (..., D)."""
        return np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1))

    @property
    def position_sigma(self) -> float | FloatArray:
        """Root of the sum of their squares (DRMS), of shape (...)."""
        total: float | FloatArray = scalar_or_array(
            np.sqrt(np.trace(self.covariance, axis1=-2, axis2=-1))
        )
        return total

    def __repr__(self) -> str:
        """Tell the number of positions."""
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
    n_threads: int | None = None,
) -> Location:
    """Locate a target by what several stations measured at the same instant.

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
        The range of each station but the first, less that of the first, in metres. Their errors
        are taken as independent of each other.
    range_sigma, azimuth_sigma, elevation_sigma : array_like of shape (..., K), optional
        Standard deviations in place of those of the stations.
    range_difference_sigma : array_like of shape (..., K - 1), optional
        Standard deviations of the range differences.
    method : {"robust", "least-squares", "lenth-mle", "lenth-huber", "lenth-andrews"}
        Tukey's biweight from `redundancy` degrees of freedom on, and least squares below; least
        squares always; or, for azimuths in the plane alone, one of Lenth's (1981) estimators.
    redundancy : int
        Least degrees of freedom with which faults are looked for. With one they cannot be told,
        with two hardly.
    initial : array_like of shape (..., D), optional
        A position near that of the target. It decides where several explain the measurements.
    n_threads : int, optional
        Threads to use; by default one for little work and all cores for much.

    Returns
    -------
    Location
        Position, covariance, residuals and faults. In a batch an instant without a position has
        nan there, and the reason in `problem`.

    Raises
    ------
    ValueError
        A wrong shape, a number outside its domain, a standard deviation that is missing; without a
        batch also a target that cannot be located: too few measurements, bearings that do not
        intersect, two positions that explain the measurements equally well, a target at a station.
    numpy.linalg.LinAlgError
        Without a batch, a geometry that leaves a direction undetermined.
    TypeError
        An argument of the wrong type.

    Notes
    -----
    Leading axes are broadcast against each other. Where only one kind is measured and none of its
    standard deviations is given, it is taken as the same for all and estimated: by least squares
    from the residuals, robustly from their median size.

    The start is the best of the points where as many measurements as there are coordinates agree;
    eight Huber steps (1.345) and Tukey's (4.685) follow, whichever of both starts is better. Other
    starts are tried, and two minima whose likelihoods differ less than by a factor of 20 are an
    error. Faults have weight 0. The robust covariance is `0.963 (J' W J)^-1`, which with normal
    errors is 5 % larger than that of least squares, and for each measurement that may or may not be
    a fault, with probability q, `6 q (1 - q) d d'`, where d is what the position moves by when it
    is left out. Cost O(M) a step, about ten steps.

    Examples
    --------
    Five direction finders, one of which is wrong by half a radian:

    >>> import numpy as np
    >>> from tertia.location import locate
    >>> places = [[0, 0], [1000, 0], [2000, 0], [0, 2000], [2000, 2000]]
    >>> bearings = [0.7864, 0.0010, 5.4968, 2.3551, 3.4261]
    >>> fix = locate(places, azimuth=bearings, azimuth_sigma=0.002)
    >>> fix
    Location([1001.02 ± 1.52, 999.061 ± 2.34], 1 of 5 faulty)
    >>> fix.outliers.azimuth
    array([False, False, False, False,  True])
    """
    places, axes, sigmas = _stations(stations)
    k, d = places.shape[-2:]
    given = {
        "range": (range, range_sigma),
        "azimuth": (azimuth, azimuth_sigma),
        "elevation": (elevation, elevation_sigma),
        "range_difference": (range_difference, range_difference_sigma),
    }
    measured = {
        kind: (_measured(value, kind, k), _deviations(sigma, sigmas.get(kind), kind, k))
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
    values = np.full((*batch, len(_KINDS), k), np.nan)
    deviations = np.full((*_sigma_batch(measured), len(_KINDS), k), np.nan)
    for kind, (value, sigma) in measured.items():
        at, first = _KINDS.index(kind), int(kind == "range_difference")
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
    location = _location(result, tuple(measured), estimated=_is_unknown(measured))
    if isinstance(location.problem, Problem):
        _raise(location.problem, measured)
    return location


def accuracy_map(
    stations: Sequence[Station] | npt.ArrayLike,
    grid: npt.ArrayLike,
    *,
    measurements: Sequence[Kind] | None = None,
    range_sigma: npt.ArrayLike | None = None,
    azimuth_sigma: npt.ArrayLike | None = None,
    elevation_sigma: npt.ArrayLike | None = None,
    range_difference_sigma: npt.ArrayLike | None = None,
    n_threads: int | None = None,
) -> Accuracy:
    """Return the covariance that a position would have, before anything is measured.

    Parameters
    ----------
    stations : sequence of K Station, or array_like of shape (K, D)
        The stations, or their positions alone.
    grid : array_like of shape (..., D)
        Positions of the target in metres.
    measurements : sequence of {"range", "azimuth", "elevation", "range_difference"}, optional
        What is measured; by default all that there are standard deviations of.
    range_sigma, azimuth_sigma, elevation_sigma : array_like of shape (K,), optional
        Standard deviations in place of those of the stations.
    range_difference_sigma : array_like of shape (K - 1,), optional
        Standard deviations of range differences, see `locate`.
    n_threads : int, optional
        Threads to use; by default one for little work and all cores for much.

    Returns
    -------
    Accuracy
        Covariance and dilution of precision of every position. The variances are infinite where
        the measurements do not determine it, or it is at a station.

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
    places, axes, own = _stations(stations)
    if places.ndim != 2:
        raise ValueError("stations must have one position each")
    points = finite(grid, "grid")
    k, d = places.shape
    if points.shape[-1:] != (d,):
        raise ValueError(f"grid has shape {points.shape}; it must be (..., {d})")
    given = dict(
        zip(
            _KINDS,
            (range_sigma, azimuth_sigma, elevation_sigma, range_difference_sigma),
            strict=True,
        )
    )
    deviations = np.full((1, len(_KINDS), k), np.nan)
    for kind in _chosen(measurements, given, own):
        sigma = _deviations(given[kind], own.get(kind), kind, k)
        if sigma.ndim > 1:
            raise ValueError(f"{kind}_sigma has shape {sigma.shape}; it must have no batch")
        if measurements is not None and np.all(np.isnan(sigma)):
            raise ValueError(f"{kind}_sigma is missing")
        first = int(kind == "range_difference")
        deviations[0, _KINDS.index(kind), first:] = sigma
    if d == 2 and not np.all(np.isnan(deviations[0, 2])):
        raise ValueError("elevation needs stations with three coordinates")
    if np.all(np.isnan(deviations)):
        raise ValueError("no standard deviation is given; nothing would be measured")
    covariance, dilution = _core.location_accuracy(
        places[np.newaxis],
        None if axes is None else axes[np.newaxis],
        deviations,
        np.ascontiguousarray(points),
        threads(n_threads),
    )
    return Accuracy(covariance, scalar_or_array(dilution))


_Measured: TypeAlias = dict[str, tuple[FloatArray, FloatArray]]


def _stations(
    stations: Sequence[Station] | npt.ArrayLike,
) -> tuple[FloatArray, FloatArray | None, dict[str, FloatArray]]:
    """Return positions, (..., K, D), axes, (..., K, D, D), and the stations' own sigmas, (K,)."""
    if isinstance(stations, Station):
        raise TypeError("stations is one Station; it must be a sequence of them")
    if not isinstance(stations, Sequence) or not any(isinstance(s, Station) for s in stations):
        places = finite(stations, "stations")  # type: ignore[arg-type]
        _require_dimension(places, "stations", "(..., K, 2) or (..., K, 3)")
        if places.ndim < 2 or places.shape[-2] == 0:
            raise ValueError(f"stations has shape {places.shape}; it must be (..., K, D)")
        return places, None, {}
    known: list[Station] = []
    for at, station in enumerate(stations):
        if not isinstance(station, Station):
            raise TypeError(f"stations[{at}] is {station!r}; it must be a Station")
        known.append(station)
    positions = [station.position for station in known]
    try:
        places = np.stack(np.broadcast_arrays(*positions), axis=-2)
    except ValueError:
        shapes = ", ".join(str(position.shape) for position in positions)
        raise ValueError(f"the positions of the stations have shapes {shapes}") from None
    sigmas = {
        str(kind): np.array(
            [np.nan if (s := getattr(one, f"{kind}_sigma")) is None else s for one in known],
            dtype=np.float64,
        )
        for kind in _STATION_KINDS
    }
    return places, _all_axes(known, places.shape[-1]), sigmas


def _all_axes(stations: Sequence[Station], d: int) -> FloatArray | None:
    """Return the axes of all stations, None if all are those of the frame."""
    if all(station.axes is None for station in stations):
        return None
    each = [np.eye(d) if station.axes is None else station.axes for station in stations]
    return np.stack(np.broadcast_arrays(*each), axis=-3)


def _axes(axes: npt.ArrayLike, place: FloatArray) -> FloatArray:
    """Return axes of a station, checked."""
    array = finite(axes, "axes")
    d = place.shape[-1]
    if array.ndim < 2 or array.shape[-2:] != (d, d):
        raise ValueError(f"axes has shape {array.shape}; it must be (..., {d}, {d})")
    if array.shape[:-2] not in {(), place.shape[:-1]}:
        raise ValueError(f"axes has shape {array.shape}, position {place.shape}; they do not fit")
    error = np.max(np.abs(array @ np.swapaxes(array, -1, -2) - np.eye(d)), initial=0.0)
    if error > _ORTHONORMAL:
        raise ValueError(f"axes is {error:.1g} off a rotation; its rows must be orthonormal")
    if np.any(np.linalg.det(array) < 0):
        raise ValueError("axes is a reflection; its rows must be east, north and up")
    return array


def _turned(offset: FloatArray, axes: FloatArray | None) -> FloatArray:
    """Return offsets from stations, (..., K, D), in the axes of the stations."""
    if axes is None:
        return offset
    turned: FloatArray = (axes @ offset[..., np.newaxis])[..., 0]
    return turned


def _require_dimension(array: FloatArray, name: str, shape: str) -> None:
    if array.ndim < 1 or array.shape[-1] not in {2, 3}:
        raise ValueError(f"{name} has shape {array.shape}; it must be {shape}")


def _measured(value: npt.ArrayLike, kind: str, k: int) -> FloatArray:
    """Return measurements, (..., K) or (..., K - 1), within their domain."""
    array = samples(value, kind)
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
    sigma: npt.ArrayLike | None, own: FloatArray | None, kind: str, k: int
) -> FloatArray:
    """Return standard deviations, (..., K) or (..., K - 1), nan where they are unknown."""
    count = k - int(kind == "range_difference")
    if sigma is None:
        return np.full(count, np.nan) if own is None else own
    array = positive(sigma, f"{kind}_sigma")
    if array.ndim == 0:
        return np.full(count, array)
    _require_length(array, f"{kind}_sigma", k)
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
        told = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
        raise ValueError(f"the batches do not fit together: {told}") from None


def _sigma_batch(measured: _Measured) -> tuple[int, ...]:
    return np.broadcast_shapes(*(sigma.shape[:-1] for _, sigma in measured.values()))


def _matched(array: FloatArray, batch: tuple[int, ...], axes: int) -> FloatArray:
    """Return rows for each element of the batch, or the only one."""
    tail = array.shape[array.ndim - axes :]
    if array.size == int(np.prod(tail)):
        return array.reshape(1, *tail)
    return np.broadcast_to(array, (*batch, *tail))


def _chosen(
    measurements: Sequence[Kind] | None, given: dict[Kind, Any], own: dict[str, FloatArray]
) -> list[Kind]:
    """Return the kinds that are measured."""
    if measurements is None:
        return [kind for kind in _KINDS if given[kind] is not None or kind in own]
    for kind in measurements:
        if kind not in _KINDS:
            raise ValueError(f"measurements has {kind!r}; it must be one of {', '.join(_KINDS)}")
    return list(measurements)


def _location(
    result: tuple[FloatArray, FloatArray, FloatArray, BoolArray, list[FloatArray]],
    kinds: tuple[str, ...],
    *,
    estimated: bool,
) -> Location:
    position, covariance, residual, outlier, columns = result
    problems, degrees, chi_square, p_value, dilution, sigma = columns
    problem: Problem | IntArray = problems.astype(np.int64)
    if position.ndim == 1:
        problem = Problem(int(problems))

    def each(array: Any) -> list[Any]:
        return [
            array[..., at, int(kind == "range_difference") :] if kind in kinds else None
            for at, kind in enumerate(_KINDS)
        ]

    return Location(
        position,
        covariance,
        Residuals(*each(residual)),
        Outliers(*each(outlier)),
        scalar_or_array(degrees.astype(np.int64)),
        scalar_or_array(chi_square),
        scalar_or_array(p_value),
        scalar_or_array(dilution),
        scalar_or_array(sigma) if estimated else None,
        problem,
    )


def _raise(problem: Problem, measured: _Measured) -> None:
    if not problem:
        return
    azimuth, _ = measured.get("azimuth", (np.zeros(1), None))
    reason = problem.reason + _degrees(azimuth)
    raise np.linalg.LinAlgError(reason) if problem == Problem.SINGULAR else ValueError(reason)


def _degrees(azimuth: FloatArray) -> str:
    """Return what to add to an error where azimuths may be degrees.

    More than a whole turn is no error in itself: azimuths may be unwrapped.
    """
    large = np.argwhere(np.abs(azimuth) > 2 * np.pi)
    if not len(large):
        return ""
    place = ", ".join(map(str, large[0]))
    return f"; azimuths are radians, and azimuth[{place}] is {azimuth[tuple(large[0])]:.6g}"
