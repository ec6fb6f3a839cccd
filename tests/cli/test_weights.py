"""The command `tertia weights`: what the library says of a file of measurements."""

import json
import warnings
from functools import partial
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import terminal

from tertia import fusion, tables, weights
from tertia.fusion._estimates import allowing_for

run = partial(terminal.run, "weights")

FILE = Path(__file__).parents[2] / "examples" / "estimates.csv"
BOTH = ("--value", "east_m", "--value", "north_m")


def samples() -> list[np.ndarray]:
    frame = pl.read_csv(FILE)
    return [
        frame.filter(sensor=name).select("east_m", "north_m").to_numpy()
        for name in ("radar", "finders")
    ]


@pytest.mark.parametrize("differences", [False, True])
def test_it_is_the_library_on_the_means(differences: bool, tmp_path: Path) -> None:
    output = tmp_path / "weights.parquet"
    options = ("--differences",) if differences else ()
    done = run(FILE, *BOTH, *options, "--loss", 0.1, "--output", output, "--json")
    assert done.code == 0
    told, table = json.loads(done.out), pl.read_parquet(output)
    spread = [weights.sample_covariance(s, differences=differences) / 24 for s in samples()]
    means = np.array([s.mean(axis=0) for s in samples()])
    convention = "differences" if differences else "sample-mean"
    fused = fusion.fuse(means, spread, n=24)
    if differences:
        fused = allowing_for(
            fusion.fuse(means, spread), means, np.array(spread), [(23**2 / 34, 1.0)] * 2
        )
    assert told["pvalue"] == fused.pvalue
    assert told["loss"] == weights.fusion_loss(spread, 24, convention=convention).loss
    assert told["required_count"] == weights.required_samples(spread, 0.1, convention=convention)
    assert table["sensor"].to_list() == ["radar", "finders", "fused"]
    assert table["measurement_count"].to_list() == [24, 24, 48]
    np.testing.assert_array_equal(table[2, "east_m"], fused.mean[0])
    sigma = np.sqrt(fused.covariance[1, 1])
    np.testing.assert_array_equal(table[2, "north_sigma_m"], sigma)
    found = table.select(pl.col("^weight_.*$")).to_numpy()[:2].reshape(2, 2, 2)
    np.testing.assert_array_equal(found, fused.weights)
    np.testing.assert_allclose(found.sum(axis=0), np.eye(2), atol=1e-14)


def test_what_is_printed() -> None:
    done = run(FILE, *BOTH)
    assert done.code == 0
    assert "fused: east_m 1203.6 ± 3.7, north_m -353.3 ± 3.3" in done.out
    assert "measurements per sensor, the relative increase would be below 0.05" in done.out


def test_systematic_errors_are_part_of_the_sigmas(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    rows = [f"{name},{x}" for name in "abc" for x in rng.normal(5.0, 1.0, 400)]
    path = tmp_path / "in.csv"
    path.write_text("sensor,x\n" + "\n".join(rows) + "\n", encoding="utf-8")
    found = {}
    for bias in (0, 2):
        done = run(path, "--value", "x", "--bias-sigma", bias, "--json")
        found[bias] = [row["x_sigma"] for row in json.loads(done.out)["sensors"]]
        assert ("not included" in done.err + done.out) == (bias == 0)
    np.testing.assert_allclose(found[2][:3], np.hypot(found[0][:3], 2.0), rtol=1e-9)
    assert found[2][3] == pytest.approx(2.0 / 3**0.5, rel=0.01)


def test_incomplete_rows_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "in.csv"
    path.write_text("who,x\na,1\na,\n,3\na,2\nb,4\nb,nan\nb,6\n", encoding="utf-8")
    done = run(path, "--column", "sensor=who", "--value", "x", "--json")
    assert done.code == 0
    assert done.err.startswith("3 of 7 rows are incomplete\n")
    assert [row["measurement_count"] for row in json.loads(done.out)["sensors"]] == [2, 2, 4]


@pytest.mark.parametrize(
    ("text", "options", "code", "message"),
    [
        ("sensor,x\na,1\na,2\n", ("--value", "x"), 1, "in.csv: there is 1 sensor; two are needed"),
        ("sensor,x\na,1\nb,2\nb,3\n", ("--value", "x"), 1, "sensor a has 1 measurement"),
        ("sensor,x\na,1\n", ("--value", "y"), 2, "has no column y; it has sensor, x"),
        ("sensor,x\na,east\n", ("--value", "x"), 1, "x is 'east'; it must be a finite number"),
        ("sensor,x\n", ("--value", "x"), 1, "is empty"),
        (
            "sensor,x\na,1\n",
            ("--value", "sensor"),
            2,
            "the column sensor is given for two purposes",
        ),
        ("sensor,x\na,1\n", ("--value", "x", "--loss", 0), 2, "loss is 0"),
        ("sensor,x\na,1\n", ("--value", "x", "--bias-sigma", -1), 2, "bias_sigma is -1"),
        (
            "sensor,x\n" + "a,1\nb,1\n" * 9,
            ("--value", "x"),
            1,
            "sensor a: all values of x are equal",
        ),
        ("sensor,x\na,1e308\na,-1e308\nb,1\nb,2\n", ("--value", "x"), 1, "above 1e+70"),
    ],
)
def test_mistakes(
    text: str, options: tuple[object, ...], code: int, message: str, tmp_path: Path
) -> None:
    path = tmp_path / "in.csv"
    path.write_text(text, encoding="utf-8")
    done = run(path, *options)
    assert done.code == code
    terminal.assert_refused(done, message)


@pytest.mark.parametrize("step", [1e-6, 0.05])
def test_rows_that_repeat_the_row_before_are_left_out(step: float) -> None:
    """As of a sensor of 2 Hz that is recorded at 20 Hz."""
    random = np.random.default_rng(6)
    once = np.round(random.normal(100.0, [[1.0], [3.0]], (2, 60)) / step) * step
    sensor = np.repeat(["a", "b"], 60)
    table = pl.DataFrame({"sensor": sensor, "v_m": once.ravel()})
    copied = pl.DataFrame({"sensor": np.repeat(sensor, 10), "v_m": np.repeat(once.ravel(), 10)})
    expected = tables.weights(table, values="v_m")
    with pytest.warns(tables.RecordWarning, match="rows of sensor [ab] repeat the row before"):
        found = tables.weights(copied, values="v_m")
    again = np.sum(np.diff(once, axis=1) == 0.0, axis=1)
    assert found["measurement_count"].to_list()[:2] == (60 - again).tolist()
    for column in ("v_m", "v_sigma_m"):
        np.testing.assert_allclose(found[column], expected[column], rtol=0.05)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # rounding repeats values, too
        rounded = table.with_columns(pl.col("v_m").round(0))
        assert tables.weights(rounded, values="v_m")["measurement_count"][0] == 60
