"""Files of every format, with every command: the same numbers, and one line per mistake."""

import gzip
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl
import pytest
from places import DATA, EXAMPLES
from terminal import indicators, run

import tertia
from tertia.fusion import fuse_series
from tertia.kalman import SingerModel
from tertia.location import Station, locate
from tertia.tracker import Plots, Radar, track
from tertia.trajectory import reconstruct

# how a table is written in each format, by others
WRITERS: dict[str, Callable[[pl.DataFrame, Path], object]] = {
    ".csv": lambda table, path: table.write_csv(path),
    ".csv.gz": lambda table, path: path.write_bytes(gzip.compress(table.write_csv().encode())),
    ".parquet": lambda table, path: table.write_parquet(path),
    ".arrow": lambda table, path: table.write_ipc(path),
    ".feather": lambda table, path: table.write_ipc(path, compression="zstd"),
    ".jsonl": lambda table, path: table.write_ndjson(path),
    ".jsonl.gz": lambda table, path: path.write_bytes(gzip.compress(table.write_ndjson().encode())),
}
READERS: dict[str, Callable[[Path], pl.DataFrame]] = {
    ".parquet": pl.read_parquet,
    ".arrow": pl.read_ipc,
    ".feather": pl.read_ipc,
    ".jsonl": lambda path: pl.read_ndjson(path, infer_schema_length=None),
    ".csv": lambda path: pl.read_csv(path, infer_schema_length=None),
    ".json": lambda path: pl.read_json(path, infer_schema_length=None),
}


class Command(NamedTuple):
    """A command on an example: what it reads, what else it is told, and a column of numbers."""

    name: str
    file: str
    options: tuple[object, ...]
    number: str


COMMANDS = {
    "bearing": Command("bearing", "bearings.csv", ("--by", "target"), "azimuth_deg"),
    "fuse-series": Command(
        "fuse-series",
        "radars.csv",
        ("--sigma", "0.1", "--alpha", "0", "--acceleration-sigma", "0"),
        "azimuth_deg",
    ),
    "locate": Command(
        "locate", "measurements.csv", ("--sensors", EXAMPLES / "stations.toml"), "azimuth_deg"
    ),
    "reconstruct": Command(
        "reconstruct",
        "measurements.csv",
        ("--sensors", EXAMPLES / "stations.toml", "--jerk", 0.1),
        "azimuth_deg",
    ),
    "track": Command(
        "track", "air_plots.csv", ("--sensors", EXAMPLES / "air_radars.toml"), "range_m"
    ),
    "evaluate": Command(
        "evaluate", "air_truth.csv", ("--truth", EXAMPLES / "air_truth.csv"), "east_m"
    ),
}
# writes a page, and no table
REPORT = Command("report", *COMMANDS["track"][1:])
every_command = pytest.mark.parametrize("command", COMMANDS.values(), ids=list(COMMANDS))


def table(command: Command) -> pl.DataFrame:
    """Return the first third of what the command reads, with numbers as numbers."""
    frame = pl.read_csv(EXAMPLES / command.file, infer_schema_length=None)
    frame = frame.filter(pl.col("time_s") < pl.col("time_s").max() / 3)
    if command.name != "evaluate":
        return frame
    few = frame["target"].unique(maintain_order=True)[:3].to_list()
    return frame.filter(pl.col("target").is_in(few)).rename({"target": "track"})


def results(path: Path, command: Command, folder: Path, suffix: str = ".parquet") -> pl.DataFrame:
    """Return what the command writes; the run must succeed."""
    output = folder / f"results{suffix}"
    done = run(command.name, path, *command.options, "--output", output)
    assert done.code == 0, done.err
    return READERS[suffix](output)


def alike(one: pl.DataFrame, other: pl.DataFrame, what: str) -> None:
    """Check that two tables hold the same numbers and the same text."""
    assert one.columns == other.columns, what
    assert one.height == other.height, what
    for name in one.columns:
        left, right = (
            frame[name].cast(pl.Float64, strict=False) if is_number else frame[name].cast(pl.String)
            for is_number in [other[name].dtype.is_numeric()]
            for frame in (one, other)
        )
        assert left.is_null().to_list() == right.is_null().to_list(), (what, name)
        if left.dtype == pl.Float64:
            np.testing.assert_array_equal(left.drop_nulls(), right.drop_nulls(), f"{what} {name}")
        else:
            assert left.to_list() == right.to_list(), (what, name)


