"""Mistakes in the files of every command: what is read is right, or one line says why not."""

import gzip
import re
from collections.abc import Callable
from pathlib import Path
from runpy import run_path
from typing import Any, NamedTuple

import numpy as np
import polars as pl
import pytest
from places import ROOT
from terminal import run, succeed


class Command(NamedTuple):
    """A command with a good file, its options, and a column that it needs."""

    file: str
    options: tuple[str, ...]
    value: str


COMMANDS = {
    "bearing": Command("bearings.csv", ("--by", "sensor"), "azimuth_deg"),
    "fuse-series": Command("azimuths.csv", (), "azimuth_deg"),
    "locate": Command(
        "bearings.csv", ("--sensors", "finders.toml", "--tolerance", "inf"), "azimuth_deg"
    ),
    "reconstruct": Command("telemetry.csv", ("--sensors", "towers.toml"), "azimuth_deg"),
    "smooth": Command("positions.csv", ("--sigma", "20", "--by", "icao_address"), "latitude_deg"),
    "weights": Command("estimates.csv", ("--value", "east_m", "--value", "north_m"), "east_m"),
    "register": Command("plots.csv", ("--sensors", "radars.toml"), "range_m"),
    "track": Command("plots.csv", ("--sensors", "radars.toml"), "range_m"),
    "smooth-tracks": Command("plots.csv", ("--sensors", "radars.toml"), "range_m"),
    "fuse-tracks": Command("tracks.csv", ("--sensors", "radars.toml"), "east_m"),
    "evaluate": Command("tracks.csv", ("--truth", "truth.csv", "--origin", "50.0,14.0"), "east_m"),
    "audit": Command("tracks.csv", ("--truth", "truth.csv", "--origin", "50.0,14.0"), "east_m"),
    "report": Command("plots.csv", ("--sensors", "radars.toml"), "range_m"),
}  # fmt: skip
# of a file with sensors, and how it is told
SENSORS: dict[str, tuple[Callable[[str], str | bytes], str]] = {
    "two of one name": (lambda text: re.sub(r'name = "\w+"', 'name = "a"', text), "there are two"),
    "none": (lambda text: "", "there are no"),
    "a decimal comma": (lambda text: re.sub(r"(\d)\.(\d)", r"\1,\2", text, count=1), "cannot read"),
    "no place": (lambda text: text.replace("latitude_deg", "lat"), "latitude_deg of .* is missing"),
    "a name misspelt": (
        lambda text: text.replace("azimuth_sigma_deg", "azimut_sigma_deg"),
        "did you mean azimut_sigma_deg",
    ),
    "negative": (
        lambda text: re.sub(r"azimuth_sigma_deg = [\d.]+", "azimuth_sigma_deg = -1", text),
        "azimuth_sigma_deg of .* is -1; it must be positive",
    ),
    "text": (
        lambda text: re.sub(r"azimuth_sigma_deg = [\d.]+", 'azimuth_sigma_deg = "one"', text),
        "is 'one'; it must be a finite number",
    ),
    "no name": (lambda text: text.replace("name", "nome"), "1 has no name"),
    "UTF-16": (lambda text: text.encode("utf-16"), ""),
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a good file of each kind."""
    path = tmp_path_factory.mktemp("good")
    scenes = run_path(str(ROOT / "examples" / "scenes.py"))["SCENES"]
    for scene, names, count in (
        ("bearings", {"bearings.csv": "bearings.csv", "sensors.toml": "finders.toml"}, 200),
        ("telemetry", {"bearings.csv": "telemetry.csv", "sensors.toml": "towers.toml"}, 60),
        ("misaligned", {"plots.csv": "plots.csv", "sensors.toml": "radars.toml"}, 150),
        ("adsb", {"positions.csv": "positions.csv"}, 80),
        ("gaps", {"azimuths.csv": "azimuths.csv"}, 60),
    ):  # fmt: skip
        made = path / scene
        made.mkdir()
        scenes[scene](made, np.random.default_rng(2026))
        for name, called in names.items():
            lines = (made / name).read_text(encoding="utf-8").splitlines(keepends=True)
            kept = lines if name.endswith(".toml") else lines[:count]
            (path / called).write_text("".join(kept), encoding="utf-8")
    last = pl.read_csv(path / "plots.csv")["time_s"].max()
    truth = pl.read_csv(path / "misaligned" / "truth.csv")
    truth.filter(pl.col("time_s") <= last).write_csv(path / "truth.csv")
    (path / "estimates.csv").write_text((ROOT / "examples" / "estimates.csv").read_text())
    options = ("--sensors", path / "radars.toml", "--output", path / "tracks.csv")
    succeed("track", path / "plots.csv", *options)
    return path


def column(name: str, value: Callable[[str, int], str], at: int | None = None) -> Any:
    """Return what changes a column, in all rows or in one; None where there is none."""

    def changed(text: str) -> str | None:
        header, *lines = text.splitlines()
        names = header.split(",")
        if name not in names:
            return None
        k, rows = names.index(name), []
        for i, line in enumerate(lines):
            cells = line.split(",")
            if at is None or i == at:
                cells[k] = value(cells[k], i)
            rows.append(",".join(cells))
        return "\n".join([header, *rows]) + "\n"

    return changed


def header(change: Callable[[str], str]) -> Any:
    def changed(text: str) -> str:
        first, _, rest = text.partition("\n")
        return f"{change(first)}\n{rest}"

    return changed


def clock(i: int) -> str:
    return f"12:{i // 60 % 60:02d}:{i % 60:02d}"


def mistakes(value: str) -> dict[str, tuple[Any, str | None]]:
    """Return changes, and what must be said; None: the file is right, or it is said what is odd."""
    name, rest = value[:-3], value[-2:]
    number = "it must be a finite number"
    return {
        "semicolons": (lambda text: text.replace(",", ";").replace(".", ","), ""),
        "tabs": (lambda text: text.replace(",", "\t"), ""),
        "UTF-16": (lambda text: text.encode("utf-16"), ""),
        "a line of the separator": (lambda text: f"sep=,\n{text}", ""),
        "byte order mark": (lambda text: text.encode("utf-8-sig"), ""),
        "CRLF": (lambda text: text.replace("\n", "\r\n").encode(), ""),
        "capitals": (header(str.upper), ""),
        "padded": (header(lambda names: names.replace(",", " , ")), ""),
        "wrong name": (header(lambda names: names.replace(value, "foo")), "has no column"),
        "misspelt": (
            header(lambda names: names.replace(value, f"{name}{rest}")),
            f"has no column .*did you mean {name}{rest}|has no columns .*={name}{rest}",
        ),
        "twice": (header(lambda names: f"{names},{names.split(',')[0]}"), None),
        "text in a number": (column(value, lambda *_: "about 12", 5), f"line 7: .*{number}"),
        "infinite": (column(value, lambda *_: "inf", 5), f"line 7: .*{number}"),
        "nothing": (column(value, lambda *_: ""), None),
        "huge": (column(value, lambda *_: "1e300", 5), None),
        "empty": (lambda _: "", "is empty"),
        "header alone": (lambda text: text.splitlines()[0] + "\n", "is empty"),
        "one row": (lambda text: "\n".join(text.splitlines()[:2]) + "\n", None),
        "binary": (lambda _: bytes(range(256)) * 20, "it is not a text file"),
        "a page": (lambda _: "<!DOCTYPE html><html></html>\n", "it is a web page"),
        "JSON": (lambda _: '[{"time_s": 0}]\n', "it is JSON"),
        "a field too many": (lambda text: text + ",1" * 60 + "\n", "fields, the header has"),
        "an open quote": (lambda text: text + '"abc\n', "cannot read"),
        "radians": (column("azimuth_deg", lambda one, _: str(np.radians(float(one)))), None),
        "gradians": (column("azimuth_deg", lambda one, _: str(float(one) % 360 / 0.9)), None),
        "kilometres": (column("range_m", lambda one, _: str(float(one) / 1e3)), "kilometres"),
        "negative": (column("range_m", lambda *_: "-5"), None),
        "swapped": (
            header(
                lambda names: re.sub(
                    "latitude|longitude",
                    lambda one: "longitude" if one[0] == "latitude" else "latitude",
                    names,
                )
            ),
            None,
        ),
        "an impossible place": (column("latitude_deg", lambda *_: "900", 3), None),
        "an unknown sensor": (column("sensor", lambda *_: "nobody", 3), None),
        "a sensor missing": (column("sensor", lambda *_: "", 3), None),
        "a padded sensor": (column("sensor", lambda one, _: f" {one} "), ""),
        "backwards": (
            lambda text: "\n".join([text.splitlines()[0], *text.splitlines()[:0:-1]]) + "\n", ""
        ),
        "repeated": (
            lambda text: "\n".join(
                [text.splitlines()[0], *(one for one in text.splitlines()[1:] for _ in range(2))]
            ) + "\n",
            None,
        ),
        "local dates": (column("time_s", lambda _, i: f"22.11.2026 {clock(i)}"), None),
        "zones": (column("time_s", lambda _, i: f"2026-11-22T{clock(i)}+01:00"), None),
        "times of day": (column("time_s", lambda _, i: clock(i)), None),
        "milliseconds": (column("time_s", lambda _, i: str(1.76e12 + 1e3 * i)), None),
        "a time missing": (column("time_s", lambda *_: "", 4), None),
        "codes": (column("icao_address", lambda *_: "4204.0"), None),
        "no address": (column("icao_address", lambda *_: "ZZZZZZ", 2), None),
        "a height missing": (column("height_m", lambda *_: "-"), None),
    }  # fmt: skip


def judged(code: int, out: str, err: str, where: str) -> None:
    """Check that at most a note and an error were said, and why nothing was written."""
    assert code in {0, 1, 2}, where
    assert "Traceback" not in err + out, where
    assert err.count("\n") <= 2, (where, err)
    assert all(len(line) < 600 for line in err.splitlines()), (where, err)
    assert code == 0 or err or "not located" in out, where


@pytest.mark.parametrize("command", COMMANDS)
def test_mistakes_in_measurements(command: str, folder: Path, tmp_path: Path) -> None:
    file, options, value = COMMANDS[command]
    given = [folder / one if (folder / one).is_file() else one for one in options]
    text = (folder / file).read_text(encoding="utf-8")
    output = tmp_path / ("out.html" if command == "report" else "out.csv")
    good = run(command, folder / file, *given, "--output", output)
    assert good.code == 0, good.err
    for name, (change, said) in mistakes(value).items():
        contents = change(text)
        if contents is None:
            continue
        path = tmp_path / "in.csv"
        path.write_bytes(contents if isinstance(contents, bytes) else contents.encode())
        output.unlink(missing_ok=True)
        done = run(command, path, *given, "--output", output)
        judged(done.code, done.out, done.err, name)
        if said == "":
            assert done.code == 0, (name, done.err)
            assert done.err == good.err, name
            assert output.exists()
        elif said is not None and command != "audit":
            # an audit takes what is there: columns that it does not know are no estimates
            assert re.search(said, done.err), (name, done.err)


@pytest.mark.parametrize("command", COMMANDS)
def test_files_that_are_none(command: str, folder: Path, tmp_path: Path) -> None:
    file, options, _ = COMMANDS[command]
    given = [folder / one if (folder / one).is_file() else one for one in options]
    contents = (folder / file).read_bytes()
    packed = gzip.compress(contents)
    half = len(packed) // 2
    files = {
        "absent.csv": (None, "there is no file"),
        f"{'x' * 300}.csv": (None, "File name too long"),
        "damaged.csv.gz": (
            packed[:half] + bytes([packed[half] ^ 255]) + packed[half + 1 :], "cannot read"
        ),
        "cut.csv.gz": (packed[:60], "cannot read"),
        "plain.csv.gz": (contents, "it is not compressed by gzip"),
        "text.parquet": (contents, "it is not in Parquet format"),
        "text.jsonl": (contents, "line 1: each line must be a JSON object"),
    }  # fmt: skip
    output = tmp_path / ("out.html" if command == "report" else "out.csv")
    for name, (held, said) in files.items():
        path = tmp_path / name
        if held is not None:
            path.write_bytes(held)
        done = run(command, path, *given, "--output", output)
        judged(done.code, done.out, done.err, name)
        assert done.code in {1, 2}, name
        assert said in done.err, (name, done.err)
        assert "Schema" not in done.err
        assert not output.exists()
    done = run(command, tmp_path, *given, "--output", output)
    assert (done.code, "it is a folder" in done.err) == (1, True)


@pytest.mark.parametrize("command", COMMANDS)
def test_outputs_of_every_command(command: str, folder: Path, tmp_path: Path) -> None:
    file, options, _ = COMMANDS[command]
    given = [folder / one if (folder / one).is_file() else one for one in options]
    suffix = ".html" if command == "report" else ".csv"
    (tmp_path / f"folder{suffix}").mkdir()
    (tmp_path / f"loop{suffix}").symlink_to(tmp_path / f"loop{suffix}")
    outputs = {
        tmp_path / f"folder{suffix}": "Is a directory",
        tmp_path / f"loop{suffix}": "Too many levels of symbolic links",
        tmp_path / f"{'y' * 300}{suffix}": "File name too long",
        tmp_path / "absent" / f"out{suffix}": "No such file or directory",
        tmp_path / "out.xlsx": "its name must end in",
    }
    if suffix == ".csv":
        outputs[folder / file] = "it contains the "
    before = (folder / file).read_bytes()
    for output, said in outputs.items():
        done = run(command, folder / file, *given, "--output", output)
        assert done.code in {1, 2}, output
        assert re.fullmatch(f"tertia: cannot write .*{said}.*\n", done.err), done.err
    assert (folder / file).read_bytes() == before


@pytest.mark.parametrize("command", COMMANDS)
def test_options_that_are_none_and_help(command: str, folder: Path) -> None:
    file, options, _ = COMMANDS[command]
    given = [folder / one if (folder / one).is_file() else one for one in options]
    told = run(command, "--help").out
    assert f"tertia {command} " in told
    wrong: list[tuple[str, object, str]] = [("--colour", "red", "--colour")]
    if "--method" in told:
        wrong.append(("--method", "best", "--method"))
    if "--plot" in told:
        wrong.append(("--plot", "x.xls", "cannot write x.xls: its name must end in"))
        wrong.append(("--plot", folder / "absent" / "x.png", "cannot write"))
    if "--sensors" in options:
        wrong += [("--sensors", f"absent.{kind}", "there is no file") for kind in ("csv", "toml")]
    for option, value, said in wrong:
        done = run(command, folder / file, *given, option, value)
        assert done.code in {1, 2}
        assert said in done.err


@pytest.mark.parametrize(
    "command", [one for one, what in COMMANDS.items() if "--sensors" in what.options]
)
@pytest.mark.parametrize("name", SENSORS)
def test_mistakes_in_sensors(command: str, name: str, folder: Path, tmp_path: Path) -> None:
    file, options, _ = COMMANDS[command]
    change, said = SENSORS[name]
    text = (folder / options[1]).read_text(encoding="utf-8")
    contents = change(text)
    sensors = tmp_path / "sensors.toml"
    sensors.write_bytes(contents if isinstance(contents, bytes) else contents.encode())
    output = tmp_path / ("out.html" if command == "report" else "out.csv")
    done = run(command, folder / file, "--sensors", sensors, *options[2:], "--output", output)
    judged(done.code, done.out, done.err, name)
    assert re.search(said, done.err), done.err
    if not said:
        assert done.code == 0


def test_another_origin_is_asked_about(folder: Path) -> None:
    """Tracks 70 km beside the truth: some are near a target by chance, most are not."""
    for origin in ("50.5,14.7", "49.9,13.9"):
        done = run(
            *("evaluate", folder / "tracks.csv", "--truth", folder / "truth.csv"),
            *("--origin", origin),
        )
        assert done.code == 0
        assert "of a target: do tracks and truth have the same origin?" in done.err
        assert done.err.count("\n") == 1


@pytest.mark.parametrize(
    "form", ["2026-11-22T12:00:0{k},5Z", "2026-11-22 12:00:0{k},5", "12:00:0{k},5"]
)
def test_a_comma_before_fractions_of_seconds(form: str, folder: Path, tmp_path: Path) -> None:
    sensors = folder / "finders.toml"
    names = ["hill", "tower", "roof", "van"]
    angles = [70.0, 250.0, 350.0, 300.0]
    written: list[bytes] = []
    for mark in (",", "."):
        rows = [
            f"{form.replace(',', mark).format(k=k)};{name};{angle}"
            for k in range(3)
            for name, angle in zip(names, angles, strict=True)
        ]
        path, output = tmp_path / "in.csv", tmp_path / f"out{len(written)}.csv"
        path.write_text("\n".join(["time_s;sensor;azimuth_deg", *rows]), encoding="utf-8")
        done = run("locate", path, "--sensors", sensors, "--output", output)
        assert done.err == ""
        written.append(output.read_bytes())
    assert written[0] == written[1]
