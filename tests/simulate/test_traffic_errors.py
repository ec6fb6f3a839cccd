"""Seeds, no traffic, and bad input."""

from dataclasses import fields
from typing import get_args

import numpy as np
import pytest
from simulate.aircraft import (
    corner,
    radar,
)

from tertia import simulate
from tertia.flightplan import FlightPlan
from tertia.simulate import (
    FlightScenario,
    dense_traffic,
    encounter,
    flights,
    radar_plots,
    routes,
    set_up,
)


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
        ({"bias": [1, 2, 3]}, TypeError, r"bias is \[1, 2, 3\]; it must be a Bias"),
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
