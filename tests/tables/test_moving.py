"""Sensors that move: where they were is in the rows."""

import re
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from checks import in_region
from terminal import run, succeed

from tertia import plot, tables
from tertia.geo import LocalFrame
from tertia.location import locate
from tertia.sensors import Station

SIGMA = np.radians(3.0)


def drive(rng: np.random.Generator, count: int = 60, wrong: float = 0.2) -> pl.DataFrame:
    """Return an hour of bearings from a car that passes by (4 km, 6 km)."""
    time = np.sort(rng.uniform(0, 3600, count))
    places = np.column_stack([2.2 * time, 1500 * np.sin(time / 900)])
    azimuth = np.arctan2(*(np.array([4e3, 6e3]) - places).T) + rng.normal(0, SIGMA, count)
    bad = rng.random(count) < wrong
    azimuth[bad] = rng.uniform(-np.pi, np.pi, bad.sum())
    return pl.DataFrame(
        {
            "time_s": time,
            "sensor": "car",
            "azimuth_deg": np.degrees(azimuth) % 360,
            "sensor_east_m": places[:, 0],
            "sensor_north_m": places[:, 1],
        }
    )


CAR = Station((0.0, 0.0), name="car", azimuth_sigma=SIGMA)


def test_one_position_of_an_hour_is_within_its_sigma() -> None:
    inside = []
    for seed in range(60):
        found = tables.locate(
            drive(np.random.default_rng(seed)), sensors=[CAR], tolerance=np.inf
        ).row(0, named=True)
        error = np.array([found["east_m"] - 4e3, found["north_m"] - 6e3])
        cross = found["covariance_east_north_m2"]
        covariance = [[found["east_sigma_m"] ** 2, cross], [cross, found["north_sigma_m"] ** 2]]
        inside.append(in_region(error, covariance))
    # 95 % of 60: 57 ± 1.7
    assert sum(inside) >= 53


def test_it_is_what_locate_says_of_as_many_stations() -> None:
    table = drive(np.random.default_rng(1), wrong=0.0)
    places = table.select("sensor_east_m", "sensor_north_m").to_numpy()
    one_each = [Station(place, azimuth_sigma=SIGMA, name="car") for place in places]
    expected = locate(one_each, azimuth=np.radians(table["azimuth_deg"]))
    found = tables.locate(table, sensors=[CAR], tolerance=np.inf)
    np.testing.assert_allclose(found.select("east_m", "north_m").row(0), expected.position)
    np.testing.assert_allclose(found["measurement_count"], 60)


def test_some_stand_and_some_move_on_the_earth() -> None:
    """At every instant a car and two towers; the same in the plane and on the earth."""
    rng = np.random.default_rng(2)
    frame = LocalFrame(50.0, 14.0)
    time = np.arange(20.0)
    car = np.column_stack([100.0 * time, 50.0 * time])
    target = np.array([5e3, 7e3])
    places = {"car": car, "A": np.tile([0.0, 9e3], (20, 1)), "B": np.tile([9e3, 0.0], (20, 1))}
    parts, local = [], []
    for name, own in places.items():
        azimuth = np.arctan2(*(target - own).T) + rng.normal(0, 1e-3, 20)
        row = {"time_s": time, "sensor": name, "azimuth_deg": np.degrees(azimuth) % 360}
        moved = own if name == "car" else np.full((20, 2), np.nan)
        local.append(
            pl.DataFrame(row | {"sensor_east_m": moved[:, 0], "sensor_north_m": moved[:, 1]})
        )
        latitude, longitude, _ = frame.to_geodetic(np.column_stack([own, np.zeros(20)]))
        latitude, longitude = (
            np.where(np.isnan(moved[:, 0]), np.nan, cells) for cells in (latitude, longitude)
        )
        parts.append(
            pl.DataFrame(row | {"sensor_latitude_deg": latitude, "sensor_longitude_deg": longitude})
        )
    stations = [Station(own[0], name=name, azimuth_sigma=1e-3) for name, own in places.items()]
    found = tables.locate(pl.concat(local), sensors=stations)
    error = np.hypot(found["east_m"] - 5e3, found["north_m"] - 7e3)
    assert found["measurement_count"].to_list() == [3] * 20
    assert (error < 4 * np.hypot(found["east_sigma_m"], found["north_sigma_m"])).all()
    way = tables.reconstruct(pl.concat(local), sensors=stations, jerk=0.0)
    np.testing.assert_allclose(way["east_m"], 5e3, atol=20)
    with pytest.raises(
        tables.RecordError, match="can be used only if the positions of all sensors are given"
    ):
        tables.locate(pl.concat(parts), sensors=stations)


