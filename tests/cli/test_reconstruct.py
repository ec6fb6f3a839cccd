"""The command `tertia reconstruct`: numbers equal to those of the library, errors in one line."""

import re
import runpy
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import polars as pl
import pytest
import terminal
from places import EXAMPLES, ROOT
from pyproj import Geod
from terminal import Write, assert_column, covariance_of, table
from trajectory import test_ranges

from tertia import metrics, simulate
from tertia.geo import LocalFrame
from tertia.location import LocationStatus
from tertia.sensors import Bias, Station
from tertia.trajectory import Trajectory, reconstruct

run = partial(terminal.run, "reconstruct")
track = partial(terminal.result, "reconstruct")

EXAMPLE = (EXAMPLES / "measurements.csv", "--sensors", EXAMPLES / "stations.toml")
NAN = float("nan")
AXES = ("east", "north", "up")
UNITS = {"range": ("m", 1.0), "azimuth": ("deg", np.pi / 180), "elevation": ("deg", np.pi / 180)}
PLACES = {"A": (0.0, 0.0, 10.0), "B": (3000.0, 0.0, 0.0), "C": (0.0, 4000.0, 20.0)}
SIGMA = {"range": 10.0, "azimuth": 0.3, "elevation": 0.2}
NAMES = list(PLACES)
STEPS = 40
TIMES = np.arange(float(STEPS))
HEAD = "time_s,sensor,range_m,azimuth_deg,elevation_deg"

FloatArray = npt.NDArray[np.float64]


def sites() -> list[Station]:
    told = {f"{kind}_sigma": value * UNITS[kind][1] for kind, value in SIGMA.items()}
    return [Station(place, name=name, **told) for name, place in PLACES.items()]


def truth() -> FloatArray:
    return np.column_stack([500 + 20 * TIMES, 1500 + 0.3 * TIMES**2, 400 + 0 * TIMES])


def recording(seed: int = 5) -> dict[str, FloatArray]:
    """Return measurements in the units of files, one instant empty, one range with a fault."""
    found = simulate.stations(sites(), truth(), missing_probability=0.05, rng=seed).measurements
    for values in found.values():
        values[7] = NAN
    found["range"][[20, 21], 1] += 200.0
    return {kind: np.round(values / UNITS[kind][1], 4) for kind, values in found.items()}


Z = recording()


def lines(values: dict[str, FloatArray] = Z, extra: str = "") -> list[str]:
    return terminal.wide(TIMES, NAMES, values, extra)


@pytest.fixture
def write(tmp_path: Path) -> Write:
    return terminal.writer(tmp_path, HEAD, "m.csv")


@pytest.fixture
def stations(write: Write) -> Path:
    header = "name,east_m,north_m,up_m,range_sigma_m,azimuth_sigma_deg,elevation_sigma_deg"
    rows = [",".join(map(str, [name, *p, *SIGMA.values()])) for name, p in PLACES.items()]
    return write(rows, header, "stations.csv")


def rebuilt(values: dict[str, FloatArray] = Z, **options: Any) -> Trajectory:
    measured: dict[str, Any] = {kind: v * UNITS[kind][1] for kind, v in values.items()}
    return reconstruct(sites(), TIMES, **measured, **options)


def check(frame: pl.DataFrame, result: Trajectory) -> None:
    """Check every column of a trajectory but the time."""
    sigma = np.sqrt(np.diagonal(result.covariance, axis1=1, axis2=2))
    for i, axis in enumerate(AXES):
        for at, (prefix, unit, values) in enumerate(
            [
                ("", "m", result.position),
                ("velocity_", "m_s", result.velocity),
                ("acceleration_", "m_s2", result.acceleration),
            ]
        ):
            assert_column(frame[f"{prefix}{axis}_{unit}"], values[:, i])
            assert_column(frame[f"{prefix}{axis}_sigma_{unit}"], sigma[:, 3 * at + i])
        for j in range(i):
            between = np.where(np.isfinite(sigma[:, 0]), result.covariance[:, j, i], NAN)
            assert_column(frame[f"covariance_{AXES[j]}_{axis}_m2"], between)
    problems = np.asarray(result.fixes.status)
    assert_column(
        frame["degrees_of_freedom"], np.where(problems, NAN, result.fixes.degrees_of_freedom)
    )
    unknown = np.isnan(result.position).any(axis=1)
    assert_column(frame["outlier_count"], np.where(unknown, NAN, result.outlier.count))
    assert_column(frame["pvalue"], result.fixes.pvalue)
    reasons = [LocationStatus(p).message if p else None for p in problems]
    assert frame["status"].to_list() == reasons


