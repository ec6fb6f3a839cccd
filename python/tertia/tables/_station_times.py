"""Warnings about stations whose times are hours off, or in another unit than those of others."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import polars as pl

from tertia._arrays import BoolArray
from tertia.tables._doubts import doubt, doubt_summer_time
from tertia.tables._measurements import Target

# least measurements of a station; least offset, and the unit of offsets: zones differ by quarters
# of an hour
_FEWEST, _LEAST, _QUARTER, _HOUR = 10, 1700.0, 900.0, 3600.0
# seconds, and steps of the stations, by which both ends of two records may differ
_ENDS, _STEPS = 5.0, 2.0
# gap between the times of two stations, in durations of the longer
_APART = 3.0
# how many times longer milliseconds and so on last than seconds, and how nearly
_UNITS = {1e3: "milliseconds", 1e6: "microseconds", 1e9: "nanoseconds"}
_NEARLY = 1.1


def doubt_station_times(targets: Sequence[Target]) -> None:
    """Warn if the times of a station are hours off those of most others, or in another unit.

    Records of two stations that begin and end some quarters of an hour apart, or far after each
    other, are probably of one time in two zones.
    """
    for target in targets:
        spans = _spans(target)
        if _doubts_summer_time(target, spans):
            return
        for k in reversed(spans):
            others = [span for one, span in spans.items() if one != k]
            said = [_difference(spans[k], span) for span in others]
            known = [one for one in said if one is not None]
            if len(known) > len(others) / 2:
                name, (first, last, _) = target.sensors.names[k], spans[k]
                low, high = min(span[0] for span in others), max(span[1] for span in others)
                when = f"from {first:.10g} to {last:.10g} s"
                doubt(
                    f"the times of {name} go {when}, those of the others from {low:.10g} to "
                    f"{high:.10g} s: {sorted(known)[len(known) // 2]}"
                )
                return


def _doubts_summer_time(target: Target, stations: Iterable[int]) -> bool:
    """Warn, and return True, if summer time begins in the times of one station alone."""
    if not target.moments.dtype.is_temporal() or np.diff(target.times).max(initial=0.0) >= _HOUR:
        return False
    names = target.sensors.names
    moments = {k: target.moments.filter(pl.Series(_measures(target, k))) for k in stations}
    return any(doubt_summer_time(f"the time of {names[k]}", own) for k, own in moments.items())


def _measures(target: Target, k: int) -> BoolArray:
    """Return at which instants a station measures anything, (N,)."""
    known = [np.isfinite(values[:, k]) for values in target.values.values()]
    return np.asarray(np.any(known, axis=0))


def _spans(target: Target) -> dict[int, tuple[float, float, float]]:
    """Return the first and last time and the usual step of each station with measurements."""
    found = {}
    for k in range(len(target.sensors.names)):
        own = target.times[_measures(target, k)]
        if len(own) >= _FEWEST and own[-1] > own[0]:
            found[k] = float(own[0]), float(own[-1]), float(np.median(np.diff(own)))
    return found


def _difference(own: tuple[float, float, float], other: tuple[float, float, float]) -> str | None:
    """Return the question that the times of two stations raise; None if they agree."""
    durations = own[1] - own[0], other[1] - other[0]
    for factor, unit in _UNITS.items():
        if 1 / _NEARLY < durations[0] / durations[1] / factor < _NEARLY:
            return f"are they {unit}? Give all times in seconds"
    shifts = own[0] - other[0], own[1] - other[1]
    least = max(_ENDS, _STEPS * max(own[2], other[2]))
    zone = _QUARTER * round(sum(shifts) / 2 / _QUARTER)
    both = abs(zone) >= _LEAST and max(abs(shift - zone) for shift in shifts) <= least
    gap = max(own[0] - other[1], other[0] - own[1])
    if both or gap > max(_APART * max(durations), _LEAST):
        hours = (zone if both else sum(shifts) / 2) / _HOUR
        return (
            f"are they {abs(hours):.3g} h {'late' if hours > 0 else 'early'}, as of another time "
            "zone? Otherwise stations see nothing at the same time"
        )
    return None