@every_command
def test_every_format_gives_the_same_numbers(command: Command, tmp_path: Path) -> None:
    found = {}
    for suffix, write in WRITERS.items():
        path = tmp_path / f"in[1]{suffix}"
        write(table(command), path)
        found[suffix] = results(path, command, tmp_path)
    assert found[".csv"].height > 1
    for suffix, one in found.items():
        alike(one, found[".parquet"], suffix)


@every_command
def test_every_format_is_written(command: Command, tmp_path: Path) -> None:
    path = tmp_path / "in.parquet"
    table(command).write_parquet(path)
    whole = results(path, command, tmp_path)
    for suffix in READERS:
        alike(results(path, command, tmp_path, suffix), whole, suffix)


# ------------------------------------------------------------------------------------------------
# mistakes


def folder_of(path: Path) -> list[str]:
    return sorted(str(one) for one in path.rglob("*"))


def fails(folder: Path, *arguments: object) -> tuple[int, str]:
    """Run a command that must fail with one line, and leave nothing behind."""
    before = folder_of(folder)
    done = run(*arguments)
    assert done.code in {1, 2}
    assert done.out == ""
    assert re.fullmatch(r"tertia: .*\n", done.err), done.err
    assert folder_of(folder) == before
    return done.code, done.err


def as_text(command: Command) -> pl.DataFrame:
    return table(command).with_columns(pl.all().cast(pl.String))


def spoil(name: str, command: Command, path: Path) -> Path:
    """Write what the command reads with a mistake in it."""
    frame, number = table(command), command.number
    path = path / f"in{name[name.index('.') :]}"
    kind = name.partition(".")[0]
    if kind == "column":
        # the only range, angle or place
        measured = [one for one in frame.columns if one.endswith(("_m", "_deg")) or one == number]
        frame = frame.drop(measured)
        WRITERS[path.suffix](frame, path)
    elif kind == "text":
        frame = as_text(command)
        cells = frame[number].to_list()
        frame = frame.with_columns(pl.Series(number, [*cells[:2], "about 12", *cells[3:]]))
        WRITERS[path.suffix](frame, path)
    elif kind == "header":
        WRITERS[path.suffix](frame.clear(), path)
    elif kind == "empty":
        path.write_bytes(b"")
    elif kind == "cut":
        WRITERS[path.suffix](frame, path)
        contents = path.read_bytes()
        path.write_bytes(contents[: len(contents) // 2])
    elif kind == "broken":
        lines = frame.write_ndjson().splitlines()
        path.write_text("\n".join([*lines[:3], lines[3][:-5], *lines[4:]]), encoding="utf-8")
    elif kind == "folder":
        path.mkdir()
    else:
        assert kind == "absent"
    return path


MISTAKES = {
    "column.csv": (2, "has no column"),
    "column.arrow": (2, "has no column"),
    "column.jsonl": (2, "has no column"),
    "text.csv": (1, r"line 4: \w+ is 'about 12'; it must be a finite number"),
    "text.parquet": (1, r"row 3: \w+ is 'about 12'; it must be a finite number"),
    "text.jsonl": (1, r"line 3: \w+ is 'about 12'; it must be a finite number"),
    "header.csv": (1, "is empty"),
    "header.parquet": (1, "is empty"),
    "header.arrow": (1, "is empty"),
    "empty.csv": (1, "is empty"),
    "empty.parquet": (1, "is empty"),
    "empty.feather": (1, "is empty"),
    "empty.jsonl": (1, "is empty"),
    "cut.parquet": (1, "cannot read .*: it is not in Parquet format, or is cut off"),
    "cut.arrow": (1, "cannot read .*: it is not in Arrow IPC format, or is cut off"),
    "broken.jsonl": (1, "line 4: each line must be a JSON object with the columns"),
    "folder.csv": (1, "cannot read .*: it is a folder"),
    "folder.arrow": (1, "cannot read .*: it is a folder"),
    "absent.csv": (2, "there is no file"),
    "absent.jsonl": (2, "there is no file"),
    "absent.json": (1, "tables are read from CSV, Parquet, Arrow or JSON lines"),
}


@pytest.mark.parametrize("command", [*COMMANDS.values(), REPORT], ids=[*COMMANDS, "report"])
@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_in_files(mistake: str, command: Command, tmp_path: Path) -> None:
    path = spoil(mistake, command, tmp_path)
    output = tmp_path / ("out.html" if command is REPORT else "out.csv")
    code, err = fails(tmp_path, command.name, path, *command.options, "--output", output)
    expected, message = MISTAKES[mistake]
    assert code == expected
    assert re.search(message, err), err


@every_command
@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("absent/out.csv", "cannot write .*: No such file or directory"),
        ("taken.csv", "cannot write .*: Is a directory"),
        ("out.xlsx", "cannot write .*: its name must end in .csv, .json, .parquet, .arrow"),
    ],
)
def test_results_that_cannot_be_written(
    name: str, message: str, command: Command, tmp_path: Path
) -> None:
    path = tmp_path / "in.csv"
    table(command).write_csv(path)
    (tmp_path / "taken.csv").mkdir()
    _, err = fails(tmp_path, command.name, path, *command.options, "--output", tmp_path / name)
    assert re.search(message, err), err


