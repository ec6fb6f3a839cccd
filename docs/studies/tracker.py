"""Figures of docs/tracker.md, and of the pages on motion, plans and the paper's tracker."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cache
from typing import Any, get_args

import numpy as np

from studies.montecarlo import generator, normalised_squares
from studies.pages import markdown, repetitions
from tertia import simulate
from tertia._arrays import BoolArray, FloatArray, IntArray
from tertia.flightplan import FlightPlan
from tertia.tracker import (
    COLUMNS,
    AssociationName,
    CvModel,
    ImmModel,
    Motion,
    PlanModel,
    Plots,
    Radar,
    Tracker,
    TrackTable,
    WindowModel,
    track,
)

FLIGHTS = repetitions(300)
SET_UPS: tuple[simulate.SetUpName, ...] = ("en-route", "middle", "tma")
# largest wind and standard deviation of the wind, m/s
WIND = {"en-route": (50.0, 30.0), "middle": (30.0, 20.0), "tma": (15.0, 10.0)}
MODELS = {
    "en-route": ImmModel(straight_sigma=0.05, turn_sigma=1.2),
    "middle": ImmModel(straight_sigma=0.05),
    "tma": ImmModel(straight_sigma=0.05, turn_rate_walk=float(np.radians(0.25))),
}
SCENARIOS: tuple[simulate.FlightScenario, ...] = get_args(simulate.FlightScenario)
# motions, with and without flight plans
MOTIONS = ("imm with plans", "imm", "singer", "cv", "window", "window with plans")
# error of a known wind, and the wind_sigma that is given for it, m/s
WIND_ERROR, WIND_SIGMA = 5.0, 6.0
# radians: a flight that changes its course by less makes no turn of its plan
TURN = np.radians(15.0)
# flights at once, and false plots a scan among them
CROWD, CLUTTER = repetitions(60), 100.0
# seconds from flight to flight: each is tracked by itself
APART = 20_000.0


@dataclass(frozen=True)
class Recording:
    """Flights one after the other, and their plots."""

    radar: Radar
    plans: list[FlightPlan]
    traffic: simulate.Traffic
    plots: Plots
    target: IntArray


@dataclass(frozen=True)
class Errors:
    """What was found of each plot of a recording; nan where no track had it."""

    position: FloatArray
    prediction: FloatArray
    normalised: FloatArray
    turning: FloatArray
    conforming: BoolArray
    lost: BoolArray


@cache
def recording(
    set_up: simulate.SetUpName, scenario: simulate.FlightScenario, flights: int = FLIGHTS
) -> Recording:
    """Simulate flights of a scenario with the wind on."""
    scene = simulate.set_up(set_up)
    plans = simulate.routes(set_up, flights, rng=generator(110, SET_UPS.index(set_up)))
    rng = generator(111, SET_UPS.index(set_up), SCENARIOS.index(scenario))
    speed, course = rng.uniform(0, WIND[set_up][0], flights), rng.uniform(0, 2 * np.pi, flights)
    wind = np.stack([speed * np.sin(course), speed * np.cos(course)], axis=-1)
    traffic = simulate.flights(plans, scenario=scenario, wind=wind, rng=rng)
    seen = simulate.radar_plots(traffic, [scene.radar], rng=rng)
    time = seen.plots.time + APART * seen.target
    polar = seen.plots
    plots = Plots(time, polar.range, polar.azimuth, height=polar.height, identity=seen.target)
    later = [
        FlightPlan(
            plan.waypoints,
            plan.speeds,
            start_time=plan.start_time + APART * i,
            bank=plan.bank,
            turn_rate=plan.turn_rate,
            identity=i,
        )
        for i, plan in enumerate(plans)
    ]
    order = np.argsort(time)
    moved = replace(
        traffic,
        start=traffic.start + APART * np.arange(flights),
        left=traffic.left + APART * np.arange(flights),
    )
    return Recording(scene.radar, later, moved, plots[order], seen.target[order])


def at(traffic: simulate.Traffic, name: str, plots: Plots, target: IntArray) -> FloatArray:
    """Interpolate a quantity of the flights at the times of their plots."""
    values = getattr(traffic, name).astype(float)
    place = (plots.time - traffic.start[target]) / traffic.step
    low = np.clip(place.astype(int), 0, traffic.count[target] - 2)
    share = (place - low).reshape(-1, *[1] * (values.ndim - 2))
    between: FloatArray = (1 - share) * values[target, low] + share * values[target, low + 1]
    return between


def model(motion: str, set_up: simulate.SetUpName) -> Motion:
    """Return a motion with the parameters of a set-up."""
    models: dict[str, Motion] = {
        "imm": MODELS[set_up],
        "cv": CvModel(MODELS[set_up].straight_sigma),
        "singer": "singer",
        "window": "window",
    }
    return models[motion.removesuffix(" with plans")]


def errors(record: Recording, motion: str, set_up: simulate.SetUpName, **options: Any) -> Errors:
    """Track a recording, and compare with the truth."""
    found = track(
        record.plots,
        [record.radar],
        motion=model(motion, set_up),
        identity_error_probability=1e-9,
        **options,
    )
    return compared(record, found)


def compared(record: Recording, found: TrackTable) -> Errors:
    """Compare the rows with plots with the truth."""
    rows = found[(found.plot >= 0) & found.confirmed]
    n, k = len(record.plots), rows.plot
    truth = at(record.traffic, "position", record.plots, record.target)
    position, prediction = np.full((n, 2), np.nan), np.full((n, 2), np.nan)
    position[k] = rows.position - truth[k]
    plots, _ = record.plots.to_cartesian([record.radar])
    prediction[k] = plots[k] - rows.innovation - truth[k]
    columns = {name: np.full(n, np.nan) for name in ("normalised", "turning")}
    columns["normalised"][k] = normalised_squares(position[k], rows.covariance[:, :2, :2])
    columns["turning"][k] = rows.turn_probability
    conforming = np.zeros(n, dtype=bool)
    conforming[k] = rows.conforms
    numbers = [
        np.unique(found.track[(found.plot >= 0) & np.isin(found.plot, np.flatnonzero(of))])
        for of in (record.target == f for f in np.unique(record.target))
    ]
    lost = np.array([len(of) != 1 for of in numbers])
    return Errors(position, prediction, **columns, conforming=conforming, lost=lost)


def rms(error: FloatArray, which: BoolArray) -> float:
    """Root mean square length of the errors that are there."""
    kept = error[which & np.isfinite(error[:, 0])]
    return float(np.sqrt(np.mean(np.sum(kept**2, axis=-1))))


def ratio(one: Errors, other: Errors, name: str, which: BoolArray) -> float:
    """Ratio of two trackers' errors of the same plots."""
    a, b = getattr(one, name), getattr(other, name)
    both = which & np.isfinite(a[:, 0]) & np.isfinite(b[:, 0])
    return rms(a, both) / rms(b, both)


