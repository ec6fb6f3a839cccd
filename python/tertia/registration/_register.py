"""Estimation of the noise and the biases of radars from a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from tertia import _core
from tertia._arrays import FloatArray, IntArray, instance, sequence_of
from tertia.registration._registration import NoiseHistory, Registration
from tertia.registration._states import Common, Run, alone, common
from tertia.sensors import Bias, ByKind, Radar
from tertia.tracker import Plots, TrackTable, track

# rounds of tracking, each with the noise found in the one before
_ROUNDS = 3
# stretches of time at most, and scans in each at least
_STRETCHES, _SCANS = 24, 8


@dataclass(frozen=True, slots=True, eq=False)
class Rounds:
    """A registration, and the tracks of each radar alone that it uses.

    `stated` are the tracks with the stated noise, `found` those with the estimated noise; `common`
    are the states of the former at common instants.
    """

    registration: Registration
    stated: list[TrackTable]
    found: list[TrackTable]
    common: Common


def register(
    plots: Plots,
    sensors: Sequence[Radar],
    *,
    tracks: TrackTable | None = None,
    n_threads: int | None = None,
    **options: Any,
) -> Registration:
    """Estimate the noise and the biases of radars from their plots.

    Parameters
    ----------
    plots : Plots
        The plots of a recording, in any order.
    sensors : sequence of K Radar
        The radars.
    tracks : TrackTable, optional
        Tracks from all plots and all radars; by default they are made here.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.
    **options
        Options of the tracker; see `tertia.tracker.Tracker`.

    Returns
    -------
    Registration
        Biases and noise factors with their standard deviations.

    Raises
    ------
    ValueError
        No radar, a table without the plots, or an error of the tracker.
    TypeError
        An argument of the wrong type.

    Notes
    -----
    **Noise.** A line is fitted to every six successive plots of a straight track. The mean squares
    about the lines, in range and in azimuth, have a robust mean: lines beyond the 99.9 % quantile
    of chi-squared are excluded. Tracking is repeated three times, each time with the noise
    estimated before, because too narrow gates exclude the plots with the largest errors.

    **Biases.** Tracks of each radar alone are compared at common instants, one per scan of the
    slowest radar. The biases follow from the differences of all pairs of radars by weighted least
    squares, with Huber's weights beyond 2.5 standard deviations and a prior of ten times the stated
    noise. A bias is unknown if its standard deviation remains above half its prior, because no
    difference between radars depends on it. Standard deviations treat all instants of a track as
    one measurement, so they remain valid for errors that last as long as the track.

    Biases are assumed to be constant, without a range gain, and times to be correct. Differences do
    not show an error common to all radars. Cost O(N log N) in plots, and O(M K⁴) in M common
    instants.

    References
    ----------
    P. J. Huber, "Robust estimation of a location parameter", Annals of Mathematical Statistics 35
    (1964). H. White, "A heteroskedasticity-consistent covariance matrix estimator", Econometrica
    48 (1980).

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.registration import register
    >>> from tertia.sensors import Radar
    >>> from tertia.simulate import dense_traffic, radar_plots
    >>> numbers = {"range_sigma": 50.0, "azimuth_sigma": 0.0015, "scan_period": 4.0}
    >>> radars = [Radar([east, 0.0], **numbers) for east in (-4e4, 4e4)]
    >>> traffic = dense_traffic(30, area=(1e5, 1e5), rng=1)
    >>> record = radar_plots(traffic, radars, bias=[[0.0, 0.0], [200.0, 0.0]], rng=2)
    >>> found = register(record.plots, radars)
    >>> found.bias[1]
    Bias(range=200, azimuth=3.34e-05, range_sigma=3.75, azimuth_sigma=6.04e-05)
    """
    sites = list(sequence_of(sensors, Radar, "sensors"))
    if not sites:
        raise ValueError("sensors is empty; there must be one or more")
    if tracks is not None:
        instance(tracks, "tracks", TrackTable)
        if len(tracks.track_of_plot) != len(plots):
            raise ValueError(
                f"tracks is of {len(tracks.track_of_plot)} plots; it must be of the {len(plots)} "
                "given"
            )
    run: Run = partial(track, n_threads=n_threads, **options)
    joint = run(plots, sites) if tracks is None else tracks
    return rounds(plots, sites, run, joint).registration


def rounds(plots: Plots, radars: Sequence[Radar], run: Run, joint: TrackTable) -> Rounds:
    """Register radars, and keep the tracks of each radar alone."""
    count, edges = len(radars), _edges(plots, max(radar.scan_period for radar in radars))
    stated, found, sensors = [], [], []
    levels, histories = np.empty((2, count, 2)), np.empty((2, count, len(edges) - 1, 2))
    for k, given in enumerate(radars):
        radar = given
        for n in range(_ROUNDS):
            table = alone(plots, [*radars[:k], radar, *radars[k + 1 :]], k, run)
            if n == 0:
                stated.append(table)
            levels[:, k], histories[:, k] = _noise(table, plots, radar, edges)
            radar = with_noise(radar, levels[0, k])
        found.append(table)
        sensors.append(radar)
    states = common(joint, stated, radars)
    noise = np.array([[radar.range_sigma, radar.azimuth_sigma] for radar in radars])
    places = np.array([radar.position[:2] for radar in radars])
    bias, bias_sigma = _core.register_biases(states.columns(), places, noise)
    factor, factor_sigma = levels / noise
    history, history_sigma = histories / noise[:, np.newaxis]
    unknown = np.isnan(bias)
    value, spread = np.where(unknown, 0.0, bias), np.where(unknown, np.inf, bias_sigma)
    registration = Registration(
        Bias(
            range=value[:, 0],
            azimuth=value[:, 1],
            range_sigma=spread[:, 0],
            azimuth_sigma=spread[:, 1],
        ),
        _by_kind(factor),
        _by_kind(factor_sigma),
        NoiseHistory(edges, _by_kind(history), _by_kind(history_sigma)),
        tuple(sensors),
    )
    return Rounds(registration, stated, found, states)


def with_noise(radar: Radar, sigma: FloatArray) -> Radar:
    """Return the radar with other standard deviations of range and azimuth, where known."""
    range_sigma, azimuth_sigma = np.where(
        np.isfinite(sigma), sigma, [radar.range_sigma, radar.azimuth_sigma]
    )
    return Radar(
        radar.position,
        range_sigma=float(range_sigma),
        azimuth_sigma=float(azimuth_sigma),
        scan_period=radar.scan_period,
        max_range=radar.max_range,
        detection_probability=radar.detection_probability,
        name=radar.name,
    )


def corrected(states: Common, registration: Registration, radars: Sequence[Radar]) -> Common:
    """Return states without biases, and with covariances scaled to the noise of their time.

    The states are from tracks with the noise of the whole recording. Their standard deviations
    along and across the range are scaled to the noise of each period. Unknown biases remain.
    """
    history, whole = registration.history, registration.noise_factor
    which = in_stretches(states.time, history.edges)
    factors = np.empty((len(which), len(radars), 2))
    for axis, kind in enumerate(("range", "azimuth")):
        over_time, level = getattr(history.factor, kind), getattr(whole, kind)
        factors[..., axis] = (over_time / level[:, np.newaxis])[:, which].T
    factors[~np.isfinite(factors)] = 1.0
    bias = np.stack([registration.bias.range, registration.bias.azimuth], axis=-1)
    places = np.array([radar.position[:2] for radar in radars])
    state, covariance = _core.correct_states(states.columns(), places, bias, factors)
    return Common(
        states.time,
        states.track,
        state,
        covariance,
        states.joint_state,
        states.joint_covariance,
    )


def in_stretches(time: FloatArray, edges: FloatArray) -> IntArray:
    """Return the period of each time."""
    return np.clip(np.searchsorted(edges, time, side="right") - 1, 0, len(edges) - 2)


def _by_kind(columns: FloatArray) -> ByKind:
    """Return columns (..., 2) of range and azimuth."""
    range_, azimuth = (np.ascontiguousarray(columns[..., axis]) for axis in range(2))
    return ByKind(range=range_, azimuth=azimuth)


def _edges(plots: Plots, period: float) -> FloatArray:
    """Return the edges of periods, each of several scans."""
    known = plots.time[np.isfinite(plots.time)]
    if not len(known):
        return np.array([0.0, 1.0])
    first, last = float(np.min(known)), float(np.max(known))
    count = int(np.clip((last - first) // (_SCANS * period), 1, _STRETCHES))
    return np.linspace(first, last, count + 1)


def _noise(
    table: TrackTable, plots: Plots, radar: Radar, edges: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return standard deviations of range and azimuth and their errors, (2, 2), and over time."""
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
