"""Stations with latitudes, longitudes and heights that measure only azimuths."""

import numpy as np
import polars as pl
import pytest

from tertia import tables
from tertia.tables._sensors import stations

pyproj = pytest.importorskip("pyproj")
EARTH = pyproj.Geod(ellps="WGS84")

HEIGHTS = {"a": 1800.0, "b": 2200.0, "c": 2000.0}
PLACES = {"a": (47.0, 11.0), "b": (47.3, 11.6), "c": (46.8, 11.7)}
# 60 km from the first station, where heights of 2000 m matter by 20 m
TARGET = (47.1, 11.8)


def sensors(heights=HEIGHTS):
    return stations(
        [
            {
                "name": name,
                "latitude_deg": latitude,
                "longitude_deg": longitude,
                "height_m": heights[name],
                "azimuth_sigma_deg": 0.1,
                "elevation_sigma_deg": 0.1,
            }
            for name, (latitude, longitude) in PLACES.items()
        ]
    )


def azimuths(places, targets):
    """Return azimuths of the geodesics, in degrees."""
    there = np.broadcast_arrays(*np.transpose(places), *np.transpose(targets))
    return EARTH.inv(there[1], there[0], there[3], there[2])[0]


def recording(times):
    rows = [
        pl.DataFrame({"time_s": times, "sensor": name, "azimuth_deg": azimuths(place, TARGET)})
        for name, place in PLACES.items()
    ]
    return pl.concat(rows)


def away(row):
    return EARTH.inv(row["longitude_deg"], row["latitude_deg"], *TARGET[::-1])[2]


def test_the_position_is_at_the_mean_height_of_the_stations() -> None:
    row = tables.locate(recording([0.0]), sensors=sensors()).row(0, named=True)
    assert away(row) < 4.0
    frame = sensors().frame
    latitude, longitude = row["latitude_deg"], row["longitude_deg"]
    local = frame.to_local(latitude, longitude, 2000.0)
    np.testing.assert_allclose(local[:2], [row["east_m"], row["north_m"]], atol=1e-6)
    low = frame.to_local(latitude, longitude, 0.0)
    assert np.linalg.norm((low - local)[:2]) > 15
    assert row["height_m"] is None
    assert row["up_m"] is None
    assert row["up_sigma_m"] is None
    assert row["covariance_east_north_m2"] is not None
    assert row["covariance_east_up_m2"] is None
    correlation = row["covariance_east_north_m2"] / row["east_sigma_m"] / row["north_sigma_m"]
    assert 0.05 < abs(correlation) < 1


def test_an_elevation_at_an_instant_gives_its_height_alone() -> None:
    table = recording([0.0, 10.0]).with_columns(
        elevation_deg=pl.when(pl.col("time_s") == 10.0).then(2.0)
    )
    found = tables.locate(table, sensors=sensors())
    assert found["height_m"].is_null().to_list() == [True, False]
    assert found["latitude_deg"].null_count() == 0
    assert found["covariance_east_north_m2"].null_count() == 0
    assert found["covariance_east_up_m2"].is_null().to_list() == [True, False]


def test_paths_have_latitudes_and_no_heights() -> None:
    found = tables.reconstruct(recording(np.arange(20.0)), sensors=sensors(), jerk=0.0)
    assert max(away(row) for row in found.iter_rows(named=True)) < 4.0
    for name in ("up_m", "height_m", "velocity_up_m_s", "up_sigma_m", "covariance_east_up_m2"):
        assert found[name].null_count() == 20
    assert found["covariance_east_north_m2"].null_count() == 0
    assert found["outlier_count"].null_count() == 0


@pytest.mark.parametrize("call", [tables.locate, tables.reconstruct])
def test_heights_of_moving_stations_are_those_of_the_instant(call) -> None:
    """A balloon over the first place climbs; the mean height climbs by a third."""
    climb = pl.when(pl.col("sensor") == "a")
    times = np.arange(12.0)
    table = recording(times).with_columns(
        sensor_latitude_deg=climb.then(PLACES["a"][0]),
        sensor_longitude_deg=climb.then(PLACES["a"][1]),
        sensor_height_m=climb.then(1800.0 + 600.0 * pl.col("time_s")),
    )
    found = call(table, sensors=sensors())
    frame, places = sensors().frame, found.select("latitude_deg", "longitude_deg").to_numpy()
    local = frame.to_local(*places.T, 2000.0 + 200.0 * times)
    np.testing.assert_allclose(local[:, :2], found.select("east_m", "north_m"), atol=1e-5)


def test_positions_off_the_earth_have_no_latitude() -> None:
    own = sensors()
    found = own.geodetic(np.array([[9e6, 0.0, np.nan], [1e6, 2e5, np.nan], [np.nan] * 3]))
    assert found["latitude_deg"].is_null().to_list() == [True, False, True]
    assert found["height_m"].null_count() == 3