@cache
def outcome(
    set_up: simulate.SetUpName,
    scenario: simulate.FlightScenario,
    prior: float = 0.8,
    flights: int = FLIGHTS,
) -> dict[str, float]:
    """Compare the tracker with plans and the one without on the same plots."""
    record = recording(set_up, scenario, flights)
    plain = errors(record, "imm", set_up)
    aided = errors(
        record,
        "imm",
        set_up,
        plans=record.plans,
        plan_model=PlanModel(prior, wind_sigma=WIND[set_up][1]),
    )
    found = compared_both(record, plain, aided)
    if "after" in found:
        found["blocked"] = block_delay(record, aided)
    else:
        found["wrongly"] = blocked_wrongly(record, aided)
    return found


def compared_both(record: Recording, plain: Errors, aided: Errors) -> dict[str, float]:
    """Compare the errors of a tracker with plans and of one without on the same plots."""
    kept = ~(plain.lost | aided.lost)[record.target]
    turning = kept & (at(record.traffic, "turning", record.plots, record.target) > 0.5)
    left = record.traffic.left[record.target]
    after = kept & (record.plots.time > left)
    found = {
        "turn": ratio(aided, plain, "position", turning),
        "prediction": ratio(aided, plain, "prediction", turning),
        "whole": ratio(aided, plain, "position", kept),
        "lost": float(np.mean(aided.lost)),
        "plain lost": float(np.mean(plain.lost)),
        "nees": float(np.nanmean(aided.normalised[kept])) / 2,
        "plain nees": float(np.nanmean(plain.normalised[kept])) / 2,
    }
    if after.any():
        soon = after & (record.plots.time < left + 120.0)
        found["after"] = ratio(aided, plain, "position", after)
        found["soon"] = ratio(aided, plain, "position", soon)
    return found


