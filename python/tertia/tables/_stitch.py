"""Tracks across the boundaries of a recording that was tracked in parts."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import polars as pl

from tertia.tables._frames import Table, names, result, series

_NEEDED = ("time_s", "track", "sensor", "plot")


def stitch(parts: Iterable[Table]) -> Iterator[Table]:
    """Join the tracks of parts of a recording that overlap in time.

    Every part except the first must begin some minutes before the end of the previous part. Tracks
    of two parts that share plots in this overlap become one track, with the number of the earlier
    part. In the overlap, the rows of the earlier part are used, because its tracks have a longer
    history; after the end of this part, the rows of the next part follow. The plots of one part and
    the rows of two parts are in memory at the same time.

    Parameters
    ----------
    parts : iterable of DataFrame of Polars or pandas, Table or RecordBatch of pyarrow
        Results of `track`, in time order, from plots with a column `plot` that numbers them in the
        whole recording.

    Returns
    -------
    iterator of tables of the same kind
        One table per part, with the rows that are not in the earlier tables, and the numbers of the
        tracks in the whole recording.

    Raises
    ------
    ValueError
        If a part ends before the previous one, plots are not numbered in the whole recording, or a
        table does not have the columns of tracks.
    TypeError
        If a table is of an unsupported kind.

    Notes
    -----
    Each part is tracked without information from earlier parts, such as systematic errors of
    radars, the density of clutter, and how long a target has existed. The longer the overlap, the
    better are the tracks at a boundary; for measured figures, see the page 'Embedding'.

    Examples
    --------
    >>> import numpy as np, polars as pl
    >>> from tertia import tables
    >>> from tertia.sensors import Radar
    >>> radar = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0)
    >>> time = np.arange(0.0, 400.0, 4.0)
    >>> plots = pl.DataFrame({"time_s": time, "range_m": 50e3 + 200 * time, "azimuth_deg": 30.0})
    >>> plots = plots.with_row_index("plot")
    >>> halves = [plots.filter(pl.col("time_s") <= 200), plots.filter(pl.col("time_s") > 100)]
    >>> found = pl.concat(tables.stitch(tables.track(half, sensors=[radar]) for half in halves))
    >>> found.height, found["track"].unique().to_list()
    (100, [1])
    """
    before: pl.DataFrame | None = None
    count = 0
    for number, table in enumerate(parts):
        own = _read(table, number)
        if before is None or own.is_empty():
            kept = own
        else:
            _check_order(before, own, number)
            own, kept = _continued(before, own, count, number)
        if own.height:
            before, count = own, max(count, *own["track"].to_list())
        yield result(table, kept)


def _read(table: Table, number: int) -> pl.DataFrame:
    """Return a table of tracks as a Polars DataFrame."""
    there = names(table)
    missing = [name for name in _NEEDED if name not in there]
    if missing:
        raise ValueError(
            f"parts[{number}] has no column {missing[0]}; it must be a result of `track`"
        )
    return pl.DataFrame({name: series(table, name) for name in there})


def _check_order(before: pl.DataFrame, own: pl.DataFrame, number: int) -> None:
    ends = before["time_s"].max(), own["time_s"].max()
    if ends[1] < ends[0]:  # type: ignore[operator]
        raise ValueError(
            f"parts[{number}] ends at {ends[1]!s}, the part before it at {ends[0]!s}: parts "
            "must be in order of time"
        )


def _continued(
    before: pl.DataFrame, own: pl.DataFrame, count: int, number: int
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Return the rows of a part with track numbers of the whole recording, and the new rows."""
    common = _common(before, own, number)
    earlier = _paired(common)
    fresh = [one for one in own["track"].unique().sort().to_list() if one not in earlier]
    numbers = earlier | {one: count + k for k, one in enumerate(fresh, start=1)}
    seam = before["time_s"].max()
    last = before.group_by("track").agg(end=pl.col("time_s").max())
    renamed = own.with_columns(
        # a new track is kept from its beginning, unless its plots belong to an earlier track
        later=pl.col("track").is_in(common["track_own"].unique().implode())
        | (pl.col("time_s").max().over("track") <= seam),
        track=pl.col("track").replace_strict(numbers, return_dtype=own.schema["track"]),
    )
    end = pl.col("end").fill_null(pl.when("later").then(pl.lit(seam)))
    kept = (
        renamed.join(last, on="track", how="left", maintain_order="left")
        .filter(end.is_null() | (pl.col("time_s") > end))
        .join(before.select("plot"), on="plot", how="anti", maintain_order="left")
    )
    return renamed.drop("later"), kept.drop("later", "end")


def _common(before: pl.DataFrame, own: pl.DataFrame, number: int) -> pl.DataFrame:
    """Return the tracks, and the times of their rows, of each plot that both parts contain."""
    start, end = own["time_s"].min(), before["time_s"].max()
    ends = [
        one.filter(pl.col("plot").is_not_null()).select(_NEEDED)
        for one in (before.filter(pl.col("time_s") >= start), own)
    ]
    common = ends[0].join(ends[1], on="plot", suffix="_own")
    if common.height:
        apart = (pl.col("time_s") - pl.col("time_s_own")).abs() > (end - start) / 2  # type: ignore[operator]
        other = pl.col("sensor").ne_missing(pl.col("sensor_own"))
        for plot in common.filter(apart | other)["plot"].head(1):
            raise ValueError(
                f"plot {plot} of parts[{number - 1}] and plot {plot} of parts[{number}] differ: "
                "number the plots of the whole recording in a column `plot` before it is divided"
            )
    return common


def _paired(common: pl.DataFrame) -> dict[int, int]:
    """Return the earlier track of each track, one to one; most common plots are paired first."""
    counts = common.group_by("track", "track_own").len()
    most = counts.sort("len", "track", "track_own", descending=[True, False, False])
    found: dict[int, int] = {}
    for earlier, own, _ in most.iter_rows():
        if own not in found and earlier not in found.values():
            found[own] = earlier
    return found
