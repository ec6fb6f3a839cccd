"""The command `tertia locate`: numbers equal to those of the library, one clear line per error."""

import datetime
import errno
import re
import runpy
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt
import polars as pl
import pytest
import terminal
from places import EXAMPLES
from pyproj import Geod
from terminal import Write, assert_column, covariance_of, table

from tertia import metrics, simulate
from tertia.cli.files import write as writing
from tertia.geo import LocalFrame
from tertia.location import Location, LocationStatus, Station, locate
from tertia.tables import _sensors

run = partial(terminal.run, "locate")
positions = partial(terminal.result, "locate")

NAN = float("nan")
AXES = ("east", "north", "up")
KINDS = {"range": "m", "azimuth": "deg", "elevation": "deg", "range_difference": "m"}
UNIT = {kind: np.pi / 180 if unit == "deg" else 1.0 for kind, unit in KINDS.items()}

PLACES = {
    "A": (0.0, 0.0, 10.0),
    "B": (3000.0, 0.0, 0.0),
    "C": (0.0, 4000.0, 20.0),
    "D": (3000.0, 4000.0, 5.0),
}
SIGMA = {"range": 10.0, "azimuth": 0.3, "elevation": 0.2}
NAMES = list(PLACES)
STEPS = 25
TIMES = 2.0 * np.arange(STEPS)

FloatArray = npt.NDArray[np.float64]
Values = dict[str, FloatArray]


def sites(places: dict[str, Any] = PLACES, sigma: dict[str, float] = SIGMA) -> list[Station]:
    told = {f"{kind}_sigma": value * UNIT[kind] for kind, value in sigma.items()}
    return [Station(place, name=name, **told) for name, place in places.items()]


def truth() -> FloatArray:
    return np.column_stack([500 + 20 * TIMES, 1500 + 10 * TIMES, 400 + 0 * TIMES])


def recording(seed: int = 5) -> Values:
    """Return measurements in the units of files, (steps, K), some missing, some faults."""
    found = simulate.stations(
        sites(), truth(), outlier_probability=0.04, missing_probability=0.1, rng=seed
    ).measurements
    return {kind: np.round(values / UNIT[kind], 4) for kind, values in found.items()}


Z = recording()


def wide(values: Values = Z, extra: str = "", names: list[str] = NAMES) -> list[str]:
    steps = len(next(iter(values.values())))
    return terminal.wide(TIMES[:steps], names, values, extra)


def long(values: Values = Z) -> list[str]:
    return [
        f"{TIMES[i]},{name},{kind},{terminal.cell(v[i, k])}"
        for kind, v in values.items()
        for k, name in enumerate(NAMES)
        for i in range(STEPS)
    ]


WIDE = "time_s,sensor,range_m,azimuth_deg,elevation_deg"
LONG = "time_s,sensor,kind,value"


def station_lines(
    places: dict[str, Any] = PLACES, sigma: dict[str, float] = SIGMA
) -> tuple[str, list[str]]:
    axes = AXES[: len(next(iter(places.values())))]
    header = ["name", *(f"{a}_m" for a in axes), *(f"{k}_sigma_{KINDS[k]}" for k in sigma)]
    rows = [",".join(map(str, [name, *place, *sigma.values()])) for name, place in places.items()]
    return ",".join(header), rows


def as_toml(header: str, rows: list[str]) -> str:
    tables = [
        "".join(
            f'{key} = "{value}"\n' if key == "name" else f"{key} = {value}\n"
            for key, value in zip(header.split(","), row.split(","), strict=True)
        )
        for row in rows
    ]
    return "".join(f"[[station]]\n{table}" for table in tables)


@pytest.fixture
def write(tmp_path: Path) -> Write:
    return terminal.writer(tmp_path, WIDE, "m.csv")


@pytest.fixture
def stations(write: Write) -> Path:
    header, rows = station_lines()
    return write(rows, header, "stations.csv")


def located(values: Values = Z, **options: Any) -> Location:
    measured = {kind: v * UNIT[kind] for kind, v in values.items()}
    return locate(sites(), **measured, **options)


def faults_of(result: Location, step: int) -> list[str]:
    """Return the names of the faults of an instant."""
    return [
        f"{NAMES[k + (kind == 'range_difference')]} {kind}"
        for kind in KINDS
        if (marks := getattr(result.outlier, kind)) is not None
        for k in np.flatnonzero(marks[step])
    ]


def check(frame: pl.DataFrame, result: Location) -> None:
    """Check every column of a table of positions but the time."""
    d = result.position.shape[1]
    for i, axis in enumerate(AXES[:d]):
        assert_column(frame[f"{axis}_m"], result.position[:, i])
        assert_column(frame[f"{axis}_sigma_m"], result.sigma[:, i])
        for j in range(i):
            assert_column(frame[f"covariance_{AXES[j]}_{axis}_m2"], result.covariance[:, j, i])
    problems = np.asarray(result.status)
    assert_column(frame["degrees_of_freedom"], np.where(problems, NAN, result.degrees_of_freedom))
    assert_column(frame["outlier_count"], np.where(problems, NAN, result.outlier.count))
    assert_column(frame["pvalue"], result.pvalue)
    reasons = [LocationStatus(p).message if p else None for p in problems]
    assert frame["status"].to_list() == reasons
    for step, told in enumerate(frame["outlier_measurement"]):
        assert sorted(told.split("; ") if told else []) == sorted(faults_of(result, step))


def test_positions_are_those_of_the_library(write: Write, stations: Path, tmp_path: Path) -> None:
    frame = positions(write(wide()), "--sensors", stations, folder=tmp_path)
    assert frame.columns == [
        *("time_s", "east_m", "east_sigma_m", "north_m", "north_sigma_m", "up_m", "up_sigma_m"),
        *("covariance_east_north_m2", "covariance_east_up_m2", "covariance_north_up_m2"),
        *("measurement_count", "degrees_of_freedom", "pvalue", "outlier_count"),
        *("outlier_measurement", "status"),
    ]
    assert frame["time_s"].to_list() == TIMES.tolist()
    result = located()
    assert np.sum(result.outlier.count) > 3
    check(frame, result)
    counts = sum(np.count_nonzero(~np.isnan(v), axis=1) for v in Z.values())
    assert frame["measurement_count"].to_list() == list(counts)


