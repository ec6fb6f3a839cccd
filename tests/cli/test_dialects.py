"""Files as people have them: the same results, or one line that helps."""

import gzip
import re
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import polars as pl
import pytest
from terminal import result, run

STATIONS = """
[[station]]
name = "Köln"
east_m = 0.0
north_m = 0.0
azimuth_sigma_deg = 2.0

[[station]]
name = "B"
east_m = 10_000.0
north_m = 0.0
azimuth_sigma_deg = 2.0

[[station]]
name = "C"
east_m = 0.0
north_m = 10_000.0
azimuth_sigma_deg = 2.0
"""
ROWS = [
    ("0.5", "Köln", "45.25"), ("0.5", "B", "-44.75"), ("0.5", "C", "135.5"),
    ("1.5", "Köln", "46.0"), ("1.5", "B", "-46.5"), ("1.5", "C", "134.0"),
]  # fmt: skip


def text(separator: str = ",", comma: str = ".", header: str = "time_s,sensor,azimuth_deg") -> str:
    lines = [header.split(","), *ROWS]
    return "".join(
        separator.join(cell.replace(".", comma) for cell in cells) + "\n" for cells in lines
    )


NOON = datetime(2026, 11, 22, 12)
PLAIN = text()
EXCEL = text(";", ",")
FORMS: dict[str, bytes] = {
    "semicolons": text(";").encode(),
    "decimal commas": EXCEL.encode(),
    "a line that tells spreadsheets the separator": f"sep=;\r\n{EXCEL}".encode(),
    "tabs": text("\t").encode(),
    "tabs and decimal commas": text("\t", ",").encode(),
    "spaces": text(" ").encode(),
    "aligned by spaces": "".join(
        f" {line.replace(',', '     '):20}\n" for line in ["# seen", *PLAIN.splitlines()]
    )
    .replace(" # seen", "# seen")
    .encode(),
    "spaces and decimal commas": text(" ", ",").encode(),
    "line ends of Windows": PLAIN.replace("\n", "\r\n").encode(),
    "line ends of old Macs": PLAIN.replace("\n", "\r").encode(),
    "UTF-8 with a mark": EXCEL.encode("utf-8-sig"),
    "UTF-16 with a mark": PLAIN.encode("utf-16"),
    "UTF-16, big": b"\xfe\xff" + EXCEL.encode("utf-16-be"),
    "UTF-16 without a mark": PLAIN.encode("utf-16-le"),
    "names padded": text(header=" time_s , sensor,azimuth_deg ").encode(),
    "names of another case": text(header="Time_S,SENSOR,Azimuth_Deg").encode(),
    "units in brackets": text(header="Time [s],Sensor,Azimuth (deg)").encode(),
    "a sign for degrees": text(header="Time [s],Sensor,Azimuth [°]").encode(),
    "times of day": PLAIN.replace("0.5,", "00:00:00.5,").replace("1.5,", "0:00:01.5,").encode(),
}


@pytest.fixture
def stations(tmp_path: Path) -> Path:
    path = tmp_path / "stations.toml"
    path.write_text(STATIONS, encoding="utf-8")
    return path


def located(path: Path, stations: Path, *options: object) -> tuple[pl.DataFrame, str]:
    output = path.with_suffix(".parquet")
    done = run("locate", path, "--sensors", stations, "--output", output, *options)
    assert done.code == 0, done.err
    return pl.read_parquet(output), done.err


@pytest.mark.parametrize("form", FORMS)
def test_every_form_gives_the_same(form: str, stations: Path, tmp_path: Path) -> None:
    plain, other = tmp_path / "plain.csv", tmp_path / "other.csv"
    plain.write_text(PLAIN, encoding="utf-8")
    other.write_bytes(FORMS[form])
    expected, _ = located(plain, stations)
    found, said = located(other, stations)
    assert found.equals(expected)
    assert said == ""
    assert expected.height == 2


def test_packed(stations: Path, tmp_path: Path) -> None:
    path = tmp_path / "packed.csv.gz"
    path.write_bytes(gzip.compress(EXCEL.encode()))
    assert located(path, stations)[0].height == 2


def test_an_old_encoding_is_said(stations: Path, tmp_path: Path) -> None:
    path = tmp_path / "old.csv"
    path.write_bytes(EXCEL.encode("cp1252"))
    found, said = located(path, stations)
    assert found.height == 2
    assert said == f"{path} is not UTF-8; it is read as Windows-1252\n"


def test_names_of_columns_in_an_old_encoding(tmp_path: Path) -> None:
    path = tmp_path / "old.csv"
    path.write_bytes("Azimuth [°]\n12\n13\n14\n15\n16\n".encode("cp1252"))
    done = run("bearing", path)
    assert done.code == 0
    assert f"{path} is not UTF-8; it is read as Windows-1252\n" in done.err
    done = run("bearing", path, "--value", "Azimuth [°]")
    assert done.code == 0