def test_files_on_the_earth(tmp_path: Path) -> None:
    """The map of an hour's drive has a line from every place."""
    pyproj = pytest.importorskip("pyproj")
    earth = pyproj.Geod(ellps="WGS84")
    rng = np.random.default_rng(5)
    table = drive(rng, count=30, wrong=0.0)
    frame = LocalFrame(49.2, 16.6)
    latitude, longitude, _ = frame.to_geodetic(
        np.column_stack([table["sensor_east_m"], table["sensor_north_m"], np.zeros(30)])
    )
    emitter = (16.66, 49.25)
    azimuth, _, _ = earth.inv(longitude, latitude, [emitter[0]] * 30, [emitter[1]] * 30)
    rows = pl.DataFrame(
        {
            "time_s": table["time_s"],
            "sensor": "car",
            "azimuth_deg": (azimuth + rng.normal(0, 3.0, 30)) % 360,
            "sensor_latitude_deg": latitude,
            "sensor_longitude_deg": longitude,
        }
    )
    path, sensors = tmp_path / "drive.csv", tmp_path / "sensors.toml"
    rows.write_csv(path)
    sensors.write_text(
        '[[station]]\nname = "car"\nlatitude_deg = 49.2\nlongitude_deg = 16.6\n'
        "azimuth_sigma_deg = 3.0\n",
        encoding="utf-8",
    )
    arguments = ("locate", path, "--sensors", sensors, "--tolerance", "inf", "--output")
    succeed(*arguments, tmp_path / "fix.csv")
    found = pl.read_csv(tmp_path / "fix.csv").row(0, named=True)
    _, _, error = earth.inv(*emitter, found["longitude_deg"], found["latitude_deg"])
    assert error < 3 * np.hypot(found["east_sigma_m"], found["north_sigma_m"])
    succeed(*arguments, tmp_path / "fix.geojson")
    text = (tmp_path / "fix.geojson").read_text(encoding="utf-8")
    assert len(re.findall("LineString", text)) == 30


def test_half_a_place_is_none() -> None:
    table = drive(np.random.default_rng(1)).drop("sensor_north_m")
    with pytest.raises(
        tables.RecordError, match="sensor_north_m or sensor_longitude_deg is missing"
    ):
        tables.locate(table, sensors=[CAR])


@pytest.mark.parametrize("tolerance", [0.0, np.inf])
def test_positions_of_sensors_may_have_any_names(tolerance: float) -> None:
    """Latitudes in a column of another name are not taken for metres."""
    rng = np.random.default_rng(3)
    frame = LocalFrame(57.0, -11.0)
    along = np.tile([0.0, 4e3], 20)
    places = np.column_stack([along, 500 * rng.random(40), np.zeros(40)])
    latitude, longitude, _ = frame.to_geodetic(places)
    azimuth = np.degrees(np.arctan2(*(np.array([2e3, 6e3]) - places[:, :2]).T)) % 360
    table = pl.DataFrame(
        {
            "time_s": np.repeat(np.arange(20.0), 2),
            "sensor": ["a", "b"] * 20,
            "azimuth_deg": azimuth,
            "sensor_latitude_deg": latitude,
            "sensor_longitude_deg": longitude,
        }
    )
    sensors = pl.DataFrame(
        {"name": ["a", "b"], "latitude_deg": 57.0, "longitude_deg": -11.0, "azimuth_sigma_deg": 3.0}
    )
    names = {"sensor_latitude_deg": "Buoy Lat", "sensor_longitude_deg": "Buoy Lon"}
    options = {"sensors": sensors, "tolerance": tolerance}
    expected = tables.locate(table, **options)
    found = tables.locate(table.rename(names), columns=names, **options)
    assert found.equals(expected)
    assert abs(expected["north_m"].mean() - 6e3) < 200


def test_only_one_of_several_files_has_positions_of_sensors(tmp_path: Path) -> None:
    table = drive(np.random.default_rng(4), wrong=0.0)
    fixed = pl.DataFrame({"time_s": [0.0], "sensor": ["hill"], "azimuth_deg": [0.0]})
    table.write_csv(tmp_path / "car.csv")
    fixed.write_csv(tmp_path / "hill.csv")
    (tmp_path / "sensors.toml").write_text(
        '[[station]]\nname = "car"\neast_m = 0\nnorth_m = 0\nazimuth_sigma_deg = 3\n'
        '[[station]]\nname = "hill"\neast_m = 4000\nnorth_m = 0\nazimuth_sigma_deg = 3\n'
    )
    said = []
    for files in (["car.csv", "hill.csv"], ["hill.csv", "car.csv"]):
        succeed(
            "locate",
            *(tmp_path / file for file in files),
            *("--sensors", tmp_path / "sensors.toml", "--tolerance", "inf"),
            *("--output", tmp_path / "found.csv"),
        )
        said.append(pl.read_csv(tmp_path / "found.csv").row(0, named=True))
    assert abs(said[0]["north_m"] - 6e3) < 500
    assert said[1]["north_m"] == pytest.approx(said[0]["north_m"], abs=1.0)


