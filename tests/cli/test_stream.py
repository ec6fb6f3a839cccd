"""`tertia track --stream`: rows of the library's tracker, flat memory, clean ends."""

import contextlib
import io
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from places import DATA
from terminal import Run, assert_refused, run

from tertia.tracker import Plots, PlotStatus, Radar, Tracker, TrackTable

LEBL = DATA / "lebl_radar" / "plots_0800_0830.csv.gz"
COMMAND = [sys.executable, "-c", "from tertia.cli import main; main()", "track", "--stream"]
HEAD = "time_s,sensor,range_m,azimuth_deg,height_m,identity"
SCAN = 4.0
RADARS = [
    Radar((0.0, 0.0), range_sigma=50.0, azimuth_sigma=0.001, scan_period=SCAN, name="west"),
    Radar((60e3, 5e3), range_sigma=80.0, azimuth_sigma=0.002, scan_period=6.0, name="east"),
]
SITES = """name,east_m,north_m,range_sigma_m,azimuth_sigma_deg,scan_period_s
west,0,0,50,{},4
east,60000,5000,80,{},6
""".format(*np.degrees([0.001, 0.002]))


def recording() -> pl.DataFrame:
    """Return what two radars see of five aircraft in 200 s, and clutter, in order of time."""
    random = np.random.default_rng(3)
    rows = []
    for radar in RADARS:
        for scan in np.arange(0.0, 200.0, radar.scan_period):
            for k in range(5):
                moment = scan + radar.scan_period * (k + 0.5) / 5
                place = np.array([20e3 + 9e3 * k - 120 * moment, 30e3 + 80 * moment])
                east, north = place - radar.position
                rows.append(
                    (
                        round(moment, 3),
                        str(radar.name),
                        round(np.hypot(east, north) + 40 * random.standard_normal(), 1),
                        round(np.degrees(np.arctan2(east, north)) % 360, 4),
                        round(3000 + 500.0 * k, 1),
                        1000 + k,
                    )
                )
            clutter = (round(random.uniform(5e3, 90e3), 1), round(random.uniform(0, 360), 3))
            rows.append((round(scan + 0.01, 3), str(radar.name), *clutter, None, None))
    return pl.DataFrame(rows, HEAD.split(","), orient="row").sort("time_s")


SEEN = recording()
TEXT = SEEN.write_csv()
LINES = TEXT.splitlines()


def plots() -> Plots:
    return Plots(
        SEEN["time_s"].to_numpy(),
        SEEN["range_m"].to_numpy(),
        np.radians(SEEN["azimuth_deg"].to_numpy()),
        sensor=(SEEN["sensor"] == "east").cast(int).to_numpy(),
        height=SEEN["height_m"].fill_null(np.nan).to_numpy(),
        identity=SEEN["identity"].fill_null(-1).to_numpy(),
    )


def stretches(times: Sequence[float], latency: float) -> Iterator[slice]:
    """Yield stretches of plots in order of time."""
    begin = 0
    for at, moment in enumerate(times):
        if moment - times[begin] >= latency:
            yield slice(begin, at)
            begin = at
    yield slice(begin, len(times))


@cache
def expected(latency: float) -> list[TrackTable]:
    tracker, given = Tracker(RADARS), plots()
    return [tracker.update(given[part]) for part in stretches(given.time.tolist(), latency)]


def joined(tables: list[TrackTable], name: str) -> Any:
    return np.concatenate([getattr(table, name) for table in tables])


@pytest.fixture
def sites(tmp_path: Path) -> Path:
    path = tmp_path / "radars.csv"
    path.write_text(SITES, encoding="utf-8")
    return path


def stream(text: str, *arguments: object) -> tuple[int, str, str]:
    done = subprocess.run(
        [*COMMAND, *map(str, arguments)],
        input=text.encode(),
        capture_output=True,
        check=False,
        timeout=120,
    )
    return done.returncode, done.stdout.decode(), done.stderr.decode()


def of_file(path: Path, *arguments: object) -> Run:
    """Run in this process, on a file: nothing has to be started."""
    return run("track", path, "--stream", *arguments)


@pytest.mark.parametrize("separator", [";", "\t"])
def test_decimal_commas(separator: str, sites: Path, write: Callable[..., Path]) -> None:
    text = TEXT.replace(",", separator).replace(".", ",").replace("time_s", "Time [s]")
    usual, other = (of_file(write(one), "--sensors", sites) for one in (TEXT, text))
    assert usual == other
    assert usual.code == 0