def test_trajectory_is_that_of_the_library(write: Write, stations: Path, tmp_path: Path) -> None:
    frame = track(write(lines()), "--sensors", stations, folder=tmp_path)
    assert frame.columns[:3] == ["time_s", "east_m", "east_sigma_m"]
    assert frame.columns[-1] == "status"
    assert frame.width == 1 + 18 + 3 + 6
    assert frame["time_s"].to_list() == TIMES.tolist()
    result = rebuilt()
    check(frame, result)
    assert "B range" in frame["outlier_measurement"][20]
    for step, told in enumerate(frame["outlier_measurement"]):
        marks = [
            (k, kind) for kind in UNITS for k in range(3) if getattr(result.outlier, kind)[step, k]
        ]
        expected = sorted(f"{NAMES[k]} {kind}" for k, kind in marks)
        assert sorted(told.split("; ") if told else []) == expected
    # an instant without measurements has a position all the same
    assert frame["status"].is_not_null().arg_true().to_list() == [7]
    assert frame["east_m"].null_count() == 0


@pytest.mark.parametrize("order", ["spatial-first", "temporal-first"])
@pytest.mark.parametrize("smoother", ["rts", "local-polynomial"])
@pytest.mark.parametrize("method", ["robust", "least-squares"])
def test_methods(
    order: Any, smoother: Any, method: Any, write: Write, stations: Path, tmp_path: Path
) -> None:
    options = ("--order", order, "--smoother", smoother, "--spatial", method)
    frame = track(write(lines()), "--sensors", stations, *options, folder=tmp_path)
    check(frame, rebuilt(order=order, smoother=smoother, spatial=method))


def test_options_of_smoothers(write: Write, stations: Path, tmp_path: Path) -> None:
    arguments = (write(lines()), "--sensors", stations)
    polynomials = ("--smoother", "local-polynomial", "--window", 9, "--degree", 2)
    frame = track(*arguments, *polynomials, folder=tmp_path)
    check(frame, rebuilt(smoother="local-polynomial", window=9, degree=2))
    check(track(*arguments, "--jerk", 0.05, folder=tmp_path), rebuilt(jerk=0.05))
    assert "  jerk 0.05 (given)\n" in run(*arguments, "--jerk", 0.05).out
    smoothed = rebuilt().smoothed
    assert smoothed is not None
    assert f"  jerk {float(smoothed.jerk):.3g} (estimated" in run(*arguments).out
    said = run(*arguments, *polynomials).out
    assert "jerk" not in said
    assert "  systematic errors are not included" in said
    assert "not included" not in run(*arguments).out