@every_command
def test_permissions(command: Command, tmp_path: Path) -> None:
    path, closed = tmp_path / "in.csv", tmp_path / "closed"
    path.touch(mode=0)
    if os.access(path, os.R_OK):
        pytest.skip("root may do all")
    path.chmod(0o600)
    table(command).write_csv(path)
    closed.mkdir(mode=0o500)
    output = closed / "out.csv"
    done = run(command.name, path, *command.options, "--output", output)
    assert (done.code, done.err) == (1, f"tertia: cannot write {output}: Permission denied\n")
    path.chmod(0)
    _, err = fails(tmp_path, command.name, path, *command.options)
    assert "cannot read" in err


@pytest.mark.parametrize(
    ("command", "option"),
    [("locate", "--sensors"), ("track", "--sensors"), ("evaluate", "--truth")],
)
@pytest.mark.parametrize("mistake", ["cut.parquet", "cut.arrow", "empty.jsonl", "folder.csv"])
def test_mistakes_in_the_other_file(
    mistake: str, command: str, option: str, tmp_path: Path
) -> None:
    path = spoil(mistake, COMMANDS[command], tmp_path)
    file = tmp_path / "first.csv"
    table(COMMANDS[command]).write_csv(file)
    _, err = fails(tmp_path, command, file, option, path)
    assert re.search(MISTAKES[mistake][1], err), err


@pytest.mark.parametrize("command", ["locate", "reconstruct", "track"])
def test_radians_are_suspected_in_every_format(command: str, tmp_path: Path) -> None:
    one = COMMANDS[command]
    frame = table(one).with_columns(pl.col("azimuth_deg").radians())
    for suffix in (".csv", ".arrow", ".jsonl"):
        path = tmp_path / f"in{suffix}"
        WRITERS[suffix](frame, path)
        assert "are they radians? Use degrees" in run(one.name, path, *one.options).err


@pytest.mark.parametrize("command", [name for name in COMMANDS if name != "track"])
def test_asterix_is_for_tracks(command: str, tmp_path: Path) -> None:
    path = tmp_path / "in.ast"
    path.write_bytes(b"\x30\x00\x04\x00")
    one = COMMANDS[command]
    _, err = fails(tmp_path, one.name, path, *one.options)
    assert "only tertia track, report and audit read ASTERIX, " in err


# ------------------------------------------------------------------------------------------------
# real recordings

real = pytest.mark.skipif(not (DATA / "difar").is_dir(), reason="the recordings are not here")
FORMATS = (".csv", ".parquet", ".arrow", ".jsonl")


def in_every_format(frame: pl.DataFrame, folder: Path, name: str, *options: object) -> pl.DataFrame:
    """Return what a command makes of a recording, the same from each format."""
    command = Command(name, "", options, "")
    found = {}
    for suffix in FORMATS:
        path = folder / f"in{suffix}"
        WRITERS[suffix](frame, path)
        found[suffix] = results(path, command, folder, ".parquet")
        alike(found[suffix], found[".csv"], suffix)
    return found[".parquet"]


@real
def test_bearings_of_a_real_recording(tmp_path: Path) -> None:
    frame = pl.read_csv(DATA / "difar" / "bearings.csv", infer_schema_length=None)
    frame = frame.select("buoy", azimuth_deg=pl.col("bearing_deg").fill_nan(None))
    found = in_every_format(frame, tmp_path, "bearing", "--by", "buoy")
    assert found.height == 4
    for row in found.iter_rows(named=True):
        theta = frame.filter(pl.col("buoy") == row["buoy"])["azimuth_deg"].fill_null(np.nan)
        one = tertia.estimate_bearing(theta.to_numpy(), nan_policy="omit")
        assert (row["azimuth_deg"], row["azimuth_sigma_deg"]) == (one.value, one.sigma)


