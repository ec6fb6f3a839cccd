"""Recordings of radars in ASTERIX: plots, service and status messages, system tracks, ADS-B."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from tertia.io._categories import TITLES
from tertia.io._framing import frames
from tertia.io._packets import MAGIC, udp_payloads

if TYPE_CHECKING:
    import polars as pl

    from tertia.io._asterix_reader import Reader


@dataclass(frozen=True, slots=True, eq=False)
class AsterixRecording:
    """Contents of an ASTERIX recording, as tables of Polars; missing items are null.

    Attributes
    ----------
    plots : DataFrame
        Target reports of radars (categories 48 and 1): `time_s`, `sensor`, `range_nm`,
        `azimuth_deg`, `flight_level`, `icao_address`, `mode_3a`, `callsign`, `detection`,
        `simulated`, `field_monitor`, `track_number`, `speed_m_s`, `course_deg`.
    sensors : DataFrame
        One row per radar that sent plots or service messages (categories 34, 2): `sensor`,
        `latitude_deg`, `longitude_deg`, `height_m`, `scan_period_s`, `plots`.
    tracks : DataFrame
        System tracks (category 62): `time_s`, `sensor`, `target`, `latitude_deg`, `longitude_deg`,
        `height_m`, `flight_level`, `east_m`, `north_m`, `east_sigma_m`, `north_sigma_m` and
        `covariance_east_north_m2` (I062/500), `speed_m_s`, `course_deg`, `icao_address`,
        `mode_3a`, `callsign`, `velocity_east_m_s`, `velocity_north_m_s` and their sigmas,
        `vertical_rate_m_s`, `confirmed`, `coasted` (without a plot), and the codes of I062/200:
        `transversal`, `longitudinal`, `vertical`.
    reports : DataFrame
        ADS-B reports (category 21): `time_s`, `sensor`, `target`, `latitude_deg`,
        `longitude_deg`, `height_m`, `flight_level`, `speed_m_s`, `course_deg`, `icao_address`,
        `callsign`.
    positions : DataFrame
        Target reports of surface movement and multilateration systems (categories 10 and 20), with
        the first columns of `tracks`, up to `callsign`; `target` is the track number.
    messages : DataFrame
        Messages in which sensors report their own state (categories 2, 19, 34), and in which a
        tracker reports the state of its sensors (63) and its own state (65). The columns are:
        `time_s`; `sensor`, the sensor that the row describes; `source`, the sender of the message;
        `service` (I063/015); `state` (`operational`, `degraded`, `initialising`, `not connected`,
        `inhibited`, `unknown`), `failed` (of `psr`, `ssr`, `mode-s`, `ads-b`, `multilateration`,
        with `+` between them), `overload`, `time_valid`, `plots_missing`, `service_report` (the
        code of I065/050); `time_bias_s`, `range_gain`, `range_bias_m`, `azimuth_bias_deg` (Mode S
        or SSR), `psr_range_gain`, `psr_range_bias_m`, `psr_azimuth_bias_deg`,
        `psr_elevation_bias_deg`; `collimation_range_m` and `collimation_azimuth_deg`, the
        differences between primary and secondary plots. A message without any of these items has no
        row.
    skipped : dict of int to int
        Number of data blocks of categories that are not read, by category.
    damaged : int
        Number of data blocks that are cut off or contain a record that cannot be decoded, plus the
        number of places at which no data block begins. A damaged record and the rest of its block
        are left out.
    lost_bytes : int
        Number of bytes of a file that belong to no data block, for example after a damaged length.
        They are skipped up to the next block that can be decoded.
    first_damage : str
        Place and description of the first damage; empty if there is none.
    editions : dict of int to str
        Edition by which each category was decoded.
    truncated_times : bool
        True if no record has a full time of day; the times then restart from 0 every 512 s
        (I001/141).
    repeated : int
        Number of duplicate plots that were removed, for example from two network lines.
    other_packets : int
        Number of UDP packets of a network recording that do not contain ASTERIX.
    """

    plots: pl.DataFrame
    sensors: pl.DataFrame
    tracks: pl.DataFrame
    reports: pl.DataFrame
    positions: pl.DataFrame
    messages: pl.DataFrame
    skipped: dict[int, int]
    damaged: int
    lost_bytes: int
    first_damage: str
    editions: dict[int, str]
    truncated_times: bool
    repeated: int
    other_packets: int

    def skipped_text(self) -> str:
        """Return the categories that were not read, as text."""
        return ", ".join(
            f"{count} {'block' if count == 1 else 'blocks'} of category {number} "
            f"({TITLES.get(number, 'unknown')})"
            for number, count in self.skipped.items()
        )

    def __repr__(self) -> str:
        """Return the numbers of rows."""
        parts = {
            "plots": self.plots,
            "sensors": self.sensors,
            "tracks": self.tracks,
            "reports": self.reports,
            "positions": self.positions,
            "messages": self.messages,
        }
        listed = ", ".join(f"{table.height} {name}" for name, table in parts.items())
        return f"AsterixRecording({listed})"


def read_asterix(path: str | Path | Sequence[bytes]) -> AsterixRecording:
    """Read an ASTERIX recording.

    Parameters
    ----------
    path : str, Path, or sequence of bytes
        A file of consecutive data blocks; a network recording of UDP packets that contain data
        blocks (pcap, pcapng); or a file of data blocks in frames (IOSS final format, RFF). The type
        is recognised from the first bytes. The payloads of UDP packets may be given instead of a
        path.

    Returns
    -------
    AsterixRecording
        The contents of the recording.

    Raises
    ------
    ValueError
        If a file is not ASTERIX, or none of its records can be decoded; the error message states
        the number of the byte.
    ImportError
        If a library is not installed.
    OSError
        If the file cannot be read.

    Notes
    -----
    Radars are named by their codes, SAC/SIC. Times are seconds of the day (UTC), and continue
    beyond 86400 if a recording passes midnight. Mode 3/A codes and flight levels that are garbled
    or not validated are null. Times of category 1 restart from 0 every 512 s; they are completed
    with the full times of the service messages (category 2) of the same radar. Duplicates, for
    example from two network lines, are removed. Range gains and biases in tracker messages
    (I063/080) have the sign of `tertia.sensors.Bias`; for other messages the specification does not
    define the sign.

    Each category is decoded with the edition that decodes most of its first twenty data blocks; if
    several editions decode the same number of them, the newest is used.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from tertia.io import read_asterix
    >>> block = bytes.fromhex("30 0010 f8 1702 4251e5 a0 4000 2000 04d2")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "plots.ast")
    ...     _ = path.write_bytes(block)
    ...     recording = read_asterix(path)
    >>> recording
    AsterixRecording(1 plots, 1 sensors, 0 tracks, 0 reports, 0 positions, 0 messages)
    >>> recording.plots.select("sensor", "range_nm", "azimuth_deg", "mode_3a").row(0)
    ('23/2', 64.0, 45.0, '2322')
    """
    try:
        from tertia.io._asterix_reader import Reader  # noqa: PLC0415  # only here Polars is needed
    except ImportError as error:
        raise ImportError("ASTERIX needs Polars: pip install 'tertia[asterix]'") from error
    if not isinstance(path, (str, Path)):
        return _of_packets(Reader(Path("the data")), enumerate(path, start=1))
    path = Path(path)
    contents = path.read_bytes()
    if not contents:
        raise ValueError(f"{path} is empty")
    reader = Reader(path)
    framed = frames(contents)
    if contents[:4] in MAGIC:
        return _of_packets(reader, _payloads(reader, contents))
    if framed is not None:
        for number, payload in framed:
            reader.take_frame(payload, number)
    else:
        reader.take(contents)
    return AsterixRecording(**reader.recording())


def write_asterix(
    tracks: pl.DataFrame, path: str | Path, *, source: tuple[int, int] = (0, 0)
) -> None:
    """Write system tracks in ASTERIX, category 62.

    Parameters
    ----------
    tracks : DataFrame of Polars
        Rows of `tables.track`, or of `read_asterix(...).tracks`: `time_s` and `track` (or
        `target`), and any of `latitude_deg` and `longitude_deg`, `east_m` and `north_m`,
        `velocity_east_m_s` and `velocity_north_m_s` (or `speed_m_s` and `course_deg`), `height_m`,
        `flight_level`, `vertical_rate_m_s`, `icao_address`, `mode_3a`, `callsign`, `confirmed`,
        `coasted` (or `plot`, which is null for coasted rows); `east_sigma_m`, `north_sigma_m`,
        `covariance_east_north_m2` and the sigmas of the velocities (I062/500); `transversal`,
        `longitudinal`, `vertical`, the codes of I062/200. Missing items are null.
    path : str or Path
        The file. It consists of data blocks of at most 16 records, in the order of the rows.
    source : tuple of two int
        Codes of this system, SAC and SIC.

    Returns
    -------
    None
        The file is written.

    Raises
    ------
    ValueError
        If a column is missing, or a value is outside the range of an item.
    ImportError
        If Polars is not installed.
    OSError
        If the file cannot be written.

    Notes
    -----
    Values are rounded to the steps of the items: 1/128 s, 5.4e-6 degrees, 0.5 m, 0.25 m/s, 6.25 ft,
    a quarter of a flight level. Sigmas above the largest value that an item can hold are left out.
    `height_m` is the geometric altitude (I062/130). Track numbers have 16 bits, and restart after
    65535.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import polars as pl
    >>> from tertia.io import read_asterix, write_asterix
    >>> tracks = pl.DataFrame({"time_s": 10.0, "track": 7, "east_m": 250.0, "north_m": -1e4})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "tracks.ast")
    ...     write_asterix(tracks, path, source=(25, 100))
    ...     found = read_asterix(path).tracks
    >>> found.select("time_s", "sensor", "target", "east_m", "north_m").row(0)
    (10.0, '25/100', '7', 250.0, -10000.0)
    """
    try:
        from tertia.io._asterix_writer import asterix_tracks  # noqa: PLC0415  # as above
    except ImportError as error:
        raise ImportError("ASTERIX needs Polars: pip install 'tertia[asterix]'") from error
    Path(path).write_bytes(asterix_tracks(tracks, source))


def _payloads(reader: Reader, contents: bytes) -> Iterable[tuple[int, bytes]]:
    try:
        import_module("dpkt")
    except ImportError as error:
        raise ImportError("network recordings need dpkt: pip install 'tertia[asterix]'") from error
    return udp_payloads(reader.path, contents)


def _of_packets(reader: Reader, payloads: Iterable[tuple[int, bytes]]) -> AsterixRecording:
    for number, payload in payloads:
        reader.take_packet(payload, number)
    if not reader.blocks:
        raise ValueError(f"{reader.path} has no packet that contains ASTERIX")
    return AsterixRecording(**reader.recording())