def test_positions_of_sensors_are_not_mixed(tmp_path: Path) -> None:
    table = drive(np.random.default_rng(5))
    table.write_csv(tmp_path / "car.csv")
    names = {"sensor_east_m": "sensor_longitude_deg", "sensor_north_m": "sensor_latitude_deg"}
    table.rename(names).write_csv(tmp_path / "other.csv")
    (tmp_path / "sensors.toml").write_text(
        '[[station]]\nname = "car"\neast_m = 0\nnorth_m = 0\nazimuth_sigma_deg = 3\n'
    )
    files = tmp_path / "car.csv", tmp_path / "other.csv"
    done = run("locate", *files, "--sensors", tmp_path / "sensors.toml", "--tolerance", "inf")
    assert "the positions of the sensors are in sensor_east_m, sensor_latitude_deg" in done.err


def test_places_that_are_not_used_are_noticed(recwarn: pytest.WarningsRecorder) -> None:
    """Only if they change: a table may repeat the place of a sensor in each row."""
    table = drive(np.random.default_rng(6), wrong=0.0).drop("sensor_east_m", "sensor_north_m")
    fixed = table.with_columns(lat=pl.lit(50.0), lon=pl.lit(14.0))
    other = Station((3e3, 0.0), name="hill", azimuth_sigma=SIGMA)
    options = {"sensors": [CAR, other], "tolerance": np.inf}
    both = pl.concat([table, table.with_columns(sensor=pl.lit("hill"))])
    tables.locate(both, **options)
    tables.locate(both.with_columns(lat=pl.lit(50.0), lon=pl.lit(14.0)), **options)
    assert not [one for one in recwarn if "are not used" in str(one.message)]
    moving = fixed.with_columns(lat=50.0 + pl.col("time_s") / 1e5)
    with pytest.warns(tables.RecordWarning, match="lat and lon change, and are not used"):
        tables.locate(pl.concat([moving, fixed.with_columns(sensor=pl.lit("hill"))]), **options)


@pytest.mark.parametrize("command", ["locate", "locate --tolerance inf", "reconstruct"])
def test_pictures_show_sensors_where_they_were(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    time, places = np.arange(20.0), np.linspace([0.0, 0.0], [8e3, 0.0], 20)
    azimuth = np.degrees(np.arctan2(*(np.array([4e3, 6e3]) - places).T))
    rows = {"time_s": time, "azimuth_deg": azimuth % 360}
    rows |= {"sensor_east_m": places[:, 0], "sensor_north_m": 0.0}
    hill = {"azimuth_deg": np.degrees(np.arctan2(-6e3, 6e3)) % 360}
    hill |= {"sensor": "hill", "sensor_east_m": 1e4, "sensor_north_m": 0.0}
    both = [pl.DataFrame(rows | {"sensor": "car"}), pl.DataFrame(rows | hill)]
    # what one of them does not measure at an instant must not move it
    measured = pl.concat(both, how="diagonal").filter(
        (pl.col("sensor") == "car") | (pl.col("time_s") > 2.0)
    )
    measured.write_csv(tmp_path / "seen.csv")
    # far away
    (tmp_path / "sensors.csv").write_text(
        "name,east_m,north_m,azimuth_sigma_deg\ncar,-900000,0,3\nhill,-900000,0,3\n"
    )
    drawn = []
    for name in ("location", "trajectory"):
        real = getattr(plot, name)

        def noted(stations: list[Station], *given: object, real=real, **options: object) -> object:
            drawn.extend(np.ravel(one.position[..., 0]) for one in stations)
            return real(stations, *given, **options)

        monkeypatch.setattr(plot, name, noted)
    picture = "--plot", tmp_path / "seen.png"
    sensors = "--sensors", tmp_path / "sensors.csv"
    succeed(*command.split(), tmp_path / "seen.csv", *sensors, *picture)
    assert np.unique(np.concatenate(drawn)) == pytest.approx([*places[:, 0], 1e4])
