"""Sounds of many emissions: how their arrivals are grouped, and what is said of many groups."""

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from terminal import run, succeed

PLACES = np.array([[0, 0], [900, 50], [1000, 950], [30, 1000], [500, 1300], [-300, 500]])
SPEED, WIND = 347.0, np.array([4.0, 2.0])


@pytest.fixture
def shots(tmp_path: Path) -> pl.DataFrame:
    """Return the true positions of 40 shots; `shots.csv` and `stations.csv` are written."""
    rng = np.random.default_rng(3)
    truth = rng.uniform(100, 900, (40, 2))
    begin, rows = datetime(2024, 7, 4, 23, 58), []
    for shot, place in enumerate(truth):
        fired = begin + timedelta(seconds=10.0 * shot + float(rng.uniform(0, 5)))
        away = PLACES - place
        distance = np.linalg.norm(away, axis=1)
        delay = distance / (SPEED + away @ WIND / distance) + rng.normal(0, 0.004, len(PLACES))
        rows += [
            {
                "incident": f"INC-{shot:03d}",
                "sensor": f"S{k}",
                "arrival_time_s": (fired + timedelta(seconds=float(late))).isoformat(),
            }
            for k, late in enumerate(delay)
        ]
    rows.sort(key=lambda row: row["arrival_time_s"])
    pl.DataFrame(rows).write_csv(tmp_path / "shots.csv")
    stations = {"name": [f"S{k}" for k in range(len(PLACES))], "arrival_time_sigma_s": 0.004}
    places = {"east_m": PLACES[:, 0], "north_m": PLACES[:, 1]}
    pl.DataFrame(stations | places).write_csv(tmp_path / "stations.csv")
    return pl.DataFrame({"east": truth[:, 0], "north": truth[:, 1]})


def arguments(folder: Path, *more: object) -> tuple[object, ...]:
    files = folder / "shots.csv", "--sensors", folder / "stations.csv"
    return ("locate", *files, "--propagation-speed", "343", *more)


MEDIUM = ("--propagation-speed-sigma", "6", "--wind-sigma", "5")


def test_arrivals_are_grouped_by_their_own_times(shots: pl.DataFrame, tmp_path: Path) -> None:
    output = tmp_path / "found.csv"
    done = succeed(
        *arguments(tmp_path, *MEDIUM, "--tolerance", "4", "--output", output),
    )
    found = pl.read_csv(output)
    assert found.height == shots.height
    error = [(found[f"{axis}_m"] - shots[axis]).to_numpy() for axis in ("east", "north")]
    columns = ("east_sigma_m", "north_sigma_m", "covariance_east_north_m2")
    east, north, cross = (found[name].to_numpy() for name in columns)
    square = (error[0] * north) ** 2 + (error[1] * east) ** 2 - 2 * cross * error[0] * error[1]
    inside = square / ((east * north) ** 2 - cross**2) < 5.99
    # 95 % of 40: 38 ± 1.4
    assert inside.sum() >= 34
    assert "taken as exactly" not in done.err


def test_without_a_tolerance_it_is_asked_for(shots: pl.DataFrame, tmp_path: Path) -> None:
    assert shots.height
    done = run(*arguments(tmp_path))
    assert done.code
    assert "a sensor has several times of arrival: give a tolerance in seconds" in done.err


def test_many_groups_are_summarised(shots: pl.DataFrame, tmp_path: Path) -> None:
    done = succeed(*arguments(tmp_path, *MEDIUM, "--by", "incident"))
    assert "the speed of the signals and the wind are estimated for each of 40 groups" in done.err
    assert "sensors of all 40 groups together" in done.err
    assert done.out.count("incident INC-") == 20
    assert "20 more groups: " in done.out
    counts = [line.split()[2] for line in done.out.splitlines() if " arrival_time " in line]
    assert counts == [str(shots.height)] * len(PLACES)


def test_an_exact_speed_of_sound_is_doubted(shots: pl.DataFrame, tmp_path: Path) -> None:
    assert shots.height
    for command in ("locate", "reconstruct"):
        options = arguments(tmp_path, "--tolerance", "4", "--wind-sigma", "0")[1:]
        assert "taken as exactly 343 m/s" in succeed(command, *options).err
