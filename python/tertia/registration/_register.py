"""Estimation of the noise and the biases of radars from a recording."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from tertia import _core
from tertia._arrays import FloatArray, instance
from tertia.registration._registration import NoiseHistory, Registration
from tertia.registration._states import Run, States, alone
from tertia.sensors import ByKind, PositionSensor, Radar, Station
from tertia.sensors._channels import WIDEST_BEAM
from tertia.tracker import Plots, TrackTable
from tertia.tracker._biases import columns_of, values_of, without_deviation
from tertia.tracker._doubts import names_of, place_doubts
from tertia.tracker._errors import Errors, equal_periods, errors, in_periods, with_bias
from tertia.tracker._models import with_heights
from tertia.tracker._recording import tracked
from tertia.tracker._sensors import interval, sensors_of
from tertia.tracker._start import start

# rounds of tracking, each with the noise found in the one before
_ROUNDS = 3
# stretches of time at most, and scans in each at least
_STRETCHES, _SCANS = 24, 8
# share of the noise by which errors may still change when they are found
_STAYS = 0.5
# redundant measurements from which on the noise beside other radars is known
_REDUNDANT = 30.0


@dataclass(frozen=True, slots=True, eq=False)
class Rounds:
    """A registration, and the tracks of single radars on which it is based.

    `stated` has the tracks made with the stated noise, and `found` those made with the estimated
    noise.
    """

    registration: Registration
    stated: list[TrackTable]
    found: list[TrackTable]


def register(
    plots: Plots,
    sensors: Sequence[Radar | PositionSensor],
    *,
    tracks: TrackTable | None = None,
    n_threads: int | None = None,
    **options: Any,
) -> Registration:
    """Estimate the noise and the systematic errors of radars from their plots.

    Parameters
    ----------
    plots : Plots
        The plots of a recording, in any order.
    sensors : sequence of K Radar or PositionSensor
        The sensors. Positions of a `PositionSensor` are assumed to be free of systematic errors
        except for a delay; they help to determine the errors of the radars. If its `bias` has an
        `east_sigma` or `north_sigma`, these errors are estimated, too.
    tracks : TrackTable, optional
        Tracks from the plots of all sensors; by default they are made from `plots`.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.
    **options
        Options of `tertia.tracker.Tracker`, which makes the tracks.

    Returns
    -------
    Registration
        The estimated biases, over time and at the end, and noise factors, with their standard
        deviations.

    Raises
    ------
    ValueError, TypeError
        If there is no radar, if `tracks` was not made from these plots, if the tracker raises an
        error, or if an argument has the wrong type.

    Warns
    -----
    UserWarning
        If all radars have the same errors, as if the position of one of them were wrong.

    Notes
    -----
    **Systematic errors.** Each radar has an offset and a gain of the range, an offset of the
    azimuth, and a clock offset. Their prior distribution is given by the `bias` of the radar or, if
    that is None, by `RADAR_LIMITS`. A radar with `bias=Bias()` is assumed to be free of systematic
    errors. The plots of one target within 2.2 scans of the slowest radar form a block. The unknown
    position, velocity and acceleration of the target are eliminated from each block by projection,
    so that blocks are independent of each other and of any filter. Blocks that do not fit a motion
    with constant acceleration are left out. An error that does not affect any block keeps its prior
    distribution: the plots of a single radar contain no information on its errors, and a clock
    error that all radars share cannot be estimated.

    If the errors of a target persist, as those of its transponder do, the blocks of a target agree
    with each other more than independent ones would. The information of all blocks is then divided
    by the ratio of the squared sums of scores of each target to their expected value, as in
    cluster-robust standard errors (Liang, Zeger 1986), and the noise is not assumed to be smaller
    than stated.

    Tracks of single radars are compared first. This comparison finds errors of up to ten times
    their prior sigmas. The plots are then tracked with these errors removed. Tracking and
    estimation are repeated as long as the estimated errors still change.

    **Noise.** A line is fitted to every six successive plots of a straight track. The mean squares
    of the residuals, in range and in azimuth, are averaged robustly: lines beyond the 99.9 %
    quantile of the chi-squared distribution are excluded. Tracking is repeated three times, each
    time with the noise that was estimated before, because gates that are too small exclude the
    plots with the largest errors. If the residuals of the blocks are larger than this noise
    explains, the noise is multiplied by the ratio. This happens if a radar smooths its plots,
    because their scatter about a line is then smaller than their errors.

    **Errors over time.** A recording has up to 360 periods of equal length, of four scans of the
    slowest radar or more. From period to period, errors drift at one of five rates (none, and a
    quarter, 1, 4 and 16 times the rate stated by `drift_share` and `drift_time`); the estimates are
    averaged by the likelihoods of the rates. A sudden change of the errors of a radar is assumed
    only if it is a million times as likely as no change, and larger than a tenth of their prior
    sigmas. The first tracks are made with registration while tracking, so that changes larger than
    the gates are also found.

    If the radars have no `frame`, the curvature of the earth appears as a gain of the range. Radars
    at the same place determine only differences of their errors. The cost is O(N log N + N K^2 +
    T K^3) for N plots and T periods.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.registration import register
    >>> from tertia.sensors import Bias, Radar
    >>> from tertia.simulate import dense_traffic, radar_plots
    >>> numbers = {"range_sigma": 50.0, "azimuth_sigma": 0.0015, "scan_period": 4.0}
    >>> radars = [Radar([east, 0.0], **numbers) for east in (-4e4, 4e4)]
    >>> traffic = dense_traffic(30, area=(1e5, 1e5), rng=1)
    >>> record = radar_plots(traffic, radars, bias=Bias(range=[0.0, 200.0]), rng=2)
    >>> found = register(record.plots, radars)
    >>> off = found.bias.range[1] - 200.0
    >>> bool(abs(off) < 3 * found.bias.range_sigma[1]), found.changes
    (True, ())
    """
    instance(plots, "plots", Plots)
    sites = [one for one in sensors_of(sensors) if not isinstance(one, Station)]
    if len(sites) < len(sensors):
        raise TypeError("sensors has a Station; registration takes Radar and PositionSensor")
    if not any(isinstance(one, Radar) for one in sites):
        raise ValueError("sensors has no Radar; there must be one or more")
    if tracks is not None:
        instance(tracks, "tracks", TrackTable)
        if len(tracks.track_of_plot) != len(plots):
            raise ValueError(
                f"tracks is of {len(tracks.track_of_plot)} plots; it must be of the {len(plots)} "
                "given"
            )
    run: Run = partial(_quiet, registration=False, n_threads=n_threads, **options)
    plots = with_heights(plots, sites, options.get("profile", "aircraft"))
    found = rounds(plots, sites, run, tracks).registration
    for said in place_doubts(sites, found.bias, names_of(sites)):
        warnings.warn(said, UserWarning, stacklevel=2)
    return found


def _quiet(plots: Plots, sensors: Sequence[Radar | PositionSensor], **options: Any) -> TrackTable:
    """Return the tracks, without warnings of what the errors of the sensors cause."""
    return tracked(plots, sensors, **options)[0]


def rounds(
    plots: Plots,
    given: Sequence[Radar | PositionSensor],
    run: Run,
    joint: TrackTable | None = None,
) -> Rounds:
    """Register radars; return the registration and the tracks of each sensor alone."""
    count, edges = len(given), _stretches(plots, given)
    stated, found, sensors = [], [], list(given)
    levels = np.full((2, count, 2), np.nan)
    histories = np.full((2, count, len(edges) - 1, 2), np.nan)
    for k, sensor in enumerate(given):
        for n in range(_ROUNDS if isinstance(sensor, Radar) else 1):
            table = alone(plots, sensors, k, run)
            if n == 0:
                stated.append(table)
            if isinstance(radar := sensors[k], Radar):
                levels[:, k], histories[:, k] = _noise(table, plots, radar, edges)
                sensors[k] = with_noise(radar, levels[0, k])
        found.append(table)
    known = _systematic(plots, sensors, run, joint, stated)
    # the noise of single radars, and what their plots are off together
    own = np.where(known.redundancy > _REDUNDANT, known.factor, 1.0)
    noise = _stated(given)
    factor, factor_sigma = levels * own / noise
    history, history_sigma = (
        over_time * own[:, np.newaxis] / noise[:, np.newaxis] for over_time in histories
    )
    alike = without_deviation(known.bias, given)
    registration = Registration(
        bias=known.bias,
        covariance=known.covariance,
        deviation_covariance=known.deviation_covariance,
        changes=known.changes,
        prior=known.prior,
        noise_factor=_by_kind(factor),
        noise_factor_sigma=_by_kind(factor_sigma),
        noise_history=NoiseHistory(edges, _by_kind(history), _by_kind(history_sigma)),
        bias_history=known.history,
        sensors=tuple(
            with_bias(
                with_noise(one, levels[0, k] * own[k]) if isinstance(one, Radar) else one,
                alike[k],
            )
            for k, one in enumerate(given)
        ),
    )
    return Rounds(registration, stated, found)


def _stretches(plots: Plots, sensors: Sequence[Radar | PositionSensor]) -> FloatArray:
    """Return the edges of the periods in which the noise is estimated."""
    return equal_periods(plots.time, _SCANS * max(map(interval, sensors)), _STRETCHES)


def _stated(sensors: Sequence[Radar | PositionSensor]) -> FloatArray:
    """Return the standard deviations of range and azimuth, (K, 2); inf if not measured."""
    return np.array(
        [
            [one.range_sigma, one.azimuth_sigma] if isinstance(one, Radar) else [np.inf, np.inf]
            for one in sensors
        ]
    )


def _systematic(
    plots: Plots,
    sensors: Sequence[Radar | PositionSensor],
    run: Run,
    joint: TrackTable | None,
    alone: Sequence[TrackTable],
) -> Errors:
    """Return the systematic errors, estimated from the tracks of all radars.

    If errors are large, the plots of one target are assigned to several tracks, and no block
    contains plots of two radars. Therefore plots are tracked again with the estimated errors
    removed, until the estimates no longer change. The first tracks are made while the errors are
    estimated scan by scan, as they may change suddenly.
    """
    begin = start(alone, sensors)[0]
    sigma, found = columns_of(begin, "_sigma"), columns_of(begin)
    noise = _stated(sensors)
    joint = run(plots, sensors, registration=None) if joint is None else joint
    known = errors(plots, joint, sensors, sigma=sigma, start=found)
    for _ in range(_ROUNDS - 1):
        before, found = found, known.values
        moved = (found - before)[..., [0, 2]]
        if np.all(np.abs(moved) < _STAYS * noise):
            break
        joint = run(*known.removed(plots, sensors))
        known = errors(plots, joint, sensors, sigma=sigma, start=found)
    return known


def with_noise(radar: Radar, sigma: FloatArray) -> Radar:
    """Return the radar with the given standard deviations of range and azimuth, if known."""
    range_sigma, azimuth_sigma = np.where(
        np.isfinite(sigma) & (np.asarray(sigma) > 0),
        sigma,
        [radar.range_sigma, radar.azimuth_sigma],
    )
    # beyond this it is no radar, for example where ranges are in another unit
    azimuth_sigma = min(float(azimuth_sigma), WIDEST_BEAM)
    return replace(radar, range_sigma=float(range_sigma), azimuth_sigma=azimuth_sigma)


def corrected(states: States, registration: Registration, radars: Sequence[Radar]) -> States:
    """Return states from which biases are removed, with covariances scaled to the period's noise.

    The states come from tracks that were made with the noise of the whole recording. Their standard
    deviations along and across the range are scaled to the noise of each period.
    """
    history, whole = registration.noise_history, registration.noise_factor
    which = in_periods(states.time, history.edges)
    factors = np.empty((len(which), len(radars), 2))
    for axis, kind in enumerate(("range", "azimuth")):
        over_time, level = getattr(history.factor, kind), getattr(whole, kind)
        factors[..., axis] = (over_time / level[:, np.newaxis])[:, which].T
    factors[~np.isfinite(factors)] = 1.0
    places = np.array([radar.position[:2] for radar in radars])
    found = registration.bias_history
    bias = np.stack([values_of(one) for one in found.bias])[in_periods(states.time, found.edges)]
    state, covariance = _core.correct_states(states.columns(), places, bias, factors)
    return States(
        states.time,
        states.track,
        state,
        covariance,
        states.joint_state,
        states.joint_covariance,
    )


def _by_kind(columns: FloatArray) -> ByKind:
    """Return an array (..., 2) of range and azimuth as a `ByKind`."""
    range_, azimuth = (np.ascontiguousarray(columns[..., axis]) for axis in range(2))
    return ByKind(range=range_, azimuth=azimuth)


def _noise(
    table: TrackTable, plots: Plots, radar: Radar, edges: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the noise of range and azimuth with its standard errors, (2, 2), and its history."""
    rows = np.flatnonzero(table.plot >= 0)
    own = plots[table.plot[rows]]
    up = radar.position[2] if len(radar.position) == 3 else 0.0
    updates = {
        "track": table.track[rows],
        "turn_probability": table.turn_probability[rows],
        "row_time": table.time[rows],
        "time": own.time,
        "range": own.range,
        "azimuth": own.azimuth,
        "height": own.height - up,
    }
    whole, over_time = _core.register_noise(updates, radar.azimuth_sigma, radar.scan_period, edges)
    return np.array(whole), np.array(over_time)
