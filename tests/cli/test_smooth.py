"""The command `tertia smooth`: what the library says of a file of positions."""

import json
import warnings
from functools import partial
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import terminal

from tertia import smoothing, tables
from tertia.geo import SystemPlane

run = partial(terminal.run, "smooth")


def positions() -> pl.DataFrame:
    """Two targets on straight lines; one plot is far off, one is missing, one comes twice."""
    random = np.random.default_rng(4)
    time = np.arange(60.0)
    parts = []
    for target, speed in (("007", 100.0), ("b", -40.0)):
        east, north = speed * time, 2000.0 - 0.5 * speed * time
        east, north = (a + 20.0 * random.normal(size=60) for a in (east, north))
        parts.append(
            pl.DataFrame({"time_s": time, "target": target, "east_m": east, "north_m": north})
        )
    rows = pl.concat(parts).with_columns(
        east_m=pl.when(pl.int_range(pl.len()) == 30)
        .then(pl.col("east_m") + 3000)
        .otherwise("east_m")
    )
    rows = rows.with_columns(north_m=pl.when(pl.int_range(pl.len()) != 80).then("north_m"))
    return pl.concat([rows, rows[40:41]])


def test_it_is_the_function_of_tables(tmp_path: Path) -> None:
    file, output = tmp_path / "positions.csv", tmp_path / "smoothed.parquet"
    rows = positions()
    rows.write_csv(file)
    done = run(file, "--by", "target", "--sigma", 20, "--output", output, "--json")
    assert done.code == 0
    assert json.loads(done.out) == {"tracks": 2, "rows": 121, "outliers": 1}
    found = pl.read_parquet(output)
    expected = tables.smooth(rows, by="target", sigma=20.0, n_threads=1)
    for name in expected.columns:
        assert found[name].to_list() == expected[name].to_list(), name
    assert found["smoothing_outlier"].arg_true().to_list() == [30]
    off = found[30, "east_smoothed_m"] - 100.0 * 30
    assert abs(off) < 3 * found[30, "east_smoothed_sigma_m"]


def test_values_and_columns_of_sigma(tmp_path: Path) -> None:
    file = tmp_path / "up.csv"
    rows = positions().select(t="time_s", up_m="east_m").head(60).with_columns(s=pl.lit(20.0))
    rows.write_csv(file)
    done = run(file, "--value", "up_m", "--sigma", "s", "--column", "time_s=t")
    assert done.code == 0
    assert "1 track of 60 rows, 1 outlier left out" in done.out
    assert "up_smoothed_sigma_m" in done.out


def test_covariances_that_other_commands_write(tmp_path: Path) -> None:
    """Rotated ellipses of error are used; a covariance that is missing is 0."""
    random = np.random.default_rng(7)
    time = 4.0 * np.arange(40)
    half = np.radians(random.uniform(20.0, 70.0, 40))
    axes = np.stack([np.sin(half), np.cos(half), np.cos(half), -np.sin(half)], axis=-1)
    turned = axes.reshape(40, 2, 2)
    covariance = turned @ np.diag([100.0**2, 10.0**2]) @ turned.transpose(0, 2, 1)
    noise = np.linalg.cholesky(covariance) @ random.standard_normal((40, 2, 1))
    plots = np.column_stack([80.0 * time, 30.0 * time]) + noise[..., 0]
    covariance[5, 0, 1] = covariance[5, 1, 0] = 0.0
    rows = pl.DataFrame(
        {
            "time_s": time,
            "east_m": plots[:, 0],
            "north_m": plots[:, 1],
            "east_sigma_m": np.sqrt(covariance[:, 0, 0]),
            "north_sigma_m": np.sqrt(covariance[:, 1, 1]),
            "covariance_east_north_m2": [
                None if k == 5 else one for k, one in enumerate(covariance[:, 0, 1])
            ],
        }
    )
    file, output = tmp_path / "positions.csv", tmp_path / "smoothed.parquet"
    rows.write_csv(file)
    sigmas = ("--sigma", "east_sigma_m", "--sigma", "north_sigma_m")
    terminal.succeed("smooth", file, *sigmas, "--output", output)
    expected = smoothing.smooth(plots, covariance, time=time)
    smoothed = pl.read_parquet(output).select("east_smoothed_m", "north_smoothed_m")
    np.testing.assert_allclose(smoothed, expected.position, rtol=1e-9)
    # no errors have such an ellipse
    column = pl.Series([-1e4 if k == 7 else 0.0 for k in range(40)])
    rows.with_columns(covariance_east_north_m2=column).write_csv(file)
    done = run(file, *sigmas)
    said = "line 9: covariance_east_north_m2 is larger than the product of the sigmas"
    assert done.code == 1
    assert said in done.err


