"""Flight plans that are added, replaced, removed, and given to tracks while the tracker runs."""

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest
from tracker.flights import RADAR, line, noisy

from tertia.flightplan import CorrelationStatus, FlightPlan
from tertia.tracker import COLUMNS, Plots, Tracker, track

CODE = 0o4321
ROUTE = [[-30e3, 40e3], [0.0, 40e3], [0.0, 90e3]]
SHORTCUT = [[-30e3, 40e3], [-12e3, 40e3], [60e3, 76e3]]


def plan_of(waypoints, speed=150.0, **options):
    return FlightPlan(waypoints, speed, **options)


def flight(plan, n=60, *, code=-1, seed=3, period=4.0):
    """Plots of a flight along a plan."""
    time = period * np.arange(n)
    position, _ = plan.at(time)
    numbers = noisy(position, RADAR, np.random.default_rng(seed))
    return Plots(time, *numbers, identity=np.full(n, code))


def joined(*parts):
    """Plots of several flights."""
    names = "time", "range", "azimuth", "icao_address"
    return Plots(**{name: np.concatenate([getattr(one, name) for one in parts]) for name in names})


def scans(tracker, plots):
    """Give plots one by one; the rows of all of them."""
    return [tracker.update(plots[[k]]) for k in range(len(plots))]


def last(tables, name):
    return np.concatenate([getattr(table, name) for table in tables])[-1]


def assert_same(tables, others):
    for one, other in zip(tables, others, strict=True):
        for column in COLUMNS:
            np.testing.assert_array_equal(getattr(one, column.name), getattr(other, column.name))


@pytest.mark.parametrize("motion", ["imm", "window"])
def test_a_plan_added_before_its_flight_is_as_one_from_the_start(motion):
    plans = [plan_of(ROUTE), plan_of(SHORTCUT)]
    plots = flight(plans[0])
    given = Tracker([RADAR], motion=motion, plans=plans)
    added = Tracker([RADAR], motion=motion)
    assert [added.add_plan(plan) for plan in plans] == [0, 1]
    assert added.plans == tuple(plans)
    found = scans(given, plots)
    assert last(found, "plan") == 0
    assert last(found, "plan_status") == CorrelationStatus.ACCEPTED
    assert_same(found, scans(added, plots))


def test_a_plan_added_later_is_found_in_five_plots():
    plots, other = flight(plan_of(ROUTE)), plan_of([[0.0, -50e3], [40e3, -50e3]])
    # while others are searched, and while that pauses
    for k in (8, 14):
        tracker = Tracker([RADAR], plans=[other])
        assert scans(tracker, plots[:k])[-1].plan[-1] == -1
        number = tracker.add_plan(plan_of(ROUTE))
        found = scans(tracker, plots[k : k + 5])
        assert [table.plan[-1] for table in found] == [-1] * 4 + [number]


def test_a_plan_of_the_identity_is_found_at_once():
    plots, tracker = flight(plan_of(ROUTE), code=CODE), Tracker([RADAR])
    scans(tracker, plots[:6])
    number = tracker.add_plan(plan_of(ROUTE, identity=CODE))
    found = tracker.update(plots[[6]])
    assert found.plan[-1] == number
    assert found.plan_status[-1] == CorrelationStatus.LINKED


def test_a_removed_plan_is_left_and_its_number_not_used_again():
    plots, plan = flight(plan_of(ROUTE)), plan_of(ROUTE)
    tracker, plain = Tracker([RADAR], plans=[plan]), Tracker([RADAR])
    scans(tracker, plots[:20])
    scans(plain, plots[:20])
    tracker.remove_plan(0)
    assert tracker.plans == (None,)
    row = tracker.update(plots[[20]])
    assert (row.plan[-1], row.plan_status[-1]) == (-1, CorrelationStatus.NONE)
    # the same plan again is found in five plots
    assert tracker.add_plan(plan) == 1
    found = scans(tracker, plots[21:26])
    assert [table.plan[-1] for table in found] == [-1] * 4 + [1]
    for call in (lambda: tracker.remove_plan(0), lambda: tracker.replace_plan(0, plan)):
        with pytest.raises(ValueError, match=r"plan is 0; there is no plan of this number"):
            call()
    with pytest.raises(ValueError, match="plan is 2; there is no plan"):
        tracker.remove_plan(2)
    with pytest.raises(TypeError, match="plan is None; it must be a FlightPlan"):
        tracker.add_plan(None)
    with pytest.raises(ValueError, match="takes no plans"):
        Tracker([RADAR], motion="cv").add_plan(plan)