def block_delay(record: Recording, found: Errors) -> float:
    """Median time from leaving the plan until it was blocked."""
    delays = []
    for f in np.flatnonzero(np.isfinite(record.traffic.left)):
        of = (record.target == f) & (record.plots.time > record.traffic.left[f])
        blocked = record.plots.time[of & ~found.conforming & np.isfinite(found.turning)]
        delays.append(blocked[0] - record.traffic.left[f] if len(blocked) else np.inf)
    return float(np.median(delays))


def blocked_wrongly(record: Recording, found: Errors) -> float:
    """Share of flights that follow their plans, and whose plan was blocked once."""
    traffic, time, target = record.traffic, record.plots.time, record.target
    first = np.full(len(record.plans), np.inf)
    np.minimum.at(first, target[found.conforming], time[found.conforming])
    # at its end no plan is believed
    end = traffic.start + traffic.step * (traffic.count - 1) - 3 * record.radar.scan_period
    during = (time > first[target]) & (time < end[target]) & np.isfinite(found.turning)
    return len(np.unique(target[during & ~found.conforming])) / len(record.plans)


def delay(record: Recording, found: Errors) -> float:
    """Mean time from the first plot of a turn until it was flagged; if never, all of the turn."""
    turning = at(record.traffic, "turning", record.plots, record.target) > 0.5
    course = np.arctan2(*at(record.traffic, "velocity", record.plots, record.target).T)
    if not np.any(found.turning > 0.5):
        return np.inf
    delays = []
    for f in range(len(record.plans)):
        of = np.flatnonzero(record.target == f)
        time, flags = record.plots.time[of], found.turning[of] > 0.5
        ends = np.flatnonzero(np.diff(turning[of].astype(int))) + 1
        for k, end in zip(ends[::2], ends[1::2], strict=False):
            turned = np.angle(np.exp(1j * (course[of[end]] - course[of[k - 1]])))
            if abs(turned) > TURN:
                flagged = np.flatnonzero(flags[k:end])
                delays.append(time[k + flagged[0] if len(flagged) else end] - time[k])
    return float(np.mean(delays))


def flagged(seconds: float) -> str:
    """Format a delay; a model without turns flags none."""
    return f"{seconds:.1f} s" if np.isfinite(seconds) else "–"


def peak(record: Recording, found: Errors, kept: BoolArray) -> float:
    """Mean over flights of the largest error in a turn."""
    size = np.hypot(*found.position.T)
    largest = [np.nanmax(size[kept & (record.target == f)], initial=0.0) for f in range(FLIGHTS)]
    return float(np.mean([value for value in largest if value > 0]))


def two_minutes(set_up: simulate.SetUpName, flights: int = repetitions(60)) -> tuple[float, float]:
    """Return errors of predictions over 120 s, along plans and straight on."""
    record = recording(set_up, "conforming", flights)
    tracker = Tracker(
        [record.radar],
        motion=MODELS[set_up],
        plans=record.plans,
        identity_error_probability=1e-9,
    )
    along, straight = [], []
    for k in range(len(record.plots)):
        rows = tracker.update(record.plots[[k]])
        flight, time = record.target[[k]], record.plots.time[[k]] + 120.0
        last = record.traffic.start[flight] + record.traffic.step * record.traffic.count[flight]
        numbers, positions = tracker.extrapolate(120.0)
        here = rows[rows.plot == k]
        if not len(here) or time[0] > last[0] - record.traffic.step:
            continue
        later = Plots(time, [1.0], [0.0])
        truth = at(record.traffic, "position", later, flight)[0]
        along.append(positions[numbers == here.track[0]][0] - truth)
        straight.append(here.position[0] + 120.0 * here.velocity[0] - truth)
    one, other = np.array(along), np.array(straight)
    everything = np.ones(len(one), dtype=bool)
    return rms(one, everything), rms(other, everything)


