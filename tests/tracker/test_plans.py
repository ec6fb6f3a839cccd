"""Flight plans: they help where they are flown, and do no harm where not."""

import pickle

import numpy as np
import pytest
from tracker.flights import RADAR, noisy, squared_errors

from tertia import simulate
from tertia.flightplan import FlightPlan
from tertia.tracker import PlanModel, Plots, Tracker, track


def rms(squares):
    return np.sqrt(np.mean(np.concatenate(squares)))


def test_plans_help_and_probability_zero_is_the_plain_imm():
    plans = simulate.routes("middle", 40, rng=81)
    traffic = simulate.flights(plans, wind=20.0, rng=82)
    radar = simulate.set_up("middle").radar
    seen = simulate.radar_plots(traffic, [radar], rng=83)
    square = {"with": [], "without": []}
    for flight in range(40):
        of = seen.target == flight
        if of.sum() < 20:
            continue
        plots, plan = seen.plots[of], [plans[flight]]
        plain, aided = track(plots, [radar]), track(plots, [radar], plans=plan)
        silent = track(plots, [radar], plans=plan, plan_model=PlanModel(0.0))
        np.testing.assert_allclose(silent.position, plain.position, rtol=0, atol=1e-6)
        assert np.all(aided.plan[-5:] == 0)
        for name, found in (("with", aided), ("without", plain)):
            squares, turning = squared_errors(found, traffic, flight)
            square[name].append(squares[found.confirmed & turning])
    assert rms(square["with"]) < 0.8 * rms(square["without"])


def test_a_wrong_plan_is_blocked_and_does_no_harm():
    plans = simulate.routes("middle", 40, rng=91)
    traffic = simulate.flights(plans, scenario="hijack", wind=20.0, rng=92)
    radar = simulate.set_up("middle").radar
    seen = simulate.radar_plots(traffic, [radar], rng=93)
    square, blocked = {"with": [], "without": []}, []
    for flight in range(40):
        left, of = traffic.left[flight], seen.target == flight
        end = traffic.start[flight] + traffic.step * (traffic.count[flight] - 1)
        if of.sum() < 20 or np.isnan(left) or end < left + 60:
            continue
        tables = {
            "with": track(seen.plots[of], [radar], plans=[plans[flight]]),
            "without": track(seen.plots[of], [radar]),
        }
        for name, found in tables.items():
            squares, _ = squared_errors(found, traffic, flight)
            square[name].append(squares[found.confirmed & (found.time > left)])
        table = tables["with"]
        blocked.append(np.any(~table.conforms[(table.time > left) & (table.time < left + 60)]))
    assert rms(square["with"]) < 1.04 * rms(square["without"])
    assert np.mean(blocked) > 0.9


def lost_and_turns(scenario, seed, flights=60):
    """Flights in more than one track, and rms errors in turns: the window, and it with plans."""
    plans = simulate.routes("middle", flights, rng=seed)
    traffic = simulate.flights(plans, scenario=scenario, wind=20.0, rng=seed + 1)
    radar = simulate.set_up("middle").radar
    seen = simulate.radar_plots(traffic, [radar], rng=seed + 2)
    lost, squares = np.zeros(2, dtype=int), ([], [])
    for flight in range(flights):
        plots = seen.plots[seen.target == flight]
        if len(plots) < 20:
            continue
        for i, plan in enumerate(([], [plans[flight]])):
            found = track(plots, [radar], motion="window", plans=plan)
            lost[i] += len(np.unique(found.track)) > 1
            square, turning = squared_errors(found, traffic, flight)
            squares[i].append(square[turning & found.confirmed])
    return lost, [rms(each) for each in squares]


def test_the_window_holds_flights_that_turn_and_a_plan_makes_it_better():
    lost, (usual, aided) = lost_and_turns("conforming", 101)
    assert np.all(lost <= 1)
    assert aided < 0.9 * usual


@pytest.mark.parametrize("scenario", ["wrong-turn", "straight-on"])
def test_the_window_survives_a_wrong_plan(scenario):
    lost, _ = lost_and_turns(scenario, 111)
    assert np.all(lost <= 1)


def test_a_known_wind_makes_turns_better():
    plans = simulate.routes("en-route", 30, rng=101)
    wind = np.array([30.0, -25.0])
    traffic = simulate.flights(plans, wind=wind, rng=102)
    radar = simulate.set_up("en-route").radar
    seen = simulate.radar_plots(traffic, [radar], rng=103)
    models = {
        "known": PlanModel(wind=(33.0, -29.0), wind_sigma=6.0),
        "unknown": PlanModel(wind_sigma=30.0),
        "wrong": PlanModel(wind=-wind, wind_sigma=6.0),
    }
    square = {name: [] for name in models}
    for flight in range(30):
        plots = seen.plots[seen.target == flight]
        for name, model in models.items():
            found = track(plots, [radar], plans=[plans[flight]], plan_model=model)
            squares, turning = squared_errors(found, traffic, flight)
            square[name].append(squares[found.confirmed & turning])
    assert rms(square["known"]) < 0.95 * rms(square["unknown"])
    assert rms(square["wrong"]) > 1.1 * rms(square["known"])