def test_clocks(write: Write) -> None:
    """The error of a clock is that of its sensor, whatever this measures."""
    clocks = {"A": 0.0, "B": 1.5, "C": -1.0}
    measured: dict[str, Any] = {}
    for k, (name, late) in enumerate(clocks.items()):
        way = np.column_stack([500 + 20 * (TIMES - late), 1500 + 0.3 * (TIMES - late) ** 2])
        way = np.column_stack([way, np.full(STEPS, 400.0)])
        found = simulate.stations([sites()[NAMES.index(name)]], way, rng=k).measurements
        for kind, values in found.items():
            measured.setdefault(kind, np.empty((STEPS, 3)))[:, k] = values[:, 0]
    in_files = {kind: values / UNITS[kind][1] for kind, values in measured.items()}
    header = "name,east_m,north_m,up_m,range_sigma_m,azimuth_sigma_deg,elevation_sigma_deg"
    rows = [
        ",".join(map(str, [name, *p, *SIGMA.values(), 0.0 if name == "A" else 2.0]))
        for name, p in PLACES.items()
    ]
    stations = write(rows, f"{header},time_bias_sigma_s", "stations.csv")
    head, *printed = table(run(write(lines(in_files)), "--sensors", stations).out)
    values = [dict(zip(head, row, strict=False)) for row in printed]
    assert "bias" not in head
    for name, late in clocks.items():
        for row in (row for row in values if row["sensor"] == name and name != "A"):
            error = float(row["time_bias_s"]) - late
            assert 0.0 < float(row["time_bias_sigma_s"]) < 1.0
            assert abs(error) < 3.0 * float(row["time_bias_sigma_s"])
    assert len(values) == 9


def test_bias(write: Write, stations: Path, tmp_path: Path) -> None:
    z = {kind: v.copy() for kind, v in Z.items()}
    z["range"][:, 2] += 40.0
    z["azimuth"][:, 0] += 0.7
    arguments = (write(lines(z)), "--sensors", stations, "--bias", "range, azimuth")
    result = rebuilt(z, bias=Bias(range_sigma=np.inf, azimuth_sigma=np.inf))
    check(track(*arguments, folder=tmp_path), result)
    head, *rows = table(run(*arguments).out)
    assert head[-2:] == ["bias", "bias_sigma"]
    told = {tuple(row[:2]): row[6:] for row in rows}
    assert result.bias is not None
    for k, name in enumerate(NAMES):
        assert told[name, "elevation"] == []
        for kind in ("range", "azimuth"):
            _, factor = UNITS[kind]
            value, sigma = (
                float(getattr(result.bias, name)[k] / factor) for name in (kind, f"{kind}_sigma")
            )
            assert told[name, kind] == [f"{value:.3g}", f"{sigma:.3g}"]


def test_summary(write: Write, stations: Path) -> None:
    done = run(write(lines()), "--sensors", stations)
    assert (done.code, done.err) == (0, "")
    _, *rows = table(done.out)
    result = rebuilt()
    expected = {
        (NAMES[k], kind): [
            str(np.count_nonzero(~np.isnan(Z[kind][:, k]))),
            str(np.count_nonzero(getattr(result.outlier, kind)[:, k])),
            *(f"{value:.3g}" for value in statistics[k, 1:]),
        ]
        for kind, statistics in result.statistics.items()
        for k in range(3)
    }
    told = [row for row in rows if len(row) >= 6 and row[0] in NAMES]
    assert {tuple(row[:2]): row[2:6] for row in told} == expected
    sigma = np.median(np.sqrt(np.sum(result.sigma**2, axis=1)))
    assert f"40 of 40 instants with a position, median sigma {sigma:.3g} m\n" in done.out
    alone = "  1 instant has too few measurements for a position of its own; the path includes it\n"
    assert alone in done.out


def test_growing_errors_of_ranges(write: Write) -> None:
    rng, places, _, ranges = test_ranges.scene(0)
    wrong = ranges * np.exp(0.28 * rng.standard_normal(ranges.shape))
    beacons = [f"B{k},{east!r},{north!r},3.0" for k, (east, north) in enumerate(places.tolist())]
    sensors = write(beacons, "name,east_m,north_m,range_sigma_m", "beacons.csv")
    rows = [f"{t}.0,B{k},{r!r}" for t, own in enumerate(wrong.tolist()) for k, r in enumerate(own)]
    done = run(write(rows, "time_s,sensor,range_m"), "--sensors", sensors)
    relative = test_ranges.path(places, wrong).relative_range_sigma
    said = f"errors of ranges grow with the range; of large ranges, sigma is {relative:.0%}"
    assert said in done.out


