"""A folder with what is told of tracks: a summary, tables, pictures."""

from pathlib import Path

import polars as pl

from tertia import plot
from tertia.cli import _tables
from tertia.cli._tracked import Tracked, draw, one_row_per_track, summary

SUMMARY = "summary.json"
TABLES = ("radars.csv", "tracks.csv")
PICTURES = ("tracks.png", "update_probability.png")


def write_report(tracked: Tracked, radars: pl.DataFrame, folder: Path) -> None:
    """Write all of it; files that are there are replaced."""
    _tables.make_folder(folder)
    _tables.write_json(summary(tracked, radars), folder / SUMMARY)
    tracks = one_row_per_track(tracked.rows(), tracked.recording.identities.name)
    for table, name in zip((radars, tracks), TABLES, strict=True):
        _tables.write(table, folder / name)
    draw(tracked, folder / PICTURES[0])
    _draw_updates(tracked, folder / PICTURES[1])


def _draw_updates(tracked: Tracked, path: Path) -> None:
    from matplotlib.figure import Figure  # noqa: PLC0415  # slow to import

    figure = Figure(figsize=(8.0, 4.5), layout="constrained")
    plot.update_probability(tracked.table, tracked.sites.radars, ax=figure.subplots())
    _tables.save(figure, path)