def on_plan(n=40, identity=None):
    """A flight on the leg of its plan, a plot at a time, and the plan."""
    plan = FlightPlan([[-30e3, 40e3], [40e3, 40e3], [60e3, 60e3]], 150.0, identity=0o4321)
    time = 4.0 * np.arange(n)
    position = np.array([-30e3, 40e3]) + np.outer(time, [150.0, 0.0])
    numbers = noisy(position, RADAR, np.random.default_rng(9))
    codes = np.full(n, 0o4321) if identity is None else identity
    return Plots(time, *numbers, identity=codes), plan


@pytest.mark.parametrize("motion", ["imm", "window"])
def test_a_suspended_plan_is_blocked_until_it_is_resumed(motion):
    plots, plan = on_plan()
    tracker = Tracker([RADAR], motion=motion, plans=[plan])
    plain = track(plots, [RADAR], motion=motion)
    with pytest.raises(ValueError, match="track is 1; there is no confirmed track"):
        tracker.suspend_plan(1)
    assert tracker.update(plots[:15]).conforms[-1]
    assert len(tracker.suspended_plans) == 0
    tracker.suspend_plan(1)
    np.testing.assert_array_equal(tracker.suspended_plans, [1])
    # the copy is held, too
    tracker = pickle.loads(pickle.dumps(tracker))
    held = tracker.update(plots[15:28])
    assert len(held) == 13
    assert not held.conforms.any()
    assert np.all(held.plan == 0)
    straight = held.position[-1] + 120.0 * held.velocity[-1]
    np.testing.assert_allclose(tracker.extrapolate(120.0)[1][0], straight, atol=1e-6)
    tracker.resume_plan(1)
    assert len(tracker.suspended_plans) == 0
    released = tracker.update(plots[28:])
    assert not released.conforms[:4].any()
    assert released.conforms[4:].all()
    # held before the plan was found: the plan has no say at all
    early, (plots, _) = (
        Tracker([RADAR], motion=motion, plans=[plan]),
        on_plan(identity=np.full(40, -1)),
    )
    tables = [early.update(plots[:5])]
    assert tables[0].plan[-1] == -1
    early.suspend_plan(1)
    tables += [early.update(plots[[k]]) for k in range(5, len(plots))]
    assert not any(table.conforms.any() for table in tables)
    position = np.concatenate([table.position for table in tables])
    assert tables[-1].plan[0] == 0
    np.testing.assert_allclose(position[-1], plain.position[-1], rtol=0, atol=1e-6)
    for number in (7, "1"):
        with pytest.raises((ValueError, TypeError), match="track"):
            tracker.resume_plan(number)


@pytest.mark.parametrize("code", [0o7500, 0o7600, 0o7700])
def test_an_emergency_suspends_the_plan(code):
    codes = np.full(40, 0o4321)
    codes[12] = codes[20:22] = code
    plots, plan = on_plan(identity=codes)
    tracker = Tracker([RADAR], plans=[plan], emergency_codes=(0o7500, 0o7600, 0o7700))
    found = tracker.update(plots)
    # one answer may be read wrongly; what was held stays so, and the identity stays
    of = {plot: row for row, plot in enumerate(found.plot)}
    assert found.conforms[of[10] : of[20] + 1].all()
    assert not found.conforms[of[21] :].any()
    assert np.all(found.identity == 0o4321)
    assert np.all(found.track == 1)
    np.testing.assert_array_equal(tracker.suspended_plans, [1])
    # an identity like any other, where it is no emergency
    assert track(plots, [RADAR], plans=[plan]).conforms[-1]


def test_extrapolation_follows_the_plan():
    plan = FlightPlan([[-30e3, 40e3], [10e3, 40e3], [10e3, 90e3]], 150.0)
    time = 4.0 * np.arange(50)
    position = np.array([-30e3, 40e3]) + np.outer(time, [150.0, 0.0])
    plots = Plots(time, *noisy(position, RADAR, np.random.default_rng(5)))
    aided, plain = Tracker([RADAR], plans=[plan]), Tracker([RADAR])
    aided.update(plots)
    plain.update(plots)
    corner = np.array([10e3, 40e3])
    (number,), (there,) = aided.extrapolate(120.0)
    assert number == 1
    assert np.linalg.norm(plain.extrapolate(120.0)[1][0] - [17.4e3, 40e3]) < 3000
    assert there[0] < corner[0] + 500
    assert there[1] > corner[1] + 2000
