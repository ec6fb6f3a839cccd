"""Make stations.toml and measurements.csv: three simulated stations that follow a target.

Nothing here was measured. The simulation is `tertia.simulate.stations` with a fixed seed, so the
files can be made again. Every second each station measures range, azimuth and elevation; about
every twentieth measurement is missing. The target climbs in a turn. The truth per station:

north   as it says: 10 m and 0.3 degrees
east    its range is 120 m too long from 30 to 36 s, as if an echo was followed
south   its azimuths are 1 degree too large, because it is not well aligned

Nobody measures from 50 to 51 s.
"""

import csv
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tertia.location import Station
from tertia.simulate import stations

FloatArray = npt.NDArray[np.float64]

SEED = 12
INSTANTS = 90
PLACES_M = {"north": (200.0, 3100.0, 35.0), "east": (3000.0, 900.0, 12.0), "south": (0.0, 0.0, 5.0)}
RANGE_SIGMA_M, ANGLE_SIGMA_DEG = 10.0, 0.3
MISSING_PROBABILITY = 0.05
ECHO_S, ECHO_M = (30, 36), 120.0
MISALIGNED_DEG = 1.0
SILENCE_S = (50, 51)


def times() -> FloatArray:
    """Return the times of the instants in seconds."""
    return np.arange(INSTANTS, dtype=np.float64)


def truth() -> FloatArray:
    """Return the positions of the target in metres: 25 m/s, a turn of 0.02 rad/s, climbing."""
    time = times()
    heading = 0.4 + 0.02 * time
    return np.column_stack(
        [
            1900.0 - 1250.0 * np.cos(heading),
            1000.0 + 1250.0 * np.sin(heading),
            300.0 + 2.0 * time,
        ]
    )


def sites() -> list[Station]:
    """Return the stations."""
    angle = np.radians(ANGLE_SIGMA_DEG)
    return [
        Station(
            place, range_sigma=RANGE_SIGMA_M, azimuth_sigma=angle, elevation_sigma=angle, name=name
        )
        for name, place in PLACES_M.items()
    ]


def measurements() -> dict[str, FloatArray]:
    """Simulate ranges, azimuths and elevations, (instants, stations), in metres and degrees."""
    time, names = times(), list(PLACES_M)
    record = stations(
        sites(), truth(), missing_probability=MISSING_PROBABILITY, rng=SEED
    ).measurements
    found = {
        "range_m": record["range"].copy(),
        "azimuth_deg": np.degrees(record["azimuth"]),
        "elevation_deg": np.degrees(record["elevation"]),
    }
    echo = (time >= ECHO_S[0]) & (time <= ECHO_S[1])
    found["range_m"][echo, names.index("east")] += ECHO_M
    found["azimuth_deg"][:, names.index("south")] += MISALIGNED_DEG
    found["azimuth_deg"] %= 360.0
    silence = (time >= SILENCE_S[0]) & (time <= SILENCE_S[1])
    for values in found.values():
        values[silence] = np.nan
    return found


def rows() -> Iterator[tuple[str, ...]]:
    """Yield time, station, range, azimuth and elevation; empty where one is missing."""
    found = measurements()
    decimals = {"range_m": 1, "azimuth_deg": 3, "elevation_deg": 3}
    for step, time in enumerate(times()):
        for k, name in enumerate(PLACES_M):
            values = [(found[kind][step, k], digits) for kind, digits in decimals.items()]
            cells = ["" if np.isnan(value) else f"{value:.{digits}f}" for value, digits in values]
            yield (f"{time:.0f}", name, *cells)


def toml() -> str:
    """Return the file of the stations."""
    parts = ["# positions in a local frame; standard deviations of single measurements"]
    for name, (east, north, up) in PLACES_M.items():
        parts.append(
            f'\n[[station]]\nname = "{name}"\n'
            f"east_m = {east}\nnorth_m = {north}\nup_m = {up}\n"
            f"range_sigma_m = {RANGE_SIGMA_M}\n"
            f"azimuth_sigma_deg = {ANGLE_SIGMA_DEG}\n"
            f"elevation_sigma_deg = {ANGLE_SIGMA_DEG}"
        )
    return "\n".join(parts) + "\n"


if __name__ == "__main__":
    here = Path(__file__)
    here.with_name("stations.toml").write_text(toml(), encoding="utf-8")
    with here.with_name("measurements.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["time_s", "sensor", "range_m", "azimuth_deg", "elevation_deg"])
        writer.writerows(rows())
