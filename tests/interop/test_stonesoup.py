"""Stone Soup: its detections in our tracker, our updater and motion in its trackers."""

from datetime import datetime, timedelta

import numpy as np
import pytest

pytest.importorskip("stonesoup")

from stonesoup.dataassociator.neighbour import GlobalNearestNeighbour, NearestNeighbour
from stonesoup.deleter.time import UpdateTimeStepsDeleter
from stonesoup.hypothesiser.distance import DistanceHypothesiser
from stonesoup.initiator.simple import SimpleMeasurementInitiator
from stonesoup.measures import Mahalanobis
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.measurement.nonlinear import (
    Cartesian2DToBearing,
    CartesianToBearingRange,
)
from stonesoup.models.transition.linear import (
    CombinedLinearGaussianTransitionModel,
    ConstantVelocity,
    Singer,
)
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.tracker.simple import MultiTargetTracker, SingleTargetTracker
from stonesoup.types.detection import Detection
from stonesoup.types.groundtruth import GroundTruthPath, GroundTruthState
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.prediction import GaussianStatePrediction
from stonesoup.types.state import GaussianState
from stonesoup.types.track import Track
from stonesoup.types.update import GaussianStateUpdate
from stonesoup.updater.kalman import ExtendedKalmanUpdater, KalmanUpdater

from tertia import audit
from tertia.interop.stonesoup import (
    PlotTracker,
    SingerMotion,
    Updater,
    errors,
    plots,
    predictor,
    radar,
)
from tertia.kalman import SingerModel
from tertia.tracker import Plots, Radar, Tracker

START = datetime(2024, 1, 1)
PERIOD = 4.0
NEARLY_STRAIGHT = CombinedLinearGaussianTransitionModel([ConstantVelocity(0.5)] * 2)
POSITION = LinearGaussian(4, (0, 2), np.array([[400.0, 120.0], [120.0, 900.0]]))


def truth(time, target):
    """Targets that fly apart."""
    angle = 0.5 + 2.0 * target
    return (20e3 + 200.0 * time) * np.array([np.cos(angle), np.sin(angle)])


def scans(model, targets=2, steps=30, seed=1, missed=0.1, phase=0.0):
    rng = np.random.default_rng(seed)
    for step in range(steps):
        seconds = PERIOD * step + phase
        time = START + timedelta(seconds=seconds)
        seen = set()
        for target in range(targets):
            if rng.random() < missed:
                continue
            state = np.zeros((model.ndim_state, 1))
            state[list(model.mapping), 0] = truth(seconds, target)
            noise = np.linalg.cholesky(model.covar()) @ rng.standard_normal((2, 1))
            mean = model.function(GaussianState(state, np.eye(len(state))), noise=noise)
            seen.add(Detection(mean, time, measurement_model=model))
        yield time, seen


def polar(place=(0.0, 0.0), turned=0.0):
    return CartesianToBearingRange(
        4,
        (0, 2),
        np.diag([np.radians(0.1) ** 2, 50.0**2]),
        translation_offset=np.array([[place[0]], [place[1]]]),
        rotation_offset=np.array([[0.0], [0.0], [turned]]),
    )


def states(tracks):
    """Means and covariances of all states, in the order of the tracks' first positions."""
    ordered = sorted(tracks, key=lambda t: t[0].state_vector[0])
    return [
        (np.array(s.state_vector, dtype=float)[:, 0], np.array(s.covar), type(s).__name__)
        for one in ordered
        for s in one
    ]


def run(predictor_, updater, model, tracker, initiator):
    hypothesiser = DistanceHypothesiser(predictor_, updater, Mahalanobis(), 5.0)
    kind = {SingleTargetTracker: NearestNeighbour, MultiTargetTracker: GlobalNearestNeighbour}
    parts = {
        "initiator": initiator,
        "deleter": UpdateTimeStepsDeleter(5),
        "data_associator": kind[tracker](hypothesiser),
        "updater": updater,
    }
    targets = 1 if tracker is SingleTargetTracker else 2
    made = tracker(detector=list(scans(model, targets)), **parts)
    found = set()
    for _, tracks in made:
        found |= tracks
    return states(found)


