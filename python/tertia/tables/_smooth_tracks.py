"""Smoothed tracks from tables of radar plots."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from tertia import tracker
from tertia.tables._described import SensorsLike
from tertia.tables._frames import Table, result
from tertia.tables._groups import known, named
from tertia.tables._identities import identity_columns
from tertia.tables._parts import source_of
from tertia.tables._track import Recording, recording_of, state_columns, tracks_of
from tertia.tracker import (
    Longitudinal,
    Motion,
    SmoothedTracks,
    TrackTable,
    Transversal,
    Vertical,
)

# undetermined values are null
_WORDS: dict[str, dict[int, str]] = {
    "transversal": {
        Transversal.CONSTANT_COURSE: "constant",
        Transversal.RIGHT_TURN: "right",
        Transversal.LEFT_TURN: "left",
    },
    "longitudinal": {
        Longitudinal.CONSTANT_SPEED: "constant",
        Longitudinal.INCREASING_SPEED: "increasing",
        Longitudinal.DECREASING_SPEED: "decreasing",
    },
    "vertical": {Vertical.LEVEL: "level", Vertical.CLIMB: "climb", Vertical.DESCENT: "descent"},
}


@dataclass(frozen=True, slots=True)
class Smoothing:
    """A recording, its filtered tracks, the smoothed tracks, and the processing time."""

    recording: Recording
    tracks: TrackTable
    table: SmoothedTracks
    seconds: float

    @property
    def rows(self) -> pl.DataFrame:
        """The rows of the smoothed tracks, with the columns of files."""
        table, of = self.table, self.recording
        words = {
            name: pl.Series(getattr(table, name)).replace_strict(
                dict(called), default=None, return_dtype=pl.String
            )
            for name, called in _WORDS.items()
        }
        between = table.plot < 0
        return pl.DataFrame(
            {
                "time_s": of.clock.moments(table.time),
                "track": table.track,
                "sensor": named(table.sensor, of.sensors.names),
                "plot": of.numbered(table.plot),
                **state_columns(table, of.sensors),
                "acceleration_m_s2": table.acceleration,
                "turn_rate_deg_s": np.degrees(table.turn_rate),
                "turn_probability": table.turn_probability,
                "speed_change_probability": table.speed_change_probability,
                "height_m": known(table.height),
                "height_sigma_m": known(table.height_sigma),
                "vertical_rate_m_s": known(table.vertical_rate),
                **words,
                **identity_columns(table, of.identities),
                "gap_s": table.gap,
                "outlier": known(table.outlier, ~between),
                "final": table.final,
            }
        )

    def summary(self) -> dict[str, Any]:
        """Return figures of the whole recording."""
        table = self.table
        sigma = np.sqrt(np.trace(table.covariance[:, :2, :2], axis1=1, axis2=2) / 2)
        return {
            "plot_count": len(self.recording.plots),
            "in_track_count": int(np.sum(table.plot >= 0)),
            "track_count": len(np.unique(table.track)),
            "joined_track_count": len(np.unique(self.tracks.track)) - len(np.unique(table.track)),
            "row_count": len(table),
            "outlier_count": int(np.sum(table.outlier)),
            "turn_share": float(np.mean(table.turn_probability > 0.5)) if len(table) else 0.0,
            "median_sigma_m": float(np.median(sigma)) if len(table) else None,
            "smoothing_s": self.seconds,
        }


def smooth_tracks(
    table: Table,
    *,
    sensors: SensorsLike,
    columns: Mapping[str, str] | None = None,
    motion: Motion = "imm",
    every: float | None = None,
    exclude: str | None = None,
    clock_period: float | None = None,
    n_threads: int | None = None,
) -> Table:
    """Estimate each track from all its plots, including later ones, as `tertia smooth-tracks` does.

    Parameters
    ----------
    table : DataFrame of Polars or pandas, Table or RecordBatch of pyarrow
        One row per plot, in any order, with the columns of `track`.
    sensors : sequence of Radar, DataFrame, or str or Path
        The radars. A radar without a name is identified by its index. A table has one row per
        radar, with the columns of sensors files; a path is that of a sensors file in TOML.
    columns : mapping of str to str, optional
        The names that columns have in this table, keyed by their standard names.
    motion : {"imm", "cv"} or ImmModel, CvModel
        Motion model of the targets.
    every : float, optional
        Interval in seconds at which additional rows between plots are returned.
    exclude : str, optional
        Name of a sensor whose plots are not used for the estimates; the result still has rows for
        them.
    clock_period : float, optional
        Seconds after which the clock of the plots restarts from 0, for example 86400.
    n_threads : int, optional
        Number of threads; by default all cores.

    Returns
    -------
    table of the same kind
        One row for every plot of a track, and for every additional time. The columns are those of
        `track`, without the columns of plans and `confirmed`, and in addition `acceleration_m_s2`,
        `turn_rate_deg_s`, `speed_change_probability`, `height_sigma_m`, the movement as words
        (`transversal`, `longitudinal`, `vertical`), `gap_s`, `outlier` and `final`. Unknown values
        are null. The result can be used as the truth in `evaluate`.

    Raises
    ------
    RecordError, ValueError, TypeError
        As for `track`; also if `exclude` is not among `sensors`.

    Examples
    --------
    >>> import numpy as np, polars as pl
    >>> from tertia import tables
    >>> from tertia.sensors import Radar
    >>> radar = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0)
    >>> time = np.arange(0.0, 100.0, 4.0)
    >>> plots = pl.DataFrame({"time_s": time, "range_m": 50e3 + 200 * time, "azimuth_deg": 30.0})
    >>> found = tables.smooth_tracks(plots, sensors=[radar], every=2.0)
    >>> found.height, found["transversal"].unique().to_list()
    (49, ['constant'])
    """
    found = smoothing_of(
        recording_of(source_of(table), sensors, columns),
        motion=motion,
        every=every,
        exclude=exclude,
        clock_period=clock_period,
        n_threads=n_threads,
    )
    return result(table, found.rows)


def smoothing_of(
    recording: Recording,
    *,
    motion: Motion,
    every: float | None,
    exclude: str | None,
    clock_period: float | None,
    n_threads: int | None,
) -> Smoothing:
    """Return the smoothed tracks of a recording."""
    names = list(recording.sensors.names)
    if exclude is not None and exclude not in names:
        raise ValueError(f"exclude is {exclude!r}; it must be one of {', '.join(names)}")
    tracking = tracks_of(recording, motion=motion, clock_period=clock_period, n_threads=n_threads)
    start = time.perf_counter()
    table = tracker.smooth_tracks(
        recording.plots,
        recording.sensors.items,
        tracking.table,
        motion=motion,
        every=every,
        exclude=None if exclude is None else names.index(exclude),
        n_threads=n_threads,
    )
    seconds = tracking.seconds + time.perf_counter() - start
    return Smoothing(recording, tracking.table, table, seconds)
