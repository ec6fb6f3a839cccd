"""Tracks of the plots of radars."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import polars as pl

from tertia import tracker
from tertia._arrays import FloatArray, IntArray
from tertia._units import FLIGHT_LEVEL, NAUTICAL_MILE
from tertia.flightplan import FlightPlan
from tertia.sensors import Radar
from tertia.tables._columns import numbers, times
from tertia.tables._kinds import Table, names, take
from tertia.tables._track_rows import IDENTITIES, Clock, Identities, track_rows
from tertia.tracker import NO_IDENTITY, Plots

# columns of which one is taken, the first that is there, and their units
_RANGES = {"range_m": 1.0, "range_nm": NAUTICAL_MILE}
_HEIGHTS = {"height_m": 1.0, "flight_level": FLIGHT_LEVEL}
_TIME, _AZIMUTH, _RADAR = "time_s", "azimuth_deg", "radar"
_NAMES = (_TIME, _AZIMUTH, _RADAR, *_RANGES, *_HEIGHTS, *IDENTITIES)


def track(
    table: Table,
    radars: Sequence[Radar],
    *,
    columns: Mapping[str, str] | None = None,
    plans: Sequence[FlightPlan] = (),
    **options: Any,
) -> Table:
    """Track the targets that radars see, as the command `tertia track`.

    Parameters
    ----------
    table : DataFrame of Polars or pandas, Table or RecordBatch of pyarrow
        One row per plot, in any order: `time_s` (seconds, or dates with time), `range_m` or
        `range_nm`, and `azimuth_deg`; `radar`, its name, if there are several; and, if known,
        `height_m` or `flight_level`, and `icao_address` (hexadecimal), `mode_3a` (octal) or
        `identity`.
    radars : sequence of Radar
        The radars. One without a name is called by its index.
    columns : mapping of str to str, optional
        How columns are called in the table, by these names.
    plans : sequence of FlightPlan
        Where targets have said they will fly.
    **options
        As of `tertia.tracker.Tracker`.

    Returns
    -------
    table of the same kind
        One row for every plot of a confirmed track and for every scan that missed it, with time,
        track, radar, index of the plot, position and velocity with their covariance, and what is
        known of turn, height, identity and plan; null where nothing is.

    Raises
    ------
    ValueError
        A column that is not there, a time that is missing, a radar that is not among `radars`, an
        identity that is none, or an option outside its domain.
    TypeError
        A table of another kind, a column of the wrong type, or an option of the wrong type.

    Examples
    --------
    >>> import numpy as np, polars as pl
    >>> from tertia.tables import track
    >>> from tertia.tracker import Radar
    >>> radar = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0)
    >>> time = np.arange(0.0, 100.0, 4.0)
    >>> plots = pl.DataFrame({"time_s": time, "range_m": 50e3 + 200 * time}).with_columns(
    ...     azimuth_deg=30.0
    ... )
    >>> found = track(plots, [radar])
    >>> found.height, found["track"].unique().to_list()
    (25, [1])
    """
    called = dict(columns or {})
    for name in called:
        if name not in _NAMES:
            raise ValueError(f"columns has {name!r}; it must have some of {', '.join(_NAMES)}")
    there = {
        name: called.get(name, name) for name in _NAMES if called.get(name, name) in names(table)
    }
    distance, height, identity = (
        next((name for name in kinds if name in called), None)
        or next((name for name in kinds if name in there), None)
        for kinds in (_RANGES, _HEIGHTS, IDENTITIES)
    )
    if distance is None:
        raise ValueError(f"the table has no column {' or '.join(_RANGES)}")
    wanted = [_TIME, _AZIMUTH, *filter(None, [distance, height, identity])]
    if _RADAR in there or _RADAR in called or len(radars) > 1:
        wanted.append(_RADAR)
    taken = take(table, [called.get(name, name) for name in wanted])
    frame = taken.frame.rename({called.get(name, name): name for name in wanted})
    moments = times(frame[_TIME])
    clock = Clock.of(moments)
    named = [str(k) if radar.name is None else radar.name for k, radar in enumerate(radars)]
    identities = Identities(identity or "identity")
    plots = Plots(
        clock.seconds(moments),
        numbers(frame[distance]) * _RANGES[distance],
        np.radians(numbers(frame[_AZIMUTH])),
        sensor=_radar_numbers(frame, named),
        height=_heights(frame, height),
        identity=_identities(frame, identities) if identity else NO_IDENTITY,
    )
    found = tracker.track(plots, radars, plans=plans, **options)
    rows = track_rows(
        found, clock=clock, identities=identities, radars=named, plans=plans, geodetic={}
    )
    return taken.result(rows)  # type: ignore[no-any-return]


def _heights(frame: pl.DataFrame, name: str | None) -> FloatArray | float:
    return math.nan if name is None else numbers(frame[name]) * _HEIGHTS[name]


def _radar_numbers(frame: pl.DataFrame, named: Sequence[str]) -> IntArray | int:
    if _RADAR not in frame.columns:
        return 0
    column = frame[_RADAR].cast(pl.String)
    unknown = (~column.is_in(list(named)).fill_null(False)).arg_true()
    if len(unknown):
        raise ValueError(
            f"radar[{unknown[0]}] is {column[unknown[0]]}; the radars are {', '.join(named)}"
        )
    found = column.replace_strict(named, list(range(len(named))), return_dtype=pl.Int64)
    return np.asarray(found.to_numpy())


def _identities(frame: pl.DataFrame, identities: Identities) -> IntArray:
    column = frame[identities.name]
    if column.dtype.is_float():
        column = column.fill_nan(None).cast(pl.Int64)
    text = column.cast(pl.String)
    found = identities.numbers(text)
    wrong = (text.is_not_null() & found.is_null()).arg_true()
    if len(wrong):
        base = IDENTITIES[identities.name]
        raise ValueError(
            f"{identities.name}[{wrong[0]}] is {text[wrong[0]]!r}; it must be a number of base "
            f"{base}"
        )
    return np.asarray(found.fill_null(NO_IDENTITY).to_numpy())