def test_json_lines_with_a_mark(tmp_path: Path) -> None:
    path = tmp_path / "marked.jsonl"
    rows = "".join(f'{{"azimuth_deg": {angle}}}\n' for angle in range(12, 17))
    path.write_text(rows, encoding="utf-8-sig")
    assert run("bearing", path).code == 0


@pytest.mark.parametrize(
    ("zero", "one"),
    [
        ("2026-11-22T12:00:00Z", "2026-11-22T12:00:01Z"),
        ("2026-11-22 12:00:00 UTC", "2026-11-22 12:00:01 UTC"),
        ("2026-11-22 13:00:00 +01:00", "2026-11-22 13:00:01+01"),
        ("20261122T120000Z", "20261122T120001Z"),
    ],
)
def test_dates_with_a_zone(zero: str, one: str, stations: Path, tmp_path: Path) -> None:
    path = tmp_path / "dates.csv"
    dated = PLAIN.replace("0.5,", f"{zero},").replace("1.5,", f"{one},")
    path.write_text(dated, encoding="utf-8")
    found, _ = located(path, stations)
    assert found["time_s"].dt.to_string("iso:strict").to_list() == [
        "2026-11-22T12:00:00.000000+00:00",
        "2026-11-22T12:00:01.000000+00:00",
    ]


def test_times_of_day_are_counted_on_after_midnight(stations: Path, tmp_path: Path) -> None:
    path = tmp_path / "night.csv"
    night = PLAIN.replace("0.5,", "23:59:59,").replace("1.5,", "00:00:01,")
    path.write_text(night, encoding="utf-8")
    found, said = located(path, stations)
    assert "times of day after midnight are counted on from 86400 seconds" in said
    assert found["time_s"].to_list() == [86_399.0, 86_401.0]


def test_two_columns_of_nearly_one_name(stations: Path, write: Callable[..., Path]) -> None:
    path = write(PLAIN.replace("time_s,", "Time_s,").replace("sensor", "TIME_S,sensor", 1))
    done = run("locate", path, "--sensors", stations)
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert "has the columns Time_s and TIME_S for time_s" in done.err


def test_bearings_can_be_located_as_they_are(stations: Path, write: Callable[..., Path]) -> None:
    lines = ["sensor,azimuth_deg"]
    lines += [f"{name},{float(angle) + 0.01 * k}" for _, name, angle in ROWS[:3] for k in range(9)]
    bearings, path = write(lines), write("", "found.csv")
    assert run("bearing", bearings, "--by", "sensor", "--output", path).code == 0
    found, _ = located(path, stations)
    assert found["time_s"].to_list() == [0.0]
    assert found["east_m"].item() == pytest.approx(5000.0, rel=0.05)
    # several instants without times
    done = run("locate", bearings, "--sensors", stations)
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert "has no column time_s" in done.err
    assert "if targets do not move, a tolerance of inf combines the measurements" in done.err


def test_a_code_may_be_written_as_a_number(write: Callable[..., Path]) -> None:
    radars = write(
        '[[radar]]\nname = "A"\neast_m = 0\nnorth_m = 0\nrange_sigma_m = 50\n'
        "azimuth_sigma_deg = 0.1\nscan_period_s = 4\n",
        "radars.toml",
    )
    rows = [f"{4 * k},{20_000 + 400 * k},45.0,4204.0" for k in range(9)]
    plots = write(["time_s,range_m,azimuth_deg,mode_3a", *rows])
    output = plots.with_suffix(".parquet")
    assert run("track", plots, "--sensors", radars, "--output", output).code == 0
    assert set(pl.read_parquet(output)["mode_3a"]) == {"4204"}


LONG = "x" * 300


@pytest.mark.parametrize(
    "arguments",
    [
        ("bearing", f"{LONG}.csv"),
        ("bearing", "{plain}", "--output", f"{LONG}.csv"),
        ("locate", f"{LONG}.csv", "--sensors", "{stations}"),
        ("locate", "{plain}", "--sensors", f"{LONG}.toml"),
        ("locate", "{plain}", "--sensors", f"{LONG}.csv"),
        ("track", f"{LONG}.ast", "--sensors", "{stations}"),
        ("track", "--stream", f"{LONG}.csv", "--sensors", "{stations}"),
        ("simulate", LONG),
        ("evaluate", "{plain}", "--truth", f"{LONG}.csv"),
    ],
)
def test_a_name_too_long(arguments: tuple[str, ...], stations: Path, tmp_path: Path) -> None:
    plain = tmp_path / "plain.csv"
    plain.write_text(PLAIN, encoding="utf-8")
    done = run(*(one.format(plain=plain, stations=stations) for one in arguments))
    assert done.code in {1, 2}
    assert done.err.count("\n") == 1