def test_rows_of_measurements(write: Write, stations: Path, tmp_path: Path) -> None:
    output = tmp_path / "r.parquet"
    done = run(write(lines()), "--sensors", stations, "--measurements", output)
    assert (done.code, done.err) == (0, "")
    result = rebuilt()
    expected = [
        (
            *(TIMES[i], name, kind, v[i, k]),
            getattr(result.residual, kind)[i, k],
            bool(getattr(result.outlier, kind)[i, k]),
        )
        for i in range(STEPS)
        for k, name in enumerate(NAMES)
        for kind, v in Z.items()
        if not np.isnan(v[i, k])
    ]
    assert pl.read_parquet(output).rows() == expected


def test_sigmas_of_measurements_replace_those_of_stations(
    write: Write, stations: Path, tmp_path: Path
) -> None:
    head = HEAD + ",range_sigma_m"
    frame = track(write(lines(extra=",25"), head), "--sensors", stations, folder=tmp_path)
    told = {f"{kind}_sigma": value * UNITS[kind][1] for kind, value in SIGMA.items()}
    others = [Station(p, **(told | {"range_sigma": 25.0})) for p in PLACES.values()]
    measured: dict[str, Any] = {kind: v * UNITS[kind][1] for kind, v in Z.items()}
    check(frame, reconstruct(others, TIMES, **measured))
    rows = [line + (",30" if line.startswith("9.0,B") else ",25") for line in lines()]
    frame = track(write(rows, head), "--sensors", stations, folder=tmp_path)
    each = np.where((TIMES == 9.0)[:, np.newaxis] & (np.array(NAMES) == "B"), 30.0, 25.0)
    check(frame, reconstruct(others, TIMES, range_sigma=each, **measured))


def test_range_differences(write: Write, tmp_path: Path) -> None:
    places = np.array([[0.0, 0.0], [3000.0, 0.0], [0.0, 4000.0], [4000.0, 5000.0], [-1000, 3000]])
    distance = np.linalg.norm(truth()[:, np.newaxis, :2] - places, axis=-1)
    noise = np.random.default_rng(3).standard_normal((STEPS, 4))
    values = (distance[:, 1:] - distance[:, :1] + noise).round(3)
    head = "name,east_m,north_m,range_difference_sigma_m"
    rows = [f"S{k},{e},{n},{'' if k == 0 else k}" for k, (e, n) in enumerate(places)]
    stations = write(rows, head, "stations.csv")
    told = [f"{TIMES[i]},S{k + 1},{values[i, k]}" for i in range(STEPS) for k in range(4)]
    path = write(told, "time_s,sensor,range_difference_m")
    frame = track(path, "--sensors", stations, folder=tmp_path)
    expected = reconstruct(
        [Station(place) for place in places],
        TIMES,
        range_difference=values,
        range_difference_sigma=[1.0, 2.0, 3.0, 4.0],
    )
    assert_column(frame["north_m"], expected.position[:, 1])
    assert_column(frame["velocity_east_sigma_m_s"], np.sqrt(expected.covariance[:, 2, 2]))


# latitude, longitude, height
EARTH = {"A": (50.1, 14.3, 350.0), "B": (50.55, 14.9, 410.0), "C": (49.8, 15.2, 520.0)}
GEODETIC = ("latitude_deg", "longitude_deg", "height_m")


