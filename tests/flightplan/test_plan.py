"""Paths of plans: vectors, formulas, hard routes, bad input."""

import pickle

import numpy as np
import pytest
from flightplan.cases import START, WAY, plan
from reference import flightplan as reference
from tolerances import PARITY

from tertia.flightplan import (
    FlightPlan,
)


class TestTurns:
    def test_vector(self):
        turns = plan().turns
        assert turns.radius[0] == pytest.approx(10584.0562223249, abs=1e-9)
        assert np.degrees(220 / turns.radius[0]) == pytest.approx(1.1909490301, abs=1e-10)
        assert turns.angle[0] == pytest.approx(np.pi / 3, abs=1e-15)
        assert turns.lead[0] == pytest.approx(6110.7077090774, abs=1e-9)
        assert turns.arc[0] == pytest.approx(11083.5977577458, abs=1e-9)
        assert turns.arc[0] / 220 == pytest.approx(50.3799898079, abs=1e-10)
        np.testing.assert_allclose(turns.start, [[0, START]], rtol=0, atol=1e-9)
        expected = [[5292.0281111625, 53055.3538545387]]
        np.testing.assert_allclose(turns.end, expected, rtol=0, atol=1e-9)
        assert plan(80.0).turns.radius[0] == pytest.approx(1527.8874536822, abs=1e-9)

    @pytest.mark.parametrize(
        ("s", "position", "course"),
        [
            (3000, (422.3288812817, 46849.2827577366), 16.2402140473),
            (8000, (2882.1854055266, 51149.0052355702), 43.3072374595),
            (13000, (6951.6811368241, 54013.5549756658), 60.0),
        ],
    )
    def test_vector_of_the_path(self, s, position, course):
        found, bearing = plan().path(START + s)
        np.testing.assert_allclose(found, position, rtol=0, atol=1e-9)
        assert np.degrees(bearing) == pytest.approx(course, abs=1e-10)

    @pytest.mark.parametrize(
        ("position", "s", "offset"),
        [
            ((500, 46000), 2183.8354898468, 281.4702882903),
            ((2500, 49500), 6421.5466595637, 743.7307194561),
        ],
    )
    def test_vector_of_the_projection(self, position, s, offset):
        found = plan().project(position)
        assert found.along_track - START == pytest.approx(s, abs=1e-9)
        # inside of a turn to the right
        assert found.cross_track == pytest.approx(offset, abs=1e-9)

    @pytest.mark.parametrize("degrees", [-140, -60, -5, 3, 30, 90, 120])
    @pytest.mark.parametrize("speed", [60.0, 150.0, 250.0])
    def test_parity(self, degrees, speed):
        angle = np.radians(degrees)
        corner = np.array([2e4, 5e4])
        u1 = reference.unit(corner)
        u2 = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ u1
        points = [np.zeros(2), corner, corner + 8e4 * u2]
        expected = reference.turn(*points, speed)
        one = FlightPlan(points, speed)
        turns = one.turns
        assert turns.angle[0] == pytest.approx(-expected["th"], abs=1e-12)
        for key in ("radius", "lead", "arc"):
            assert getattr(turns, key)[0] == pytest.approx(expected[key], rel=PARITY)
        for key in ("start", "end", "centre"):
            np.testing.assert_allclose(getattr(turns, key)[0], expected[key], rtol=0, atol=1e-6)
        begin = np.hypot(*expected["start"])
        for s in np.linspace(-9e3, expected["arc"] + 9e3, 41):
            position, bearing = one.path(begin + s)
            place, course = reference.at(expected, s)
            np.testing.assert_allclose(position, place, rtol=0, atol=1e-6)
            assert np.abs(np.angle(np.exp(1j * (bearing - np.pi / 2 + course)))) < 1e-9
        near = np.random.default_rng(1).normal(size=(200, 2)) * 3000 + expected["start"]
        found = one.project(near)
        for p, distance, offset in zip(near, found.along_track, found.cross_track, strict=True):
            s, e = reference.project(expected, p)
            # the nearest point of all is not farther than that of the rule by the bisector
            assert abs(offset) <= e + 1e-6
            if abs(abs(offset) - e) < 1e-6:
                assert distance - begin == pytest.approx(s, abs=1e-5)

    def test_passing_times(self):
        times = FlightPlan(WAY, 210.0, start_time=50.0).times
        expected = 50 + reference.passing_times(WAY, 210.0)
        np.testing.assert_allclose(times, expected, rtol=PARITY)

    def test_waypoints_are_passed_in_the_middle_of_their_arcs(self):
        one = FlightPlan(WAY, [200, 210, 190, 230, 180.0], start_time=1e4)
        position, _ = one.at(one.times)
        turns = one.turns
        to_waypoint = WAY[1:-1] - turns.centre
        to_waypoint /= np.linalg.norm(to_waypoint, axis=1, keepdims=True)
        middle = turns.centre + turns.radius[:, np.newaxis] * to_waypoint
        np.testing.assert_allclose(position[1:-1], middle, rtol=0, atol=1e-6)
        np.testing.assert_allclose(position[[0, -1]], WAY[[0, -1]], rtol=0, atol=1e-6)
        assert one.length == pytest.approx(one.distances[-1], rel=1e-15)
        np.testing.assert_allclose(np.diff(one.distances) / np.diff(one.times), one.speeds)

    def test_velocities_are_derivatives(self):
        one = FlightPlan(WAY, 210.0)
        times = np.linspace(-50, one.times[-1] + 50, 400)
        difference = (one.at(times + 0.01)[0] - one.at(times - 0.01)[0]) / 0.02
        np.testing.assert_allclose(one.at(times)[1], difference, rtol=0, atol=0.02)

    def test_given_times_are_kept(self):
        times = [100.0, 420.0, 650.0, 1200.0, 1500.0, 1900.0]
        one = FlightPlan(WAY, times=times)
        np.testing.assert_allclose(one.times, times, rtol=0, atol=1e-6)
        assert one.start_time == 100.0

    def test_given_times_are_kept_in_sharp_turns_after_short_legs(self):
        times = np.array([0.0, 15.0, 30.0])
        plan = FlightPlan([[0, 0], [0, 3e3], [500, 100]], times=times, bank=0.4)
        assert plan.times == pytest.approx(times, abs=1e-9)

    def test_turn_radius(self):
        one = FlightPlan(WAY, [200, 180, 190, 150, 180.0], turn_radius=5000.0)
        assert one.turns.radius.max() == pytest.approx(5000.0, rel=1e-12)
        assert one.turns.radius[0] == pytest.approx(5000.0, rel=1e-12)
        small = FlightPlan(WAY, 200.0, turn_radius=900.0)
        np.testing.assert_allclose(small.turns.radius, 900.0, rtol=1e-12)
        timed = FlightPlan(WAY, times=[0, 300, 600, 1100, 1400, 1800], turn_radius=5000.0)
        assert timed.turns.radius.max() == pytest.approx(5000.0, rel=1e-6)
        np.testing.assert_allclose(timed.times, [0, 300, 600, 1100, 1400, 1800], atol=1e-6)

    def test_heights(self):
        one = FlightPlan(WAY, 200.0, heights=np.arange(6) * 1000.0)
        np.testing.assert_allclose(one.height(one.times), one.heights, atol=1e-9)
        assert one.height(one.times[:2].mean()) == pytest.approx(500.0)
        assert one.height(-100.0) == 0.0
        assert np.isnan(plan().height(3.0))

    def test_shapes(self):
        one = plan()
        position, velocity = one.at(5.0)
        assert position.shape == velocity.shape == (2,)
        position, velocity = one.at(np.zeros((3, 4)))
        assert position.shape == velocity.shape == (3, 4, 2)
        assert isinstance(one.path(3.0)[1], float)
        found = one.project(np.zeros((3, 4, 2)))
        assert found.along_track.shape == found.cross_track.shape == found.course.shape == (3, 4)
        assert isinstance(one.project([0, 1]).leg, int)
        assert one.at(np.zeros(0))[0].shape == (0, 2)

    def test_it_can_be_sent_to_another_process(self):
        again = pickle.loads(pickle.dumps(plan(identity=7)))
        assert again.length == plan().length
        assert again.identity == 7