def test_swapped_latitude_and_longitude_are_suspected(write: Callable[..., Path]) -> None:
    pytest.importorskip("pyproj")
    stations = STATIONS.replace("east_m = 0.0", "latitude_deg = 152.0")
    stations = stations.replace("east_m = 10_000.0", "latitude_deg = 152.1")
    path = write(stations.replace("north_m", "longitude_deg"), "swapped.toml")
    done = run("locate", write(PLAIN), "--sensors", path)
    assert (done.code, done.err.count("\n")) == (1, 1)
    assert "are latitude and longitude swapped?" in done.err
    tracks = write(["time_s,track,east_m,north_m", "0,1,0,0", "4,1,400,0"], "tracks.csv")
    lines = ["time_s,target,latitude_deg,longitude_deg", "0,A,11,52", "4,A,11.006,52"]
    truth = write(lines, "truth.csv")
    done = run("evaluate", tracks, "--truth", truth, "--origin", "52,11", "--update-interval", 4)
    assert "are latitude_deg and longitude_deg swapped?" in done.err


@pytest.mark.parametrize(
    ("form", "value"),
    [
        ("45°15'00\"", 45.25), ("45° 15′ 00,0″", 45.25), ("45°15'", 45.25), ("45.25°", 45.25),
        ("45-15-00", 45.25), ("45 15 00.0", 45.25), ("45:15:00", 45.25), ("45d15m0s", 45.25),
        ("4515.00N", 45.25), ("04515E", 45.25), ("451500N", 45.25), ("0003036W", -0.51),
        ("-0°30'36\"", -0.51), ("−0.51", -0.51), ("0°30'36\"W", -0.51), ("N45°15'", 45.25),
    ],
)  # fmt: skip
def test_degrees_minutes_and_seconds(
    form: str, value: float, write: Callable[..., Path], tmp_path: Path
) -> None:
    plain, sexagesimal = (
        result("bearing", write(["azimuth_deg", cell, *"12345"]), folder=tmp_path)
        for cell in (str(value), '"{}"'.format(form.replace('"', '""')))
    )
    assert sexagesimal.equals(plain)


def test_a_cell_missing_between_spaces(tmp_path: Path) -> None:
    """Which one is missing cannot be known."""
    path = tmp_path / "in.csv"
    path.write_text(text(" ").replace("1.5 B", "1.5  "), encoding="utf-8")
    done = run("bearing", path)
    assert done.code == 1
    assert "line 6 has 2 fields, the header has 3; between spaces, a missing value must" in done.err


@pytest.mark.parametrize("form", ["N45°E", "-45°W", "45°75'", "30-35", "4575N", "north"])
def test_what_is_no_angle(form: str, write: Callable[..., Path]) -> None:
    done = run("bearing", write(["azimuth_deg", *5 * [form]]))
    assert done.code == 1
    assert "it must be a finite number" in done.err


@pytest.mark.parametrize(
    ("form", "cell", "first"),
    [
        ("%d.%m.%Y %H:%M:%S,%f", "22.11.2026 12:00:0{},500", NOON + timedelta(seconds=0.5)),
        ("%d.%m.%Y %H:%M:%S:%f", "22.11.2026 12:00:0{}:000005", NOON + timedelta(microseconds=5)),
        ("%H:%M:%S;%f", "12:00:0{};500", 43200.5),
        ("%x %X.%f", "11/22/26 12:00:0{}.5", NOON + timedelta(seconds=0.5)),
    ],
)  # fmt: skip
def test_fractions_and_dates_in_formats(
    form: str, cell: str, first: datetime | float, stations: Path, tmp_path: Path
) -> None:
    path = tmp_path / "in.csv"
    rows = ["\t".join([cell.format(time[0]), *rest]) for time, *rest in ROWS]
    path.write_text("\n".join(["time_s\tsensor\tazimuth_deg", *rows]), encoding="utf-8")
    frame, notes = located(path, stations, "--time-format", form)
    assert frame["time_s"][0] == first
    assert notes == ""


def test_a_format_that_is_not_possible(stations: Path, tmp_path: Path) -> None:
    path = tmp_path / "in.csv"
    path.write_text(PLAIN, encoding="utf-8")
    done = run("locate", path, "--sensors", stations, "--time-format", "%d.%m.%y %I:%M")
    assert done.code == 1
    assert done.err.count("\n") == 1


@pytest.mark.parametrize("bad", ['1,"of a cell', "1," + 200_000 * "x"])
def test_a_cell_without_an_end(bad: str, tmp_path: Path) -> None:
    path = tmp_path / "in.csv"
    path.write_text("azimuth_deg,note\n" + bad + "\n" + 60_000 * "2,x\n" + "1,2,3\n")
    done = run("bearing", path)
    assert done.code == 1
    assert re.fullmatch("tertia: .*in.csv: up to line .* is a quotation mark missing.\n", done.err)


def test_json_lines_nested_too_deeply(tmp_path: Path) -> None:
    path = tmp_path / "in.jsonl"
    path.write_text('{"azimuth_deg": 1}\n{"azimuth_deg": ' + 50_000 * "[" + "\n")
    done = run("bearing", path)
    assert done.code == 1
    assert done.err == f"tertia: {path}, line 2: each line must be a JSON object with the columns\n"