def test_one_row_per_measurement_in_any_order(write: Write, stations: Path, tmp_path: Path) -> None:
    rows = long()
    np.random.default_rng(0).shuffle(rows)
    frame = positions(write(rows, LONG), "--sensors", stations, folder=tmp_path)
    check(frame, located())


@pytest.mark.parametrize("method", ["robust", "least-squares"])
def test_methods(method: Any, write: Write, stations: Path, tmp_path: Path) -> None:
    path = write(wide())
    frame = positions(path, "--sensors", stations, "--method", method, folder=tmp_path)
    check(frame, located(method=method))


@pytest.mark.parametrize("method", ["robust", "lenth-mle", "lenth-huber", "lenth-andrews"])
def test_bearings_in_the_plane(method: Any, write: Write, tmp_path: Path) -> None:
    places = {name: place[:2] for name, place in PLACES.items()}
    header, rows = station_lines(places, {"azimuth": 0.3})
    stations = write(rows, header, "plane.csv")
    path = write(wide({"azimuth": Z["azimuth"]}), "time_s,sensor,azimuth_deg")
    frame = positions(path, "--sensors", stations, "--method", method, folder=tmp_path)
    assert "up_m" not in frame.columns
    plane = sites(places, {"azimuth": 0.3})
    check(frame, locate(plane, azimuth=np.radians(Z["azimuth"]), method=method))


def test_a_sigma_that_nobody_states_is_estimated(write: Write, tmp_path: Path) -> None:
    places = {name: place[:2] for name, place in PLACES.items()}
    header, rows = station_lines(places, {})
    stations = write(rows, header, "plane.csv")
    path = write(wide({"azimuth": Z["azimuth"]}), "time_s,sensor,azimuth_deg")
    result = locate(list(places.values()), azimuth=np.radians(Z["azimuth"]))
    check(positions(path, "--sensors", stations, folder=tmp_path), result)
    sigma = np.degrees(np.asarray(result.measurement_sigma))
    told = f"estimated at each instant, median {np.median(sigma[np.isfinite(sigma)]):.3g} deg"
    assert told in run(path, "--sensors", stations).out


def test_a_sigma_per_measurement_goes_before_that_of_the_station(
    write: Write, stations: Path, tmp_path: Path
) -> None:
    own = np.where(np.arange(STEPS * 4).reshape(STEPS, 4) % 3, NAN, 25.0)
    columns = Z | {"range_sigma": own}
    path = write(wide(columns), WIDE + ",range_sigma_m")
    sigma = np.where(np.isnan(own), 10.0, own)
    check(positions(path, "--sensors", stations, folder=tmp_path), located(range_sigma=sigma))
    rows = [line + ",25" if ",range," in line else line + "," for line in long()]
    frame = positions(write(rows, LONG + ",sigma"), "--sensors", stations, folder=tmp_path)
    check(frame, located(range_sigma=25.0))


@pytest.mark.parametrize("form", ["wide", "long"])
def test_range_differences(form: str, write: Write, tmp_path: Path) -> None:
    distance = np.linalg.norm(truth()[:, np.newaxis] - list(PLACES.values()), axis=-1)
    noise = 3 * np.random.default_rng(2).standard_normal((STEPS, 4))
    values = (distance - distance[:, :1] + noise).round(3)
    values[:, 0] = NAN
    angles = {"azimuth": 0.3, "elevation": 0.2}
    measured = {kind: Z[kind] for kind in angles} | {"range_difference": values}
    header, rows = station_lines(sigma=angles)
    told = [f"{row},{sigma}" for row, sigma in zip(rows, ("", 3.0, 4.0, 5.0), strict=True)]
    stations = write(told, header + ",range_difference_sigma_m", "stations.csv")
    lines = wide(measured) if form == "wide" else long(measured)
    wanted = "time_s,sensor,azimuth_deg,elevation_deg,range_difference_m"
    head = wanted if form == "wide" else LONG
    frame = positions(write(lines, head), "--sensors", stations, folder=tmp_path)
    result = locate(
        sites(sigma=angles),
        azimuth=np.radians(Z["azimuth"]),
        elevation=np.radians(Z["elevation"]),
        range_difference=values[:, 1:],
        range_difference_sigma=[3.0, 4.0, 5.0],
    )
    assert np.all(result.success)
    check(frame, result)
    summary = table(run(tmp_path / "m.csv", "--sensors", stations).out)
    assert ["A", "range_difference"] not in [row[:2] for row in summary]


def test_initial_decides(write: Write, tmp_path: Path) -> None:
    stations = write(["A,0,0,5", "B,1000,0,5"], "name,east_m,north_m,range_sigma_m", "two.csv")
    path = write(["0,A,800", "0,B,700"], "time_s,sensor,range_m")
    places, ranges = [[0.0, 0.0], [1000.0, 0.0]], [800.0, 700.0]
    done = run(path, "--sensors", stations)
    assert done.code == 1
    assert "0 of 1 instant located\n" in done.out
    assert f"1 instant not located: {LocationStatus.AMBIGUOUS.message}" in done.out
    for north in (500, -500):
        arguments = (path, "--sensors", stations, "--initial", f"600,{north}")
        frame = positions(*arguments, folder=tmp_path)
        fix = locate(places, range=ranges, range_sigma=5.0, initial=[600.0, north])
        assert frame.select("east_m", "north_m").row(0) == tuple(fix.position)
        assert frame["pvalue"].to_list() == [None if np.isnan(fix.pvalue) else fix.pvalue]


@pytest.mark.parametrize("suffix", ["toml", "csv", "parquet"])
def test_files_of_stations(suffix: str, write: Write, tmp_path: Path) -> None:
    path = tmp_path / f"s.{suffix}"
    header, rows = station_lines()
    if suffix == "csv":
        write([*rows, ""], header + ",remark", path.name)
        path.write_text(path.read_text().replace("A,0.0", " A ,0.0").replace("20.0", "20.0 "))
    elif suffix == "toml":
        path.write_text(as_toml(header, rows), encoding="utf-8")
    else:
        told = [row.split(",") for row in rows]
        names = [row[0] for row in told]
        numbers = np.array([row[1:] for row in told], dtype=np.float64).T
        columns = dict(zip(header.split(","), [names, *numbers], strict=True))
        pl.DataFrame(columns).write_parquet(path)
    check(positions(write(wide()), "--sensors", path, folder=tmp_path), located())


