"""Estimated times over waypoints."""

import numpy as np
import pytest
from flightplan.cases import WAY
from reference import flightplan as reference
from scipy import stats
from tolerances import CHANCE

from tertia.flightplan import (
    FlightPlan,
    conformance,
    estimate_times_over,
)


def flights(count, rng, wind=30.0, step=6.0):
    """Plans, and flights that follow them with other banks and speeds, in a wind.

    Airspeeds are off by a process of 10 m/s that forgets in five minutes. Times, distances along
    the path that is flown, and the route of that path.
    """
    kept = np.exp(-step / 300.0)
    for _ in range(count):
        courses = rng.uniform(0, 2 * np.pi) + np.cumsum(rng.uniform(-1.2, 1.2, 6))
        legs = rng.uniform(4e4, 8e4, (6, 1)) * np.stack([np.sin(courses), np.cos(courses)], -1)
        waypoints = np.concatenate([[[0, 0]], np.cumsum(legs, axis=0)])
        planned = rng.uniform(200, 230)
        flown = FlightPlan(waypoints, planned, bank=np.radians(rng.normal(23, 2.2)))
        blowing = rng.uniform(0, wind) * reference.unit(rng.normal(size=2))
        off, distance, distances, speeds = rng.normal(0, 10.0), 0.0, [], []
        while distance < flown.length:
            _, bearing = flown.path(distance)
            u = np.array([np.sin(bearing), np.cos(bearing)])
            across = reference.cross(blowing, u)
            speed = np.sqrt((planned + off) ** 2 - across**2) + u @ blowing
            distances.append(distance)
            speeds.append(speed)
            distance += speed * step
            off = kept * off + np.sqrt(1 - kept**2) * rng.normal(0, 10.0)
        times = step * np.arange(len(speeds))
        yield FlightPlan(waypoints, planned), flown, times, np.array(distances), np.array(speeds)


def ahead(flight, rng, before):
    """Errors at each waypoint so long before it is passed: refined, their sigmas, the plan's."""
    one, flown, times, distances, speeds = flight
    position, bearing = flown.path(distances)
    u = np.stack([np.sin(bearing), np.cos(bearing)], axis=-1)
    right = np.stack([u[:, 1], -u[:, 0]], axis=-1)
    position = position + rng.normal(0, 200.0) * right + rng.normal(0, 75.0, position.shape)
    velocity = speeds[:, np.newaxis] * u + rng.normal(0, 4.0, u.shape)
    covariance = np.tile(np.diag([75.0**2, 75**2, 16, 16]), (len(times), 1, 1))
    found = estimate_times_over(one, times, position, velocity, covariance=covariance)
    follows = conformance(one, times, position, velocity, covariance=covariance)
    passed = np.interp(flown.distances, distances, times)
    for waypoint in range(1, len(one.waypoints) - 1):
        at = np.searchsorted(times, passed[waypoint] - before)
        # after a minute on the way, while the plan is followed
        if times[at] > 60 and follows.conforms[at]:
            here = np.interp(follows.along_track[at], one.distances, one.times)
            alone = times[at] + one.times[waypoint] - here
            true = passed[waypoint]
            yield found.time[at, waypoint] - true, found.sigma[at, waypoint], alone - true


class TestTimesOver:
    @pytest.mark.parametrize(("before", "rms"), [(120.0, 4.7), (300.0, 22.0)])
    def test_refined_times(self, before, rms):
        rng = np.random.default_rng(8)
        rows = np.array([row for flight in flights(100, rng) for row in ahead(flight, rng, before)])
        refined, sigma, alone = rows.T
        assert len(rows) > 250
        assert np.sqrt(np.mean(refined**2)) < rms
        assert np.sqrt(np.mean(alone**2)) > 1.5 * np.sqrt(np.mean(refined**2))
        # wind is the same for a whole flight, so errors of a flight are not independent
        assert 0.5 < np.sqrt(np.mean((refined / sigma) ** 2)) < 1.15

    def test_sigma_where_the_speed_wanders_as_assumed(self):
        """A random walk of the ground speed by 4 % a minute."""
        rng = np.random.default_rng(9)
        one = FlightPlan([[0, 0], [60e3, 0], [120e3, 0]], 200.0)
        step, scores = 2.0, []
        steps = 0.04 * np.sqrt(step / 60) * rng.normal(size=(400, 500))
        steps[:, :60] = 0  # constant for as long as the mean looks back
        for walk in steps:
            speed = 200 * (1 + np.cumsum(walk))
            distance = np.concatenate([[0], np.cumsum(step * speed)[:-1]])
            times = step * np.arange(500)
            n = 60
            position = np.column_stack([distance[:n], np.zeros(n)])
            velocity = np.column_stack([speed[:n], np.zeros(n)])
            found = estimate_times_over(one, times[:n], position, velocity)
            true = np.interp(60e3, distance, times)
            scores.append((found.time[-1, 1] - true) / found.sigma[-1, 1])
        low, high = stats.chi2.ppf([CHANCE / 2, 1 - CHANCE / 2], 400) / 400
        assert low * 0.9 < np.mean(np.square(scores)) < high * 1.1

    def test_mean_speed_by_its_formula(self):
        one = FlightPlan([[0, 0], [3e5, 0]], 200.0)
        rng = np.random.default_rng(10)
        times = np.cumsum(rng.uniform(4, 12, 30))
        speeds = 190 + rng.normal(0, 5, 30)
        position = np.column_stack([200 * times, np.zeros(30)])
        velocity = np.column_stack([speeds, np.zeros(30)])
        found = estimate_times_over(one, times, position, velocity)
        for k in (0, 3, 29):
            expected = reference.mean_speed(times[: k + 1], speeds[: k + 1])
            assert found.speed[k] == pytest.approx(expected, rel=1e-12)
            rest = (3e5 - 200 * times[k]) / expected
            assert found.time[k, 1] == pytest.approx(times[k] + rest, rel=1e-12)
        covariance = np.tile(np.diag([2500.0, 1, 9, 1]), (30, 1, 1))
        wide = estimate_times_over(one, times, position, velocity, covariance=covariance)
        np.testing.assert_allclose(wide.speed_sigma, 3.0)
        tau = wide.time[-1, 1] - times[-1]
        relative = 9 / wide.speed[-1] ** 2 + 0.04**2 / 60 * tau / 3
        expected = 2500 / wide.speed[-1] ** 2 + tau**2 * relative
        assert wide.sigma[-1, 1] == pytest.approx(np.sqrt(expected), rel=1e-12)

    def test_what_does_not_conform_changes_nothing(self):
        one = FlightPlan(WAY, 210.0)
        times = np.arange(0, 600, 10.0)
        position, velocity = one.at(times)
        position[20:, 0] += 2e4
        found = estimate_times_over(one, times, position, velocity)
        blocked = np.flatnonzero(~conformance(one, times, position, velocity).conforms)[0]
        assert 20 <= blocked < 24
        np.testing.assert_array_equal(found.speed[blocked:], found.speed[blocked])


def test_a_track_without_plots_has_a_text():
    plan = FlightPlan(WAY, 220.0)
    found = estimate_times_over(plan, [], np.empty((0, 2)), np.empty((0, 2)))
    assert repr(found) == "TimesOver(0 plots)"
