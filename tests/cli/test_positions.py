"""Reports of positions in files."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from terminal import run

from tertia import tables
from tertia.geo import SystemPlane
from tertia.sensors import Bias, PositionSensor, Radar, Station
from tertia.tracker import Plots, track

SENSORS = """
[[radar]]
name = "west"
east_m = -70000.0
north_m = 0.0
range_sigma_m = 50.0
azimuth_sigma_deg = 0.08
scan_period_s = 4.0
trusted = true

[[position_sensor]]
name = "mlat"
position_sigma_m = 30.0
update_interval_s = 1.0
time_bias_s = 0.0
"""
PLACE = (-70e3, 0.0)
ITEMS: list[Radar | PositionSensor] = [
    Radar(
        PLACE,
        range_sigma=50.0,
        azimuth_sigma=np.radians(0.08),
        scan_period=4.0,
        bias=Bias(),
        name="west",
    ),
    PositionSensor(position_sigma=30.0, update_interval=1.0, bias=Bias(time=0.0), name="mlat"),
]


def reports() -> pl.DataFrame:
    """Return plots of a radar, and reports, every other one with its own covariance."""
    random = np.random.default_rng(5)
    time = np.arange(0.0, 60.0)
    east, north = 200.0 * time, 5000.0 + 50.0 * time
    stated = np.where(np.arange(60) % 2, 40.0, np.nan)
    report = pl.DataFrame({
        "time_s": time, "sensor": ["mlat"] * 60,
        "east_m": east + 30.0 * random.standard_normal(60),
        "north_m": north + 30.0 * random.standard_normal(60),
        "east_sigma_m": stated, "north_sigma_m": stated + 5.0,
        "covariance_east_north_m2": stated * 10.0,
    })  # fmt: skip
    seen = slice(2, None, 4)
    plot = pl.DataFrame({
        "time_s": time[seen] + 0.1, "sensor": ["west"] * 15,
        "range_m": np.hypot(east[seen] - PLACE[0], north[seen]),
        "azimuth_deg": np.degrees(np.arctan2(east[seen] - PLACE[0], north[seen])),
    })  # fmt: skip
    return pl.concat([report, plot], how="diagonal").fill_nan(None)


def expected(frame: pl.DataFrame) -> Plots:
    """Return the same plots by the library."""
    column = {name: frame[name].cast(pl.Float64, strict=False).to_numpy() for name in frame.columns}
    cross = column["covariance_east_north_m2"]
    spread = np.stack([column["east_sigma_m"] ** 2, cross, cross, column["north_sigma_m"] ** 2], 1)
    return Plots(
        column["time_s"],
        column["range_m"],
        np.radians(column["azimuth_deg"]),
        sensor=(frame["sensor"] == "mlat").to_numpy().astype(int),
        position=np.stack([column["east_m"], column["north_m"]], 1),
        covariance=spread.reshape(-1, 2, 2),
    )


def test_positions_of_files_are_those_of_the_library(tmp_path: Path) -> None:
    frame = reports()
    frame.write_csv(tmp_path / "plots.csv")
    (tmp_path / "sensors.toml").write_text(SENSORS)
    output = tmp_path / "tracks.csv"
    options = ("--sensors", tmp_path / "sensors.toml", "--output", output)
    done = run("track", tmp_path / "plots.csv", *options, "--plot", tmp_path / "tracks.png")
    assert done.code == 0, done.err
    found, wanted = pl.read_csv(output), track(expected(frame), ITEMS)
    assert found.height == len(wanted) > 70
    np.testing.assert_allclose(found["east_m"], wanted.position[:, 0], rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(
        found["east_sigma_m"], np.sqrt(wanted.covariance[:, 0, 0]), rtol=1e-9
    )
    same = tables.track(frame, sensors=ITEMS)
    np.testing.assert_allclose(same["north_m"], wanted.position[:, 1], rtol=1e-12)


def test_latitudes_and_longitudes_are_in_the_plane_of_the_radars() -> None:
    # covariances beside latitudes are of true north
    frame = reports().filter(pl.col("sensor") == "mlat").drop("^.*(sigma|covariance).*$")
    plane = SystemPlane(50.0, 14.0)
    place = np.column_stack([frame["east_m"], frame["north_m"], np.zeros(60)])
    latitude, longitude = (np.asarray(one) for one in plane.to_geodetic(place)[:2])
    earth = frame.drop("east_m", "north_m").with_columns(
        latitude_deg=pl.Series(latitude), longitude_deg=pl.Series(longitude)
    )
    noise = {"range_sigma": 50.0, "azimuth_sigma": 0.0014}
    radar = plane.radar(50.5, 14.5, name="west", scan_period=4.0, **noise)
    found = tables.track(earth, sensors=[radar, ITEMS[1]])
    wanted = tables.track(frame, sensors=ITEMS)
    np.testing.assert_allclose(found["east_m"], wanted["east_m"], atol=1e-5)


CAMERA = """
[[station]]
name = "camera"
{place}
azimuth_sigma_deg = 0.05

