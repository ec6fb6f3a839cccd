"""The report: its page, its summary and its command."""

import io
import json
import re
import runpy
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import polars as pl
import pytest
from places import EXAMPLES
from terminal import run

from tertia import metrics, report, simulate
from tertia.location import Station
from tertia.report._bearings import hear
from tertia.report._times import Times
from tertia.sensors import Bias
from tertia.tracker import Plots, Radar, track

pytest.importorskip("plotly")
pytest.importorskip("jinja2")

PLOTS = (EXAMPLES / "air_plots.csv", "--sensors", EXAMPLES / "air_radars.toml")


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scene")
    assert run("simulate", folder, "--aircraft", 16, "--duration", 700, "--seed", 5).code == 0
    return folder


@pytest.fixture(scope="module")
def summary(scene: Path) -> dict[str, Any]:
    """Return the summary of the page with everything."""
    done = run(
        *("report", scene / "plots.csv", "--sensors", scene / "sensors.toml"),
        *("--plans", scene / "plans.json", "--truth", scene / "truth.csv"),
        *("--bearings", scene / "bearings.csv"),
        *("--by", "target", "--output", scene / "page.html", "--json"),
    )
    assert done.code == 0, done.err
    found: dict[str, Any] = json.loads(done.out)
    return found


def test_radars_are_as_good_as_they_were_made(scene: Path, summary: dict[str, Any]) -> None:
    """Noise within its errors, the bias of the last radar, and its noise after half the time."""
    made = json.loads((scene / "scene.json").read_text(encoding="utf-8"))
    for row in summary["radars"][:2]:
        for kind in ("range_sigma", "azimuth_sigma"):
            unit = "m" if kind.startswith("range") else "deg"
            off = row[f"{kind}_{unit}"] - row[f"{kind}_stated_{unit}"]
            assert abs(off) < 4 * row[f"{kind}_error_{unit}"], row["radar"]
        assert abs(row["range_bias_m"]) < 4 * row["range_bias_sigma_m"]
    last, fault = summary["radars"][2], made["radars"]["radar-3"]
    between = (fault["range_bias_m"] - last["range_bias_m"]) / last["range_bias_sigma_m"]
    assert abs(between) < 4
    assert last["azimuth_sigma_stated_deg"] * 1.3 < last["azimuth_sigma_deg"]
    assert last["azimuth_sigma_deg"] < fault["azimuth_sigma_deg"]
    assert any(text.startswith("radar-3: azimuth sigma") for text in summary["findings"])
    assert not any(text.startswith(("radar-1", "radar-2")) for text in summary["findings"])


