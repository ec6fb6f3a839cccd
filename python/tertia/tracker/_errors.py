"""Estimation of systematic errors of radars from plots of targets that several radars see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from tertia import _core
from tertia._arrays import FloatArray, IntArray
from tertia.sensors import Bias, PositionSensor, Radar
from tertia.sensors._sensors import drift_rates, own_biases
from tertia.tracker._biases import (
    are_placed,
    bias_of,
    bias_with_deviation,
    columns_of,
    constants_of,
    padded,
    with_deviation_sigma,
)
from tertia.tracker._earth import in_plane
from tertia.tracker._plots import Plots
from tertia.tracker._registrar import target_plots
from tertia.tracker._sensors import core_sensors, interval, slant
from tertia.tracker._table import TrackTable

_Sensor: TypeAlias = Radar | PositionSensor

# periods of a recording at most, in all and of all sensors, and scans of the slowest sensor in each
# at least
_PERIODS, _IN_ALL, _SCANS = 360, 1440, 4


@dataclass(frozen=True, slots=True, eq=False)
class BiasHistory:
    """Systematic errors of sensors over time, in T periods of equal length.

    Attributes
    ----------
    edges : ndarray of shape (T + 1,)
        Times in seconds at which the periods begin and end.
    bias : tuple of T Bias
        The biases of the K sensors in each period, with their standard deviations.
    """

    edges: FloatArray
    bias: tuple[Bias, ...]

    def correct(self, plots: Plots) -> Plots:
        """Return plots from which the biases of their period are removed.

        Parameters
        ----------
        plots : Plots
            Plots of the K sensors. The first and the last period also apply to earlier and later
            plots.

        Returns
        -------
        Plots
            The corrected plots, as from `Bias.correct`.

        Raises
        ------
        ValueError
            As for `Bias.correct`.

        Examples
        --------
        >>> from tertia.registration import BiasHistory
        >>> from tertia.sensors import Bias, PositionSensor, Radar
        >>> from tertia.tracker import Plots
        >>> history = BiasHistory([0.0, 60.0, 120.0], (Bias(range=[0.0]), Bias(range=[150.0])))
        >>> history.correct(Plots([10.0, 90.0], 9150.0, 1.0)).range
        array([9150., 9000.])
        """
        corrected: Plots = self.bias[0].correct(plots)
        names = ("time", "range", "azimuth", *(["position"] if plots.position is not None else []))
        columns = {name: np.array(getattr(corrected, name)) for name in names}
        period = in_periods(plots.time, np.asarray(self.edges))
        for t, bias in enumerate(self.bias[1:], start=1):
            own = np.flatnonzero(period == t)
            part = bias.correct(plots[own])
            for name, column in columns.items():
                column[own] = getattr(part, name)
        return replace(corrected, **columns)


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """Systematic errors of K sensors, their prior distribution, and the noise of the sensors.

    `covariance` (4 K, 4 K) is the covariance of the errors of offset, gain, azimuth and time in the
    last period, sensor by sensor. In `deviation_covariance` (8 K, 8 K), the coefficients of the
    deviation follow the time; it is None if no azimuth deviates. `changes` has the times of sudden
    changes and the sensors that changed. `factor` (K, 2) is the ratio of the estimated to the
    assumed noise, and `redundancy` is the number of redundant measurements from which it was
    estimated.
    """

    history: BiasHistory
    covariance: FloatArray
    deviation_covariance: FloatArray | None
    changes: tuple[tuple[float, int], ...]
    prior: Bias
    factor: FloatArray
    redundancy: FloatArray

    @property
    def bias(self) -> Bias:
        """The errors at the end."""
        return self.history.bias[-1]

    @property
    def values(self) -> FloatArray:
        """The errors of each period without deviations, (T, K, 4)."""
        return np.stack([columns_of(bias) for bias in self.history.bias])

    def removed(self, plots: Plots, sensors: Sequence[_Sensor]) -> tuple[Plots, list[_Sensor]]:
        """Return plots without the errors, and sensors of which only the sigmas are left."""
        return self.history.correct(plots), without_values(sensors, self.bias)


def without_values(sensors: Sequence[_Sensor], bias: Bias) -> list[_Sensor]:
    """Return sensors that have these biases, of which the values have been removed from plots."""
    unknown = with_deviation_sigma(bias)
    left = bias_of(0.0 * unknown, unknown, are_placed(sensors))
    return [with_bias(one, left[k]) for k, one in enumerate(sensors)]


def with_bias(sensor: _Sensor, found: Bias) -> _Sensor:
    """Return a sensor with the bias that was found, unless it reports exact positions."""
    bias = sensor.bias
    is_exact = isinstance(sensor, PositionSensor) and (
        bias is None or (bias.east_sigma == 0.0 and bias.north_sigma == 0.0)
    )
    return sensor if is_exact else replace(sensor, bias=found)


def errors(
    plots: Plots,
    tracks: TrackTable,
    sensors: Sequence[_Sensor],
    *,
    sigma: FloatArray | None = None,
    start: FloatArray | None = None,
) -> Errors:
    """Return the errors that follow from the plots of the tracks.

    `sigma` (K, 4) are the standard deviations of the prior distribution, and `start` (T, K, 4) or
    (K, 4) are the errors with which the estimation begins. By default both are those of the
    sensors, which are always the means of the prior distribution.
    """
    given = own_biases(sensors)
    most = min(_PERIODS, max(_IN_ALL // len(sensors), 1))
    edges = equal_periods(plots.time, _SCANS * max(map(interval, sensors)), most)
    mean = columns_of(given)
    sigma = columns_of(given, "_sigma") if sigma is None else sigma
    begin = mean if start is None else start
    begin = padded(np.broadcast_to(begin, (len(edges) - 1, *mean.shape)))
    plots = plots._replaced(height=_heights(plots, tracks))
    rows = np.flatnonzero((tracks.plot >= 0) & tracks.confirmed)
    own = in_plane(plots, sensors)[tracks.plot[rows]]
    (value, after, covariance, factor, redundancy), changes, _ = _core.register_errors(
        target_plots(own, tracks, rows),
        core_sensors(sensors, "cv")[0],
        slant(sensors, plots),
        [padded(one) for one in (mean, sigma, drift_rates(sensors))],
        edges,
        np.ascontiguousarray(begin),
    )
    placed = are_placed(sensors)
    history = tuple(bias_with_deviation(*own, placed) for own in zip(value, after, strict=True))
    return Errors(
        history=BiasHistory(edges, history),
        covariance=constants_of(covariance),
        deviation_covariance=covariance if history[-1].deviation_order > 0 else None,
        changes=tuple((float(edges[period]), sensor) for period, sensor in changes),
        prior=bias_of(mean, sigma, placed),
        factor=factor,
        redundancy=redundancy,
    )


def _heights(plots: Plots, tracks: TrackTable) -> FloatArray:
    """Return the heights of plots: those of their tracks where they have none."""
    height: FloatArray = np.array(plots.height, dtype=float)
    rows = np.flatnonzero(tracks.plot >= 0)
    rows = rows[~np.isfinite(height[tracks.plot[rows]])]
    height[tracks.plot[rows]] = tracks.height[rows]
    return height


def equal_periods(time: FloatArray, shortest: float, most: int) -> FloatArray:
    """Return the edges of at most so many periods of equal length that cover all times."""
    known = time[np.isfinite(time)]
    if not len(known):
        return np.array([0.0, 1.0])
    first, last = float(np.min(known)), float(np.max(known))
    count = int(np.clip((last - first) // shortest, 1, most))
    return np.linspace(first, max(last, np.nextafter(first, np.inf)), count + 1)


def in_periods(time: FloatArray, edges: FloatArray) -> IntArray:
    """Return the index of the period that contains each time."""
    return np.clip(np.searchsorted(edges, time, side="right") - 1, 0, len(edges) - 2)
