"""Every mistake that new users make with files and options: right, or one line that helps.

A case changes a good scene in one place. It says what must come out: the tracks of the good scene
(`None`), the tracks with a warning, or an error, always in one line of which a pattern is given.
"""

import gzip
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl
import pytest
from terminal import run
from typer.main import get_command

from tertia import cli, tables
from tertia.geo import LocalFrame
from tertia.sensors import Station
from tertia.tracker import Plots, Radar, track

COUNT, PERIOD = 24, 4.0
HEADER = "time_s,sensor,range_m,azimuth_deg,height_m,mode_3a"
SENSORS = """[[radar]]
name = "west"
latitude_deg = 50.0
longitude_deg = 14.0
range_sigma_m = 40.0
azimuth_sigma_deg = 0.08
scan_period_s = 4.0
trusted = true
[[radar]]
name = "east"
latitude_deg = 50.1
longitude_deg = 14.4
range_sigma_m = 40.0
azimuth_sigma_deg = 0.08
scan_period_s = 4.0
trusted = true
"""
LONG = "x" * 300


def rows() -> list[dict[str, str]]:
    """Return the plots of one aircraft by two radars, as cells of text."""
    found = []
    for k in range(COUNT):
        for name, place, after in (("west", (50.0, 14.0), 0.0), ("east", (50.1, 14.4), 1.5)):
            time = PERIOD * k + after
            at = 50.4 - 0.0008 * time, 14.1 + 0.0025 * time, 5000.0
            polar = LocalFrame(*place).geodetic_to_polar(*at)
            cells = time, name, polar[0], np.degrees(polar[1]) % 360.0, 5000.0, "4204"
            found.append(dict(zip(HEADER.split(","), map(str, cells), strict=True)))
    return found


Rows = list[dict[str, str]]


def text(cells: Rows, separator: str = ",", header: str | None = None) -> str:
    lines = [header or separator.join(cells[0]), *(separator.join(one.values()) for one in cells)]
    return "\n".join(lines) + "\n"


def each(column: str, change: Callable[[str], object], where: Any = None) -> Callable[[Rows], Rows]:
    """Return what changes the cells of a column, by default all of them."""

    def changed(cells: Rows) -> Rows:
        return [
            one | ({column: str(change(one[column]))} if where is None or at in where else {})
            for at, one in enumerate(cells)
        ]

    return changed


def clock(form: str) -> Callable[[str], str]:
    """Return what writes seconds as the time of a day."""

    def written(cell: str) -> str:
        minute, second = divmod(float(cell), 60.0)
        return form.format(minute=int(minute), second=f"{second:06.3f}")

    return written


def commas(cells: Rows) -> str:
    return text([{k: v.replace(".", ",") for k, v in one.items()} for one in cells], ";")


def damaged(contents: bytes) -> bytes:
    middle = len(contents) // 2
    return contents[:middle] + bytes([contents[middle] ^ 0xFF]) + contents[middle + 1 :]


class Case(NamedTuple):
    """A mistake: how plots or sensors differ, options, and what is said."""

    plots: Callable[[Rows], Rows | str | bytes] = lambda cells: cells
    said: str | None = None
    fails: bool = False
    same: bool = True
    sensors: Callable[[str], str | bytes] = lambda words: words
    name: str = "plots.csv"
    options: tuple[object, ...] = ()


def renamed(header: str) -> Callable[[Rows], str]:
    return lambda cells: text(cells, header=header)


def failing(said: str, plots: Any = lambda cells: cells, **more: Any) -> Case:
    return Case(plots, said, fails=True, **more)