def test_latitude_and_longitude_in_space(write: Write, tmp_path: Path) -> None:
    frame = LocalFrame(*EARTH["A"])
    told: dict[str, Any] = {f"{k}_sigma": value * UNITS[k][1] for k, value in SIGMA.items()}
    known = [frame.station(*place, name=name, **told) for name, place in EARTH.items()]
    flown = np.linspace([50.1, 14.6, 9000.0], [50.2, 14.7, 9500.0], STEPS)
    measured = simulate.stations(known, frame.to_local(*flown.T), rng=4).measurements
    z = {kind: np.round(v / UNITS[kind][1], 4) for kind, v in measured.items()}
    header = ",".join(["name", *GEODETIC, *(f"{k}_sigma_{UNITS[k][0]}" for k in SIGMA)])
    rows = [",".join(map(str, [name, *p, *SIGMA.values()])) for name, p in EARTH.items()]
    arguments = (write(lines(z)), "--sensors", write(rows, header, "earth.csv"))
    found = track(*arguments, folder=tmp_path)
    assert found.columns[6:11] == ["up_sigma_m", *GEODETIC, "velocity_east_m_s"]
    in_radians: dict[str, Any] = {kind: v * UNITS[kind][1] for kind, v in z.items()}
    result = reconstruct(known, TIMES, **in_radians)
    check(found, result)
    for column, expected in zip(GEODETIC, frame.to_geodetic(result.position), strict=True):
        assert_column(found[column], expected)
    error = found.select(GEODETIC).to_numpy() - flown
    assert np.max(np.abs(error) @ np.diag([111e3, 72e3, 1.0])) < 100
    told_of_origin = "origin of east, north and up: latitude 50.1, longitude 14.3, height 350 m"
    assert f"\n{told_of_origin}\n" in run(*arguments).out


@pytest.mark.parametrize("order", ["spatial-first", "temporal-first"])
def test_latitude_and_longitude_in_the_plane(order: str, write: Write, tmp_path: Path) -> None:
    flown = np.linspace([50.1, 14.6], [50.2, 14.7], STEPS)
    geod = Geod(ellps="WGS84")
    azimuth = np.empty((STEPS, 3))
    for k, (latitude, longitude, _) in enumerate(EARTH.values()):
        here = np.full(STEPS, longitude), np.full(STEPS, latitude)
        azimuth[:, k] = geod.inv(*here, flown[:, 1], flown[:, 0])[0]
    rows = [f"{name},{place[0]},{place[1]},0.01" for name, place in EARTH.items()]
    stations = write(rows, "name,latitude_deg,longitude_deg,azimuth_sigma_deg", "earth.csv")
    path = write(lines({"azimuth": azimuth}), "time_s,sensor,azimuth_deg")
    found = track(path, "--sensors", stations, "--order", order, folder=tmp_path)
    assert "height_m" not in found.columns
    told = found["longitude_deg"].to_numpy(), found["latitude_deg"].to_numpy()
    # without the north of each station it would be 200 m
    assert np.max(geod.inv(*flown.T[::-1], *told)[2]) < 3


def test_groups(write: Write, stations: Path, tmp_path: Path) -> None:
    other = recording(9)
    rows = [*lines(extra=",007"), *lines(other, ",x")]
    arguments = (write(rows, HEAD + ",target"), "--sensors", stations, "--by", "target")
    first, second = track(*arguments, folder=tmp_path).partition_by("target", maintain_order=True)
    check(first, rebuilt())
    check(second, rebuilt(other))
    done = run(*arguments, "--plot", tmp_path / "p.svg")
    assert (done.code, done.err) == (0, "")
    assert re.findall(r"^target (\w+): 40 of 40 instants", done.out, re.M) == ["007", "x"]
    words = re.sub(r"<!-- (.*?) -->", r"\1", (tmp_path / "p.svg").read_text(encoding="utf-8"))
    for word in ("target 007: 39 of 40 instants located", "trajectory", "time_s", "up (m)"):
        assert word in words


