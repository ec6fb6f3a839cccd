"""All that is told of a recording: tracks, radars, fusion, the truth, plans, emitters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tertia import metrics
from tertia._arrays import FloatArray, IntArray
from tertia.flightplan import FlightPlan
from tertia.metrics import Truth
from tertia.metrics._evaluation import MOST_NEES, Judged, judge, usual_periods
from tertia.report._bearings import Emitter, Heard, hear
from tertia.report._plans import Followed, followed
from tertia.report._radars import (
    Biases,
    Innovations,
    Noise,
    Updates,
    biases,
    corrected,
    innovations,
    noise,
    stretches,
    updates,
)
from tertia.report._tracks import (
    Combined,
    Common,
    Run,
    alone,
    combine,
    common,
    confirmed_rows,
)
from tertia.sensors import Radar, Station
from tertia.tracker import Plots, TrackTable

Progress = Callable[[str, float], None]

TOGETHER, FOUND = "all radars together", "all radars, noise as found"
OPTIMAL, OPTIMAL_FOUND = "tracks fused, as stated", "tracks fused, as found"
INTERSECTION = "covariance intersection, as found"


@dataclass(frozen=True, slots=True, eq=False)
class Fusion:
    """Tracks of single radars fused at common instants, in several ways, by name."""

    told: Common
    found: Common
    ways: dict[str, Combined]
    states: dict[str, tuple[FloatArray, FloatArray]]
    error: dict[str, FloatArray]
    nees: dict[str, FloatArray]


@dataclass(frozen=True, slots=True, eq=False)
class Analysis:
    """A recording, and all that is told of it."""

    plots: Plots
    radars: Sequence[Radar]
    names: list[str]
    plans: Sequence[FlightPlan]
    truth: Truth | None
    edges: FloatArray
    joint: TrackTable
    joint_found: TrackTable
    single: list[TrackTable]
    noise: list[Noise]
    innovations: list[Innovations]
    updates: list[Updates]
    biases: Biases
    fusion: Fusion | None
    judged: dict[str, Judged]
    period: float
    followed: list[Followed]
    heard: list[Heard]
    stations: Sequence[Station]


def analyse(
    plots: Plots,
    radars: Sequence[Radar],
    run: Run,
    *,
    plans: Sequence[FlightPlan],
    truth: Truth | None,
    stations: Sequence[Station],
    emitters: Sequence[Emitter],
    distance: float,
    period: float | None,
    progress: Progress,
) -> Analysis:
    """Track, fuse and judge a recording."""
    steps = iter(np.linspace(0.0, 1.0, len(radars) + 7))

    def tell(what: str) -> None:
        progress(what, float(next(steps)))

    names = [str(k + 1) if radar.name is None else radar.name for k, radar in enumerate(radars)]
    tell("tracks of all radars")
    joint = run(plots, radars)
    known = plots.time[np.isfinite(plots.time)]
    slowest = max(radar.scan_period for radar in radars)
    edges = stretches(known, slowest) if len(known) else np.array([0.0, 1.0])
    found = []
    for k, name in enumerate(names):
        tell(f"noise of {name}")
        found.append(noise(plots, radars, k, run, edges))
    tell("tracks of single radars")
    several = len(radars) > 1
    single = [alone(plots, radars, k, run) for k in range(len(radars))] if several else [joint]
    joint_found = run(plots, [one.radar for one in found])
    tell("fusion")
    fused = told = None
    shift = Biases(*np.full((2, len(radars), 2), np.nan))
    if several:
        told = common(joint, single, radars)
    if told is not None and len(told.time):
        better = common(joint, [one.table for one in found], radars)
        shift = biases(told, radars)
        fused = _fuse(told, corrected(better, found, shift))
    tell("plots")
    seen = [innovations(joint, k) for k in range(len(radars))]
    counts = [updates(joint, plots, k, seen[k], edges) for k in range(len(radars))]
    tell("plans")
    plan_rows = followed(joint, plans, slowest)
    tell("truth")
    sets = {TOGETHER: joint, FOUND: joint_found}
    if several:
        sets |= dict(zip(names, single, strict=True))
    judged: dict[str, Judged] = {}
    required = period or slowest
    if truth is not None:
        judged, required = _judge_all(sets, truth, distance, period)
        if fused is not None and TOGETHER in judged:
            fused = _judge_fusion(fused, truth, judged[TOGETHER])
    tell("direction finders")
    heard = [hear(emitter, stations) for emitter in emitters]
    return Analysis(
        plots=plots,
        radars=radars,
        names=names,
        plans=plans,
        truth=truth,
        edges=edges,
        joint=joint,
        joint_found=joint_found,
        single=single,
        noise=found,
        innovations=seen,
        updates=counts,
        biases=shift,
        fusion=fused,
        judged=judged,
        period=required,
        followed=plan_rows,
        heard=heard,
        stations=stations,
    )


def _fuse(told: Common, better: Common) -> Fusion:
    """Fuse at the instants at which the radars have tracks, whichever noise is believed."""
    keys = [set(zip(one.track.tolist(), one.time.tolist(), strict=True)) for one in (told, better)]
    both = keys[0] & keys[1]
    told, better = (
        one.chosen(
            np.array(
                [key in both for key in zip(one.track.tolist(), one.time.tolist(), strict=True)],
                dtype=bool,
            )
        )
        for one in (told, better)
    )
    ways = {
        OPTIMAL: combine(told, "matrix"),
        OPTIMAL_FOUND: combine(better, "matrix"),
        INTERSECTION: combine(better, "covariance-intersection"),
    }
    states = {name: (one.state, one.covariance) for name, one in ways.items()}
    states[TOGETHER] = told.joint_state, told.joint_covariance
    return Fusion(told, better, ways, states, {}, {})


def _judge_all(
    sets: dict[str, TrackTable], truth: Truth, distance: float, period: float | None
) -> tuple[dict[str, Judged], float]:
    """Judge all sets of tracks by the same period."""
    rows = {name: confirmed_rows(table) for name, table in sets.items()}
    rows = {name: one for name, one in rows.items() if np.any(one.updated)}
    usual = usual_periods(rows[TOGETHER]) if TOGETHER in rows else []
    if not usual:
        return {}, period or 1.0
    required = usual[0] if period is None else period
    periods = required, max([required, *usual])
    return {name: judge(one, truth, periods, distance) for name, one in rows.items()}, required


def _judge_fusion(fused: Fusion, truth: Truth, joint: Judged) -> Fusion:
    """Compare the states with those of the targets that the joint tracks show."""
    tracks = joint.rows.track[joint.rows.updated]
    target = _shown(tracks, joint.told.matching.target, fused.told.track)
    places = truth.at(target, fused.told.time)[:, :2]
    states = dict(fused.states)
    states |= {
        f"#{k}": (fused.told.state[:, k], fused.told.covariance[:, k])
        for k in range(fused.told.state.shape[1])
    }
    error = {name: state[:, :2] - places for name, (state, _) in states.items()}
    nees = {
        name: np.asarray(metrics.nees(error[name], spread[:, :2, :2]))
        for name, (_, spread) in states.items()
    }
    return Fusion(fused.told, fused.found, fused.ways, fused.states, error, nees)


def _shown(track: IntArray, target: IntArray, wanted: IntArray) -> IntArray:
    """Return which target a track shows most often, -1 where it shows none."""
    found = np.full(len(wanted), -1)
    for number in np.unique(wanted):
        own = target[(track == number) & (target >= 0)]
        if len(own):
            found[wanted == number] = int(np.argmax(np.bincount(own)))
    return found


def mean_nees(
    time: FloatArray, nees: FloatArray, edges: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return normalised errors per axis in stretches of time, and how many there are."""
    known = np.isfinite(nees)
    which = np.clip(np.searchsorted(edges, time[known], side="right") - 1, 0, len(edges) - 2)
    count = np.bincount(which, minlength=len(edges) - 1)
    total = np.bincount(which, nees[known] / 2, minlength=len(edges) - 1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan), count.astype(np.float64)


def within(nees: FloatArray) -> float:
    """Return the share of errors within the 95 % ellipse, nan of none."""
    known = nees[np.isfinite(nees)]
    return float(np.mean(known <= MOST_NEES)) if len(known) else np.nan