def assert_same(found, expected, count):
    assert len(found) == len(expected) >= count
    assert sum(name == "GaussianStateUpdate" for *_, name in found) > 0.7 * count
    for (mean, covariance, kind), (m, c, k) in zip(found, expected, strict=True):
        assert kind == k
        sigma = np.sqrt(np.diag(c))
        np.testing.assert_allclose(mean / sigma, m / sigma, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(
            covariance / np.outer(sigma, sigma), c / np.outer(sigma, sigma), atol=1e-9
        )


@pytest.mark.parametrize("tracker", [SingleTargetTracker, MultiTargetTracker])
class TestTheirTrackers:
    def test_the_updater_gives_the_states_of_theirs(self, tracker):
        initiator = SimpleMeasurementInitiator(
            GaussianState([0, 0, 0, 0], np.diag([0, 300**2, 0, 300**2])), POSITION
        )
        theirs, ours = (
            run(KalmanPredictor(NEARLY_STRAIGHT), updater, POSITION, tracker, initiator)
            for updater in (KalmanUpdater(POSITION), Updater(POSITION))
        )
        assert_same(ours, theirs, 28 if tracker is SingleTargetTracker else 56)

    def test_the_motion_gives_the_states_of_theirs(self, tracker):
        alpha, sigma = 0.05, 2.0
        model = LinearGaussian(6, (0, 3), np.diag([400.0, 900.0]))
        initiator = SimpleMeasurementInitiator(
            GaussianState([0] * 6, np.diag([0, 300**2, 9, 0, 300**2, 9])), model
        )
        theirs = CombinedLinearGaussianTransitionModel([Singer(2 * alpha * sigma**2, alpha)] * 2)
        ours = predictor(SingerModel(1.0, alpha, sigma, exact=True))
        expected = run(KalmanPredictor(theirs), KalmanUpdater(model), model, tracker, initiator)
        found = run(ours, Updater(model), model, tracker, initiator)
        assert_same(found, expected, 28 if tracker is SingleTargetTracker else 56)


def test_a_measurement_that_is_not_linear_updates_as_theirs():
    model = polar((3e3, -2e3), 0.4)
    rng = np.random.default_rng(2)
    for _ in range(20):
        mean = rng.normal([20e3, 100, -15e3, 50], 100.0)
        root = rng.normal(size=(4, 4)) * np.array([[300.0], [20.0], [300.0], [20.0]])
        state = GaussianState(mean, root @ root.T, timestamp=START)
        (seen,) = next(scans(model, 1, missed=0.0))[1]
        seen.state_vector = model.function(state) + np.array([[1e-3], [40.0]])
        both = [
            updater.update(SingleHypothesis(state_of_prediction(state), seen))
            for updater in (ExtendedKalmanUpdater(model, use_joseph_cov=True), Updater(model))
        ]
        sigma = np.sqrt(np.diag(both[0].covar))
        off = np.array(both[1].state_vector - both[0].state_vector, dtype=float)[:, 0]
        np.testing.assert_allclose(off / sigma, 0.0, atol=1e-9)
        difference = np.array(both[1].covar - both[0].covar) / np.outer(sigma, sigma)
        np.testing.assert_allclose(difference, 0.0, atol=1e-9)


def state_of_prediction(state):
    return GaussianStatePrediction(state.state_vector, state.covar, timestamp=START)


def test_the_motion_is_that_of_the_library():
    model = SingerModel(1.0, 0.02, 3.0, exact=True)
    motion = SingerMotion(model)
    interval = timedelta(seconds=2.5)
    assert np.array_equal(motion.matrix(time_interval=interval), model.transition(2.5))
    assert np.array_equal(motion.covar(time_interval=interval), model.process_noise(2.5))
    assert motion.ndim_state == 3
    with pytest.raises(TypeError, match="it must be a SingerModel"):
        predictor(NEARLY_STRAIGHT)


class TestPlots:
    @pytest.mark.parametrize("model", [polar((5e3, 7e3), 0.3), POSITION])
    def test_are_where_the_detections_are(self, model):
        _, seen = next(scans(model, missed=0.0))
        detections = sorted(seen, key=lambda d: float(d.state_vector[1, 0]))
        taken = plots(detections, [POSITION, model], START)
        (place,) = (radar(model, PERIOD).position,)
        direction = np.stack([np.sin(taken.azimuth), np.cos(taken.azimuth)], axis=-1)
        found = place + taken.range[:, np.newaxis] * direction
        expected = [
            (model.inverse_function(d) if model is not POSITION else d.state_vector)[
                list(model.mapping) if model is not POSITION else [0, 1], 0
            ]
            for d in detections
        ]
        np.testing.assert_allclose(found, np.array(expected, dtype=float), atol=1e-6)
        assert taken.sensor.tolist() == [0 if model is POSITION else 1] * 2
        assert np.array_equal(taken.time, [0.0, 0.0])

    def test_a_far_radar_has_the_covariance_of_x_and_y(self):
        one = radar(POSITION, PERIOD)
        offset = np.array([30e3, -20e3]) - one.position
        plot = Plots([0.0], [np.hypot(*offset)], [np.arctan2(*offset)])
        _, covariance = plot.to_cartesian([one])
        np.testing.assert_allclose(covariance[0], POSITION.covar(), rtol=2e-3)

    def test_mistakes(self):
        _, seen = next(scans(POSITION, missed=0.0))
        with pytest.raises(ValueError, match="not among those given"):
            plots(seen, [polar()], START)
        with pytest.raises(TypeError, match="Cartesian2DToBearing; it must be of bearing and"):
            radar(Cartesian2DToBearing(4, (0, 2), np.array([[1.0]])), PERIOD)
        tilted = CartesianToBearingRange(
            4, (0, 2), np.eye(2), rotation_offset=np.array([[0.1], [0.0], [0.0]])
        )
        with pytest.raises(ValueError, match="the sensor must not be tilted"):
            radar(tilted, PERIOD)


class TestOurTracker:
    def test_tracks_are_those_of_the_library(self):
        models = [polar(), polar((30e3, 10e3))]
        steps = [
            step
            for k, model in enumerate(models)
            for step in scans(model, seed=k, phase=k * PERIOD / 2)
        ]
        steps.sort(key=lambda step: step[0])
        made = PlotTracker(steps, models, PERIOD)
        counts = [len(tracks) for _, tracks in made]
        assert counts[0] == 0
        assert counts[-1] == 2
        radars = [
            Radar(place, range_sigma=50.0, azimuth_sigma=np.radians(0.1), scan_period=PERIOD)
            for place in ((0.0, 0.0), (30e3, 10e3))
        ]
        library = Tracker(radars)
        expected = set()
        for time, seen in steps:
            until = (time - START).total_seconds()
            rows = library.update(plots(seen, models, START), time=until)
            expected |= set(
                zip(rows.time.round(6), *rows.position.T, *rows.velocity.T, strict=True)
            )
        found = {
            ((s.timestamp - START).total_seconds(), *s.state_vector[[0, 2, 1, 3], 0])
            for one in made.tracks
            for s in one
        }
        assert len(found) > 90
        assert found == expected
        updates = [s for one in made.tracks for s in one if isinstance(s, GaussianStateUpdate)]
        assert len(updates) > 90
        for state in updates:
            place = state.hypothesis.measurement.measurement_model.inverse_function(
                state.hypothesis.measurement
            )
            off = np.hypot(*(np.array(place - state.state_vector, dtype=float)[[0, 2], 0]))
            assert off < 500.0

    def test_errors_are_as_large_as_told(self):
        made = PlotTracker(
            list(scans(POSITION, steps=60)), [POSITION], PERIOD, {"clutter_density": 1e-10}
        )
        *_, (_, tracks) = made
        assert len(tracks) == 2
        nees = []
        for one in tracks:
            last = [s for s in one if (s.timestamp - START).total_seconds() > 40]
            target = min(
                range(2),
                key=lambda k: abs(float(last[0].state_vector[0, 0]) - truth(44.0, k)[0]),
            )
            for state in last:
                place = truth((state.timestamp - START).total_seconds(), target)
                error = np.array(state.state_vector, dtype=float)[[0, 2], 0] - place
                covariance = np.array(state.covar)[np.ix_([0, 2], [0, 2])]
                nees.append(error @ np.linalg.solve(covariance, error))
        assert 0.7 < np.mean(nees) < 2.6

    def test_a_target_that_is_gone_has_no_track(self):
        steps = list(scans(polar(), steps=20))
        nothing = [(START + timedelta(seconds=PERIOD * k), set()) for k in range(20, 32)]
        made = PlotTracker(steps + nothing, [polar()], PERIOD)
        counts = [len(tracks) for _, tracks in made]
        assert counts[19] == 2
        assert counts[-1] == 0

    def test_positions_need_a_density_of_clutter(self):
        with pytest.raises(ValueError, match="options has no clutter_density"):
            PlotTracker([], [POSITION], PERIOD)


def test_tracks_and_truth_are_the_arguments_of_an_audit():
    """Each state belongs to the nearest path at its time; others are left out."""
    rng = np.random.default_rng(1)
    paths, tracks = [], []
    for target in range(2):
        moments = [START + timedelta(seconds=PERIOD * step) for step in range(60)]
        places = [
            np.array([x, 1.0, y, 1.0]) for x, y in (truth(PERIOD * k, target) for k in range(60))
        ]
        states = zip(places, moments, strict=True)
        paths.append(GroundTruthPath([GroundTruthState(p, timestamp=t) for p, t in states]))
        later = moments[-1] + timedelta(seconds=1)
        seen = [
            GaussianState(p + rng.normal(0, 30.0, 4), np.eye(4) * 900.0, timestamp=t)
            for p, t in zip([*places, places[-1]], [*moments, later], strict=True)
        ]
        tracks.append(Track(seen))
    found = audit(**errors(tracks, paths))
    assert found.count == 120
    assert found.verdict == "honest"
    with pytest.raises(ValueError, match="no state of the tracks is at a time of the truth"):
        errors([], paths)
