"""Sensors as objects, as rows of a table, and as a file: the same results."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from places import EXAMPLES
from terminal import succeed

from tertia import tables
from tertia.sensors import Radar, Station
from tertia.tables._described import sensors_of

pd = pytest.importorskip("pandas")
pytest.importorskip("pyarrow")

KINDS = {
    "polars": lambda frame: frame,
    "pandas": lambda frame: frame.to_pandas(),
    "pyarrow": lambda frame: frame.to_arrow(compat_level=pl.CompatLevel.oldest()),
}
PLACES = {"A": (0.0, 0.0), "B": (9e3, 1e3), "C": (4e3, 8e3), "D": (-2e3, 6e3)}
ROWS = pl.DataFrame(
    {
        "name": list(PLACES),
        "east_m": [east for east, _ in PLACES.values()],
        "north_m": [north for _, north in PLACES.values()],
        "azimuth_sigma_deg": [1.0, 2.0, 1.5, None],
        "range_sigma_m": [None, None, None, 5.0],
    }
)
STATIONS = [
    Station(
        PLACES[row["name"]],
        name=row["name"],
        azimuth_sigma=row["azimuth_sigma_deg"],
        range_sigma=row["range_sigma_m"],
        degrees=True,
    )
    for row in ROWS.iter_rows(named=True)
]
ON_EARTH = pl.DataFrame(
    {
        "name": list("ABC"),
        "latitude_deg": [50.0, 50.1, 50.05],
        "longitude_deg": [14.0, 14.05, 14.2],
        "azimuth_sigma_deg": 0.5,
    }
)
BEARINGS = pl.DataFrame({"sensor": list("ABC"), "azimuth_deg": [52.0, 147.0, 270.0]})


def measured(seed: int, count: int = 20) -> pl.DataFrame:
    rng = np.random.default_rng(seed)
    time = 10.0 * np.arange(count)
    target = np.column_stack([3e3 + 5 * time, np.full(count, 4e3)])
    rows = []
    for name, place in PLACES.items():
        east, north = (target - place).T
        azimuth = np.degrees(np.arctan2(east, north)) + rng.normal(0, 1, count)
        away = np.hypot(east, north) + rng.normal(0, 5, count)
        cells = {"azimuth_deg": azimuth % 360} if name != "D" else {"range_m": away}
        rows.append(pl.DataFrame({"time_s": time, "sensor": name} | cells))
    return pl.concat(rows, how="diagonal")


def toml(rows: pl.DataFrame, noun: str, path: Path) -> Path:
    lines = []
    for row in rows.iter_rows(named=True):
        there = {key: value for key, value in row.items() if value is not None}
        lines += [f"[[{noun}]]", *(f"{key} = {value!r}" for key, value in there.items())]
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


@pytest.mark.parametrize("function", [tables.locate, tables.reconstruct])
@pytest.mark.parametrize("kind", KINDS)
def test_stations_in_any_form(function: Any, kind: str, tmp_path: Path) -> None:
    """Also with missing cells, which pandas reads as nan."""
    table = measured(51)
    expected = function(table, sensors=STATIONS)
    assert function(table, sensors=KINDS[kind](ROWS)).equals(expected)
    path = toml(ROWS, "station", tmp_path / "stations.toml")
    assert function(table, sensors=path).equals(expected)
    assert function(table, sensors=os.fspath(path)).equals(expected)


def test_stations_with_latitudes_give_latitudes(tmp_path: Path) -> None:
    """As the command does with the same table."""
    BEARINGS.write_csv(tmp_path / "bearings.csv")
    ON_EARTH.write_csv(tmp_path / "stations.csv")
    command = ("locate", tmp_path / "bearings.csv", "--sensors", tmp_path / "stations.csv")
    succeed(*command, "--output", tmp_path / "found.parquet")
    expected = pl.read_parquet(tmp_path / "found.parquet")
    found = tables.locate(BEARINGS, sensors=ON_EARTH)
    assert found.equals(expected)
    assert 50.0 < found["latitude_deg"].item() < 50.1
    assert 14.0 < found["longitude_deg"].item() < 14.2


def test_radars_in_any_form(tmp_path: Path) -> None:
    """The example of two radars on the earth, as its file is and as a table."""
    plots = pl.read_csv(EXAMPLES / "air_plots.csv")
    path = EXAMPLES / "air_radars.toml"
    succeed(
        "track", EXAMPLES / "air_plots.csv", "--sensors", path, "--output", tmp_path / "t.parquet"
    )
    expected = pl.read_parquet(tmp_path / "t.parquet")
    found = tables.track(plots, sensors=path)
    np.testing.assert_allclose(found["east_m"], expected["east_m"], atol=1e-6)
    registered = tables.register(plots, sensors=path)
    assert registered["name"].to_list() == ["west", "east"]
    # a result of `register` is such a table
    again = tables.track(plots, sensors=registered)
    assert again["track"].n_unique() == found["track"].n_unique()
    smoothed = tables.smooth_tracks(plots, sensors=registered)
    assert smoothed.height > 0
    assert set(smoothed.columns) >= {"east_m", "track"}


def test_sensors_of_all_kinds_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "sensors.toml"
    path.write_text(
        '[[position_sensor]]\nname = "gps"\nposition_sigma_m = 10.0\nupdate_interval_s = 1.0\n',
        encoding="utf-8",
    )
    time = np.arange(60.0)
    reports = pl.DataFrame({"time_s": time, "east_m": 50.0 * time, "north_m": 1000.0})
    found = tables.track(reports.with_columns(sensor=pl.lit("gps")), sensors=path)
    assert found["track"].n_unique() == 1


@pytest.mark.parametrize(
    ("sensors", "kind", "message"),
    [
        ({"A": (0.0, 0.0)}, TypeError, "sensors is a dict; it must be a sequence of sensors, a Da"),
        ([(0.0, 0.0)], TypeError, r"sensors\[0\] is a tuple; it must be a Radar, PositionSensor"),
        ("stations.csv", ValueError, "sensors is 'stations.csv'; a path must be that of a .toml"),
        (ROWS.drop("name"), tables.ColumnError, "sensors has no column name; it has east_m"),
        (ROWS.drop("east_m"), tables.RecordError, "sensors: east_m of A is missing"),
        (ROWS.head(0), tables.RecordError, "sensors: there are no stations"),
        (Path("nothing.toml"), FileNotFoundError, "nothing.toml"),
    ],
)
def test_what_does_not_describe_sensors(sensors: Any, kind: type[Exception], message: str) -> None:
    with pytest.raises(kind, match=message):
        tables.locate(measured(52), sensors=sensors)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    path = tmp_path / "sensors.toml"
    for text, message in (
        ("[[station]\n", "cannot read .*sensors.toml: "),
        ("station = 3\n", r"station is not a list of tables; each must begin with \[\[station"),
        ("origin = 3\n[[station]]\nname = 'A'\n", r"origin is not a table; it must begin with"),
    ):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(tables.RecordError, match=message):
            tables.locate(measured(53), sensors=path)


def test_how_to_name_a_column_is_said(tmp_path: Path) -> None:
    """By an option of the command, and by an argument of the function."""
    table = measured(54)
    wrong = table.rename({"time_s": "time", "azimuth_deg": "bearing", "range_m": "dist"})
    ROWS.write_csv(tmp_path / "stations.csv")
    wrong.rename({"bearing": "azimuth_deg"}).write_csv(tmp_path / "m.csv")
    end = r'did you mean time.*; it has time, .*: give columns=\{"time_s": "time"\}'
    with pytest.raises(tables.ColumnError, match=end):
        tables.reconstruct(wrong.rename({"bearing": "azimuth_deg"}), sensors=ROWS)
    with pytest.raises(
        tables.ColumnError, match=r'no column of meas.*give columns=\{"range_m": "dist'
    ):
        tables.locate(wrong, sensors=ROWS)
    with pytest.raises(
        tables.ColumnError, match=r'no column sensor.*: give columns=\{"sensor": "C'
    ):
        tables.locate(table.drop("sensor"), sensors=ROWS)
    near = table.rename({"azimuth_deg": "azimut_deg"}).drop("range_m")
    with pytest.raises(tables.ColumnError, match=r'give columns=\{"azimuth_deg": "azimut_deg"\}'):
        tables.locate(near, sensors=ROWS)
    # a name that was given has been understood
    with pytest.raises(tables.ColumnError, match=r"no column t; it has [^:]*$"):
        tables.locate(table, sensors=ROWS, columns={"time_s": "t"})
    with pytest.raises(tables.ColumnError, match=r"no column az; it has [^:]*$"):
        tables.screen(table, values="az")
    with pytest.raises(tables.ColumnError, match=r'give columns=\{"azimuth_deg": "azimut_deg"\}'):
        tables.bearing(near)


def test_how_to_name_a_column_of_the_truth_is_said() -> None:
    """There is an argument for it in `audit`, and none in `evaluate`."""
    tracks = pl.DataFrame(
        {"time_s": [0.0], "track": 1, "east_m": 0.0, "north_m": 0.0}
        | {"east_sigma_m": 1.0, "north_sigma_m": 1.0, "covariance_east_north_m2": 0.0}
    )
    truth = pl.DataFrame({"time_s": [0.0], "target": 1, "east_m": 0.0, "nort_m": 0.0})
    told = r'no column north_m .*: give truth_columns=\{"north_m": "nort_m"\}'
    with (
        pytest.raises(ValueError, match="must both have"),
        pytest.warns(tables.RecordWarning, match=told),
    ):
        tables.audit(tracks, truth=truth)
    with pytest.raises(tables.ColumnError, match=r"did you mean nort_m\?\); it has [^:]*$"):
        tables.evaluate(tracks, truth=truth)


@pytest.mark.parametrize("unit", ["m", "µs"])
def test_range_differences_in_another_unit(unit: str, recwarn: pytest.WarningsRecorder) -> None:
    rng = np.random.default_rng(55)
    places = np.array(list(PLACES.values()))
    rows = []
    for step in range(8):
        away = np.hypot(*(rng.uniform(0, 6e3, 2) - places).T)
        found = (away[1:] - away[0]) / (1.0 if unit == "m" else 299.792458)
        rows += [(float(step), name, x) for name, x in zip("BCD", found, strict=True)]
    table = pl.DataFrame(rows, schema=["time_s", "sensor", "range_difference_m"], orient="row")
    sensors = ROWS.with_columns(range_difference_sigma_m=pl.lit(10.0))
    tables.locate(table, sensors=sensors)
    told = [str(one.message) for one in recwarn if issubclass(one.category, tables.RecordWarning)]
    assert bool(told) == (unit == "µs")
    assert all("are they times?" in one and "is in metres" in one for one in told)


def test_a_plain_sequence_is_as_before() -> None:
    radar = Radar(range_sigma=50.0, azimuth_sigma=0.002, scan_period=4.0)
    time = np.arange(0.0, 100.0, 4.0)
    plots = pl.DataFrame({"time_s": time, "range_m": 50e3 + 200 * time, "azimuth_deg": 30.0})
    assert tables.track(plots, sensors=(radar,)).height == 25


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("azimut_bias_deg = 2", r"has no azimuth_bias_deg .did you mean azimut_bias_deg"),
        ("max_range = 60000", r"has no max_range_m .did you mean max_range."),
        ("max_range_km = 60", r"has no max_range_m; max_range_km is in another unit"),
        ("range_bias_sigma = 3", r"has no range_bias_sigma_m .did you mean range_bias_sigma"),
        ("trustd = true", r"has no trusted .did you mean trustd"),
    ],
)
def test_a_property_under_another_name_is_noticed(line: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "radars.toml"
    path.write_text(
        '[[radar]]\nname = "a"\neast_m = 0\nnorth_m = 0\nrange_sigma_m = 50\n'
        f"azimuth_sigma_deg = 0.1\nscan_period_s = 4\n{line}\n"
    )
    with pytest.warns(tables.RecordWarning, match=f"radars.toml: a {said}"):
        sensors_of(path)
