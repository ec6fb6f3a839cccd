"""The commands `tertia track` and `tertia evaluate`: numbers of the library, errors in one line."""

import datetime
import inspect
import io
import json
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
from places import DATA, EXAMPLES
from terminal import Run, Write, assert_column, table

from tertia import metrics, plot
from tertia.cli.commands import track as track_command
from tertia.cli.files.limits import read_limits
from tertia.flightplan import CorrelationStatus, FlightPlan
from tertia.tracker import PlanModel, Plots, PlotStatus, Radar, Tracker, TrackTable, track

EXAMPLE = (EXAMPLES / "air_plots.csv", "--sensors", EXAMPLES / "air_radars.toml")
LEBL = DATA / "lebl_radar" / "plots_0800_0830.csv.gz"
HEAD = "time_s,sensor,range_m,azimuth_deg,height_m,identity"
NAN = float("nan")

FloatArray = npt.NDArray[np.float64]

tracks = partial(terminal.result, "track")


def run(*arguments: object, command: str = "track") -> Run:
    return terminal.run(command, *arguments)


RADARS = [
    Radar(
        (0.0, 0.0, 100.0),
        range_sigma=50.0,
        azimuth_sigma=0.1 * np.pi / 180,
        scan_period=4.0,
        max_range=150e3,
        detection_probability=0.95,
        name="west",
    ),
    Radar(
        (60e3, 5e3, 0.0),
        range_sigma=80.0,
        azimuth_sigma=0.2 * np.pi / 180,
        scan_period=6.0,
        name="east",
    ),
]
FIX_HEAD = "name,latitude_deg,longitude_deg"
PLAN = FlightPlan([[10e3, 30e3], [24e3, 30e3], [24e3, 60e3]], 200.0, identity=0o4321, name="P1")
PLAN_TEXT = json.dumps(
    [
        {
            "name": "P1",
            "identity": 0o4321,
            "waypoints": PLAN.waypoints.tolist(),
            "speeds_m_s": 200.0,
        }
    ]
)


def recording() -> pl.DataFrame:
    """Return what is seen of two aircraft in 160 s, one along the plan; clutter, and mistakes."""
    random = np.random.default_rng(8)
    rows = []
    for k, radar in enumerate(RADARS):
        for time in np.arange(0.7 * k, 160.0, radar.scan_period):
            planned, _ = PLAN.at(min(time, PLAN.times[-1]))
            straight = np.array([40e3 - 90 * time, 20e3 + 120 * time])
            for place, code, height in ((planned, 0o4321, 3048.0), (straight, -1, NAN)):
                if random.uniform() < 0.1:
                    continue
                way = place - radar.position[:2]
                level = 0.0 if np.isnan(height) else height - radar.position[2]
                azimuth = np.arctan2(*way) + radar.azimuth_sigma * random.standard_normal()
                distance = np.hypot(np.hypot(*way), level) + 50 * random.standard_normal()
                told = np.degrees(azimuth) % 360
                rows.append((time, radar.name, distance, told, height, code))
            clutter = (random.uniform(1e3, 140e3), random.uniform(0, 360))
            rows.append((time, radar.name, *clutter, NAN, -1))
    rows.append((80.0, "west", 151e3, 10.0, NAN, -1))
    rows.append((81.0, "east", NAN, 10.0, NAN, -1))
    columns = HEAD.split(",")
    return pl.DataFrame(rows, columns, orient="row").with_columns(
        pl.col("range_m").round(1), pl.col("azimuth_deg").round(4)
    )


SEEN = recording()


def plots(
    frame: pl.DataFrame = SEEN, *, time: FloatArray | None = None, kind: str = "identity"
) -> Plots:
    number = {radar.name: k for k, radar in enumerate(RADARS)}
    return Plots(
        frame["time_s"].to_numpy() if time is None else time,
        frame["range_m"].to_numpy(),
        np.radians(frame["azimuth_deg"].to_numpy()),
        sensor=np.array([number[name] for name in frame["sensor"]]),
        height=frame["height_m"].to_numpy(),
        **{kind: frame["identity"].to_numpy()},
    )


def lines(frame: pl.DataFrame = SEEN) -> list[str]:
    def text(value: object) -> str:
        return "" if value == -1 or (isinstance(value, float) and np.isnan(value)) else str(value)

    return [",".join(map(text, row)) for row in frame.iter_rows()]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    return terminal.writer(tmp_path, HEAD, "plots.csv", lines())


RADAR_HEAD = (
    "name,east_m,north_m,up_m,range_sigma_m,azimuth_sigma_deg,scan_period_s,max_range_m,"
    "detection_probability"
)
RADAR_ROWS = ["west,0,0,100,50,0.1,4,150000,0.95", "east,60000,5000,0,80,0.2,6,,"]


@pytest.fixture
def radars(write: Write) -> Path:
    return write(RADAR_ROWS, RADAR_HEAD, "radars.csv")


@pytest.fixture
def plans(tmp_path: Path) -> Path:
    path = tmp_path / "plans.json"
    path.write_text(PLAN_TEXT, encoding="utf-8")
    return path


