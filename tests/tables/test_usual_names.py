"""Columns of usual recordings: what is said of their names, and that what is said works."""

import re
import shlex
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from terminal import run, succeed

from tertia import tables
from tertia.sensors import Station

# of OpenSky, of Movebank, of a sonobuoy receiver, and of Danish AIS
HEADERS = {
    "time,icao24,lat,lon,velocity,heading": "time_s=time latitude_deg=lat longitude_deg=lon",
    "event-id,timestamp,location-long,location-lat": (
        "time_s=timestamp latitude_deg=location-lat longitude_deg=location-long"
    ),
    "Time (UTC),Buoy Lat,Buoy Lon": (
        "'time_s=Time (UTC)' 'latitude_deg=Buoy Lat' 'longitude_deg=Buoy Lon'"
    ),
    "# Timestamp,MMSI,Latitude,Longitude": (
        "'time_s=# Timestamp' latitude_deg=Latitude longitude_deg=Longitude"
    ),
    "t,lat,lon,altitude,geoaltitude": "time_s=t latitude_deg=lat longitude_deg=lon",
    "epoch,easting,northing": "time_s=epoch east_m=easting north_m=northing",
}


@pytest.mark.parametrize("header", HEADERS)
def test_all_names_are_said_at_once(header: str, tmp_path: Path) -> None:
    count = header.count(",") + 1
    path = tmp_path / "positions.csv"
    rows = "\n".join(",".join([str(row)] * count) for row in range(8))
    path.write_text(f"\n{header}\n{rows}\n".lstrip("\n"), encoding="utf-8")
    done = run("smooth", path, "--sigma", "1")
    options = [f"--column {one}" for one in shlex.split(HEADERS[header], posix=True)]
    assert done.code == 2
    said = done.err.rpartition(": give ")[2].strip()
    assert shlex.split(said) == shlex.split(
        " ".join(f"--column {shlex.quote(one.removeprefix('--column '))}" for one in options)
    )
    succeed("smooth", path, "--sigma", "1", *shlex.split(said))


def test_of_plots_and_bearings(tmp_path: Path) -> None:
    path, sensors = tmp_path / "plots.csv", tmp_path / "sensors.toml"
    radar = '[[radar]]\nname = "a"\nrange_sigma_m = 9\nazimuth_sigma_deg = 1\nscan_period_s = 3\n'
    sensors.write_text(f"{radar}east_m = 0\nnorth_m = 0\n", encoding="utf-8")
    path.write_text("UTC,Bearing (T),dist_km\n1,2,3\n", encoding="utf-8")
    said = run("track", path, "--sensors", sensors).err
    assert "no columns time_s, range_m or range_nm, azimuth_deg; dist_km is in another unit" in said
    assert said.strip().endswith("give --column time_s=UTC --column 'azimuth_deg=Bearing (T)'")


@pytest.mark.parametrize(
    ("column", "name"),
    [
        ("azimuth_deg", "Azimuth [gon]"),
        ("azimuth_deg", "bearing_mils"),
        ("range_m", "distance_feet"),
        ("range_m", "range_yd"),
        ("range_m", "distance_mm"),
    ],
)
def test_other_units_are_not_suggested_and_are_doubted(column: str, name: str) -> None:
    count = 12
    table = pl.DataFrame({"time_s": np.arange(count), name: np.full(count, 50.0), "sensor": "a"})
    stations = pl.DataFrame({"name": ["a"], "east_m": [0.0], "north_m": [0.0]})
    with pytest.raises(tables.ColumnError, match="is in another unit") as caught:
        tables.locate(table, sensors=stations)
    assert "give" not in str(caught.value).split("is in another unit")[1]
    with pytest.warns(tables.RecordWarning, match="but its name states another unit"):
        found = tables.locate(table, sensors=stations, columns={column: name})
    assert found.height == count


@pytest.mark.parametrize("other", ["bistatic_range_m", "range_rate_m_s", "rssi_dbm", "doppler_hz"])
def test_other_quantities_are_not_suggested(other: str) -> None:
    table = pl.DataFrame({"time_s": [1.0], "sensor": ["a"], other: [20.0]})
    stations = pl.DataFrame({"name": ["a"], "east_m": [0.0], "north_m": [0.0]})
    with pytest.raises(tables.ColumnError, match="no column of measurements") as caught:
        tables.locate(table, sensors=stations)
    assert "did you mean" not in str(caught.value)


