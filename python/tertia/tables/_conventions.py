"""Warnings about measurements that agree only under another convention, such as another zero."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tertia._arrays import BoolArray, FloatArray, IntArray
from tertia.geo import LocalFrame
from tertia.location import LIGHT, Location, locate
from tertia.location._conventions import CONVENTIONS, Convention
from tertia.sensors import Bias, ByKind, Station
from tertia.tables._doubts import doubt, extent
from tertia.tables._heights import given_heights
from tertia.tables._measurements import Target

# instants and targets that are tried, those with most measurements
_INSTANTS, _TARGETS = 200, 50
# other conventions are tried if fewer instants fit; one is suggested if so many fit, so many more
_USUAL, _SHARE, _GAIN = 0.8, 0.75, 0.3
# degrees of freedom that must agree
_EVIDENCE = 4.0
# p-value above which measurements agree; share of faults, and mean square of the residuals of the
# others, with which they do as well
_CHANCE, _FEW, _SQUARE = 1e-3, 0.25, 2.0
# share of instants whose arrivals are too far apart, and how much too far
_MANY, _FAR = 0.5, 2.0

# options that decide whether measurements agree
_TRIED = ("propagation_speed", "propagation_speed_sigma", "wind_sigma", "multipath")


def doubt_conventions(targets: Sequence[Target], options: Mapping[str, Any]) -> None:
    """Warn if most instants contradict themselves, and would agree under another convention.

    `options` are those of `locate` or `reconstruct`.
    """
    trials = _trials(targets, options)
    for trial in trials:
        if trial.is_too_slow(options.get("propagation_speed", LIGHT)):
            return
    share, _ = _agreement(trials, None)
    if share >= _USUAL:
        return
    # if no instant is located, none agrees
    share = np.nan_to_num(share)
    best, meant = 0.0, None
    for one in CONVENTIONS:
        if any(one.kind in trial.measured for trial in trials):
            found, worth = _agreement(trials, one)
            if found > best and worth >= _EVIDENCE:
                best, meant = found, one
    if meant is not None and best >= max(_SHARE, share + _GAIN):
        doubt(meant.message)


@dataclass(frozen=True, slots=True)
class _Trial:
    """Some instants of a target, and what is passed to `locate`."""

    stations: Sequence[Station]
    measured: Mapping[str, FloatArray]
    options: Mapping[str, Any]

    def located(self, meant: Convention | None) -> Location | None:
        """Return the positions, if the numbers follow a convention; None if there are none."""
        measured: dict[str, Any] = dict(self.measured)
        if meant is not None and meant.kind in measured:
            measured[meant.kind] = meant.usual(measured[meant.kind])
        with warnings.catch_warnings():
            # of angles in degrees
            warnings.simplefilter("ignore")
            try:
                return locate(self.stations, **measured, **self.options, bias=Bias())
            except ValueError:
                return None

    def is_too_slow(self, speed: float) -> bool:
        """Warn and return True if signals come later than their speed allows."""
        arrival = self.measured.get("arrival_time")
        if arrival is None or len(arrival) < 1:
            return False
        places = np.array([np.atleast_2d(one.position)[0] for one in self.stations])
        apart = extent(places)
        spread = np.fmax.reduce(arrival, axis=1) - np.fmin.reduce(arrival, axis=1)
        if not np.sum(spread * speed > _FAR * apart) > _MANY * len(arrival):
            return False
        doubt(
            f"arrivals of one emission differ by {np.nanmedian(spread):.3g} s, but at {speed:g} "
            f"m/s signals need only {apart / speed:.3g} s between the sensors: are they sounds "
            "(propagation_speed), are times in another unit, or is a tolerance too large?"
        )
        return True


def _trials(targets: Sequence[Target], options: Mapping[str, Any]) -> list[_Trial]:
    found: list[_Trial] = []
    left = _INSTANTS
    for target in targets[:_TARGETS]:
        if left <= 0:
            break
        sigmas = target.all_sigmas(optional=True)
        if not sigmas:
            continue
        count = sum(np.isfinite(values).sum(axis=1) for values in target.values.values())
        steps = np.sort(np.argsort(-np.asarray(count), kind="stable")[:left])
        left -= len(steps)
        measured = {name: values[steps] for name, values in target.measured().items()}
        stations = [_at(one, steps) for one in target.sensors.items]
        tried = {name: options[name] for name in _TRIED if name in options}
        tried |= {f"{kind}_sigma": one[steps] for kind, one in sigmas.items()}
        tried |= _heights(target, steps, options)
        found.append(_Trial(stations, measured, tried))
    return found


def _heights(target: Target, steps: IntArray, options: Mapping[str, Any]) -> dict[str, FloatArray]:
    """Return the heights of a target at some instants and their sigmas, as far as all are known."""
    try:
        given = given_heights(target.heights, options.get("height"), options.get("height_sigma"))
    except ValueError:
        # the error is raised when the positions are estimated
        return {}
    frame = target.sensors.frame
    below = frame.height if isinstance(frame, LocalFrame) else 0.0
    each = [
        np.broadcast_to(np.asarray(one, dtype=np.float64), np.shape(target.times))[steps]
        for one in given
        if one is not None
    ]
    if not each or not np.isfinite(each).all():
        return {}
    return dict(zip(("height", "height_sigma"), [each[0] - below, *each[1:]], strict=False))


def _at(one: Station, steps: IntArray) -> Station:
    """Return a station without sigmas, at some of the instants if it moves."""
    position, axes = np.asarray(one.position), one.axes
    if position.ndim > 1:
        position = position[steps]
        axes = None if axes is None else np.asarray(axes)[steps]
    return Station(position, axes=axes, position_sigma=one.position_sigma)


def _agreement(trials: Sequence[_Trial], meant: Convention | None) -> tuple[float, float]:
    """Return the share of redundant instants that agree, and their degrees of freedom."""
    tried, agreed, worth = 0, 0, 0.0
    for trial in trials:
        found = trial.located(meant)
        if found is None:
            continue
        freedom = np.atleast_1d(found.degrees_of_freedom)
        agrees = _fits(found) & (freedom > 0)
        tried += int(np.sum(freedom > 0))
        agreed += int(np.sum(agrees))
        worth += float(np.sum(freedom[agrees]))
    return (agreed / tried if tried else math.nan), worth


def _fits(found: Location) -> BoolArray:
    """Return which instants fit, perhaps after a few measurements were left out as faults."""
    there = np.atleast_1d(np.asarray(found.status)) == 0
    residual, outlier = _columns(found.residual), _columns(found.outlier) == 1
    faults = np.sum(outlier, axis=1)
    count = np.sum(np.isfinite(residual), axis=1)
    squares = np.nansum(np.where(outlier, 0.0, residual) ** 2, axis=1)
    freedom = np.atleast_1d(found.degrees_of_freedom)
    clean = (faults == 0) & ~(np.atleast_1d(found.pvalue) < _CHANCE)
    few = (faults > 0) & (faults <= _FEW * count) & (squares <= _SQUARE * (freedom - faults))
    fits: BoolArray = there & (clean | few)
    return fits


def _columns(values: ByKind) -> FloatArray:
    """Return the values of all kinds side by side, (N, M)."""
    each = (values.range, values.azimuth, values.elevation, values.range_difference)
    known = [one for one in (*each, values.arrival_time) if one is not None]
    return np.concatenate([np.asarray(one, dtype=np.float64) for one in known], axis=1)