class TestHardRoutes:
    @pytest.mark.parametrize("degrees", [150.0, 165.0, 179.9, 180.0, -180.0, -179.0])
    def test_hairpins(self, degrees):
        angle = np.radians(degrees)
        after = np.array([0, 5e4]) + 4e4 * np.array([np.sin(angle), np.cos(angle)])
        one = FlightPlan([[0, 0], [0, 5e4], after], 220.0)
        turns = one.turns
        lead = 10584.0562223249 * np.tan(np.radians(75))
        assert turns.lead[0] == pytest.approx(min(lead, 4e4), rel=1e-9)
        times = np.linspace(-100, one.times[-1] + 100, 3000)
        position, velocity = one.at(times)
        assert np.isfinite(position).all()
        assert np.isfinite(velocity).all()
        step = np.linalg.norm(np.diff(position, axis=0), axis=1)
        assert step.max() <= 220 * (times[1] - times[0]) * (1 + 1e-9)
        np.testing.assert_allclose(one.project(position).cross_track, 0, atol=1e-6)

    def test_neighbouring_turns_share_a_short_leg(self):
        one = FlightPlan([[0, 0], [0, 4e4], [1e4, 4e4], [1e4, 8e4]], 250.0)
        np.testing.assert_allclose(one.turns.lead, 5000.0, rtol=1e-12)
        np.testing.assert_allclose(one.turns.radius, 5000.0, rtol=1e-12)

    def test_random_routes_are_continuous(self):
        rng = np.random.default_rng(3)
        for _ in range(50):
            scale = 10 ** rng.uniform(0, 6)
            count = rng.integers(2, 12)
            one = FlightPlan(rng.normal(size=(count, 2)) * scale, rng.uniform(50, 300, count - 1))
            distances = np.linspace(-0.1 * scale, one.length + 0.1 * scale, 500)
            position, _ = one.path(distances)
            step = np.linalg.norm(np.diff(position, axis=0), axis=1)
            assert np.all(step <= np.diff(distances) * (1 + 1e-9) + 1e-9)
            np.testing.assert_allclose(one.project(position).cross_track, 0, atol=1e-8 * scale)
            assert np.all(np.diff(one.times) >= 0)
