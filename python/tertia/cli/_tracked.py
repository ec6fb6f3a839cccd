"""What came of a recording of plots: by radar, by track, as a whole, as a picture."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from tertia import plot
from tertia.cli import _maps, _tables
from tertia.cli._radar_plots import Recording
from tertia.cli._radars import RadarSites
from tertia.flightplan import FlightPlan
from tertia.tables._track_rows import track_rows
from tertia.tracker import PlotStatus, TrackTable

_FIGURE_SIZE = (11.0, 9.0)


@dataclass(frozen=True, slots=True)
class Tracked:
    """A recording, its tracks, and how long they took."""

    recording: Recording
    sites: RadarSites
    plans: Sequence[FlightPlan]
    table: TrackTable
    seconds: float

    def refused(self) -> dict[str, int]:
        """Return how many plots could not be used, by the reason."""
        statuses, counts = np.unique(self.table.track_of_plot, return_counts=True)
        pairs = zip(statuses.tolist(), counts.tolist(), strict=True)
        return {PlotStatus(status).message: count for status, count in pairs if status < 0}

    def rows(self) -> pl.DataFrame:
        """Return the rows of the tracks as they are in files."""
        recording, sites = self.recording, self.sites
        return track_rows(
            self.table,
            clock=recording.clock,
            identities=recording.identities,
            radars=sites.names,
            plans=self.plans,
            geodetic=sites.places.geodetic(self.table.position),
        )


def radar_rows(tracked: Tracked) -> pl.DataFrame:
    """Return what is told of each radar.

    Scans that missed a target are those of confirmed tracks.
    """
    table, radar = tracked.table, tracked.recording.plots.sensor
    refused = table.track_of_plot < 0
    used = np.zeros(len(radar), dtype=bool)
    used[table.plot[table.plot >= 0]] = True
    rows = []
    for k, one in enumerate(tracked.sites.radars):
        own, seen = radar == k, (table.sensor == k) & table.confirmed
        updates, missed = (int(np.sum(seen & there)) for there in (table.plot >= 0, table.plot < 0))
        expected = updates + missed
        rows.append(
            (
                str(one.name),
                *(int(np.sum(own & x)) for x in (own, used, ~used & ~refused, refused)),
                missed,
                updates / expected if expected else None,
            )
        )
    names = ["radar", "plots", "in tracks", "in none", "refused", "missed scans"]
    kinds = [pl.String, *[pl.Int64] * 5]
    schema: dict[str, Any] = dict(zip(names, kinds, strict=True))
    return pl.DataFrame(rows, schema | {"probability of update": pl.Float64}, orient="row")


def figures(tracked: Tracked) -> dict[str, Any]:
    """Return what is told of the whole."""
    table, plots = tracked.table, tracked.recording.plots
    followed = table.plan >= 0
    left = followed & ~table.conforms
    time = plots.time[np.isfinite(plots.time)]
    return {
        "plots": len(plots),
        "plots_in_tracks": int(np.sum(table.plot >= 0)),
        "plots_refused": tracked.refused(),
        "duration_s": float(np.ptp(time)),
        "tracks": len(np.unique(table.track)),
        "rows": len(table),
        "missed_scans": int(np.sum(table.plot < 0)),
        "turning": float(np.mean(table.turn_probability > 0.5)) if len(table) else 0.0,
        "plans": len(tracked.plans),
        "tracks_with_plan": len(np.unique(table.track[followed])),
        "tracks_that_left_their_plan": len(np.unique(table.track[left])),
        "tracking_s": tracked.seconds,
    }


def summary(tracked: Tracked, radars: pl.DataFrame) -> dict[str, Any]:
    """Return what is told of the whole and of each radar."""
    return figures(tracked) | {"radars": radars.to_dicts()}


def one_row_per_track(rows: pl.DataFrame, identity: str) -> pl.DataFrame:
    """Return what is told of each track, from the rows of all."""
    hit = pl.col("plot").is_not_null()
    sure = pl.col("confirmed")
    return (
        rows.sort("track", "time_s", maintain_order=True)
        .group_by("track", maintain_order=True)
        .agg(
            pl.col("time_s").first().alias("first_time_s"),
            pl.col("time_s").last().alias("last_time_s"),
            hit.sum().cast(pl.Int64).alias("plots"),
            (~hit).sum().cast(pl.Int64).alias("missed"),
            (hit & sure).sum().truediv(sure.sum()).alias("probability_of_update"),
            pl.col(identity).drop_nulls().last(),
            pl.col("plan").drop_nulls().last(),
            pl.col("conforms").mean(),
            pl.col("turn_probability").mean(),
            pl.col("speed_m_s").mean(),
            pl.col("height_m").mean(),
        )
    )


def lines(tracked: Tracked) -> list[_maps.Feature | None]:
    """Return the tracks as lines on a map."""
    rows = tracked.rows()
    told = one_row_per_track(rows, tracked.recording.identities.name)
    groups = rows.partition_by("track", as_dict=True)
    return [
        _maps.feature(groups[(row["track"],)], "time_s", f"track {row['track']}", row)
        for row in told.iter_rows(named=True)
    ]


def draw(tracked: Tracked, path: Path) -> None:
    """Draw the tracks from above."""
    from matplotlib.figure import Figure  # noqa: PLC0415  # slow to import

    figure = Figure(figsize=_FIGURE_SIZE, layout="constrained")
    plot.tracks(
        tracked.table,
        tracked.sites.radars,
        plots=tracked.recording.plots[tracked.table.track_of_plot >= 0],
        plans=tracked.plans,
        ax=figure.subplots(),
    )
    _tables.save(figure, path)