@pytest.mark.parametrize("before", ["# of today\n#\n", "# 1,2\n# "])
def test_comments_before_the_header(before: str, sites: Path, write: Callable[..., Path]) -> None:
    usual, other = (of_file(write(one), "--sensors", sites) for one in (TEXT, before + TEXT))
    assert usual == other
    assert usual.code == 0


def check(found: pl.DataFrame, tables: list[TrackTable]) -> None:
    assert found.height == sum(map(len, tables)) > 100
    assert found["track"].to_list() == joined(tables, "track").tolist()
    np.testing.assert_array_equal(found["time_s"], joined(tables, "time"))
    np.testing.assert_array_equal(
        found.select("east_m", "north_m").to_numpy(), joined(tables, "position")
    )
    plot = found["plot"].fill_null(-1).to_numpy()
    np.testing.assert_array_equal(plot, joined(tables, "plot"))
    assert found["confirmed"].all()


@pytest.mark.parametrize("latency", [None, 0.0, 3.0, 1000.0])
def test_rows_are_those_of_the_tracker(
    latency: float | None, sites: Path, write: Callable[..., Path]
) -> None:
    told = () if latency is None else ("--latency", latency)
    code, out, err = of_file(write(TEXT), "--sensors", sites, *told)
    assert (code, err) == (0, "")
    found = pl.read_csv(io.StringIO(out), infer_schema_length=None)
    check(found, expected(SCAN / 4 if latency is None else latency))
    assert found["identity"].drop_nulls().unique().sort().to_list() == list(range(1000, 1005))


def test_standard_input_of_csv_and_json(sites: Path, write: Callable[..., Path]) -> None:
    """JSON has null for what is not known, or nothing at all."""
    _, whole, _ = of_file(write(TEXT), "--sensors", sites)
    assert stream(TEXT, "-", "--sensors", sites) == (0, whole, "")
    lines = [
        json.dumps({name: value for name, value in row.items() if value is not None or at % 2})
        for at, row in enumerate(SEEN.iter_rows(named=True))
    ]
    code, out, err = stream("\n".join(lines), "--sensors", sites)
    assert (code, err) == (0, "")
    check(pl.read_ndjson(io.StringIO(out), infer_schema_length=None), expected(SCAN / 4))
    assert of_file(write("\n".join(lines), "p.jsonl"), "--sensors", sites, "--rows", "csv") == (
        0,
        whole,
        "",
    )
    _, again, _ = of_file(write(TEXT), "--sensors", sites, "--rows", "jsonl")
    assert again == out


def test_order_and_duplicates(sites: Path, write: Callable[..., Path]) -> None:
    """Plots a little late are taken as they come; one that comes twice counts once."""
    order = np.argsort(
        SEEN["time_s"].to_numpy() + np.random.default_rng(1).uniform(0, 0.5, SEEN.height)
    )
    mixed = SEEN[order]
    twice = mixed[np.repeat(np.arange(mixed.height), 1 + (np.arange(mixed.height) % 50 == 7))]
    code, out, err = of_file(write(twice.write_csv()), "--sensors", sites)
    assert code == 0
    assert err == f"{twice.height - mixed.height} plots refused: {PlotStatus.DUPLICATE.message}\n"
    found = pl.read_csv(io.StringIO(out), infer_schema_length=None)
    tidy = sum(map(len, expected(SCAN / 4)))
    assert abs(found.height - tidy) < 0.02 * tidy
    assert found["track"].n_unique() == len(np.unique(joined(expected(SCAN / 4), "track")))


def test_a_wrong_clock_does_not_stop_the_others(sites: Path, write: Callable[..., Path]) -> None:
    stray = LINES[300].replace(LINES[300].split(",")[0], "90000", 1)
    lines = [*LINES[:300], stray, *LINES[300:]]
    code, out, err = of_file(write("\n".join(lines)), "--sensors", sites)
    assert code == 0
    assert err == f"1 plot refused: {PlotStatus.CLOCK_ERROR.message}\n"
    found = pl.read_csv(io.StringIO(out), infer_schema_length=None)
    assert found["track"].n_unique() == len(np.unique(joined(expected(SCAN / 4), "track")))
    # less the error of a clock
    assert found["time_s"].max() == pytest.approx(SEEN["time_s"].max(), abs=0.2)


