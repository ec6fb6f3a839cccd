"""ASTERIX recordings as input of the commands."""

from pathlib import Path

import polars as pl

from tertia._result import counted
from tertia.cli.terminal.say import fail, reading
from tertia.io import AsterixRecording, read_asterix
from tertia.tables._doubts import doubt
from tertia.tables._parts import Part
from tertia.tables._sensors import GEODETIC

# names of files that are ASTERIX recordings, not tables
SUFFIXES = (".ast", ".asterix", ".raw", ".pcap", ".pcapng")
# a plot may have several of these
IDENTITIES = ("icao_address", "mode_3a", "callsign")
_ESTIMATED = ("east_m", "north_m", "east_sigma_m", "north_sigma_m", "covariance_east_north_m2")


def _read(path: Path) -> AsterixRecording:
    try:
        with reading(path):
            return read_asterix(path)
    except (ImportError, ValueError) as error:
        fail(str(error))


def _doubt_rest(path: Path, found: AsterixRecording) -> None:
    """Print which parts of a recording are not read."""
    if found.skipped:
        doubt(f"{path}: not supported and left out: {found.skipped_text()}")
    if found.damaged:
        lost = (
            f", and {counted(found.lost_bytes, 'byte')} outside data blocks"
            if found.lost_bytes
            else ""
        )
        doubt(
            f"{path}: {counted(found.damaged, 'damaged data block')} partly left out{lost}; the "
            f"first damage: {found.first_damage}"
        )


def _doubt_radars(path: Path, messages: pl.DataFrame) -> None:
    """Print which radars report that their plots should not be used."""
    for what, wrong in (
        ("its time source is invalid", ~pl.col("time_valid")),
        ("it is not released for operational use", pl.col("state") == "inhibited"),
    ):
        for radar in messages.filter(wrong)["sensor"].unique(maintain_order=True):
            doubt(f"{path}: radar {radar} reported at times that {what}")


def measured(found: AsterixRecording) -> pl.DataFrame:
    """Return the plots of targets that a radar has measured."""
    left_out = pl.col("simulated") | pl.col("field_monitor") | (pl.col("detection") == "none")
    return found.plots.filter(~left_out.fill_null(False))


def plots(path: Path) -> Part:
    """Return the measured plots of a recording, and its information about radars."""
    found = _read(path)
    seen = measured(found)
    if seen.is_empty():
        fail(f"{path} has no plots of targets (categories 48, 1); it has {_contents(found)}")
    _doubt_rest(path, found)
    for count, noun, why in (
        (found.repeated, "plot", "duplicates"),
        (
            found.plots.height - seen.height,
            "plot",
            "simulated, of a field monitor, or without a detection",
        ),
        (found.other_packets, "packet", "no ASTERIX"),
    ):
        if count:
            doubt(f"{path}: {counted(count, noun)} left out: {why}")
    own = pl.col("sensor").is_in(seen["sensor"].unique().implode())
    _doubt_radars(path, found.messages.filter(own))
    if found.truncated_times:
        doubt(f"{path}: times restart every 512 s, because no service message has a full time")
    # columns of identities without values are dropped
    empty = [name for name in IDENTITIES if seen[name].null_count() == seen.height]
    said = {
        row["sensor"]: {name: value for name, value in row.items() if value is not None}
        for row in found.sensors.drop("plot_count").iter_rows(named=True)
    }
    return Part(seen.drop(empty), str(path), path.stem, sensors=said)


def tracks(path: Path) -> Part:
    """Return the system tracks of a recording, with their estimated accuracies."""
    recording = _read(path)
    found = recording.positions if recording.tracks.is_empty() else recording.tracks
    if found.is_empty():
        fail(f"{path} has no system tracks (category 62) nor positions (10, 20)")
    _doubt_rest(path, recording)
    columns = [
        one
        for one in ("time_s", "target", *_ESTIMATED, *GEODETIC, *IDENTITIES)
        if found[one].null_count() < found.height
    ]
    if "east_sigma_m" not in columns:
        fail(f"{path} has no accuracies (I062/500, I010/500, I020/500)")
    rows = found.select(columns).drop_nulls(["time_s", "target", "east_sigma_m", "north_sigma_m"])
    return Part(rows, str(path), path.stem)


def truth(path: Path) -> Part:
    """Return the positions of targets from ADS-B reports or, if there are none, system tracks."""
    found = _read(path)
    tables = (found.reports, found.tracks, found.positions)
    rows = next((one for one in tables if not one.is_empty()), None)
    if rows is None:
        fail(
            f"{path} has neither ADS-B reports (category 21) nor system tracks (62) nor positions "
            "(10, 20)"
        )
    _doubt_rest(path, found)
    rows = rows.drop_nulls(["time_s", "target", *GEODETIC[:2]])
    if rows.is_empty():
        fail(f"{path} has no latitudes and longitudes of targets")
    places = rows.select("time_s", "target", *GEODETIC).unique(
        ["time_s", "target"], keep="first", maintain_order=True
    )
    return Part(places, str(path), path.stem)


def _contents(found: AsterixRecording) -> str:
    counts = (
        (found.plots.height, "plot", "simulated or fixed"),
        (found.tracks.height, "system track", "62"),
        (found.reports.height, "ADS-B report", "21"),
        (found.positions.height, "position", "10, 20"),
        (found.messages.height, "message", "63, 65 and others"),
    )
    listed = [f"{counted(count, noun)} ({of})" for count, noun, of in counts if count]
    return ", ".join(filter(None, [*listed, found.skipped_text()])) or "nothing else"