def columns() -> str:
    """Tabulate the columns of a table of tracks."""
    rows = []
    for column in COLUMNS:
        shape = "".join(f", {n}" for n in column.shape)
        rows.append(
            [f"`{column.name}`", column.type, f"(N{shape or ','})", column.unit, column.doc]
        )
    return markdown(["column", "type", "shape", "unit", "meaning"], rows)


def conforming() -> str:
    """Tabulate trackers of flights that follow their plans."""
    rows = []
    for set_up in SET_UPS:
        record = recording(set_up, "conforming")
        plain = errors(record, "imm", set_up)
        turning = at(record.traffic, "turning", record.plots, record.target) > 0.5
        kind = {"plans": record.plans, "plan_model": PlanModel(wind_sigma=WIND[set_up][1])}
        for motion in MOTIONS:
            found = errors(record, motion, set_up, **(kind if motion.endswith("plans") else {}))
            kept = ~(plain.lost | found.lost)[record.target]
            straight = kept & ~turning
            highest = peak(record, plain, kept & turning)
            rows.append(
                [
                    f"{set_up}, {motion}",
                    f"{rms(found.position, kept & turning):.0f}",
                    f"{ratio(found, plain, 'position', kept & turning):.2f}",
                    f"{ratio(found, plain, 'prediction', kept & turning):.2f}",
                    f"{ratio(found, plain, 'position', kept):.2f}",
                    f"{peak(record, found, kept & turning) / highest:.2f}",
                    flagged(delay(record, found)),
                    f"{np.nanmean(found.turning[straight] > 0.5):.1%}",
                    f"{np.nanmean(found.normalised[kept]) / 2:.2f}",
                    f"{np.mean(found.lost):.1%}",
                ]
            )
    head = ["", "turns, m", "turns", "prediction in turns", "whole", "peak", "flag after"]
    return markdown([*head, "false flags", "NEES per axis", "lost"], rows)


def extrapolation() -> str:
    """Tabulate predictions over two minutes."""
    rows = []
    for set_up in SET_UPS:
        along, straight = two_minutes(set_up)
        rows.append([set_up, f"{straight:.0f}", f"{along:.0f}", f"{along / straight:.2f}"])
    return markdown(
        ["prediction over 120 s, RMSE in m", "straight on", "along the plan", "ratio"], rows
    )


def plans() -> str:
    """Tabulate what plans do in every scenario, per set-up."""
    rows = []
    for scenario in SCENARIOS:
        cells = []
        for name in (
            "turn",
            "prediction",
            "whole",
            "after",
            "soon",
            "blocked",
            "wrongly",
            "lost",
            "plain lost",
        ):
            values = [outcome(set_up, scenario).get(name) for set_up in SET_UPS]
            styles = {"blocked": "{:.0f} s", "wrongly": "{:.1%}"}
            style = "{:.1%}" if "lost" in name else styles.get(name, "{:.2f}")
            cells.append(" / ".join("–" if v is None else style.format(v) for v in values))
        rows.append([scenario, *cells])
    head = [
        "",
        "turns",
        "prediction in turns",
        "whole",
        "after leaving",
        "first 120 s",
        "blocked after",
        "blocked wrongly",
    ]
    return markdown([*head, "lost", "lost without"], rows)


@cache
def windows(set_up: simulate.SetUpName, scenario: simulate.FlightScenario) -> dict[str, float]:
    """Compare the window along plans and the one without on the same plots."""
    record = recording(set_up, scenario)
    plain = errors(record, "window", set_up)
    aided = errors(record, "window", set_up, plans=record.plans)
    return compared_both(record, plain, aided)


def paper() -> str:
    """Tabulate what plans do to the window in every scenario, per set-up."""
    styles = {"turn": ".2f", "prediction": ".2f", "whole": ".2f", "after": ".2f"}
    styles |= {"nees": ".2f", "plain nees": ".2f", "lost": ".1%", "plain lost": ".1%"}
    rows = []
    for scenario in SCENARIOS:
        cells = []
        for name, style in styles.items():
            values = [windows(set_up, scenario).get(name) for set_up in SET_UPS]
            cells.append(" / ".join("–" if v is None else format(v, style) for v in values))
        rows.append([scenario, *cells])
    head = ["", "turns", "prediction in turns", "whole", "after leaving", "NEES", "NEES without"]
    return markdown([*head, "lost", "lost without"], rows)


