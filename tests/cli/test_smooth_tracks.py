"""The command `tertia smooth-tracks`: where targets were, as a truth for others."""

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from terminal import result, run, succeed

from tertia import simulate, tables

OPTIONS = ("--set-up", "tma", "--aircraft", "8", "--radar-count", "2", "--duration", "400")


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scene")
    succeed("simulate", folder, *OPTIONS)
    return folder


def rmse(path: Path, truth: Path) -> float:
    """Root mean square error of tracks in a file."""
    done = json.loads(succeed("evaluate", path, "--truth", truth, "--json").out)
    (found,) = (row["value"] for row in done["figures"] if row["figure"] == "RMSE")
    return float(found)


def test_the_file_is_a_truth(scene: Path, tmp_path: Path) -> None:
    plots, sensors = scene / "plots.csv", tmp_path / "sensors.toml"
    reference, tracks = tmp_path / "reference.csv", tmp_path / "tracks.csv"
    # the radars have no systematic errors, which few aircraft would not tell
    known = (scene / "sensors.toml").read_text().replace("[[radar]]", "[[radar]]\ntrusted = true")
    sensors.write_text(known)
    options = (plots, "--sensors", sensors)
    done = succeed("smooth-tracks", *options, "--every", 1, "--output", reference)
    assert "sigma of a position" in done.out
    succeed("track", *options, "--output", tracks)
    # it is nearly as far from the tracks as the truth is, and much nearer to the truth
    of_tracks, known, of_reference = (
        rmse(path, truth)
        for path, truth in (
            (tracks, scene / "truth.csv"),
            (tracks, reference),
            (reference, scene / "truth.csv"),
        )
    )
    assert 0.5 < known / of_tracks < 1.2
    assert of_reference < 0.8 * of_tracks


def test_rows_are_those_of_the_library(scene: Path, tmp_path: Path) -> None:
    frame = result(
        "smooth-tracks", scene / "plots.csv", "--sensors", scene / "sensors.toml", folder=tmp_path
    )
    assert frame.columns[:4] == ["time_s", "track", "sensor", "plot"]
    assert set(frame["transversal"].unique()) <= {"constant", "right", "left", None}
    assert set(frame["vertical"].unique()) <= {"level", "climb", "descent", None}
    assert frame["plot"].null_count() == 0
    np.testing.assert_array_less(0.0, frame["east_sigma_m"])


def test_tables_as_the_command(scene: Path) -> None:
    set_up = simulate.set_up("tma")
    plots = pl.read_csv(scene / "plots.csv").filter(pl.col("sensor") == "radar-1")
    found = tables.smooth_tracks(plots.drop("sensor"), sensors=[set_up.radar], every=2.0)
    assert found["plot"].null_count() > 0
    between = found.filter(pl.col("plot").is_null())
    assert between["outlier"].null_count() == len(between)
    with pytest.raises(ValueError, match="exclude"):
        tables.smooth_tracks(plots.drop("sensor"), sensors=[set_up.radar], exclude="nobody")


def test_wrong_use(scene: Path) -> None:
    assert run("smooth-tracks", "--sensors", scene / "sensors.toml").code == 2
    done = run(
        "smooth-tracks", scene / "plots.csv", "--sensors", scene / "sensors.toml", "--exclude", "x"
    )
    assert done.code != 0
    assert "exclude" in done.err