CASES = {
    # how tables are written
    "semicolons": Case(lambda cells: text(cells, ";")),
    "tabs": Case(lambda cells: text(cells, "\t")),
    "bars": Case(lambda cells: text(cells, "|")),
    "decimal commas": Case(commas),
    "UTF-16": Case(lambda cells: text(cells).encode("utf-16")),
    "UTF-16, packed": Case(
        lambda cells: gzip.compress(commas(cells).encode("utf-16")), name="plots.csv.gz"
    ),
    "byte order mark": Case(lambda cells: text(cells).encode("utf-8-sig")),
    "CRLF": Case(lambda cells: text(cells).replace("\n", "\r\n")),
    "names padded": Case(renamed(HEADER.replace(",", " , "))),
    "names in capitals": Case(renamed(HEADER.upper())),
    "units in brackets": Case(renamed(HEADER.replace("range_m", "Range [m]"))),
    "name missing": failing(
        r"has no column range_m or range_nm; it has time_s, sensor, rho",
        renamed(HEADER.replace("range_m", "rho")),
    ),
    "name misspelt": failing(
        "has no column azimuth_deg .did you mean azimut",
        renamed(HEADER.replace("azimuth_deg", "azimut")),
    ),
    "letters swapped": failing(
        "no column range_m or range_nm .did you mean rnage_m",
        renamed(HEADER.replace("range", "rnage"))
    ),
    "another unit": failing(
        "no column range_m or range_nm; range_km is in another unit",
        renamed(HEADER.replace("range_m", "range_km")),
    ),
    "an optional name misspelt": Case(
        renamed(HEADER.replace("height_m", "heigth_m")),
        "has no column height_m or flight_level .did you mean heigth_m", same=False,
    ),
    "comments": Case(lambda cells: f"# of 22 Nov., \"west\"; and east\n#\n{text(cells)}"),
    "comments, Excel": Case(lambda cells: f"# 1,5\n{commas(cells)}".encode("utf-16")),
    "header as a comment": Case(lambda cells: f"# of numpy\n# {text(cells)}"),
    "wrong after comments": failing(
        "line 8: range_m is 'about 12'",
        lambda cells: "#\n#,,,,,,,\n#\n" + text(each("range_m", lambda _: "about 12", {3})(cells)),
    ),
    "too long after comments": failing(
        "line 51 has 8 fields, the header has 6", lambda cells: f"#\n{text(cells)}1,2,3,4,5,6,7,8\n"
    ),
    "name given": Case(
        renamed(HEADER.replace("range_m", "rho")), options=("--column", "range_m=rho")
    ),
    "no header": failing(
        "its first line has numbers", lambda cells: "\n".join(f"{k},2,3" for k in range(9))
    ),
    "text in a number": failing(
        r"line 5: range_m is 'about 12'; it must be a finite number",
        each("range_m", lambda _: "about 12", {3}),
    ),
    "a field too many": failing(
        r"line 50 has 8 fields, the header has 6", lambda cells: text(cells) + "1,2,3,4,5,6,7,8\n"
    ),
    "a blank line": Case(lambda cells: text(cells) + "\n\n"),
    "empty": failing("is empty", lambda cells: ""),
    "header alone": failing("is empty", lambda cells: HEADER + "\n"),
    "gzip damaged": failing(
        "cannot read", lambda cells: damaged(gzip.compress(text(cells).encode())),
        name="plots.csv.gz",
    ),
    "gzip cut off": failing(
        "unexpected end of file", lambda cells: gzip.compress(text(cells).encode())[:400],
        name="plots.csv.gz",
    ),
    "no gzip": failing("it is not compressed by gzip", text, name="plots.csv.gz"),
    "a workbook": failing("it is a workbook", lambda cells: b"PK\x03\x04" + b"\0" * 99),
    "a PDF": failing("it is a PDF", lambda cells: b"%PDF-1.7\n" + b"\xe2\xe3" * 99),
    # units
    "radians": Case(
        each("azimuth_deg", lambda cell: np.radians(float(cell))), "are they radians", same=False
    ),
    "kilometres": Case(
        each("range_m", lambda cell: float(cell) / 1e3), "are they kilometres", same=False
    ),
    "feet": Case(
        each("height_m", lambda cell: 30_000.0), "is it in feet", same=False
    ),
    "a hundred turns": failing(
        "line 4: azimuth_deg is 36000; it must be between -720 and 720",
        each("azimuth_deg", lambda _: 36_000, {2}),
    ),
    "sigma in radians": Case(
        sensors=lambda words: words.replace("= 0.08", "= 0.0014", 1),
        said="azimuth_sigma_deg of west is 0.0014 degrees: is it in radians", same=False,
    ),
    "a negative range": Case(each("range_m", lambda _: -9999, {7}), same=False),
    "negative ranges": failing(
        "no plot can be used: .* the range is not positive", each("range_m", lambda _: -9999)
    ),
    # sensors
    "swapped, one impossible": failing(
        "between -90 and 90; are latitude and longitude swapped",
        sensors=lambda words: words.replace("50.1", "114.4"),
    ),
    "swapped, one of two": Case(
        sensors=lambda words: words.replace("50.1", "x").replace("14.4", "50.1").replace("x", "14"),
        said="km from the origin: are latitude and longitude swapped", same=False,
    ),
    "unknown sensor": failing(
        "line 3: sensor is 'EAST 2'; the sensors are west, east",
        each("sensor", lambda cell: "EAST 2" if cell == "east" else cell),
    ),
    "two of one name": failing(
        "there are two radars west", sensors=lambda words: words.replace("east", "west")
    ),
    "a key misspelt": failing(
        "scan_period_s of west is missing .did you mean scan_period",
        sensors=lambda words: words.replace("scan_period_s", "scan_period"),
    ),
    "keys in capitals": Case(sensors=lambda words: words.replace("range_sigma_m", "RANGE_SIGMA_M")),
    "a comma in TOML": failing(
        r"sensors.toml: .*line 3", sensors=lambda words: words.replace("50.0", "50,0")
    ),
    "TOML in UTF-16": Case(sensors=lambda words: words.encode("utf-16")),
    "TOML with a mark": Case(sensors=lambda words: words.encode("utf-8-sig")),
    # times
    "backwards": Case(lambda cells: cells[::-1], same=False),
    "repeated": Case(lambda cells: [one for one in cells for _ in range(2)], same=False),
    "milliseconds": failing(
        "is it in milliseconds", each("time_s", lambda cell: 1.7638e12 + 1e3 * float(cell))
    ),
    "zone": Case(
        each("time_s", clock("2026-11-22T12:{minute:02d}:{second}+01:00")), same=False
    ),
    "UTC": Case(each("time_s", clock("2026-11-22 12:{minute:02d}:{second} UTC")), same=False),
    "compact": Case(each("time_s", clock("20261122T12{minute:02d}{second}Z")), same=False),
    "time of day": Case(each("time_s", clock("12:{minute:02d}:{second}")), same=False),
    "local dates": failing(
        "or give --time-format, for example",
        each("time_s", clock("22.11.2026 12:{minute:02d}:{second}")),
    ),
    "local dates, said": Case(
        each("time_s", clock("22.11.2026 12:{minute:02d}:{second}")),
        options=("--time-format", "%d.%m.%Y %H:%M:%S.%f"), same=False,
    ),
    "half a day, said": Case(
        each("time_s", clock("{second} {minute:02d} 01 PM")),
        options=("--time-format", "%S.%f %M %I %p"), same=False,
    ),
    "another format": failing(
        "line 2: time_s is '0.0'; it must be in the time format %d.%m.%Y",
        options=("--time-format", "%d.%m.%Y"),
    ),
    "some with a zone": failing(
        "like the other times",
        each("time_s", clock("2026-11-22T12:{minute:02d}:{second}Z"), range(9)),
    ),
    # identities and heights
    "codes as numbers": Case(each("mode_3a", lambda cell: cell + ".0")),
    "an impossible code": failing(
        "line 6: mode_3a is '4289'; it must be octal digits",
        each("mode_3a", lambda _: "4289", {4}),
    ),
    "heights missing": Case(each("height_m", lambda _: "", range(0, 48, 5)), same=False),
    "heights of nothing": Case(each("height_m", lambda _: "-"), same=False),
    # few
    "one row": Case(lambda cells: cells[:1], "no track was confirmed", same=False),
    "one of an aircraft": Case(
        lambda cells: [*cells, cells[-1] | {"mode_3a": "1234", "range_m": "9000"}], same=False
    ),
}  # fmt: skip