@real
def test_one_aircraft_fused_from_a_real_recording(tmp_path: Path) -> None:
    """Every other scan of a radar for each of two sensors."""
    plots = pl.read_csv(DATA / "lebl_radar" / "plots_0800_0830.csv.gz", infer_schema_length=None)
    [(address, _)] = plots["icao24"].drop_nulls().value_counts(sort=True).head(1).rows()
    own = plots.filter(pl.col("icao24") == address).sort("tod_s").unique("tod_s", keep="first")
    own = own.sort("tod_s")
    frame = own.select(
        "tod_s", "theta_deg", sensor=pl.Series(["even", "odd"] * own.height)[: own.height]
    )
    options = ("--column", "azimuth_deg=theta_deg", "--column", "time_s=tod_s")
    noise = ("--sigma", 0.08, "--alpha", 0.02, "--acceleration-sigma", 0.002)
    found = in_every_format(frame, tmp_path, "fuse-series", *options, *noise)
    z = np.full((2, own.height), np.nan)
    for k in range(2):
        z[k, k::2] = own["theta_deg"].to_numpy()[k::2]
    model = SingerModel(1.0, 0.02, 0.002, exact=True)
    expected = fuse_series(z, 0.08**2, model, time=own["tod_s"].to_numpy(), period=360.0)
    np.testing.assert_allclose(found["azimuth_deg"], expected.mean[:, 0], rtol=1e-12)


def towers() -> tuple[pl.DataFrame, list[Station]]:
    """Return bearings of an animal from three towers along some days, and the towers."""
    lenth = DATA / "lenth"
    rows = []
    for at, line in enumerate((lenth / "azimuth.dat").read_text().splitlines()[:60]):
        for word in re.findall(r"(\d) +(\d+)", line[22:]):
            rows.append((600.0 * at, word[0], float(word[1])))
    places = [
        list(map(float, filter(None, line.split(","))))
        for line in (lenth / "towers.dat").read_text().split()
    ]
    stations = [
        Station(
            np.subtract(places[int(name) - 1], places[0]), name=name, azimuth_sigma=np.radians(3.0)
        )
        for name in "678"
    ]
    return pl.DataFrame(rows, ["time_s", "sensor", "azimuth_deg"], orient="row"), stations


@real
@pytest.mark.parametrize("command", ["locate", "reconstruct"])
def test_an_animal_of_a_real_recording(command: str, tmp_path: Path) -> None:
    frame, stations = towers()
    sites = pl.DataFrame(
        {
            "name": [one.name for one in stations],
            "east_m": [one.position[0] for one in stations],
            "north_m": [one.position[1] for one in stations],
            "azimuth_sigma_deg": [3.0] * 3,
        }
    )
    sites.write_ndjson(tmp_path / "towers.jsonl")
    found = in_every_format(frame, tmp_path, command, "--sensors", tmp_path / "towers.jsonl")
    wide = frame.pivot("sensor", index="time_s", values="azimuth_deg").sort("time_s")
    azimuth = np.radians(wide.select("6", "7", "8").fill_null(np.nan).to_numpy())
    if command == "locate":
        position = locate(stations, azimuth=azimuth).position
    else:
        position = reconstruct(stations, wide["time_s"].to_numpy(), azimuth=azimuth).position
    assert found.height == len(position) == 60
    told = found.select("east_m", "north_m").fill_null(np.nan).to_numpy()
    assert np.isfinite(told).mean() > 0.9
    np.testing.assert_allclose(told, position, rtol=1e-9, atol=1e-6)