def check(frame: pl.DataFrame, result: TrackTable) -> None:
    """Check every column but those of time and identity."""
    assert frame["track"].to_list() == result.track.tolist()
    assert frame["sensor"].to_list() == [RADARS[k].name for k in result.sensor]
    assert_column(frame["plot"], np.where(result.plot < 0, NAN, result.plot))
    names = ["east_m", "north_m", "velocity_east_m_s", "velocity_north_m_s"]
    state = np.hstack([result.position, result.velocity])
    for i, name in enumerate(names):
        quantity, unit = re.split("_(?=m)", name, maxsplit=1)
        assert_column(frame[name], state[:, i])
        assert_column(frame[f"{quantity}_sigma_{unit}"], np.sqrt(result.covariance[:, i, i]))
        for j, other in enumerate(names[:i]):
            second, unit2 = re.split("_(?=m)", other, maxsplit=1)
            product = {("m", "m"): "m2", ("m", "m_s"): "m2_s", ("m_s", "m_s"): "m2_s2"}
            column = f"covariance_{second}_{quantity}_{product[unit2, unit]}"
            assert_column(frame[column], result.covariance[:, j, i])
    for name in ("turn_probability", "speed_change_probability"):
        assert_column(frame[name], getattr(result, name))
    assert_column(frame["height_m"], result.height)
    assert_column(frame["vertical_rate_m_s"], result.vertical_rate)
    np.testing.assert_allclose(frame["speed_m_s"], np.linalg.norm(result.velocity, axis=1))
    course = np.radians(frame["course_deg"].to_numpy())
    toward = np.column_stack([np.sin(course), np.cos(course)])
    speed = frame["speed_m_s"].to_numpy()[:, np.newaxis]
    np.testing.assert_allclose(speed * toward, result.velocity, atol=1e-9)
    assert frame["confirmed"].to_list() == result.confirmed.tolist()
    planned = result.plan >= 0
    assert frame["plan"].to_list() == ["P1" if has else None for has in planned]
    conforming = [bool(c) if has else None for c, has in zip(result.conforms, planned, strict=True)]
    assert frame["conforms"].to_list() == conforming


def test_tracks_are_those_of_the_library(write: Write, radars: Path, tmp_path: Path) -> None:
    frame = tracks(write(), "--sensors", radars, folder=tmp_path)
    result = track(plots(), RADARS)
    assert len(np.unique(result.track)) >= 2
    assert frame.columns[:4] == ["time_s", "track", "sensor", "plot"]
    assert frame.columns[-5:] == ["identity", "plan", "conforms", "merged", "confirmed"]
    assert frame.width == 4 + 8 + 6 + 2 + 5 + 6
    assert frame["time_s"].to_list() == result.time.tolist()
    assert_column(frame["identity"], np.where(result.identity < 0, NAN, result.identity))
    check(frame, result)


def test_plans_of_messages(write: Write) -> None:
    """The same tracks as with the plans that the library reads of the messages."""
    sensors = write(
        [
            '[[radar]]\nname = "A"\nlatitude_deg = 50.0\nlongitude_deg = 14.0',
            "range_sigma_m = 50.0\nazimuth_sigma_deg = 0.08\nscan_period_s = 4.0",
        ],
        "",
        "sensors.toml",
    )
    fixes = write(["AAAA,50.2,13.5", "BBBB,50.2,14.5", "MIDDY,50.2,14.0"], FIX_HEAD, "fixes.csv")
    filed = write(
        ["-A320/M-S/C", "-AAAA0000", "-N0390F330 MIDDY", "-BBBB0020", "-0)"],
        "(FPL-ABC12/A4321-IS",
        "plans.fpl",
    )
    rows = [f"{t},{40_000 - 100 * t},{320 + 0.2 * t}" for t in np.arange(0.0, 200.0, 4.0)]
    found = write(rows, "time_s,range_m,azimuth_deg", "found.csv")
    arguments = (found, "--sensors", sensors, "--plans", filed)
    done = run(*arguments, "--fixes", fixes)
    assert done.code == 0, done.err
    assert "1 plan" in done.out
    assert "give --fixes" in run(*arguments).err
    few = write(["AAAA,50.2,13.5", "MIDDY,50.2,14.0"], FIX_HEAD, "few.csv")
    told = run(*arguments, "--fixes", few).err
    assert "BBBB" in told
    assert told.count("\n") == 1
    plans = write(["[]"], "", "plans.json")
    told = run(found, "--sensors", sensors, "--plans", plans, "--fixes", fixes).err
    assert "--fixes and --airways are only for messages" in told


def test_plans(write: Write, radars: Path, plans: Path, tmp_path: Path) -> None:
    arguments = (write(), "--sensors", radars, "--plans", plans)
    frame = tracks(*arguments, folder=tmp_path)
    result = track(plots(), RADARS, plans=[PLAN])
    assert np.any(result.plan >= 0)
    check(frame, result)
    assert "1 track with one of 1 plan, 0 of which left the plan" in run(*arguments).out
    frame = tracks(*arguments, "--motion", "window", folder=tmp_path)
    check(frame, track(plots(), RADARS, motion="window", plans=[PLAN]))
    told = ("--flown-probability", 0.3, "--wind", "20,-5.5", "--wind-sigma", 5)
    frame = tracks(*arguments, *told, folder=tmp_path)
    windy = track(plots(), RADARS, plans=[PLAN], plan_model=PlanModel(0.3, (20.0, -5.5), 5.0))
    check(frame, windy)
    assert not np.array_equal(windy.position, track(plots(), RADARS, plans=[PLAN]).position)
    wrong = run(*arguments, "--motion", "cv")
    assert wrong.code == 2
    assert "motion 'cv' takes no plans" in wrong.err
    wrong = run(*arguments, "--wind", "20")
    assert wrong.code == 2
    assert "--wind is '20'" in wrong.err


@pytest.mark.parametrize(
    ("told", "options"),
    [
        (("--motion", "cv"), {"motion": "cv"}),
        (("--motion", "window"), {"motion": "window"}),
        (("--confirmation", "4,6", "--coasting", 1), {"confirmation": (4, 6), "coasting": 1}),
        (("--clutter-density", 1e-4), {"clutter_density": 1e-4}),
        (("--max-speed", 160), {"max_speed": 160.0}),
        (("--profile", "drone", "--max-speed", 300), {"profile": "drone", "max_speed": 300.0}),
        (("--gate-probability", 0.8), {"gate_probability": 0.8}),
    ],
)
def test_options(told: Any, options: Any, write: Write, radars: Path, tmp_path: Path) -> None:
    frame = tracks(write(), "--sensors", radars, *told, folder=tmp_path)
    result = track(plots(), RADARS, **options)
    check(frame, result)
    usual = track(plots(), RADARS)
    alike = usual.covariance.shape == result.covariance.shape
    assert not (alike and np.array_equal(usual.covariance, result.covariance))


