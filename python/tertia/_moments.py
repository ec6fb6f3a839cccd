"""Times given as text, datetimes, durations or times of day instead of seconds."""

from __future__ import annotations

import math
from datetime import datetime, time, timedelta, timezone
from typing import Any

import numpy as np
import numpy.typing as npt

_MOMENTS = (str, datetime, np.datetime64, time, timedelta, np.timedelta64)


def are_moments(array: npt.NDArray[Any]) -> bool:
    """Return whether an array holds datetimes, durations, times of day or text."""
    if array.dtype.kind in "MmU":
        return True
    first = next((one for one in array.flat if not _is_missing(one)), None)
    return array.dtype.kind == "O" and isinstance(first, _MOMENTS)


def seconds(array: npt.NDArray[Any], name: str) -> npt.NDArray[np.float64]:
    """Return datetimes as seconds since 1970; datetimes without a time zone are taken as UTC.

    Durations and times of day become their seconds.
    """
    if array.dtype.kind not in "Mm":
        flat = [_moment(one, f"{name}[{at}]") for at, one in enumerate(array.flat)]
        return np.array(flat, dtype=np.float64).reshape(array.shape)
    since = array
    if array.dtype.kind == "M":
        since = array - np.datetime64(0, "s").astype(array.dtype)
    found = np.asarray(since / np.timedelta64(1, "s"), dtype=np.float64)
    return np.where(np.isnat(array), np.nan, found)


def _is_missing(one: Any) -> bool:
    """Return whether an object is None, nan, or what pandas has for a missing time or value."""
    is_nan = isinstance(one, float) and math.isnan(one)
    return one is None or is_nan or type(one).__name__ in {"NaTType", "NAType"}


def _moment(one: Any, place: str) -> float:
    if _is_missing(one):
        return np.nan
    if isinstance(one, (np.datetime64, np.timedelta64)):
        return float(seconds(np.asarray(one), place))
    if isinstance(one, timedelta):
        return one.total_seconds()
    if isinstance(one, time):
        return 3600.0 * one.hour + 60.0 * one.minute + one.second + 1e-6 * one.microsecond
    if isinstance(one, str):
        try:
            # Python 3.10 does not know Z
            one = datetime.fromisoformat(one.strip().replace("Z", "+00:00"))
        except ValueError:
            raise ValueError(
                f"{place} is {str(one)!r}; it must be a number of seconds or a date with time, as "
                "2026-11-22T12:00:00Z"
            ) from None
    if not isinstance(one, datetime):
        raise TypeError(f"{place} is a {type(one).__name__}; it must be a date with time")
    return (one if one.tzinfo else one.replace(tzinfo=timezone.utc)).timestamp()
