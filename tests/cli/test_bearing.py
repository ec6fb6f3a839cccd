"""The command line: numbers equal to those of the library, and one clear line per error."""

import json
import os
import re
import runpy
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from matplotlib.figure import Figure
from places import DATA, EXAMPLES
from terminal import run

import tertia
from tertia import tables
from tertia.cli.commands import bearing
from tertia.cli.files import read
from tertia.cli.files import write as writing

COLUMNS = ["count", "missing", "azimuth_deg", "azimuth_sigma_deg", "outlier_count", "polarity"]
EXAMPLE = EXAMPLES / "bearings.csv"
DIFAR = DATA / "difar/bearings.csv"
MIN_COUNT = 5
METHODS = ["robust", "corrected", "paper", "k-sigma", "mean"]


def results(path: Path, folder: Path, *arguments: object) -> pl.DataFrame:
    """Return the result table with full precision; the run must succeed."""
    output = folder / "results.parquet"
    done = run("bearing", path, "--output", output, *arguments)
    assert done.code == 0, done.err
    return pl.read_parquet(output)


def table(out: str) -> list[list[str]]:
    """Return the cells of a printed table without empty cells, header first."""
    lines = [re.split(r"\s{2,}", line.strip()) for line in out.splitlines() if line.strip()]
    return [lines[0], *lines[2:]]


def column(values: object, header: str = "azimuth_deg") -> str:
    return "\n".join([header, *map(str, np.asarray(values, dtype=object))]) + "\n"


def record() -> list[float]:
    theta = tertia.simulate.direction_finder(60, bearing=359.0, rng=5).theta
    return [float(v) for v in theta.round(3)]


@pytest.mark.parametrize("method", METHODS)
def test_numbers_are_those_of_the_library_for_every_method(
    method: str, write: Callable[..., Path], tmp_path: Path
) -> None:
    theta = record()
    table = results(
        write(column(theta)), tmp_path, "--method", method, "--block-size", 7, "--k", 2.2
    )
    expected = tertia.estimate_bearing(theta, method=method, block_size=7, k=2.2)  # type: ignore[arg-type]
    assert table.columns == [*COLUMNS, "note"]
    assert table.rows() == [
        (
            60,
            0,
            expected.value,
            expected.sigma,
            np.count_nonzero(expected.outlier),
            expected.polarity,
            None,
        )
    ]


def test_methods_differ(write: Callable[..., Path], tmp_path: Path) -> None:
    path = write(column(record()))
    values = {results(path, tmp_path, "--method", m)["azimuth_deg"].item() for m in METHODS}
    assert len(values) >= 4


def test_across_north(write: Callable[..., Path], tmp_path: Path) -> None:
    theta = [358.0, 2.0, 359.0, 1.0, 0.5, 359.5]
    value = results(write(column(theta)), tmp_path, "--method", "mean")["azimuth_deg"].item()
    assert min(value, 360 - value) < 1e-12


def test_period_zero_does_not_wrap(write: Callable[..., Path], tmp_path: Path) -> None:
    path = write(column([358.0, 2.0, 1.0, 1.0, 3.0]))
    row = results(path, tmp_path, "--method", "mean", "--period", 0)
    assert row["azimuth_deg"].item() == pytest.approx(73.0, rel=1e-15)


def test_period_of_another_unit(write: Callable[..., Path], tmp_path: Path) -> None:
    path = write(column([6399.0, 1.0, 6398.0, 2.0, 5.0], header="mil"))
    row = results(path, tmp_path, "--value", "mil", "--method", "mean", "--period", 6400)
    assert row["mil"].item() == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "theta", "expected"),
    [
        ("range_m", [500.0, 900.0, 700.0, 720.0, 680.0], 700.0),
        ("azimuth_rad", [6.2, 0.1, 0.0, 6.3, 6.25], 0.0001),
        ("heading", [359.0, 1.0, 0.0, 2.0, 358.0], 0.0),
    ],
)
def test_the_period_is_that_of_the_unit(
    name: str, theta: list[float], expected: float, write: Callable[..., Path], tmp_path: Path
) -> None:
    path = write(column(theta, header=name))
    found = results(path, tmp_path, "--value", name, "--method", "mean")[name].item()
    assert found == pytest.approx(expected, abs=1e-4)


def test_values_without_a_unit_that_are_no_degrees(write: Callable[..., Path]) -> None:
    done = run("bearing", write(column([2185.0, 2190.0], header="mil")), "--value", "mil")
    assert done.code == 1
    assert "mil is 2185; it must be between -720 and 720" in done.err


