"""What is assumed of plots and motion: as given, else fitted from the recording."""

import math
from dataclasses import dataclass

import numpy as np
import polars as pl

from tertia._arrays import FloatArray
from tertia.cli._fit import SensorFit, best_motion, fit_sensor
from tertia.cli._plots import Group
from tertia.cli._terminal import WRONG_USAGE, as_text, fail, print_table, tracked
from tertia.kalman import SingerModel


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
class Noise:
    """The motion of the targets, and the sigmas of sensors that do not state one per plot."""

    model: SingerModel
    sigmas: dict[str, float]

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


def settle(
    groups: list[Group], sensors: list[str], given: Given, angle: str, period: float | None
) -> Noise:
    """Fit what is not given, and print it."""
    for name in given.sigmas:
        if name is not None and name not in sensors:
            fail(f"--sigma names {name}; the sensors are {', '.join(sensors)}", WRONG_USAGE)
    unknown = given.unknown(sensors)
    alpha, acceleration_sigma = given.alpha, given.acceleration_sigma
    seek_motion = alpha is None or acceleration_sigma is None
    fits, problems = _fit(groups, sensors if seek_motion else unknown, angle, period)
    for name in unknown:
        if name in problems:
            fail(f"{problems[name]}: give --sigma {name}=VALUE")
    found = [_sigma_row(fits[name]) for name in unknown]
    if seek_motion:
        if not fits:
            fail(f"{next(iter(problems.values()))}: give --alpha and --acceleration-sigma")
        best = best_motion(list(fits.values()))
        if alpha is None:
            alpha = best.noise.alpha
            found.append(_motion_row("alpha", alpha, 0, best))
        if acceleration_sigma is None:
            acceleration_sigma = best.noise.acceleration_sigma
            found.append(_motion_row("acceleration sigma", acceleration_sigma, 1, best))
    if found:
        _print(found)
    sigmas = {name: fits[name].noise.measurement_sigma for name in unknown}
    if given.sigma_column is None:
        sigmas |= {
            n: given.sigmas.get(n, given.sigmas.get(None, math.nan))
            for n in sensors
            if n not in sigmas
        }
    return Noise(SingerModel(1.0, alpha or 0.0, acceleration_sigma or 0.0, exact=True), sigmas)


def _fit(
    groups: list[Group], sensors: list[str], angle: str, period: float | None
) -> tuple[dict[str, SensorFit], dict[str, str]]:
    """Return the fits of sensors that can be fitted, and why others cannot."""
    fits, problems = {}, {}
    for name in tracked(sensors, "Fitting"):
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


_Row = tuple[str, float, float, str, int]


def _sigma_row(fit: SensorFit) -> _Row:
    noise = fit.noise
    name = f"sigma of {fit.sensor}"
    return name, noise.measurement_sigma, noise.relative_errors[2], fit.sensor, fit.left_out


def _motion_row(name: str, value: float, which: int, fit: SensorFit) -> _Row:
    return name, value, fit.noise.relative_errors[which], fit.sensor, fit.left_out


def _print(rows: list[_Row]) -> None:
    names = ["fitted", "value", "relative error", "from the plots of", "left out"]
    table = pl.DataFrame(rows, names, orient="row")

    def cells(row: dict[str, object]) -> dict[str, str]:
        texts = {name: as_text(value) for name, value in row.items()}
        value, error = row["value"], row["relative error"]
        if isinstance(value, float) and isinstance(error, float):
            texts["value"] = f"{value:.3g}"
            texts["relative error"] = f"{error:.0%}" if math.isfinite(error) else "not told"
        return texts

    print_table(table, cells, text=["fitted", "from the plots of"], limited="rows are shown")