def guards() -> str:
    """Tabulate what the guard acceleration of the window does, alike in all set-ups."""
    rows = []
    for acceleration in (5.0, 7.0, 9.0, 12.0, None):
        cells = []
        for set_up in SET_UPS:
            record = recording(set_up, "conforming")
            turning = at(record.traffic, "turning", record.plots, record.target) > 0.5
            found = errors(record, "window", set_up, guard_acceleration=acceleration)
            missed = np.isnan(found.position[turning, 0])
            cells.append(f"{np.mean(found.lost):.1%}, {np.mean(missed):.1%}")
        rows.append(
            ["12 to 7, by the scan" if acceleration is None else f"{acceleration:.0f}", *cells]
        )
    return markdown(["guard acceleration, m/s²", *SET_UPS], rows)


def flags() -> str:
    """Tabulate how often straight flight is flagged: soon after turns, and long after them."""
    rows = []
    for set_up in SET_UPS:
        record = recording(set_up, "conforming")
        turning = at(record.traffic, "turning", record.plots, record.target) > 0.5
        since = np.full(len(turning), np.inf)
        for f in range(len(record.plans)):
            of = np.flatnonzero(record.target == f)
            last = np.maximum.accumulate(np.where(turning[of], record.plots.time[of], -np.inf))
            since[of] = record.plots.time[of] - last
        cells = []
        for plans in ([], record.plans):
            found = errors(record, "window", set_up, plans=plans)
            for which in (since <= 120.0, since > 120.0):
                flagged_now = found.turning[which & ~turning] > 0.5
                known = np.isfinite(found.turning[which & ~turning])
                cells.append(f"{np.mean(flagged_now[known]):.1%}")
        rows.append([set_up, *cells])
    head = ["", "window, 120 s after a turn", "later"]
    return markdown([*head, "window with plans, 120 s after a turn", "later"], rows)


def in_known_wind(record: Recording, set_up: simulate.SetUpName) -> Errors:
    """Track each flight separately, with its wind known except for an error."""
    rng = generator(112, SET_UPS.index(set_up))
    winds = record.traffic.wind + rng.normal(0.0, WIND_ERROR, record.traffic.wind.shape)
    parts, order = [], []
    for f, plan in enumerate(record.plans):
        of = np.flatnonzero(record.target == f)
        one = replace(record, plans=[plan], plots=record.plots[of], target=record.target[of])
        air = PlanModel(wind=winds[f], wind_sigma=WIND_SIGMA)
        parts.append(errors(one, "imm", set_up, plans=one.plans, plan_model=air))
        order.append(of)
    back = np.argsort(np.concatenate(order))
    columns = {
        field.name: [getattr(part, field.name) for part in parts] for field in fields(Errors)
    }
    lost = np.concatenate(columns.pop("lost"))
    return Errors(**{name: np.concatenate(c)[back] for name, c in columns.items()}, lost=lost)


def wind() -> str:
    """Tabulate what the wind adds where it is known, on flights that follow their plans."""
    rows = []
    for set_up in SET_UPS:
        for scenario in SCENARIOS[:2]:
            record = recording(set_up, scenario)
            plain, found = errors(record, "imm", set_up), in_known_wind(record, set_up)
            kept = ~(plain.lost | found.lost)[record.target]
            turning = at(record.traffic, "turning", record.plots, record.target) > 0.5
            unknown, turns = outcome(set_up, scenario), kept & turning
            known = (ratio(found, plain, name, turns) for name in ("position", "prediction"))
            ratios = (unknown["turn"], unknown["prediction"], *known)
            rows.append(
                [
                    f"{set_up}, {scenario}",
                    *(f"{value:.2f}" for value in ratios),
                    f"{np.mean(found.lost):.1%}",
                ]
            )
    head = ["", "turns", "prediction in turns", "turns, wind known", "prediction, wind known"]
    return markdown([*head, "lost"], rows)


