"""Warnings about stations that contradict each other because their clocks differ."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tertia._arrays import FloatArray
from tertia.location import locate
from tertia.sensors import Bias, Kind, Station
from tertia.tables._doubts import doubt
from tertia.tables._measurements import Target

# kinds that one station measures alone, at its own time
_KINDS: tuple[Kind, ...] = ("range", "azimuth", "elevation")
_ANGLES = {"azimuth", "elevation"}
# targets and instants that are used; instants on either side by which rates are measured
_TARGETS, _INSTANTS, _SIDE = 20, 200, 3
# median p-value above which nothing is wrong
_AGREES = 0.2
# least instants, least mean square of the contradictions, and most of it that other clocks leave
_FEWEST, _CONTRADICTION, _LEFT = 8, 2.0, 0.5
# mean square of what other clocks leave, and its share of the contradictions, with which wrong
# positions of stations, which look the same on a straight path, are no better explanation
_AS_STATED, _FAR = 1.5, 10.0
# how much larger the information criterion must be with other errors of the stations
_EVIDENCE = 10.0
# least difference of two clocks in its standard deviations
_CERTAIN = 6.0
# share of the instants that fit worst and are left out, and rounds in which they are found
_TRIMMED, _ROUNDS = 0.2, 4
# share of the information below which a combination of clocks is not determined
_DETERMINED = 1e-6


def doubt_station_clocks(targets: Sequence[Target], bias: Bias | None) -> None:
    """Warn if stations contradict each other, and would agree if their clocks were set differently.

    A clock that is wrong by τ changes a measurement by τ times its rate. The differences of the
    clocks are found by least squares from the contradictions at single instants; no motion is
    assumed. Stated clocks are not judged: `bias`, or the biases of the stations. Cost O(N K³) for N
    instants, of which 200 are used.
    """
    if targets and _is_stated(targets[0].sensors.items, bias):
        return
    blocks: list[FloatArray] = []
    for target in targets[:_TARGETS]:
        blocks += _contradictions(target) if len(blocks) < _INSTANTS else []
    if len(blocks) < _FEWEST:
        return
    names = targets[0].sensors.names
    said = _differences(blocks, len(names))
    if said is None:
        return
    late, sigma = said
    wrong = np.flatnonzero(np.abs(late) > _CERTAIN * sigma)
    if not len(wrong):
        return
    listed = ", ".join(f"{late[k]:.3g} ± {sigma[k]:.1g} s to those of {names[k]}" for k in wrong)
    most = float(np.max(np.abs(late)))
    doubt(
        "the stations contradict each other, and would agree if their clocks differed: if the "
        f"times of {names[0]} are correct, add {listed}; on a straight path, a wrong position of a "
        f"station looks the same; to estimate the clocks with a path, state time_bias_sigma_s = "
        f"{most:.1g} for each station (Bias.time_sigma)"
    )


def _is_stated(stations: Sequence[Station], bias: Bias | None) -> bool:
    """Return whether errors of clocks, or their sigmas, were given."""
    own = [bias] if bias is not None else [station.bias for station in stations]
    stated = [(one.time, one.time_sigma) for one in own if one is not None]
    return any(
        np.any(np.nan_to_num(np.asarray(one, dtype=float))) for each in stated for one in each
    )


def _contradictions(target: Target) -> list[FloatArray]:
    """Return for each instant the contradictions in sigmas, and how errors of stations change them.

    A block has one row for each redundant measurement; the columns are the contradiction, and its
    changes per second of the clock of each station, per sigma of the bias of each kind and station,
    and per metre of the coordinates of each station.
    """
    sigmas = target.all_sigmas(optional=True)
    kinds = [kind for kind in _KINDS if kind in target.values]
    if not sigmas or not kinds:
        return []
    stations = target.sensors.items
    k = len(stations)
    position = _located(target, stations, sigmas)
    if position is None:
        return []
    d = position.shape[1]
    rates = {
        kind: _rates(target.times[: len(position)], target.values[kind][: len(position)], kind)
        for kind in kinds
    }
    blocks = []
    for i in np.flatnonzero(np.isfinite(position).all(axis=1)).tolist():
        rows = []
        for at, kind in enumerate(kinds):
            for j in np.flatnonzero(np.isfinite(target.values[kind][i])).tolist():
                expected, gradient = _expected(_at(stations[j], i), position[i], kind)
                off = target.values[kind][i, j] - expected
                if kind in _ANGLES:
                    off = math.remainder(off, 2 * math.pi)
                clock, bias, place = np.zeros(k), np.zeros(len(_KINDS) * k), np.zeros((k, d))
                # what is labelled with a time that is too early comes from later
                clock[j], bias[at * k + j] = rates[kind][i, j], sigmas[kind][i, j]
                place[j] = -gradient
                row = np.concatenate([gradient, [off], clock, bias, place.ravel()])
                rows.append(row / sigmas[kind][i, j])
        block = np.array(rows)
        if len(block) > d and np.isfinite(block).all():
            u, size, _ = np.linalg.svd(block[:, :d])
            free = u[:, np.count_nonzero(size > 1e-9 * size[0]) :]
            blocks.append(free.T @ block[:, d:])
    return blocks


def _located(
    target: Target, stations: Sequence[Station], sigmas: Mapping[str, FloatArray]
) -> FloatArray | None:
    """Return the positions at single instants, (N, D), without heights if only azimuths are known.

    Return None if they cannot be located, or if their measurements agree.
    """
    some = slice(None, _INSTANTS)
    measured: dict[str, Any] = {f"{kind}_sigma": sigma[some] for kind, sigma in sigmas.items()}
    measured |= {kind: values[some] for kind, values in target.measured().items()}
    bare = [_moved(one, some) for one in stations]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            trusted = locate(bare, **measured, bias=Bias())
            pvalue = np.atleast_1d(trusted.pvalue)[np.atleast_1d(trusted.degrees_of_freedom) > 0]
            if not len(pvalue) or np.median(np.nan_to_num(pvalue)) > _AGREES:
                return None
            found = np.atleast_2d(locate(bare, **measured).position)
        except ValueError:
            return None
    return found[:, :2] if np.isnan(found[:, -1]).all() else found


def _moved(station: Station, some: slice) -> Station:
    """Return a station without sigmas, at some of the instants if it moves."""
    place, axes = np.asarray(station.position), station.axes
    axes = axes if axes is None or axes.ndim < 3 else axes[some]
    return Station(place[some] if place.ndim > 1 else place, axes=axes)


def _at(station: Station, i: int) -> tuple[FloatArray, FloatArray]:
    """Return the position of a station at an instant, and its axes there."""
    place = np.asarray(station.position, dtype=np.float64)
    place = place[i] if place.ndim > 1 else place
    axes = np.eye(len(place)) if station.axes is None else np.asarray(station.axes)
    return place, axes[i] if axes.ndim > 2 else axes


def _expected(
    station: tuple[FloatArray, FloatArray], position: FloatArray, kind: Kind
) -> tuple[float, FloatArray]:
    """Return what a station measures of a target at a position, and the derivatives, (D,)."""
    place, axes = station
    d = len(position)
    offset = axes[:d, :d] @ (position - place[:d])
    flat = math.hypot(offset[0], offset[1])
    distance = float(np.linalg.norm(offset))
    up = offset[2] if d > 2 else 0.0
    if kind == "azimuth":
        slope = [offset[1] / flat**2, -offset[0] / flat**2, 0.0]
        value = math.atan2(offset[0], offset[1])
    elif kind == "elevation":
        slope = [-up * one / (flat * distance**2) for one in offset[:2]]
        slope.append(flat / distance**2)
        value = math.atan2(up, flat)
    else:
        slope, value = list(offset / distance), distance
    return value, np.array(slope[:d]) @ axes[:d, :d]


def _rates(times: FloatArray, values: FloatArray, kind: Kind) -> FloatArray:
    """Return the rates of measured series by straight lines through a few instants, (N, K)."""
    found = np.full(values.shape, np.nan)
    for i, own in enumerate(values):
        near = slice(max(0, i - _SIDE), i + _SIDE + 1)
        t, y = times[near, np.newaxis] - times[i], values[near] - own
        y = np.remainder(y + math.pi, 2 * math.pi) - math.pi if kind in _ANGLES else y
        known = np.isfinite(y)
        count = known.sum(axis=0)
        t = np.where(known, t, 0.0)
        t = np.where(known, t - t.sum(axis=0) / np.maximum(count, 1), 0.0)
        square = np.sum(t**2, axis=0)
        enough = (count > _SIDE) & (square > 0.0)
        rate = np.nansum(t * y, axis=0) / np.where(enough, square, 1.0)
        found[i] = np.where(enough, rate, np.nan)
    return found


def _differences(blocks: list[FloatArray], k: int) -> tuple[FloatArray, FloatArray] | None:
    """Return by how much each clock is too early and the sigmas, if this explains contradictions.

    The clock of the first station is the reference. Constant errors of the measurements or of the
    positions of the stations must be less likely, by the Bayesian information criterion (Schwarz
    1978).
    """
    clocks, places = slice(2, 1 + k), 1 + k * (1 + len(_KINDS))
    others = slice(1 + k, places), slice(places, None)
    kept = blocks
    for _ in range(_ROUNDS):
        rows = np.concatenate(kept)
        found, _, order, _ = np.linalg.lstsq(rows[:, clocks], rows[:, 0], rcond=_DETERMINED)
        if order < k - 1:
            return None
        squares = [np.mean((one[:, 0] - one[:, clocks] @ found) ** 2) for one in blocks]
        limit = np.quantile(squares, 1.0 - _TRIMMED)
        kept = [one for one, square in zip(blocks, squares, strict=True) if square <= limit]
    rows = np.concatenate(kept)
    before = float(np.mean(rows[:, 0] ** 2))
    left, criterion = _left(rows[:, 0], rows[:, clocks])
    if before < _CONTRADICTION or left > _LEFT * before:
        return None
    explains = left <= _AS_STATED and before >= _FAR * left
    rivals = others[:1] if explains else others
    if criterion > min(_left(rows[:, 0], rows[:, part])[1] for part in rivals) - _EVIDENCE:
        return None
    covariance = np.linalg.inv(rows[:, clocks].T @ rows[:, clocks]) * max(left, 1.0)
    return np.append(0.0, found), np.append(0.0, np.sqrt(np.diag(covariance)))


def _left(y: FloatArray, x: FloatArray) -> tuple[float, float]:
    """Return the mean square that a linear model leaves, and its information criterion."""
    found, _, order, _ = np.linalg.lstsq(x, y, rcond=_DETERMINED)
    left = float(np.mean((y - x @ found) ** 2))
    return left, len(y) * math.log(max(left, 1e-300)) + order * math.log(len(y))
