"""`tertia track --stream --control`: plans that change while plots come."""

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from terminal import succeed

from tertia.flightplan import FlightPlan
from tertia.tracker import Plots, Radar, Tracker

SITE = """name,east_m,north_m,range_sigma_m,azimuth_sigma_deg,scan_period_s
west,0,0,50,0.08,4
"""
RADAR = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0, name="west")
WAY = [[-30e3, 40e3], [0.0, 40e3], [0.0, 90e3]]
OTHER = [[-30e3, 60e3], [40e3, 60e3]]
PLAN = {"name": "ABC123", "waypoints": WAY, "speeds_m_s": 150.0}


def seen(count: int = 60) -> list[dict[str, float]]:
    """Return the plots of a flight along the plan."""
    time = 4.0 * np.arange(count)
    position, _ = FlightPlan(WAY, 150.0).at(time)
    random = np.random.default_rng(5)
    distance = np.hypot(*position.T) + 50.0 * random.standard_normal(count)
    azimuth = np.degrees(np.arctan2(*position.T)) + 0.08 * random.standard_normal(count)
    rows = zip(time.tolist(), distance.tolist(), azimuth.tolist(), strict=True)
    return [{"time_s": t, "range_m": r, "azimuth_deg": a} for t, r, a in rows]


def told(lines: list[str], tmp_path: Path, *arguments: str) -> tuple[pl.DataFrame, list[Any], str]:
    """Return the rows, the answers, and all of stderr."""
    site, plots = tmp_path / "radar.csv", tmp_path / "plots.txt"
    site.write_text(SITE, encoding="utf-8")
    plots.write_text("\n".join(lines), encoding="utf-8")
    given = ("--sensors", site, "--rows", "csv", *arguments)
    _, out, err = succeed("track", plots, "--stream", *given)
    answers = [json.loads(line) for line in err.splitlines() if line.startswith("{")]
    return pl.read_csv(io.StringIO(out)), answers, err


def ordered(requests: dict[int, dict[str, Any]]) -> list[str]:
    """Return lines of plots, with requests before some of them."""
    lines = []
    for at, row in enumerate(seen()):
        lines += [json.dumps(requests[at])] if at in requests else []
        lines.append(json.dumps(row))
    return lines


def test_control_lines_do_what_the_methods_do(tmp_path: Path) -> None:
    requests: dict[int, dict[str, Any]] = {
        0: {"control": "add_plan", "name": "WRONG", "waypoints": OTHER, "speeds_m_s": 150},
        8: {"control": "add_plan", **PLAN},
        20: {"control": "suspend_plan", "track": 1},
        24: {"control": "resume_plan", "track": 1},
        34: {"control": "decorrelate", "track": 1},
        38: {"control": "correlate", "track": 1, "plan": "WRONG"},
        44: {"control": "replace_plan", **PLAN, "waypoints": WAY[:2]},
        48: {"control": "remove_plan", "name": "WRONG"},
    }
    rows, answers, _ = told(ordered(requests), tmp_path, "--control", "--latency", "0")
    names = [request["control"] for request in requests.values()]
    assert answers == [{"control": name, "ok": True, "reason": None} for name in names]

    tracker = Tracker([RADAR])
    plan = FlightPlan(WAY, 150.0, name="ABC123")
    calls = {
        0: lambda: tracker.add_plan(FlightPlan(OTHER, 150.0, name="WRONG")),
        8: lambda: tracker.add_plan(plan),
        20: lambda: tracker.suspend_plan(1),
        24: lambda: tracker.resume_plan(1),
        34: lambda: tracker.decorrelate(1),
        38: lambda: tracker.correlate(1, 0),
        44: lambda: tracker.replace_plan(1, FlightPlan(WAY[:2], 150.0, name="ABC123")),
        48: lambda: tracker.remove_plan(0),
    }
    plans: list[str | None] = []
    places: list[float] = []
    for at, row in enumerate(seen()):
        if at in calls:
            calls[at]()
        table = tracker.update(
            Plots([row["time_s"]], [row["range_m"]], np.radians([row["azimuth_deg"]]))
        )
        plans += [None if k < 0 else ("WRONG", "ABC123")[k] for k in table.plan]
        places += table.position[:, 0].tolist()
    assert {"WRONG", "ABC123", None} == set(plans)
    assert rows["plan"].to_list() == plans
    np.testing.assert_allclose(rows["east_m"], places, rtol=0, atol=1e-6)


def test_control_lines_in_csv(tmp_path: Path) -> None:
    rows = seen()
    lines = ["time_s,range_m,azimuth_deg", *(",".join(map(str, row.values())) for row in rows)]
    # before the header, too
    lines.insert(0, f"#control {json.dumps({'control': 'add_plan', **PLAN})}")
    found, answers, text = told(lines, tmp_path, "--control")
    assert answers == [{"control": "add_plan", "ok": True, "reason": None}]
    assert found["plan"].to_list()[-1] == "ABC123"
    assert "left out" not in text


@pytest.mark.parametrize(
    ("request_", "reason"),
    [
        ({"control": "add_plan", **PLAN}, "name is 'ABC123'; a plan with this name already exists"),
        ({"control": "add_plan", "waypoints": WAY}, "name is None"),
        ({"control": "add_plan", "name": "A"}, "it has no waypoints"),
        ({"control": "add_plan", "name": "A", "waypoints": [[0, 0]]}, "two or more waypoints"),
        ({"control": "add_plan", "name": "A", "waypoints": WAY, "speeds_m_s": "x"}, "speeds"),
        ({"control": "remove_plan", "name": "NONE"}, "it must be the name of a plan"),
        ({"control": "correlate", "track": 1, "plan": "NONE"}, "it must be the name of a plan"),
        ({"control": "correlate", "plan": "ABC123"}, "track is missing"),
        ({"control": "suspend_plan", "track": 99}, "there is no confirmed track"),
        ({"control": "suspend_plan", "track": "one"}, "must be an integer"),
        ({"control": "fly"}, "control is 'fly'; it must be add_plan or"),
        ({"control": ["fly"]}, "it must be add_plan or"),
        ({"control": "add_plan", **PLAN, "name": "B", "identity": 1e400}, ""),
    ],
)
def test_requests_that_are_refused_change_nothing(
    request_: dict[str, Any], reason: str, tmp_path: Path
) -> None:
    good = {"control": "add_plan", **PLAN}
    rows, answers, _ = told(ordered({0: good, 30: request_}), tmp_path, "--control")
    assert [answer["ok"] for answer in answers] == [True, False]
    assert answers[1]["control"] == request_["control"]
    assert reason in answers[1]["reason"]
    assert rows["plan"].to_list()[-1] == "ABC123"


def test_without_the_option_control_lines_are_bad_lines(tmp_path: Path) -> None:
    rows, answers, text = told(ordered({3: {"control": "add_plan", **PLAN}}), tmp_path)
    assert not answers
    assert "1 of 61 lines left out" in text
    assert rows["plan"].null_count() == rows.height


@pytest.mark.parametrize("deep", ['{"control": ' + 200_000 * "[", '{"control": "\\ud800"}'])
def test_what_is_no_request(deep: str, tmp_path: Path) -> None:
    lines = [*ordered({0: {"control": "add_plan", **PLAN}}), deep]
    _, answers, _ = told(lines, tmp_path, "--control")
    assert [answer["ok"] for answer in answers] == [True, False]
    assert answers[1]["control"] is None
