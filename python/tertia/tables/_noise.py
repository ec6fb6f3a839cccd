"""What is assumed of plots and motion: as given, else fitted from the recording."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tertia._arrays import FloatArray
from tertia.kalman import SingerModel
from tertia.tables._fit import SensorFit, best_motion, fit_sensor
from tertia.tables._plots import Group


@dataclass(frozen=True, slots=True)
class Given:
    """What the caller says: sigmas by sensor (None: all others), or one for each plot."""

    sigmas: dict[str | None, float]
    sigma_column: str | None
    alpha: float | None
    acceleration_sigma: float | None

    def unknown(self, sensors: list[str]) -> list[str]:
        """Return the sensors whose sigma is not given."""
        if self.sigma_column is not None or None in self.sigmas:
            return []
        return [name for name in sensors if name not in self.sigmas]


@dataclass(frozen=True, slots=True)
class Fitted:
    """A number that was fitted, its relative error, and the plots that tell it."""

    name: str
    value: float
    relative_error: float
    sensor: str
    left_out: int


@dataclass(frozen=True, slots=True)
class Noise:
    """The motion of the targets, and the sigmas of sensors that do not state one per plot."""

    model: SingerModel
    sigmas: dict[str, float]
    fitted: list[Fitted]

    def variance(self, group: Group) -> FloatArray:
        """Return the variances of the plots of a group, (K, steps)."""
        sigma = group.sigma.copy()
        for k, name in enumerate(group.sensors):
            own = sigma[k]
            known = own[~np.isnan(own)]
            # a step without a plot needs some positive number, too
            usual = float(np.median(known)) if known.size else 1.0
            own[np.isnan(own)] = self.sigmas.get(name, usual)
        variance: FloatArray = sigma**2
        return variance


class NotFittedError(ValueError):
    """Too little to fit what is not given: the sigma of a sensor, or (None) the motion."""

    def __init__(self, problem: str, sensor: str | None) -> None:
        wanted = "alpha and acceleration_sigma" if sensor is None else f"the sigma of {sensor}"
        super().__init__(f"{problem}: give {wanted}")
        self.problem, self.sensor = problem, sensor


def settle(
    groups: list[Group], sensors: list[str], given: Given, angle: str, period: float | None
) -> Noise:
    """Fit what is not given; raises NotFittedError where there is too little for that."""
    unknown = given.unknown(sensors)
    alpha, acceleration_sigma = given.alpha, given.acceleration_sigma
    seek_motion = alpha is None or acceleration_sigma is None
    fits, problems = _fit(groups, sensors if seek_motion else unknown, angle, period)
    for name in unknown:
        if name in problems:
            raise NotFittedError(problems[name], name)
    fitted = [_sigma(fits[name]) for name in unknown]
    if seek_motion:
        if not fits:
            raise NotFittedError(next(iter(problems.values())), None)
        best = best_motion(list(fits.values()))
        if alpha is None:
            alpha = best.noise.alpha
            fitted.append(_motion("alpha", alpha, 0, best))
        if acceleration_sigma is None:
            acceleration_sigma = best.noise.acceleration_sigma
            fitted.append(_motion("acceleration sigma", acceleration_sigma, 1, best))
    sigmas = {name: fits[name].noise.measurement_sigma for name in unknown}
    if given.sigma_column is None:
        sigmas |= {
            n: given.sigmas.get(n, given.sigmas.get(None, math.nan))
            for n in sensors
            if n not in sigmas
        }
    model = SingerModel(1.0, alpha or 0.0, acceleration_sigma or 0.0, exact=True)
    return Noise(model, sigmas, fitted)


def _fit(
    groups: list[Group], sensors: list[str], angle: str, period: float | None
) -> tuple[dict[str, SensorFit], dict[str, str]]:
    """Return the fits of sensors that can be fitted, and why others cannot."""
    fits, problems = {}, {}
    for name in sensors:
        series = [
            (group.times, group.z[group.sensors.index(name)])
            for group in groups
            if name in group.sensors
        ]
        try:
            fits[name] = fit_sensor(name, series, period)
        except ValueError as error:
            problems[name] = f"{angle} of {name} {str(error).removeprefix('z ')}"
    return fits, problems


def _sigma(fit: SensorFit) -> Fitted:
    noise = fit.noise
    name = f"sigma of {fit.sensor}"
    return _motion(name, noise.measurement_sigma, 2, fit)


def _motion(name: str, value: float, which: int, fit: SensorFit) -> Fitted:
    sigma = float(fit.noise.sigma[which])
    relative = sigma / value if value > 0 else math.inf
    return Fitted(name, value, relative, fit.sensor, fit.left_out)
