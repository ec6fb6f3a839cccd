"""Warnings about records that look wrong."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from datetime import timedelta

import numpy as np
import polars as pl

from tertia._arrays import FloatArray
from tertia.tables._names import all_misspelt

# number of values to check a unit, least spread of azimuths (°), least median of ranges (m)
_DOUBTFUL_COUNT, _DOUBTFUL_SPREAD, _LEAST_RANGE = 20, 1.0, 1000.0
# azimuths in degrees are rarely above a circle, and in gradians not above 400
_FULL, _GRADIANS = 361.0, 400.0
# largest range difference, as a share of the distance of sensors, that may be in microseconds
_TINY = 1 / 250
# median range, as a share of the distance of sensors, that is probably in kilometres
_NEAR = 1 / 50
_SMALL_RANGES = (
    "half of the ranges are below {:.3g}: are they kilometres or nautical miles? Use metres"
)
# the year 5138, in seconds, and in other units
_LATEST = 1e11
_SUBUNITS = {"milliseconds": 1e14, "microseconds": 1e17, "nanoseconds": math.inf}
# the years 1970 to 2100, in days; and the longest recording in days
_DAYS = {
    (25_569.0, 73_051.0): "as in spreadsheets",
    (2_440_587.0, 2_488_070.0): "as in Julian dates",
}
_LONGEST = 1.0
# digits of the time of day after the last one; minutes that such times pass, and their usual step
_MIDNIGHT, _MINUTES, _SHORT = 240_000.0, 3, 20.0
# share of an hour within which local times go back at its end
_HOUR, _AN_HOUR, _ALMOST = 3600.0, timedelta(hours=1), 5 / 6
# day and last hour at which summer time begins, and usual steps within which its first time comes
_SUNDAY, _NIGHT, _SKIPPED = 6, 3, 10.0
# seconds by which a clock may be set back, and this in multiples of delays and of usual steps
_AT_ONCE, _MOST_BACK, _FAR = 1.0, 43_200.0, 3.0
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
    if name == "azimuth_deg" and _are_gradians(known):
        doubt("azimuths reach 400: are they gradians? Use degrees, 0.9 for a gradian")
        return
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


def _are_gradians(azimuths: FloatArray) -> bool:
    """Return whether angles go round a circle of 400."""
    known = azimuths[np.isfinite(azimuths)]
    if len(known) < _DOUBTFUL_COUNT or known.min() < 0.0 or not _FULL < known.max() <= _GRADIANS:
        return False
    return bool(np.all(np.histogram(known, 8, (0.0, _GRADIANS))[0]))


def doubt_names(
    described: Mapping[str, Mapping[str, object]], known: Sequence[str], file: str
) -> None:
    """Warn of keys of sensors that are probably misspelt names of known ones, and are not used."""
    judged: set[str] = set()
    for name, row in described.items():
        there = [key for key, cell in row.items() if cell is not None and key not in judged]
        for said in all_misspelt(known, there):
            doubt(f"{file}: {name} {said}")
        judged.update(there)
        judged.difference_update(known)


def doubt_ranges(values: FloatArray, places: FloatArray) -> None:
    """Warn if ranges are probably not in metres, because they are tiny beside the net of sensors.

    `places` are the positions of the sensors, (K, D), in metres.
    """
    known = np.abs(values[np.isfinite(values)])
    if len(known) < _DOUBTFUL_COUNT:
        return
    typical, apart = float(np.median(known)), extent(places)
    if typical < _LEAST_RANGE and (apart == 0.0 or typical < _NEAR * apart):
        doubt(_SMALL_RANGES.format(typical))


def extent(places: FloatArray) -> float:
    """Return the largest distance between two of the places, (K, D)."""
    return float(np.max(np.linalg.norm(places[:, np.newaxis] - places, axis=-1)))


def doubt_differences(values: FloatArray, places: FloatArray) -> None:
    """Warn if range differences are probably times, such as microseconds.

    `places` are the positions of the sensors, (K, D), in metres.
    """
    known = np.abs(values[np.isfinite(values)])
    if len(known) < _DOUBTFUL_COUNT:
        return
    largest, apart = float(np.max(known)), extent(places)
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
        unit = next(unit for unit, most in _SUBUNITS.items() if last <= most)
        doubt(f"{name} is as large as {last:.6g}: is it in {unit}? Use seconds")
    for (least, most), said in _DAYS.items():
        is_short = least < first < last < most and last - first < _LONGEST
        if is_short and times.n_unique() >= _DOUBTFUL_COUNT:
            doubt(
                f"{name} is between {first:.6f} and {last:.6f}: is it in days, {said}? Use "
                "seconds, or dates with times"
            )
    if first >= 0 and last < _MIDNIGHT and _are_clock_digits(times):
        doubt(
            f"{name} is between {first:.10g} and {last:.10g}, minutes and seconds below 60: "
            "are these times of day, hhmmss? Write them as 12:35:19"
        )


def _are_clock_digits(times: pl.Series) -> bool:
    """Return whether numbers have the digits hhmmss, as in NMEA, and pass some minutes."""
    minutes, seconds = np.divmod(times.drop_nulls().to_numpy().astype(np.float64), 100.0)
    if np.any(seconds >= 60.0) or np.any(minutes % 100.0 >= 60.0):
        return False
    if len(np.unique(minutes)) <= _MINUTES:
        return False
    step = np.diff(np.unique(100.0 * minutes + seconds))
    return bool(len(step) >= _DOUBTFUL_COUNT and np.median(step) <= _SHORT)


def doubt_summer_time(name: str, times: pl.Series) -> bool:
    """Warn, and return True, if local times are probably those of a night when clocks change."""
    if not isinstance(times.dtype, pl.Datetime) or times.dtype.time_zone is not None:
        return False
    known = times.drop_nulls()
    return _doubt_mixed_hours(name, known) or _doubt_skipped_hour(name, known)


def _doubt_mixed_hours(name: str, known: pl.Series) -> bool:
    """Warn, and return True, if the hour before the end of summer time comes twice."""
    # times of several sensors may be somewhat out of order
    least = -(2 * _ALMOST - 1.0) * _HOUR
    back = (known.diff().dt.total_milliseconds() < 1e3 * least).arg_true().to_list()
    if len(back) != 1:
        return False
    before, after = known[back[0] - 1], known[back[0]]
    hour = after.replace(minute=0, second=0, microsecond=0)
    late, early = ((one - hour).total_seconds() / _HOUR for one in (before, after))
    # the hour begins again almost at its end, and it is not the record that begins again
    start = abs((known[0] - after).total_seconds()) / _HOUR
    found: bool = _ALMOST <= late <= 1.0 and early <= 1.0 - _ALMOST < start
    if found:
        doubt(
            f"{name} goes back from {before} to {after}: are these local times at the end of "
            "summer time? Give times with their zone; otherwise the rows of two hours are mixed"
        )
    return found


def _doubt_skipped_hour(name: str, known: pl.Series) -> bool:
    """Warn, and return True, if an hour of a night before Sunday is missing from local times."""
    if known.is_empty() or known.max() - known.min() < _AN_HOUR:  # type: ignore[operator]
        return False
    each = known.unique().sort()
    step = each.diff().drop_nulls().dt.total_microseconds().to_numpy() / 1e6
    usual = float(np.median(step)) if len(step) >= _DOUBTFUL_COUNT else math.inf
    gaps = np.flatnonzero(step > _HOUR)
    if len(gaps) != 1 or step[gaps[0]] > _HOUR + _SKIPPED * usual:
        return False
    before, after = each[int(gaps[0])], each[int(gaps[0]) + 1]
    hour = after.replace(minute=0, second=0, microsecond=0)
    # at midnight or later
    found: bool = hour.weekday() == _SUNDAY and hour.hour <= _NIGHT and (hour - before) > _AN_HOUR
    if found:
        doubt(
            f"{name} goes from {before} to {after}: are these local times at the start of summer "
            "time? Give times with their zone; otherwise targets seem to stop for an hour"
        )
    return found


def doubt_clock(name: str, times: pl.Series, labels: Sequence[pl.Series]) -> None:
    """Warn if the clock of a recording was probably set back.

    If rows with other `labels`, such as those of a second sensor, begin where times go back, it was
    not.
    """
    seconds = times if times.dtype.is_numeric() else times.dt.timestamp("us") / 1e6
    rows = np.flatnonzero(seconds.is_not_null().to_numpy())
    step = np.diff(seconds.to_numpy()[rows])
    if len(step) < _DOUBTFUL_COUNT or not _AT_ONCE < -step.min() < _MOST_BACK:
        return
    at = int(step.argmin())
    # delays of messages are many, and of all sizes
    usual = max(-float(np.partition(step, 1)[1]), float(np.median(np.abs(step))))
    since = float(np.sum(step[: at + 1]))
    if min(-float(step[at]), since) < _FAR * usual:
        return
    first, last = (int(row) for row in rows[at : at + 2])
    for label in labels:
        one, other = (set(part.unique().to_list()) for part in (label[:last], label[last:]))
        if one.isdisjoint(other):
            return
    before, after = (
        f"{one:.10g}" if isinstance(one, float) else one for one in times[[first, last]]
    )
    doubt(
        f"{name} goes back once, from {before} to {after}: was the clock set? The rows of two "
        "periods are then mixed"
    )
