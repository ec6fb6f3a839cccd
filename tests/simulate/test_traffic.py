"""Traffic between its samples, set-ups, dense traffic and encounters."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from scipy import stats
from simulate.aircraft import GRAVITY, corner, course, wrapped, zigzag

from tertia.simulate import (
    SetUpName,
    dense_traffic,
    encounter,
    flights,
    routes,
    set_up,
)


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