def test_tracks_are_corrected_and_the_cost_of_not_correcting_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two radars that contradict each other: the tracks of `track`, and how many without it."""
    write = runpy.run_path(str(EXAMPLES / "scenes.py"))["write"]
    monkeypatch.chdir(tmp_path)
    write("misaligned")
    scene = ("misaligned/plots.csv", "--sensors", "misaligned/sensors.toml")
    page = Path("page.html")
    found = json.loads(run("report", *scene, "--output", page, "--json").out)
    assert "Systematic errors of the radars are subtracted" in page.read_text(encoding="utf-8")
    assert found["tracks"] == json.loads(run("track", *scene, "--json").out)["track_count"] == 12
    assert found["tracks_not_corrected"] > 12
    said = f"{found['tracks_not_corrected']} tracks instead of 12"
    assert found["findings"][-1] == f"Without correction of the biases: {said}."
    assert [one.partition(" bias")[0] for one in found["findings"][:-1]] == [
        "east: range",
        "east: azimuth",
    ]
    off = (*scene, "--registration", "off", "--output", page, "--json")
    uncorrected = json.loads(run("report", *off).out)
    assert "Systematic errors of the radars are" not in page.read_text(encoding="utf-8")
    assert uncorrected["tracks"] == found["tracks_not_corrected"]
    assert uncorrected["findings"] == found["findings"][:-1]


def test_fusion_is_better_than_any_radar_alone(summary: dict[str, Any]) -> None:
    rows = {row["tracks"]: row for row in summary["fusion"]}
    alone = min(row["rmse_m"] for name, row in rows.items() if name.endswith("alone"))
    assert (
        rows["tracks fused, estimated noise"]["rmse_m"]
        < rows["tracks fused, stated noise"]["rmse_m"]
    )
    assert rows["tracks fused, estimated noise"]["rmse_m"] < alone
    # systematic errors make the registration track once more, with other numbers
    assert rows["tracks fused, stated noise"]["rmse_m"] < alone
    assert rows["all radars together, at these instants"]["rmse_m"] < alone
    # covariance intersection is conservative whatever the correlation
    assert rows["covariance intersection, estimated noise"]["within_95"] > 0.92


def test_who_left_the_plan_is_found_without_correction(scene: Path, tmp_path: Path) -> None:
    """All who left it, soon, and nobody else."""
    done = run(
        *("report", scene / "plots.csv", "--sensors", scene / "sensors.toml"),
        *("--plans", scene / "plans.json", "--registration", "off"),
        *("--output", tmp_path / "page.html", "--json"),
    )
    made = json.loads((scene / "scene.json").read_text(encoding="utf-8"))["left_plan_s"]
    rows = json.loads(done.out)["conformance"]
    found = {row["plan"]: row["left_s"] for row in rows if row["left_s"]}
    assert set(found) == set(made)
    for name, time in made.items():
        assert 0 < found[name] - time < 90.0


def test_who_left_the_plan_is_found(scene: Path, summary: dict[str, Any]) -> None:
    """All who left it, soon; a turn that is flown too wide may seem to leave it for a while."""
    made = json.loads((scene / "scene.json").read_text(encoding="utf-8"))["left_plan_s"]
    found = {row["plan"]: row["left_s"] for row in summary["conformance"] if row["left_s"]}
    assert set(made) <= set(found)
    others = [row for row in summary["conformance"] if row["plan"] in set(found) - set(made)]
    assert len(others) <= 1
    assert all(row["back_s"] - row["left_s"] < 60.0 for row in others if row["left_s"])
    for name, time in made.items():
        assert 0 < found[name] - time < 90.0


def test_emitters_are_where_they_were_put(scene: Path, summary: dict[str, Any]) -> None:
    made = json.loads((scene / "scene.json").read_text(encoding="utf-8"))["emitters_m"]
    for row in summary["emitters"]:
        assert not row["moves"]
        for value, axis in zip(made[row["emitter"]], ("east", "north"), strict=True):
            assert abs(row[f"{axis}_m"] - value) < 4 * row[f"{axis}_sigma_m"]


def test_figures_are_those_of_evaluate(scene: Path, summary: dict[str, Any]) -> None:
    tracks = scene / "tracks.parquet"
    options = ("--sensors", scene / "sensors.toml", "--plans", scene / "plans.json")
    assert run("track", scene / "plots.csv", *options, "--output", tracks).code == 0
    judged = json.loads(run("evaluate", tracks, "--truth", scene / "truth.csv", "--json").out)
    page = {row["figure"]: row["all radars together"] for row in summary["evaluation"]}
    for row in judged["figures"]:
        assert page[row["figure"]] == pytest.approx(row["value"], rel=1e-9), row["figure"]
    rows = summary["requirements"]
    own = {row["figure"]: row for row in rows if row["tracks"] == "all radars together"}
    assert len(own) == 14
    for figure, row in own.items():
        assert row["value"] == page[figure]
        assert row["low"] is None or row["low"] <= row["value"]
        assert (row["limit"], row["verdict"]) == (None, "")


def test_the_page_is_whole_and_asks_for_nothing(scene: Path, summary: dict[str, Any]) -> None:
    """All sections, valid figures with units on their axes, and no address outside the library."""
    html = (scene / "page.html").read_text(encoding="utf-8")
    for section in (
        *("map", "radars", "fusion", "truth", "audit"),
        *("plans", "finders", "tracks", "notes"),
    ):
        assert f'<section id="{section}">' in html
    assert not re.search(r"<(script|link|img)[^>]+(src|href)=\"(?!data:)", html)
    charts = json.loads(re.findall(r"^const charts = (.*);$", html, re.MULTILINE)[0])
    graph_objects = pytest.importorskip("plotly.graph_objects")
    without = {"updated scans", "NEES per axis", "stated noise", "estimated noise", "intersection"}
    for figure in charts.values():
        for key, axis in graph_objects.Figure(figure).to_dict()["layout"].items():
            if re.match("[xy]axis", key):
                text = axis["title"]["text"]
                assert re.search(r"\(.+\)", text) or text in without


def test_without_truth_plans_and_bearings(tmp_path: Path) -> None:
    """The example of two radars, and one of them alone."""
    output = tmp_path / "page.html"
    done = run("report", *PLOTS, "--output", output)
    assert done.code == 0, done.err
    html = output.read_text(encoding="utf-8")
    assert '<section id="fusion">' in html
    # each radar is compared with the other one, and says how well that knows
    assert "reference-table" in html
    assert not any(
        f'<section id="{name}">' in html for name in ("truth", "audit", "plans", "finders")
    )
    plots = pl.read_csv(PLOTS[0], infer_schema=False).filter(pl.col("sensor") == "west")
    plots.drop("sensor").write_csv(tmp_path / "west.csv")
    radars = Path(PLOTS[2]).read_text(encoding="utf-8").split("[[radar]]")
    (tmp_path / "west.toml").write_text("[[radar]]".join(radars[:2]), encoding="utf-8")
    done = run(
        "report", tmp_path / "west.csv", "--sensors", tmp_path / "west.toml", "--output", output
    )
    assert done.code == 0, done.err
    assert '<section id="fusion">' not in output.read_text(encoding="utf-8")


def test_dates_and_hostile_names(tmp_path: Path) -> None:
    """Times are since a midnight, and a name cannot end a script or begin a tag."""
    name = "</script><b>&"
    plots = pl.read_csv(PLOTS[0], infer_schema=False).filter(pl.col("sensor") == "west")
    start = pl.datetime(2024, 5, 1, 23, 58)
    time = start + pl.duration(milliseconds=pl.col("time_s").cast(pl.Float64) * 1000)
    moments = time.dt.to_string("%Y-%m-%dT%H:%M:%S%.3f")
    plots.with_columns(moments.alias("time_s"), pl.lit(name).alias("sensor")).write_csv(
        tmp_path / "plots.csv"
    )
    radars = Path(PLOTS[2]).read_text(encoding="utf-8").split("[[radar]]")
    (tmp_path / "radars.toml").write_text(
        "[[radar]]".join(radars[:2]).replace("west", name), encoding="utf-8"
    )
    options = ("--sensors", tmp_path / "radars.toml", "--output", tmp_path / "page.html")
    assert run("report", tmp_path / "plots.csv", *options).code == 0
    html = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert '"title":"time (as recorded)","zero":1714521600000.0' in html
    assert name not in html
    assert "&lt;/script&gt;&lt;b&gt;&amp;" in html


def test_nothing_to_show() -> None:
    """A page of no plots, and of plots that make no track, says so and does not fail."""
    radar = Radar(range_sigma=50.0, azimuth_sigma=0.002, scan_period=4.0, name="r")
    for plots in (Plots([], [], []), Plots([0.0, 100.0], [5e4, 9e4], [0.0, 2.0])):
        page = report.make(plots, [radar, radar])
        assert page.summary["tracks"] == 0
        assert page.summary["findings"] == []


def ship() -> tuple[list[Station], report.Emitter, np.ndarray[Any, Any]]:
    """Return three finders, the bearings of a ship under way, and where it was."""
    random = np.random.default_rng(3)
    places = [[0.0, 0.0], [2e4, 0.0], [0.0, 2e4]]
    finders = [Station(place, azimuth_sigma=0.01) for place in places]
    time = np.arange(60.0)
    target = np.column_stack([8e3 + 100 * time, np.full(60, 8e3)])
    off = target[:, np.newaxis] - np.array(places)
    azimuth = np.arctan2(off[..., 0], off[..., 1]) + 0.01 * random.standard_normal((60, 3))
    return finders, report.Emitter("ship", time, azimuth), target


def test_an_emitter_that_moves_has_a_path_and_no_position() -> None:
    """Its path is where the ship was, within the sigmas; an emitter alone needs no radar."""
    finders, emitter, target = ship()
    page = report.make(stations=finders, bearings=[emitter])
    [row] = page.summary["emitters"]
    assert row["moves"]
    assert "east_m" not in row
    assert page.summary["findings"] == [
        f"ship moves along a path with a sigma of {row['path_sigma_m']:.3g} m."
    ]
    path = hear(emitter, finders).path
    assert path is not None
    off = path.position - target
    nees = metrics.nees(off, path.covariance[:, :2, :2]) / 2
    assert 0.2 < np.mean(nees) < 2.5


def test_bearings_alone(scene: Path, summary: dict[str, Any], tmp_path: Path) -> None:
    """The emitters of the page with everything, no map of tracks, and nothing of radars."""
    output = tmp_path / "bearings.html"
    done = run(
        *("report", "--sensors", scene / "sensors.toml", "--bearings", scene / "bearings.csv"),
        *("--by", "target", "--output", output, "--json"),
    )
    assert done.code == 0, done.err
    found = json.loads(done.out)
    assert found["emitters"] == summary["emitters"]
    assert found["radars"] == []
    assert found["tracks"] == 0
    assert set(found) == set(summary)
    html = output.read_text(encoding="utf-8")
    assert '<section id="finders">' in html
    assert not any(f'<section id="{name}">' in html for name in ("map", "radars", "tracks"))
    assert "player" not in html.split("</script>")[-2]


def test_what_a_page_needs() -> None:
    finders, emitter, _ = ship()
    with pytest.raises(ValueError, match="plots or bearings must be given"):
        report.make()
    radar = Radar(range_sigma=50.0, azimuth_sigma=0.002, scan_period=4.0)
    with pytest.raises(ValueError, match="sensors, plans and truth can be used only with plots"):
        report.make(sensors=[radar], stations=finders, bearings=[emitter])
    done = run("report", "--sensors", PLOTS[2])
    assert (done.code, done.err) == (2, "tertia: give files of plots, or --bearings\n")
    done = run("report", *PLOTS[1:], "--bearings", "b.csv", "--truth", PLOTS[0])
    assert "--plans and --truth are for plots" in done.err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--output", "page.pdf"), "cannot write page.pdf: its name must end in .html, .htm"),
        (("--max-distance", "0"), "max_distance is 0.0; it must be a positive number"),
        (("--truth", "nothing.csv"), "there is no file nothing.csv"),
    ],
)
def test_wrong_usage(options: tuple[str, ...], message: str) -> None:
    done = run("report", *PLOTS, *options)
    assert (done.code, done.err) == (2, f"tertia: {message}\n")


def test_errors_at_common_instants_are_those_of_the_target_at_the_time(
    summary: dict[str, Any],
) -> None:
    """Where a track changes its target, it is not compared with the one it has left.

    The errors are about those at updates: radar-1 alone had 3,685 m there, and 133 m at updates.
    """
    there = {row["tracks"]: row["rmse_m"] for row in summary["fusion"]}
    at_updates = next(row for row in summary["evaluation"] if row["figure"] == "RMSE")
    for name in ("radar-1", "radar-2", "radar-3"):
        assert 1.0 < there[f"{name} alone"] / at_updates[name] < 1.5, name


def test_what_has_one_name_has_one_value(summary: dict[str, Any]) -> None:
    """Every figure that two tables show of the same tracks is the same number."""
    found: dict[tuple[str, str], set[str]] = {}
    words = {
        "rmse_m": "RMSE",
        "nees_per_axis": "NEES per axis",
        "within_95": "share within the 95 % ellipse",
    }

    def add(tracks: str, figure: str, value: float | None) -> None:
        found.setdefault((tracks, words.get(figure, figure)), set()).add(
            "none" if value is None else f"{value:.6g}"
        )

    for row in summary["evaluation"]:
        for name in row.keys() - {"figure", "unit"}:
            add(name, row["figure"], row[name])
    for row in summary["requirements"]:
        add(row["tracks"], row["figure"], row["value"])
    for table in ("audit", "fusion"):
        for row in summary[table]:
            for figure in words.keys() & row.keys():
                add(row["tracks"], figure, row[figure])
    compared = [key for key in found if key[1] in words.values()]
    assert len(compared) >= 15
    assert {key: values for key, values in found.items() if len(values) > 1} == {}
    text = next(one for one in summary["findings"] if one.startswith("All radars together"))
    (rmse,) = found["all radars together", "RMSE"]
    assert f"RMSE {float(rmse):.3g} m" in text


def test_limits_are_shown_where_they_are_given(
    summary: dict[str, Any], scene: Path, tmp_path: Path
) -> None:
    html = (scene / "page.html").read_text(encoding="utf-8")
    assert summary["requirements"]
    assert "no limit is given" not in html
    assert '<th scope="col" class="words">verdict</th>' not in html
    assert '<td class="words">radar-1 alone</td>' in html
    limits = tmp_path / "limits.toml"
    limits.write_text("rmse_m = 10\n", encoding="utf-8")
    done = run(
        *("report", scene / "plots.csv", "--sensors", scene / "sensors.toml"),
        *("--truth", scene / "truth.csv", "--limits", limits, "--output", tmp_path / "page.html"),
    )
    assert done.code == 0, done.err
    html = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert '<th scope="col" class="words">verdict</th>' in html
    assert '<td class="words">not met</td>' in html
    # what the recording has not is not among its figures
    assert "flight plans</" not in html
    assert "emitters</" not in html


def test_tables_can_be_taken_as_csv(summary: dict[str, Any], scene: Path) -> None:
    """Each table has its link, whose values are those of the summary, and not computed again."""
    html = (scene / "page.html").read_text(encoding="utf-8")
    found = {
        name: pl.read_csv(io.StringIO(unquote(text)), infer_schema_length=None)
        for name, text in re.findall(
            r'<a download="([a-z-]+)\.csv" href="data:text/csv;charset=utf-8,([^"]*)"', html
        )
    }
    assert found.keys() == set(re.findall(r'tabindex="0" id="([a-z-]+)"', html))
    emitters = [{k: v for k, v in row.items() if k != "bearings"} for row in summary["emitters"]]
    bearings = [
        {"emitter": row["emitter"]} | one for row in summary["emitters"] for one in row["bearings"]
    ]
    tables = {
        "radar-table": summary["radars"],
        "fusion-table": summary["fusion"],
        "requirement-table": summary["requirements"],
        "evaluation-table": summary["evaluation"],
        "audit-table": summary["audit"],
        "plan-table": summary["conformance"],
        "emitter-table": emitters,
        "bearing-table": bearings,
    }
    for name, rows in tables.items():
        assert found.pop(name).equals(as_read(rows)), name
    [(name, tracks)] = found.items()
    assert (name, len(tracks)) == ("track-table", summary["tracks"])


def as_read(rows: list[dict[str, Any]]) -> pl.DataFrame:
    """Return rows as if they had been written and read; an empty text is read as nothing."""
    frame = pl.DataFrame(rows, infer_schema_length=None).with_columns(
        pl.col(pl.String).replace("", None)
    )
    return pl.read_csv(frame.write_csv().encode(), infer_schema_length=None)


def test_bearings_have_the_time_scale_of_the_plots(scene: Path, tmp_path: Path) -> None:
    """Dates of both are from the same midnight, and dates do not go with seconds."""
    for name in ("plots", "bearings"):
        frame = pl.read_csv(scene / f"{name}.csv", infer_schema_length=None).head(3000)
        time = pl.datetime(2024, 5, 1, 6) + pl.duration(milliseconds=1000 * pl.col("time_s"))
        frame.with_columns(time.dt.to_string("%Y-%m-%dT%H:%M:%S%.3fZ").alias("time_s")).write_csv(
            tmp_path / f"{name}.csv"
        )
    command = ("report", tmp_path / "plots.csv", "--sensors", scene / "sensors.toml")
    command += ("--by", "target", "--output", tmp_path / "page.html", "--bearings")
    assert run(*command, tmp_path / "bearings.csv").code == 0
    html = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert '"title":"time (UTC)","zero":1714521600000.0' in html
    charts = json.loads(re.findall(r"^const charts = (.*);$", html, re.MULTILINE)[0])
    for name in ("updates", *(one for one in charts if one.startswith("bearings-"))):
        time = [x for trace in charts[name]["data"] for x in trace["x"] if x is not None]
        assert 6 * 3600 <= min(time) < max(time) < 6.2 * 3600, name
    done = run(*command, scene / "bearings.csv")
    assert done.code != 0
    assert "must both be dates, or both be seconds" in done.err


@pytest.mark.parametrize(
    ("since", "title", "column", "text", "sentence"),
    [
        (None, "time (s)", "from (s)", "36,610", "36,610 s"),
        (datetime(2024, 5, 1), "time (as recorded)", "from", "10:10:10", "10:10:10"),
        (datetime(2024, 5, 1, tzinfo=timezone.utc), "time (UTC)", "from", "10:10:10", "10:10:10"),
        (
            datetime(2024, 5, 1, tzinfo=timezone(timedelta(hours=2))),
            "time (UTC)",
            "from",
            "08:10:10",
            "08:10:10",
        ),
    ],
)
def test_texts_of_times(
    since: datetime | None, title: str, column: str, text: str, sentence: str
) -> None:
    times = Times(since)
    assert (times.title, times.column("from")) == (title, column)
    assert (times.text(36_610.0), times.at(36_610.0)) == (text, sentence)
    assert times.text(None) is None
    if since is not None:
        assert str(times.text(86_400.0 + 36_610.0)) == f"2024-05-02 {text}"
        assert times.zero == 1e3 * since.replace(tzinfo=since.tzinfo or timezone.utc).timestamp()


def test_the_page_tells_which_radar_is_bad_and_how(summary: dict[str, Any], scene: Path) -> None:
    """From the findings alone, compared with what the scene was made of."""
    faults = json.loads((scene / "scene.json").read_text(encoding="utf-8"))["radars"]
    told = [text for text in summary["findings"] if text.startswith("radar-")]
    assert {text.partition(":")[0] for text in told} == set(faults) == {"radar-3"}
    assert any("azimuth sigma" in one for one in told)
    bias = next(one for one in told if "range bias" in one)
    value, error = (float(one) for one in re.findall(r"(\d+) ± (\d+) m", bias)[0])
    assert abs(value - faults["radar-3"]["range_bias_m"]) < 3 * error


def test_maps_have_the_numbers_of_the_table(scene: Path, summary: dict[str, Any]) -> None:
    html = (scene / "page.html").read_text(encoding="utf-8")
    charts = json.loads(re.findall(r"^const charts = (.*);$", html, re.MULTILINE)[0])
    for row, cells in zip(summary["radars"], charts["no-track"]["data"], strict=True):
        assert cells["name"] == row["radar"]
        assert sum(x for one in cells["z"] for x in one if x is not None) == row["in_no_track"]
    for name in ("coverage", "levels"):
        shares = [x for cells in charts[name]["data"] for one in cells["z"] for x in one]
        known = [x for x in shares if x is not None]
        assert 20 < len(known) < len(shares)
        assert all(0 <= x <= 1 for x in known)
        assert np.mean(known) == pytest.approx(
            np.mean([row["probability_of_update"] for row in summary["radars"]]), abs=0.1
        )


@pytest.mark.parametrize(
    ("fault", "words", "size", "within"),
    [
        ({"time": 1.5}, "clock", 1.5, 0.5),
        ({"azimuth": np.radians(0.3)}, "azimuth bias", 0.3, 0.02),
        ({"azimuth": np.radians(0.5)}, "azimuth bias", 0.5, 0.02),
        ({"range": 200.0}, "range bias", 200.0, 30.0),
    ],
)
def test_an_error_of_a_radar_is_a_finding(
    fault: dict[str, float], words: str, size: float, within: float
) -> None:
    places = ((0.0, 0.0), (60e3, -30e3), (-20e3, 70e3))
    radars = [
        Radar(
            place, range_sigma=60.0, azimuth_sigma=np.radians(0.1), scan_period=4.0 + k, name=name
        )
        for k, (place, name) in enumerate(zip(places, "abc", strict=True))
    ]
    traffic = simulate.dense_traffic(20, area=(150e3, 150e3), duration=600.0, rng=41)
    wrong = Bias(**{name: (0.0, value, 0.0) for name, value in fault.items()})
    seen = simulate.radar_plots(traffic, radars, bias=wrong, rng=42)
    findings = report.make(seen.plots, radars).summary["findings"]
    bare, whole = (
        len(np.unique(track(seen.plots, radars, registration=one).track)) for one in (False, None)
    )
    # all but .3 degrees make second tracks
    assert bare > whole or size == 0.3
    if bare > whole:
        cost = f"Without correction of the biases: {bare} tracks instead of {whole}."
        assert findings.pop() == cost
    assert {text[0] for text in findings} == {"b"}
    told = next(text for text in findings if text.startswith(f"b: {words}"))
    value, error = (float(one) for one in re.findall(r"([\d.]+) ± ([\d.]+)", told)[0])
    assert abs(value - size) < 4 * error < within


def test_bearings_with_elevations_and_of_moving_finders(tmp_path: Path) -> None:
    """Elevations are not used; places of finders in the rows cannot be."""
    rng = np.random.default_rng(7)
    places = np.array([[0, 0, 5.0], [4e3, 0, 20.0], [0, 4e3, 9.0]])
    rows = {"time_s": np.repeat(np.arange(30.0), 3), "sensor": list("abc") * 30}
    away = np.array([2e3, 2500.0]) - places[:, :2]
    azimuth = np.degrees(np.arctan2(*away.T)) + rng.normal(0, 1, (30, 3))
    table = pl.DataFrame(rows | {"azimuth_deg": azimuth.ravel(), "elevation_deg": 3.0})
    columns = dict(zip(("east_m", "north_m", "up_m"), places.T, strict=True))
    finders = {"name": list("abc"), "azimuth_sigma_deg": 1.0, "elevation_sigma_deg": 1.0}
    pl.DataFrame(finders | columns).write_csv(tmp_path / "finders.csv")
    table.write_csv(tmp_path / "bearings.csv")
    moving = {"sensor_east_m": 0.0, "sensor_north_m": 1.0, "sensor_up_m": 1.0}
    table.with_columns(**{name: pl.lit(value) for name, value in moving.items()}).write_csv(
        tmp_path / "moving.csv"
    )
    command = ("report", "--sensors", tmp_path / "finders.csv", "--output", tmp_path / "page.html")
    done = run(*command, "--bearings", tmp_path / "bearings.csv")
    assert done.code == 0, done.err
    done = run(*command, "--bearings", tmp_path / "moving.csv")
    assert done.code == 1
    assert "positions of moving direction finders, which a report cannot show" in done.err
