"""Warnings about records that look wrong."""

from __future__ import annotations

import math
import warnings

import numpy as np
import polars as pl

from tertia._arrays import FloatArray

# number of values to check a unit, least spread of azimuths (°), least median of ranges (m)
_DOUBTFUL_COUNT, _DOUBTFUL_SPREAD, _LEAST_RANGE = 20, 1.0, 1000.0
# largest range difference, as a share of the distance of sensors, that may be in microseconds
_TINY = 1 / 250
# median range, as a share of the distance of sensors, that is probably in kilometres
_NEAR = 1 / 50
_SMALL_RANGES = (
    "half of the ranges are below {:.3g}: are they kilometres or nautical miles? Use metres"
)
# the year 5138, in seconds
_LATEST = 1e11
# largest plausible median of a column, its unit, and the unit that is likely if the median is
# larger
_MOST = {
    "range_nm": (1000.0, "nautical miles", "metres"),
    "height_m": (20_000.0, "metres", "feet"),
    "flight_level": (1000.0, "hundreds of feet", "feet"),
}


class RecordWarning(UserWarning):
    """A warning about records that look wrong, such as radians in a column of degrees."""


def doubt(message: str) -> None:
    """Warn that records look wrong."""
    warnings.warn(message, RecordWarning, stacklevel=2)


def doubt_unit(name: str, values: pl.Series) -> None:
    """Warn if the unit of a column looks wrong."""
    if name not in {"azimuth_deg", "range_m", *_MOST}:
        return
    known = values.to_numpy()
    # checked first, because most columns of degrees soon have a value above 2π
    if name == "azimuth_deg" and np.any(np.abs(known[:_DOUBTFUL_COUNT]) > 2 * math.pi):
        return
    known = known[~np.isnan(known)]
    if len(known) < _DOUBTFUL_COUNT:
        return
    if name == "azimuth_deg":
        if np.all(np.abs(known) <= 2 * math.pi) and np.ptp(known) > _DOUBTFUL_SPREAD:
            doubt("all azimuths are within 6.3 degrees: are they radians? Use degrees")
        return
    typical = float(np.median(np.abs(known)))
    if name == "range_m" and typical < _LEAST_RANGE:
        doubt(_SMALL_RANGES.format(typical))
    most, unit, other = _MOST.get(name, (math.inf, "", ""))
    if typical > most:
        doubt(f"the median of {name} is {typical:.6g}: is it in {other}? Use {unit}")


def doubt_ranges(values: FloatArray, places: FloatArray) -> None:
    """Warn if ranges are probably not in metres, because they are tiny beside the net of sensors.

    `places` are the positions of the sensors, (K, D), in metres.
    """
    known = np.abs(values[np.isfinite(values)])
    if len(known) < _DOUBTFUL_COUNT:
        return
    typical, apart = float(np.median(known)), _extent(places)
    if typical < _LEAST_RANGE and (apart == 0.0 or typical < _NEAR * apart):
        doubt(_SMALL_RANGES.format(typical))


def _extent(places: FloatArray) -> float:
    return float(np.max(np.linalg.norm(places[:, np.newaxis] - places, axis=-1)))


def doubt_differences(values: FloatArray, places: FloatArray) -> None:
    """Warn if range differences are probably times, such as microseconds.

    `places` are the positions of the sensors, (K, D), in metres.
    """
    known = np.abs(values[np.isfinite(values)])
    if len(known) < _DOUBTFUL_COUNT:
        return
    largest, apart = float(np.max(known)), _extent(places)
    if largest < _TINY * apart:
        doubt(
            f"all range differences are below {largest:.3g}, but sensors are {apart:.3g} m apart: "
            "are they times? Multiply them by the speed of the signals: range_difference_m is in "
            "metres"
        )


def doubt_time(name: str, times: pl.Series) -> None:
    """Warn if times are probably not in seconds."""
    if times.dtype.is_numeric() and len(times):
        last = times.max()
        if isinstance(last, (int, float)) and last > _LATEST:
            doubt(f"{name} is as large as {last:.6g}: is it in milliseconds? Use seconds")
