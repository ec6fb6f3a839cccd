"""Simulated air traffic, and what radars see of it."""

from dataclasses import fields, replace
from typing import get_args

import numpy as np
import pytest
from scipy import spatial, stats

from tertia import simulate
from tertia.flightplan import FlightPlan
from tertia.simulate import (
    FlightScenario,
    SetUpName,
    dense_traffic,
    encounter,
    flights,
    radar_plots,
    routes,
    set_up,
)
from tertia.tracker import Radar

GRAVITY = 9.80665
BANK = np.radians(23.0)
# nothing differs between flights but what a test lets
STILL = {"bank_sigma": 0.0, "navigation_sigma": 0.0, "speed_error": 0.0}
LEAVING = [name for name in get_args(FlightScenario) if name not in {"conforming", "speed"}]


def corner(degrees, speed=220.0, leg=50e3, **options):
    """A plan that comes from the south and turns once."""
    angle = np.radians(degrees)
    end = [leg * np.sin(angle), leg * (1 + np.cos(angle))]
    return FlightPlan([[0.0, 0.0], [0.0, leg], end], speed, **options)


def zigzag(speed=200.0, **options):
    """A plan with turns by 60 and 70 degrees to both sides, and legs of 60 km."""
    courses = np.radians([0.0, 60.0, -10.0, 50.0])
    ways = 60e3 * np.stack([np.sin(courses), np.cos(courses)], axis=-1)
    return FlightPlan(np.concatenate([[[0.0, 0.0]], np.cumsum(ways, axis=0)]), speed, **options)


def path(plan, bank):
    """Points every few metres on the legs and arcs of a plan: the geometry of fly-by turns."""
    points, speed = plan.waypoints, plan.speeds[0]
    radius = speed**2 / (GRAVITY * np.tan(bank))
    pieces, begin = [], points[0]
    for a, b, c in zip(points[:-2], points[1:-1], points[2:], strict=True):
        u, v = (b - a) / np.hypot(*(b - a)), (c - b) / np.hypot(*(c - b))
        angle = np.arctan2(u[1] * v[0] - u[0] * v[1], u @ v)
        lead = radius * np.tan(abs(angle) / 2)
        first, side = b - lead * u, np.sign(angle) * np.array([u[1], -u[0]])
        pieces.append(np.linspace(begin, first, 4000))
        phi = np.linspace(0.0, abs(angle), 1000)[:, np.newaxis]
        pieces.append(first + radius * (np.sin(phi) * u + (1 - np.cos(phi)) * side))
        begin = b + lead * v
    return np.concatenate([*pieces, np.linspace(begin, points[-1], 4000)])


def off(positions, line):
    """Distances of positions from the nearest point of a line."""
    return spatial.cKDTree(line).query(positions)[0]


def course(velocity):
    return np.degrees(np.arctan2(velocity[..., 0], velocity[..., 1]))


def wrapped(degrees):
    return (np.asarray(degrees) + 180) % 360 - 180


def valid(traffic, flight):
    return slice(0, traffic.count[flight])


# dynamics


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


def test_banks_differ_as_told():
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
        # it turns from a few seconds before the arc until a few seconds behind it
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
        # the last sample may lie behind the last waypoint
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


def test_navigation_and_speed_err_as_told():
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
    assert np.std(begins[1]) == pytest.approx(500, rel=0.3)
    assert np.mean(begins[1]) == pytest.approx(np.mean(begins[0]), abs=200)


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


# scenarios


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


# traffic


def test_behind_its_end_a_flight_is_nowhere():
    traffic = flights([corner(30, leg=5e3), corner(30)], rng=24)
    short, long = traffic.count
    assert short < long == traffic.position.shape[1]
    for name in ("position", "velocity", "turn_rate"):
        values = getattr(traffic, name)
        assert np.isnan(values[0, short:]).all()
        assert not np.isnan(values[0, :short]).any()
    position, velocity = traffic.at([0, 0, 0, 1], [-0.1, short - 1.0, short - 0.9, np.nan])
    np.testing.assert_array_equal(np.isnan(position[:, 0]), [True, False, True, True])
    np.testing.assert_array_equal(np.isnan(velocity), np.isnan(position))


