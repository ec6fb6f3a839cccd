"""Comparison of tracks with the truth: positions at common instants, GOSPA and overall figures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tertia import metrics
from tertia._arrays import BoolArray, FloatArray, IntArray
from tertia.metrics import Indicators, Truth
from tertia.metrics._indicator import Indicator

# a track that ends is shown for this many scans of its radars
_AGE = 1.5
# of an interval: times in files are rounded
_ROUNDING = 1e-6
# 95 % of chi-squared with two degrees of freedom
MOST_NEES = 5.991464547107979
# figures that may have limits: their names and units
REQUIRED = {
    "probability_of_update": ("probability of update", ""),
    "long_gap_ratio": ("share missed in long gaps", ""),
    "data_age": ("age of the data, mean", "s"),
    "pair_time_offset": ("time between updates of close targets, RMS", "s"),
    "rmse": ("RMSE", "m"),
    "large_error_ratio": ("share in runs of large errors", ""),
    "probability_of_height_update": ("probability of update, right height", ""),
    "wrong_height_ratio": ("share of wrong heights", ""),
    "probability_of_identity_update": ("probability of update, right identity", ""),
    "wrong_identity_ratio": ("share of wrong identities", ""),
    "continuity": ("share of targets with one track", ""),
    "false_tracks_per_hour": ("false tracks per hour", "/h"),
    "near_false_tracks_per_hour": ("false tracks near targets, per hour", "/h"),
    "false_update_density": ("false updates in 450 intervals", "/900 NM²"),
}
PARTS = ("GOSPA", "localisation", "missed", "false")


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows of tracks in SI units; unknown values are nan, and tracks and radars have numbers."""

    time: FloatArray
    track: IntArray
    radar: IntArray
    position: FloatArray
    velocity: FloatArray
    covariance: FloatArray | None
    updated: BoolArray
    height: FloatArray | None = None
    identity: IntArray | None = None

    def updates(self) -> Rows:
        """Return the rows that have a plot."""
        columns = {name: getattr(self, name) for name in self.__slots__}
        known = {name: column for name, column in columns.items() if column is not None}
        return replace(self, **{name: column[self.updated] for name, column in known.items()})


def usual_periods(rows: Rows) -> list[float]:
    """Return, in increasing order, the median time between the updates of a track by each radar."""
    time, track, radar = (x[rows.updated] for x in (rows.time, rows.track, rows.radar))
    periods = []
    for one in np.unique(radar):
        own = radar == one
        order = np.lexsort((time[own], track[own]))
        gaps = np.diff(time[own][order])[np.diff(track[own][order]) == 0]
        if len(gaps):
            periods.append(float(np.median(gaps)))
    return sorted(periods)


def pictures(rows: Rows, instants: FloatArray, lasting: float) -> FloatArray:
    """Return the positions of tracks, (M, T, 2), extrapolated from their last rows.

    A track exists from its first row until `lasting` seconds after its last row; at other times its
    position is nan.
    """
    order = np.lexsort((rows.time, rows.track))
    _, starts = np.unique(rows.track[order], return_index=True)
    found = []
    for own in np.split(order, starts[1:]):
        last = np.searchsorted(rows.time[own], instants, side="right") - 1
        row = own[np.maximum(last, 0)]
        age = instants - rows.time[row]
        shown = rows.position[row] + age[:, np.newaxis] * rows.velocity[row]
        ended = instants > rows.time[own[-1]] + lasting
        shown[(last < 0) | ended] = np.nan
        found.append(shown)
    return np.array(found)


def gospa(
    rows: Rows, truth: Truth, periods: tuple[float, float], cutoff: float
) -> tuple[FloatArray, FloatArray]:
    """Return instants, one per update interval, and GOSPA at each with its parts, (T, 4).

    `periods` are the required update interval and the update interval of the slowest radar. The
    parts are returned as distances: their squares add up to the square of GOSPA.
    """
    required, slowest = periods
    first, last = truth.time.min(), truth.time.max()
    instants = first + required * np.arange(np.floor((last - first) / required + _ROUNDING) + 1)
    shown = pictures(rows, instants, _AGE * slowest)
    there = truth.at(np.arange(len(truth))[:, np.newaxis], instants)
    parts = np.empty((len(instants), 4))
    for t in range(len(instants)):
        estimates, places = (x[:, t][np.isfinite(x[:, t, 0])] for x in (shown, there))
        one = metrics.gospa(estimates, places, cutoff)
        parts[t] = one.distance**2, one.localisation, one.missed, one.false
    return instants, np.sqrt(parts)


