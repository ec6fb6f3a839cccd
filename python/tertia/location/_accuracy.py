"""The accuracy that positions would have with given stations, computed without measurements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import FloatArray, finite, listed, positive_number, scalar_or_array, threads
from tertia._result import Result
from tertia.location._arrivals import LIGHT
from tertia.location._bias import given_biases
from tertia.location._height import lifted, without_heights
from tertia.location._readers import correlation_of, deviations
from tertia.sensors import Bias, Kind, Station
from tertia.sensors._kinds import KINDS
from tertia.sensors._sensors import stack_stations, survey_sigmas


@dataclass(frozen=True, slots=True, eq=False)
class Accuracy(Result):
    """The accuracy that positions would have with given stations, computed without measurements.

    Attributes
    ----------
    covariance : ndarray of shape (..., D, D)
        Covariance of a least-squares position in m²; variances are infinite where the position is
        not determined.
    dop : float or ndarray of shape (...)
        Dilution of precision, as in `Location`.
    """

    _rows: ClassVar = "dop", 0

    covariance: FloatArray
    dop: float | FloatArray

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations of the coordinates, of shape (..., D)."""
        return np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1))

    @property
    def drms(self) -> float | FloatArray:
        """Distance root mean square: square root of the sum of the variances, of shape (...).

        It is horizontal where only the height is not determined.
        """
        variances = np.diagonal(self.covariance, axis1=-2, axis2=-1)
        plane, up = variances[..., :2].sum(axis=-1), variances[..., 2:].sum(axis=-1)
        total: float | FloatArray = scalar_or_array(
            np.sqrt(plane + np.where(np.isinf(up), 0.0, up))
        )
        return total

    def __repr__(self) -> str:
        """Show the number of positions."""
        return f"Accuracy(batch {self.covariance.shape[:-2]})"


def accuracy_map(
    stations: Sequence[Station] | npt.ArrayLike,
    grid: npt.ArrayLike,
    *,
    kinds: Sequence[Kind] | None = None,
    range_sigma: npt.ArrayLike | None = None,
    azimuth_sigma: npt.ArrayLike | None = None,
    elevation_sigma: npt.ArrayLike | None = None,
    range_difference_sigma: npt.ArrayLike | None = None,
    arrival_time_sigma: npt.ArrayLike | None = None,
    bias: Bias | None = None,
    range_difference_correlation: float = 0.5,
    propagation_speed: float = LIGHT,
    degrees: bool = False,
    n_threads: int | None = None,
) -> Accuracy:
    """Return the covariance that positions would have with given stations.

    Parameters
    ----------
    stations : sequence of K Station, or array_like of shape (K, D)
        The stations, or their positions alone.
    grid : array_like of shape (..., D)
        Positions of the target in metres.
    kinds : sequence of str, optional
        Kinds of measurements: "range", "azimuth", "elevation", "range_difference" and
        "arrival_time". By default, the kinds that have a standard deviation are used.
    range_sigma, azimuth_sigma, elevation_sigma : array_like of shape (K,), optional
        Standard deviations in metres and radians, instead of those of the stations.
    range_difference_sigma : array_like of shape (K - 1,), optional
        Standard deviations of the range differences in metres.
    arrival_time_sigma : array_like of shape (K,), optional
        Standard deviations of the times of arrival in seconds.
    bias : Bias, optional
        Systematic errors that replace those of the stations: the same for all stations, or one for
        each, (K,). Their variances are added to those of the random errors. A measurement whose
        systematic error has an infinite sigma is not used. If a sigma is None, nothing is added,
        because a systematic error cannot be estimated without measurements.
    range_difference_correlation, propagation_speed : float
        As for `locate`.
    degrees : bool
        Whether the angles and their standard deviations in this call are in degrees.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    Accuracy
        Covariance and dilution of precision at every position of the grid. The variances are
        infinite at positions that the measurements would not determine, and at positions of
        stations. Azimuths alone do not determine the height; the variances are then those in the
        plane, and that of the height is infinite.

    Raises
    ------
    ValueError
        If a shape is wrong, a standard deviation is missing or not positive, or a kind does not
        exist.
    TypeError
        If an argument has the wrong type.

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
            (
                range_sigma,
                azimuth_sigma,
                elevation_sigma,
                range_difference_sigma,
                arrival_time_sigma,
            ),
            strict=True,
        )
    )
    biases = given_biases(bias, stations, k)
    speed = positive_number(propagation_speed, "propagation_speed")
    sigmas = np.full((1, len(KINDS), k), np.nan)
    for kind in _chosen(kinds, given, own):
        sigma = deviations(given[kind], own.get(kind), kind, k, degrees=degrees)
        if sigma.ndim > 1:
            raise ValueError(f"{kind}_sigma has shape {sigma.shape}; it must have no batch")
        if kinds is not None and np.all(np.isnan(sigma)):
            raise ValueError(f"{kind}_sigma is missing")
        sigma = biases.usable(kind, biases.widened(kind, sigma))
        first = int(kind == "range_difference")
        sigmas[0, KINDS.index(kind), first:] = sigma * (speed if kind == "arrival_time" else 1.0)
    if d == 2 and not np.all(np.isnan(sigmas[0, 2])):
        raise ValueError("elevation needs stations with three coordinates")
    if np.all(np.isnan(sigmas)):
        raise ValueError("no standard deviation is given; nothing would be measured")
    measured = dict(zip(KINDS, sigmas[0], strict=True))
    places, axes, flat = without_heights(places, axes, measured)
    points = points[..., : places.shape[1]]
    covariance, dop = _core.location_accuracy(
        (places[np.newaxis], None if axes is None else axes[np.newaxis]),
        (sigmas, survey_sigmas(stations)),
        np.ascontiguousarray(points),
        correlation_of(range_difference_correlation),
        threads(n_threads),
    )
    if flat:
        _, covariance = lifted(points, covariance)
    return Accuracy(covariance, scalar_or_array(dop))


def _chosen(
    kinds: Sequence[Kind] | None, given: dict[Kind, Any], own: dict[str, FloatArray]
) -> list[Kind]:
    """Return the kinds that are measured."""
    if kinds is None:
        return [kind for kind in KINDS if given[kind] is not None or kind in own]
    chosen = listed(kinds, "kinds")
    for kind in chosen:
        if kind not in KINDS:
            raise ValueError(f"kinds has {kind!r}; it must be one of {', '.join(KINDS)}")
    return chosen