def test_between_samples_stands_a_cubic():
    """On a circle, whose positions are known, and on a straight line exactly."""
    traffic = dense_traffic(40, turning_share=1.0, step=4.0, rng=25)
    fine = dense_traffic(40, turning_share=1.0, step=0.5, rng=25)
    who = np.arange(40)[:, np.newaxis]
    time = fine.time[:, 1:-1:3]
    position, velocity = traffic.at(who, time)
    rate = np.abs(fine.turn_rate[:, 1:-1:3])
    smooth = rate == np.abs(traffic.turn_rate[who, (time // 4).astype(int)])
    smooth &= rate == np.abs(traffic.turn_rate[who, np.minimum((time // 4).astype(int) + 1, 75)])
    error = np.sqrt(np.sum((position - fine.position[:, 1:-1:3]) ** 2, axis=-1))
    # h^4 / 384 of the fourth derivative: 250 m/s times the cube of 3 degrees per second
    assert np.max(error[smooth]) < 4**4 / 384 * 250 * np.radians(3) ** 3
    np.testing.assert_allclose(velocity[smooth], fine.velocity[:, 1:-1:3][smooth], atol=0.1)
    samples = traffic.at(who, traffic.time)
    np.testing.assert_allclose(samples[0], traffic.position, atol=1e-6)
    np.testing.assert_allclose(samples[1], traffic.velocity, atol=1e-9)


def test_some_of_the_flights():
    traffic = flights([zigzag(identity=k) for k in range(4)], rng=26)
    some = traffic[np.array([2, 0])]
    np.testing.assert_array_equal(some.identity, [2, 0])
    assert some.plans == (traffic.plans[2], traffic.plans[0])
    np.testing.assert_array_equal(some.position[1], traffic.position[0])
    assert len(traffic[1:]) == len(traffic[traffic.identity > 0]) == 3
    with pytest.raises(TypeError, match="slice or an array"):
        traffic[0]


# set-ups


@pytest.mark.parametrize("name", get_args(SetUpName))
def test_routes_suit_their_set_up(name):
    scene, plans = set_up(name), routes(name, 200, rng=27)
    near, far = scene.distance
    angles = []
    for i, plan in enumerate(plans):
        assert plan.identity == i
        assert scene.speed[0] <= plan.speeds[0] <= scene.speed[1]
        assert (plan.speeds == plan.speeds[0]).all()
        assert scene.height[0] <= plan.heights[0] <= scene.height[1]
        assert plan.heights[0] / 304.8 == pytest.approx(round(plan.heights[0] / 304.8))
        legs = np.diff(plan.waypoints, axis=0)
        line = np.concatenate(
            [
                np.linspace(a, b, 500)
                for a, b in zip(plan.waypoints[:-1], plan.waypoints[1:], strict=True)
            ]
        )
        distance = np.hypot(*line.T)
        assert np.min(distance) > near - 1
        assert np.max(distance) < far + 1
        turns = wrapped(np.diff(course(legs)))
        assert 2 <= len(turns) <= 4
        angles.extend(turns)
        radius = plan.speeds[0] ** 2 / (GRAVITY * np.tan(np.radians(25)))
        arcs = np.concatenate([[0], radius * np.tan(np.radians(np.abs(turns)) / 2), [0]])
        scans = (
            (np.hypot(*legs.T) - arcs[1:] - arcs[:-1]) / plan.speeds[0] / scene.radar.scan_period
        )
        assert np.min(scans) > 15 - 1e-6
        assert np.max(scans) < 30 + 1e-6
    angles = np.array(angles)
    assert 20 <= np.min(np.abs(angles)) < 25
    assert 80 < np.max(np.abs(angles)) <= 110
    assert np.mean(angles > 0) == pytest.approx(0.5, abs=0.1)
    counts = np.bincount([len(plan.waypoints) for plan in plans], minlength=7)
    assert (counts[4:7] > 10).all()


def test_a_set_up_without_room_is_an_error():
    scene = replace(set_up("en-route"), distance=(10e3, 20e3))
    with pytest.raises(ValueError, match="leave no room for routes at 200 to 250 m/s"):
        routes(scene, 1, rng=1)


# dense traffic and encounters


def test_dense_traffic_fills_its_area():
    traffic = dense_traffic(4000, area=(300e3, 100e3), turning_share=0.3, rng=28)
    middle = traffic.position[:, traffic.position.shape[1] // 2]
    for k, extent in enumerate((300e3, 100e3)):
        assert stats.kstest(middle[:, k] / extent + 0.5, "uniform").pvalue > 0.01
    speed = np.hypot(*traffic.velocity[:, 0].T)
    assert stats.kstest((speed - 100) / 150, "uniform").pvalue > 0.01
    assert stats.kstest(course(traffic.velocity[:, 0]) / 360 + 0.5, "uniform").pvalue > 0.01
    share = traffic.turning.any(axis=1).mean()
    assert share == pytest.approx(0.3, abs=4 * np.sqrt(0.21 / 4000))
    straight = ~traffic.turning.any(axis=1)
    # a turn may begin in the last step
    assert np.mean(np.ptp(traffic.velocity[straight], axis=1).max(axis=1) < 1e-9) > 0.99
    np.testing.assert_array_equal(traffic.identity, np.arange(4000))


def test_dense_traffic_turns_on_circles():
    traffic = dense_traffic(50, turning_share=1.0, step=1.0, rng=29)
    mean = (traffic.velocity[:, 1:] + traffic.velocity[:, :-1]) / 2
    # where a turn begins or ends within a step: h^2 / 8 of V w
    np.testing.assert_allclose(np.diff(traffic.position, axis=1), mean, atol=1.7)
    turned = np.unwrap(np.radians(course(traffic.velocity)), axis=1)
    both = traffic.turning[:, 1:] & traffic.turning[:, :-1]
    np.testing.assert_allclose(np.diff(turned, axis=1)[both], traffic.turn_rate[:, 1:][both])
    assert (np.abs(turned[:, -1] - turned[:, 0]) < np.radians(110.1)).all()


def test_crossing_aircraft_meet_at_small_angles():
    traffic = encounter("crossing", n=3, angle=np.radians(10), middle=(1e3, 2e3), rng=30)
    position, velocity = traffic.at(np.arange(3), 300.0)
    np.testing.assert_allclose(position, [[1e3, 2e3]] * 3, atol=1e-6)
    np.testing.assert_allclose(np.sort(course(velocity)), [80, 90, 100])


@pytest.mark.parametrize("name", ["formation", "in-trail"])
def test_aircraft_five_miles_apart(name):
    traffic = encounter(name, n=3, course=np.radians(30), rng=31)
    along = np.array([0.5, np.sqrt(0.75)])
    across = np.array([along[1], -along[0]])
    order, level = (across, along) if name == "formation" else (along, across)
    for k in (0, -1):
        np.testing.assert_allclose(
            np.sort(traffic.position[:, k] @ order)[1:]
            - np.sort(traffic.position[:, k] @ order)[:-1],
            9260,
        )
        np.testing.assert_allclose(np.ptp(traffic.position[:, k] @ level), 0, atol=1e-6)
    np.testing.assert_allclose(
        traffic.velocity, 200 * np.broadcast_to(along, traffic.velocity.shape)
    )


# plots


def radar(position=(0.0, 0.0), **options):
    settings = {
        "range_sigma": 1e-6,
        "azimuth_sigma": 1e-12,
        "scan_period": 10.0,
        "detection_probability": 1 - 1e-15,
    }
    return Radar(position, **settings | options)


def test_a_plot_is_where_the_beam_and_the_aircraft_are():
    """All around, near and far, from radars that turn at other times."""
    traffic = dense_traffic(300, area=(60e3, 60e3), turning_share=0.5, rng=32)
    towers = [radar(), radar((5e3, -7e3), scan_period=4.0)]
    record = radar_plots(traffic, towers, phase=[3.0, 1.5], rng=1)
    plots = record.plots
    np.testing.assert_array_equal(record.phase, [3.0, 1.5])
    assert (np.diff(plots.time) >= 0).all()
    position, _ = traffic.at(record.target, plots.time)
    for k, tower in enumerate(towers):
        own = plots.sensor == k
        offset = position[own] - tower.position
        # of a tangential speed of 250 m/s the azimuth has a microsecond's share
        distance = np.hypot(*offset.T)
        azimuth = np.arctan2(*offset.T)
        beam = 2 * np.pi * (plots.time[own] - record.phase[k]) / tower.scan_period
        lag = (azimuth - beam + np.pi) % (2 * np.pi) - np.pi
        assert np.max(np.abs(lag[distance > 1500])) < 2e-6
        wrong = (plots.azimuth[own] - azimuth + np.pi) % (2 * np.pi) - np.pi
        assert np.max(np.abs(wrong)) < 1e-9
        height = traffic.height[record.target[own], 0]
        np.testing.assert_allclose(plots.range[own], np.hypot(distance, height), rtol=1e-9)


def test_every_scan_sees_every_aircraft_once():
    """As often as the beam overtakes its azimuth, which crosses the north meanwhile."""
    traffic = dense_traffic(200, area=(80e3, 80e3), duration=400.0, rng=33)
    record = radar_plots(traffic, [radar()], phase=0.0, rng=1)
    turned = np.unwrap(np.arctan2(traffic.position[..., 0], traffic.position[..., 1]), axis=1)
    lag = 2 * np.pi * traffic.time / 10.0 - turned
    expected = np.floor(lag[:, -1] / (2 * np.pi)) - np.ceil(lag[:, 0] / (2 * np.pi)) + 1
    # nearer, the azimuth may be as quick as the beam
    far = np.min(np.hypot(traffic.position[..., 0], traffic.position[..., 1]), axis=1) > 1500
    assert np.sum(far) > 150
    counts = np.bincount(record.target, minlength=200)
    np.testing.assert_array_equal(counts[far], expected[far])
    assert np.any(np.abs(np.diff(turned[:, [0, -1]], axis=1)) > 1)


def test_an_aircraft_above_the_radar_does_not_stop_the_simulation():
    traffic = encounter("in-trail", middle=(0.0, 0.0), height=0.0, rng=1)
    record = radar_plots(traffic, [radar()], rng=1)
    assert 2 * 57 <= len(record) <= 2 * 61
    assert np.isfinite(record.plots.range).all()


@pytest.fixture(scope="module")
def crowd():
    return dense_traffic(1000, duration=200.0, rng=34)


def errors(traffic, record, tower):
    """Errors of range and azimuth in units of their standard deviations."""
    known = record[record.target >= 0]
    position, _ = traffic.at(known.target, known.plots.time)
    height = traffic.height[known.target, 0] - (
        tower.position[2] if len(tower.position) == 3 else 0
    )
    offset = position - tower.position[:2]
    azimuth = known.plots.azimuth - np.arctan2(*offset.T)
    return (
        (known.plots.range - np.hypot(np.hypot(*offset.T), height)) / tower.range_sigma,
        ((azimuth + np.pi) % (2 * np.pi) - np.pi) / tower.azimuth_sigma,
    )


def test_noise_is_normal_and_detection_as_probable_as_told(crowd):
    tower = Radar(
        (0, 0, 500), range_sigma=100, azimuth_sigma=0.002, scan_period=5, detection_probability=0.8
    )
    record = radar_plots(crowd, [tower], rng=2)
    for error in errors(crowd, record, tower):
        assert stats.kstest(error, "norm").pvalue > 0.01
    scans = 1000 * 200 / 5
    assert len(record) == pytest.approx(0.8 * scans, abs=4 * np.sqrt(0.16 * scans))


def test_beyond_its_range_a_radar_sees_nothing(crowd):
    record = radar_plots(crowd, [radar(max_range=50e3)], rng=3)
    assert 0 < len(record) < 2000
    assert np.max(record.plots.range) < 50e3 + 1e-3
    whole = radar_plots(crowd, [radar()], phase=record.phase, rng=3)
    assert np.sum(whole.plots.range < 50e3) == len(record)


def test_bias_and_outliers(crowd):
    tower = radar(range_sigma=50, azimuth_sigma=0.001)
    record = radar_plots(
        crowd, [tower], bias=[200, 0.01], outlier_probability=0.1, outlier_size=30.0, rng=4
    )
    n = len(record)
    assert record.outlier.mean() == pytest.approx(0.1, abs=4 * 0.3 / np.sqrt(n))
    for error, shift in zip(errors(crowd, record, tower), (4.0, 10.0), strict=True):
        good, bad = error[~record.outlier], error[record.outlier]
        assert stats.kstest(good - shift, "norm").pvalue > 0.01
        assert stats.kstest((bad - shift) / 30, "norm").pvalue > 0.01


def test_each_radar_has_its_own_bias_and_clutter(crowd):
    towers = [radar(max_range=400e3), radar(max_range=400e3)]
    record = radar_plots(crowd, towers, bias=[[0, 0], [500, 0]], clutter=[0, 40], rng=5)
    for k, shift in enumerate((0.0, 500.0)):
        own = record[record.plots.sensor == k]
        np.testing.assert_allclose(
            errors(crowd, own, towers[k])[0] * towers[k].range_sigma, shift, atol=1e-4
        )
        false = np.sum(own.target == -1)
        assert false == (pytest.approx(800, abs=4 * np.sqrt(800)) if k else 0)


def test_duplicates_repeat_a_plot_of_the_scan(crowd):
    record = radar_plots(crowd, [radar(range_sigma=50)], duplicate_probability=0.2, rng=6)
    singles = np.sum(~record.duplicate)
    assert np.sum(record.duplicate) / singles == pytest.approx(0.2, abs=4 * 0.4 / np.sqrt(singles))
    keys = {
        (t, w)
        for t, w in zip(
            record.target[~record.duplicate], record.plots.time[~record.duplicate], strict=True
        )
    }
    repeated = record[record.duplicate]
    assert all(key in keys for key in zip(repeated.target, repeated.plots.time, strict=True))
    # with another noise
    assert len(np.unique(record.plots.range)) == len(record)


def test_replies_are_rounded_missing_and_garbled(crowd):
    record = radar_plots(
        crowd,
        [radar()],
        height_missing_probability=0.1,
        identity_missing_probability=0.2,
        identity_garbled_probability=0.05,
        rng=7,
    )
    n, plots = len(record), record.plots
    told = ~np.isnan(plots.height)
    assert told.mean() == pytest.approx(0.9, abs=4 * 0.3 / np.sqrt(n))
    np.testing.assert_allclose(plots.height[told] / 30.48, np.round(plots.height[told] / 30.48))
    wrong = np.abs(plots.height[told] - crowd.height[record.target[told], 0])
    assert 15 < np.max(wrong) <= 15.24 + 1e-9
    answered = plots.identity >= 0
    assert answered.mean() == pytest.approx(0.8, abs=4 * 0.4 / np.sqrt(n))
    garbled = plots.identity[answered] != crowd.identity[record.target[answered]]
    assert garbled.mean() == pytest.approx(0.05, abs=4 * 0.22 / np.sqrt(n))
    assert np.max(plots.identity) < 4096


def test_without_heights_the_range_is_horizontal_and_without_identity_there_is_none():
    traffic = flights([zigzag()], rng=35)
    record = radar_plots(traffic, [radar((0, 0, 1000))], rng=8)
    assert np.isnan(record.plots.height).all()
    assert (record.plots.identity == -1).all()
    position, _ = traffic.at(record.target, record.plots.time)
    np.testing.assert_allclose(record.plots.range, np.hypot(*position.T), atol=1e-4)


def test_clutter_is_uniform_over_the_area_and_comes_with_the_beam(crowd):
    tower = radar(max_range=300e3, detection_probability=1e-12)
    record = radar_plots(crowd, [tower], clutter=250, rng=9)
    assert (record.target == -1).all()
    assert len(record) == pytest.approx(5000, abs=4 * np.sqrt(5000))
    plots = record.plots
    assert stats.kstest((plots.range / 300e3) ** 2, "uniform").pvalue > 0.01
    assert stats.kstest(plots.azimuth / (2 * np.pi), "uniform").pvalue > 0.01
    beam = 2 * np.pi * (plots.time - record.phase[0]) / 10
    lag = (plots.azimuth - beam + np.pi) % (2 * np.pi) - np.pi
    assert np.max(np.abs(lag)) < 1e-9
    assert np.isnan(plots.height).all()
    assert (plots.identity == -1).all()


def test_phases_are_uniform():
    traffic = encounter("formation", duration=10.0, rng=1)
    record = radar_plots(traffic, [radar(scan_period=8.0)] * 400, rng=10)
    assert stats.kstest(record.phase / 8, "uniform").pvalue > 0.01


def test_a_flight_alone_with_the_clutter(crowd):
    record = radar_plots(crowd, [radar(max_range=400e3)], clutter=50, rng=11)
    alone = record.alone(5)
    assert set(alone.target) == {-1, 5}
    assert np.sum(alone.target == 5) == np.sum(record.target == 5)
    assert alone.target[0] == alone.target[-1] == 5
    span = alone.plots.time[[0, -1]]
    inside = (record.plots.time > span[0]) & (record.plots.time < span[1])
    assert np.sum(alone.target == -1) == np.sum(inside & (record.target == -1))
    assert len(record.alone(12345)) == 0


# seeds, nothing, errors


def same(first, second):
    for field in fields(first):
        a, b = getattr(first, field.name), getattr(second, field.name)
        if field.name == "plots":
            same(a, b)
        elif field.name != "plans":
            np.testing.assert_array_equal(a, b)


def test_a_seed_gives_the_same_traffic_and_a_generator_goes_on():
    plans = routes("tma", 3, rng=36)
    for first, second in zip(plans, routes("tma", 3, rng=36), strict=True):
        np.testing.assert_array_equal(first.waypoints, second.waypoints)
    for make in (
        lambda rng: flights(plans, scenario="holding", wind=15.0, rng=rng),
        lambda rng: dense_traffic(5, rng=rng),
        lambda rng: radar_plots(
            dense_traffic(5, rng=1), [radar(max_range=1e6)], clutter=3, rng=rng
        ),
    ):
        same(make(37), make(37))
        generator = np.random.default_rng(37)
        same(make(generator), make(37))
        with pytest.raises(AssertionError):
            same(make(generator), make(37))


def test_nobody_flies():
    for traffic in (
        flights([], rng=1),
        dense_traffic(0, rng=1),
        encounter("formation", n=0, rng=1),
    ):
        assert len(traffic) == 0
        assert repr(traffic) == "Traffic(0 flights)"
        record = radar_plots(traffic, [radar(max_range=1e5)], clutter=10, rng=1)
        assert len(record) == len(record.plots) == 0
    assert routes("tma", 0, rng=1) == []
    assert len(radar_plots(dense_traffic(3, rng=1), [], rng=1)) == 0
    assert len(encounter("crossing", n=1, rng=1)) == 1


def test_the_shortest_flight_has_two_samples():
    traffic = flights([FlightPlan([[0, 0], [0, 20]], 200.0)], rng=1)
    assert traffic.count[0] >= 2
    assert not np.isnan(traffic.position[0, :2]).any()


def test_sharp_and_close_turns_come_to_an_end():
    """Waypoints within the circle of a turn, and turns back."""
    plan = FlightPlan([[0, 0], [0, 20e3], [0, 1e3], [500, 1e3], [500, 0], [30e3, 0]], 230.0)
    for name in get_args(FlightScenario):
        traffic = flights([plan] * 10, scenario=name, wind=50.0, rng=2)
        position = traffic.position[np.isfinite(traffic.position)]
        assert np.max(np.abs(position)) < 400e3
        assert np.max(traffic.count) < 4000


PLAN = corner(60)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"plans": PLAN}, TypeError, "(?s)plans is .*; it must be a sequence"),
        ({"plans": [PLAN, 3]}, TypeError, r"plans\[1\] is 3; it must be a FlightPlan"),
        ({"plans": [corner(60, 20.0)]}, ValueError, r"plans\[0\] has a speed of 20 m/s"),
        (
            {"plans": [FlightPlan([[0, 0], [0, 0.5]], 100.0)]},
            ValueError,
            r"plans\[0\] has waypoints 0 and 1 at one place",
        ),
        ({"scenario": "lost"}, ValueError, "scenario is 'lost'; it must be one of conforming"),
        ({"scenario": ["speed", "speed"]}, ValueError, "scenario is .* one of 1 each"),
        ({"scenario": [3]}, ValueError, "scenario is 3"),
        (
            {"plans": [FlightPlan([[0, 0], [0, 5e4]], 100.0)], "scenario": "fly-over"},
            ValueError,
            r"plans\[0\] has no turn; the scenario 'fly-over' needs one",
        ),
        ({"wind": -1.0}, ValueError, "wind is -1.0"),
        ({"wind": [90.0, 0.0]}, ValueError, "wind of flight 0 is 90 m/s; it must not be above 84"),
        ({"wind": [1.0, 2.0, 3.0]}, ValueError, r"wind is \(3,\)"),
        ({"wind": np.nan}, ValueError, "wind is nan"),
        ({"bank": 0.0}, ValueError, "bank is 0.0"),
        ({"bank_sigma": -0.1}, ValueError, "bank_sigma is -0.1"),
        ({"navigation_sigma": -1}, ValueError, "navigation_sigma is -1"),
        ({"speed_error": 60.0}, ValueError, "at most a quarter of the speed: 55 m/s"),
        ({"lasting": 0.0}, ValueError, "lasting is 0.0"),
        ({"step": 0.0}, ValueError, "step is 0.0"),
        ({"step": "1"}, TypeError, "step is '1'"),
        ({"rng": -1}, ValueError, "rng is -1"),
    ],
)
def test_flights_refuse(options, error, message):
    settings = {"plans": [PLAN]} | options
    with pytest.raises(error, match=message):
        flights(settings.pop("plans"), **settings)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"traffic": 3}, TypeError, "traffic is 3"),
        ({"radars": radar()}, TypeError, "(?s)radars is .*; it must be a sequence"),
        ({"radars": [3]}, TypeError, r"radars\[0\] is 3"),
        ({"clutter": 5}, ValueError, "max_range is inf; it must be finite where there is clutter"),
        ({"clutter": -1}, ValueError, r"clutter is \[-1.0\]"),
        ({"clutter": [1, 2]}, ValueError, r"clutter has shape \(2,\); it must fit \(1,\)"),
        ({"phase": [1, 2]}, ValueError, r"phase has shape \(2,\)"),
        ({"bias": [1, 2, 3]}, ValueError, r"bias has shape \(3,\); it must fit \(1, 2\)"),
        ({"outlier_probability": 2}, ValueError, "outlier_probability is 2"),
        ({"outlier_size": -1}, ValueError, "outlier_size is -1"),
        ({"duplicate_probability": -1}, ValueError, "duplicate_probability is -1"),
        ({"height_missing_probability": 2}, ValueError, "height_missing_probability is 2"),
        ({"identity_missing_probability": 2}, ValueError, "identity_missing_probability is 2"),
        ({"identity_garbled_probability": 2}, ValueError, "identity_garbled_probability is 2"),
    ],
)
def test_radar_plots_refuse(options, error, message):
    settings = {"traffic": encounter("crossing", rng=1), "radars": [radar()]} | options
    with pytest.raises(error, match=message):
        radar_plots(settings.pop("traffic"), settings.pop("radars"), **settings)


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: set_up("sea"), ValueError, "name is 'sea'; it must be one of tma, middle"),
        (lambda: routes("sea", 1), ValueError, "name is 'sea'"),
        (lambda: routes("tma", -1), ValueError, "n is -1"),
        (lambda: dense_traffic(-1), ValueError, "n is -1"),
        (lambda: dense_traffic(1, area=3), TypeError, "area is 3"),
        (lambda: dense_traffic(1, speed=(200, 100)), ValueError, "speed is"),
        (lambda: dense_traffic(1, turning_share=2), ValueError, "turning_share is 2"),
        (lambda: dense_traffic(1, duration=0), ValueError, "duration is 0"),
        (lambda: dense_traffic(1, duration=1e9), ValueError, "below ten million steps"),
        (lambda: encounter("collision"), ValueError, "name is 'collision'; it must be one of"),
        (lambda: encounter("crossing", middle=(1, 2, 3)), ValueError, "middle is"),
        (lambda: encounter("crossing", speed=0), ValueError, "speed is 0"),
        (lambda: encounter("crossing", rng=1).at(2, 0.0), IndexError, "between -2 and 1"),
        (lambda: encounter("crossing", rng=1).at(0.5, 0.0), TypeError, "must hold integers"),
        (lambda: encounter("crossing", rng=1).at([0, 1], [0.0] * 3), ValueError, "must fit flight"),
    ],
)
def test_others_refuse(call, error, message):
    with pytest.raises(error, match=message):
        call()


def test_the_parts_of_the_package_make_one_module():
    assert simulate.__all__ == sorted(simulate.__all__)