def scene(folder: Path, case: Case) -> tuple[Path, Path]:
    """Write plots and sensors with the mistake."""
    cells = case.plots(rows())
    contents = text(cells) if isinstance(cells, list) else cells
    words = case.sensors(SENSORS)
    plots, sensors = folder / case.name, folder / "sensors.toml"
    for path, one in ((plots, contents), (sensors, words)):
        path.write_bytes(one.encode() if isinstance(one, str) else one)
    return plots, sensors


def tracked(folder: Path, case: Case) -> tuple[int, str, pl.DataFrame | None]:
    """Return the exit code, what was said, and the tracks."""
    plots, sensors = scene(folder, case)
    output = folder / "tracks.parquet"
    done = run("track", plots, "--sensors", sensors, *case.options, "--output", output)
    return done.code, done.err, pl.read_parquet(output) if output.exists() else None


@pytest.mark.parametrize("name", CASES)
def test_mistakes_in_plots(name: str, tmp_path: Path) -> None:
    case = CASES[name]
    code, said, found = tracked(tmp_path, case)
    # a hint may stand before an error
    assert said.count("\n") <= (0 if case.said is None else 2)
    assert "Traceback" not in said
    if case.said is not None:
        assert re.search(case.said, said), said
    assert (code != 0) == case.fails, said
    if found is None:
        assert case.fails
        return
    good = tmp_path / "good"
    good.mkdir()
    _, _, expected = tracked(good, Case())
    assert expected is not None
    assert expected.height > COUNT
    if case.same:
        assert found.equals(expected)
    elif case.said is None:
        # dates in place of seconds, or plots more and fewer: the aircraft is where it was
        last, same = (
            one.filter(pl.col("track") == one["track"][0]).tail(1) for one in (found, expected)
        )
        for column in ("east_m", "north_m"):
            assert last[column].item() == pytest.approx(same[column].item(), abs=200.0)


