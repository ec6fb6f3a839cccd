"""Estimation of systematic errors of radars from plots of targets that several radars see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tertia import _core
from tertia._arrays import FloatArray
from tertia.sensors import Bias
from tertia.sensors._sensors import own_biases
from tertia.tracker import Plots, TrackTable
from tertia.tracker._registrar import target_plots
from tertia.tracker._sensors import Sensor, core_sensors, slant
from tertia.tracker._start import are_placed, bias_of, columns_of


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """Systematic errors of K sensors, their prior distribution, and the noise of the sensors.

    `covariance` (4 K, 4 K) is the covariance of the errors of offset, gain, azimuth and time, radar
    by radar. `factor` (K, 2) is the ratio of the estimated to the assumed noise, and `redundancy`
    is the number of redundant measurements from which it was estimated.
    """

    bias: Bias
    covariance: FloatArray
    prior: Bias
    factor: FloatArray
    redundancy: FloatArray


def errors(
    plots: Plots, tracks: TrackTable, sensors: Sequence[Sensor], prior: Bias, first: Bias
) -> Errors:
    """Return the errors that follow from the plots of the tracks, iterated from initial values.

    Only the standard deviations of `prior` are used; the means of the prior distribution are those
    of the sensors.
    """
    given = own_biases(sensors)
    rows = np.flatnonzero((tracks.plot >= 0) & tracks.confirmed)
    own = plots[tracks.plot[rows]]
    columns = target_plots(own, tracks, rows)
    sigma = columns_of(prior, "_sigma")
    (value, covariance, factor, redundancy), _ = _core.register_errors(
        columns,
        core_sensors(sensors, "cv")[0],
        slant(sensors),
        columns_of(given),
        sigma,
        columns_of(first),
    )
    spread = np.sqrt(np.diagonal(covariance)).reshape(sigma.shape)
    placed = are_placed(sensors)
    bias, limits = bias_of(value, spread, placed), bias_of(columns_of(given), sigma, placed)
    return Errors(bias, covariance, limits, factor, redundancy)