@real
def test_tracks_of_a_real_recording_and_their_figures(tmp_path: Path) -> None:
    plots = pl.read_csv(DATA / "lebl_radar" / "plots_0800_0830.csv.gz", infer_schema_length=None)
    plots = plots[:6000].select(
        time_s="tod_s", range_nm="rho_nm", azimuth_deg="theta_deg", icao_address="icao24"
    )
    sites = pl.DataFrame(
        {
            "name": ["lebl"],
            "east_m": [0.0],
            "north_m": [0.0],
            "range_sigma_m": [50.0],
            "azimuth_sigma_deg": [0.08],
            "scan_period_s": [4.0],
        }
    )
    sites.write_ipc(tmp_path / "radars.arrow")
    found = in_every_format(plots, tmp_path, "track", "--sensors", tmp_path / "radars.arrow")
    radar = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0)
    identity = plots["icao_address"].str.to_integer(base=16, strict=False).fill_null(-1).to_numpy()
    seen = Plots(
        plots["time_s"],
        plots["range_nm"] * 1852.0,
        np.radians(plots["azimuth_deg"]),
        icao_address=identity,
    )
    expected = track(seen, [radar])
    np.testing.assert_array_equal(found.select("east_m", "north_m").to_numpy(), expected.position)
    # the plots themselves are a truth with errors, but one from outside the tracker
    position, _ = seen.to_cartesian([radar])
    there = plots.with_columns(east_m=position[:, 0], north_m=position[:, 1])
    there = there.rename({"icao_address": "target"}).drop_nulls("target")
    there = there.unique(["time_s", "target"], keep="first", maintain_order=True)
    truth = there.select("time_s", "target", "east_m", "north_m")
    truth.write_ipc(tmp_path / "truth.feather")
    told = in_every_format(
        found, tmp_path, "evaluate", "--truth", tmp_path / "truth.feather", "--update-interval", 4
    )
    figures = indicators(found, truth, max_distance=1000.0, update_interval=4.0)
    values = dict(told.select("figure", "value").rows())
    assert values["targets"] == len(figures.matching.targets)
    assert values["probability of update"] == figures.probability_of_update.value > 0.9
    assert values["RMSE"] == figures.rmse.value < 100.0


def test_each_file_has_names_of_its_own(tmp_path: Path) -> None:
    """A file without a named column has the usual one, and may have the name of its sensor."""
    time = np.arange(0.0, 60.0, 4.0)
    east, north = 20e3 + 100.0 * time, np.full(time.shape, 30e3)
    radar = pl.DataFrame(
        {
            "Time [s]": time,
            "range_m": np.hypot(east, north),
            "azimuth_deg": np.degrees(np.arctan2(east, north)),
        }
    )
    radar.write_csv(tmp_path / "radar.csv")
    pl.DataFrame({"t": time + 1.0, "x": east + 100.0, "north_m": north}).write_csv(
        tmp_path / "adsb.csv"
    )
    sensors = tmp_path / "sensors.toml"
    sensors.write_text(
        "[[radar]]\nname='radar'\neast_m=0.0\nnorth_m=0.0\nrange_sigma_m=20.0\n"
        "azimuth_sigma_deg=0.1\nscan_period_s=4.0\n"
        "[[position_sensor]]\nname='adsb'\nposition_sigma_m=20.0\nupdate_interval_s=4.0\n"
    )
    files = tmp_path / "radar.csv", tmp_path / "adsb.csv"
    how = "--sensors", sensors, "--column", "time_s=t", "--column", "east_m=x"
    done = run("track", *files, *how, "--output", tmp_path / "tracks.csv")
    assert done.code == 0, done.err
    tracks = pl.read_csv(tmp_path / "tracks.csv")
    assert tracks["track"].unique().to_list() == [1]
    assert set(tracks["sensor"].unique()) == {"radar", "adsb"}
    # a name that no file has is an error
    wrong = run("track", *files, *how[:2], "--column", "time_s=nothing")
    assert wrong.code == 2
    assert "has no column nothing" in wrong.err


def test_warnings_of_the_library_are_notes(tmp_path: Path) -> None:
    pl.DataFrame(
        {"sensor": ["A", "B", "A", "B"], "fox": [1, 1, 2, 2], "azimuth_deg": [30.0, 20, 30, 20]}
    ).write_csv(tmp_path / "bearings.csv")
    pl.DataFrame({"name": ["A", "B"], "east_m": [0.0, 200.0], "north_m": 0.0}).write_csv(
        tmp_path / "towers.csv"
    )
    how = "--sensors", tmp_path / "towers.csv", "--by", "fox", "--method", "posterior"
    done = run("locate", tmp_path / "bearings.csv", *how, "--max-range", 500)
    assert done.code == 0, done.err
    [line] = done.err.splitlines()
    assert line.startswith("1 of 1 positions have more than 5%")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes")
@pytest.mark.parametrize("command", [("smooth", "--sigma", "1"), ("bearing",)])
def test_pipes_are_refused(command: tuple[str, ...], tmp_path: Path) -> None:
    """A pipe can be read only once."""
    os.mkfifo(tmp_path / "pipe.csv")
    for path in ("-", tmp_path / "pipe.csv"):
        done = run(*command, path)
        assert done.code == 2
        assert "standard input or a pipe; only tertia track --stream" in done.err