def test_dates_and_clocks_that_begin_again(sites: Path, write: Callable[..., Path]) -> None:
    _, out, _ = of_file(write(TEXT), "--sensors", sites)
    plain = pl.read_csv(io.StringIO(out), infer_schema_length=None)
    since = pl.duration(milliseconds=1000 * pl.col("time_s"))
    start_of_day = pl.datetime(2026, 3, 1, 10, time_zone="UTC")
    dated = SEEN.with_columns((start_of_day + since).dt.to_string("iso:strict").alias("time_s"))
    code, out, err = of_file(write(dated.write_csv()), "--sensors", sites)
    assert (code, err) == (0, "")
    found = pl.read_csv(io.StringIO(out), infer_schema_length=None)
    moments = found["time_s"].str.to_datetime("%Y-%m-%dT%H:%M:%S%.f%z", time_unit="us")
    told = (moments - moments[0]).dt.total_microseconds() / 1e6
    np.testing.assert_allclose(told, plain["time_s"] - plain["time_s"][0], atol=1e-6)
    late = SEEN.with_columns((pl.col("time_s") + 86_300) % 86_400)
    code, out, err = of_file(write(late.write_csv()), "--sensors", sites, "--clock-period", 86_400)
    assert (code, err) == (0, "")
    found = pl.read_csv(io.StringIO(out), infer_schema_length=None)
    np.testing.assert_allclose(found["time_s"] - 86_300, plain["time_s"], atol=1e-6)
    code, _, err = of_file(write(dated.write_csv()), "--sensors", sites, "--clock-period", 86_400)
    assert (code, err) == (
        2,
        "tertia: --clock-period can be used only if times are in seconds; these plots have dates\n",
    )


BAD = {
    "5,west,far,10,,": "range_m is 'far'; it must be a finite number",
    "5,west,inf,10,,": "range_m is 'inf'; it must be a finite number",
    "noon,west,50000,10,,": "time_s is 'noon'; it must be a number of seconds or a date",
    "2026-03-01T10:00:00,west,50000,10,,": "time_s is '2026-03-01T10:00:00'; it must be a number",
    ",west,50000,10,,": "time_s is missing",
    "5,north,50000,10,,": "sensor is 'north'; the sensors are west, east",
    "5,,50000,10,,": "sensor is missing",
    "5,west,50000,10": "it has 4 fields, the header has 6",
    "5,west,50000,10,,4A": "identity is '4A'; it must be a whole number, 0 or more",
    "\x00\xff": "it has 1 field, the header has 6",
    # what the reader of CSV does not take
    "5,west\r5,10,,": "it has 1 field, the header has 6",
    "5," + 200_000 * "x": "it has 1 field, the header has 6",
}


@pytest.mark.parametrize("bad", BAD, ids=range(len(BAD)))
def test_bad_lines_are_counted_and_the_first_is_told(
    bad: str, sites: Path, write: Callable[..., Path]
) -> None:
    lines = [*LINES[:200], bad, "", *LINES[200:], bad]
    path = write("\n".join(lines))
    code, out, err = of_file(path, "--sensors", sites)
    assert code == 0
    first, second, *others = err.splitlines()
    assert first.startswith(f"tertia: {path}, line 201: {BAD[bad]}")
    assert first.endswith("; such lines are left out")
    assert second == f"2 of {SEEN.height + 2} lines left out"
    assert not others
    found = pl.read_csv(io.StringIO(out), infer_schema_length=None)
    tables = expected(SCAN / 4)
    assert found.height == sum(map(len, tables))
    # the number of a plot is that of its row in the file
    assert found["plot"].max() == SEEN.height


@pytest.mark.parametrize(
    "bad",
    [
        '{"time_s": 5, "sensor": "west"',
        "[1, 2]",
        '{"time_s": 5, "sensor": "west", "azimuth_deg": 3}',
        '{"time_s": 5, "sensor": "west", "range_m": [1], "azimuth_deg": 3}',
        "5,west,50000,10,,",
        200_000 * "[",
        '{"time_s": 5, "sensor": "\\ud800", "range_m": 5e4, "azimuth_deg": 3}',
    ],
    ids=range(7),
)
def test_bad_lines_of_json(bad: str, sites: Path, write: Callable[..., Path]) -> None:
    lines = SEEN.write_ndjson().splitlines()
    code, out, err = of_file(write("\n".join([*lines[:9], bad, *lines[9:]])), "--sensors", sites)
    assert (code, err.count("\n")) == (0, 2)
    assert "line 10: " in err
    assert len(out.splitlines()) == sum(map(len, expected(SCAN / 4)))