def test_defaults_are_those_of_the_library() -> None:
    mine, theirs = (inspect.signature(one).parameters for one in (track_command.track, Tracker))
    alike = ["motion", "coasting", "clutter_density", "profile", "max_speed"]
    for name in [*alike, "gate_probability", "clock_period"]:
        assert mine[name].default == theirs[name].default
    usual = PlanModel()
    assert tuple(map(float, mine["wind"].default.split(","))) == usual.wind
    for name in ("flown_probability", "wind_sigma"):
        assert mine[name].default == getattr(usual, name)
    plots_of_scans = tuple(map(int, mine["confirmation"].default.split(",")))
    assert plots_of_scans == theirs["confirmation"].default


def test_a_clock_that_begins_again(write: Write, radars: Path, tmp_path: Path) -> None:
    time = (SEEN["time_s"].to_numpy() + 86_300) % 86_400
    assert np.ptp(time) > 86_000
    path = write(lines(SEEN.with_columns(pl.Series("time_s", time))))
    options = ("--sensors", radars, "--clock-period", 86_400)
    check(
        tracks(path, *options, folder=tmp_path),
        track(plots(time=time), RADARS, clock_period=86_400.0),
    )
    dated = write([row.replace(row.split(",")[0], "2026-03-01", 1) for row in LINES], name="d.csv")
    done = run(dated, *options)
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert "clock_period can be used only if times are in seconds" in done.err


def test_radars_on_the_earth(write: Write, tmp_path: Path) -> None:
    """The second radar is a degree and a half east, where north is another direction."""
    pyproj = pytest.importorskip("pyproj")
    head = RADAR_HEAD.replace("east_m,north_m,up_m", "longitude_deg,latitude_deg,height_m")
    path = write(["A,2.0,50.0,100,50,0.1,4,,", "B,3.5,50.2,0,50,0.1,5,,"], head, "r.csv")
    earth = pyproj.Geod(ellps="WGS84")
    rows = []
    for name, period, longitude, latitude in (("A", 4.0, 2.0, 50.0), ("B", 5.0, 3.5, 50.2)):
        for time in np.arange(0.0, 120.0, period):
            azimuth, _, ground = earth.inv(longitude, latitude, 2.7, 50.5 + 0.001 * time)
            rows.append(f"{time},{name},{ground},{azimuth % 360},0")
    seen = write(rows, "time_s,sensor,range_m,azimuth_deg,height_m")
    frame = tracks(seen, "--sensors", path, "--registration", "off", folder=tmp_path)
    assert frame["track"].n_unique() == 1
    settled = frame.filter(pl.col("time_s") > 40.0)
    _, _, off = earth.inv(
        settled["longitude_deg"].to_numpy(),
        settled["latitude_deg"].to_numpy(),
        np.full(settled.height, 2.7),
        50.5 + 0.001 * settled["time_s"].to_numpy(),
    )
    # without the convergence of the meridians it is 1.2 degrees, more than a kilometre
    assert off.max() < 60.0
    assert "origin of east and north: latitude 50" in run(seen, "--sensors", path).out
    # plans are in the same frame
    header = "name,longitude_deg,latitude_deg,speed_m_s"
    plan = write(["A,2.7,50.5,111.2", "A,2.7,51.0,111.2"], header, "plans.csv")
    done = run(seen, "--sensors", path, "--plans", plan)
    assert "1 track with one of 1 plan, 0 of which left the plan" in done.out


def test_nautical_miles_flight_levels_and_columns_of_other_names(
    write: Write, radars: Path, tmp_path: Path
) -> None:
    frame = SEEN.with_columns(pl.col("range_m") / 1852, pl.col("height_m") / 30.48)
    path = write(lines(frame), "t,who,rho,theta,fl,identity")
    named = ("time_s=t", "sensor=who", "range_nm=rho", "azimuth_deg=theta", "flight_level=fl")
    columns = [part for name in named for part in ("--column", name)]
    found = tracks(path, "--sensors", radars, *columns, folder=tmp_path)
    expected = track(plots(), RADARS)
    np.testing.assert_allclose(found["east_m"], expected.position[:, 0], atol=1e-3)
    assert_column(found["height_m"].is_not_null().cast(float), ~np.isnan(expected.height))
    assert found["height_m"].drop_nulls().to_numpy() == pytest.approx(3048.0, abs=1.0)


@pytest.mark.parametrize(
    ("column", "told", "number", "back"),
    [
        ("mode_3a", "4321", 0o4321, "4321"),
        ("mode_3a", "0021", 0o21, "0021"),
        ("icao_address", "4a08eb", 0x4A08EB, "4A08EB"),
        ("icao_address", "00beef", 0xBEEF, "00BEEF"),
        ("identity", "77", 77, 77),
    ],
)
def test_identities(
    column: str, told: str, number: int, back: object, write: Write, radars: Path, tmp_path: Path
) -> None:
    rows = [line.replace(f",{0o4321}", f", {told} ") for line in lines()]
    path = write(rows, HEAD.replace("identity", column))
    frame = tracks(path, "--sensors", radars, folder=tmp_path)
    assert set(frame[column].drop_nulls()) == {back}
    assert_column(
        frame[column].is_not_null().cast(float),
        track(plots(), RADARS).identity >= 0,
    )
    # and it finds its plan
    same = {"identity": None, column: number if column == "identity" else told}
    plan = json.dumps([{**json.loads(PLAN_TEXT)[0], **same}])
    (tmp_path / "own.json").write_text(plan, encoding="utf-8")
    options = ("--sensors", radars, "--plans", tmp_path / "own.json")
    own = FlightPlan(PLAN.waypoints, 200.0, **{column: number})
    code = SEEN.with_columns(pl.col("identity").replace(0o4321, number))
    expected = track(plots(code, kind=column), RADARS, plans=[own])
    assert np.any(expected.plan_status == CorrelationStatus.LINKED)
    check(tracks(path, *options, folder=tmp_path), expected)


