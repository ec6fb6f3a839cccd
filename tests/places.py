"""Where things are, wherever the tests run."""

import csv
import os
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"
DATA = Path(os.environ.get("TERTIA_DATA", ROOT.parent / "shared" / "data"))

needs_data = pytest.mark.skipif(
    not DATA.is_dir(), reason=f"no recordings in {DATA}, which TERTIA_DATA names"
)


def difar():
    """Times, positions of the direction finders, (N, 4, 2), azimuths and the boat."""
    with (DATA / "difar" / "bearings.csv").open() as file:
        rows = list(csv.DictReader(file))
    calls = {key: i for i, key in enumerate(dict.fromkeys(row["call_id"] for row in rows))}
    n, buoys = len(calls), ["NW", "NE", "SW", "SE"]
    places = np.full((n, 4, 2), np.nan)
    times, azimuth, truth = np.full(n, np.inf), np.full((n, 4), np.nan), np.full((n, 2), np.nan)
    scale = np.array([93_570.0, 110_920.0])  # metres a degree at 32.8 degrees north
    origin = np.array([-117.588, 32.818])
    for row in rows:
        at, buoy = calls[row["call_id"]], buoys.index(row["buoy"])
        here = np.array([float(row["buoy_lon"]), float(row["buoy_lat"])])
        boat = np.array([float(row["boat_lon"]), float(row["boat_lat"])])
        places[at, buoy], truth[at] = scale * (here - origin), scale * (boat - origin)
        azimuth[at, buoy] = np.radians(float(row["bearing_deg"] or "nan"))
        times[at] = min(times[at], float(row["t_s"] or "inf"))
    for column in np.moveaxis(places, 0, -1).reshape(8, n):
        known = ~np.isnan(column)
        column[:] = np.interp(times, times[known], column[known])
    return times, places, azimuth, truth