@cache
def crowd(set_up: simulate.SetUpName, clutter: float) -> simulate.RadarPlots:
    """Simulate sixty flights at once, without identities and heights."""
    plans = simulate.routes(set_up, CROWD, rng=generator(113, SET_UPS.index(set_up)))
    rng = generator(114, SET_UPS.index(set_up))
    traffic = simulate.flights(plans, wind=WIND[set_up][0] / 2, rng=rng)
    return simulate.radar_plots(
        traffic,
        [simulate.set_up(set_up).radar],
        clutter=clutter,
        height_missing_probability=1.0,
        identity_missing_probability=1.0,
        rng=rng,
    )


def associations() -> str:
    """Tabulate plots that went astray, flights that were lost and false tracks in clutter."""
    rows = []
    rules: list[tuple[str, AssociationName]] = [(motion, "gnn") for motion in MOTIONS]
    for motion, rule in [*rules, ("window", "paper")]:
        cells = []
        for set_up in SET_UPS:
            seen = crowd(set_up, CLUTTER)
            plans = simulate.routes(set_up, CROWD, rng=generator(113, SET_UPS.index(set_up)))
            found = track(
                seen.plots,
                [simulate.set_up(set_up).radar],
                motion=model(motion, set_up),
                association=rule,
                plans=plans if motion.endswith("plans") else [],
            )
            rows_with_plots = found[(found.plot >= 0) & found.confirmed]
            target = seen.target[rows_with_plots.plot]
            owner = {
                number: int(np.bincount(target[rows_with_plots.track == number] + 1).argmax()) - 1
                for number in np.unique(rows_with_plots.track)
            }
            own = np.array([owner[number] for number in rows_with_plots.track])
            held = np.array([k for k in owner.values() if k >= 0])
            lost = np.mean([np.count_nonzero(held == k) != 1 for k in range(CROWD)])
            cells.append(f"{np.mean(target != own):.2%}, {lost:.1%}, {len(owner) - len(held)}")
        name = motion if rule == "gnn" else f"{motion}, score of the paper"
        rows.append([name, *cells])
    return markdown(["wrong plots, flights lost, false tracks", *SET_UPS], rows)


@cache
def windows_of(set_up: simulate.SetUpName, plots: int, degree: int) -> Errors:
    """Track with the paper's window that keeps so many plots after a detection."""
    record = recording(set_up, "conforming")
    motion = WindowModel(degree=degree, after_turn=plots)
    return compared(
        record, track(record.plots, [record.radar], motion=motion, identity_error_probability=1e-9)
    )


def degrees() -> str:
    """Tabulate the paper's window with a quadratic after a detection, against the line."""
    rows = []
    for plots, degree in ((3, 1), (5, 2), (6, 2), (7, 2), (8, 2)):
        cells: list[list[str]] = [[] for _ in range(6)]
        for set_up in SET_UPS:
            record = recording(set_up, "conforming")
            found, line = windows_of(set_up, plots, degree), windows_of(set_up, 3, 1)
            turning = at(record.traffic, "turning", record.plots, record.target) > 0.5
            ratios = (
                ratio(found, line, "position", turning),
                ratio(found, line, "prediction", turning),
                peak(record, found, turning) / peak(record, line, turning),
                ratio(found, line, "position", ~turning),
                np.nanmean(found.normalised) / 2,
            )
            flagged_now = found.turning[~turning & np.isfinite(found.turning)] > 0.5
            for cell, value in zip(cells, ratios, strict=False):
                cell.append(f"{value:.2f}")
            cells[-1].append(f"{np.mean(flagged_now):.0%}")
        rows.append([f"{plots}, degree {degree}", *map(" / ".join, cells)])
    head = ["plots", "turns", "prediction in turns", "peak", "straight", "NEES per axis"]
    return markdown([*head, "flag on straight"], rows)


def priors() -> str:
    """Tabulate what the prior costs where a turn is not flown, and gains where it is."""
    rows = []
    for prior in (0.2, 0.4, 0.6, 0.8):
        cells = []
        for set_up in SET_UPS:
            flown, not_flown = (
                outcome(set_up, scenario, prior, repetitions(150, 3))
                for scenario in SCENARIOS[:7:6]
            )
            ratios = (flown["turn"], not_flown["after"], not_flown["soon"])
            cells.append(" / ".join(f"{value:.2f}" for value in ratios))
        rows.append([f"{prior:.1f}", *cells])
    return markdown(["flown_probability", *SET_UPS], rows)