def test_of_several_kinds_each_is_written(write: Write, radars: Path, tmp_path: Path) -> None:
    path = write([line + ",1200" for line in lines()], HEAD + ",mode_3a")
    found = tracks(path, "--sensors", radars, folder=tmp_path)
    assert set(found["mode_3a"]) == {"1200"}
    assert set(found["identity"].drop_nulls()) == {0o4321}
    assert not {"icao_address", "callsign"} & set(found.columns)


def test_identities_are_those_of_the_plots_so_far(
    write: Write, radars: Path, tmp_path: Path
) -> None:
    """Callsigns come once in a while; the stream writes the same as the command."""
    rows = [
        line + (",4204.0" if n % 3 else ",") + (f",KLM{line.split(',')[-1]}" if n % 5 == 0 else ",")
        for n, line in enumerate(lines())
    ]
    path = write(rows, HEAD + ",mode_3a,callsign")
    named = ("--registration", "off")
    found = tracks(path, "--sensors", radars, *named, folder=tmp_path)
    assert set(found["mode_3a"].drop_nulls()) == {"4204"}
    done = run(path, "--stream", "--sensors", radars, *named)
    assert done.code == 0, done.err
    streamed = pl.read_csv(io.StringIO(done.out), schema_overrides={"mode_3a": pl.String})
    assert streamed.columns == found.columns
    for written in (found, streamed):
        known = written.drop_nulls(["callsign", "identity"])
        assert (known["callsign"] == "KLM" + known["identity"].cast(pl.String)).all()
        assert known.height > 0.3 * written.height
        for _, own in written.sort("time_s").group_by("track"):
            # once it is known it stays
            last = own["callsign"].drop_nulls().len()
            assert last == 0 or own["callsign"][-last:].null_count() == 0


def test_files_are_stacked_and_a_single_radar_needs_no_column(
    write: Write, radars: Path, tmp_path: Path
) -> None:
    whole = tracks(write(), "--sensors", radars, folder=tmp_path)
    first = write(lines()[:50], name="a.csv")
    second = tmp_path / "b.parquet"
    rest = SEEN[50:].with_columns(pl.col("identity").replace(-1, None))
    rest.with_columns(pl.col("range_m", "height_m").fill_nan(None)).write_parquet(second)
    assert tracks(first, second, "--sensors", radars, folder=tmp_path).equals(whole)
    alone = SEEN.filter(pl.col("sensor") == "west").with_row_index()
    one = write(RADAR_ROWS[:1], RADAR_HEAD, "one.csv")
    path = write(lines(alone.drop("sensor", "index")), HEAD.replace("sensor,", ""), "c.csv")
    frame = tracks(path, "--sensors", one, folder=tmp_path)
    check(frame, track(plots(alone), RADARS[:1]))


def test_radars_of_toml(write: Write, radars: Path, tmp_path: Path) -> None:
    names = RADAR_HEAD.split(",")
    parts = []
    for row in RADAR_ROWS:
        cells = dict(zip(names, row.split(","), strict=True))
        told = [f'name = "{cells.pop("name")}"', *(f"{k} = {v}" for k, v in cells.items() if v)]
        parts.append("\n".join(["[[radar]]", *told]))
    path = tmp_path / "radars.toml"
    path.write_text("\n".join(parts), encoding="utf-8")
    expected = tracks(write(), "--sensors", radars, folder=tmp_path)
    assert tracks(write(), "--sensors", path, folder=tmp_path).equals(expected)


def test_dates_count_from_midnight_and_come_back(
    write: Write, radars: Path, plans: Path, tmp_path: Path
) -> None:
    """The plan, whose seconds are those of the day, is found as it is with numbers."""
    midnight = datetime.datetime(2026, 3, 1, tzinfo=datetime.timezone.utc)
    moments = [midnight + datetime.timedelta(seconds=t) for t in SEEN["time_s"]]
    dated = SEEN.with_columns(pl.Series("time_s", [f"{m:%Y-%m-%dT%H:%M:%S.%fZ}" for m in moments]))
    options = ("--sensors", radars, "--plans", plans)
    frame = tracks(write(lines(dated)), *options, folder=tmp_path)
    result = track(plots(), RADARS, plans=[PLAN])
    check(frame, result)
    assert frame["time_s"].dtype == pl.Datetime("us", "UTC")
    since = (frame["time_s"] - midnight).dt.total_microseconds().to_numpy() / 1e6
    np.testing.assert_allclose(since, result.time, atol=1e-6)


def test_summary(write: Write, radars: Path) -> None:
    done = run(write(), "--sensors", radars)
    result = track(plots(), RADARS)
    head, *rows = table(done.out)[:3]
    assert head[:5] == ["sensor", "plot_count", "in_track_count", "in_none_count", "refused_count"]
    for k, row in enumerate(rows):
        own = plots().sensor == k
        seen = (result.sensor == k) & result.confirmed
        refused = int(np.sum(own & (result.track_of_plot < 0)))
        taken = int(np.sum((result.sensor == k) & (result.plot >= 0)))
        assert refused == 1
        assert row[:4] == [RADARS[k].name, str(own.sum()), str(taken), str(own.sum() - taken - 1)]
        share = np.mean(result.plot[seen] >= 0)
        assert row[4:] == ["1", str(int(np.sum(seen & (result.plot < 0)))), f"{share:.3g}"]
    assert f"  1 plot refused: {PlotStatus.OUT_OF_RANGE.message}\n" in done.out
    assert f"  1 plot refused: {PlotStatus.INVALID.message}\n" in done.out
    count = len(np.unique(result.track))
    assert f"{count} tracks, {len(result)} rows in" in done.out