[[station]]
name = "without azimuths"
east_m = 0.0
north_m = 0.0
"""


def with_camera() -> pl.DataFrame:
    """Return the same with azimuths of a camera at (5, -2) km."""
    time = np.arange(20.0, 60.0)
    azimuth = np.degrees(np.arctan2(200.0 * time - 5e3, 7000.0 + 50.0 * time))
    seen = pl.DataFrame({"time_s": time, "sensor": ["camera"] * 40, "azimuth_deg": azimuth})
    return pl.concat([reports(), seen], how="diagonal")


def test_azimuths_of_stations(tmp_path: Path) -> None:
    frame = with_camera()
    frame.write_csv(tmp_path / "plots.csv")
    place = CAMERA.format(place="east_m = 5000.0\nnorth_m = -2000.0")
    (tmp_path / "sensors.toml").write_text(SENSORS + place)
    output = tmp_path / "tracks.csv"
    options = ("--sensors", tmp_path / "sensors.toml", "--output", output)
    done = run("track", tmp_path / "plots.csv", *options)
    assert done.code == 0, done.err
    camera = Station([5e3, -2e3], azimuth_sigma=0.05, degrees=True, name="camera")
    wanted = tables.track(frame, sensors=[*ITEMS, camera])
    found = pl.read_csv(output)
    assert (found["sensor"] == "camera").sum() > 30
    np.testing.assert_allclose(found["east_m"], wanted["east_m"], rtol=1e-12)


def test_a_stream_of_all_sensors(tmp_path: Path) -> None:
    frame = with_camera().sort("time_s")
    place = CAMERA.format(place="east_m = 5000.0\nnorth_m = -2000.0")
    (tmp_path / "sensors.toml").write_text(SENSORS + place)
    output = tmp_path / "tracks.csv"
    for name in ("plots.csv", "plots.jsonl"):
        path = tmp_path / name
        (frame.write_csv if path.suffix == ".csv" else frame.write_ndjson)(path)
        options = ("--sensors", tmp_path / "sensors.toml")
        assert run("track", path, *options, "--output", output).code == 0
        # all at once, when it ends
        done = run("track", path, *options, "--stream", "--latency", "1000", "--rows", "csv")
        assert done.code == 0, done.err
        found = pl.read_csv(done.out.encode())
        wanted = pl.read_csv(output).filter("confirmed")
        assert found.height == wanted.height > 100
        order = ["time_s", "sensor"]
        np.testing.assert_allclose(
            found.sort(order)["east_m"], wanted.sort(order)["east_m"], rtol=1e-12
        )


def test_stations_on_the_earth_are_in_the_plane_of_the_radars(tmp_path: Path) -> None:
    plane = SystemPlane(50.0, 14.0)
    latitude, longitude, _ = plane.to_geodetic(np.array([5e3, -2e3, 0.0]))
    west = plane.to_geodetic(np.array([*PLACE, 0.0]))
    on_earth = SENSORS.replace(
        "east_m = -70000.0\nnorth_m = 0.0", f"latitude_deg = {west[0]}\nlongitude_deg = {west[1]}"
    )
    place = CAMERA.format(place=f"latitude_deg = {latitude}\nlongitude_deg = {longitude}")
    origin = "[origin]\nlatitude_deg = 50.0\nlongitude_deg = 14.0\n"
    (tmp_path / "sensors.toml").write_text(origin + on_earth + place)
    with_camera().with_columns(height_m=0.0).write_csv(tmp_path / "plots.csv")
    output = tmp_path / "tracks.csv"
    for more in ((), ("--flat",)):
        options = ("--sensors", tmp_path / "sensors.toml", "--output", output, *more)
        done = run("track", tmp_path / "plots.csv", *options)
        assert done.code == 0, done.err
        found = pl.read_csv(output)
        seen = found.filter(pl.col("sensor") == "camera")
        assert seen.height > 25
        # the origin of a flat earth is that of the file, too
        np.testing.assert_allclose(seen["east_m"], 200.0 * seen["time_s"], atol=40.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("position_sigma_m = 30.0", "position_sigma_m = -1.0"), "position_sigma is -1"),
        (('name = "mlat"', 'name = "west"'), "there are two sensors west"),
        (("update_interval_s = 1.0", "update_interval_s = 0"), "update_interval"),
    ],
)
def test_mistakes_in_the_file_of_sensors(
    change: tuple[str, str], words: str, tmp_path: Path
) -> None:
    reports().write_csv(tmp_path / "plots.csv")
    (tmp_path / "sensors.toml").write_text(SENSORS.replace(*change))
    done = run("track", tmp_path / "plots.csv", "--sensors", tmp_path / "sensors.toml")
    assert done.code != 0
    assert words in done.err


def test_commands_for_radars_say_so(tmp_path: Path) -> None:
    reports().write_csv(tmp_path / "plots.csv")
    (tmp_path / "sensors.toml").write_text(SENSORS)
    done = run("report", tmp_path / "plots.csv", "--sensors", tmp_path / "sensors.toml")
    assert done.code != 0
    assert "which only `tertia track` without --udp can use" in done.err