# latitude, longitude, height
EARTH = {
    "A": (50.1, 14.3, 350.0),
    "B": (50.55, 14.9, 410.0),
    "C": (49.8, 15.2, 520.0),
    "D": (50.3, 13.6, 280.0),
}
GEODETIC = ("latitude_deg", "longitude_deg", "height_m")
ORIGIN = (50.2, 14.5, 100.0)
TARGET = (50.05, 14.75)


def earth_lines(sigma: dict[str, float], d: int = 3) -> tuple[str, list[str]]:
    header = ["name", *GEODETIC[:d], *(f"{kind}_sigma_{KINDS[kind]}" for kind in sigma)]
    rows = [
        ",".join(map(str, [name, *place[:d], *sigma.values()])) for name, place in EARTH.items()
    ]
    return ",".join(header), rows


def origin_table(origin: tuple[float, ...]) -> str:
    told = zip(GEODETIC, origin, strict=False)
    return "[origin]\n" + "".join(f"{key} = {value}\n" for key, value in told)


def on_the_earth(frame: LocalFrame) -> list[Station]:
    told: dict[str, Any] = {f"{kind}_sigma": value * UNIT[kind] for kind, value in SIGMA.items()}
    return [frame.station(*place, name=name, **told) for name, place in EARTH.items()]


@pytest.mark.parametrize("suffix", ["csv", "toml"])
def test_latitude_and_longitude_in_space(suffix: str, write: Write, tmp_path: Path) -> None:
    header, rows = earth_lines(SIGMA)
    if suffix == "csv":
        stations, frame = write(rows, header, "earth.csv"), LocalFrame(*EARTH["A"])
        told = "latitude 50.1, longitude 14.3, height 350 m"
    else:
        stations, frame = tmp_path / "earth.toml", LocalFrame(*ORIGIN)
        stations.write_text(as_toml(header, rows) + origin_table(ORIGIN), encoding="utf-8")
        told = "latitude 50.2, longitude 14.5, height 100 m"
    known = on_the_earth(frame)
    track = np.linspace([50.0, 14.6, 9000.0], [50.1, 14.9, 9500.0], STEPS)
    measured = simulate.stations(
        known, frame.to_local(*track.T), outlier_probability=0.04, missing_probability=0.1, rng=3
    ).measurements
    values = {kind: np.round(v / UNIT[kind], 4) for kind, v in measured.items()}
    path = write(wide(values))
    found = positions(path, "--sensors", stations, folder=tmp_path)
    assert found.columns[5:11] == [
        *("up_m", "up_sigma_m", *GEODETIC, "covariance_east_north_m2"),
    ]
    result = locate(known, **{kind: v * UNIT[kind] for kind, v in values.items()})
    check(found, result)
    for column, expected in zip(GEODETIC, frame.to_geodetic(result.position), strict=True):
        assert_column(found[column], expected)
    error = found.select(GEODETIC).to_numpy() - track
    assert np.nanmax(np.abs(error) @ np.diag([111e3, 72e3, 1.0])) < 120
    done = run(path, "--sensors", stations)
    assert f"\norigin of east, north and up: {told}\n" in done.out


def geodesics() -> tuple[FloatArray, FloatArray]:
    """Return azimuths in degrees and distances in metres from the stations to the target."""
    latitude, longitude, _ = np.array(list(EARTH.values())).T
    there = np.full(4, TARGET[1]), np.full(4, TARGET[0])
    azimuth, _, distance = Geod(ellps="WGS84").inv(longitude, latitude, *there)
    return np.asarray(azimuth), np.asarray(distance)


@pytest.mark.parametrize("kind", ["azimuth", "range"])
@pytest.mark.parametrize("origin", [None, ORIGIN[:2]])
def test_latitude_and_longitude_in_the_plane(
    kind: str, origin: tuple[float, ...] | None, write: Write, tmp_path: Path
) -> None:
    sigma = {"azimuth": 0.01, "range": 3.0}
    header, rows = earth_lines({kind: sigma[kind]}, d=2)
    stations = write(rows, header, "earth.csv")
    if origin is not None:
        stations = tmp_path / "earth.toml"
        stations.write_text(as_toml(header, rows) + origin_table(origin), encoding="utf-8")
    measured = dict(zip(("azimuth", "range"), geodesics(), strict=True))[kind]
    path = write(wide({kind: measured[np.newaxis]}), f"time_s,sensor,{kind}_{KINDS[kind]}")
    picture = tmp_path / "p.png"
    frame = positions(path, "--sensors", stations, "--plot", picture, folder=tmp_path)
    assert frame.columns[1:8] == [
        *("east_m", "east_sigma_m", "north_m", "north_sigma_m", "latitude_deg", "longitude_deg"),
        "covariance_east_north_m2",
    ]
    [row] = frame.to_dicts()
    assert row["outlier_count"] == 0
    _, _, error = Geod(ellps="WGS84").inv(*TARGET[::-1], row["longitude_deg"], row["latitude_deg"])
    # without the north of each station it would be 270 m
    assert error < 0.5
    place = "latitude 50.2, longitude 14.5" if origin else "latitude 50.1, longitude 14.3"
    assert f"\norigin of east and north: {place}\n" in run(path, "--sensors", stations).out


@pytest.mark.parametrize(("reach", "angle", "length"), [(100e3, 0.004, 4.0), (300e3, 0.04, 100.0)])
@pytest.mark.parametrize("latitude", [0.0, 50.0, 75.0])
def test_what_the_page_says_a_plane_costs(
    latitude: float, reach: float, angle: float, length: float
) -> None:
    rng = np.random.default_rng(0)
    distance, bearing = reach * np.sqrt(rng.uniform(size=400)), rng.uniform(0, 360, 400)
    there = np.full(400, 14.0), np.full(400, latitude)
    east, north, _ = Geod(ellps="WGS84").fwd(*there, bearing, distance)
    corners = {
        str(k): {"latitude_deg": y, "longitude_deg": x}
        for k, (x, y) in enumerate(zip(east, north, strict=True))
    }
    start = {"latitude_deg": latitude, "longitude_deg": 14.0}
    plane, space = (
        _sensors.stations([{"name": k} | row | height for k, row in corners.items()], origin=start)
        for height in ({}, {"height_m": 0.0})
    )
    measured = []
    for found in (plane, space):
        place = np.array([one.position for one in found.items])
        axes = np.array([one.axes for one in found.items])
        # from each place to the next
        offset = np.roll(place, -1, axis=0) - place
        own = np.einsum("kij,kj->ki", axes, offset)
        measured.append((np.arctan2(own[:, 0], own[:, 1]), np.linalg.norm(offset, axis=1)))
    (azimuths, ranges), (true_azimuths, true_ranges) = measured
    turned = np.degrees(np.abs(np.angle(np.exp(1j * (azimuths - true_azimuths)))))
    assert angle / 3 < np.max(turned) < angle
    assert length / 3 < np.max(np.abs(ranges - true_ranges)) < length