def test_several_targets_in_one_track() -> None:
    rows = positions()
    with warnings.catch_warnings():
        warnings.simplefilter("error", tables.RecordWarning)
        tables.smooth(rows, by="target", sigma=20.0)
        tables.smooth(rows, by="target", sigma=10.0)
    with pytest.warns(tables.RecordWarning, match="the track scatter .* are there several targets"):
        tables.smooth(rows, sigma=20.0)


def test_mistakes(tmp_path: Path) -> None:
    file = tmp_path / "positions.csv"
    row = pl.int_range(pl.len())
    holes = pl.when(~row.is_in([3, 4])).then(20.0)
    rows = positions().with_columns(s=pl.when(row == 2).then(-1.0).otherwise(20.0), h=holes)
    rows.write_csv(file)
    for options, message in (
        (("--sigma", "x"), "x"),
        (("--sigma", 0), "sigma is 0.0; it must be a positive number"),
        (("--sigma", -5), "sigma is -5.0; it must be a positive number"),
        (("--sigma", 5, "--velocity-sigma", -1), "velocity_"),
        (("--sigma", "s"), "positions.csv, line 4: s is -1; it must be positive"),
        (("--sigma", "h"), "positions.csv, line 5: h is missing (2 such rows)"),
        (("--sigma", 1, "--sigma", 2, "--sigma", 3), "sigma has 3 elements"),
        (("--sigma", 1, "--value", "up_m"), "up_m"),
    ):
        done = run(file, *options)
        terminal.assert_refused(done, message)


def test_latitudes_and_longitudes(tmp_path: Path) -> None:
    """What the plane makes of them comes back: a line over 60 km, without noise."""
    time = np.arange(300.0)
    plane = SystemPlane(50.0, 14.0)
    way = np.column_stack([200.0 * time, -90.0 * time, 0.0 * time])
    latitude, longitude, _ = plane.to_geodetic(way)
    flight = pl.DataFrame({"time_s": time, "latitude_deg": latitude, "longitude_deg": longitude})
    found = tables.smooth(flight, sigma=5.0)
    np.testing.assert_allclose(found["latitude_smoothed_deg"], latitude, atol=1e-7)
    np.testing.assert_allclose(found["longitude_smoothed_deg"], longitude, atol=1e-7)
    scale, convergence = map(np.asarray, plane.scale_and_convergence(way))
    east = (200.0 * np.cos(convergence) + 90.0 * np.sin(convergence)) / scale
    np.testing.assert_allclose(found["east_rate_m_s"], east, rtol=1e-3)
    path, output = tmp_path / "flight.csv", tmp_path / "smooth.parquet"
    flight.rename({"latitude_deg": "Latitude [deg]"}).write_csv(path)
    assert run(path, "--sigma", "5", "--output", output).code == 0
    columns = ["latitude_smoothed_deg", "longitude_smoothed_deg", "smoothing_outlier"]
    assert pl.read_parquet(output).select(columns).equals(found.select(columns))
    moving = flight.with_columns(
        speed_m_s=pl.lit(np.hypot(200.0, 90.0)),
        course_deg=pl.lit(np.degrees(np.arctan2(200.0, -90.0))),
    )
    moving.write_csv(path)
    assert run(path, "--sigma", 5, "--velocity-sigma", 0.1, "--output", output).code == 0
    both = pl.read_parquet(output)
    np.testing.assert_allclose(both["east_rate_m_s"], 200.0, rtol=1e-2)
    assert not both["smoothing_velocity_outlier"].any()
    missing = flight.with_columns(latitude_deg=pl.lit(None, pl.Float64))
    with pytest.raises(tables.RecordError, match="there are no positions"):
        tables.smooth(missing, sigma=5.0)


@pytest.mark.parametrize("latitude", [139.7, 4807.038])
def test_latitudes_that_are_none(latitude: float, tmp_path: Path) -> None:
    path = tmp_path / "positions.csv"
    path.write_text(f"time_s,latitude_deg,longitude_deg\n0,35,139\n1,{latitude},35.6\n")
    done = terminal.run("smooth", path, "--sigma", "10")
    assert done.code == 1
    assert "positions.csv, line 3: latitude_deg is " in done.err
    assert "is it swapped with the longitude, or in degrees and minutes?" in done.err