def folder(path: Path) -> Path:
    path.mkdir()
    return path


def link(path: Path, to: Path) -> Path:
    path.symlink_to(to)
    return path


def locked(path: Path) -> Path:
    path.parent.chmod(0o500)
    if os.access(path.parent, os.W_OK):
        pytest.skip("root may write everywhere")
    return path


# from where the output would be, what is there in its place, and what is said
OUTPUTS: dict[str, tuple[Callable[[Path], Path], str | None]] = {
    "a long name": (lambda path: path.with_stem(LONG), "File name too long"),
    "a folder": (folder, "Is a directory"),
    "a link to a file": (lambda path: link(path, path.with_stem("real")), None),
    "a link to a folder": (
        lambda path: link(path, folder(path.with_stem("there"))), "Is a directory"
    ),
    "a link to nothing": (
        lambda path: link(path, path.parent / "absent" / "x"), "No such file or directory"
    ),
    "a link to itself": (lambda path: link(path, path), "Too many levels of symbolic links"),
    "not writable": (locked, "Permission denied"),
    "in no folder": (lambda path: path.parent / "absent" / path.name, "No such file or directory"),
    "of another kind": (lambda path: path.with_suffix(".xlsx"), "its name must end in .(csv|html)"),
}  # fmt: skip


@pytest.mark.parametrize(("command", "suffix"), [("track", ".csv"), ("report", ".html")])
@pytest.mark.parametrize("name", OUTPUTS)
def test_outputs(name: str, command: str, suffix: str, tmp_path: Path) -> None:
    plots, sensors = scene(tmp_path, Case())
    make, said = OUTPUTS[name]
    output = make(tmp_path / f"out{suffix}")
    done = run(command, plots, "--sensors", sensors, "--output", output)
    if said is None:
        assert done.code == 0
        assert output.is_symlink()
        assert output.stat().st_size > 1000
        return
    assert done.code in {1, 2}
    # before anything was computed
    assert done.out == ""
    assert re.fullmatch(f"tertia: cannot write .*{said}.*\n", done.err), done.err


