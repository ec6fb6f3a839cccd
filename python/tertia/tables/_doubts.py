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
# the years 1970 to 2100, in days as spreadsheets count them, and the longest recording in days
_DAYS, _LONGEST = (25_569.0, 73_051.0), 1.0
# share of an hour within which local times go back at its end
_ALMOST = 5 / 6
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
    if not times.dtype.is_numeric() or not len(times):
        return
    first, last = times.min(), times.max()
    if not isinstance(first, (int, float)) or not isinstance(last, (int, float)):
        return
    if last > _LATEST:
        doubt(f"{name} is as large as {last:.6g}: is it in milliseconds? Use seconds")
    days = _DAYS[0] < first < last < _DAYS[1] and last - first < _LONGEST
    if days and times.n_unique() >= _DOUBTFUL_COUNT:
        doubt(
            f"{name} is between {first:.6f} and {last:.6f}: is it in days, as in spreadsheets? Use "
            "seconds, or dates with times"
        )


def doubt_summer_time(name: str, times: pl.Series) -> None:
    """Warn if local times are probably those of a night at the end of summer time."""
    if not isinstance(times.dtype, pl.Datetime) or times.dtype.time_zone is not None:
        return
    known = times.drop_nulls()
    back = (known.diff().dt.total_milliseconds() < 0).arg_true().to_list()
    if len(back) != 1:
        return
    before, after = known[back[0] - 1], known[back[0]]
    hour = after.replace(minute=0, second=0, microsecond=0)
    late, early = ((one - hour).total_seconds() / 3600.0 for one in (before, after))
    # the hour begins again almost at its end, and it is not the record that begins again
    start = abs((known[0] - after).total_seconds()) / 3600.0
    if _ALMOST <= late <= 1.0 and early <= 1.0 - _ALMOST < start:
        doubt(
            f"{name} goes back from {before} to {after}: are these local times at the end of "
            "summer time? Give times with their zone; otherwise the rows of two hours are mixed"
        )
