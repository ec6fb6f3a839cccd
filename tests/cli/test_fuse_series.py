"""The command `tertia fuse-series`: numbers of the library, one clear line per error."""

import datetime
import re
import runpy
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_args

import numpy as np
import numpy.typing as npt
import polars as pl
import pytest
import terminal
from places import EXAMPLES
from terminal import Write, assert_column

from tertia import metrics, simulate
from tertia.fusion import FusedSeries, FusionMethod, fuse_series
from tertia.kalman import SingerModel, fit_noise
from tertia.tables import _noise

EXAMPLE = EXAMPLES / "radars.csv"
MODEL = SingerModel(2.0, 0.05, 0.01, exact=True)
MOTION = ("--alpha", MODEL.alpha, "--acceleration-sigma", MODEL.acceleration_sigma)
SENSORS = ("A", "B")
ANGLE = (
    ("azimuth", "deg"),
    ("azimuth_rate", "deg_s"),
    ("azimuth_acceleration", "deg_s2"),
)

run = partial(terminal.run, "fuse-series")
track = partial(terminal.result, "fuse-series")


def tables(out: str) -> list[list[list[str]]]:
    """Return the cells of all printed tables, header first."""
    parts = [part for part in re.split(r"\n\s*\n", out) if "─" in part]
    rows = [[line for line in part.splitlines() if line.strip()] for part in parts]
    cells = [[re.split(r"\s{2,}", line.strip()) for line in part] for part in rows]
    return [[part[0], *(row for row in part[2:] if len(row) > 1)] for part in cells]


