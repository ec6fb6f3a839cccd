"""The command `tertia fuse-tracks`, and the same function of tables."""

import json
from pathlib import Path

import polars as pl
import pytest
from polars.testing import assert_frame_equal
from terminal import run

from tertia import tables
from tertia.cli.files.read import plots, read_radars

OPTIONS = ("--set-up", "tma", "--aircraft", "12", "--radar-count", "2", "--duration", "400")


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the tracks of two radars, each from its own plots."""
    folder = tmp_path_factory.mktemp("scene")
    assert run("simulate", folder, *OPTIONS).code == 0
    recorded = pl.read_csv(folder / "plots.csv", infer_schema=False)
    for k in (1, 2):
        recorded.filter(pl.col("sensor") == f"radar-{k}").write_csv(folder / f"radar-{k}.csv")
        done = run("track", folder / f"radar-{k}.csv", "--sensors", folder / "sensors.toml",
                   "--output", folder / f"tracks-{k}.csv")  # fmt: skip
        assert done.code == 0, done.err
    return folder


def fuse(scene: Path, output: Path, *options: str) -> dict[str, object]:
    files = (scene / "tracks-1.csv", scene / "tracks-2.csv", "--sensors", scene / "sensors.toml")
    done = run("fuse-tracks", *files, "--output", output, "--json", *options)
    assert done.code == 0, done.err
    return json.loads(done.out)


def test_two_files_make_one_picture(scene: Path, tmp_path: Path) -> None:
    found = fuse(scene, tmp_path / "picture.csv")
    rows = pl.read_csv(tmp_path / "picture.csv")
    assert found["row_count"] == rows.height
    # both radars see nearly all of the twelve aircraft
    both = rows.filter(
        pl.col("track_radar-1").is_not_null() & pl.col("track_radar-2").is_not_null()
    )
    assert both["track"].n_unique() > 8
    assert both.height > 0.6 * rows.height
    truth = pl.read_csv(scene / "truth.csv")
    assert abs(found["mean_target_count"] - truth["target"].n_unique()) < 6


def test_the_function_of_tables_is_the_command(scene: Path, tmp_path: Path) -> None:
    fuse(scene, tmp_path / "picture.parquet", "--method", "matrix", "--no-registration")
    tracks = pl.concat(
        [pl.read_csv(scene / f"tracks-{k}.csv") for k in (1, 2)], how="vertical_relaxed"
    )
    sensors = read_radars(scene / "sensors.toml", plots(scene / "plots.csv"))
    found = tables.fuse_tracks(tracks, sensors=sensors, method="matrix", registration=False)
    assert_frame_equal(found, pl.read_parquet(tmp_path / "picture.parquet"), check_dtypes=False)


def test_what_is_wrong(scene: Path) -> None:
    files = (scene / "tracks-1.csv", "--sensors", scene / "sensors.toml")
    done = run("fuse-tracks", *files, "--update-interval", "0")
    assert done.code != 0
    assert "update_interval" in done.err
    assert run("fuse-tracks", scene / "plots.csv", *files[1:]).code != 0
