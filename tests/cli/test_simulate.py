"""The command `tertia simulate`: files that the other commands read, with what it says of them."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from terminal import run

from tertia.geo import SystemPlane

OPTIONS = ("--set-up", "tma", "--aircraft", "10", "--radar-count", "2", "--duration", "400")


def scene(folder: Path, *options: object) -> Path:
    done = run("simulate", folder, *OPTIONS, *options)
    assert done.code == 0, done.err
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return scene(tmp_path_factory.mktemp("scene"))


@pytest.mark.parametrize(
    "command",
    [
        "track {0}/plots.csv --sensors {0}/sensors.toml --plans {0}/plans.json --output {1}/t.csv",
        "evaluate {1}/t.csv --truth {0}/truth.csv",
        "bearing {0}/bearings.csv --by target --by sensor",
        "locate {0}/bearings.csv --sensors {0}/sensors.toml --by target",
        "fuse-series {0}/azimuths.csv --by target --alpha 0.05 --acceleration-sigma 0.001",
    ],
)
def test_the_other_commands_read_the_files(
    command: str, folder: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    place = tmp_path_factory.getbasetemp()
    done = run(*command.format(folder, place).split())
    assert done.code == 0, done.err
    assert done.err == ""


def test_a_scene_on_the_earth(tmp_path: Path) -> None:
    """Tracks have latitudes, true courses and true speeds."""
    folder = scene(tmp_path / "earth", "--origin", "50.1,14.26", "--clutter", "0", "--seed", "3")
    sensors = folder / "sensors.toml"
    place = "latitude_deg = 50.1\nlongitude_deg = 14.26\nheight_m = 50.0"
    assert place in sensors.read_text(encoding="utf-8")
    tracks = tmp_path / "earth.csv"
    done = run("track", folder / "plots.csv", "--sensors", sensors, "--output", tracks)
    assert (done.code, done.err) == (0, "")
    assert run("evaluate", tracks, "--truth", folder / "truth.csv").code == 0
    rows = pl.read_csv(tracks, infer_schema_length=None)
    plane = SystemPlane(50.1, 14.26)
    places = rows.select("east_m", "north_m", pl.col("height_m").fill_null(0.0)).to_numpy()
    latitude, longitude, _ = plane.to_geodetic(places)
    np.testing.assert_allclose(rows["latitude_deg"], latitude, atol=1e-7)
    np.testing.assert_allclose(rows["longitude_deg"], longitude, atol=1e-7)
    scale, convergence = plane.scale_and_convergence(places)
    east, north = rows["velocity_east_m_s"].to_numpy(), rows["velocity_north_m_s"].to_numpy()
    np.testing.assert_allclose(rows["speed_m_s"], np.hypot(east, north) / scale, rtol=1e-6)
    turned = np.arctan2(east, north) - convergence - np.radians(rows["course_deg"].to_numpy())
    np.testing.assert_allclose(np.sin(turned), 0.0, atol=1e-6)


def test_faults_are_what_the_scene_says(folder: Path) -> None:
    """The last radar's ranges are too long, and its azimuths worse after half the time."""
    told = json.loads((folder / "scene.json").read_text(encoding="utf-8"))
    fault = told["radars"]["radar-2"]
    plots = pl.read_csv(folder / "plots.csv", schema_overrides={"mode_3a": pl.String})
    truth = pl.read_csv(folder / "truth.csv")
    radars = (folder / "sensors.toml").read_text(encoding="utf-8")
    assert "detection_probability = 0.95" in radars
    assert plots.height == told["plot_count"]
    plans = json.loads((folder / "plans.json").read_text(encoding="utf-8"))
    codes = {plan["mode_3a"]: plan for plan in plans}
    errors = []
    for row in plots.filter(pl.col("sensor") == "radar-2").iter_rows(named=True):
        plan = codes.get(row["mode_3a"] or "")
        if plan is None or row["flight_level"] is None:
            continue
        own = truth.filter(pl.col("target") == plan["name"])
        place = [np.interp(row["time_s"], own["time_s"], own[x]) for x in ("east_m", "north_m")]
        # the second radar is at the north of the first
        east, north = place[0], place[1] - 31_500.0
        rise = row["flight_level"] * 30.48 - 50.0
        azimuth = np.degrees(np.arctan2(east, north))
        errors.append(
            (
                row["time_s"],
                row["range_m"] - np.hypot(np.hypot(east, north), rise),
                (row["azimuth_deg"] - azimuth + 180.0) % 360.0 - 180.0,
            )
        )
    time, off, turned = np.array(errors).T
    assert np.median(off) == pytest.approx(fault["range_bias_m"], abs=25.0)
    since = fault["azimuth_sigma_since_s"]
    sigma = [np.median(np.abs(turned[half])) / 0.6745 for half in (time < since, time > since)]
    assert sigma[0] == pytest.approx(1.2 * 0.08, rel=0.25)
    assert sigma[1] == pytest.approx(fault["azimuth_sigma_deg"], rel=0.25)


def test_the_seed_makes_the_files(folder: Path, tmp_path: Path) -> None:
    again, other = scene(tmp_path / "again"), scene(tmp_path / "other", "--seed", 2)
    names = sorted(path.name for path in folder.iterdir())
    assert names == sorted(path.name for path in again.iterdir())
    assert all((folder / n).read_bytes() == (again / n).read_bytes() for n in names)
    assert (folder / "plots.csv").read_bytes() != (other / "plots.csv").read_bytes()


def test_a_single_radar_has_no_faults(tmp_path: Path) -> None:
    told: dict[str, Any] = json.loads(
        run("simulate", tmp_path, *OPTIONS, "--radar-count", 1, "--json").out
    )
    assert told["radars"] == {}


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    done = run("simulate", tmp_path / "file")
    assert done.code == 2
    assert done.err == f"tertia: cannot write {tmp_path / 'file'}: it is not a folder\n"
