"""What registration finds on recordings, which do not belong to the project."""

from __future__ import annotations

import csv
import gzip
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from studies.pages import DATA, markdown, table_of
from tertia._arrays import FloatArray, IntArray
from tertia.io import read_asterix
from tertia.registration import Registration, register
from tertia.sensors import Radar
from tertia.tracker import Plots, track

LEBL = DATA / "lebl_radar" / "plots_0800_0830.csv.gz"
JAHORINA = DATA / "asterix" / "Jahorina.raw"
NAUTICAL_MILE, FLIGHT_LEVEL = 1852.0, 30.48
NOISE = {"range_sigma": 60.0, "azimuth_sigma": np.radians(0.07).item()}
# an aircraft has so many plots at least; seconds of the recording of half an hour
FEWEST, DURATION = 10, 900.0
# what is added to every second scan, as if it were of another radar: degrees, metres
ADDED = ((0.0, 0.0), (0.1, 0.0), (0.3, 0.0), (0.3, 200.0), (0.5, 200.0), (1.0, 500.0))
UNITS = {"range": (1.0, "m"), "azimuth": (180 / np.pi, "°")}


@dataclass(frozen=True)
class Recording:
    """Plots of one radar, and the address of each."""

    time: FloatArray
    range: FloatArray
    azimuth: FloatArray
    height: FloatArray
    address: IntArray

    def plots(self, sensor: IntArray | int = 0) -> Plots:
        """Return them without their addresses."""
        return Plots(
            self.time,
            self.range,
            self.azimuth,
            sensor=np.broadcast_to(sensor, self.time.shape),
            height=self.height,
        )


def lebl() -> Recording:
    """Return plots of the radar of Barcelona."""
    with gzip.open(LEBL, "rt") as file:
        rows = [row for row in csv.DictReader(file) if row["rho_nm"] and row["theta_deg"]]
    time, distance, azimuth, level = (
        np.array([float(row[name] or "nan") for row in rows])
        for name in ("tod_s", "rho_nm", "theta_deg", "fl")
    )
    address = np.array([int(row["icao24"] or "-1", 16) for row in rows])
    early = time < np.min(time) + DURATION
    columns = (
        time,
        NAUTICAL_MILE * distance,
        np.radians(azimuth),
        100 * 0.3048 * level,
        address,
    )
    return Recording(*(one[early] for one in columns))


def jahorina() -> Recording:
    """Return plots of the radar 23/2."""
    plots = read_asterix(JAHORINA).plots
    address = [-1 if one is None else int(one, 16) for one in plots["icao_address"]]
    return Recording(
        plots["time_s"].to_numpy(),
        NAUTICAL_MILE * plots["range_nm"].to_numpy(),
        np.radians(plots["azimuth_deg"].to_numpy()),
        FLIGHT_LEVEL * plots["flight_level"].fill_null(np.nan).to_numpy(),
        np.array(address),
    )


def table() -> str:
    """Tabulate the errors; without the recordings, the table is that of the page."""
    if not (LEBL.is_file() and JAHORINA.is_file()):
        return table_of("registration.md", "recordings")
    rows = []
    for name, record, period in (("lebl", lebl(), 4.0), ("Jahorina", jahorina(), 5.0078125)):
        rows.append(_alone(name, record, Radar(scan_period=period, **NOISE)))
    rows += _divided(lebl())
    head = ["recording", "added to every second scan", "azimuth found", "range found", "observable"]
    head += ["aircraft", "tracks, not registered", "tracks, registered while tracking"]
    return markdown(head, rows)


def _alone(name: str, record: Recording, radar: Radar) -> list[str]:
    """Return that one radar says nothing of its errors."""
    plots = record.plots()
    found = register(plots, [radar])
    cells = [_told(found, kind, 0) for kind in ("azimuth", "range")]
    return [name, "one radar", *cells, _observable(found), *_counts(record, plots, [radar])]


def _divided(record: Recording) -> Iterable[list[str]]:
    """Yield a radar whose every second scan counts as that of another one at its place."""
    radars = [Radar(scan_period=8.0, name=name, **NOISE) for name in ("even", "odd")]
    # scans begin where the beam points north
    scan = np.round((record.time - np.min(record.time)) / 4.0 - record.azimuth / (2 * np.pi))
    sensor = (scan % 2).astype(np.int64)
    for degrees, metres in ADDED:
        moved = replace(
            record,
            azimuth=(record.azimuth + np.radians(degrees) * sensor) % (2 * np.pi),
            range=record.range + metres * sensor,
        )
        plots = moved.plots(sensor)
        found = register(plots, radars)
        cells = [_told(found, kind, 1) for kind in ("azimuth", "range")]
        yield [
            "lebl",
            f"{degrees}°, {metres:g} m",
            *cells,
            _observable(found),
            *_counts(moved, plots, radars),
        ]


def _told(found: Registration, kind: str, k: int) -> str:
    """Return an error of a radar less that of the first, with its standard deviation."""
    scale, unit = UNITS[kind]
    value = np.asarray(getattr(found.bias, kind))
    at = {"range": 0, "azimuth": 2}[kind]
    weight = np.zeros(len(found.covariance))
    weight[4 * k + at] = 1.0
    if k:
        weight[at] = -1.0
    off = value[k] - (value[0] if k else 0.0)
    sigma = np.sqrt(weight @ found.covariance @ weight)
    digits = 4 if unit == "°" else 1
    return f"{scale * off:.{digits}f} ± {scale * sigma:.{digits}f} {unit}"


def _observable(found: Registration) -> str:
    names = [kind for kind, seen in found.observable.items() if np.any(seen)]
    return ", ".join(names) or "none"


def _counts(record: Recording, plots: Plots, radars: list[Radar]) -> list[str]:
    """Return aircraft and tracks of so many plots, as they are and with the errors taken out."""
    known = record.address[record.address >= 0]
    aircraft = np.unique(known, return_counts=True)[1]
    cells = [str(np.count_nonzero(aircraft >= FEWEST))]
    for registers in (False, len(radars) > 1):
        tracks = track(plots, radars, registration=registers)
        seen = tracks.confirmed & (tracks.plot >= 0)
        plots_of = np.unique(tracks.track[seen], return_counts=True)[1]
        cells.append(str(np.count_nonzero(plots_of >= FEWEST)))
    return cells