def test_measurements_are_not_overwritten(tmp_path: Path) -> None:
    plots, sensors = scene(tmp_path, Case())
    before = plots.read_bytes()
    other = tmp_path / "other.csv"
    other.symlink_to(plots)
    for output in (plots, other):
        done = run("track", plots, "--sensors", sensors, "--output", output)
        assert (done.code, done.out) == (2, "")
        assert done.err == f"tertia: cannot write {output}: it contains the measurements\n"
    assert plots.read_bytes() == before


@pytest.mark.parametrize("command", ["register", "report"])
def test_noise_beyond_any_direction(command: str, tmp_path: Path) -> None:
    """Kilometres for metres: the azimuths of the targets say nothing."""
    radars = "".join(
        f'[[radar]]\nname = "{name}"\neast_m = {east}\nnorth_m = 0\nrange_sigma_m = 50\n'
        "azimuth_sigma_deg = 0.08\nscan_period_s = 4\n"
        for name, east in (("east", 0), ("west", 20))
    )
    rng = np.random.default_rng(1)
    lines = ["time_s,sensor,range_m,azimuth_deg,mode_3a"]
    for k in range(100):
        for one, name in enumerate(("east", "west")):
            for code in range(1, 9):
                place = 10 * code + 0.8 * k + rng.normal(0, 0.05)
                row = (4 * k + one, name, place, rng.uniform(0, 360), f"{code:04o}")
                lines.append(",".join(map(str, row)))
    (tmp_path / "s.toml").write_text(radars, encoding="utf-8")
    (tmp_path / "plots.csv").write_text("\n".join(lines), encoding="utf-8")
    output = tmp_path / ("out.html" if command == "report" else "out.csv")
    done = run(
        command, tmp_path / "plots.csv", "--sensors", tmp_path / "s.toml", "--output", output
    )
    assert done.code == 0, done.err
    assert "are they kilometres or nautical miles" in done.err
    assert "degrees=True" not in done.err


