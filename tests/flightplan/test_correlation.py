"""Which plan a track flies."""

import numpy as np
import pytest
from checks import NAN
from flightplan.cases import plan, tracked
from reference import flightplan as reference

from tertia.flightplan import (
    CorrelationStatus,
    FlightPlan,
    correlate,
)


class TestCorrelation:
    def test_the_score_by_its_formula(self):
        rng = np.random.default_rng(4)
        one = FlightPlan([[0, 0], [3e5, 0]], 220.0, heights=9000.0)
        times = np.array([400.0])
        position = np.array([[9e4, -800.0]])
        velocity = 215 * np.array([[np.cos(0.05), np.sin(0.05)]])
        root = rng.normal(size=(4, 4)) * [[100], [100], [3], [3]]
        covariance = (root @ root.T)[np.newaxis]
        found = correlate([one], times, position, velocity, covariance=covariance, height=[9100.0])
        u, n = velocity[0] / 215, np.array([-velocity[0, 1], velocity[0, 0]]) / 215
        expected = reference.score(
            800.0, 0.05, 5.0, 400 - 9e4 / 220, 100.0,
            p=n @ covariance[0, :2, :2] @ n,
            psi_variance=n @ covariance[0, 2:, 2:] @ n / 215**2,
            v_variance=u @ covariance[0, 2:, 2:] @ u,
        )  # fmt: skip
        assert found.scores[0] == pytest.approx(expected, rel=1e-9)
        without = correlate([one], times, position, velocity).scores[0]
        expected = reference.score(800.0, 0.05, 5.0, 400 - 9e4 / 220)
        assert without == pytest.approx(expected, rel=1e-9)

    def test_the_mean_over_plots_without_gaps(self):
        one = plan()
        times = np.array([10.0, 20.0, NAN, 40.0, 50.0, 60.0])
        position, velocity = one.at(np.arange(10.0, 70.0, 10.0))
        position[0, 0] += 700.0
        found = correlate([one], times, position, velocity)
        assert found.scores[0] == pytest.approx(-0.5 / 5, rel=1e-9)
        assert (found.plan, found.status) == (0, CorrelationStatus.ACCEPTED)
        short = correlate([one], times[:4], position[:4], velocity[:4])
        assert (short.plan, short.status) == (-1, CorrelationStatus.AMBIGUOUS)
        nothing = correlate([one], times[2:3], position[2:3], velocity[2:3])
        assert np.isnan(nothing.scores[0])
        assert nothing.status == CorrelationStatus.NONE

    def test_identity(self):
        plans = [plan(identity=5), plan(identity=6), plan()]
        times = np.arange(10.0, 70.0, 10.0)
        position, velocity = plans[0].at(times)

        def decided(identity, moved=0.0):
            found = correlate(plans, times, position + moved, velocity, identity=identity)
            return found.plan, found.status

        assert decided(6) == (1, CorrelationStatus.LINKED)
        # an identity that no plan has is none
        assert decided(-1) == decided(8) == (-1, CorrelationStatus.AMBIGUOUS)
        assert decided(6, 3000.0) == (1, CorrelationStatus.LINKED)
        assert decided(6, 6000.0) == (-1, CorrelationStatus.NONE)

    @pytest.mark.parametrize("n_threads", [1, 3])
    def test_batches(self, n_threads):
        plans = [FlightPlan([[0, y], [9e4, y]], 200.0) for y in (0, 2e4, 4e4)]
        times = np.arange(100.0, 150.0, 10.0)
        order = np.array([[0, 2], [1, 1], [2, 0]])
        states = [np.stack([plans[k].at(times)[i] for k in order.flat]) for i in (0, 1)]
        states = [state.reshape(3, 2, 5, 2) for state in states]
        instants = np.broadcast_to(times, (3, 2, 5))
        found = correlate(plans, instants, *states, n_threads=n_threads)
        np.testing.assert_array_equal(found.plan, order)
        assert found.scores.shape == (3, 2, 3)
        assert repr(found) == "Correlation(0 none, 0 ambiguous, 6 accepted, 0 linked)"

    @pytest.mark.parametrize(
        ("live", "known", "least", "wrong"),
        [
            (20, True, 0.94, 0.004),
            (40, True, 0.88, 0.004),
            (80, True, 0.80, 0.004),
            (20, False, 0.70, 0.008),
            (40, False, 0.50, 0.008),
            (80, False, 0.25, 0.008),
        ],
    )
    def test_identification(self, live, known, least, wrong):
        """Ten shared routes, five scans; those that are not identified are ambiguous."""
        correct = mistaken = total = 0
        for trial in range(1600 // live):
            plans, states = shared_routes(live, np.random.default_rng([5, live, trial]))
            heights = states.pop("height")
            found = correlate(plans, **states, height=heights if known else None)
            correct += np.count_nonzero(found.plan == np.arange(live))
            mistaken += np.count_nonzero((found.plan >= 0) & (found.plan != np.arange(live)))
            total += live
        assert correct / total > least
        assert mistaken / total <= wrong


def shared_routes(live, rng, scan=10.0):
    """Plans on ten routes of 700 km, and five scans of every flight, somewhere on its way."""
    routes = []
    for _ in range(10):
        course, start = rng.uniform(0, 2 * np.pi), rng.uniform(-2e5, 2e5, 2)
        courses = course + np.cumsum(rng.uniform(-0.5, 0.5, 7))
        legs = 1e5 * np.stack([np.sin(courses), np.cos(courses)], axis=-1)
        routes.append(start + np.concatenate([[[0, 0]], np.cumsum(legs, axis=0)]))
    plans, tracks = [], []
    now = scan * np.arange(5)
    for k in range(live):
        route, speed = routes[rng.integers(10)], rng.normal(220.0, 12.0)
        height = 300.0 * rng.integers(29, 42)
        flown = rng.uniform(0.05, 0.95) * 7e5 / speed
        one = FlightPlan(route, speed, start_time=-flown, heights=height, name=f"{k}")
        plans.append(one)
        # late or early by half a minute, 5 m/s off the plan
        late = rng.normal(0, 30.0)
        true = speed + rng.normal(0, 5.0)
        actual = FlightPlan(route, true, start_time=-(flown - late) * speed / true)
        position, velocity, covariance = tracked(
            actual, now, rng, aside=rng.normal(0, 300.0), position_sigma=100.0, velocity_sigma=4.0
        )
        tracks.append((now, position, velocity, covariance, height + rng.normal(0, 15.0, 5)))
    keys = ("time", "position", "velocity", "covariance", "height")
    return plans, dict(zip(keys, map(np.stack, zip(*tracks, strict=True)), strict=True))
