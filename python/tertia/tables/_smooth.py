"""Positions of targets, smoothed along time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import polars as pl

from tertia import smoothing
from tertia._arrays import FloatArray, finite, real
from tertia.tables._columns import as_names, by_length, known, layout, numbers, seconds, times
from tertia.tables._kinds import Table, take

_QUANTITIES = ("smoothed", "rate", "acceleration")


def smooth(
    table: Table,
    columns: str | Sequence[str] = ("east_m", "north_m"),
    *,
    sigma: float | str | Sequence[float | str],
    time: str = "time_s",
    by: str | Sequence[str] = (),
    jerk: float | None = None,
) -> Table:
    """Smooth positions, or any series, with `tertia.smoothing.smooth`.

    Parameters
    ----------
    table : DataFrame of Polars or pandas, Table or RecordBatch of pyarrow
        One row per plot, in any order; null and nan are missing.
    columns : str or sequence of str
        Columns of the axes.
    sigma : float, str or sequence of these
        Standard deviation of the plots, or the column that has it: for all axes, or for each.
    time : str
        Column of the time: seconds, or dates with time.
    by : str or sequence of str
        Columns whose values tell the targets; by default all plots are of one.
    jerk : float, optional
        Intensity of the white jerk; by default that which makes each track most likely.

    Returns
    -------
    table of the same kind
        The same rows with more columns, for each axis: `_smoothed`, `_rate` and `_acceleration`
        after its name, each followed by one that ends in `_sigma`; null where nothing is known.

    Raises
    ------
    ValueError
        A column that is not there, or there already, a measurement that is infinite, a time that
        is missing, a sigma that is not positive, or a negative jerk.
    numpy.linalg.LinAlgError
        Sigmas that are lost to rounding beside each other.
    TypeError
        A table of another kind, or a column or option of the wrong type.

    Examples
    --------
    >>> import numpy as np, polars as pl
    >>> from tertia.tables import smooth
    >>> time = np.arange(20.0)
    >>> table = pl.DataFrame({"time_s": time, "east_m": 100 * time + 10 * (-1) ** np.arange(20)})
    >>> track = smooth(table, "east_m", sigma=10.0, jerk=0.0)
    >>> [round(value, 2) for value in track.select("east_m_rate", "east_m_rate_sigma").row(9)]
    [99.85, 0.4]
    """
    axes, keys = as_names(columns), as_names(by)
    told = [sigma] * len(axes) if isinstance(sigma, (str, int, float)) else list(sigma)
    if len(told) != len(axes):
        raise ValueError(f"sigma has {len(told)} elements; there are {len(axes)} columns")
    of_columns = [one for one in told if isinstance(one, str)]
    intensity = None if jerk is None else real(jerk, "jerk")
    taken = take(table, [*axes, time, *of_columns, *keys])
    frame = taken.frame
    groups = layout(frame, keys)
    t = seconds(times(frame[time]))
    rows = groups.order[np.lexsort((t[groups.order], groups.group))]
    y = np.column_stack([numbers(frame[name]) for name in axes])[rows]
    variance = np.column_stack([_sigmas(frame, one) for one in told])[rows] ** 2
    moments = t[rows]
    values, sigmas = np.full((2, frame.height, len(_QUANTITIES) * len(axes)), np.nan)

    def tracks(elements: Any) -> tuple[Any, smoothing.SmoothedPositions]:
        found = smoothing.smooth(
            y[elements], variance[elements], time=moments[elements], jerk=intensity
        )
        return rows[elements], found

    for _, found in by_length(groups.lengths, tracks):
        if isinstance(found, ValueError):
            raise found
        places, track = found
        values[places], sigmas[places] = track.mean, track.sigma
    return taken.extended(_added(values, sigmas, axes))  # type: ignore[no-any-return]


def _sigmas(frame: pl.DataFrame, sigma: float | str) -> FloatArray:
    if isinstance(sigma, str):
        return numbers(frame[sigma])
    return np.full(frame.height, finite(real(sigma, "sigma"), "sigma"))


def _added(values: FloatArray, sigmas: FloatArray, axes: Sequence[str]) -> pl.DataFrame:
    added = {}
    for d, axis in enumerate(axes):
        for q, quantity in enumerate(_QUANTITIES):
            column, name = q * len(axes) + d, f"{axis}_{quantity}"
            told = np.isfinite(sigmas[:, column])
            added[name] = known(values[:, column], told)
            added[f"{name}_sigma"] = known(sigmas[:, column], told)
    return pl.DataFrame(added)