STATIONS = """[[station]]
name = "A"
east_m = 0.0
north_m = 0.0
azimuth_sigma_deg = 1.0
[[station]]
name = "B"
east_m = 10_000.0
north_m = 0.0
azimuth_sigma_deg = 1.0
"""
JITTERED = [
    f"{t + d:.2f},{s},{a}" for t in range(9) for s, a, d in (("A", 45, 0), ("B", -45, 0.01))
]
# command, header and rows, options, what is said
GROUPS: dict[str, tuple[str, list[str], tuple[str, ...], str | None]] = {
    "bearing of one row": (
        "bearing", ["target,azimuth_deg", "one,45", *(f"many,{50 + k % 3}" for k in range(20))],
        ("--by", "target"), "1 of 2 groups could not be estimated",
    ),
    "smooth of one row": (
        "smooth", ["time_s,target,east_m,north_m,s", "0,one,1,1,5",
                   *(f"{k},many,{k},{2 * k},5" for k in range(20))],
        ("--by", "target", "--sigma", "s"), "",
    ),
    "fuse-series of one row": (
        "fuse-series", ["time_s,sensor,target,azimuth_deg", "0,a,one,45"],
        ("--by", "target"), "at least 10 are needed: give the sigma of a",
    ),
    "weights of one row": (
        "weights", ["sensor,v", "a,1", "b,2", "b,2.1"], ("--value", "v"),
        "sensor a has 1 measurement; its weight needs at least two",
    ),
    "locate of one row": (
        "locate", ["time_s,sensor,azimuth_deg", "0,A,45"], ("--sensors", "{stations}"), "",
    ),
    "locate of times that differ": (
        "locate", ["time_s,sensor,azimuth_deg", *JITTERED], ("--sensors", "{stations}"),
        "no two sensors measured at the same time, and the times differ by .* s: give a tolerance",
    ),
    "the same with a tolerance": (
        "locate", ["time_s,sensor,azimuth_deg", *JITTERED],
        ("--sensors", "{stations}", "--tolerance", "0.1"), None,
    ),
    "reconstruct with a tolerance": (
        "reconstruct", ["time_s,sensor,azimuth_deg", *JITTERED],
        ("--sensors", "{stations}", "--tolerance", "0.1"), None,
    ),
    "a second measurement": (
        "locate", ["time_s,sensor,azimuth_deg", "0,A,45", "0,A,46", "0,B,-45"],
        ("--sensors", "{stations}"), "line 3: azimuth is given twice for this sensor",
    ),
    "an unknown station": (
        "locate", ["time_s,sensor,azimuth_deg", "0,A,45", "0,b,46"],
        ("--sensors", "{stations}"), "line 3: sensor is 'b'; the sensors are A, B",
    ),
    "a duplicate station": (
        "locate", ["time_s,sensor,azimuth_deg", "0,A,45"], ("--sensors", "{twice}"),
        "there are two stations A",
    ),
    "a negative range of a station": (
        "locate", ["time_s,sensor,range_m", "0,A,-45", "0,B,20"], ("--sensors", "{stations}"),
        "line 2: range is -45; it must be positive",
    ),
    "a column twice": (
        "bearing", ["azimuth_deg,azimuth_deg", *(f"{50 + k % 3},{k}" for k in range(20))], (),
        "has two columns azimuth_deg",
    ),
    "no ranges of a radar beside finders": (
        "track", ["time_s,sensor,distance,azimuth_deg", "0,west,20000,45", "4,west,20100,45"],
        ("--sensors", "{mixed}"), "no column range_m or range_nm .did you mean distance",
    ),
    "tracks at one time": (
        "evaluate", ["time_s,track,east_m,north_m", "0,1,0,0", "0,1,1,0"], ("--truth", "{truth}"),
        "give update_interval",
    ),
    "tracks of another time": (
        "evaluate", ["time_s,track,east_m,north_m", "9,1,0,0", "13,1,1,0"],
        ("--truth", "{truth}"), "the times of .*table.csv and those of .*truth.csv do not overlap",
    ),
    "a track of one row": (
        "evaluate", ["time_s,track,east_m,north_m", "0,1,0,0"], ("--truth", "{truth}"),
        "give update_interval",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", GROUPS)
def test_small_and_crooked_groups(name: str, tmp_path: Path) -> None:
    command, lines, options, said = GROUPS[name]
    files = {
        "stations": ("stations.toml", STATIONS),
        "twice": ("twice.toml", STATIONS.replace('"B"', '"A"')),
        "mixed": ("mixed.toml", SENSORS + STATIONS),
        "truth": ("truth.csv", "time_s,target,east_m,north_m\n0,1,0,0\n"),
    }
    paths = {key: tmp_path / file for key, (file, _) in files.items()}
    for key, (_, contents) in files.items():
        paths[key].write_text(contents, encoding="utf-8")
    table = tmp_path / "table.csv"
    table.write_text("\n".join(lines) + "\n", encoding="utf-8")
    done = run(command, table, *(one.format(**paths) for one in options))
    assert done.err.count("\n") <= 1
    if said is None:
        assert (done.code, done.err) == (0, "")
    else:
        assert re.search(said, done.err), done.err


def test_settings_are_options_of_the_command(tmp_path: Path) -> None:
    plots, sensors = scene(tmp_path, Case())
    plain, told = tmp_path / "plain.parquet", tmp_path / "told.parquet"
    words = (
        f'sensors = "{sensors}"\n[track]\nfiles = "{plots}"\nmotion = "cv"\n[locate]\nrisk = 1\n'
    )
    settings = tmp_path / "settings.toml"
    settings.write_bytes(words.encode("utf-8-sig"))
    assert run("track", "--settings", settings, "--output", told).code == 0
    assert run("track", plots, "--sensors", sensors, "--motion", "cv", "--output", plain).code == 0
    assert pl.read_parquet(told).equals(pl.read_parquet(plain))
    # the command line comes first
    assert run("track", "--settings", settings, "--motion", "imm", "--output", told).code == 0
    assert not pl.read_parquet(told).equals(pl.read_parquet(plain))


COMMANDS = getattr(get_command(cli.app), "commands")  # noqa: B009  # of a group of commands


@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_every_command_has_settings(command: str, tmp_path: Path) -> None:
    settings = tmp_path / "settings.toml"
    settings.write_text(f"[{command}]\ntime-format = '%d'\nnonsense = 1\n", encoding="utf-8")
    done = run(command, "--settings", settings)
    assert (done.code, done.out, done.err.count("\n")) == (2, "", 1)
    assert f"nonsense is not an option of {command}; it has " in done.err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("motions = 3", "motions is not an option of track; it has "),
        ("track = 3", "track is not a table of options"),
        ("motion = [", "cannot read"),
        ("settings = 'other.toml'", "settings is not an option of track"),
    ],
)
def test_settings_that_are_none(words: str, said: str, tmp_path: Path) -> None:
    settings = tmp_path / "settings.toml"
    settings.write_text(words, encoding="utf-8")
    done = run("track", "plots.csv", "--settings", settings)
    assert (done.code in {1, 2}, done.err.count("\n")) == (True, 1)
    assert said in done.err
    done = run("track", "plots.csv", "--settings", tmp_path / f"{LONG}.toml")
    assert (done.code, done.err.count("\n")) == (1, 1)