def test_json_has_the_figures(write: Write, radars: Path, plans: Path) -> None:
    done = run(write(), "--sensors", radars, "--plans", plans, "--json")
    summary, result = json.loads(done.out), track(plots(), RADARS, plans=[PLAN])
    assert summary["plot_count"] == len(SEEN)
    assert summary["row_count"] == len(result)
    assert summary["track_count"] == len(np.unique(result.track))
    assert summary["refused_count"] == {
        PlotStatus.INVALID.message: 1,
        PlotStatus.OUT_OF_RANGE.message: 1,
    }
    assert [one["sensor"] for one in summary["sensors"]] == ["west", "east"]


def test_a_sky_without_targets(write: Write, radars: Path, tmp_path: Path) -> None:
    path = write(["1,west,50000,10,,", "9,west,20000,99,,"])
    done = run(
        path, "--sensors", radars, "--output", tmp_path / "o.csv", "--plot", tmp_path / "p.svg"
    )
    assert done.code == 0
    assert done.err.startswith("no track was confirmed: each target has too few plots")
    assert "--max-speed" in done.err
    assert done.err.count("\n") == 1
    assert pl.read_csv(tmp_path / "o.csv").height == 0


LINES = [f"{4 * i},west,{50000 + 700 * i},{10 + i},," for i in range(25)]


def changed(old: str, new: str) -> list[str]:
    return [LINES[0].replace(old, new, 1), *LINES[1:]]


@pytest.mark.parametrize(
    ("rows", "header", "message"),
    [
        (
            LINES,
            HEAD.replace("time_s", "t"),
            "plots.csv has no column time_s (did you mean t?); it has t, sensor",
        ),
        (LINES, HEAD.replace("range_m", "r"), "has no column range_m or range_nm; it has time_s"),
        (LINES, HEAD.replace("azimuth_deg", "a"), "has no column azimuth_deg"),
        (LINES, HEAD.replace("sensor", "r"), "has no column sensor; it has"),
        (changed("west", "north"), HEAD, "line 2: sensor is 'north'; the sensors are"),
        (changed("west", ""), HEAD, "line 2: sensor is missing"),
        (changed("0,west", ",west"), HEAD, "line 2: time_s is missing"),
        (changed("0,west", "noon,west"), HEAD, "time_s is 'noon'; it must be a number of seconds"),
        (changed(",,", ",,4A"), HEAD, "line 2: identity is '4A'; it must be a whole number"),
        (
            changed(",,", ",,4A"),
            HEAD.replace("identity", "mode_3a"),
            "line 2: mode_3a is '4A'; it must be octal digits",
        ),
        (
            changed(",,", ",,-4A"),
            HEAD.replace("identity", "icao_address"),
            "line 2: icao_address is '-4A'; it must be hexadecimal digits",
        ),
        ([",,,,,"], HEAD, "plots.csv is empty"),
        (["1,west,,3,,"], HEAD, "no plot can be used: time, range or azimuth is not"),
    ],
)
def test_mistakes_in_plots(
    rows: list[str], header: str, message: str, write: Write, radars: Path, tmp_path: Path
) -> None:
    output = tmp_path / "out" / "o.csv"
    output.parent.mkdir()
    path = write(rows, header)
    done = run(path, "--sensors", radars, "--output", output)
    terminal.assert_refused(done, message)
    assert not list(output.parent.iterdir())


@pytest.mark.parametrize(
    ("rows", "header", "message"),
    [
        (RADAR_ROWS, RADAR_HEAD.replace("scan_period_s", "p"), "scan_period_s of west is missing"),
        (RADAR_ROWS, RADAR_HEAD.replace("name", "n"), "has no column name"),
        (
            ["west,0,0,1,50,0.1,-4,,"],
            RADAR_HEAD,
            "scan_period_s of west is -4; it must be positive",
        ),
        (["west,0,0,1,x,0.1,4,,"], RADAR_HEAD, "range_sigma_m of west is 'x'; it must be a"),
        (["west,0,0,1,50,0.1,4,,1.5"], RADAR_HEAD, "west: detection_probability is 1.5"),
    ],
)
def test_mistakes_in_radars(rows: list[str], header: str, message: str, write: Write) -> None:
    done = run(write(LINES), "--sensors", write(rows, header, "r.csv"))
    terminal.assert_refused(done, message)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("p.json", "{", "cannot read"),
        ("p.json", "[]", "has no plans"),
        ("p.json", '[{"name": "A", "waypoints": [[0, 0]]}]', "plan A"),
        ("p.xml", "", "its name must end in .csv, .json, .geojson"),
        ("p.txt", "", "give --fixes"),
        ("p.csv", "a,b\n1,2\n", "it must have name"),
        (
            "p.csv",
            "name,longitude_deg,latitude_deg,speed_m_s\nA,2,41,200\nA,3,42,200\n",
            "its positions are latitudes and longitudes: give a frame or an origin",
        ),
    ],
)
def test_mistakes_in_plans(
    name: str, text: str, message: str, write: Write, radars: Path, tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    done = run(write(LINES), "--sensors", radars, "--plans", path)
    terminal.assert_refused(done, message)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--confirmation", "3"), "--confirmation is '3'; it must be two numbers"),
        (("--confirmation", "5,4"), "confirmation"),
        (("--coasting", 0), "coasting is 0"),
        (("--gate-probability", 1), "gate_probability is 1"),
        (("--clutter-density", -1), "clutter_density"),
        (("--column", "range=r"), "columns has 'range'; it must be one of time_s"),
        (
            ("--column", "time_s=t", "--column", "time_s=u"),
            "twice; if its name differs between the files, rename the column in one of them",
        ),
        (("--column", "time_s=t"), "has no column t; it has time_s"),
        (("--plans", "nowhere.json"), "there is no file nowhere.json"),
    ],
)
def test_wrong_options(options: Any, message: str, write: Write, radars: Path) -> None:
    done = run(write(LINES), "--sensors", radars, *options)
    assert done.code == 2
    terminal.assert_refused(done, message)