def test_positions_that_are_none_on_the_earth() -> None:
    found = _sensors.stations([{"name": "A", "latitude_deg": 50.0, "longitude_deg": 14.0}])
    told = found.geodetic(np.array([[0.0, 0.0], [1e7, 0.0], [NAN, NAN]]))
    assert list(told) == ["latitude_deg", "longitude_deg"]
    assert told["latitude_deg"].to_list() == [pytest.approx(50.0, abs=1e-9), None, None]
    assert told["longitude_deg"].to_list() == [pytest.approx(14.0, abs=1e-9), None, None]


def test_stations_in_metres_have_no_origin(write: Write, stations: Path) -> None:
    assert "origin" not in run(write(wide()), "--sensors", stations).out


def test_extra_geo_is_asked_for(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    stations = write(["A,50,14,1"], "name,latitude_deg,longitude_deg,range_sigma_m", "earth.csv")
    monkeypatch.setattr(_sensors, "find_spec", lambda name: None)
    told = f"tertia: {stations}: latitude_deg needs the extra geo: pip install 'tertia[geo]'\n"
    assert run(write(wide()), "--sensors", stations) == (1, "", told)


def test_times_of_iso_8601_parquet_and_other_names(
    write: Write, stations: Path, tmp_path: Path
) -> None:
    start = datetime.datetime(2026, 3, 1, 23, 59, 50)
    rows = [line.split(",", 1) for line in wide()]
    dates = [(start + datetime.timedelta(seconds=float(t))).isoformat() for t, _ in rows]
    path = write([f"{d},{r}" for d, (_, r) in zip(dates, rows, strict=True)], WIDE)
    frame = positions(path, "--sensors", stations, folder=tmp_path)
    assert frame["time_s"].to_list() == [start + datetime.timedelta(seconds=t) for t in TIMES]
    check(frame, located())
    other = tmp_path / "m.parquet"
    columns = {"t": np.repeat(TIMES, 4), "site": NAMES * STEPS}
    columns |= {f"{kind}_{KINDS[kind]}": v.ravel() for kind, v in Z.items()}
    pl.DataFrame(columns).write_parquet(other)
    arguments = (other, "--sensors", stations, "--column", "time_s=t", "--column", "sensor=site")
    frame = positions(*arguments, folder=tmp_path)
    assert frame.columns[0] == "time_s"
    check(frame, located())


def test_groups_and_stacked_files(write: Write, stations: Path, tmp_path: Path) -> None:
    other = recording(9)
    files = [
        write(wide(extra=",007")[:30], WIDE + ",target", "a.csv"),
        write([*wide(extra=",007")[30:], *wide(other, ",x")], WIDE + ",target", "b.csv"),
    ]
    arguments = (*files, "--sensors", stations, "--by", "target")
    frame = positions(*arguments, folder=tmp_path)
    assert frame.columns[:2] == ["target", "time_s"]
    first, second = frame.partition_by("target", maintain_order=True)
    assert (first["target"][0], second["target"][0]) == ("007", "x")
    check(first, located())
    check(second, located(other))
    done = run(*arguments, "--plot", tmp_path / "p.png")
    assert re.findall(r"^target (\w+): 25 of 25 instants located", done.out, re.M) == ["007", "x"]
    assert {row[0] for row in table(done.out)[1:]} == {"007", "x"}


def test_rows_of_measurements(write: Write, stations: Path, tmp_path: Path) -> None:
    output = tmp_path / "r.parquet"
    z = {kind: v.copy() for kind, v in Z.items()}
    for v in z.values():
        v[3] = NAN
    z["range"][3, 1] = 2000.0
    done = run(write(wide(z)), "--sensors", stations, "--measurements", output)
    assert (done.code, done.err) == (0, "")
    frame, result = pl.read_parquet(output), located(z)
    assert frame.columns == ["time_s", "sensor", "kind", "value", "residual", "outlier"]
    expected = []
    for i in range(STEPS):
        for k, name in enumerate(NAMES):
            for kind, v in z.items():
                if np.isnan(v[i, k]):
                    continue
                r = getattr(result.residual, kind)[i, k]
                wrong = bool(getattr(result.outlier, kind)[i, k])
                told = (None, None) if result.status[i] else (r, wrong)  # type: ignore[index]
                expected.append((TIMES[i], name, kind, v[i, k], *told))
    assert frame.rows() == expected
    assert frame["outlier"].null_count() == 1


def test_output_can_be_read_again(write: Write, stations: Path, tmp_path: Path) -> None:
    again = tmp_path / "again.csv"
    assert run(write(wide()), "--sensors", stations, "--measurements", again).code == 0
    check(positions(again, "--sensors", stations, folder=tmp_path), located())


def test_summary(write: Write, stations: Path) -> None:
    z = {kind: v.copy() for kind, v in Z.items()}
    for v in z.values():
        v[3] = NAN
    done = run(write(wide(z)), "--sensors", stations)
    assert (done.code, done.err) == (0, "")
    head, *rows = table(done.out)
    counts = ["measurement_count", "outlier_count"]
    assert head == ["sensor", "kind", *counts, "residual_mean", "residual_rms"]
    result = located(z)
    expected = []
    for k, name in enumerate(NAMES):
        for kind, v in z.items():
            wrong = getattr(result.outlier, kind)[:, k]
            r = getattr(result.residual, kind)[:, k]
            kept = r[~wrong & ~np.isnan(r)]
            numbers = (np.mean(kept), np.sqrt(np.mean(kept**2)))
            counts = (np.count_nonzero(~np.isnan(v[:, k])), np.count_nonzero(wrong))
            expected.append([name, kind, *map(str, counts), *(f"{x:.3g}" for x in numbers)])
    assert [row for row in rows if len(row) == len(head)] == expected
    sigma = np.sqrt(np.sum(result.sigma**2, axis=1))
    median = np.median(sigma[np.isfinite(sigma)])
    assert f"24 of 25 instants located, median sigma {median:.3g} m\n" in done.out
    assert f"  1 instant not located: {LocationStatus.TOO_FEW.message}\n" in done.out


@pytest.mark.parametrize("count", [4, 12])
def test_the_size_of_residuals_of_correct_sigmas_is_told(count: int, tmp_path: Path) -> None:
    """Three range differences leave one degree of freedom; with many there is nothing to say."""
    rng = np.random.default_rng(61)
    angle = 2 * np.pi * np.arange(count) / count + rng.normal(0, 0.1, count)
    places = 5e3 * np.column_stack([np.cos(angle), np.sin(angle)])
    names = [f"S{k:02}" for k in range(count)]
    rows = []
    for step in range(200):
        away = np.hypot(*(rng.normal(0, 1e3, 2) - places).T) + rng.normal(0, 7.0, count)
        rows += [(step, name, x - away[0]) for name, x in zip(names[1:], away[1:], strict=True)]
    head = ["time_s", "sensor", "range_difference_m"]
    pl.DataFrame(rows, schema=head, orient="row").write_csv(tmp_path / "m.csv")
    pl.DataFrame(
        {"name": names, "east_m": places[:, 0], "north_m": places[:, 1]}
        | {"range_difference_sigma_m": 7.0 * np.sqrt(2)}
    ).write_csv(tmp_path / "s.csv")
    done = run(tmp_path / "m.csv", "--sensors", tmp_path / "s.csv")
    told = re.search(r"residual_rms is about ([\d.]+) if the sigmas are correct", done.out)
    assert (told is None) == (count == 12)
    if told is not None:
        assert "600 measurements have 200 degrees of freedom" in done.out
        rms = [float(row[-1]) for row in table(done.out)[1:] if row[0] in names]
        assert np.sqrt(np.mean(np.square(rms))) == pytest.approx(float(told[1]), rel=0.2)


def test_contradictions_that_no_fault_explains_are_told(write: Write, stations: Path) -> None:
    arguments = (write(wide()), "--sensors", stations, "--method", "least-squares")
    result = located(method="least-squares")
    count = np.count_nonzero(np.asarray(result.pvalue) < 1e-3)
    assert count > 1
    told = f"  {count} instants with a p-value below 0.001 and no outlier found"
    assert told in run(*arguments).out
    assert "p-value" not in run(*arguments[:3]).out


@pytest.mark.parametrize("suffix", ["csv", "json", "parquet"])
def test_output_has_full_precision(
    suffix: str, write: Write, stations: Path, tmp_path: Path
) -> None:
    output = tmp_path / f"o.{suffix}"
    done = run(write(wide()), "--sensors", stations, "--output", output)
    assert (done.code, done.err) == (0, "")
    assert done.out.endswith(f"wrote {STEPS} rows to {output}\n")
    assert [row["up_m"] for row in terminal.rows_of(output)] == located().position[:, 2].tolist()


def test_azimuths_in_radians_are_doubted(write: Write, stations: Path) -> None:
    radians = {"azimuth": np.radians(Z["azimuth"]), "range": Z["range"]}
    head = "time_s,sensor,azimuth_deg,range_m"
    told = "all azimuths are within 6.3 degrees: are they radians? Use degrees\n"
    assert told in run(write(wide(radians), head), "--sensors", stations).err
    assert run(write(wide()), "--sensors", stations).err == ""


def test_pictures(write: Write, stations: Path, tmp_path: Path) -> None:
    picture = tmp_path / "p.svg"

    def words() -> str:
        return re.sub(r"<!-- (.*?) -->", r"\1", picture.read_text(encoding="utf-8"))

    path = write(wide())
    assert run(path, "--sensors", stations, "--plot", picture).code == 0
    for word in ("up (m)", "azimuth / sigma", "25 of 25 instants located", "time_s"):
        assert word in words()
    rows = [line for line in wide() if line.startswith("4.0,")]
    assert run(write(rows), "--sensors", stations, "--plot", picture).code == 0
    assert "bearing" in words()
    assert "range / sigma" not in words()
    many = [line + f",{i}" for i in range(5) for line in wide()]
    arguments = (write(many, WIDE + ",t"), "--sensors", stations, "--by", "t")
    done = run(*arguments, "--plot", picture)
    assert (done.code, done.err) == (0, "only the first 4 of 5 groups are drawn\n")
    assert "t 3: 25 of 25" in words()


def test_results_are_whole_or_not_there(
    write: Write, stations: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    output = tmp_path / "o.csv"
    output.write_text("before", encoding="utf-8")
    path = write(wide())
    before = sorted(tmp_path.iterdir())

    def full(_: pl.DataFrame, file: BinaryIO) -> None:
        file.write(b"half")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setitem(writing.WRITERS, ".csv", full)
    done = run(path, "--sensors", stations, "--output", output)
    assert (done.code, done.err) == (
        1,
        f"tertia: cannot write {output}: No space left on device\n",
    )
    assert output.read_text(encoding="utf-8") == "before"
    assert sorted(tmp_path.iterdir()) == before


def test_regions_and_protection_levels(write: Write, stations: Path, tmp_path: Path) -> None:
    told = "--probability", 0.9, "--risk", 1e-5
    frame = positions(write(wide()), "--sensors", stations, *told, folder=tmp_path)
    expected = located()
    region, level = expected.region(0.9), np.asarray(expected.protection_level(1e-5))
    assert_column(frame["region_area_m2"], region.area)
    assert_column(frame["region_semi_major_m"], region.semi_major)
    assert_column(frame["region_orientation_deg"], np.degrees(region.orientation))
    assert_column(frame["cep_m"], expected.cep())
    assert_column(frame["protection_level_m"], np.where(np.isfinite(level), level, NAN))


def test_few_bearings(write: Write, tmp_path: Path) -> None:
    rows = [f"0,{name},{azimuth}" for name, azimuth in zip("ABC", (35, 325, 2), strict=True)]
    places = write(["A,0,0", "B,400,0", "C,200,-300"], "name,east_m,north_m", "towers.csv")
    bearings = write(rows, "time_s,sensor,azimuth_deg", "bearings.csv")
    how = "--sensors", places, "--method", "posterior", "--max-range", 1000
    frame = positions(bearings, *how, folder=tmp_path)
    expected = locate(
        [[0, 0], [400, 0], [200, -300]],
        azimuth=np.radians([35, 325, 2]),
        method="posterior",
        max_range=1000.0,
    )
    np.testing.assert_allclose(frame.select("east_m", "north_m").row(0), expected.position)


def test_example_agrees_with_its_script_and_its_truth(tmp_path: Path) -> None:
    script = runpy.run_path(str(EXAMPLES / "make_stations.py"))
    header, *rows = (EXAMPLES / "measurements.csv").read_text(encoding="utf-8").splitlines()
    assert header == WIDE
    assert [tuple(line.split(",")) for line in rows] == list(script["rows"]())
    stations = EXAMPLES / "stations.toml"
    assert stations.read_text(encoding="utf-8") == script["toml"]()
    frame = positions(EXAMPLES / "measurements.csv", "--sensors", stations, folder=tmp_path)
    echo = frame.filter(pl.col("time_s").is_between(30, 36))["outlier_measurement"]
    assert echo.str.contains("east range").sum() >= 5
    assert frame.filter(pl.col("status").is_not_null())["time_s"].to_list() == [50.0, 51.0]
    # the azimuths of one station are wrong, so only most of the others' sigma is true
    known = frame["status"].is_null().to_numpy()
    error = np.abs(frame["up_m"].to_numpy() - script["truth"]()[:, 2])[known]
    assert np.mean(error < 2 * frame["up_sigma_m"].to_numpy()[known]) > 0.9


S = "--sensors"
HEAD = "name,east_m,north_m,up_m,range_sigma_m,azimuth_sigma_deg\n"
EARTHLY = '[[station]]\nname = "A"\nlatitude_deg = 50\nlongitude_deg = 14\n'
FILES = {
    "s.csv": HEAD + "A,0,0,0,10,0.3\nB,1000,0,0,10,0.3\nC,0,1000,0,,\n",
    "plane.csv": "name,east_m,north_m,range_sigma_m\nA,0,0,1\nB,9,0,1\n",
    "header.csv": HEAD,
    "nonorth.csv": HEAD + "A,0,,0,1,1\n",
    "noheight.csv": HEAD + "A,0,0,,1,1\nB,0,0,3,1,1\n",
    "texteast.csv": HEAD + "A,zero,0,0,1,1\n",
    "geo.csv": "name,lat,lon\nA,1,2\n",
    "both.csv": "name,east_m,north_m,latitude_deg,longitude_deg\nA,0,0,,\nB,,,50,14\n",
    "height.csv": "name,east_m,north_m,height_m\nA,0,0,\nB,1,0,5\n",
    "up.csv": "name,latitude_deg,longitude_deg,up_m\nA,50,14,5\n",
    "latitude.csv": "name,latitude_deg\nA,50\n",
    "longitude.csv": "name,latitude_deg,longitude_deg\nA,50,14\nB,,14\n",
    "high.csv": "name,latitude_deg,longitude_deg,height_m\nA,50,14,\nB,50,15,9\n",
    "pole.csv": "name,latitude_deg,longitude_deg\nA,50,14\nB,90.5,14\n",
    "turn.csv": "name,latitude_deg,longitude_deg\nA,50,361\n",
    "far.csv": "name,latitude_deg,longitude_deg\nA,50,14\nB,60,14\n",
    "level.csv": "name,latitude_deg,longitude_deg\nA,50,14\nB,50,15\n",
    "origin.toml": EARTHLY + "[origin]\nlatitude_deg = 50\n",
    "south.toml": EARTHLY + "[origin]\nlatitude_deg = -91\nlongitude_deg = 14\n",
    "lifted.toml": EARTHLY + "[origin]\nlatitude_deg = 5\nlongitude_deg = 14\nheight_m = 3\n",
    "number.toml": "origin = 5\n" + EARTHLY,
    "metres.toml": '[[station]]\nname = "A"\neast_m = 0\nnorth_m = 0\n[origin]\n',
    "odd.toml": "station = 3\n",
    "moving.toml": '[[station]]\nname = "A"\nazimuth_sigma_deg = 5\n',
    "from.toml": '[origin]\nlatitude_deg = 50\nlongitude_deg = 14\n[[station]]\nname = "A"\n',
    "breite.csv": "name,Breite,Laenge\nA,50,14\n",
    "true.toml": '[[station]]\nname = "A"\neast_m = true\nnorth_m = 0\n',
    "empty.csv": "",
    "m.csv": WIDE + "\n0,A,500,10,1\n0,B,600,,\n",
    "nothing.csv": WIDE + "\n0,A,,,\n1,B,NA,-,\n",
    "other.csv": "time_s,sensor,azimuth_rad\n0,A,1\n",
    "kind.csv": LONG + "\n0,A,range,500\n0,A,bearing,1\n",
    "spell.csv": WIDE + "\n0,A,500,1,1\n1,Aa,500,1,1\n",
    "nosite.csv": WIDE + "\n0,A,500,1,1\n1,,500,1,1\n",
    "notime.csv": WIDE + "\n0,A,500,1,1\n\n,B,500,1,1\n",
    "badtime.csv": WIDE + "\n0,A,500,1,1\nnoon,A,500,1,1\n",
    "zero.csv": WIDE + "\n0,A,500,1,1\n1,A,0,1,1\n",
    "steep.csv": WIDE + "\n0,A,500,1,181\n",
    "again.csv": WIDE + "\n0,A,500,1,1\n0,A,500,,\n",
    "sigma.csv": WIDE + ",range_sigma_m\n0,A,500,1,1,0\n",
    "bare.csv": "time_s,sensor,range_m,azimuth_deg\n0,A,500,1\n0,C,600,\n",
    "first.csv": "time_s,sensor,range_difference_m\n0,B,5\n0,A,5\n",
    "dates.csv": "time_s,sensor,range_m\n2026-01-01,A,5\n",
    "range.csv": "time_s,sensor,range_m,residual\n0,A,5,x\n",
    "fine.csv": "time_s,sensor,range_m,azimuth_deg\n0,A,500,45\n0,B,600,\n",
}


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["m.csv", S, "folder"], 1, "cannot read folder: .*"),
        (["m.csv", S, "folder.toml"], 1, "cannot read folder.toml: Is a directory"),
        (["m.csv", S, "binary.toml"], 1, "cannot read binary.toml: .*"),
        (["m.csv", S, "odd.toml"], 1, r"odd.toml: station is not a list of tables; each must .*"),
        (["m.csv", S, "true.toml"], 1, "true.toml: east_m of A is True; it must be a finite .*"),
        (["m.csv", S, "empty.csv"], 1, "empty.csv is empty"),
        (["m.csv", S, "header.csv"], 1, "header.csv: there are no stations"),
        (
            ["m.csv", S, "breite.csv"],
            1,
            "breite.csv: east_m of A is missing: give latitude_deg and longitude_deg, or east_m "
            "and north_m",
        ),
        (["m.csv", S, "nonorth.csv"], 1, "nonorth.csv: north_m of A is missing"),
        (["m.csv", S, "noheight.csv"], 1, "noheight.csv: up_m of A is missing"),
        (["m.csv", S, "texteast.csv"], 1, "texteast.csv: east_m of A is 'zero'; it must be .*"),
        (["m.csv", S, "geo.csv"], 1, "geo.csv: latitude_deg of A is missing .did you mean lat.*"),
        (
            ["m.csv", S, "moving.toml"],
            1,
            "moving.toml: east_m of A is missing; a sensor that moves needs a position here, .*",
        ),
        (
            ["m.csv", S, "both.csv"],
            1,
            "both.csv: there are east_m of A and latitude_deg of B; all .*",
        ),
        (
            ["m.csv", S, "height.csv"],
            1,
            "height.csv: there are east_m of A and height_m of B; all .*",
        ),
        (
            ["m.csv", S, "up.csv"],
            1,
            "up.csv: there are up_m of A and latitude_deg of A; all positions must be given .*",
        ),
        (["m.csv", S, "latitude.csv"], 1, "latitude.csv: longitude_deg of A is missing"),
        (["m.csv", S, "longitude.csv"], 1, "longitude.csv: latitude_deg of B is missing"),
        (["m.csv", S, "high.csv"], 1, "high.csv: height_m of A is missing"),
        (
            ["m.csv", S, "pole.csv"],
            1,
            "pole.csv: latitude_deg of B is 90.5; it must be between -90 and 90; are .*swapped.",
        ),
        (["m.csv", S, "turn.csv"], 1, "turn.csv: longitude_deg of A is 361; it must be .* 360"),
        (
            ["m.csv", S, "far.csv"],
            1,
            "far.csv: B is 1112 km from the origin; sensors without .* 1000 km; are .*",
        ),
        (
            ["m.csv", S, "level.csv"],
            1,
            "elevations need the heights of the sensors: give height_m of .* level.csv",
        ),
        (["m.csv", S, "origin.toml"], 1, "origin.toml: longitude_deg of the origin is missing"),
        (["m.csv", S, "south.toml"], 1, "south.toml: latitude_deg of the origin is -91; it .*"),
        (
            ["m.csv", S, "lifted.toml"],
            1,
            "lifted.toml: the origin has height_m, but no sensor has one",
        ),
        (
            ["m.csv", S, "number.toml"],
            1,
            r"number.toml: origin is not a table; it must begin with \[origin\]",
        ),
        (
            ["m.csv", S, "metres.toml"],
            1,
            "metres.toml: an origin is for sensors with latitude_deg .*, not with east_m of A: "
            "leave out one of them",
        ),
        (
            ["m.csv", S, "from.toml"],
            1,
            "from.toml: latitude_deg of A is missing; a sensor that moves needs a position here, "
            "too, such as its first",
        ),
        (
            ["m.csv", S, "s.csv", "--by", "height_m"],
            2,
            "cannot group by height_m: the results have .*",
        ),
        (["m.csv", S, "m.csv"], 2, "m.csv has no column name .did you mean sensor.*"),
        (["nothing.csv", S, "s.csv"], 1, "there are no measurements: all values are missing"),
        (
            ["other.csv", S, "s.csv"],
            2,
            "other.csv has no column of measurements: range_m, azimuth_deg, elevation_deg, "
            "range_difference_m, arrival_time_s, or kind and value; azimuth_rad is in another "
            "unit; it has time_s, sensor, azimuth_rad",
        ),
        (["m.csv", S, "s.csv", "--column", "time_s=t"], 2, "m.csv has no column t; it has .*"),
        (["m.csv", S, "s.csv", "--column", "sensor=t"], 2, "m.csv has no column t; it has .*"),
        (["m.csv", S, "s.csv", "--by", "t"], 2, "m.csv has no column t; it has .*"),
        (["m.csv", S, "s.csv", "--by", "sensor"], 2, "cannot group by sensor: the results have .*"),
        (
            ["range.csv", S, "s.csv", "--by", "residual"],
            2,
            "cannot group by residual: the results have a column of this name",
        ),
        (["m.csv", S, "s.csv", "--by", "outlier_count"], 2, "cannot group by outlier_count: .*"),
        (["m.csv", S, "s.csv", "--by", "east_m"], 2, "cannot group by east_m: .*"),
        (
            ["kind.csv", S, "s.csv"],
            1,
            "kind.csv, line 3: kind is 'bearing'; it must be one of range, azimuth, .*",
        ),
        (
            ["spell.csv", S, "s.csv"],
            1,
            "spell.csv, line 3: sensor is 'Aa'; the sensors are A, B, C",
        ),
        (["nosite.csv", S, "s.csv"], 1, "nosite.csv, line 3: sensor is missing"),
        (["notime.csv", S, "s.csv"], 1, "notime.csv, line 4: time_s is missing"),
        (["badtime.csv", S, "s.csv"], 1, "badtime.csv, line 3: time_s is 'noon'; it must be .*"),
        (["zero.csv", S, "s.csv"], 1, "zero.csv, line 3: range is 0; it must be positive"),
        (
            ["steep.csv", S, "s.csv"],
            1,
            "steep.csv, line 2: elevation is 181; it must be between .*",
        ),
        (
            ["again.csv", S, "s.csv"],
            1,
            "again.csv, line 3: range is given twice for this sensor and time_s 0.0: .* group .*",
        ),
        (["sigma.csv", S, "s.csv"], 1, "sigma.csv, line 2: range_sigma_m is 0; it must be .*"),
        (["m.csv", S, "s.csv"], 1, "s.csv: A has no elevation_sigma_deg, but measures elevation"),
        (["bare.csv", S, "s.csv"], 1, "s.csv: C has no range_sigma_m, but measures range"),
        (
            ["first.csv", S, "s.csv"],
            1,
            "first.csv, line 3: the first sensor has a range difference; only the other sensors .*",
        ),
        (
            ["m.csv", S, "plane.csv"],
            1,
            "elevations need the heights of the sensors: give up_m of the .* plane.csv",
        ),
        (
            ["fine.csv", "dates.csv", S, "s.csv"],
            1,
            "time_s holds numbers in fine.csv and dates in dates.csv; .*",
        ),
        (
            ["fine.csv", S, "s.csv", "--method", "lenth-mle"],
            1,
            "method is 'lenth-mle'; it is for azimuths alone, in the plane",
        ),
        (
            ["fine.csv", S, "s.csv", "--initial", "1,2"],
            2,
            "--initial is '1,2'; it must be 3 numbers, one for each coordinate of the sensors",
        ),
        (["fine.csv", S, "s.csv", "--initial", "a,b,c"], 2, "--initial is 'a,b,c'; it must .*"),
        (["fine.csv", S, "s.csv", "--initial", "1,2,nan"], 2, "--initial is '1,2,nan'; it .*"),
        (
            ["fine.csv", S, "s.csv", "--measurements", "x"],
            2,
            "cannot write x: its name must end .*",
        ),
        (
            ["fine.csv", S, "s.csv", "--output", "x.csv", "--measurements", "x.csv"],
            2,
            "two results would be written to x.csv",
        ),
    ],
)
def test_errors_are_one_clear_line_and_leave_nothing(
    arguments: list[str], code: int, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, content in FILES.items():
        Path(name).write_text(content, encoding="utf-8")
    for folder in ("folder", "folder.toml"):
        Path(folder).mkdir()
    Path("binary.toml").write_bytes(bytes(range(128, 256)))
    before = sorted(Path().iterdir())
    done = run(*arguments)
    assert done.code == code, done.err
    assert re.fullmatch(f"tertia: {message}\n", done.err), done.err
    assert sorted(Path().iterdir()) == before


def test_a_recording_without_faults_is_as_accurate_as_it_says(
    write: Write, stations: Path, tmp_path: Path
) -> None:
    found = simulate.stations(sites(), truth(), rng=8).measurements
    values = {kind: v / UNIT[kind] for kind, v in found.items()}
    frame = positions(write(wide(values)), S, stations, folder=tmp_path)
    error = frame.select("east_m", "north_m", "up_m").to_numpy() - truth()
    assert 0.7 < np.mean(np.asarray(metrics.nees(error, covariance_of(frame, AXES)))) / 3 < 1.4


def test_a_height_on_the_earth_is_above_the_ellipsoid(tmp_path: Path) -> None:
    places = {"A": (48.0, 11.0, 500.0), "B": (48.2, 11.5, 420.0), "C": (47.8, 11.6, 900.0)}
    targets = np.array([[48.3, 11.9, 9e3], [47.2, 12.5, 9e3], [48.6, 9.8, 9e3]])
    sensors, rows = [], []
    for name, place in places.items():
        keys = dict(zip(("latitude_deg", "longitude_deg", "height_m"), place, strict=True))
        sensors.append({"name": name, **keys, "azimuth_sigma_deg": 0.1})
        for time, target in enumerate(targets):
            east, north, _ = LocalFrame(*place).to_local(*target)
            azimuth = np.degrees(np.arctan2(east, north))
            rows.append({"time_s": time, "sensor": name, "azimuth_deg": azimuth})
    pl.DataFrame(rows).write_csv(tmp_path / "m.csv")
    pl.DataFrame(sensors).write_csv(tmp_path / "s.csv")
    options = ["--sensors", tmp_path / "s.csv", "--height", 9000, "--height-sigma", 10]
    found = positions(tmp_path / "m.csv", *options, folder=tmp_path)
    place = found.select("latitude_deg", "longitude_deg", "height_m").to_numpy()
    np.testing.assert_allclose(place, targets, atol=1e-6)


@pytest.mark.parametrize(("factor", "doubted"), [(1.0, False), (1e-3, True)])
def test_ranges_are_judged_by_the_distances_of_the_stations(
    factor: float, doubted: bool, write: Write
) -> None:
    """Ranges of some metres in a hall are no kilometres."""
    places = {"A": (0.0, 0.0), "B": (60.0, 0.0), "C": (0.0, 25.0), "D": (60.0, 25.0)}
    stations = write(
        [f"{name},{east},{north},1" for name, (east, north) in places.items()],
        "name,east_m,north_m,range_sigma_m",
        "hall.csv",
    )
    rows = [
        f"{k},{name},{factor * np.hypot(20 + k - east, 10 - north)}"
        for k in range(10)
        for name, (east, north) in places.items()
    ]
    done = terminal.run("locate", write(rows, "time_s,sensor,range_m"), "--sensors", stations)
    assert ("are they kilometres" in done.err) == doubted


def test_the_speed_of_sound_is_printed(write: Write) -> None:
    places = {"A": (0.0, 0.0), "B": (600.0, 0.0), "C": (0.0, 500.0), "D": (600.0, 500.0)}
    places |= {"E": (300.0, 800.0), "F": (-200.0, 250.0)}
    stations = write(
        [f"{name},{east},{north},0.002" for name, (east, north) in places.items()],
        "name,east_m,north_m,arrival_time_sigma_s",
        "microphones.csv",
    )
    rows = [
        f"{k},{name},{k + np.hypot(200 + 20 * k - east, 300 - north) / 346.0:.5f}"
        for k in range(8)
        for name, (east, north) in places.items()
    ]
    seen = write(rows, "time_s,sensor,arrival_time_s")
    options = "--propagation-speed", "340", "--propagation-speed-sigma", "5"
    done = terminal.run("locate", seen, "--sensors", stations, *options)
    assert done.code == 0, done.err
    found = re.search(r"speed of signals: ([0-9.]+) ± ([0-9.]+) m/s", done.out)
    assert found is not None
    assert abs(float(found[1]) - 346.0) < 3 * float(found[2]) < 5
