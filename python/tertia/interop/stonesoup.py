"""Components for Stone Soup: a tracker, an updater, and Singer's motion model.

`PlotTracker` makes Stone Soup's tracks from its detections by `tertia.tracker`. In trackers made of
Stone Soup's own components, `Updater` updates states by `tertia.fusion`, and `SingerMotion`
predicts them by `tertia.kalman`. The state of a track is `[x, vx, y, vy]` in metres and m/s, with x
to the east and y to the north. Needs the extra `stonesoup`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime, timedelta
from typing import Any

import numpy as np
from stonesoup.base import Property
from stonesoup.models.base import TimeVariantModel
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.measurement.nonlinear import CartesianToBearingRange
from stonesoup.models.transition.linear import (
    CombinedLinearGaussianTransitionModel,
    LinearGaussianTransitionModel,
)
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.tracker import Tracker as TrackerBase
from stonesoup.types.array import CovarianceMatrix, StateVector
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.prediction import GaussianStatePrediction
from stonesoup.types.track import Track
from stonesoup.types.update import GaussianStateUpdate, Update
from stonesoup.updater.kalman import ExtendedKalmanUpdater

from tertia import fusion
from tertia._arrays import FloatArray, instance
from tertia.kalman import SingerModel
from tertia.sensors import Radar
from tertia.tracker import Plots, Tracker, TrackTable

__all__ = ["PlotTracker", "SingerMotion", "Updater", "errors", "plots", "predictor", "radar"]

# x and y are represented by a radar at this distance in metres; an arc of constant range deviates
# from a line by a metre in 20 km
_FAR = 1e8
# indices of the components of a state of Tertia in a state of Stone Soup
_ORDER = [0, 2, 1, 3]


def radar(model: Any, scan_period: float, **options: Any) -> Radar:
    """Return the radar that corresponds to a measurement model.

    Parameters
    ----------
    model : CartesianToBearingRange or LinearGaussian
        A model of range and bearing with uncorrelated errors, or a model of x and y. The latter
        become range and azimuth of a radar at a distance of 1e8 m, along the axes of the
        covariance.
    scan_period : float
        Seconds per rotation of the antenna.
    **options
        As for `tertia.tracker.Radar`.

    Returns
    -------
    tertia.tracker.Radar
        The radar.

    Raises
    ------
    ValueError
        If range and bearing are correlated, or the sensor is tilted.
    TypeError
        If the model is of another kind.

    Examples
    --------
    >>> import numpy as np
    >>> from stonesoup.models.measurement.nonlinear import CartesianToBearingRange
    >>> from tertia.interop.stonesoup import radar
    >>> model = CartesianToBearingRange(4, (0, 2), np.diag([np.radians(0.1) ** 2, 50.0**2]))
    >>> radar(model, 4.0).range_sigma
    50.0
    """
    covariance = np.asarray(model.noise_covar, dtype=np.float64)
    if isinstance(model, CartesianToBearingRange):
        if covariance[0, 1] != 0 or np.any(np.asarray(model.rotation_offset, dtype=float)[:2]):
            raise ValueError(
                "the errors of bearing and range must not be correlated, and the sensor must not "
                "be tilted"
            )
        place = np.asarray(model.translation_offset, dtype=np.float64)[:2, 0]
        azimuth_sigma, range_sigma = np.sqrt(np.diag(covariance)).tolist()
    elif isinstance(model, LinearGaussian) and covariance.shape == (2, 2):
        place = -_FAR * _line_of_sight(model)
        across, range_sigma = np.sqrt(np.linalg.eigvalsh(covariance)).tolist()
        azimuth_sigma = across / _FAR
    else:
        raise TypeError(
            f"the measurement model is a {type(model).__name__}; it must be of bearing and range, "
            "or of x and y"
        )
    noise = {"range_sigma": range_sigma, "azimuth_sigma": azimuth_sigma}
    return Radar(place, scan_period=scan_period, **noise, **options)


def plots(detections: Iterable[Any], models: Sequence[Any], start: datetime) -> Plots:
    """Return detections as plots of radars.

    Parameters
    ----------
    detections : iterable of Detection
        Detections, each with its measurement model.
    models : sequence of measurement models
        Measurement models of all sensors; the sensor of a plot is the index of its model.
    start : datetime
        Instant at which the times of the plots are zero.

    Returns
    -------
    tertia.tracker.Plots
        The plots.

    Raises
    ------
    ValueError
        If a detection has a model that is not among `models`.
    TypeError
        If a model is of a kind that `radar` does not support.

    Examples
    --------
    >>> from datetime import datetime
    >>> import numpy as np
    >>> from stonesoup.models.measurement.nonlinear import CartesianToBearingRange
    >>> from stonesoup.types.detection import Detection
    >>> from tertia.interop.stonesoup import plots
    >>> model = CartesianToBearingRange(4, (0, 2), np.diag([1e-6, 2500.0]))
    >>> start = datetime(2024, 1, 1)
    >>> seen = plots([Detection([0.0, 1e4], start, measurement_model=model)], [model], start)
    >>> np.degrees(seen.azimuth), seen.range
    (array([90.]), array([10000.]))
    """
    rows = [_row(detection, models, start) for detection in detections]
    time, distance, azimuth, index = np.array(rows, dtype=np.float64).reshape(-1, 4).T
    return Plots(time, distance, azimuth, sensor=index.astype(np.int64))


def errors(
    tracks: Iterable[Any], truth: Iterable[Any], mapping: Sequence[int] = (0, 2)
) -> dict[str, FloatArray]:
    """Return tracks and the truth as arguments for `tertia.audit`.

    Parameters
    ----------
    tracks : iterable of Track
        Tracks, or other sequences of Gaussian states.
    truth : iterable of GroundTruthPath
        True paths, with states at the times of the tracks.
    mapping : sequence of int
        Indices of the components of the state that are compared.

    Returns
    -------
    dict
        `error` (N, m), `covariance` (N, m, m), `time` in seconds from the first state, and
        `groups`, the index of the track. A state is compared with the nearest path at its time;
        states at times at which the truth has no state are left out.

    Raises
    ------
    ValueError
        If no state is at a time of the truth.

    Examples
    --------
    >>> from datetime import datetime
    >>> import numpy as np
    >>> from stonesoup.types.groundtruth import GroundTruthPath, GroundTruthState
    >>> from stonesoup.types.state import GaussianState
    >>> from stonesoup.types.track import Track
    >>> from tertia import audit
    >>> from tertia.interop.stonesoup import errors
    >>> now = datetime(2024, 1, 1)
    >>> path = GroundTruthPath([GroundTruthState([0.0, 1.0, 0.0, 1.0], timestamp=now)])
    >>> track = Track([GaussianState([3.0, 1.0, 4.0, 1.0], np.eye(4) * 25.0, timestamp=now)])
    >>> audit(**errors([track], [path])).nees.value
    0.5
    """
    chosen = list(mapping)
    places: dict[datetime, list[FloatArray]] = {}
    for path in truth:
        for state in path:
            there = np.asarray(state.state_vector, dtype=np.float64)[chosen, 0]
            places.setdefault(state.timestamp, []).append(there)
    rows: list[tuple[Any, ...]] = []
    for group, one in enumerate(tracks):
        for state in one:
            if state.timestamp not in places:
                continue
            mean = np.asarray(state.mean, dtype=np.float64).reshape(-1)[chosen]
            off = mean - np.array(places[state.timestamp])
            covariance = np.asarray(state.covar, dtype=np.float64)[np.ix_(chosen, chosen)]
            nearest = off[np.argmin(np.linalg.norm(off, axis=-1))]
            rows.append((nearest, covariance, state.timestamp, group))
    if not rows:
        raise ValueError("no state of the tracks is at a time of the truth")
    first = min(row[2] for row in rows)
    return {
        "error": np.array([row[0] for row in rows]),
        "covariance": np.array([row[1] for row in rows]),
        "time": np.array([(row[2] - first).total_seconds() for row in rows]),
        "groups": np.array([row[3] for row in rows], dtype=np.float64),
    }


def _row(detection: Any, models: Sequence[Any], start: datetime) -> tuple[float, ...]:
    model = detection.measurement_model
    index = next((k for k, known in enumerate(models) if _measures_alike(model, known)), None)
    if index is None:
        raise ValueError("a detection has a measurement model that is not among those given")
    seconds = (detection.timestamp - start).total_seconds()
    first, second = (float(value) for value in detection.state_vector[:, 0])
    if isinstance(model, LinearGaussian):
        line = _line_of_sight(model)
        east, north = np.array([first, second]) + _FAR * line
        return seconds, math.hypot(east, north), math.atan2(east, north), index
    turned = float(np.asarray(model.rotation_offset, dtype=float)[2, 0])
    return seconds, second, math.pi / 2 - (first + turned), index


def _line_of_sight(model: Any) -> FloatArray:
    """Return the direction of the largest error of x and y."""
    vectors: FloatArray = np.linalg.eigh(np.asarray(model.noise_covar, dtype=np.float64))[1]
    return vectors[:, 1]


def _measures_alike(first: Any, second: Any) -> bool:
    if first is second:
        return True
    names = ("noise_covar", "translation_offset", "rotation_offset")
    return type(first) is type(second) and all(
        np.array_equal(getattr(first, name, 0.0), getattr(second, name, 0.0)) for name in names
    )


class PlotTracker(TrackerBase):  # type: ignore[misc]
    """`tertia.tracker.Tracker` with the interface of a Stone Soup tracker.

    Parameters
    ----------
    detector : DetectionReader
        Source of the detections. A step is a scan or part of a scan.
    measurement_models : sequence of measurement models
        Measurement models of all sensors, as for `radar`. Sensors that measure x and y need the
        option `clutter_density`, because the area that they cover is unknown.
    scan_period : float
        Seconds per rotation of the antenna.
    options : mapping, optional
        Options of the tracker, as for `tertia.tracker.Tracker`.

    Notes
    -----
    `tracks` contains the confirmed tracks that have not ended. Each state is an update with its
    detection, or a prediction if a scan missed the target.
    """

    detector: Any = Property(doc="Source of the detections.")
    measurement_models: Any = Property(doc="Measurement models of all sensors.")
    scan_period: Any = Property(doc="Seconds of one antenna rotation.")
    options: Any = Property(default=None, doc="Options of the tracker.")

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        options: dict[str, Any] = dict(self.options or {})
        cartesian = [isinstance(model, LinearGaussian) for model in self.measurement_models]
        if any(cartesian) and options.get("clutter_density") is None:
            raise ValueError(
                "options has no clutter_density; it must have one if a sensor measures x and y"
            )
        radars = [radar(model, self.scan_period) for model in self.measurement_models]
        self._tracker = Tracker(radars, **options)
        self._start: datetime | None = None
        self._detections: list[Any] = []
        self._tracks: dict[int, Any] = {}

    @property
    def tracks(self) -> set[Any]:
        """The current tracks."""
        numbers, _ = self._tracker.extrapolate(0.0)
        return {self._tracks[number] for number in numbers.tolist() if number in self._tracks}

    def __iter__(self) -> Iterator[tuple[datetime, set[Any]]]:
        """Start reading detections."""
        self._steps = iter(self.detector)
        return self

    def __next__(self) -> tuple[datetime, set[Any]]:
        """Process the detections of the next step."""
        time, detections = next(self._steps)
        if self._start is None:
            self._start = time
        seen = sorted(detections, key=lambda detection: detection.timestamp)
        taken = plots(seen, self.measurement_models, self._start)
        self._detections += seen
        until = (time - self._start).total_seconds()
        self._append(self._tracker.update(taken, time=max([until, *taken.time])))
        return time, self.tracks

    def _append(self, table: TrackTable) -> None:
        means = np.hstack([table.position, table.velocity])[:, _ORDER]
        covariances = table.covariance[:, _ORDER][:, :, _ORDER]
        assert self._start is not None
        for row in range(len(table)):
            moment = self._start + timedelta(seconds=float(table.time[row]))
            mean = StateVector(means[row])
            covariance = CovarianceMatrix(covariances[row])
            state = GaussianStatePrediction(mean, covariance, timestamp=moment)
            if table.plot[row] >= 0:
                hypothesis = SingleHypothesis(None, self._detections[table.plot[row]])
                state = GaussianStateUpdate(
                    mean, covariance, timestamp=moment, hypothesis=hypothesis
                )
            self._tracks.setdefault(int(table.track[row]), Track()).append(state)


class SingerMotion(LinearGaussianTransitionModel, TimeVariantModel):  # type: ignore[misc]
    """Motion along one axis by a `tertia.kalman.SingerModel`: position, velocity, acceleration.

    The matrices are computed in closed form, exactly or as printed in the source of the model, and
    are accurate to rounding for any interval.

    Parameters
    ----------
    model : SingerModel
        The motion model; its `dt` is not used.
    """

    model: Any = Property(doc="The correlation of the acceleration.")

    @property
    def ndim_state(self) -> int:
        """Number of components of the state, 3: position, velocity, acceleration."""
        return 3

    def matrix(self, time_interval: timedelta, **kwargs: Any) -> FloatArray:
        """Return the transition matrix F over the interval."""
        return self.model.transition(time_interval.total_seconds())  # type: ignore[no-any-return]

    def covar(self, time_interval: timedelta, **kwargs: Any) -> Any:
        """Return the process noise Q over the interval."""
        return CovarianceMatrix(self.model.process_noise(time_interval.total_seconds()))


def predictor(model: SingerModel, axes: int = 2) -> Any:
    """Return Stone Soup's predictor for a target with the same motion model on each axis.

    Parameters
    ----------
    model : SingerModel
        The motion model; its `dt` is not used.
    axes : int
        Number of axes. The state is position, velocity and acceleration of the first axis, followed
        by those of the next.

    Returns
    -------
    stonesoup.predictor.kalman.KalmanPredictor
        The predictor.

    Raises
    ------
    TypeError
        If the model is of another kind.

    Examples
    --------
    >>> from tertia.interop.stonesoup import predictor
    >>> from tertia.kalman import SingerModel
    >>> predictor(SingerModel(1.0, 0.05, 1.0, exact=True)).transition_model.ndim_state
    6
    """
    instance(model, "model", SingerModel)
    motions = [SingerMotion(model) for _ in range(axes)]
    return KalmanPredictor(CombinedLinearGaussianTransitionModel(motions))


class Updater(ExtendedKalmanUpdater):  # type: ignore[misc]
    """Stone Soup's updater, with the arithmetic of `tertia.fusion.fuse_scalar`.

    The components of a measurement are decorrelated and added one by one by rank-one updates in
    Joseph form, so that covariances stay positive definite and symmetric. Nonlinear measurements
    are linearised as by the `ExtendedKalmanUpdater`.
    """

    def update(self, hypothesis: Any, **kwargs: Any) -> Any:
        """Return the state updated with the measurement of a hypothesis."""
        prediction, measurement = hypothesis.prediction, hypothesis.measurement
        model = self._check_measurement_model(measurement.measurement_model)
        if hypothesis.measurement_prediction is None:
            hypothesis.measurement_prediction = self.predict_measurement(
                prediction, measurement_model=model, **kwargs
            )
        innovation = measurement.state_vector - hypothesis.measurement_prediction.state_vector
        rows = np.column_stack([self._measurement_matrix(prediction, model), innovation])
        root = np.linalg.cholesky(np.asarray(model.covar(), dtype=np.float64))
        independent = np.linalg.solve(root, rows.astype(np.float64))
        change = np.zeros(independent.shape[1] - 1)
        covariance = np.asarray(prediction.covar, dtype=np.float64)
        for *h, z in independent:
            found = fusion.fuse_scalar(change, covariance, h, z, 1.0)
            change, covariance = found.mean, found.covariance
        return Update.from_state(
            prediction,
            (prediction.state_vector + change[:, np.newaxis]).view(StateVector),
            CovarianceMatrix(covariance),
            timestamp=measurement.timestamp,
            hypothesis=hypothesis,
        )