@pytest.mark.parametrize(
    ("change", "header", "message"),
    [
        ({"azimuth_deg": np.pi / 180}, HEAD, "all azimuths are within 6.3 degrees"),
        ({"range_m": 1e-3}, HEAD, "are they kilometres or nautical miles?"),
        ({}, HEAD.replace("range_m", "range_nm"), "range_nm is"),
        ({"height_m": 10.0}, HEAD, "is it in feet? Use metres"),
        ({}, HEAD.replace("height_m", "flight_level"), "Use hundreds of feet"),
    ],
)
def test_units_that_look_wrong(
    change: dict[str, float], header: str, message: str, write: Write, radars: Path
) -> None:
    assert run(write(), "--sensors", radars).err == ""
    frame = SEEN.with_columns(pl.col(name) * factor for name, factor in change.items())
    done = run(write(lines(frame), header), "--sensors", radars)
    assert message in done.err.splitlines()[0]


def test_a_sigma_in_radians_looks_wrong(write: Write) -> None:
    rows = [RADAR_ROWS[0].replace("0.1,", "0.0017,"), RADAR_ROWS[1]]
    done = run(write(), "--sensors", write(rows, RADAR_HEAD, "r.csv"))
    assert "azimuth_sigma_deg of west is 0.0017 degrees: is it in radians?" in done.err


def test_targets_that_give_several_plots_in_a_scan(write: Write) -> None:
    """Parts of ten ships 200 m long, one to five in each scan."""
    random = np.random.default_rng(4)
    ship, scan = np.repeat(np.divmod(np.arange(400), 40), random.integers(1, 6, 400), axis=1)
    place = np.stack([2e3 + 4.0 * 4.0 * scan, 1e3 * ship - 5e3], axis=-1)
    place += random.uniform(-0.5, 0.5, (len(scan), 1)) * [200.0, 0.0]
    azimuth = np.degrees(np.arctan2(*place.T)) % 360.0
    rows = np.stack([4.0 * (scan + azimuth / 360.0), np.hypot(*place.T), azimuth], axis=-1)
    written = [f"{a:.4f},{b:.2f},{c:.4f}" for a, b, c in rows[np.argsort(rows[:, 0])]]
    path = write(written, "time_s,range_m,azimuth_deg", "ships.csv")
    one = write(["quay,0,0,0,10,0.2,4,15000,0.95"], RADAR_HEAD, "quay.csv")
    done = run(path, "--sensors", one, "--profile", "vessel")
    assert "quay: many targets give several plots in a scan" in done.err


def test_files_may_have_different_identities(write: Write, radars: Path, tmp_path: Path) -> None:
    east = [line for line in lines() if ",east," in line]
    west = [line for line in lines() if ",west," in line]
    codes = [line.replace(f",{0o4321}", ",4321") for line in east]
    files = write(west), write(codes, HEAD.replace("identity", "mode_3a"), "second.csv")
    found = tracks(*files, "--sensors", radars, folder=tmp_path)
    both = found.filter(pl.col("identity") == 0o4321)
    assert set(both["mode_3a"].drop_nulls()) == {"4321"}
    assert both["mode_3a"].null_count() < 0.2 * both.height


@pytest.mark.skipif(not LEBL.is_file(), reason="the recording is not here")
def test_a_real_recording(write: Write, tmp_path: Path) -> None:
    """Tracks hold together what has one address, and their speeds are those that it reports."""
    radar = write(["lebl,0,0,27,50,0.08,4,,"], RADAR_HEAD, "lebl.csv")
    named = ("time_s=tod_s", "range_nm=rho_nm", "azimuth_deg=theta_deg", "flight_level=fl")
    columns = [part for name in (*named, "icao_address=icao24") for part in ("--column", name)]
    frame = tracks(LEBL, "--sensors", radar, *columns, folder=tmp_path)
    source = pl.read_csv(LEBL)
    told = frame.filter(pl.col("plot").is_not_null() & pl.col("confirmed"))
    assert told.height > 0.95 * source.height
    own = source[told["plot"].to_list()]
    assert (told["icao_address"] == own["icao24"]).mean() > 0.99
    # knots
    off = told["speed_m_s"] - own["bds_GS"].cast(float) * 0.514444
    straight = (told["turn_probability"] < 0.1).to_numpy()
    assert np.nanmedian(np.abs(off.to_numpy()[straight].astype(float))) < 5.0


# ------------------------------------------------------------------------------------------------
# evaluate


def judge(*arguments: object, folder: Path) -> dict[str, float | None]:
    """Return the figures with full precision; the run must succeed."""
    output = folder / "figures.json"
    done = run(*arguments, "--output", output, command="evaluate")
    assert done.code == 0, done.err
    return {row["figure"]: row["value"] for row in json.loads(output.read_text(encoding="utf-8"))}


TIMES = np.arange(0.0, 101.0, 4.0)
TRUTH_HEAD = "time_s,target,east_m,north_m"


def way(k: int, time: FloatArray) -> FloatArray:
    """Return a straight flight: to the east, and to the north."""
    step = np.array([[200.0, 0.0], [0.0, 150.0]])[k]
    return np.array([1e3, 2e3 * k]) + time[:, np.newaxis] * step


@pytest.fixture
def truth(write: Write) -> Path:
    rows = [
        f"{t},{name},{e},{n}"
        for k, name in enumerate(["AB1", "AB2"])
        for t, (e, n) in zip(TIMES[::5], way(k, TIMES[::5]), strict=True)
    ]
    return write(rows, TRUTH_HEAD, "truth.csv")


TRACK_HEAD = "time_s,track,east_m,north_m"


