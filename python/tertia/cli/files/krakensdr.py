"""Recordings of KrakenSDR direction finders, in the format of their app."""

from pathlib import Path

import numpy as np
import polars as pl

from tertia._arrays import FloatArray
from tertia.cli.terminal.say import fail, reading
from tertia.tables._doubts import doubt
from tertia.tables._parts import Part

# columns before the spectrum; the files have no header
_COLUMNS = (
    "time",
    "angle",
    "confidence",
    "power",
    "frequency",
    "array",
    "latency",
    "sensor",
    "latitude_deg",
    "longitude_deg",
    "gps_heading",
    "compass_heading",
    "heading",
)
_NUMBERS = ("angle", "latitude_deg", "longitude_deg", "gps_heading", "compass_heading")
_PLACE = ("latitude_deg", "longitude_deg")
_RESERVED = 4
_SPECTRUM = 360
# largest difference in degrees between an angle and the maximum of its spectrum, and least share of
# rows that must agree
_NEAR, _AGREE = 2.0, 0.9
# largest variation in degrees of the position of a fixed station, due to noise of its GPS receiver
_STANDS = 1e-3


def recording(path: Path) -> Part:
    """Return the bearings of a recording, and the positions of its stations."""
    try:
        with reading(path):
            cells = pl.read_csv(path, has_header=False, infer_schema=False, glob=False)
    except pl.exceptions.PolarsError as error:
        fail(f"cannot read {path}: {str(error).splitlines()[0]}")
    first = len(_COLUMNS) + _RESERVED
    if cells.width not in {first, first + _SPECTRUM}:
        fail(
            f"{path} is not a recording of KrakenSDR: it has {cells.width} columns; these have "
            f"{first}, or {first + _SPECTRUM} with spectra (format 'Kraken App')"
        )
    cells = cells.select(pl.all().str.strip_chars())
    rows = cells[:, : len(_COLUMNS)].rename(dict(zip(cells.columns, _COLUMNS, strict=False)))
    try:
        rows = rows.with_columns(
            pl.col("time").cast(pl.Int64), *(pl.col(name).cast(pl.Float64) for name in _NUMBERS)
        )
        spectra = cells[:, first:].cast(pl.Float64).to_numpy() if cells.width > first else None
    except pl.exceptions.PolarsError as error:
        fail(f"{path}: a cell is not a number: {str(error).splitlines()[0]}")
    relative = rows["angle"].to_numpy()
    if spectra is None:
        doubt(f"{path} has no spectra; its angles are assumed to be clockwise from the heading")
    elif not _is_compass(path, relative, spectra):
        relative = -relative
    heading = pl.when(pl.col("heading") == "Compass").then("compass_heading")
    table = rows.select(
        pl.from_epoch("time", time_unit="ms").dt.replace_time_zone("UTC").alias("time_s"),
        "sensor",
        ((heading.otherwise("gps_heading") + pl.Series(relative)) % 360.0).alias("azimuth_deg"),
        *(pl.when(_moves()).then(pl.col(name)).alias(f"sensor_{name}") for name in _PLACE),
    )
    if not table["sensor_latitude_deg"].count():
        table = table.drop("sensor_latitude_deg", "sensor_longitude_deg")
    return Part(table, str(path), path.stem, 1, sensors=_places(rows))


def _is_compass(path: Path, angle: FloatArray, spectra: FloatArray) -> bool:
    """Return whether angles are clockwise, by comparison with the spectra (anticlockwise)."""
    maximum = np.argmax(spectra, axis=1)
    telling = np.abs(np.sin(np.radians(maximum))) > np.sin(np.radians(2 * _NEAR))
    circle, compass = (
        np.mean(np.abs((angle - one + 180.0) % 360.0 - 180.0)[telling] <= _NEAR)
        if telling.any()
        else 0.0
        for one in (maximum, -maximum)
    )
    if max(circle, compass) < _AGREE:
        fail(
            f"{path}: it is unclear whether its angles are clockwise: {circle:.0%} of them agree "
            f"with the maxima of the spectra, {compass:.0%} with their mirror images"
        )
    said = "clockwise from the heading" if compass > circle else "anticlockwise (unit circle)"
    doubt(f"{path}: according to the spectra, its angles are {said}")
    return bool(compass > circle)


def _moves() -> pl.Expr:
    """Return whether the station of each row moves."""
    spread = [(pl.col(name).max() - pl.col(name).min()).over("sensor") for name in _PLACE]
    return pl.max_horizontal(spread) > _STANDS


def _places(rows: pl.DataFrame) -> dict[str, dict[str, float]]:
    """Return the positions of the stations; for moving stations, the middle of their positions."""
    found = rows.group_by("sensor").agg(pl.col(_PLACE).median())
    return {row.pop("sensor"): row for row in found.to_dicts()}