ISO = ["2026-11-22T12:00:00Z", "2026-11-22T12:00:04.5Z", "2026-11-22T13:00:08+01:00"]
SECONDS = [1_795_348_800.0, 1_795_348_804.5, 1_795_348_808.0]


def _pandas(values: list[str]) -> Any:
    return pytest.importorskip("pandas").to_datetime(values, utc=True, format="ISO8601")


FORMS: dict[str, Callable[[list[str]], Any]] = {
    "text": list,
    "column of text": pl.Series,
    "dates of Polars": lambda values: pl.Series(values).str.to_datetime(time_zone="UTC"),
    "index of pandas": _pandas,
    "column of pandas": lambda values: _pandas(values).to_series(),
    "dates": lambda values: _pandas(values).to_pydatetime(),
    "numpy": lambda values: _pandas(values).tz_localize(None).to_numpy(),
}


@pytest.mark.parametrize("form", FORMS)
def test_times_of_arrays_may_be_dates(form: str) -> None:
    plots = Plots(FORMS[form](ISO), [1e4, 1.1e4, 1.2e4], [0.0, 0.0, 0.0])
    np.testing.assert_array_equal(plots.time, SECONDS)
    radar = Radar(range_sigma=50.0, azimuth_sigma=0.001, scan_period=4.0)
    assert track(plots, [radar]).time.min() == SECONDS[0]


@pytest.mark.parametrize("form", FORMS)
def test_times_of_tables_may_be_dates(form: str) -> None:
    stations = [
        Station((x, 0.0), name=name, azimuth_sigma=0.01) for name, x in (("A", 0.0), ("B", 1e4))
    ]
    if form == "dates":
        pytest.skip("no column of a table")
    table = pl.concat(
        pl.DataFrame({"time_s": FORMS[form](ISO), "azimuth_deg": angle}).with_columns(
            sensor=pl.lit(name)
        )
        for name, angle in (("A", 45.0), ("B", -45.0))
    )
    found = tables.locate(table, sensors=stations)
    assert found.height == 3
    np.testing.assert_allclose(found["east_m"], 5000.0)


@pytest.mark.parametrize("wrong", ["soon", "22.11.2026"])
def test_a_text_that_is_no_time(wrong: str) -> None:
    with pytest.raises(
        ValueError, match=rf"time\[1\] is '{wrong}'; it must be a number of seconds"
    ):
        Plots([ISO[0], wrong], [1e4, 1e4], [0.0, 0.0])
