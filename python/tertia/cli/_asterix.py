"""Recordings in ASTERIX, as the commands take them."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

import polars as pl

from tertia.cli._places import GEODETIC
from tertia.cli._terminal import WRONG_USAGE, counted, fail
from tertia.io import AsterixRecording, read_asterix

# what a recording tells of each radar, by column
Told: TypeAlias = Mapping[str, Mapping[str, Any]]

_IDENTITIES = ("icao_address", "mode_3a")


def read(path: Path) -> AsterixRecording:
    """Return what a recording holds, or fail."""
    try:
        return read_asterix(path)
    except FileNotFoundError:
        fail(f"there is no file {path}", WRONG_USAGE)
    except OSError as error:
        fail(f"cannot read {path}: {error.strerror or error}")
    except (ImportError, ValueError) as error:
        fail(str(error))


def plots_and_radars(path: Path) -> tuple[pl.DataFrame, Told, list[str]]:
    """Return the plots of a recording that were measured, and what it tells of its radars.

    The third is what there is to say of the recording.
    """
    found = read(path)
    left_out = pl.col("simulated") | pl.col("field_monitor") | (pl.col("detection") == "none")
    plots = found.plots.filter(~left_out.fill_null(False))
    if plots.is_empty():
        fail(f"{path} has no plots (category 48) of targets, but {_told_contents(found)}")
    dropped = found.plots.height - plots.height
    remarks = [
        f"{path}: {counted(count, noun)} left out: {why}"
        for count, noun, why in (
            (found.repeated, "plot", "the same as one before"),
            (dropped, "plot", "simulated, of a field monitor, or without a detection"),
            (found.other_packets, "packet", "no ASTERIX"),
        )
        if count
    ]
    # an identity that nobody tells is none
    empty = [name for name in _IDENTITIES if plots[name].null_count() == plots.height]
    rows = found.radars.drop("plots").iter_rows(named=True)
    told = {row["radar"]: {k: v for k, v in row.items() if v is not None} for row in rows}
    return plots.drop(empty), told, remarks


def _told_contents(found: AsterixRecording) -> str:
    counts = {
        "simulated or fixed": found.plots.height,
        "system tracks (62)": found.tracks.height,
        "ADS-B reports (21)": found.reports.height,
        **{f"blocks of category {number}": count for number, count in found.skipped.items()},
    }
    return ", ".join(f"{count} {name}" for name, count in counts.items() if count) or "nothing else"


def truth(path: Path) -> pl.DataFrame:
    """Return where targets were, by their ADS-B reports or else by system tracks."""
    found = read(path)
    rows = found.tracks if found.reports.is_empty() else found.reports
    if rows.is_empty():
        fail(f"{path} has neither ADS-B reports (category 21) nor system tracks (62)")
    rows = rows.drop_nulls(["time_s", "target", *GEODETIC[:2]])
    if rows.is_empty():
        fail(f"{path} tells no latitudes and longitudes of targets")
    return rows.select("time_s", "target", *GEODETIC).unique(
        ["time_s", "target"], keep="first", maintain_order=True
    )
