"""Kalman filter for an angle with its rate and acceleration, in a series or in live data.

The source is Panasyuk, Pudovkin, Rogachev 2018, equations (14) to (20), with misprints corrected.
The state is `[angle, rate, acceleration]`. The acceleration decays exponentially (Singer 1970), and
plots measure only the angle. Angles and times may be in any unit; the results are in the same
units.

If no initial state is given, angle and rate are treated exactly as unknown, and the acceleration
has the variance of its model. An unknown quantity has the variance inf; before the first plot, its
mean is nan.
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