def shown(offset: FloatArray | None = None) -> list[str]:
    off = np.zeros(2) if offset is None else offset
    return [
        f"{t},{k + 1},{e},{n}"
        for k in range(2)
        for t, (e, n) in zip(TIMES, way(k, TIMES) + off, strict=True)
    ]


def test_perfect_tracks(write: Write, truth: Path, tmp_path: Path) -> None:
    told = judge(write(shown(), TRACK_HEAD), "--truth", truth, folder=tmp_path)
    assert told["targets"] == told["tracks"] == 2
    assert told["update period"] == 4.0
    assert told["probability of update"] == 1.0
    zero = ["missed targets", "false tracks", "false updates", "identity switches"]
    zero += ["share missed in long gaps", "latency, median", "latency, largest"]
    assert {told[name] for name in zero} == {0.0}
    near = ["RMSE", "RMSE along track", "RMSE across track", "GOSPA, mean", "GOSPA, missed"]
    assert max(abs(told[name] or 0.0) for name in near) < 1e-6
    assert "NEES per axis" not in told


def test_errors_along_and_across(write: Write, truth: Path, tmp_path: Path) -> None:
    """30 m to the east is along the one, and across the other."""
    targets = tmp_path / "targets.csv"
    path = write(shown(np.array([30.0, 0.0])), TRACK_HEAD)
    told = judge(path, "--truth", truth, "--targets", targets, folder=tmp_path)
    assert told["RMSE"] == pytest.approx(30.0)
    assert told["RMSE along track"] == pytest.approx(30 / np.sqrt(2))
    rows = pl.read_csv(targets)
    assert rows["target"].to_list() == ["AB1", "AB2"]
    assert rows["update_count"].to_list() == [26, 26]
    np.testing.assert_allclose(rows["rmse_along_track_m"], [30.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(rows["rmse_cross_track_m"], [0.0, 30.0], atol=1e-6)
    assert told["GOSPA, mean"] == pytest.approx(30 * np.sqrt(2))
    assert told["GOSPA, localisation"] == told["GOSPA, mean"]


@pytest.mark.parametrize(("rmse", "verdict"), [(29.0, "not met"), (31.0, "met")])
def test_limits(write: Write, truth: Path, tmp_path: Path, rmse: float, verdict: str) -> None:
    path, output = write(shown(np.array([30.0, 0.0])), TRACK_HEAD), tmp_path / "figures.json"
    limits = write([f"rmse_m = {rmse}"], "probability_of_update = 0.5", "limits.toml")
    done = run(path, "--truth", truth, "--limits", limits, "--output", output, command="evaluate")
    assert done.code == 0, done.err
    rows = {row["figure"]: row for row in json.loads(output.read_text(encoding="utf-8"))}
    told = rows["RMSE"]
    assert (told["limit"], told["verdict"]) == (rmse, verdict)
    assert told["low"] <= told["value"] <= told["high"]
    assert rows["probability of update"]["verdict"] == "met"
    assert rows["share missed in long gaps"]["verdict"] is None
    assert rows["targets"]["low"] is None


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("rmse = 300.0", "has 'rmse'; it may have"),
        ("rmse_m = true", "rmse_m is True; it must be"),
        ("rmse_m = nan", "rmse_m is nan; it must be"),
        ("rmse_m = ", "cannot read"),
    ],
)
def test_wrong_limits(write: Write, truth: Path, line: str, text: str) -> None:
    limits = write([], line, "limits.toml")
    path = write(shown(), TRACK_HEAD)
    done = run(path, "--truth", truth, "--limits", limits, command="evaluate")
    assert done.code != 0
    assert text in " ".join(done.err.split())


@pytest.mark.parametrize("name", ["limits_3nm.toml", "limits_5nm.toml"])
def test_limits_of_the_examples_are_read(name: str) -> None:
    found = read_limits(EXAMPLES / name)
    judged = {"probability_of_update", "long_gap_ratio", "rmse", "large_error_ratio"}
    judged |= {f"probability_of_{one}_update" for one in ("height", "identity")}
    judged |= {f"wrong_{one}_ratio" for one in ("height", "identity")} | {"pair_time_offset"}
    judged |= {"false_update_density"} if "5nm" in name else set()
    assert found.keys() == judged | {"large_error"}


def test_gaps_false_tracks_switches_and_latency(write: Write, truth: Path, tmp_path: Path) -> None:
    rows = shown()
    first, second = rows[:26], rows[26:]
    # from 12 s on; from 40 to 60 s nobody; then another track
    late = [*first[3:10], *(row.replace(",1,", ",9,", 1) for row in first[15:])]
    false = [f"{t},5,-50000,{100 * t}" for t in TIMES[:6]]
    told = judge(write([*late, *second, *false], TRACK_HEAD), "--truth", truth, folder=tmp_path)
    assert told["tracks"] == 4
    assert (told["false tracks"], told["false updates"]) == (1, 6)
    assert told["identity switches"] == 1
    assert (told["latency, median"], told["latency, largest"]) == (6.0, 12.0)
    # 5 of 23 updates of the first are missed in one gap, none of 26
    assert told["probability of update"] == pytest.approx(1 - 5 / 49)
    assert told["share missed in long gaps"] == pytest.approx(5 / 49)
    missing = told["GOSPA, missed"]
    # the first is not shown at 0, 4 and 8 s, nor from 44 to 56 s: at 40 s it is still where it was
    assert missing == pytest.approx(np.sqrt(7 * 1000**2 / 2 / 26))


def test_only_updates_of_confirmed_tracks_count(write: Write, truth: Path, tmp_path: Path) -> None:
    rows = [
        f"{row},{'' if i % 26 == 20 else i},{'false' if i % 26 < 2 else 'true'}"
        for i, row in enumerate(shown())
    ]
    path = write(rows, f"{TRACK_HEAD},plot,confirmed")
    told = judge(path, "--truth", truth, folder=tmp_path)
    assert told["latency, largest"] == 8.0
    assert told["probability of update"] == pytest.approx(1 - 2 / 48)
    assert told["GOSPA, missed"] == pytest.approx(np.sqrt(2 * 2 * 1000**2 / 2 / 26))


