"""Noise of plots and motion, fitted where they are not stated."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from tertia._arrays import FloatArray
from tertia.kalman import NoiseFit, fit_noise

# times and plots of one sensor and one target, nan where there is no plot
Series: TypeAlias = tuple[FloatArray, FloatArray]

# so many determine sigma to half a percent, and take seconds
_MOST_PLOTS = 50_000
# a plot so many sigmas from the track of the others is an outlier
_GATE = 4.0


@dataclass(frozen=True, slots=True)
class SensorFit:
    """The noise of a sensor, and of the motion as it sees it, without its outliers."""

    sensor: str
    noise: NoiseFit
    left_out: int

    @property
    def motion_error(self) -> float:
        """Relative error of the acceleration; inf if the plots do not determine alpha."""
        alpha, acceleration, _ = self.noise.sigma
        known = np.isfinite(alpha) and self.noise.acceleration_sigma > 0
        return float(acceleration / self.noise.acceleration_sigma) if known else np.inf


def fit_sensor(sensor: str, series: Sequence[Series], period: float | None) -> SensorFit:
    """Fit the noise of one sensor to all its series, without outliers.

    A few of them would otherwise dominate the fit. Raises ValueError where there is too little to
    fit.
    """
    times, z = _stacked(series)
    noise = fit_noise(z, time=times, period=period, outlier_gate=_GATE)
    return SensorFit(sensor, noise, int(noise.outlier.sum()))


def best_motion(fits: Sequence[SensorFit]) -> SensorFit:
    """Return the fit that determines the motion best.

    All sensors see the same motion, so averaging their fits would hardly say more.
    """
    return min(fits, key=lambda fit: fit.motion_error)


def _stacked(series: Sequence[Series]) -> Series:
    """Return the series as rows of equal length: the longest ones, up to a limit."""
    present = [(t[~np.isnan(z)], z[~np.isnan(z)]) for t, z in series]
    present.sort(key=lambda pair: -pair[0].size)
    longest = min(_MOST_PLOTS, present[0][0].size)
    used = present[: max(1, _MOST_PLOTS // max(1, longest))]
    times, plots = np.zeros((len(used), longest)), np.full((len(used), longest), np.nan)
    for row, (t, z) in enumerate(used):
        count = min(longest, t.size)
        plots[row, :count] = z[:count]
        # no time passes after the last plot
        times[row, :count], times[row, count:] = t[:count], t[count - 1] if count else 0.0
    return times, plots