def recording(steps: int = 60, seed: int = 3) -> npt.NDArray[np.float64]:
    """Return plots of two sensors across north, the second noisier, some missing, one outlier."""
    z = simulate.radars(
        MODEL,
        steps,
        sigma=(0.1, 0.3),
        detection_probability=0.9,
        angle=358.0,
        rate=0.05,
        period=360.0,
        rng=seed,
    ).z.round(3)
    z[1, steps // 2] = (z[0, steps // 2 - 1] + 9.0) % 360
    return z


Z = recording()
TIMES = MODEL.dt * np.arange(Z.shape[1])


def lines(z: npt.NDArray[np.float64] = Z, extra: str = "") -> list[str]:
    return [
        f"{t},{name},{'' if np.isnan(value) else value}{extra}"
        for t, row in zip(TIMES, z.T, strict=True)
        for name, value in zip(SENSORS, row, strict=True)
    ]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    return terminal.writer(tmp_path, "time_s,sensor,azimuth_deg", "p.csv")


def check(frame: pl.DataFrame, result: FusedSeries, z: npt.NDArray[np.float64] = Z) -> None:
    """Check every number of a track against the library's result."""

    for c, (name, unit) in enumerate(ANGLE):
        sigma = result.sigma[:, c]
        assert_column(frame[f"{name}_sigma_{unit}"], sigma)
        assert_column(
            frame[f"{name}_{unit}"], np.where(np.isfinite(sigma), result.mean[:, c], np.nan)
        )
    for k, name in enumerate(SENSORS):
        assert_column(frame[f"weight_{name}"], result.weights[k, :, 0])
        assert_column(frame[f"azimuth_sigma_{name}_deg"], np.sqrt(result.noise_variance[k]))
        expected = [
            None if np.isnan(plot) else bool(wrong)
            for plot, wrong in zip(z[k], result.outlier[k], strict=True)
        ]
        assert frame[f"outlier_{name}"].to_list() == expected


def fused(variance: Any = ((0.1**2,), (0.3**2,)), **options: Any) -> FusedSeries:
    options = {"time": TIMES, "period": 360.0} | options
    return fuse_series(Z, variance, MODEL, **options)


SIGMAS = ("--sigma", "A=0.1", "--sigma", "B=0.3")


def test_track_is_that_of_the_library(write: Write, tmp_path: Path) -> None:
    path = write(lines())
    frame = track(path, *SIGMAS, *MOTION, folder=tmp_path)
    assert frame.columns == [
        "time_s",
        *(f"{name}{of}_{unit}" for name, unit in ANGLE for of in ("", "_sigma")),
        *("weight_A", "azimuth_sigma_A_deg", "outlier_A"),
        *("weight_B", "azimuth_sigma_B_deg", "outlier_B"),
    ]
    assert frame["time_s"].to_list() == TIMES.tolist()
    result = fused()
    assert result.outlier.any()
    check(frame, result)


@pytest.mark.parametrize("method", get_args(FusionMethod))
def test_every_method(method: FusionMethod, write: Write, tmp_path: Path) -> None:
    picture = tmp_path / "p.png"
    options = (*SIGMAS, *MOTION, "--method", method, "--plot", picture)
    check(track(write(lines()), *options, folder=tmp_path), fused(method=method))
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_one_sigma_for_all_and_others_by_name(write: Write, tmp_path: Path) -> None:
    arguments = (write(lines()), *MOTION)
    check(track(*arguments, "--sigma", 0.2, folder=tmp_path), fused(0.2**2))
    frame = track(*arguments, "--sigma", 0.1, "--sigma", "B=0.3", folder=tmp_path)
    check(frame, fused([[0.1**2], [0.3**2]]))


def test_errors_of_sensors(write: Write, tmp_path: Path) -> None:
    """Each target has errors of its own; its sensors may come in any order."""
    other = recording(seed=9)
    rows = [*lines(extra=",7"), *reversed(lines(other, ",8"))]
    path = write(rows, header="time_s,sensor,azimuth_deg,target")
    arguments = (path, *SIGMAS, *MOTION, "--by", "target")
    frame = track(*arguments, "--bias-sigma", "B=0.4", folder=tmp_path)
    options = {"time": TIMES, "period": 360.0}
    # in the order of the rows of each target
    for target, z, order in (("7", Z, [0, 1]), ("8", other, [1, 0])):
        variance, bias_sigma = np.array([[0.1**2], [0.3**2]]), np.array([0.0, 0.4])
        found = fuse_series(
            z[order], variance[order], MODEL, bias_sigma=bias_sigma[order], **options
        )
        names = ("weights", "noise_variance", "outlier", "bias_sigma")
        result = replace(found, **{name: getattr(found, name)[order] for name in names})
        assert np.all(result.bias_sigma[1] > 0.0)
        check(frame.filter(pl.col("target").cast(pl.String) == target), result, z)
    done = run(*arguments, "--bias-sigma", 0.4)
    (summary,) = tables(done.out)
    assert summary[0][-2:] == ["azimuth_bias_deg", "azimuth_bias_sigma_deg"]
    assert len(summary) == 5
    for given, wrong in (("C=1", "bias_sigma is given for C"), ("B=-1", "--bias-sigma is 'B=-1'")):
        done = run(*arguments, "--bias-sigma", given)
        assert done.code != 0
        assert wrong in done.err


def test_sigma_column(write: Write, tmp_path: Path) -> None:
    sigma = np.where(np.arange(Z.size) % 3, 0.2, 0.1)
    rows = [
        f"{line},{'' if line.endswith(',') else value}"
        for line, value in zip(lines(), sigma, strict=True)
    ]
    path = write(rows, "time_s,sensor,azimuth_deg,s")
    arguments = (path, "--column", "azimuth_sigma_deg=s", *MOTION)
    stated = sigma.reshape(-1, 2).T.copy()
    for row, plots in zip(stated, Z, strict=True):
        row[np.isnan(plots)] = np.median(row[~np.isnan(plots)])
    check(track(*arguments, folder=tmp_path), fused(stated**2))
    (summary,) = tables(run(*arguments).out)
    assert [row[4] for row in summary[1:]] == [f"{np.median(row):.3g}" for row in stated]


def test_period_zero_and_other_names(write: Write, tmp_path: Path) -> None:
    flat = np.where(Z > 180, Z - 360, Z)
    path = write(lines(flat), "t,radar,el")
    options = ("--column", "sensor=radar", "--column", "time_s=t", "--value", "el", "--period", 0)
    frame = track(path, *options, *SIGMAS, *MOTION, folder=tmp_path)
    assert frame.columns[:3] == ["time_s", "el", "el_sigma"]
    result = fuse_series(flat, [[0.1**2], [0.3**2]], MODEL, time=TIMES)
    assert result.mean[:, 0].min() < 0
    known = np.isfinite(result.sigma[:, 0])
    np.testing.assert_array_equal(frame["el"].drop_nulls(), result.mean[known, 0])


def test_order_of_rows_does_not_matter(write: Write, tmp_path: Path) -> None:
    rows = lines()
    first, *others = rows
    np.random.default_rng(0).shuffle(others)
    arguments = (*SIGMAS, *MOTION)
    shuffled = track(write([first, *others]), *arguments, folder=tmp_path)
    assert shuffled.equals(track(write(rows), *arguments, folder=tmp_path))


def test_files_are_sensors_or_are_stacked(write: Write, tmp_path: Path) -> None:
    files = [
        write(
            [f"{t},{v}" for t, v in zip(TIMES, z, strict=True)], "time_s,azimuth_deg", f"{name}.csv"
        )
        for name, z in zip(SENSORS, np.where(np.isnan(Z), "", Z.astype(str)), strict=True)
    ]
    check(track(*files, *SIGMAS, *MOTION, folder=tmp_path), fused())
    half = [
        write(rows, name=name) for rows, name in ((lines()[:50], "x.csv"), (lines()[50:], "y.csv"))
    ]
    frame = track(*half, *SIGMAS, *MOTION, folder=tmp_path)
    check(frame, fused())


def test_parquet_and_csv_together(write: Write, tmp_path: Path) -> None:
    first = write([line + ",7" for line in lines()[:50]], "time_s,sensor,azimuth_deg,target")
    rest = [line.split(",") for line in lines()[50:]]
    second = tmp_path / "second.parquet"
    pl.DataFrame(
        {
            "time_s": [float(t) for t, _, _ in rest],
            "sensor": [name for _, name, _ in rest],
            "azimuth_deg": [float(v) if v else None for _, _, v in rest],
            "target": [7] * len(rest),
        }
    ).write_parquet(second)
    arguments = ("--by", "target", *SIGMAS, *MOTION)
    frame = track(first, second, *arguments, folder=tmp_path)
    assert frame["target"].unique().to_list() == ["7"]
    check(frame, fused())


START = datetime.datetime(2026, 3, 1, 23, 59, 30)


@pytest.mark.parametrize(
    "form", ["%Y-%m-%dT%H:%M:%S", "%Y-%m-%d %H:%M:%S.%f", "%Y-%m-%dT%H:%M:%SZ"]
)
def test_times_of_iso_8601(form: str, write: Write, tmp_path: Path) -> None:
    moments = [START + datetime.timedelta(seconds=t) for t in TIMES]
    text = {f"{t}": m.strftime(form) for t, m in zip(TIMES, moments, strict=True)}
    rows = [f"{text[t]},{rest}" for t, rest in (line.split(",", 1) for line in lines())]
    arguments = (write(rows), *SIGMAS, *MOTION)
    frame = track(*arguments, "--plot", tmp_path / "p.svg", folder=tmp_path)
    zone = datetime.timezone.utc if form.endswith("Z") else None
    assert frame["time_s"].to_list() == [m.replace(tzinfo=zone) for m in moments]
    check(frame, fused())
    for suffix in ("csv", "json"):
        output = tmp_path / f"o.{suffix}"
        assert run(*arguments, "--output", output).code == 0
        assert "2026-03-01T23:59:30" in output.read_text(encoding="utf-8")


@pytest.mark.parametrize("unit", ["ms", "us", "ns"])
@pytest.mark.parametrize("zone", [None, "Europe/Berlin"])
def test_times_of_parquet(unit: Any, zone: str | None, tmp_path: Path) -> None:
    path = tmp_path / "p.parquet"
    rows = [line.split(",") for line in lines()]
    moments = [START + datetime.timedelta(seconds=float(t)) for t, _, _ in rows]
    times = pl.Series(moments, dtype=pl.Datetime(unit))
    pl.DataFrame(
        {
            "time_s": times if zone is None else times.dt.replace_time_zone(zone),
            "sensor": [name for _, name, _ in rows],
            "azimuth_deg": [float(v) if v else None for _, _, v in rows],
        }
    ).write_parquet(path)
    frame = track(path, *SIGMAS, *MOTION, folder=tmp_path)
    expected = pl.Datetime(unit, None if zone is None else "UTC")
    assert frame["time_s"].dtype == expected
    check(frame, fused())


def test_dates_without_times(write: Write, tmp_path: Path) -> None:
    rows = [f"2026-01-{day:02},A,{value}" for day, value in ((1, 1.0), (2, 2.0), (4, 4.1))]
    frame = track(write(rows), *SIGMAS[:2], *MOTION, folder=tmp_path)
    times = np.array([0, 1, 3]) * 86400.0
    expected = fuse_series([[1.0, 2.0, 4.1]], 0.1**2, MODEL, time=times, period=360.0)
    assert frame["azimuth_rate_deg_s"].to_list()[1:] == expected.mean[1:, 1].tolist()


@pytest.mark.parametrize("suffix", ["csv", "json", "parquet"])
def test_output_has_full_precision(suffix: str, write: Write, tmp_path: Path) -> None:
    output = tmp_path / f"track.{suffix}"
    done = run(write(lines()), *SIGMAS, *MOTION, "--output", output)
    assert (done.code, done.err) == (0, "")
    assert done.out.endswith(f"wrote {TIMES.size} rows to {output}\n")
    rows, result = terminal.rows_of(output), fused()
    assert [row["time_s"] for row in rows] == TIMES.tolist()
    assert rows[0]["azimuth_rate_deg_s"] is None
    assert [row["azimuth_rate_sigma_deg_s"] for row in rows[5:]] == result.sigma[5:, 1].tolist()
    assert [row["weight_B"] for row in rows[5:]] == result.weights[1, 5:, 0].tolist()


def test_summary(write: Write) -> None:
    done = run(write(lines()), *SIGMAS, *MOTION)
    assert (done.code, done.err) == (0, "")
    (summary,) = tables(done.out)
    assert summary[0] == [
        *("sensor", "plot_count", "missing_count", "outlier_count", "azimuth_sigma_stated_deg"),
        *("azimuth_sigma_deg", "azimuth_sigma_last_deg", "azimuth_innovation_rms_deg"),
        *("innovation_rms_normalised", "weight_mean"),
    ]
    result = fused()
    believed = np.sqrt(result.noise_variance)
    normalised = result.innovation / np.sqrt(result.innovation_variance)
    for k, row in enumerate(summary[1:]):
        numbers = [
            (0.1, 0.3)[k],
            np.median(believed[k]),
            believed[k, -1],
            metrics.rmse(result.innovation[k]),
            metrics.rmse(normalised[k]),
            np.nanmean(result.weights[k, :, 0]),
        ]
        present = np.count_nonzero(~np.isnan(Z[k]))
        counts = (present, TIMES.size - present, np.count_nonzero(result.outlier[k]))
        assert row == [SENSORS[k], *map(str, counts), *(f"{number:.3g}" for number in numbers)]
    sigma = np.median(result.sigma[np.isfinite(result.sigma[:, 0]), 0])
    assert f"fused: 60 steps, median sigma of azimuth_deg {sigma:.3g}\n" in done.out


def test_groups(write: Write, tmp_path: Path) -> None:
    other = recording(seed=9)
    rows = [*lines(extra=",007,x"), *lines(other, ",b,y"), "0,C,5.5,b,y", "2,C,5.7,b,y"]
    path = write(rows, "time_s,sensor,azimuth_deg,target,site")
    arguments = (path, "--by", "target", "--by", "site", *SIGMAS)
    arguments += ("--sigma", 1, *MOTION)
    frame = track(*arguments, folder=tmp_path)
    assert frame.columns[:3] == ["target", "site", "time_s"]
    first, second = frame.partition_by("target", maintain_order=True)
    check(first, fused())
    assert (first["target"][0], first["site"][0], first["weight_C"].null_count()) == (
        "007",
        "x",
        60,
    )
    z = np.vstack([other, [5.5, 5.7, *[np.nan] * 58]])
    expected = fuse_series(z, [[0.1**2], [0.3**2], [1.0]], MODEL, time=TIMES, period=360.0)
    check(second, expected, other)
    assert second["weight_C"].to_list()[-1] == expected.weights[2, -1, 0]

    done = run(*arguments, "--plot", tmp_path / "p.png")
    (summary,) = tables(done.out)
    names = [row[:3] for row in summary[1:]]
    assert names == [
        ["007", "x", "A"],
        ["007", "x", "B"],
        ["b", "y", "A"],
        ["b", "y", "B"],
        ["b", "y", "C"],
    ]
    assert re.findall(r"^(target .*): 60 steps", done.out, re.M) == [
        "target 007, site x",
        "target b, site y",
    ]


def test_a_missing_plot_makes_a_time_of_the_track(write: Write, tmp_path: Path) -> None:
    rows = ["0,A,1", "2,A,1.1", "4,A,1.2", "5,A,NA", "5,A,1.25", "9,A,-"]
    arguments = (write(rows), "--sigma", 0.1, *MOTION)
    frame = track(*arguments, folder=tmp_path)
    expected = fuse_series(
        [[1, 1.1, 1.2, 1.25, np.nan]], 0.1**2, MODEL, time=[0, 2, 4, 5, 9], period=360.0
    )
    assert frame["time_s"].to_list() == [0, 2, 4, 5, 9]
    assert frame["azimuth_deg"][4] == expected.mean[4, 0]
    assert tables(run(*arguments).out)[0][1][1:4] == ["4", "2", "0"]


def test_one_sensor_alone(write: Write) -> None:
    path = write([line for line in lines() if ",A," in line])
    done = run(path, "--sigma", 0.1, *MOTION)
    assert done.code == 0
    assert done.err == "A is the only sensor: its plots are filtered, but not fused\n"


def fits(out: str) -> dict[str, list[str]]:
    return {row[0]: row[1:] for row in tables(out)[0][1:]}


def test_what_is_not_given_is_fitted(write: Write, tmp_path: Path) -> None:
    arguments = (write(lines()),)
    done = run(*arguments)
    assert done.code == 0
    # the outlier of B is left out; A has none
    clean = Z.copy()
    clean[1, 30] = np.nan
    expected = [
        fit_noise(row[seen], time=TIMES[seen], period=360.0)
        for row, seen in zip(clean, ~np.isnan(Z), strict=True)
    ]
    best = min(expected, key=lambda fit: fit.sigma[1] / fit.acceleration_sigma)
    name = SENSORS[expected.index(best)]
    left = {"A": "0", "B": "1"}

    def told(value: float, sigma: float, sensor: str) -> list[str]:
        return [f"{value:.3g}", f"{sigma / value:.0%}", sensor, left[sensor]]

    assert fits(done.out) == {
        "sigma of A": told(expected[0].measurement_sigma, expected[0].sigma[2], "A"),
        "sigma of B": told(expected[1].measurement_sigma, expected[1].sigma[2], "B"),
        "alpha": told(best.alpha, best.sigma[0], name),
        "acceleration sigma": told(best.acceleration_sigma, best.sigma[1], name),
    }
    variance = [[fit.measurement_sigma**2] for fit in expected]
    result = fuse_series(Z, variance, best.model(2.0), time=TIMES, period=360.0)
    check(track(*arguments, folder=tmp_path), result)


@pytest.mark.parametrize(
    ("given", "fitted"),
    [
        (SIGMAS, {"alpha", "acceleration sigma"}),
        (SIGMAS[:2], {"sigma of B", "alpha", "acceleration sigma"}),
        (MOTION, {"sigma of A", "sigma of B"}),
        (MOTION[:2], {"sigma of A", "sigma of B", "acceleration sigma"}),
        ((*SIGMAS, *MOTION[2:]), {"alpha"}),
    ],
)
def test_only_what_is_not_given_is_fitted(
    given: tuple[Any, ...], fitted: set[str], write: Write
) -> None:
    done = run(write(lines()), *given)
    assert done.code == 0, done.err
    assert set(fits(done.out)) == fitted


def test_a_fit_takes_all_series_of_a_sensor() -> None:
    times = MODEL.dt * np.arange(80)
    z = np.stack([recording(80, seed)[0] for seed in (1, 2, 3)])
    z[1, 60:] = np.nan
    found = _noise.fit_sensor("A", [(times, row) for row in z], 360.0)
    assert not found.noise.outlier.any()
    expected = fit_noise(z, time=times, period=360.0)
    assert found.noise.measurement_sigma == pytest.approx(expected.measurement_sigma, rel=1e-6)
    assert found.noise.alpha == pytest.approx(expected.alpha, rel=1e-5)


def test_a_fit_takes_the_longest_series_up_to_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    times = MODEL.dt * np.arange(80)
    z = [recording(80, seed)[0] for seed in (1, 2)]
    monkeypatch.setattr(_noise, "_MOST_PLOTS", 60)
    found = _noise.fit_sensor("A", [(times[:30], z[0][:30]), (times, z[1])], 360.0)
    present = np.flatnonzero(~np.isnan(z[1]))[:60]
    expected = fit_noise(z[1][present], time=times[present], period=360.0)
    assert found.noise.measurement_sigma == pytest.approx(expected.measurement_sigma, rel=1e-9)


def test_outliers_do_not_spoil_a_fit() -> None:
    sigma = []
    for seed in range(20):
        z = simulate.radars(
            MODEL, 150, sigma=(0.1,), outlier_probability=0.05, period=360.0, rng=seed
        ).z[0]
        times = MODEL.dt * np.arange(150)
        fit = _noise.fit_sensor("A", [(times, z)], 360.0)
        assert fit.noise.outlier.any()
        plain = fit_noise(z, time=times, period=360.0)
        sigma.append((fit.noise.measurement_sigma, plain.measurement_sigma))
    robust, plain_median = np.median(sigma, axis=0)
    assert abs(robust / 0.1 - 1) < 0.1
    assert plain_median > 0.2


def test_motion_is_that_of_the_sensor_that_tells_it_best() -> None:
    times = MODEL.dt * np.arange(200)
    z = simulate.radars(MODEL, 200, sigma=(0.5, 0.05), period=360.0, rng=5).z
    both = [
        _noise.fit_sensor(name, [(times, row)], 360.0) for name, row in zip("AB", z, strict=True)
    ]
    assert _noise.best_motion(both).sensor == "B"
    assert _noise.best_motion(both[::-1]).sensor == "B"


def test_what_a_sensor_tells_of_the_motion_is_the_error_of_its_acceleration() -> None:
    # an acceleration without alpha is told for one alpha only
    errors = {"A": (0.9, 0.2, 0.1), "B": (0.5, 0.3, 0.1), "C": (np.inf, 0.1, 0.1)}
    told = [
        _noise.SensorFit(name, SimpleNamespace(acceleration_sigma=1.0, sigma=np.array(e)))  # type: ignore[arg-type]
        for name, e in errors.items()
    ]
    assert _noise.best_motion(told).sensor == "A"
    assert _noise.best_motion(told[1:]).sensor == "B"


def test_example_agrees_with_its_script_and_its_truth(tmp_path: Path) -> None:
    script = runpy.run_path(str(EXAMPLES / "make_radars.py"))
    header, *rows = EXAMPLE.read_text(encoding="utf-8").splitlines()
    assert header == "time_s,sensor,azimuth_deg"
    assert [tuple(line.split(",")) for line in rows] == list(script["rows"]())
    frame = track(EXAMPLE, folder=tmp_path).slice(6)
    truth = script["record"]().truth[6:, 0] % 360
    error = (frame["azimuth_deg"].to_numpy() - truth + 180) % 360 - 180
    # one target only: errors are correlated, so the mean may be off by this
    assert 0.5 < np.mean((error / frame["azimuth_sigma_deg"].to_numpy()) ** 2) < 1.6
    time = frame["time_s"].to_numpy()
    late, early = (
        frame["azimuth_sigma_south_deg"].to_numpy()[time > 500],
        frame["azimuth_sigma_south_deg"].to_numpy()[time < 250],
    )
    assert np.median(late) > 1.5 * np.median(early)
    assert frame["outlier_east"].sum() > 0


@pytest.mark.parametrize(
    ("header", "said"),
    [
        ("time_s,sensor,azimuth_deg,t", "both.csv has time_s and t: t is used\n"),
        ("time,sensor,azimuth_deg,t", ""),
    ],
)
def test_a_file_with_both_names_of_a_column(header: str, said: str, write: Write) -> None:
    """Another file has only one of them, so that it is not clear which is meant."""
    rows = lines()
    one = write([row for row in rows if ",A," in row], name="one.csv")
    both = write([f"{row},{k}" for k, row in enumerate(rows) if ",B," in row], header, "both.csv")
    arguments = ("--column", "time_s=t", *SIGMAS, *MOTION)
    assert run(one, both, *arguments).err.rpartition("/")[2] == said
    assert "has time_s" not in run(both, *arguments).err


def test_figure(write: Write, tmp_path: Path) -> None:
    rows = [line for i in range(6) for line in lines(extra=f",{i}")]
    path = write(rows, "time_s,sensor,azimuth_deg,t")
    picture = tmp_path / "p.svg"
    arguments = (path, *SIGMAS, *MOTION)
    done = run(*arguments, "--by", "t", "--plot", picture)
    assert (done.code, done.err) == (0, "only the first 4 of 6 groups are drawn\n")
    assert "t 3: 60 steps" in re.sub(r"<!-- (.*?) -->", r"\1", picture.read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["long.csv", "long.csv"], 2, "two files have the name long: add a column sensor"),
        (
            ["p.csv", "--value", "x"],
            2,
            "p.csv has no column x; it has time_s, sensor, azimuth_deg, s, g",
        ),
        (["p.csv", "--column", "time_s=x"], 2, "p.csv has no column x; .*"),
        (["p.csv", "--column", "sensor=x"], 2, "p.csv has no column x; .*"),
        (["p.csv", "--column", "azimuth_sigma_deg=x"], 2, "p.csv has no column x; .*"),
        (["p.csv", "--by", "x"], 2, "p.csv has no column x; .*"),
        (["p.csv", "--by", "time_s"], 2, "the column time_s is given for two purposes"),
        (["p.csv", "--by", "plot_count"], 2, "cannot group by plot_count: the results have .*"),
        (["p.csv", "--by", "rate"], 2, "p.csv has no column rate; .*"),
        (["p.csv", "--by", "weight_A"], 2, "p.csv has no column weight_A; .*"),
        (["r.csv", "--by", "weight_r"], 2, "the result would have two columns weight_r"),
        (
            ["p.csv"],
            1,
            "the noise of A cannot be estimated: z has 4 measurements; .*: give the sigma of A",
        ),
        (
            ["p.csv", "--sigma", "1"],
            1,
            "the noise of A cannot be estimated: z has 4 measurements; "
            "at least 10 are needed: give alpha and acceleration_sigma",
        ),
        (
            ["flat.csv"],
            1,
            "the noise of flat cannot be estimated: z lies on .*: give the sigma of flat",
        ),
        (
            ["twice.csv"],
            1,
            "twice.csv, line 5: A has two plots at 1.0: .* group the rows by a column",
        ),
        (
            ["p.csv", "--sigma", "C=1"],
            2,
            "sigma is given for C; the sensors are A, B",
        ),
        (["p.csv", "--sigma", "A=x"], 2, "--sigma is 'A=x'; it must be a positive number, or .*"),
        (["p.csv", "--sigma", "-1"], 2, "--sigma is '-1'; it must be a positive number, or .*"),
        (["p.csv", "--sigma", "nan"], 2, "--sigma is 'nan'; it must be a positive number, or .*"),
        (
            ["p.csv", "--sigma", "1e-90", "--alpha", "0", "--acceleration-sigma", "0"],
            2,
            "measurement_variance.* is .*",
        ),
        (
            ["p.csv", "--column", "azimuth_sigma_deg=s"],
            1,
            "p.csv, line 4: azimuth_sigma_deg is missing",
        ),
        (
            ["p.csv", "--column", "azimuth_sigma_deg=g"],
            1,
            "p.csv, line 3: g is -1; it must be positive .*",
        ),
        (["notime.csv"], 1, "notime.csv, line 4: time_s is missing"),
        (
            ["nosensor.csv"],
            1,
            "nosensor.csv, line 3: sensor is missing",
        ),
        (
            ["badtime.csv"],
            1,
            "badtime.csv, line 3: time_s is 'noon'; it must be a number of seconds "
            "or a date with time, like the other times",
        ),
        (
            ["mixedtime.csv"],
            1,
            "mixedtime.csv, line 3: time_s is '2026-01-01T00:00:02Z'; it must .*",
        ),
        (["nothing.csv"], 1, "there are no plots: azimuth_deg is missing in every row"),
        (
            ["flat.csv", "dates.csv"],
            1,
            "time_s holds numbers in flat.csv and dates in dates.csv; .*",
        ),
        (["bools.parquet"], 1, "bools.parquet: time_s holds Boolean, neither numbers nor dates"),
        (["p.csv", "--alpha", "-1"], 2, "alpha is -1.*"),
        (["p.csv", "--acceleration-sigma", "-1"], 2, "acceleration_sigma is -1.*"),
        (["p.csv", "--period", "-1"], 2, "period is -1.*"),
    ],
)
def test_errors_are_one_clear_line(
    arguments: list[str], code: int, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    two = "time_s,azimuth_deg\n"
    z = np.random.default_rng(0).normal(50, 1, 30)
    files = {
        "p": "time_s,sensor,azimuth_deg,s,g\n"
        + "".join(f"{i},A,{i}.5,1,1\n{i},B,{i}.4,{1 if i else ''},{i - 1}\n" for i in range(4))
        .replace("0,B,0.4,,-1", "0,B,0.4,1,-1")
        .replace("1,A,1.5,1,1", "1,A,1.5,,1"),
        "r": "time_s,azimuth_deg,weight_r\n1,2,3\n",
        "flat": two + "".join(f"{i},{i}\n" for i in range(20)),
        "twice": "time_s,sensor,azimuth_deg\n0,A,1\n1,A,\n1,A,1\n1,A,2\n",
        "notime": two + "0,1\n\n,2\n",
        "nosensor": "time_s,sensor,azimuth_deg\n0,A,1\n1,-,1\n",
        "badtime": two + "0,1\nnoon,2\n",
        "mixedtime": two + "2026-01-01T00:00:01,1\n2026-01-01T00:00:02Z,2\n",
        "nothing": two + "0,\n1,NA\n",
        "dates": two + "2026-01-01 10:00,1\n",
        "long": two + "".join(f"{i},{v}\n" for i, v in enumerate(z)),
    }
    for name, content in files.items():
        Path(f"{name}.csv").write_text(content, encoding="utf-8")
    pl.DataFrame({"time_s": [True], "azimuth_deg": [1.0]}).write_parquet("bools.parquet")
    done = run(*arguments)
    assert done.code == code, done.err
    assert re.fullmatch(f"tertia: {message}\n", done.err)
