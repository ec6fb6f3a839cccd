"""The command `tertia register`: the errors of a scene, and a file that `track` takes."""

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from terminal import run

from tertia.cli.files.read import read_radars
from tertia.tables._sensors import radar_rows

OPTIONS = ("--set-up", "tma", "--aircraft", "12", "--radar-count", "2", "--duration", "500")


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scene")
    assert run("simulate", folder, *OPTIONS).code == 0
    return folder


def test_errors_of_a_scene(scene: Path, tmp_path: Path) -> None:
    fault = json.loads((scene / "scene.json").read_text(encoding="utf-8"))["radars"]["radar-2"]
    plots, sensors, found = scene / "plots.csv", scene / "sensors.toml", tmp_path / "found.csv"
    done = run("register", plots, "--sensors", sensors, "--output", found)
    assert (done.code, done.err) == (0, "")
    assert "radar-2" in done.out
    rows = pl.read_csv(found)
    # only differences of the ranges of two radars are well known
    off = np.diff(rows["range_bias_m"])[0] - fault["range_bias_m"]
    assert abs(off) < 3 * np.hypot(*rows["range_bias_sigma_m"])
    assert rows["range_observable"].all()
    assert not rows["time_observable"].any()
    assert rows["azimuth_noise_factor"][1] > 1.3 * rows["azimuth_noise_factor"][0]
    again = run("track", plots, "--sensors", found, "--json")
    assert again.code == 0, again.err
    before = run("track", plots, "--sensors", sensors, "--json")
    counts = [json.loads(one.out)["track_count"] for one in (again, before)]
    assert counts[0] <= counts[1]


def test_what_is_written_is_read_again(scene: Path, tmp_path: Path) -> None:
    found = tmp_path / "found.csv"
    assert run("register", scene / "plots.csv", "--sensors", scene / "sensors.toml", "--output",
               found).code == 0  # fmt: skip
    radars = read_radars(found)
    expected = pl.read_csv(found)
    rows = radar_rows(radars)
    for name in rows.columns:
        if name != "name":
            np.testing.assert_allclose(
                rows[name].cast(pl.Float64), expected[name].cast(pl.Float64), rtol=1e-12
            )


def test_one_radar_determines_nothing(scene: Path, tmp_path: Path) -> None:
    plots = pl.read_csv(scene / "plots.csv").filter(pl.col("sensor") == "radar-1")
    alone = tmp_path / "alone.csv"
    plots.write_csv(alone)
    done = run("register", alone, "--sensors", scene / "sensors.toml")
    assert done.code == 0
    assert "no error can be estimated" in done.err


def test_no_files(scene: Path) -> None:
    done = run("register", "--sensors", scene / "sensors.toml")
    assert done.code == 2
    assert "give files of plots" in done.err


def test_a_sudden_change_is_named(scene: Path, tmp_path: Path) -> None:
    plots = pl.read_csv(scene / "plots.csv")
    later = (pl.col("sensor") == "radar-2") & (pl.col("time_s") > 250.0)
    moved = tmp_path / "moved.csv"
    azimuth = pl.col("azimuth_deg") + 0.5 * later
    plots.with_columns(azimuth_deg=azimuth % 360.0).write_csv(moved)
    done = run("register", moved, "--sensors", scene / "sensors.toml", "--json")
    assert done.code == 0
    (change,) = json.loads(done.out)["changes"]
    assert change["radar"] == "radar-2"
    assert abs(change["time"] - 250.0) < 20.0
    assert "the errors of radar-2 changed suddenly at" in done.err


def test_azimuth_errors_that_change_with_the_azimuth_are_noted(scene: Path, tmp_path: Path) -> None:
    plots = pl.read_csv(scene / "plots.csv")
    azimuth = pl.col("azimuth_deg")
    wrong = 0.3 * (2.0 * azimuth.radians()).sin() * (pl.col("sensor") == "radar-2")
    bent = tmp_path / "bent.csv"
    plots.with_columns(azimuth_deg=(azimuth + wrong) % 360.0).write_csv(bent)
    done = run("register", bent, "--sensors", scene / "sensors.toml", "--json")
    assert done.code == 0
    assert "azimuth errors change with the azimuth" in done.err
    (sigma,) = (
        one["azimuth_bias_sigma_deg"]
        for one in json.loads(done.out)["radars"]
        if one["name"] == "radar-2"
    )
    assert sigma > 0.15
    straight = run("register", scene / "plots.csv", "--sensors", scene / "sensors.toml")
    assert "change with the azimuth" not in straight.err