@pytest.mark.parametrize("motion", ["imm", "window"])
def test_a_track_cleared_on_another_route_follows_it_from_the_next_leg(motion):
    filed, cleared = plan_of(ROUTE), plan_of(SHORTCUT)
    square = {"told": [], "left": []}
    for seed in range(12):
        plots = flight(cleared, 80, seed=seed)
        told, left = (Tracker([RADAR], motion=motion, plans=[filed]) for _ in range(2))
        for tracker in (told, left):
            scans(tracker, plots[:20])
        told.replace_plan(0, cleared)
        told = pickle.loads(pickle.dumps(told))
        assert told.plans[0].waypoints.tolist() == SHORTCUT
        tables = {"told": scans(told, plots[20:]), "left": scans(left, plots[20:])}
        assert all(table.plan[-1] == 0 and table.conforms[-1] for table in tables["told"])
        assert not tables["left"][-1].conforms[-1]
        # in the turn of the new plan
        there = cleared.at(plots.time[28:38])[0]
        for name, found in tables.items():
            places = np.array([table.position[-1] for table in found[8:18]])
            square[name].append(np.mean((places - there) ** 2))
        place = told.extrapolate(60.0)[1][0]
        assert np.linalg.norm(place - cleared.at(plots.time[-1] + 60.0)[0]) < 1000
    assert np.mean(square["told"]) < 0.95 * np.mean(square["left"])


def test_other_times_of_the_same_route_change_only_the_times():
    plan = plan_of(ROUTE)
    plots = flight(plan)
    tracker, same = (Tracker([RADAR], plans=[plan]) for _ in range(2))
    scans(tracker, plots[:45])
    scans(same, plots[:45])
    tracker.replace_plan(0, plan_of(ROUTE, start_time=30.0))
    # in the middle of a turn
    assert_same(scans(tracker, plots[45:]), scans(same, plots[45:]))


def test_a_track_leaves_a_plan_that_becomes_that_of_another_identity():
    plots = flight(plan_of(ROUTE), code=CODE)
    tracker = Tracker([RADAR], plans=[plan_of(ROUTE, identity=CODE)])
    assert scans(tracker, plots[:10])[-1].plan[-1] == 0
    tracker.replace_plan(0, plan_of(ROUTE, identity=CODE + 1))
    assert all(table.plan[-1] == -1 for table in scans(tracker, plots[10:30]))


@pytest.mark.parametrize("motion", ["imm", "window"])
def test_a_plan_given_by_hand_is_kept_but_blocked_where_it_is_not_flown(motion):
    right, wrong = plan_of(ROUTE), plan_of([[-30e3, 40e3], [-10e3, 40e3], [-10e3, -40e3]])
    error = {"given": [], "none": []}
    for seed in range(12):
        plots = flight(right, 90, seed=seed)
        tracker = Tracker([RADAR], motion=motion, plans=[right, wrong])
        scans(tracker, plots[:10])
        tracker.correlate(1, 1)
        tracker = pickle.loads(pickle.dumps(tracker))
        found = scans(tracker, plots[10:])
        columns = {
            name: np.concatenate([getattr(table, name) for table in found])
            for name in ("time", "position", "plan", "plan_status", "conforms")
        }
        assert set(columns["plan"]) == {1}
        assert set(columns["plan_status"]) == {CorrelationStatus.MANUAL}
        assert columns["conforms"][0]
        assert not columns["conforms"][-1]
        plain = track(plots, [RADAR], motion=motion)
        tables = (columns["time"], columns["position"]), (plain.time, plain.position)
        for name, (time, position) in zip(error, tables, strict=True):
            late = time > plots.time[40]
            error[name].append(np.mean((position - right.at(time)[0])[late] ** 2))
    # it does as little harm as none
    assert np.mean(error["given"]) < 1.1 * np.mean(error["none"])


def test_a_plan_taken_by_hand_is_not_found_again():
    plan = plan_of(ROUTE, identity=CODE)
    plots = flight(plan, code=CODE)
    tracker = Tracker([RADAR], plans=[plan])
    with pytest.raises(ValueError, match="track is 1; there is no confirmed track"):
        tracker.correlate(1, 0)
    scans(tracker, plots[:10])
    tracker.decorrelate(1)
    assert all(table.plan[-1] == -1 for table in scans(tracker, plots[10:40]))
    with pytest.raises(ValueError, match="track is 1; it has no plan"):
        tracker.decorrelate(1)
    with pytest.raises(ValueError, match="plan is 3; there is no plan"):
        tracker.correlate(1, 3)
    with pytest.raises(TypeError, match="take"):
        tracker.correlate(1, 0, take="yes")
    tracker.correlate(1, 0)
    assert tracker.update(plots[[40]]).plan[-1] == 0


def two_tracks(plan):
    """Plots of a flight along a plan, and of one elsewhere."""
    one, other = flight(plan, 40), line(40)
    both = {
        name: np.stack([getattr(one, name), getattr(other, name)], axis=1).ravel()
        for name in ("time", "range", "azimuth")
    }
    return Plots(**both)


