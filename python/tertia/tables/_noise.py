"""The noise of plots and the motion of targets, as given or as estimated from the recording."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import polars as pl

from tertia._arrays import FloatArray
from tertia.kalman import NoiseFit, SingerModel, fit_noise
from tertia.tables._parts import RecordError

# times and plots of one sensor and one target; nan if there is no plot
Series: TypeAlias = tuple[FloatArray, FloatArray]

# this many plots determine sigma to half a percent, within seconds
_MOST_PLOTS = 50_000
# a plot this many sigmas from the track through the other plots is an outlier
_GATE = 4.0


@dataclass(frozen=True, slots=True)
class Target:
    """The plots of one target, (K, steps); nan if a sensor has no plot at a time."""

    name: str
    keys: pl.DataFrame
    sensors: list[str]
    moments: pl.Series
    times: FloatArray
    z: FloatArray
    sigma: FloatArray
    missing: list[int]


@dataclass(frozen=True, slots=True)
class Given:
    """Given parameters of the motion, and given sigmas by sensor; the key None means all others."""

    sigmas: dict[str | None, float]
    alpha: float | None
    acceleration_sigma: float | None

    def sigma(self, sensor: str) -> float | None:
        """Return the sigma of a sensor; None if it is not given."""
        return self.sigmas.get(sensor, self.sigmas.get(None))


@dataclass(frozen=True, slots=True)
class Fitted:
    """An estimated number, its relative error, and the sensors whose plots were used."""

    name: str
    value: float
    relative_error: float
    sensor: str
    left_out: int


@dataclass(frozen=True, slots=True)
class Noise:
    """The motion of the targets, sigmas that replace those of plots, and the estimated values."""

    model: SingerModel
    sigmas: dict[str, float]
    fitted: list[Fitted]

    def variance(self, sensors: Sequence[str], sigma: FloatArray) -> FloatArray:
        """Return variances of plots from their own sigmas (K, steps); nan if there are none."""
        found = sigma.copy()
        for own, name in zip(found, sensors, strict=True):
            known = own[~np.isnan(own)]
            # steps without a plot also need a positive number
            own[np.isnan(own)] = float(np.median(known)) if known.size else 1.0
            if name in self.sigmas:
                own[:] = self.sigmas[name]
        variance: FloatArray = found**2
        return variance


def settle(
    targets: Sequence[Target], sensors: Sequence[str], given: Given, period: float | None
) -> Noise:
    """Estimate the values that are not given; raise an error if there are too few plots."""
    sigmas = {name: given.sigma(name) for name in sensors}
    stated = {
        name
        for target in targets
        for name, own in zip(target.sensors, target.sigma, strict=True)
        if not np.all(np.isnan(own))
    }
    unknown = [name for name in sensors if sigmas[name] is None and name not in stated]
    alpha, acceleration_sigma = given.alpha, given.acceleration_sigma
    seek_motion = alpha is None or acceleration_sigma is None
    fits, problems = _fit(targets, sensors if seek_motion else unknown, period)
    for name in unknown:
        if name in problems:
            raise RecordError(f"{problems[name]}: give the sigma of {name}")
    fitted = [
        _fitted(f"sigma of {name}", fits[name].noise.measurement_sigma, 2, fits[name])
        for name in unknown
        if name in fits
    ]
    if seek_motion:
        if not fits:
            reason = next(iter(problems.values()), "there are no plots")
            raise RecordError(f"{reason}: give alpha and acceleration_sigma")
        best = best_motion(list(fits.values()))
        if alpha is None:
            alpha = best.noise.alpha
            fitted.append(_fitted("alpha", alpha, 0, best))
        if acceleration_sigma is None:
            acceleration_sigma = best.noise.acceleration_sigma
            fitted.append(_fitted("acceleration sigma", acceleration_sigma, 1, best))
    found = {name: sigma for name, sigma in sigmas.items() if sigma is not None}
    found |= {name: fits[name].noise.measurement_sigma for name in unknown if name in fits}
    model = SingerModel(1.0, alpha or 0.0, acceleration_sigma or 0.0, exact=True)
    return Noise(model, found, fitted)


def _fit(
    targets: Sequence[Target], sensors: Sequence[str], period: float | None
) -> tuple[dict[str, SensorFit], dict[str, str]]:
    """Return the estimates for sensors, and the reasons why other sensors have no estimates."""
    fits, problems = {}, {}
    for name in sensors:
        series = [
            (target.times, target.z[target.sensors.index(name)])
            for target in targets
            if name in target.sensors
        ]
        if not series:
            continue
        try:
            fits[name] = fit_sensor(name, series, period)
        except ValueError as error:
            problems[name] = f"the noise of {name} cannot be estimated: {error}"
    return fits, problems


def _fitted(name: str, value: float, which: int, fit: SensorFit) -> Fitted:
    sigma = float(fit.noise.sigma[which])
    relative = sigma / value if value > 0 else math.inf
    return Fitted(name, value, relative, fit.sensor, int(fit.noise.outlier.sum()))


@dataclass(frozen=True, slots=True)
class SensorFit:
    """The noise of a sensor and the motion that it observed, as estimated without outliers."""

    sensor: str
    noise: NoiseFit

    @property
    def motion_error(self) -> float:
        """The relative error of the sigma of the acceleration; inf if alpha is not determined."""
        alpha, acceleration, _ = self.noise.sigma
        known = np.isfinite(alpha) and self.noise.acceleration_sigma > 0
        return float(acceleration / self.noise.acceleration_sigma) if known else np.inf


def fit_sensor(sensor: str, series: Sequence[Series], period: float | None) -> SensorFit:
    """Estimate the noise of one sensor from all its series, without outliers.

    A few outliers would otherwise dominate the estimate. Raises ValueError if there are too few
    plots.
    """
    times, z = _stacked(series)
    return SensorFit(sensor, fit_noise(z, time=times, period=period, outlier_gate=_GATE))


def best_motion(fits: Sequence[SensorFit]) -> SensorFit:
    """Return the estimate that determines the motion most accurately.

    All sensors observe the same motion, so the mean of their estimates would hardly be more
    accurate.
    """
    return min(fits, key=lambda fit: fit.motion_error)


def _stacked(series: Sequence[Series]) -> Series:
    """Return the longest series as rows of equal length, up to a limit."""
    present = [(t[~np.isnan(z)], z[~np.isnan(z)]) for t, z in series]
    present.sort(key=lambda pair: -pair[0].size)
    longest = min(_MOST_PLOTS, present[0][0].size)
    used = present[: max(1, _MOST_PLOTS // max(1, longest))]
    times, plots = np.zeros((len(used), longest)), np.full((len(used), longest), np.nan)
    for row, (t, z) in enumerate(used):
        count = min(longest, t.size)
        plots[row, :count] = z[:count]
        # the rest of the row repeats the time of the last plot
        times[row, :count], times[row, count:] = t[:count], t[count - 1] if count else 0.0
    return times, plots
