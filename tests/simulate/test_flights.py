"""How aircraft fly: turns, legs, wind, errors."""

from typing import get_args

import numpy as np
import pytest
from scipy import stats
from simulate.aircraft import BANK, GRAVITY, STILL, corner, course, off, path, valid, zigzag

from tertia.flightplan import FlightPlan
from tertia.simulate import (
    SetUpName,
    flights,
    routes,
    set_up,
)


@pytest.mark.parametrize(("degrees", "speed"), [(60, 220.0), (-100, 220.0), (90, 130.0)])
def test_a_turn_is_flown_with_the_radius_of_its_bank_and_roll(degrees, speed):
    traffic = flights([corner(degrees, speed)] * 20, **STILL, rng=1)
    rate = GRAVITY * np.tan(BANK) / speed
    for i in range(len(traffic)):
        turning = np.flatnonzero(traffic.turning[i])
        full = slice(turning[0] + 8, turning[-1] - 12)
        # the speed varies by .7 m/s, of which the rate has the share 1/V
        expected = pytest.approx(np.sign(degrees) * rate, rel=4 * 0.7 / speed)
        assert np.mean(traffic.turn_rate[i, full]) == expected
        # the circle through three positions of the arc
        a, b, c = (
            traffic.position[i, k] for k in (full.start, sum(turning[[0, -1]]) // 2, full.stop)
        )
        sides = [np.hypot(*(a - b)), np.hypot(*(b - c)), np.hypot(*(c - a))]
        u, v = b - a, c - a
        radius = np.prod(sides) / (2 * abs(u[0] * v[1] - u[1] * v[0]))
        assert radius == pytest.approx(speed / rate, rel=0.03)
        # a bank comes and goes at 5 degrees per second, 1 of them standard deviation
        bank = np.degrees(np.arctan(traffic.turn_rate[i, valid(traffic, i)] * speed / GRAVITY))
        assert 2.4 < np.max(np.abs(np.diff(bank))) < 9.5
        assert np.max(np.abs(bank)) < 23.5


def test_slow_aircraft_turn_at_the_largest_rate_of_their_plan():
    traffic = flights([corner(90, 60.0, leg=20e3)] * 3, **STILL, rng=1)
    assert np.degrees(np.nanmax(traffic.turn_rate)) == pytest.approx(3.0, abs=0.01)


def test_banks_differ_as_given():
    traffic = flights([corner(110)] * 400, **STILL | {"bank_sigma": np.radians(2.2)}, rng=2)
    # in the middle of each turn
    middle = [int(np.mean(np.flatnonzero(turning))) for turning in traffic.turning]
    speed = np.hypot(*traffic.velocity[np.arange(400), middle].T)
    bank = np.degrees(np.arctan(traffic.turn_rate[np.arange(400), middle] * speed / GRAVITY))
    assert np.mean(bank) == pytest.approx(23, abs=4 * 2.2 / 20)
    assert np.std(bank) == pytest.approx(2.2, rel=4 / np.sqrt(800))


@pytest.mark.parametrize("degrees", [25, 60, -60, 110])
def test_fly_by_turns_follow_the_arcs_of_the_plan(degrees):
    """Where the aircraft banks as the plan says, and nothing else is wrong."""
    plan = corner(degrees)
    traffic = flights([plan] * 5, **STILL, rng=3)
    line = path(plan, BANK)
    for i in range(len(traffic)):
        # half of the roll, about 500 m, is straight instead of curved, on each side
        assert np.max(off(traffic.position[i, valid(traffic, i)], line)) < 250
        # it turns from a few seconds before the arc until a few seconds after it
        length = GRAVITY * np.tan(BANK) / 220.0
        seconds = np.count_nonzero(traffic.turning[i])
        assert seconds == pytest.approx(np.radians(abs(degrees)) / length, abs=6)


def test_the_wind_carries_the_aircraft_and_the_legs_are_held():
    wind = np.array([30.0, -20.0])
    traffic = flights([zigzag()] * 20, wind=wind, **STILL, rng=4)
    np.testing.assert_array_equal(traffic.wind, np.broadcast_to(wind, (20, 2)))
    airspeed = np.sqrt(np.sum((traffic.velocity - wind) ** 2, axis=-1))
    known = ~np.isnan(airspeed)
    # the slow variation alone: normal, .7 m/s
    assert np.max(np.abs(airspeed[known] - 200)) < 5 * 0.7
    ground = np.hypot(traffic.velocity[..., 0], traffic.velocity[..., 1])[known]
    assert np.max(ground) - np.min(ground) > 35
    line = path(traffic.plans[0], BANK)
    straight = path(replace_corners(traffic.plans[0]), BANK)
    for i in range(len(traffic)):
        here = traffic.position[i, valid(traffic, i)]
        # arcs are other curves in the wind, legs are not
        assert np.max(off(here, line)) < 1200
        legs = ~np.convolve(traffic.turning[i, valid(traffic, i)], np.ones(121), "same").astype(
            bool
        )
        # the last sample may lie after the last waypoint
        assert np.max(off(here[:-1][legs[:-1]], straight)) < 15


def replace_corners(plan):
    """The plan with so tight turns that its path is that of the legs."""
    return FlightPlan(plan.waypoints, 1.0)


def test_velocities_are_the_derivatives_of_positions():
    traffic = flights([zigzag()] * 5, wind=40.0, rng=5)
    for i in range(5):
        k = valid(traffic, i)
        position, velocity = traffic.position[i, k], traffic.velocity[i, k]
        mean = (velocity[1:] + velocity[:-1]) / 2
        np.testing.assert_allclose(np.diff(position, axis=0), mean, atol=0.5)
        turned = np.unwrap(np.radians(course(velocity)))
        rates = (traffic.turn_rate[i, k][1:] + traffic.turn_rate[i, k][:-1]) / 2
        np.testing.assert_allclose(np.diff(turned), rates, atol=2e-3)


def test_winds_of_a_number_are_uniform_in_speed_and_direction():
    traffic = flights([corner(60, leg=5e3)] * 1000, wind=40.0, rng=6)
    assert stats.kstest(np.hypot(*traffic.wind.T) / 40, "uniform").pvalue > 0.01
    angle = np.arctan2(*traffic.wind.T) / (2 * np.pi) + 0.5
    assert stats.kstest(angle, "uniform").pvalue > 0.01


def test_navigation_and_speed_err_as_given():
    plan = FlightPlan([[0.0, 0.0], [0.0, 100e3]], 200.0)
    traffic = flights([plan] * 300, rng=7)
    assert np.nanstd(traffic.position[:, 0, 0]) == pytest.approx(250, rel=4 / np.sqrt(600))
    late = traffic.position[:, 300, 0]
    assert np.std(late) == pytest.approx(250, rel=4 / np.sqrt(600))
    # it varies, but slowly
    correlation = np.corrcoef(traffic.position[:, 0, 0], late)[0, 1]
    assert 0.3 < correlation < 0.8
    lateral = traffic.velocity[..., 0]
    assert np.nanstd(lateral) == pytest.approx(250 / 200, rel=0.15)
    error = np.nanmean(traffic.velocity[..., 1], axis=1) - 200
    assert np.max(np.abs(error)) < 11.5
    assert np.std(error) == pytest.approx(10 / np.sqrt(3), rel=0.1)
    assert not traffic.turning.any()


def test_turns_begin_early_and_late():
    plan, n = corner(60), 200
    near, far = (
        flights([plan] * n, **STILL | {"navigation_sigma": sigma}, rng=8) for sigma in (0.0, 500.0)
    )
    begins = [
        traffic.position[np.arange(n), np.argmax(traffic.turning, axis=1), 1]
        for traffic in (near, far)
    ]
    # steps of 220 m and the time to roll, and where nothing is wrong no more
    assert np.std(begins[0]) < 130
    assert np.std(begins[1]) == pytest.approx(np.hypot(500, np.std(begins[0])), rel=0.15)
    assert np.mean(begins[1]) == pytest.approx(np.mean(begins[0]), abs=150)


def test_straight_legs_are_straight():
    for name in get_args(SetUpName):
        scene = set_up(name)
        traffic = flights(routes(name, 60, rng=9), wind=scene.wind, rng=10)
        near = np.array([np.convolve(t, np.ones(61), "same") > 0 for t in traffic.turning])
        acceleration = np.diff(traffic.velocity, axis=1)[~near[:, 1:]]
        acceleration = acceleration[~np.isnan(acceleration[:, 0])]
        assert len(acceleration) > 5000
        assert np.sqrt(np.mean(acceleration**2)) < 0.08


def test_heights_follow_the_plan():
    plan = zigzag(heights=[3000.0, 4000.0, 4000.0, 6000.0, 5000.0])
    traffic = flights([plan, zigzag()], **STILL, rng=11)
    assert np.isnan(traffic.height[1]).all()
    height = traffic.height[0, valid(traffic, 0)]
    assert height[0] == 3000
    assert height[-1] == pytest.approx(5000, abs=20)
    assert np.max(height) == pytest.approx(6000, abs=120)
    # half of the first leg
    assert height[150] == pytest.approx(3500, abs=20)
    assert np.max(np.abs(np.diff(height))) <= 15 + 1e-9
