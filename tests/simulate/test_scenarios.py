"""What is flown instead of a plan."""

import numpy as np
import pytest
from simulate.aircraft import (
    BANK,
    GRAVITY,
    LEAVING,
    STILL,
    corner,
    course,
    off,
    path,
    valid,
    wrapped,
    zigzag,
)

from tertia.flightplan import FlightPlan
from tertia.simulate import (
    flights,
)


def test_who_conforms_never_leaves_the_plan():
    traffic = flights([zigzag()] * 30, wind=30.0, rng=12)
    assert np.isnan(traffic.left).all()
    assert np.isnan(traffic.returned).all()
    line = path(traffic.plans[0], BANK)
    assert (
        max(np.max(off(traffic.position[i, valid(traffic, i)][::5], line)) for i in range(30)) < 2e3
    )
    # each ends at the last waypoint
    ends = traffic.position[np.arange(30), traffic.count - 1]
    assert np.max(np.hypot(*(ends - traffic.plans[0].waypoints[-1]).T)) < 1500


def test_speed_changes_on_the_route():
    traffic = flights([zigzag()] * 60, scenario="speed", **STILL, rng=13)
    speed = np.hypot(traffic.velocity[..., 0], traffic.velocity[..., 1])
    change = speed[np.arange(60), traffic.count - 1] - speed[:, 0]
    assert (np.abs(change) > 12).all()
    assert (np.abs(change) < 33).all()
    assert 15 < np.sum(change > 0) < 45
    assert np.nanmax(np.abs(np.diff(speed, axis=1))) < 0.6
    assert np.isnan(traffic.left).all()
    line = path(traffic.plans[0], BANK)
    # the radius changes with the speed
    assert (
        max(np.max(off(traffic.position[i, valid(traffic, i)][::5], line)) for i in range(60)) < 900
    )


@pytest.mark.parametrize("scenario", LEAVING)
def test_flights_leave_their_plan_when_they_say(scenario):
    n = 30
    traffic = flights([zigzag()] * n, scenario=scenario, wind=30.0, rng=14)
    assert not np.isnan(traffic.left).any()
    line = path(traffic.plans[0], BANK)
    away = []
    for i in range(n):
        k = valid(traffic, i)
        time, distance = traffic.time[i, k], off(traffic.position[i, k], line)
        assert np.max(distance[time <= traffic.left[i]]) < 2000
        back = np.inf if np.isnan(traffic.returned[i]) else traffic.returned[i]
        assert traffic.left[i] < back
        away.append(np.max(distance[(time > traffic.left[i]) & (time < back)]))
        # a turn by which it comes back may still be cut
        assert np.max(distance[time >= back], initial=0.0) < 2500
    assert np.quantile(away, 0.1) > {"fly-over": 1200, "shortcut": 2500}.get(scenario, 6000)
    returning = {"holding": 1.0, "fly-over": 1.0, "shortcut": 0.3, "vectoring": 0.3}
    share = np.mean(~np.isnan(traffic.returned))
    assert share >= returning.get(scenario, 0.0)
    if scenario not in returning:
        assert share == 0


def last_course(traffic):
    return course(traffic.velocity[np.arange(len(traffic)), traffic.count - 1])


def test_a_shortcut_leads_to_a_later_waypoint():
    plan = zigzag()
    traffic = flights([plan] * 40, scenario="shortcut", **STILL, rng=15)
    position, _ = traffic.at(np.arange(40), traffic.left)
    _, velocity = traffic.at(np.arange(40), traffic.left + 120)
    heading = course(velocity)
    targets = set()
    for i in range(40):
        bearings = course(plan.waypoints - position[i])
        close = np.abs(wrapped(bearings - heading[i])) < 12
        leg = int(position[i, 1] > plan.waypoints[1, 1]) + int(
            position[i, 1] > plan.waypoints[2, 1]
        )
        assert np.flatnonzero(close)[-1] >= leg + 2
        targets.add(int(np.flatnonzero(close)[-1]))
    assert len(targets) > 1