@dataclass(frozen=True, slots=True)
class Judged:
    """Tracks, the truth, and the results of their comparison."""

    rows: Rows
    truth: Truth
    indicators: Indicators
    along: FloatArray
    across: FloatArray
    nees: FloatArray | None
    instants: FloatArray
    gospa: FloatArray

    @property
    def time(self) -> FloatArray:
        """Times of the updates of the tracks in seconds."""
        return self.rows.time[self.rows.updated]


def judge(
    rows: Rows,
    truth: Truth,
    periods: tuple[float, float],
    distance: float,
    limits: Mapping[str, float] | None = None,
) -> Judged:
    """Compare tracks with the truth, and the indicators of the tracks with limits.

    `periods` are the required update interval and the update interval of the slowest radar.
    """
    updates = rows.updates()
    found = metrics.indicators(
        updates, truth, max_distance=distance, update_interval=periods[0], limits=limits
    )
    matching = found.matching
    course = truth.course(matching.target, updates.time)
    along, across = metrics.track_errors(matching.error, course)
    nees = None
    if updates.covariance is not None:
        own = truth.covariance_at(matching.target, updates.time)[:, :2, :2]
        nees = np.asarray(metrics.nees(matching.error, updates.covariance + own))
    instants, parts = gospa(rows, truth, periods, distance)
    return Judged(rows, truth, found, np.asarray(along), np.asarray(across), nees, instants, parts)


def figures(judged: Judged, period: float) -> list[tuple[str, float | None, str]]:
    """Return the figures of all tracks, with names, values and units; unknown values are None."""
    shown, truth = judged.indicators, judged.truth
    latency = shown.latency[~np.isnan(shown.latency)]
    confirmed = len(np.unique(judged.rows.track))
    mean = judged.gospa[:, 0].mean()
    roots = np.sqrt(np.mean(judged.gospa[:, 1:] ** 2, axis=0))
    found: list[tuple[str, float | None, str]] = [
        ("targets", len(truth), ""),
        ("missed targets", shown.missed_targets, ""),
        ("tracks", confirmed, ""),
        ("false tracks", shown.false_tracks, ""),
        ("false updates", shown.false_updates, ""),
        ("identity switches", shown.switches, ""),
        ("update period", period, "s"),
        ("latency, median", _or_none(np.median, latency), "s"),
        ("latency, largest", _or_none(np.max, latency), "s"),
        *((name, one.value, unit) for name, one, _, unit in requirements(judged, None)),
        ("RMSE along track", rmse(judged.along), "m"),
        ("RMSE across track", rmse(judged.across), "m"),
        ("GOSPA, mean", mean, "m"),
        *((f"GOSPA, {name}", value, "m") for name, value in zip(PARTS[1:], roots, strict=True)),
    ]
    if judged.nees is not None:
        known = judged.nees[~np.isnan(judged.nees)]
        found += [
            ("NEES per axis", _or_none(np.mean, known / 2), ""),
            ("share within the 95 % ellipse", _or_none(np.mean, known <= MOST_NEES), ""),
        ]
    return [
        (name, None if value is None or np.isnan(value) else value, unit)
        for name, value, unit in found
    ]


def requirements(
    judged: Judged, limits: Mapping[str, float] | None
) -> list[tuple[str, Indicator, float | None, str]]:
    """Return the indicators that may have limits, with their names, values, limits and units."""
    limits = limits or {}
    rows = [
        (name, getattr(judged.indicators, key), limits.get(key), unit)
        for key, (name, unit) in REQUIRED.items()
    ]
    # without heights or identities nothing is said of them, unless it is required
    return [row for row in rows if row[1].count or row[2] is not None or row[3].startswith("/")]


def _or_none(of: Callable[[Any], Any], values: FloatArray | BoolArray) -> float | None:
    return float(of(values)) if len(values) else None


def rmse(errors: FloatArray) -> float | None:
    """Return the root mean square of the known errors; None if no error is known."""
    known = errors[~np.isnan(errors)]
    return float(metrics.rmse(known)) if known.size else None
