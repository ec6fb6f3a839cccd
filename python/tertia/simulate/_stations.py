"""Simulated measurements of one target by several stations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import BoolArray, FloatArray, finite, generator
from tertia.sensors import Kind, Station
from tertia.sensors._kinds import KINDS
from tertia.sensors._sensors import stack_stations
from tertia.simulate._parameters import _number, _require, _shape

# metres: farther away, the lines of sight are parallel in double precision
_FARTHEST = 1e12


@dataclass(frozen=True, slots=True, eq=False)
class PassiveLocation:
    """Two stations that measure two azimuths and one range difference, and their accuracy.

    Attributes
    ----------
    position : ndarray of shape (..., 2)
        True position of the target, east and north in metres.
    jacobian : ndarray of shape (..., 3, 2)
        Derivatives with respect to the position of three measurements: the azimuth from the first
        station and the azimuth from the second station in radians, and the range from the first
        station minus the range from the second station in metres.
    sigma : ndarray of shape (3,)
        Standard deviations of the three measurements, in radians and metres.
    covariances : ndarray of shape (..., 2, 2, 2)
        Covariances of two estimates of the position. The first estimate is from the two azimuths,
        and the second is from the first azimuth and the range difference. Both use the first
        azimuth, so they are not independent.
    """

    position: FloatArray
    jacobian: FloatArray
    sigma: FloatArray
    covariances: FloatArray

    def estimates(self, rng: np.random.Generator | int | None = None) -> FloatArray:
        """Simulate both estimates of every position, to first order.

        The result has the shape (..., 2, 2); the axes are the estimate and its components east and
        north.
        """
        shape = self.jacobian.shape[:-1]
        error = self.sigma * generator(rng).standard_normal(shape)
        pairs = [
            np.linalg.solve(self.jacobian[..., rows, :], error[..., rows, np.newaxis])[..., 0]
            for rows in ([0, 1], [0, 2])
        ]
        return self.position[..., np.newaxis, :] + np.stack(pairs, axis=-2)


def passive_location(
    position: npt.ArrayLike,
    *,
    stations: npt.ArrayLike = ((-15e3, 0.0), (15e3, 0.0)),
    azimuth_sigma: float = np.radians(0.3).item(),
    range_difference_sigma: float = 100.0,
) -> PassiveLocation:
    """Return the accuracy with which two passive stations locate a target.

    This is the example of the source of `tertia.weights`.

    Parameters
    ----------
    position : array_like of shape (..., 2)
        Position of the target, east and north in metres.
    stations : array_like of shape (2, 2)
        Positions of the stations, east and north in metres.
    azimuth_sigma : float
        Standard deviation of an azimuth, in radians.
    range_difference_sigma : float
        Standard deviation of the range difference, in metres.

    Returns
    -------
    PassiveLocation
        Derivatives of the measurements, and covariances of the two estimates of the position.

    Raises
    ------
    ValueError, TypeError
        If a shape is wrong, a number is outside its domain, an argument has the wrong type, or the
        target is on the line through the stations, where the azimuths do not intersect.

    Examples
    --------
    >>> from tertia.simulate import passive_location
    >>> target = passive_location([0.0, 40e3])
    >>> (target.covariances[:, [0, 1], [0, 1]] ** 0.5).round()
    array([[169., 450.],
           [142., 742.]])
    """
    target, places = finite(position, "position"), finite(stations, "stations")
    _require(target.shape[-1:] == (2,), "position", target.shape, "of shape (..., 2)")
    _require(places.shape == (2, 2), "stations", places.shape, "of shape (2, 2)")
    farthest = max(float(np.max(np.abs(x), initial=0)) for x in (target, places))
    _require(
        farthest <= _FARTHEST, "position", farthest, f"within {_FARTHEST:g} m, as the stations"
    )
    sigma = np.array(
        [_number(azimuth_sigma, "azimuth_sigma", 1e-12, 10)] * 2
        + [_number(range_difference_sigma, "range_difference_sigma", 1e-9, 1e12)]
    )
    offset = target[..., np.newaxis, :] - places
    distance = np.sqrt(np.sum(offset**2, axis=-1, keepdims=True))
    baseline = places[1] - places[0]
    height = offset[..., 0, 0] * baseline[1] - offset[..., 0, 1] * baseline[0]
    on_line = np.argwhere(np.abs(height) <= 1e-9 * np.sum(baseline**2))
    if len(on_line):
        where = target[tuple(on_line[0])]
        raise ValueError(f"position {where} lies on the line through the stations; it must not")
    toward = offset / distance
    # azimuths turn clockwise from north
    azimuths = np.stack([toward[..., 1], -toward[..., 0]], axis=-1) / distance
    difference = toward[..., :1, :] - toward[..., 1:, :]
    jacobian = np.concatenate([azimuths, difference], axis=-2)
    scaled = jacobian / sigma[:, np.newaxis]
    roots = np.linalg.inv(np.stack([scaled[..., [0, 1], :], scaled[..., [0, 2], :]], axis=-3))
    covariances = roots @ np.swapaxes(roots, -1, -2)
    return PassiveLocation(target, jacobian, sigma, covariances)


@dataclass(frozen=True, slots=True, eq=False)
class StationRecord:
    """Simulated measurements of a target by several stations, with their outliers marked.

    Attributes
    ----------
    measurements : dict of str to ndarray of shape (..., K)
        Arguments of `tertia.location.locate`: `locate(stations, **record.measurements)`.
    outlier : dict of str to ndarray of bool, shape (..., K)
        True for outliers.
    position : ndarray of shape (..., D)
        True position of the target.
    """

    measurements: dict[str, FloatArray]
    outlier: dict[str, BoolArray]
    position: FloatArray


def stations(
    stations: Sequence[Station],
    position: npt.ArrayLike,
    *,
    kinds: Sequence[Kind] | None = None,
    outlier_probability: float = 0.0,
    outlier_size: float = 20.0,
    missing_probability: float = 0.0,
    propagation_speed: float = 299_792_458.0,
    batch: int | tuple[int, ...] = (),
    rng: np.random.Generator | int | None = None,
) -> StationRecord:
    """Simulate measurements of a target by several stations, with normal noise and outliers.

    Parameters
    ----------
    stations : sequence of K Station
        The stations; each measures the kinds for which it has a standard deviation.
    position : array_like of shape (..., D)
        True position of the target in metres.
    kinds : sequence of {"range", "azimuth", "elevation", "arrival_time"}, optional
        Kinds that are measured; by default all kinds for which a station has a standard deviation.
    outlier_probability : float
        Probability that a measurement is an outlier.
    outlier_size : float
        Offset of an outlier, in standard deviations. It is added with a random sign, except that
        times of arrival are always late.
    missing_probability : float
        Probability that a measurement is missing.
    propagation_speed : float
        Speed of signals in m/s, by default the speed of light. Signals are emitted at 0 s.
    batch : int or tuple of int
        Shape of the batch of records of every position.
    rng : numpy.random.Generator or int, optional
        Random generator or its seed.

    Returns
    -------
    StationRecord
        Measurements of shape `(*batch, ..., K)`; nan where they are missing.

    Raises
    ------
    ValueError, TypeError
        If a kind is unknown, or a parameter is outside its domain or has the wrong type.

    Examples
    --------
    >>> from tertia.location import Station, locate
    >>> from tertia.simulate import stations
    >>> places = [[0, 0], [3000, 0], [0, 3000], [3000, 3000]]
    >>> finders = [Station(p, azimuth_sigma=0.01) for p in places]
    >>> record = stations(finders, [1000, 2000], rng=1)
    >>> locate(finders, **record.measurements)
    Location([1000.74 ± 14.7, 2003.78 ± 14.6], 0 of 4 faulty)
    """
    places, axes, sigmas = stack_stations(stations)
    target = finite(position, "position").copy()
    d = places.shape[-1]
    _require(target.shape[-1:] == (d,), "position", target.shape, f"of shape (..., {d})")
    outlier_probability = _number(outlier_probability, "outlier_probability", 0, 1)
    missing_probability = _number(missing_probability, "missing_probability", 0, 1)
    size, source = _number(outlier_size, "outlier_size", 0), generator(rng)
    speed = _number(propagation_speed, "propagation_speed", 1e-9)
    truth = _sights(places, axes, target, speed)
    if kinds is None:
        chosen = [kind for kind in truth if not np.all(np.isnan(sigmas.get(kind, np.nan)))]
    else:
        chosen = list(kinds)
    record: dict[str, FloatArray] = {}
    outlier: dict[str, BoolArray] = {}
    for kind in chosen:
        _require(kind in truth, "kinds", kind, f"one of {', '.join(truth)}")
        shape = (*_shape(batch), *truth[kind].shape)
        wrong = source.uniform(size=shape) < outlier_probability
        up = 1.0 if kind == "arrival_time" else -1.0
        sign = np.where(source.uniform(size=shape) < 0.5, up, 1.0)
        error = source.standard_normal(shape) + np.where(wrong, size * sign, 0.0)
        gone = source.uniform(size=shape) < missing_probability
        record[kind] = np.where(gone, np.nan, truth[kind] + sigmas[kind] * error)
        outlier[kind] = wrong & ~np.isnan(record[kind])
    return StationRecord(record, outlier, np.broadcast_to(target, (*_shape(batch), *target.shape)))


def _sights(
    places: FloatArray, axes: FloatArray | None, target: FloatArray, speed: float
) -> dict[Kind, FloatArray]:
    """Return the measurements that each station makes alone, without errors, (..., K)."""
    k, d = places.shape[-2:]
    batch = np.broadcast_shapes(
        places.shape[:-2], target.shape[:-1], () if axes is None else axes.shape[:-3]
    )
    found = _core.predicted(
        np.broadcast_to(places, (*batch, k, d)),
        None if axes is None else np.broadcast_to(axes, (*batch, k, d, d)),
        np.broadcast_to(target, (*batch, d)),
        None,
    )
    truth: dict[Kind, FloatArray] = {
        kind: found[..., at, :]
        for at, kind in enumerate(KINDS)
        if kind != "range_difference" and (d == 3 or kind != "elevation")
    }
    truth["arrival_time"] = truth["arrival_time"] / speed
    return truth