@pytest.mark.parametrize(
    ("text", "code", "message"),
    [
        ("", 1, "records.csv is empty"),
        (f"{HEAD}\n", 1, "records.csv is empty"),
        (f"{HEAD}\nx\ny\n", 1, "records.csv: none of 2 lines can be used"),
        (
            f"{HEAD.replace('azimuth_deg', 'a')}\n1\n",
            2,
            "records.csv has no column azimuth_deg; it",
        ),
        (f"{HEAD.replace('range_m', 'r')}\n1\n", 2, "has no column range_m or range_nm; it has"),
        (f"{HEAD.replace('sensor', 'r')}\n1\n", 2, "has no column sensor; it has"),
    ],
)
def test_streams_that_cannot_be_used(
    text: str, code: int, message: str, sites: Path, write: Callable[..., Path]
) -> None:
    done = of_file(write(text), "--sensors", sites)
    assert done[:2] == (code, "")
    assert message in done[2].splitlines()[-1]
    assert "Traceback" not in done[2]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("records.csv", "--stream", "--output", "o.csv"),
            "a stream is written to standard output",
        ),
        (("records.csv", "--stream", "--latency", "-1"), "--latency is -1; it must be a number of"),
        (("a.csv", "b.csv", "--stream"), "a stream is one file, or standard input"),
        (("a.parquet", "--stream"), "cannot stream a.parquet: a stream has lines of CSV or JSON"),
        (("absent.csv", "--stream"), "there is no file absent.csv"),
        (
            ("records.csv", "--stream", "--json"),
            "--json cannot be used with a stream; use --rows jsonl",
        ),
        (("-",), "give files of plots, or --stream to read standard input"),
        ((), "give files of plots, or --stream to read standard input"),
        (
            ("records.csv", "--latency", "1"),
            "--latency, --rows, --send and --control can be used only with --stream",
        ),
    ],
)
def test_wrong_options(arguments: Any, message: str, sites: Path) -> None:
    done = run("track", *arguments, "--sensors", sites)
    assert_refused(done, message)


def test_units_that_look_wrong(sites: Path, write: Callable[..., Path]) -> None:
    frame = SEEN.with_columns(pl.col("azimuth_deg").radians(), pl.col("range_m") / 1000)
    code, _, err = of_file(write(frame.write_csv()), "--sensors", sites)
    assert code == 0
    assert err.count("all azimuths are within 6.3 degrees") == 1
    assert err.count("are they kilometres or nautical miles?") == 1


def test_a_header_where_there_are_no_tracks(sites: Path, write: Callable[..., Path]) -> None:
    code, out, err = of_file(write("\n".join(LINES[:3])), "--sensors", sites)
    assert (code, err) == (0, "")
    assert out.startswith("time_s,track,sensor,plot,")
    assert out.count("\n") == 1