@pytest.mark.parametrize(
    ("header", "said"),
    [
        ("name,lat,lon", "latitude_deg of a is missing (did you mean lat?)"),
        ("name,easting,northing", "east_m of a is missing (did you mean easting?)"),
        ("station,east_m,north_m", "has no column name (did you mean station?)"),
    ],
)
def test_of_sensors(header: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "sensors.csv").write_text(f"{header}\na,1,2\n", encoding="utf-8")
    (tmp_path / "m.csv").write_text("time_s,sensor,azimuth_deg\n1,a,2\n", encoding="utf-8")
    done = run("locate", tmp_path / "m.csv", "--sensors", tmp_path / "sensors.csv")
    assert done.code
    assert re.search(re.escape(said), done.err)


def test_tables_of_sensors_in_the_plural(tmp_path: Path) -> None:
    path = tmp_path / "sensors.toml"
    path.write_text('[[Stations]]\nname = "a"\neast_m = 0\nnorth_m = 0\n', encoding="utf-8")
    table = pl.DataFrame({"time_s": [1.0], "sensor": ["a"], "azimuth_deg": [20.0]})
    with pytest.raises(tables.RecordError, match=r"\[\[Stations\]\] must be named \[\[station\]\]"):
        tables.locate(table, sensors=path)


def test_an_altitude_is_no_latitude() -> None:
    table = pl.DataFrame({"time_s": [0.0, 1.0], "altitude_m": 3e3, "longitude_deg": 14.0})
    with pytest.raises(tables.ColumnError, match="no column latitude_deg") as caught:
        tables.smooth(table, sigma=1.0)
    assert "did you mean" not in str(caught.value)


@pytest.mark.parametrize(
    ("columns", "origin", "said"),
    [
        (("lat", "lon"), True, "no columns latitude_deg, longitude_deg; .*give columns="),
        (("x", "y"), False, "no columns east_m, north_m; .*give columns="),
        (("latitude_deg", "lon"), True, "no column longitude_deg; .*give columns="),
        (("latitude_deg", "longitude_deg"), False, r"add a table \[origin\] with latitude_deg"),
    ],
)
def test_of_reports(columns: tuple[str, str], origin: bool, said: str, tmp_path: Path) -> None:
    path = tmp_path / "sensors.toml"
    head = "[origin]\nlatitude_deg = 50\nlongitude_deg = 14\n" if origin else ""
    path.write_text(f'{head}[[position_sensor]]\nname = "a"\nposition_sigma_m = 9\n')
    table = pl.DataFrame({"time_s": [0.0, 1.0], **dict.fromkeys(columns, 50.0)})
    with pytest.raises(tables.RecordError, match=said):
        tables.track(table, sensors=path)


def test_files_and_tables_of_one_sensor(tmp_path: Path) -> None:
    """A column of sensors is needed only if it is not clear which sensor measured."""
    (tmp_path / "sensors.csv").write_text(
        "name,east_m,north_m,azimuth_sigma_deg\nwest,0,0,1\neast,8000,0,1\n"
    )
    for name, azimuth in (("west", 45.0), ("east", 315.0)):
        (tmp_path / f"{name}.csv").write_text(f"time_s,azimuth_deg\n0,{azimuth}\n")
    sensors = "--sensors", tmp_path / "sensors.csv"
    output = "--output", tmp_path / "found.csv"
    succeed("locate", tmp_path / "west.csv", tmp_path / "east.csv", *sensors, *output)
    found = pl.read_csv(tmp_path / "found.csv")
    assert found.select("east_m", "north_m").row(0) == pytest.approx((4e3, 4e3))
    (tmp_path / "other.csv").write_text("t,Rx,azimuth_deg\n0,west,45\n")
    done = run("reconstruct", tmp_path / "other.csv", *sensors)
    assert "has no columns time_s, sensor" in done.err
    assert "give --column time_s=t --column sensor=Rx" in done.err
    moves = {"sensor_east_m": [0.0, 8e3], "sensor_north_m": 0.0}
    walk = pl.DataFrame({"time_s": [0.0, 60.0], "azimuth_deg": [45.0, 315.0]} | moves)
    walker = Station((0.0, 0.0), name="walker", azimuth_sigma=0.02)
    found = tables.locate(walk, sensors=[walker], tolerance=np.inf)
    assert found.select("east_m", "north_m").row(0) == pytest.approx((4e3, 4e3))
