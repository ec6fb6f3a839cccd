"""Simulated plots of one target from several radars, and named scenarios."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from tertia._arrays import BoolArray, FloatArray, finite, generator, integer
from tertia._result import Result
from tertia.kalman._model import SingerModel, _require_model
from tertia.simulate._parameters import (
    _LARGEST,
    _choice,
    _number,
    _period,
    _require,
    _root,
    _shape,
    _wrap,
)

ScenarioName: TypeAlias = Literal[
    "healthy", "noisy", "outliers", "turn", "known", "unknown", "outage", "asynchronous"
]
_SCENARIO_SIGMA = 0.1
# scans until filters have settled
_SETTLED = 20
# disturbed scans, from the middle on
_DISTURBED_SCANS = {"noisy": np.inf, "outliers": 20, "outage": 8}
# the target that turns: metres per second, metres, radians per second, seconds
_SPEED, _DISTANCE, _TURN_RATE, _TURN_TIME = 200.0, 60e3, np.radians(1.5), 60.0


@dataclass(frozen=True, slots=True, eq=False)
class RadarRecord(Result):
    """Simulated plots of several radars, and the truth.

    Attributes
    ----------
    z : ndarray of shape (..., K, steps)
        Measured angles, wrapped to [0, period) if there is a period; nan where a radar has no plot.
    truth : ndarray of shape (..., steps, 3)
        True angle (not wrapped), rate and acceleration.
    outlier : ndarray of bool, shape (..., K, steps)
        True for outliers.
    """

    _rows: ClassVar = "z", 0

    z: FloatArray
    truth: FloatArray
    outlier: BoolArray


def radars(
    model: SingerModel,
    steps: int,
    *,
    sigma: npt.ArrayLike = (0.1, 0.1),
    detection_probability: npt.ArrayLike = 1.0,
    outlier_probability: npt.ArrayLike = 0.0,
    outlier_size: float = 15.0,
    turn: tuple[int, int, float] | None = None,
    angle: float = 0.0,
    rate: float = 0.0,
    period: float | None = None,
    batch: int | tuple[int, ...] = (),
    rng: np.random.Generator | int | None = None,
) -> RadarRecord:
    """Simulate the plots of several radars that detect the same target.

    Parameters
    ----------
    model : SingerModel
        Model of the motion of the target; each radar has a plot every `model.dt`.
    steps : int
        Number of steps, which is the number of plots of each radar if no plots are missing.
    sigma : array_like of shape (K,) or (K, steps)
        Standard deviation of the noise of each radar, constant or for each step.
    detection_probability : array_like of shape (), (K, 1) or (K, steps)
        Probability that a radar has a plot at a step. It is 0 in an outage, or between the scans of
        a slower radar. False is treated as 0, and True as 1.
    outlier_probability : array_like of shape (), (K, 1) or (K, steps)
        Probability that a plot is an outlier.
    outlier_size : float
        Standard deviation of the errors of an outlier, divided by that of the noise.
    turn : (int, int, float), optional
        First and last step of a turn, and the maximum of the additional rate (angle per unit of
        time) during the turn. As a function of time, this rate is a raised cosine.
    angle, rate : float
        Initial angle and rate of the target.
    period : float, optional
        Period of the angle; plots are wrapped to [0, period). None leaves them unwrapped.
    batch : int or tuple of int
        Shape of the batch of records.
    rng : numpy.random.Generator or int, optional
        Random generator or its seed.

    Returns
    -------
    RadarRecord
        The plots and the truth.

    Raises
    ------
    ValueError, TypeError
        If a parameter is outside its domain or has the wrong type, or shapes do not fit.

    Examples
    --------
    >>> from tertia.kalman import SingerModel
    >>> from tertia.simulate import radars
    >>> radars(SingerModel(5.0, 0.05, 0.003), 120, rng=1).z.shape
    (2, 120)
    """
    _require_model(model)
    steps = integer(steps, "steps", 1)
    period, spread = _period(period), finite(sigma, "sigma")
    _require(spread.ndim in {1, 2} and spread.size > 0, "sigma", spread.shape, "(K,) or (K, steps)")
    count = spread.shape[0]
    spread = _per_step(spread.reshape(count, -1), "sigma", count, steps, high=_LARGEST)
    seen = _per_step(detection_probability, "detection_probability", count, steps)
    wrong = _per_step(outlier_probability, "outlier_probability", count, steps)
    size = _number(outlier_size, "outlier_size", 0)
    random, shape = generator(rng), _shape(batch)
    truth = np.zeros((*shape, steps, 3))
    truth[..., 0, :2] = _number(angle, "angle"), _number(rate, "rate")
    transition, root = model.transition(), _root(model.process_noise())
    truth[..., 0, 2] = model.acceleration_sigma * random.standard_normal(shape)
    for step in range(1, steps):
        push = random.standard_normal((*shape, 3)) @ root.T
        truth[..., step, :] = truth[..., step - 1, :] @ transition.T + push
    if turn is not None:
        truth += _turn(turn, steps, model.dt)
    places = (*shape, count, steps)
    outlier = random.random(places) < wrong
    error = spread * random.standard_normal(places)
    error = np.where(outlier, size * spread * random.standard_normal(places), error)
    z = truth[..., np.newaxis, :, 0] + error
    _wrap(z, period)
    z[random.random(places) >= seen] = np.nan
    return RadarRecord(z, truth, outlier & ~np.isnan(z))


@dataclass(frozen=True, slots=True, eq=False)
class RadarScenario(RadarRecord):
    """Plots of two radars in a scenario, with the truth, and the motion model for filters.

    Attributes
    ----------
    z : ndarray of shape (..., 2, steps)
        Measured angles in degrees, unwrapped; nan where a radar has no plot.
    truth : ndarray of shape (..., steps, 3)
        True angle, rate and acceleration.
    outlier : ndarray of bool, shape (..., 2, steps)
        True for outliers.
    measurement_variance : ndarray of shape (2, 1)
        Variances of the plots as stated by the radars.
    model : SingerModel
        Motion model that filters are to assume.
    counted : ndarray of bool, shape (steps,)
        Steps at which errors are evaluated: those at which filters have settled and radar 1 has a
        scan.
    disturbed : ndarray of bool, shape (steps,)
        Steps during the disturbance or the turn; in "unknown", all steps.
    """

    measurement_variance: FloatArray
    model: SingerModel
    counted: BoolArray
    disturbed: BoolArray


def radar_scenario(
    name: ScenarioName,
    *,
    model: SingerModel | None = None,
    steps: int = 120,
    batch: int | tuple[int, ...] = (),
    rng: np.random.Generator | int | None = None,
) -> RadarScenario:
    """Simulate two radars in one of the scenarios of the documentation.

    Units are degrees and seconds. Unless stated otherwise below, the noise has a sigma of 0.1, and
    both radars state this sigma.

    Parameters
    ----------
    name : str
        "healthy": there is no fault. "noisy": from the middle of the record on, the noise of radar
        2 has five times the stated sigma. "outliers": for 20 scans from the middle of the record
        on, 30 % of the plots of radar 2 are outliers with a standard deviation of 15 sigma. "turn":
        the target approaches at 200 m/s without random acceleration. In the middle of the record,
        60 km away, it turns by 90 degrees at 1.5 degrees per second. "known": sigma is 0.05 for
        radar 1 and 0.2 for radar 2, and both radars state it correctly. "unknown": sigma is 0.05
        for radar 1 and 0.2 for radar 2, but both radars state 0.1. "outage": each plot is present
        with a probability of 0.7, and radar 2 has no plots for 8 scans from the middle of the
        record on. "asynchronous": radar 2 scans half a period after radar 1. There are therefore
        twice as many steps, each of half the length.
    model : SingerModel, optional
        Model of the motion of the target, except in "turn"; each radar scans every `model.dt`. By
        default `SingerModel(5.0, 1 / 20, 0.003)`.
    steps : int
        Number of scans of each radar, at least 40.
    batch, rng
        As for `radars`.

    Returns
    -------
    RadarScenario
        Plots, truth, and the motion model for filters. Errors are evaluated only from scan 20 on.

    Raises
    ------
    ValueError, TypeError
        If the scenario is unknown, there are fewer than 40 scans, or a parameter is outside its
        domain or has the wrong type.

    Examples
    --------
    >>> from tertia.fusion import fuse_series
    >>> from tertia.metrics import rmse
    >>> from tertia.simulate import radar_scenario
    >>> s = radar_scenario("noisy", batch=200, rng=1)
    >>> for method in ("equal", "adaptive"):
    ...     track = fuse_series(s.z, s.measurement_variance, s.model, method=method)
    ...     error = track.mean - s.truth
    ...     print(f"{method}: {rmse(error[:, s.counted, 0]):.3f}")
    equal: 0.173
    adaptive: 0.081
    """
    _choice(name, "name", get_args(ScenarioName))
    model = SingerModel(5.0, 1 / 20, 0.003) if model is None else model
    _require_model(model)
    steps = integer(steps, "steps", 2 * _SETTLED)
    since = np.arange(float(steps)) - steps // 2
    counted, disturbed = np.arange(steps) >= _SETTLED, _disturbed(name, since, model.dt)
    second = disturbed & [[False], [True]]
    stated = np.full((2, 1), _SCENARIO_SIGMA)
    motion, options = model, dict[str, Any](sigma=stated)
    if name == "noisy":
        options["sigma"] = _SCENARIO_SIGMA * np.where(second, 5.0, 1.0)
    elif name == "outliers":
        options["outlier_probability"] = 0.3 * second
    elif name == "turn":
        motion = replace(model, acceleration_sigma=0.0)
    elif name == "known":
        stated = options["sigma"] = np.array([[0.05], [0.2]])
    elif name == "unknown":
        options["sigma"] = np.array([[0.05], [0.2]])
    elif name == "outage":
        options["detection_probability"] = 0.7 * ~second
    elif name == "asynchronous":
        model = motion = replace(model, dt=model.dt / 2)
        scans = np.arange(2 * steps) % 2 == [[0], [1]]
        options["detection_probability"] = scans
        counted, disturbed = np.repeat(counted, 2) & scans[0], np.repeat(disturbed, 2)
        steps *= 2
    record = radars(motion, steps, batch=batch, rng=rng, **options)
    if name == "turn":
        path = _right_angle(since * model.dt)
        record.truth[:] = path
        record.z[:] += path[:, 0]
    return RadarScenario(
        record.z, record.truth, record.outlier, stated**2, model, counted, disturbed
    )


def _disturbed(name: ScenarioName, since: FloatArray, dt: float) -> BoolArray:
    """Return which scans are disturbed; `since` is the number of scans since the middle one."""
    if name == "unknown":
        return np.ones(since.shape, dtype=bool)
    scans = _DISTURBED_SCANS.get(name, 0.0)
    return (since >= 0) & (since * dt < _TURN_TIME if name == "turn" else since < scans)


def _right_angle(time: FloatArray) -> FloatArray:
    """Return angle, rate and acceleration of the turning target; the turn begins at time 0."""
    turned = np.clip(time, 0.0, _TURN_TIME)
    # north and east as real and imaginary part; the course is south at first
    velocity = -_SPEED * np.exp(1j * _TURN_RATE * turned)
    place = _DISTANCE + (velocity + _SPEED) / (1j * _TURN_RATE) + velocity * (time - turned)
    turns = (time >= 0) & (time < _TURN_TIME)
    # the angle is the imaginary part of log(place)
    slope = velocity / place
    bend = np.where(turns, 1j * _TURN_RATE * velocity, 0.0) / place - slope**2
    path: FloatArray = np.degrees(np.stack([np.angle(place), slope.imag, bend.imag], axis=-1))
    return path


def _per_step(
    value: npt.ArrayLike, name: str, count: int, steps: int, high: float = 1.0
) -> FloatArray:
    array = finite(_numbers(value), name)
    inside = (array >= 0) & (array <= high)
    _require(bool(np.all(inside)), name, array.tolist(), f"between 0 and {high:g}")
    try:
        return np.broadcast_to(array, (count, steps))
    except ValueError:
        raise ValueError(
            f"{name} has shape {array.shape}; it must fit {count} radars and {steps} steps"
        ) from None


def _numbers(value: npt.ArrayLike) -> npt.ArrayLike:
    """Return booleans as 0 and 1, and other values unchanged."""
    try:
        array = np.asanyarray(value)
    except ValueError:
        return value
    is_flag = array.dtype == np.bool_ or (
        array.dtype == np.object_ and all(isinstance(one, (bool, np.bool_)) for one in array.flat)
    )
    return array.astype(np.float64) if is_flag else value


def _turn(turn: tuple[int, int, float], steps: int, dt: float) -> FloatArray:
    """Return the angle, rate and acceleration that a turn adds to the motion."""
    try:
        first, last, added = turn
    except (TypeError, ValueError):
        raise TypeError(f"turn is {turn!r}; it must be (first step, last step, rate)") from None
    first, last = integer(first, "turn", 0), integer(last, "turn", 0)
    _require(first < last, "turn", turn, "a pair of rising steps and a rate")
    top = _number(added, "turn")
    elapsed = np.clip(np.arange(steps) - first, 0, last - first) * dt
    length = (last - first) * dt
    phase = 2 * np.pi * elapsed / length
    angle = top * (elapsed - length / (2 * np.pi) * np.sin(phase)) / 2
    rate = top * (1 - np.cos(phase)) / 2
    acceleration = top * np.pi / length * np.sin(phase)
    return np.stack([angle, rate, acceleration], axis=-1)
