"""Kalman filter of an angle with its rate and acceleration, for series and streams.

Source: Panasyuk, Pudovkin, Rogachev 2018, equations (14) to (20), with misprints corrected. The
state is `[angle, rate, acceleration]`, the acceleration decays (Singer 1970), and plots measure
only the angle. Units are the caller's: any angle, with any unit of time.

Without an initial state the start is exact: angle and rate are unknown, and the acceleration has
the variance of its model. Unknown quantities have the variance inf and, before the first plot, the
mean nan.
"""

from tertia._core import AngleFilter
from tertia.kalman._fit import NoiseFit, fit_noise
from tertia.kalman._model import SingerModel, steady_state
from tertia.kalman._series import (
    FilteredSeries,
    SmoothedSeries,
    Store,
    filter_series,
    smooth_series,
)

__all__ = [
    "AngleFilter",
    "FilteredSeries",
    "NoiseFit",
    "SingerModel",
    "SmoothedSeries",
    "Store",
    "filter_series",
    "fit_noise",
    "smooth_series",
    "steady_state",
]
