"""Times given as text or datetimes instead of seconds."""

from __future__ import annotations

from datetime import datetime, timezone
from typing import Any

import numpy as np
import numpy.typing as npt


def are_moments(array: npt.NDArray[Any]) -> bool:
    """Return whether an array holds datetimes or text."""
    if array.dtype.kind in "MU":
        return True
    first = next((one for one in array.flat if one is not None), None)
    return array.dtype.kind == "O" and isinstance(first, (str, datetime, np.datetime64))


def seconds(array: npt.NDArray[Any], name: str) -> npt.NDArray[np.float64]:
    """Return datetimes as seconds since 1970; datetimes without a time zone are taken as UTC."""
    if array.dtype.kind != "M":
        flat = [_moment(one, f"{name}[{at}]") for at, one in enumerate(array.flat)]
        return np.array(flat, dtype=np.float64).reshape(array.shape)
    since = array - np.datetime64(0, "s").astype(array.dtype)
    found = np.asarray(since / np.timedelta64(1, "s"), dtype=np.float64)
    return np.where(np.isnat(array), np.nan, found)


def _moment(one: Any, place: str) -> float:
    if one is None:
        return np.nan
    if isinstance(one, np.datetime64):
        return float(seconds(np.asarray(one), place))
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
