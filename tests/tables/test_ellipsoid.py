"""Positions from stations without heights that are hundreds of kilometres apart."""

import numpy as np
import polars as pl
import pytest
from pyproj import Geod

from tertia import tables

EARTH, LIGHT = Geod(ellps="WGS84"), 299_792_458.0
STATIONS = pl.DataFrame(
    {
        "name": [*"ABCDEFG"],
        "latitude_deg": [45.5, 52.0, 47.3, 50.9, 45.1, 51.7, 48.5],
        "longitude_deg": [2.5, 3.1, 13.8, 12.9, 8.4, 8.1, 5.2],
        "range_sigma_m": 30.0,
        "azimuth_sigma_deg": 0.05,
        "arrival_time_sigma_s": 1e-7,
        "range_difference_sigma_m": 30.0,
    }
)
LATITUDE, LONGITUDE = np.array([46.2, 48.9, 50.3, 47.0]), np.array([11.2, 8.0, 5.9, 5.0])


def measured(kind: str) -> pl.DataFrame:
    """Return exact measurements of targets over time, along geodesics."""
    rows = []
    for step, (north, east) in enumerate(zip(LATITUDE, LONGITUDE, strict=True)):
        places = STATIONS["longitude_deg"].to_numpy(), STATIONS["latitude_deg"].to_numpy()
        azimuth, _, distance = EARTH.inv(*places, np.full(7, east), np.full(7, north))
        values = {
            "azimuth_deg": azimuth % 360,
            "range_m": distance,
            "range_difference_m": np.where(np.arange(7) > 0, distance - distance[0], np.nan),
            "arrival_time_s": distance / LIGHT,
        }
        found = pl.DataFrame({"sensor": STATIONS["name"], kind: values[kind]})
        rows.append(found.with_columns(time_s=pl.lit(1e4 * step)))
    return pl.concat(rows)


def missed(found: pl.DataFrame) -> np.ndarray:
    """Return the distances of positions from the targets."""
    places = found["longitude_deg"].to_numpy(), found["latitude_deg"].to_numpy()
    return np.asarray(EARTH.inv(*places, LONGITUDE, LATITUDE)[2])


@pytest.mark.parametrize("kind", ["azimuth_deg", "range_m", "range_difference_m", "arrival_time_s"])
@pytest.mark.parametrize("call", [tables.locate, tables.reconstruct])
def test_positions_are_those_on_the_ellipsoid(call, kind):
    options = {"jerk": 1e-3} if call is tables.reconstruct else {}
    found = call(measured(kind), sensors=STATIONS, **options)
    assert found["outlier_count"].to_list() == [0] * 4
    # in the plane: up to 3 km, and most instants have no position
    sigma = found.select(pl.col("east_sigma_m").pow(2) + pl.col("north_sigma_m").pow(2))
    assert np.max(missed(found) / np.sqrt(sigma.to_series().to_numpy())) < 0.03


def test_without_a_stated_sigma():
    bare = STATIONS.select("name", "latitude_deg", "longitude_deg")
    noise = 20.0 * np.random.default_rng(1).standard_normal(28)
    found = tables.locate(measured("range_m").with_columns(pl.col("range_m") + noise), sensors=bare)
    assert np.max(missed(found)) < 60.0
    assert found["east_sigma_m"].max() < 60.0