def start(sites: Path, *arguments: object, **options: Any) -> "subprocess.Popen[bytes]":
    return subprocess.Popen(
        [*COMMAND, "--sensors", str(sites), *map(str, arguments)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        **options,
    )


def test_rows_come_while_the_stream_goes_on_and_an_interrupt_ends_it(sites: Path) -> None:
    """Nothing more is written to the pipe, and it remains open."""
    with start(sites, "--latency", 0.2) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdin.write("\n".join(LINES[:300]).encode() + b"\n")
        process.stdin.flush()
        rows = [process.stdout.readline() for _ in range(100)]
        assert rows[0].startswith(b"time_s,")
        assert process.poll() is None
        process.send_signal(signal.SIGINT)
        process.stdout.read()
        assert process.stderr.read() == b""
        assert process.wait(30) == 130


def test_a_reader_that_has_enough(sites: Path) -> None:
    with start(sites) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdin.write((TEXT + "\n".join(LINES[1:200]) + "\n").encode())
        process.stdin.flush()
        process.stdout.readline()
        process.stdout.close()
        # what comes later is written to nobody
        time.sleep(0.2)
        later = SEEN.with_columns(pl.col("time_s") + 200).write_csv(include_header=False)
        # it may have ended before it reads this
        with contextlib.suppress(BrokenPipeError):
            process.stdin.write(later.encode())
            process.stdin.close()
        errors = process.stderr.read().decode()
        assert "Traceback" not in errors
        assert "Broken" not in errors
        assert process.wait(30) == 0


def test_a_tail_goes_on(sites: Path, tmp_path: Path) -> None:
    """The pipe of the documents: what is appended to a file is tracked at once."""
    path = tmp_path / "records.csv"
    path.write_text("\n".join(LINES[:200]) + "\n", encoding="utf-8")
    shell = f"tail -n +1 -f {path} & tail=$!; trap 'kill $tail' EXIT; wait"
    command = " ".join(f"'{part}'" for part in COMMAND)
    with subprocess.Popen(
        ["bash", "-c", f"({shell}) | {command} - --sensors {sites} --latency 0.2 | head -n 150"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    ) as process:
        assert process.stdout is not None
        first = [process.stdout.readline() for _ in range(50)]
        with path.open("a", encoding="utf-8") as file:
            file.write("\n".join(LINES[200:]) + "\n")
        rest = process.stdout.read().splitlines()
        assert len(first) + len(rest) == 150
        os.killpg(process.pid, signal.SIGKILL)


def many(count: int) -> Iterator[str]:
    """Yield the lines of fifty aircraft that fly to and fro."""
    random = np.random.default_rng(1)
    azimuth = np.arange(50) * 7.2
    yield "time_s,range_m,azimuth_deg,identity\n"
    for scan in range(count // 50):
        moment = SCAN * (scan + np.arange(50) / 50)
        way = 30e3 + 2e3 * np.arange(50) + np.abs((200 * moment) % 100e3 - 50e3)
        way += 30 * random.standard_normal(50)
        cells = zip(moment, way, azimuth, range(50), strict=True)
        yield "".join(f"{t:.3f},{r:.1f},{a:.1f},{k}\n" for t, r, a, k in cells)


STATUS = Path("/proc/self/status")
# not getrusage: its peak is that of the parent, too, from before the program was started
PEAK = """
import re
import sys
from tertia.cli import main
try:
    main()
finally:
    status = open("/proc/self/status").read()
    print(re.search(r"VmHWM:\\s+(\\d+) kB", status)[1], file=sys.stderr)
"""


@pytest.mark.skipif(not STATUS.is_file(), reason="there is no /proc")
def test_memory_is_flat(sites: Path, tmp_path: Path) -> None:
    """100 000 plots take hardly more memory than 20 000; their rows alone are 50 MB."""
    sites.write_text("\n".join(SITES.splitlines()[:2]) + "\n", encoding="utf-8")
    peaks, rows = [], []
    for count in (20_000, 100_000):
        path = tmp_path / "many.csv"
        path.write_text("".join(many(count)), encoding="utf-8")
        with path.open("rb") as source, (tmp_path / "out.csv").open("wb") as sink:
            done = subprocess.run(
                [sys.executable, "-c", PEAK, *COMMAND[3:], "--sensors", sites, "--latency", "4"],
                stdin=source,
                stdout=sink,
                stderr=subprocess.PIPE,
                check=True,
                timeout=280,
            )
        # where aircraft turn back at once, a few plots are refused, which is said before
        peaks.append(1024 * int(done.stderr.split()[-1]))
        rows.append((tmp_path / "out.csv").read_bytes().count(b"\n"))
    assert rows[1] > 95_000
    # 1.7 MB at most were seen
    assert peaks[1] - peaks[0] < 4.4e6


@pytest.mark.skipif(not LEBL.is_file(), reason="the recording is not here")
def test_a_real_recording(tmp_path: Path) -> None:
    """As many rows as the confirmed ones of the whole, and the library's own."""
    sites = tmp_path / "lebl.csv"
    head, *_ = SITES.splitlines()
    sites.write_text(f"{head}\nlebl,0,0,50,0.08,4\n", encoding="utf-8")
    source = pl.read_csv(LEBL, infer_schema=False)[:10_000]
    path = tmp_path / "records.csv"
    source.write_csv(path)
    named = ("time_s=tod_s", "range_nm=rho_nm", "azimuth_deg=theta_deg", "flight_level=fl")
    columns = [part for name in (*named, "icao_address=icao24") for part in ("--column", name)]
    code, out, _ = of_file(path, "--sensors", sites, "--latency", 2, *columns)
    assert code == 0
    found = pl.read_csv(
        io.StringIO(out), infer_schema_length=None, schema_overrides={"icao_address": pl.String}
    )
    radar = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0, name="lebl")
    tracker = Tracker([radar])
    number = source["icao24"].str.to_integer(base=16, strict=False).fill_null(-1)
    seen = Plots(
        source["tod_s"].cast(float),
        source["rho_nm"].cast(float) * 1852.0,
        np.radians(source["theta_deg"].cast(float)),
        height=source["fl"].cast(float).fill_null(np.nan) * 30.48,
        icao_address=number.to_numpy(),
    )
    tables = [tracker.update(seen[part]) for part in stretches(seen.time.tolist(), 2.0)]
    assert found.height == sum(map(len, tables)) > 0.9 * source.height
    np.testing.assert_array_equal(
        found.select("east_m", "north_m").to_numpy(), joined(tables, "position")
    )
    np.testing.assert_array_equal(found["plot"].fill_null(-1), joined(tables, "plot"))