def test_normalised_errors(write: Write, truth: Path, tmp_path: Path) -> None:
    """Errors of (3, 4) sigma, uncorrelated and correlated."""
    path = write(
        [
            f"{row},10,10,{c}"
            for row, c in zip(shown(np.array([30.0, 40.0])), [0, 50] * 26, strict=True)
        ],
        f"{TRACK_HEAD},east_sigma_m,north_sigma_m,covariance_east_north_m2",
    )
    told = judge(path, "--truth", truth, folder=tmp_path)
    each = metrics.nees(
        [30.0, 40.0], [[[100.0, 0.0], [0.0, 100.0]], [[100.0, 50.0], [50.0, 100.0]]]
    )
    assert told["NEES per axis"] == pytest.approx(np.mean(each) / 2)
    assert told["share within the 95 % ellipse"] == 0.0


def test_figures_are_those_of_the_library(tmp_path: Path) -> None:
    frame = tracks(*EXAMPLE, "--plans", EXAMPLES / "air_plans.json", folder=tmp_path)
    truth = pl.read_csv(EXAMPLES / "air_truth.csv")
    picture = tmp_path / "p.png"
    arguments = (
        tmp_path / "result.parquet",
        "--truth",
        EXAMPLES / "air_truth.csv",
        "--update-interval",
        5,
    )
    told = judge(*arguments, "--max-distance", 700, "--plot", picture, folder=tmp_path)
    expected = terminal.indicators(frame, truth, max_distance=700.0, update_interval=5.0)
    assert told["probability of update"] == expected.probability_of_update.value > 0.98
    assert told["RMSE"] == expected.rmse.value < 100.0
    assert told["false tracks"] == expected.false_tracks == 0
    assert told["missed targets"] == 0
    assert 0.5 < (told["NEES per axis"] or 0.0) < 1.5
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_tracks_and_truth_of_dates(write: Write, truth: Path, tmp_path: Path) -> None:
    def dated(path: Path) -> Path:
        head, *rows = path.read_text(encoding="utf-8").splitlines()
        cells = [row.split(",", 1) for row in rows]
        start = datetime.datetime(2026, 3, 1, 23, 59)
        moments = [start + datetime.timedelta(seconds=float(t)) for t, _ in cells]
        told = [
            f"{m:%Y-%m-%dT%H:%M:%S},{rest}" for m, (_, rest) in zip(moments, cells, strict=True)
        ]
        return write(told, head, f"dated_{path.name}")

    path = write(shown(np.array([3.0, 4.0])), TRACK_HEAD)
    expected = judge(path, "--truth", truth, folder=tmp_path)
    assert judge(dated(path), "--truth", dated(truth), folder=tmp_path) == expected
    done = run(path, "--truth", dated(truth), command="evaluate")
    assert done.code == 1
    assert "holds numbers" in done.err


@pytest.mark.parametrize(
    ("rows", "header", "message"),
    [
        (["1,A,0,0"], "time_s,who,east_m,north_m", "has no column target"),
        (["1,A,0,0", "1,A,5,0"], TRUTH_HEAD, "line 3: target A has two positions at time_s 1"),
        (["1,A,,0"], TRUTH_HEAD, "line 2: east_m is missing"),
        (["1,A,x,0"], TRUTH_HEAD, "line 2: east_m is 'x'"),
        (["1,,0,0"], TRUTH_HEAD, "line 2: target is missing"),
        ([",A,0,0"], TRUTH_HEAD, "line 2: time_s is missing"),
        ([], TRUTH_HEAD, "true.csv is empty"),
    ],
)
def test_mistakes_in_the_truth(
    rows: list[str], header: str, message: str, write: Write, tmp_path: Path
) -> None:
    output = tmp_path / "o.csv"
    path = write(shown(), TRACK_HEAD)
    arguments = (path, "--truth", write(rows, header, "true.csv"), "--output", output)
    done = run(*arguments, command="evaluate")
    terminal.assert_refused(done, message)
    assert not output.exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--max-distance", 0), "max_distance is 0"),
        (("--update-interval", -4), "update_interval is -4"),
        (("--output", "o.csv", "--targets", "o.csv"), "two results would be written to o.csv"),
    ],
)
def test_wrong_options_of_evaluate(options: Any, message: str, write: Write, truth: Path) -> None:
    done = run(write(shown(), TRACK_HEAD), "--truth", truth, *options, command="evaluate")
    assert done.code == 2
    assert message in done.err
    assert done.err.count("\n") == 1


def test_other_origins_are_suspected(write: Write, truth: Path) -> None:
    path = write(shown(np.array([90e3, 0.0])), TRACK_HEAD)
    done = run(path, "--truth", truth, command="evaluate")
    assert done.code == 0
    assert (
        "no track is within 1000 m of a target: do tracks and truth have the same origin?"
        in done.err
    )


def test_the_example_can_be_made_again() -> None:
    made = runpy.run_path(str(EXAMPLES / "make_air_traffic.py"))
    texts = {"air_radars.toml": made["toml"](), "air_plans.json": made["plan_list"]()}
    for name, rows, header in (
        ("air_plots.csv", made["plot_rows"](), made["PLOT_HEADER"]),
        ("air_truth.csv", made["truth_rows"](), made["TRUTH_HEADER"]),
    ):
        texts[name] = "\n".join(",".join(row) for row in [header, *rows]) + "\n"
    for name, text in texts.items():
        assert (EXAMPLES / name).read_text(encoding="utf-8") == text
    seen = made["record"]()
    found = track(seen.plots, made["radars"](), plans=made["plans"]())
    assert plot.tracks(found).get_title() == "12 tracks"