def test_example_finds_the_faults_and_the_misaligned_station(tmp_path: Path) -> None:
    script = runpy.run_path(str(EXAMPLES / "make_stations.py"))
    done = run(*EXAMPLE, "--bias", "azimuth")
    told = {tuple(row[:2]): row[6:] for row in table(done.out)[1:]}
    value, sigma = map(float, told["south", "azimuth"])
    assert abs(value - script["MISALIGNED_DEG"]) < 3 * sigma < 0.3
    frame = track(*EXAMPLE, "--bias", "azimuth", folder=tmp_path)
    outlier_measurement = frame.filter(pl.col("outlier_measurement").is_not_null())
    assert outlier_measurement["outlier_measurement"].unique().to_list() == ["east range"]
    assert outlier_measurement["time_s"].is_between(30, 36).all()
    truth = script["truth"]()
    error = frame.select("east_m", "north_m", "up_m").to_numpy() - truth
    # one trajectory only: errors are correlated, so the mean may be off by this
    assert 0.4 < np.mean(np.asarray(metrics.nees(error, covariance_of(frame, AXES)))) / 3 < 1.8
    velocity = frame.select("velocity_east_m_s", "velocity_north_m_s").to_numpy()
    sigma_v = frame.select("velocity_east_sigma_m_s", "velocity_north_sigma_m_s").to_numpy()
    z = (velocity - np.gradient(truth[:, :2], axis=0))[2:-2] / sigma_v[2:-2]
    assert 0.3 < np.mean(z**2) < 2.0


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["--bias", "bearing"], 2, "--bias has 'bearing'; it must be of range, azimuth, .*"),
        (["--bias", "range_difference"], 2, "--bias has 'range_difference'; it must .*"),
        (
            ["--bias", "range", "--order", "temporal-first"],
            2,
            "bias needs order 'spatial-first' and smoother 'rts'",
        ),
        (["--degree", "two"], 2, "--degree is 'two'; it must be adaptive or a whole number"),
        (["--smoother", "local-polynomial", "--window", "12"], 2, "window is 12; it must be an .*"),
        (["--smoother", "local-polynomial", "--degree", "99"], 2, "degree is 99; it must be .*"),
        (["--jerk", "-1"], 2, "jerk is -1.0; it must not be negative"),
        (["--by", "velocity_up_m_s"], 2, "cannot group by velocity_up_m_s: .*"),
    ],
)
def test_errors_are_one_clear_line_and_leave_nothing(
    arguments: list[str],
    code: int,
    message: str,
    write: Write,
    stations: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    write(lines())
    before = sorted(Path().iterdir())
    done = run("m.csv", "--sensors", "stations.csv", *arguments)
    assert done.code == code, done.err
    assert re.fullmatch(f"tertia: {message}\n", done.err), done.err
    assert sorted(Path().iterdir()) == before


def test_errors_call_stations_by_their_names(write: Write, stations: Path) -> None:
    one = [line for line in lines() if ",B," in line]
    done = run(write(one), "--sensors", stations, "--bias", "range")
    assert done.code == 1
    told = r"tertia: biases of range of B are not observable: together they move .*\n"
    assert re.fullmatch(told, done.err)
    rows = [line + ",1" for line in one] + ["0.0,B,,,,2"]
    done = run(write(rows, HEAD + ",target"), "--sensors", stations, "--by", "target")
    assert (done.code, done.err) == (0, "target 2: there are no measurements; it is left out\n")
    few = write(["0,B,500,,", "1,B,510,,"])
    done = run(few, "--sensors", stations)
    assert (done.code, done.err) == (
        1,
        f"tertia: no instant can be located: {LocationStatus.TOO_FEW.message}\n",
    )


def test_a_sigma_that_nobody_states_is_an_error(write: Write) -> None:
    stations = write(["A,0,0", "B,9,0"], "name,east_m,north_m", "s.csv")
    path = write(["0,A,1", "0,B,2"], "time_s,sensor,azimuth_deg")
    done = run(path, "--sensors", stations)
    told = f"tertia: {stations}: A has no azimuth_sigma_deg, but measures azimuth\n"
    assert (done.code, done.err) == (1, told)


def test_figures_of_the_page_are_those_of_the_command() -> None:
    page = " ".join((ROOT / "docs" / "trajectory.md").read_text(encoding="utf-8").split())
    rows = table(run(*EXAMPLE, "--bias", "azimuth").out)[1:]
    bias = {tuple(row[:2]): row[2:] for row in rows}
    value, sigma = map(float, bias["south", "azimuth"][4:])
    assert f"finds {value} ± {sigma:.3f} degrees" in page