def test_a_holding_is_one_or_two_racetracks():
    plan = FlightPlan([[0.0, 0.0], [0.0, 100e3]], 200.0)
    traffic = flights([plan] * 30, scenario="holding", **STILL, rng=16)
    turned = np.degrees(np.nansum(traffic.turn_rate, axis=1)) / 360
    laps = np.round(np.abs(turned))
    np.testing.assert_allclose(np.abs(turned), laps, atol=0.02)
    assert set(laps) == {1, 2}
    assert set(np.sign(turned)) == {-1, 1}
    # two half circles of 23 degrees and two straight minutes
    lap = 2 * np.pi * 200 / (GRAVITY * np.tan(BANK)) + 2 * 60
    np.testing.assert_allclose((traffic.returned - traffic.left) / laps, lap, rtol=0.25)


def test_vectoring_is_12_to_20_km_off():
    plan = FlightPlan([[0.0, 0.0], [0.0, 60e3], [10e3, 220e3]], 200.0)
    traffic = flights([plan] * 60, scenario="vectoring", **STILL, rng=17)
    sides = np.sign(np.nanmean(traffic.position[..., 0] - 2e3, axis=1))
    assert set(sides) == {-1, 1}
    furthest = np.nanmax(np.abs(traffic.position[..., 0]), axis=1)
    assert np.min(furthest) > 11.5e3
    assert np.max(furthest) < 20.5e3
    assert np.std(furthest) > 1500


def test_a_hijack_turns_away_for_good():
    plan = FlightPlan([[0.0, 0.0], [0.0, 100e3]], 200.0)
    traffic = flights([plan] * 60, scenario="hijack", lasting=200.0, **STILL, rng=18)
    turned = wrapped(last_course(traffic))
    assert np.min(np.abs(turned)) > 43
    assert np.max(np.abs(turned)) < 152
    assert 15 < np.sum(turned > 0) < 45
    # and the time of the turn
    assert (traffic.end - traffic.left > 200).all()
    assert (traffic.end - traffic.left < 350).all()


def test_straight_on_does_not_turn():
    traffic = flights([corner(80)] * 10, scenario="straight-on", **STILL, rng=19)
    assert not traffic.turning.any()
    position, _ = traffic.at(np.arange(10), traffic.left)
    # where the plan's arc begins
    lead = 220.0**2 / (GRAVITY * np.tan(np.radians(25))) * np.tan(np.radians(40))
    np.testing.assert_allclose(position[:, 1], 50e3 - lead, atol=150)


def test_a_wrong_turn_is_to_another_course():
    traffic = flights([corner(80)] * 80, scenario="wrong-turn", **STILL, rng=20)
    turned = wrapped(last_course(traffic))
    assert np.min(np.abs(wrapped(turned - 80))) > 28
    assert np.mean(np.abs(turned + 80) < 2) == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(80))
    assert np.any(turned > 105)
    assert np.any((turned > 15) & (turned < 55))


def test_fly_over_begins_at_the_waypoint():
    traffic = flights([corner(80)] * 20, scenario="fly-over", **STILL, rng=21)
    first = np.argmax(traffic.turning, axis=1)
    begins = traffic.position[np.arange(20), first]
    assert np.min(begins[:, 1]) > 50e3 - 150
    assert np.max(begins[:, 1]) < 50e3 + 900
    _, velocity = traffic.at(np.arange(20), traffic.returned)
    np.testing.assert_allclose(course(velocity), 80, atol=5.1)


def test_scenarios_may_differ_among_flights():
    names = ["conforming", "hijack", "conforming"]
    traffic = flights([zigzag(identity=k) for k in (7, 8, 9)], scenario=names, rng=22)
    np.testing.assert_array_equal(np.isnan(traffic.left), [True, False, True])
    np.testing.assert_array_equal(traffic.identity, [7, 8, 9])


def test_flights_start_at_the_time_of_their_plan():
    traffic = flights([zigzag(start_time=t) for t in (0.0, 1000.0)], scenario="hijack", rng=23)
    np.testing.assert_array_equal(traffic.start, [0, 1000])
    assert traffic.left[1] > 1000
    np.testing.assert_array_equal(np.nanmin(traffic.time, axis=1), traffic.start)
    np.testing.assert_array_equal(np.nanmax(traffic.time, axis=1), traffic.end)
