"""Analysis of a recording for the page: its tracks, radars, fusion, truth and plans."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tertia import fusion, metrics
from tertia._arrays import FloatArray, IntArray
from tertia.flightplan import FlightPlan
from tertia.metrics import Audit, Truth
from tertia.metrics._evaluation import MOST_NEES, Judged, Rows, judge, usual_periods
from tertia.registration import Registration
from tertia.registration._register import corrected, rounds
from tertia.registration._states import Run, States, common_states
from tertia.report._plans import Followed, followed
from tertia.report._radars import Innovations, Updates, innovations, updates
from tertia.report._reference import Referenced, versus_others
from tertia.sensors import Radar
from tertia.sensors._identities import NUMBERS, leading
from tertia.tracker import Motion, Plots, TrackTable
from tertia.tracker._errors import in_periods

Progress = Callable[[str, float], None]

TOGETHER, FOUND = "all radars together", "all radars, estimated noise"
UNCORRECTED = "all radars, not corrected"
OPTIMAL, OPTIMAL_FOUND = "tracks fused, stated noise", "tracks fused, estimated noise"
INTERSECTION = "covariance intersection, estimated noise"


@dataclass(frozen=True, slots=True, eq=False)
class Combined:
    """Fused tracks of single radars; `weight` has the weights of K radars in position, (M, K)."""

    state: FloatArray
    covariance: FloatArray
    weight: FloatArray
    pvalue: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Fusion:
    """Tracks of single radars that are fused at common instants; `ways` has each method by name."""

    stated: States
    found: States
    ways: dict[str, Combined]
    states: dict[str, tuple[FloatArray, FloatArray]]
    error: dict[str, FloatArray]
    nees: dict[str, FloatArray]


@dataclass(frozen=True, slots=True, eq=False)
class Analysis:
    """A recording and the results of its analysis.

    `joint` has the tracks from the plots of all radars, and `uncorrected` those made without
    subtracting systematic errors.
    """

    plots: Plots
    radars: Sequence[Radar]
    names: list[str]
    plans: Sequence[FlightPlan]
    truth: Truth | None
    joint: TrackTable
    uncorrected: TrackTable
    single: list[TrackTable]
    registration: Registration
    innovations: list[Innovations]
    updates: list[Updates]
    fusion: Fusion | None
    references: list[Referenced]
    judged: dict[str, Judged]
    audits: dict[str, Audit]
    update_interval: float
    limits: Mapping[str, float]
    followed: list[Followed]

    @property
    def is_corrected(self) -> bool:
        """Whether systematic errors are subtracted in the joint tracks."""
        return self.joint is not self.uncorrected

    @property
    def edges(self) -> FloatArray:
        """Times in seconds at which the periods begin and end, (T + 1,)."""
        return self.registration.noise_history.edges

    @property
    def middle(self) -> FloatArray:
        """Times in seconds of the middles of the periods, (T,)."""
        return (self.edges[:-1] + self.edges[1:]) / 2


def analyse(
    plots: Plots,
    radars: Sequence[Radar],
    run: Run,
    together: Run,
    *,
    motion: Motion,
    plans: Sequence[FlightPlan],
    truth: Truth | None,
    max_distance: float,
    update_interval: float | None,
    limits: Mapping[str, float],
    progress: Progress,
) -> Analysis:
    """Track the plots of a recording, register the radars, and fuse and evaluate the tracks.

    `run` makes tracks without subtracting systematic errors, and `together` makes the tracks from
    the plots of all radars.
    """
    steps = iter(np.linspace(0.0, 1.0, 7))

    def begin(what: str) -> None:
        progress(what, float(next(steps)))

    names = [str(k + 1) if radar.name is None else radar.name for k, radar in enumerate(radars)]
    begin("tracks of all radars")
    joint = together(plots, radars)
    uncorrected = joint if together is run else run(plots, radars)
    begin("registration")
    # not from the tracks with stated errors: if a radar has a bias, they contain only those of its
    # plots that are in the gates, so that the bias would be underestimated
    made = rounds(plots, radars, run)
    registration = made.registration
    joint_found = run(*registration._removed(plots))
    begin("fusion")
    fused = None
    stated = common_states(joint, made.stated, radars)
    if len(stated.time):
        better = common_states(joint, made.found, radars)
        fused = _fuse(stated, corrected(better, registration, radars))
    begin("plots")
    seen = [innovations(joint, k) for k in range(len(radars))]
    counts = [
        updates(joint, plots, k, seen[k], registration.noise_history.edges)
        for k in range(len(radars))
    ]
    begin("plans")
    slowest = max(radar.scan_period for radar in radars)
    plan_rows = followed(joint, plans, slowest)
    begin("truth")
    sets = {TOGETHER: joint, FOUND: joint_found}
    if len(radars) > 1:
        sets |= {} if uncorrected is joint else {UNCORRECTED: uncorrected}
        sets |= dict(zip(names, made.stated, strict=True))
    judged: dict[str, Judged] = {}
    references = []
    if truth is None:
        references = versus_others(
            plots, names, registration, joint_found, made.stated, motion=motion
        )
    required = update_interval or slowest
    if truth is not None:
        judged, required = _judge_all(sets, truth, max_distance, update_interval, limits)
        if fused is not None and TOGETHER in judged:
            fused = _judge_fusion(fused, truth, judged[TOGETHER], max_distance)
    return Analysis(
        plots=plots,
        radars=radars,
        names=names,
        plans=plans,
        truth=truth,
        joint=joint,
        uncorrected=uncorrected,
        single=made.stated,
        registration=registration,
        innovations=seen,
        updates=counts,
        fusion=fused,
        references=references,
        judged=judged,
        audits=_audit_all(judged),
        update_interval=required,
        limits=limits,
        followed=plan_rows,
    )


def _fuse(stated: States, better: States) -> Fusion:
    """Fuse tracks at their common instants, with the stated and with the estimated noise."""
    pair = stated, better
    keys = [list(zip(one.track.tolist(), one.time.tolist(), strict=True)) for one in pair]
    both = set(keys[0]) & set(keys[1])
    stated, better = (
        one.chosen(np.array([key in both for key in own], dtype=bool))
        for one, own in zip(pair, keys, strict=True)
    )
    ways = {
        OPTIMAL: combine(stated, "matrix"),
        OPTIMAL_FOUND: combine(better, "matrix"),
        INTERSECTION: combine(better, "covariance-intersection"),
    }
    states = {name: (one.state, one.covariance) for name, one in ways.items()}
    states[TOGETHER] = stated.joint_state, stated.joint_covariance
    return Fusion(stated, better, ways, states, {}, {})


def _judge_all(
    sets: dict[str, TrackTable],
    truth: Truth,
    max_distance: float,
    update_interval: float | None,
    limits: Mapping[str, float],
) -> tuple[dict[str, Judged], float]:
    """Evaluate all sets of tracks with one update interval; also return this interval."""
    rows = {name: confirmed_rows(table) for name, table in sets.items()}
    rows = {name: one for name, one in rows.items() if np.any(one.updated)}
    usual = usual_periods(rows[TOGETHER]) if TOGETHER in rows else []
    if not usual:
        return {}, update_interval or 1.0
    required = usual[0] if update_interval is None else update_interval
    intervals = required, max([required, *usual])
    return {
        name: judge(one, truth, intervals, max_distance, limits) for name, one in rows.items()
    }, required


def _audit_all(judged: dict[str, Judged]) -> dict[str, Audit]:
    """Compare the errors of each set of tracks with the stated covariances."""
    found = {}
    for name, one in judged.items():
        updates, matching = one.rows.updates(), one.indicators.matching
        if updates.covariance is None:
            continue
        if np.any(np.isfinite(matching.error).all(axis=-1)):
            found[name] = metrics.audit(
                matching.error,
                updates.covariance,
                truth_covariance=one.truth.covariance_at(matching.target, updates.time)[:, :2, :2],
                time=updates.time,
                groups=matching.target,
            )
    return found


def _judge_fusion(fused: Fusion, truth: Truth, joint: Judged, max_distance: float) -> Fusion:
    """Compare the fused states with the targets that the joint tracks follow at these times.

    A state farther than `max_distance` from its target is left out, as in all other comparisons.
    """
    updated = joint.rows.updated
    target = _followed(
        (joint.rows.track[updated], joint.rows.time[updated]),
        joint.indicators.matching.target,
        (fused.stated.track, fused.stated.time),
    )
    places = truth.at(target, fused.stated.time)[:, :2]
    states = dict(fused.states)
    states |= {
        f"#{k}": (fused.stated.state[:, k], fused.stated.covariance[:, k])
        for k in range(fused.stated.state.shape[1])
    }
    error = {name: state[:, :2] - places for name, (state, _) in states.items()}
    for one in error.values():
        one[np.hypot(*one.T) > max_distance] = np.nan
    nees = {
        name: np.asarray(metrics.nees(error[name], spread[:, :2, :2]))
        for name, (_, spread) in states.items()
    }
    return replace(fused, error=error, nees=nees)


def _followed(
    updates: tuple[IntArray, FloatArray], target: IntArray, wanted: tuple[IntArray, FloatArray]
) -> IntArray:
    """Return, for each time, the target of the nearest update of a track; -1 if there is none."""
    (tracks, times), (track, time) = updates, wanted
    found = np.full(len(track), -1)
    for number in np.unique(track):
        own, here = np.flatnonzero(tracks == number), track == number
        if len(own):
            own = own[np.argsort(times[own], kind="stable")]
            after = np.clip(np.searchsorted(times[own], time[here]), 0, len(own) - 1)
            before = np.maximum(after - 1, 0)
            near = np.abs(times[own][before] - time[here]) < np.abs(times[own][after] - time[here])
            found[here] = target[own[np.where(near, before, after)]]
    return found


def means(time: FloatArray, values: FloatArray, edges: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the mean and the number of the known values in each period."""
    known = np.isfinite(values)
    which = in_periods(time[known], edges)
    count = np.bincount(which, minlength=len(edges) - 1)
    total = np.bincount(which, values[known], minlength=len(edges) - 1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan), count.astype(np.float64)


def within(nees: FloatArray) -> float:
    """Return the fraction of the errors within the 95 % ellipse; nan if no error is known."""
    known = nees[np.isfinite(nees)]
    return float(np.mean(known <= MOST_NEES)) if len(known) else np.nan


def confirmed_rows(table: TrackTable) -> Rows:
    """Return the rows of confirmed tracks, for evaluation."""
    own = table[table.confirmed]
    kept = own.time, own.track, own.sensor, own.position, own.velocity
    spread = own.covariance[:, :2, :2]
    return Rows(*kept, spread, own.plot >= 0, own.height, getattr(own, leading(own, NUMBERS)))


def combine(states: States, method: fusion.InstantMethod) -> Combined:
    """Fuse the states at each instant; a weight is the mean of the weights for east and north."""
    found = fusion.fuse(states.state, states.covariance, method=method)
    weight = np.trace(found.weights[..., :2, :2], axis1=-2, axis2=-1) / 2
    weight[~states.present] = np.nan
    return Combined(found.mean, found.covariance, weight, np.asarray(found.pvalue))