def test_groups_in_order_of_first_appearance(write: Callable[..., Path], tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    keys = [("z", "2"), ("a", "10"), ("z", "10"), ("a", "007")]
    thetas = rng.normal(90, 2, (30, len(keys))).round(4)
    lines = [f"{v},{s},{t}" for row in thetas for v, (s, t) in zip(row, keys, strict=True)]
    path = write("\n".join(["azimuth_deg,station,target", *lines]) + "\n")
    table = results(path, tmp_path, "--by", "station", "--by", "target")
    assert table.columns[:2] == ["station", "target"]
    assert table.select("station", "target").rows() == keys
    for theta, value, sigma in zip(
        thetas.T, table["azimuth_deg"], table["azimuth_sigma_deg"], strict=True
    ):
        expected = tertia.estimate_bearing(theta)
        assert (value, sigma) == (expected.value, expected.sigma)


@pytest.mark.parametrize("suffix", [".csv", ".xlsx"])
def test_a_stated_sigma(write: Callable[..., Path], tmp_path: Path, suffix: str) -> None:
    """In batches, and of a file that is read as a whole."""
    path = write("azimuth_deg,azimuth_sigma_deg,sensor\n10,2,A\n13,3,A\n80,1.5,B\n")
    if suffix == ".xlsx":
        pytest.importorskip("xlsxwriter")
        table = pl.read_csv(path)
        path = tmp_path / "table.xlsx"
        table.write_excel(path)
    table = results(path, tmp_path, "--by", "sensor")
    expected = tertia.estimate_bearing([10.0, 13.0], sigma=[2.0, 3.0])
    assert table.row(0)[3:5] == (expected.value, expected.sigma)
    assert table.row(1)[3:5] == (80.0, 1.5)
    table = results(path, tmp_path, "--by", "sensor", "--sigma", 1.0)
    assert table["azimuth_sigma_deg"][1] == 1.0
    drawn = tmp_path / "out.png"
    results(path, tmp_path, "--by", "sensor", "--plot", drawn)
    assert drawn.stat().st_size > 1000


def test_example_agrees_with_its_script_and_its_truth(tmp_path: Path) -> None:
    script = runpy.run_path(str(EXAMPLES / "make_bearings.py"))
    header, *lines = EXAMPLE.read_text(encoding="utf-8").splitlines()
    assert header == "time_s,target,azimuth_deg"
    assert [tuple(line.split(",")) for line in lines] == list(script["rows"]())

    table = results(EXAMPLE, tmp_path, "--by", "target")
    assert table["target"].to_list() == list(script["BEARING_DEG"])
    assert (table["count"] + table["missing"] == script["COUNT"]).all()
    truth = np.array(list(script["BEARING_DEG"].values()))
    error = (table["azimuth_deg"].to_numpy() - truth + 180) % 360 - 180
    assert (np.abs(error) < 3 * table["azimuth_sigma_deg"].to_numpy()).all()
    missing = dict(zip(table["target"], table["missing"], strict=True))
    assert missing.pop("gaps") > 0
    assert set(missing.values()) == {0}


def test_command_of_the_demo(tmp_path: Path) -> None:
    picture = tmp_path / "bearings.png"
    command: list[str | Path] = [Path(sys.executable).with_name("tertia"), "bearing", EXAMPLE]
    command += ["--by", "target", "--plot", picture]
    done = subprocess.run(command, capture_output=True, encoding="utf-8", check=True, env=utf8())
    header, *rows = table(done.stdout)
    assert header == ["target", *COLUMNS]
    theta = pl.read_csv(EXAMPLE).filter(target="north")["azimuth_deg"]
    expected = tertia.estimate_bearing(theta)
    outlier_count, polarity = expected.outlier.sum(), expected.polarity
    assert rows[0] == [
        "north",
        "120",
        "0",
        f"{expected.value:.2f}",
        f"{expected.sigma:.2f}",
        f"{outlier_count}",
        f"{polarity:+.3f}",
    ]
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert re.fullmatch(r"\d+ of 480 measurements missing\n", done.stderr)


def utf8() -> dict[str, str]:
    return {**os.environ, "PYTHONUTF8": "1"}


def test_wide_table_is_not_truncated_in_a_pipe(
    write: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    name = "a station with a long name " * 5
    path = write("azimuth_deg,station\n" + f"1.5,{name}\n" * 4 + "2.5,b\n" * 5)
    done = run("bearing", path, "--by", "station")
    assert done.code == 0
    _, long, short, note = table(done.out)
    assert note == ["systematic errors are not included: see --groups and --bias-sigma"]
    assert long == [name.strip(), "4", "0", "theta has 4 measurements; at least 5 are needed"]
    assert short[:3] == ["b", "5", "0"]
    assert "…" not in done.out


@pytest.mark.parametrize("suffix", ["csv", "json", "parquet", "CSV"])
def test_output_has_full_precision(suffix: str, write: Callable[..., Path], tmp_path: Path) -> None:
    theta = record()
    output = tmp_path / f"results.{suffix}"
    done = run("bearing", write(column(theta)), "--output", output)
    assert (done.code, done.out, done.err) == (0, f"wrote 1 row to {output}\n", "")
    read: dict[str, Callable[[Path], list[dict[str, Any]]]] = {
        "csv": lambda path: pl.read_csv(path).to_dicts(),
        "json": lambda path: json.loads(path.read_text(encoding="utf-8")),
        "parquet": lambda path: pl.read_parquet(path).to_dicts(),
    }
    (row,) = read[suffix.lower()](output)
    expected = tertia.estimate_bearing(theta)
    assert (row["azimuth_deg"], row["azimuth_sigma_deg"], row["polarity"]) == (
        expected.value,
        expected.sigma,
        expected.polarity,
    )
    assert row["note"] is None


def test_parquet_input(tmp_path: Path) -> None:
    theta = record()
    path = tmp_path / "recording.parquet"
    cells = [*theta, float("nan"), None]
    pl.DataFrame({"azimuth_deg": cells, "target": [7] * len(cells)}).write_parquet(path)
    table = results(path, tmp_path, "--by", "target")
    assert table.row(0)[:4] == (7, 60, 2, tertia.estimate_bearing(theta).value)


def test_missing_values_of_a_lone_parquet_column_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "recording.parquet"
    pl.DataFrame({"azimuth_deg": [*record(), None]}).write_parquet(path)
    assert results(path, tmp_path).row(0)[:2] == (60, 1)


def test_missing_values_are_counted_and_left_out(
    write: Callable[..., Path], tmp_path: Path
) -> None:
    words = ["", "NA", "NaN", "nan", "null", "None", "-", " NA "]
    theta = record()
    cells = [*map(str, theta[:20]), *words, *map(str, theta[20:])]
    path = write("t,azimuth_deg\n" + "".join(f"{i},{v}\n" for i, v in enumerate(cells)))
    output = tmp_path / "results.csv"
    done = run("bearing", path, "--output", output)
    assert done.code == 0
    assert done.err == f"{len(words)} of {len(cells)} measurements missing\n"
    row = pl.read_csv(output).row(0, named=True)
    expected = tertia.estimate_bearing(theta)
    assert (row["count"], row["missing"]) == (60, len(words))
    assert (row["azimuth_deg"], row["azimuth_sigma_deg"]) == (expected.value, expected.sigma)


def test_blank_lines_byte_order_mark_and_line_ends_do_not_matter(
    write: Callable[..., Path], tmp_path: Path
) -> None:
    theta = record()
    text = "\ufeff" + column(theta, "azimuth_deg").replace("\n", "\r\n") + "\r\n\r\n"
    (row,) = results(write(text), tmp_path).rows(named=True)
    assert (row["count"], row["missing"]) == (60, 0)
    assert row["azimuth_deg"] == tertia.estimate_bearing(theta).value


@pytest.mark.parametrize("suffix", ["csv", "parquet", "arrow"])
@pytest.mark.parametrize("last", [14, 7], ids=["consecutive", "a group comes back"])
def test_in_batches_as_at_once(
    suffix: str, last: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(read, "_ROWS_AT_ONCE", 64)
    number = np.append(np.arange(1000) // 70, last)
    theta = (359 + np.random.default_rng(1).standard_normal(1001)) % 360
    theta[::50] = np.nan
    frame = pl.DataFrame({"target": number, "other": number, "azimuth_deg": theta})
    path = tmp_path / f"plots.{suffix}"
    {"csv": frame.write_csv, "parquet": frame.write_parquet, "arrow": frame.write_ipc}[suffix](path)
    found = results(path, tmp_path, "--by", "target")
    expected = tables.bearing(frame, by="target")
    assert (
        found.rows() == expected.with_columns(pl.col("target").cast(found["target"].dtype)).rows()
    )


def test_a_group_with_too_few_does_not_stop_the_others(
    write: Callable[..., Path], tmp_path: Path
) -> None:
    theta = record()
    few = [f"{v},few" for v in theta[: MIN_COUNT - 1]]
    path = write("\n".join(["azimuth_deg,target", *few, *[f"{v},many" for v in theta]]))
    output, picture = tmp_path / "results.csv", tmp_path / "picture.png"
    done = run("bearing", path, "--by", "target", "--output", output, "--plot", picture)
    assert done.code == 0
    assert done.err == "1 of 2 groups could not be estimated: see the column note\n"
    failed, fine = pl.read_csv(output).rows(named=True)
    reason = "theta has 4 measurements; at least 5 are needed"
    assert (failed["target"], failed["count"], failed["note"]) == ("few", 4, reason)
    assert (
        failed["azimuth_deg"]
        is failed["azimuth_sigma_deg"]
        is failed["outlier_count"]
        is failed["polarity"]
        is None
    )
    assert fine["azimuth_deg"] == tertia.estimate_bearing(theta).value
    assert fine["note"] is None
    assert picture.stat().st_size > 0


def test_exit_code_where_no_group_can_be_estimated(
    write: Callable[..., Path], tmp_path: Path
) -> None:
    picture = tmp_path / "picture.png"
    done = run("bearing", write(column(["1", "NA", "2"])), "--plot", picture)
    assert done.code == 1
    assert "theta has 2 measurements; at least 5 are needed" in done.out
    assert done.err == (
        "1 of 3 measurements missing\n1 of 1 group could not be estimated: see the column note\n"
    )
    assert not picture.exists()


def test_thousands_of_groups(write: Callable[..., Path], tmp_path: Path) -> None:
    groups, size = 5000, 8
    theta = np.random.default_rng(3).normal(0, 2, (groups, size)).round(3) % 360
    lines = [f"{v},{i}" for column in theta.T for i, v in enumerate(column)]
    path = write("\n".join(["azimuth_deg,target", *lines]))
    table = results(path, tmp_path, "--by", "target")
    assert table["target"].to_list() == [str(i) for i in range(groups)]
    assert table["azimuth_deg"].to_list() == [
        tertia.estimate_bearing(sample).value for sample in theta
    ]

    done = run("bearing", path, "--by", "target")
    assert done.code == 0
    assert done.err == "only the first 1000 of 5000 groups are shown: --output writes all\n"
    shown = [line.split()[0] for line in done.out.splitlines() if line.strip()]
    assert "999" in shown
    assert "1000" not in shown


def test_at_most_sixteen_panels(write: Callable[..., Path], tmp_path: Path) -> None:
    theta = record()[:10]
    path = write("\n".join(["azimuth_deg,t", *[f"{v},{i}" for i in range(18) for v in theta]]))
    picture = tmp_path / "picture.svg"
    done = run("bearing", path, "--by", "t", "--plot", picture)
    assert (done.code, done.err) == (0, "only the first 16 of 18 groups are drawn\n")
    assert picture.stat().st_size > 0


def test_figure_has_a_panel_per_group_with_its_estimate() -> None:
    theta = np.array(record())
    estimate = tertia.estimate_bearing(theta, period=720.0)
    figure = Figure()
    drawn = [(f"target {i}", theta, estimate) for i in range(5)]
    bearing._draw(drawn, "az", 720.0, 10, figure)
    visible = [ax for ax in figure.axes if ax.axison]
    assert len(figure.axes) == 6
    assert [ax.get_title().split(":")[0] for ax in visible] == [f"target {i}" for i in range(5)]
    assert all(f"{estimate.value:.2f} ± " in ax.get_title() for ax in visible)
    assert [ax.get_ylabel() for ax in visible] == ["az", "", "", "az", ""]
    assert [bool(ax.get_xlabel()) for ax in visible] == [False, False, True, True, True]
    (legend,) = figure.legends
    names = [text.get_text() for text in legend.get_texts()]
    assert sorted(names) == ["bearing", "block mean", "measurement", "outlier", "± 2 sigma"]


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["fine.csv", "--value", "az"], 2, "fine.csv has no column az; it has azimuth_deg, t"),
        (["fine.csv", "--by", "x"], 2, "fine.csv has no column x; it has azimuth_deg, t"),
        (
            ["fine.csv", "--by", "azimuth_deg"],
            2,
            "the column azimuth_deg is given for two purposes",
        ),
        (
            ["fine.csv", "--by", "missing"],
            2,
            "cannot group by missing: the results have a column of this name",
        ),
        (["text.csv"], 1, "text.csv, line 4: azimuth_deg is '12 deg'; it must be a finite number"),
        (
            ["texts.csv"],
            1,
            "texts.csv, line 2: azimuth_deg is 'x'; it must be a finite number \\(2 such rows\\)",
        ),
        (["inf.parquet"], 1, "inf.parquet, row 2: azimuth_deg is inf; it must be a finite number"),
        (["dates.parquet"], 1, "dates.parquet: azimuth_deg holds Date, not numbers"),
        (["ragged.csv"], 1, "cannot read ragged.csv: line 2 has 2 fields, the header has 1"),
        (
            ["fine.csv", "--output", "x.xls"],
            2,
            "cannot write x.xls: its name must end in .csv, .json, .parquet, .arrow, .feather, "
            ".jsonl, .ndjson",
        ),
        (["absent.csv", "--plot", "x.xls"], 2, "cannot write x.xls: its name must end in .*png.*"),
        (
            ["fine.csv", "--period", "-1"],
            2,
            "period is -1; it must be a positive number, not above 1e100",
        ),
        (
            ["fine.csv", "--method", "k-sigma", "--k", "0"],
            2,
            "k is 0; it must be a positive number",
        ),
        (["fine.csv", "--block-size", "1"], 2, "block_size is 1; it must be between 2 and .*"),
    ],
)
def test_errors_are_one_clear_line(
    arguments: list[str],
    code: int,
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    files = {
        "fine": b"azimuth_deg,t\n1,a\n2,a\n3,a\n4,a\n5,a\n",
        "text": b"azimuth_deg\n1\n\n12 deg\n2\n",
        "texts": b"azimuth_deg\nx\n1\ny\n",
        "ragged": b"azimuth_deg\n1,2\n",
    }
    for name, content in files.items():
        Path(f"{name}.csv").write_bytes(content)
    pl.DataFrame({"azimuth_deg": [1.0, float("inf")]}).write_parquet("inf.parquet")
    pl.DataFrame({"azimuth_deg": ["2026-01-01"]}).with_columns(
        pl.col("azimuth_deg").str.to_date()
    ).write_parquet("dates.parquet")
    done = run("bearing", *arguments)
    assert done.code == code
    assert re.fullmatch(f"tertia: {message}\n", done.err)


def test_version_and_help() -> None:
    assert run("--version") == (0, f"tertia {tertia.__version__}\n", "")
    assert "bearing" in run("--help").out
    assert run().code == 2


def test_extra_plot_is_asked_for_before_the_work(
    monkeypatch: pytest.MonkeyPatch, write: Callable[..., Path]
) -> None:
    monkeypatch.setattr(writing, "find_spec", lambda name: None)
    done = run("bearing", write(column(record())), "--plot", "x.png")
    assert done == (1, "", "tertia: --plot needs the extra plot: pip install 'tertia[plot]'\n")


@pytest.mark.parametrize("library", ["polars", "rich", "typer"])
def test_extra_cli_is_asked_for(library: str) -> None:
    code = f"import sys; sys.modules[{library!r}] = None; from tertia.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, encoding="utf-8", check=False
    )
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "the command tertia needs the extra cli: pip install 'tertia[cli]'\n"


@pytest.mark.parametrize("module", ["tables", "report"])
def test_extra_tables_is_asked_for(module: str) -> None:
    code = f"import sys; sys.modules['polars'] = None; import tertia.{module}"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, encoding="utf-8", check=False
    )
    said = "tertia.tables needs the extra tables: pip install 'tertia[tables]'"
    assert done.stderr.splitlines()[-1] == f"ModuleNotFoundError: {said}"


@pytest.mark.skipif(not DIFAR.exists(), reason=f"no recording {DIFAR}")
@pytest.mark.parametrize("method", METHODS)
def test_real_recording_by_buoy_and_station(method: str, tmp_path: Path) -> None:
    table = results(
        DIFAR,
        tmp_path,
        "--column",
        "azimuth_deg=bearing_deg",
        "--by",
        "buoy",
        "--by",
        "station",
        "--method",
        method,
    )
    frame = pl.read_csv(DIFAR, null_values="NaN")
    keys = frame.select("buoy", "station").unique(maintain_order=True)
    assert table.select("buoy", "station").rows() == keys.rows()
    assert (table["count"].sum(), table["missing"].sum()) == (674, 166)
    estimated = table.filter(pl.col("note").is_null())
    assert estimated.height >= 24
    for row in estimated.rows(named=True):
        theta = frame.filter(buoy=row["buoy"], station=row["station"])["bearing_deg"]
        expected = tertia.estimate_bearing(theta.drop_nulls(), method=method)  # type: ignore[arg-type]
        assert (row["azimuth_deg"], row["azimuth_sigma_deg"]) == (expected.value, expected.sigma)