def test_a_plan_of_another_track_is_taken_only_on_demand():
    plan = plan_of(ROUTE)
    plots = two_tracks(plan)
    tracker = Tracker([RADAR], plans=[plan])
    found = tracker.update(plots[:20])
    owner = int(found.track[found.plan == 0][0])
    (other,) = set(found.track.tolist()) - {owner}
    with pytest.raises(ValueError, match=f"plan is 0; it is the plan of track {owner}"):
        tracker.correlate(other, 0)
    tracker.correlate(other, 0, take=True)
    found = tracker.update(plots[20:70])
    assert set(found.plan[found.track == other]) == {0}
    # the one it was taken from does not find it, as it is given by hand
    assert set(found.plan[found.track == owner]) == {-1}
    assert found.plan_status[found.track == other][-1] == CorrelationStatus.MANUAL


def test_a_plan_given_by_hand_is_free_when_its_track_ends():
    plan = plan_of(ROUTE)
    plots = flight(plan)
    tracker = Tracker([RADAR], plans=[plan])
    tracker.update(plots[:8])
    tracker.correlate(1, 0)
    tracker.update(plots[8:10])
    tracker.update(Plots([], [], []), time=float(plots.time[20]))
    found = tracker.update(plots[20:])
    assert set(found.track.tolist()) == {2}
    assert found.plan[-1] == 0
    assert found.plan_status[-1] == CorrelationStatus.ACCEPTED


ADDRESSES = 0x3C4DC1, 0x4CA123


def named_flight(plan, scans_flown, address):
    """Plots of a flight along a plan in some scans only, with an address."""
    plots = flight(plan)[scans_flown]
    return replace(plots, icao_address=np.full(len(plots), address))


@pytest.mark.parametrize("motion", ["imm", "window"])
def test_a_track_that_is_resumed_keeps_the_plan_given_by_hand(motion):
    plan, own, later = plan_of(ROUTE), *ADDRESSES
    tracker = Tracker([RADAR], motion=motion, plans=[plan])
    tracker.update(named_flight(plan, slice(8), own))
    tracker.correlate(1, 0)
    # it ends; meanwhile another aircraft flies along the plan, and does afterwards
    found = tracker.update(named_flight(plan, slice(20, 40), later))
    assert (np.unique(found.track).tolist(), set(found.plan[found.track == 2])) == ([1, 2], {-1})
    tracker = pickle.loads(pickle.dumps(tracker))
    back = replace(named_flight(plan, slice(10, 22), own), time=4.0 * np.arange(40, 52))
    found = tracker.update(joined(back, named_flight(plan, slice(40, 52), later)))
    # from the plot after its confirmation on
    assert set(found.plan[found.track == 1][1:]) == {0}
    assert set(found.plan_status[found.track == 1][1:]) == {CorrelationStatus.MANUAL}
    assert set(found.plan[found.track == 2]) == {-1}


def test_a_track_that_is_resumed_has_no_plan_that_was_given_to_another():
    plan, own, later = plan_of(ROUTE), *ADDRESSES
    tracker = Tracker([RADAR], plans=[plan])
    tracker.update(named_flight(plan, slice(8), own))
    tracker.correlate(1, 0)
    tracker.update(named_flight(plan, slice(20, 40), later))
    # the old track is not there any more, so that nothing has to be taken from it
    tracker.correlate(2, 0)
    back = replace(named_flight(plan, slice(10, 22), own), time=4.0 * np.arange(40, 52))
    found = tracker.update(joined(back, named_flight(plan, slice(40, 52), later)))
    assert set(found.plan[found.track == 1]) == {-1}
    assert set(found.plan[found.track == 2]) == {0}


def test_a_plan_given_by_hand_is_free_when_its_track_is_not_resumed_any_more():
    plan = plan_of(ROUTE, speed=60.0)
    own, later = (replace(flight(plan, 200), icao_address=np.full(200, one)) for one in ADDRESSES)
    tracker = Tracker([RADAR], plans=[plan])
    tracker.update(own[:8])
    tracker.correlate(1, 0)
    tracker.update(Plots([], [], []), time=400.0)
    assert set(tracker.update(later[120:150]).plan) == {-1}
    # after ten minutes
    assert tracker.update(later[150:]).plan[-1] == 0


def test_a_blocked_plan_that_is_replaced_counts_once_the_track_is_on_the_new_route():
    cleared = plan_of(SHORTCUT)
    plots = flight(cleared, 80)
    tracker = Tracker([RADAR], plans=[plan_of(ROUTE)])
    assert not scans(tracker, plots[:60])[-1].conforms[-1]
    tracker.replace_plan(0, cleared)
    found = scans(tracker, plots[60:66])
    assert [bool(table.conforms[-1]) for table in found] == [False] * 4 + [True] * 2


def test_plans_that_are_added_later_are_not_in_a_copy():
    tracker = Tracker([RADAR], plans=[plan_of(ROUTE)])
    copied = copy.copy(tracker)
    tracker.add_plan(plan_of(SHORTCUT))
    assert len(tracker.plans) == 2
    assert len(copied.plans) == 1
