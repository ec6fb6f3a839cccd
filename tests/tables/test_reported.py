"""Tables of reports with velocities, and of stations that move and turn."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from tertia import tables
from tertia.geo import SystemPlane
from tertia.sensors import PositionSensor, Radar, Station
from tertia.tracker import Plots, track

TIME = np.arange(0.0, 120.0, 4.0)
TRUTH = np.outer(TIME, [150.0, -80.0])


def seen(seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    position = TRUTH + random.normal(0.0, 30.0, TRUTH.shape)
    return position, np.array([150.0, -80.0]) + random.normal(0.0, 1.0, TRUTH.shape)


def test_velocities_of_reports() -> None:
    position, velocity = seen()
    sensor = PositionSensor(position_sigma=30.0, velocity_sigma=1.0, update_interval=4.0)
    expected = track(Plots(TIME, position=position, velocity=velocity), [sensor])
    columns = {"time_s": TIME, "east_m": position[:, 0], "north_m": position[:, 1]}
    parts = {"velocity_east_m_s": velocity[:, 0], "velocity_north_m_s": velocity[:, 1]}
    found = tables.track(pl.DataFrame(columns | parts), sensors=[sensor])
    np.testing.assert_allclose(found["velocity_east_m_s"], expected.velocity[:, 0], rtol=1e-12)
    # as speed and course
    speed = np.hypot(*velocity.T) / (1852.0 / 3600.0)
    course = {"speed_kt": speed, "course_deg": np.degrees(np.arctan2(*velocity.T))}
    found = tables.track(pl.DataFrame(columns | course), sensors=[sensor])
    np.testing.assert_allclose(found["velocity_east_m_s"], expected.velocity[:, 0], rtol=1e-9)
    # with sigmas of their own
    own = {"velocity_east_sigma_m_s": 5.0, "velocity_north_sigma_m_s": 2.0}
    spread = {"covariance_velocity_east_velocity_north_m2_s2": -1.0}
    rows = pl.DataFrame(columns | parts).with_columns(
        **{name: pl.lit(value) for name, value in (own | spread).items()}
    )
    covariance = np.tile([[25.0, -1.0], [-1.0, 4.0]], (len(TIME), 1, 1))
    expected = track(
        Plots(TIME, position=position, velocity=velocity, velocity_covariance=covariance), [sensor]
    )
    found = tables.track(rows, sensors=[sensor])
    np.testing.assert_allclose(found["velocity_north_m_s"], expected.velocity[:, 1], rtol=1e-12)
    smoothed = tables.smooth_tracks(rows, sensors=[sensor])
    assert smoothed["velocity_east_sigma_m_s"].max() < found["velocity_east_sigma_m_s"].max()


def test_velocities_beside_latitudes_are_of_true_north(tmp_path: Path) -> None:
    """Far from the centre of the plane its north is not true north, and lengths are longer."""
    plane = SystemPlane(50.0, 14.0)
    position, velocity = seen()
    position = position + np.array([250e3, 100e3])
    height = np.zeros(len(TIME))
    latitude, longitude, _ = plane.to_geodetic(np.column_stack([position, height]))
    scale, convergence = plane.scale_and_convergence(np.column_stack([position, height]))
    course = np.arctan2(*velocity.T) - convergence
    speed = np.hypot(*velocity.T) / scale
    path = tmp_path / "sensors.toml"
    path.write_text(
        "[origin]\nlatitude_deg = 50.0\nlongitude_deg = 14.0\n"
        '[[position_sensor]]\nname = "adsb"\nposition_sigma_m = 30.0\nvelocity_sigma_m_s = 1.0\n'
        "update_interval_s = 4.0\n",
        encoding="utf-8",
    )
    rows = pl.DataFrame(
        {
            "time_s": TIME,
            "latitude_deg": latitude,
            "longitude_deg": longitude,
            "speed_m_s": speed,
            "course_deg": np.degrees(course) % 360.0,
            "sensor": "adsb",
        }
    )
    found = tables.track(rows, sensors=path)
    sensor = PositionSensor(position_sigma=30.0, velocity_sigma=1.0, update_interval=4.0)
    expected = track(Plots(TIME, position=position, velocity=velocity), [sensor])
    np.testing.assert_allclose(found["velocity_east_m_s"], expected.velocity[:, 0], rtol=1e-6)
    np.testing.assert_allclose(
        found["speed_m_s"], np.hypot(*expected.velocity.T) / scale, rtol=1e-4
    )


def test_sigmas_beside_latitudes_are_of_true_north(tmp_path: Path) -> None:
    """An ellipse that is long along the parallel, where the parallel is not east of the plane."""
    plane = SystemPlane(70.0, 14.0)
    position = seen()[0] + np.array([500e3, 100e3])
    there = np.column_stack([position, np.zeros(len(TIME))])
    latitude, longitude, _ = plane.to_geodetic(there)
    scale, convergence = (np.asarray(one) for one in plane.scale_and_convergence(there))
    # about 12 degrees
    assert abs(convergence[0]) > 0.2
    along = np.stack([np.cos(convergence), -np.sin(convergence)], axis=-1)
    across = np.stack([np.sin(convergence), np.cos(convergence)], axis=-1)
    outer = [one[:, :, np.newaxis] * one[:, np.newaxis] for one in (along, across)]
    covariance = (scale**2)[:, np.newaxis, np.newaxis] * (200.0**2 * outer[0] + 20.0**2 * outer[1])
    path = tmp_path / "sensors.toml"
    path.write_text(
        "[origin]\nlatitude_deg = 70.0\nlongitude_deg = 14.0\n"
        '[[position_sensor]]\nname = "mlat"\nupdate_interval_s = 4.0\n',
        encoding="utf-8",
    )
    rows = pl.DataFrame(
        {"time_s": TIME, "latitude_deg": latitude, "longitude_deg": longitude, "sensor": "mlat"}
    ).with_columns(east_sigma_m=pl.lit(200.0), north_sigma_m=pl.lit(20.0))
    found = tables.track(rows, sensors=path)
    sensor = PositionSensor(update_interval=4.0)
    expected = track(Plots(TIME, position=position, covariance=covariance), [sensor])
    np.testing.assert_allclose(found["east_m"], expected.position[:, 0], rtol=1e-9)
    np.testing.assert_allclose(found["north_sigma_m"] ** 2, expected.covariance[:, 1, 1], rtol=1e-6)


def test_numbers_that_are_not_available_in_ais_are_missing_values(tmp_path: Path) -> None:
    sensors = tmp_path / "ais.toml"
    sensors.write_text(
        '[origin]\nlatitude_deg = 53.5\nlongitude_deg = 8.2\n[[position_sensor]]\nname = "ais"\n'
        "position_sigma_m = 10.0\nvelocity_sigma_m_s = 0.5\nupdate_interval_s = 4.0\n"
    )
    frame = SystemPlane(53.5, 8.2)
    latitude, longitude, _ = frame.to_geodetic(np.column_stack([TRUTH / 20.0, 0.0 * TIME]))
    speed = np.full(len(TIME), 8.5 / 0.514444)
    course = np.full(len(TIME), np.degrees(np.arctan2(150.0, -80.0)))
    columns = {"time_s": TIME, "identity": 211_000_000, "course_deg": course.copy()}
    stated = {"latitude_deg": latitude, "longitude_deg": longitude, "speed_kt": speed}
    silent = {name: value.copy() for name, value in stated.items()}
    for name, value in (("latitude_deg", 91.0), ("longitude_deg", 181.0)):
        silent[name][[5, 12]] = value
    silent["speed_kt"][:3] = 102.3
    columns["course_deg"][8:10] = 360.0
    found = tables.track(pl.DataFrame(columns | silent), sensors=sensors)
    missing = {name: pl.Series(value) for name, value in stated.items()}
    for name in ("latitude_deg", "longitude_deg"):
        missing[name][[5, 12]] = None
    missing["speed_kt"][[0, 1, 2]] = None
    missing["course_deg"] = pl.Series(course)
    missing["course_deg"][[8, 9]] = None
    expected = tables.track(pl.DataFrame(columns | missing), sensors=sensors)
    assert found.equals(expected)
    wrong = np.where(latitude == latitude[3], 91.5, latitude)
    rows = pl.DataFrame(columns | stated | {"latitude_deg": wrong})
    with pytest.raises(ValueError, match=r"latitude_deg is 91\.5; it must be between -90 and 90"):
        tables.track(rows, sensors=sensors)


def test_a_camera_on_a_ship() -> None:
    position, _ = seen()
    gps = PositionSensor(position_sigma=30.0, update_interval=4.0, name="gps")
    camera = Station([0.0, 0.0], azimuth_sigma=0.001, name="camera")
    ship = np.column_stack([5.0 * TIME, 3000.0 + 0.0 * TIME])
    azimuth = np.arctan2(*(TRUTH - ship).T)
    heading = 0.4 + 0.01 * TIME
    none = np.full(len(TIME), np.nan)
    rows = pl.concat(
        [
            pl.DataFrame(
                {
                    "time_s": TIME,
                    "sensor": "gps",
                    "east_m": position[:, 0],
                    "north_m": position[:, 1],
                }
            ),
            pl.DataFrame(
                {
                    "time_s": TIME + 0.5,
                    "sensor": "camera",
                    "azimuth_deg": np.degrees(azimuth - heading),
                    "sensor_east_m": ship[:, 0],
                    "sensor_north_m": ship[:, 1],
                    "sensor_heading_deg": np.degrees(heading),
                }
            ),
        ],
        how="diagonal",
    )
    found = tables.track(rows, sensors=[gps, camera])
    both = np.full((2 * len(TIME), 2), np.nan)
    places, where = both.copy(), both.copy()
    places[: len(TIME)], where[len(TIME) :] = position, ship
    plots = Plots(
        np.append(TIME, TIME + 0.5),
        azimuth=np.append(none, azimuth),
        sensor=np.repeat([0, 1], len(TIME)),
        position=places,
        sensor_position=where,
    )
    expected = track(plots, [gps, camera])
    assert np.sum(expected.sensor == 1) > 20
    np.testing.assert_allclose(found["east_m"], expected.position[:, 0], atol=1e-6)
    lost = tables.track(rows.drop("sensor_heading_deg"), sensors=[gps, camera])
    assert lost.filter(pl.col("sensor") == "camera").height < 10


def test_a_moving_camera_on_the_earth(tmp_path: Path) -> None:
    """Its north is that of where it is, not that of the plane."""
    plane = SystemPlane(50.0, 14.0)
    position, _ = seen()
    position = position + np.array([200e3, 0.0])
    ship = np.column_stack([200e3 + 5.0 * TIME, 3000.0 + 0.0 * TIME])
    height = np.zeros(len(TIME))
    at = plane.to_geodetic(np.column_stack([position, height]))
    place = plane.to_geodetic(np.column_stack([ship, height]))
    _, convergence = plane.scale_and_convergence(np.column_stack([ship, height]))
    later = TRUTH + np.array([200e3 + 75.0, -40.0])
    azimuth = np.arctan2(*(later - ship).T) - convergence
    path = tmp_path / "sensors.toml"
    path.write_text(
        "[origin]\nlatitude_deg = 50.0\nlongitude_deg = 14.0\n"
        '[[position_sensor]]\nname = "gps"\nposition_sigma_m = 30.0\nupdate_interval_s = 4.0\n'
        '[[station]]\nname = "camera"\nlatitude_deg = 50.1\nlongitude_deg = 15.0\n'
        "azimuth_sigma_deg = 0.06\n",
        encoding="utf-8",
    )
    rows = pl.concat(
        [
            pl.DataFrame(
                {"time_s": TIME, "sensor": "gps", "latitude_deg": at[0], "longitude_deg": at[1]}
            ),
            pl.DataFrame(
                {
                    "time_s": TIME + 0.5,
                    "sensor": "camera",
                    "azimuth_deg": np.degrees(azimuth),
                    "sensor_latitude_deg": place[0],
                    "sensor_longitude_deg": place[1],
                }
            ),
        ],
        how="diagonal",
    )
    found = tables.track(rows, sensors=path).filter(pl.col("sensor") == "camera")
    assert found.height > 20
    truth = np.outer(found["time_s"].to_numpy(), [150.0, -80.0]) + np.array([200e3, 0.0])
    error = found.select("east_m", "north_m").to_numpy() - truth
    assert np.sqrt(np.mean(error**2)) < 25.0


def test_errors_of_positions_in_a_sensors_file(tmp_path: Path) -> None:
    position, _ = seen()
    text = '[[position_sensor]]\nname = "adsb"\nposition_sigma_m = 30.0\nupdate_interval_s = 4.0\n'
    path = tmp_path / "sensors.toml"
    rows = {"time_s": TIME, "sensor": "adsb"}
    path.write_text(text + "east_bias_m = 70.0\nnorth_bias_m = -20.0\n", encoding="utf-8")
    off = position + np.array([70.0, -20.0])
    found = tables.track(
        pl.DataFrame(rows | {"east_m": off[:, 0], "north_m": off[:, 1]}), sensors=path
    )
    path.write_text(text, encoding="utf-8")
    expected = tables.track(
        pl.DataFrame(rows | {"east_m": position[:, 0], "north_m": position[:, 1]}), sensors=path
    )
    np.testing.assert_allclose(found["east_m"], expected["east_m"], atol=1e-8)
    path.write_text('[[radar]]\nname = "A"\neast_m = 0\nnorth_m = 0\nrange_sigma_m = 50\n'
                    "azimuth_sigma_deg = 0.1\nscan_period_s = 4\neast_bias_m = 3\n",
                    encoding="utf-8")  # fmt: skip
    with pytest.raises(tables.RecordError, match="only a PositionSensor has such errors"):
        tables.track(pl.DataFrame(rows | {"range_m": 1e4, "azimuth_deg": 3.0}), sensors=path)


def test_a_radar_must_not_move() -> None:
    """Its places in the rows were not used, and all tracks were wrong."""
    east, north = TRUTH.T
    radar = Radar([-20e3, 0.0], name="ship", range_sigma=20.0, azimuth_sigma=2e-3, scan_period=4.0)
    rows = pl.DataFrame(
        {
            "time_s": TIME,
            "range_m": np.hypot(east + 20e3, north),
            "azimuth_deg": np.degrees(np.arctan2(east + 20e3, north)),
        }
    )
    expected = tables.track(rows, sensors=[radar])
    fixed = rows.with_columns(sensor_east_m=-20e3, sensor_north_m=0.0)
    assert tables.track(fixed, sensors=[radar]).equals(expected)
    for moved in (
        rows.with_columns(sensor_east_m=-20e3 + 5.0 * TIME, sensor_north_m=0.0),
        rows.with_columns(sensor_heading_deg=10.0),
    ):
        with pytest.raises(tables.RecordError, match="radar ship moves"):
            tables.track(moved, sensors=[radar])
