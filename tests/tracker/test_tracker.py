"""The tracker itself: saved, in threads, its table, and options that are refused."""

import copy
import pickle

import numpy as np
import pytest
from checks import assert_covariance, assert_result, assert_same, assert_threads
from tracker.flights import RADAR, line, scene

from tertia import simulate
from tertia.flightplan import FlightPlan
from tertia.tracker import (
    COLUMNS,
    CvModel,
    ImmModel,
    PlanModel,
    Radar,
    SingerModel,
    Tracker,
    TrackTable,
    WindowModel,
    track,
)

MOTIONS = ["imm", "singer", "cv", "window"]


@pytest.mark.parametrize("motion", MOTIONS)
def test_a_saved_tracker_goes_on_to_the_last_bit(motion):
    _, _, seen = scene(31, n=10, clutter=10.0)
    radar = simulate.set_up("middle").radar
    plans = simulate.routes("middle", 10, rng=31) if motion in {"imm", "window"} else []
    half = np.median(seen.plots.time)
    first, second = seen.plots[seen.plots.time < half], seen.plots[seen.plots.time >= half]
    tracker = Tracker([radar], motion=motion, plans=plans)
    tracker.update(first)
    loaded = pickle.loads(pickle.dumps(tracker))
    copied = copy.deepcopy(tracker)
    expected = tracker.update(second)
    for other in (loaded, copied):
        assert_same(other.update(second), expected)
    assert repr(loaded) == repr(tracker)


def test_a_damaged_state_is_refused():
    _, _, seen = scene(31, n=10, clutter=10.0)
    tracker = Tracker([simulate.set_up("middle").radar])
    tracker.update(seen.plots)
    *others, saved = tracker.__getstate__()
    random = np.random.default_rng(5)
    for place in random.integers(len(saved), size=500):
        damaged = bytearray(saved)
        damaged[place] ^= 1 << random.integers(8)
        with pytest.raises(ValueError, match="not the state of a Tracker"):
            tracker.__setstate__((*others, bytes(damaged)))
    for damaged in (b"", saved[:-1], saved[1:], saved + b"\0", saved[:-8], bytes(len(saved))):
        with pytest.raises(ValueError, match="not the state of a Tracker"):
            tracker.__setstate__((*others, damaged))
    tracker.__setstate__((*others, saved))


def test_tracks_do_not_depend_on_the_number_of_threads():
    traffic = simulate.dense_traffic(1200, area=(120e3, 120e3), duration=12.0, rng=1)
    radars = [
        Radar((x, 0.0), range_sigma=50.0, azimuth_sigma=0.0014, scan_period=4.0, max_range=150e3)
        for x in (-30e3, 0.0, 30e3)
    ]
    plots = simulate.radar_plots(traffic, radars, clutter=200.0, rng=2).plots
    one = track(plots, radars, n_threads=1)
    # stretches of three seconds have room for two threads
    assert len(plots) / 4 > 2000
    assert len(np.unique(one.track)) > 1000
    assert_threads(lambda **threads: track(plots, radars, **threads))
    with pytest.raises(ValueError, match="n_threads is 0"):
        Tracker(radars, n_threads=0)


def test_a_table_is_complete_wherever_it_goes():
    table = track(line(), [RADAR])
    assert_result(table)
    assert_covariance(table.covariance)
    for other in (pickle.loads(pickle.dumps(table)), copy.copy(table), table[:]):
        assert_same(other, table)
    assert len(table[table.plot < 3]) == 3
    assert [column.name for column in COLUMNS] == [*TrackTable.__slots__[:-1]]
    for column in COLUMNS:
        values = getattr(table, column.name)
        assert values.shape == (20, *column.shape)
        assert values.dtype.kind == {"str": "U"}.get(column.type, column.type[0])
        assert column.doc
    with pytest.raises(AttributeError, match="no attribute 'speed'"):
        _ = table.speed
    with pytest.raises(ValueError, match=r"time has shape \(\)"):
        line()[3]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sensors": []}, "sensors is empty"),
        ({"sensors": [3]}, r"sensors\[0\] is 3"),
        ({"motion": "kalman"}, "motion is 'kalman'"),
        ({"confirmation": (1, 4)}, "confirmation is 1"),
        ({"confirmation": (4, 3)}, "confirmation"),
        ({"coasting": 0}, "coasting is 0"),
        ({"max_speed": -1.0}, "max_speed"),
        ({"profile": ["drone"]}, r"profile is \['drone'\]; it must be one of"),
        ({"profile": "ship"}, "profile is 'ship'; it must be one of aircraft, vessel"),
        ({"gate_probability": 1.0}, "gate_probability is 1"),
        ({"clutter_density": 0.0}, "clutter_density"),
        ({"identity_error_probability": 0.0}, "identity_error_probability"),
        ({"guard_acceleration": -1.0}, "guard_acceleration"),
        ({"plan_model": 0.8}, "plan_model is 0.8; it must be a PlanModel"),
        ({"motion": 3}, "motion is 3; it must be a model"),
        ({"motion": SingerModel(4.0, 0.05, 1.0)}, "it must be exact"),
        ({"emergency_codes": [-1]}, "emergency_codes is -1"),
        ({"plans": [3]}, r"plans\[0\] is 3"),
        ({"clock_period": 0.0}, "clock_period"),
        ({"sensors": RADAR}, "it must be a sequence of Radar"),
        ({"plans": FlightPlan([[0, 0], [1, 1]], 100.0)}, "it must be a sequence of FlightPlan"),
        ({"confirmation": 3}, "it must be a pair"),
        ({"confirmation": 1.0}, "confirmation is 1; it must be between 0 and 1"),
        ({"confirmation": "3,4"}, "it must be a pair"),
        ({"plans": [FlightPlan([[0, 0], [1, 1]], 100.0)], "motion": "cv"}, "takes no plans"),
    ],
)
def test_wrong_settings_are_refused(change, message):
    with pytest.raises((ValueError, TypeError), match=message):
        Tracker(**{"sensors": [RADAR], **change})


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ImmModel(turn_time=0.0), "turn_time"),
        (lambda: ImmModel(acceleration_sigma=-0.5), "acceleration_sigma"),
        (lambda: CvModel(-1.0), "straight_sigma"),
        (lambda: WindowModel(after_turn=1), "after_turn is 1"),
        (lambda: PlanModel(1.0), "flown_probability is 1.0"),
        (lambda: PlanModel(wind_sigma=np.nan), "wind_sigma"),
        (lambda: PlanModel(wind=(np.inf, 0.0)), "wind"),
        (lambda: PlanModel(wind=5.0), r"wind has shape \(\)"),
    ],
)
def test_wrong_models_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()
