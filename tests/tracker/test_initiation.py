"""New targets where flights are due."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from tertia.flightplan import FlightPlan
from tertia.sensors import Channel
from tertia.tracker import PlanModel, Plots, Radar, Tracker, TrackTable, track

RADAR = Radar(
    range_sigma=75.0,
    azimuth_sigma=0.1,
    scan_period=6.0,
    max_range=200e3,
    detection_probability=0.94,
    degrees=True,
)
PLANS = [
    FlightPlan([[-150e3, north], [150e3, north]], 200.0, start_time=-700.0)
    for north in (-90e3, 30e3, 60e3, 120e3)
]
SCANS, FIRST = 24, 12
AIDED = PlanModel(initiation=True)
# scan, north, speed, metres behind
DUE = (FIRST, 30e3, 200.0, 0.0)


def scene(seed, *targets):
    """Plots, and those of each target, which is a scan, north, speed and metres behind."""
    rng = np.random.default_rng(seed)
    times, places, of = [], [], []
    for number, (first, north, speed, behind) in enumerate(targets):
        scan = RADAR.scan_period * np.arange(first, SCANS)
        # 6 km before the first flight is due
        east = 200.0 * (scan[0] + 700.0) - 150e3 - 6e3 - behind + speed * (scan - scan[0])
        noise = 75.0 * rng.standard_normal((len(scan), 2))
        times.append(scan)
        places.append(np.column_stack([east, np.full(len(scan), north)]) + noise)
        of.append(np.full(len(scan), number))
    count = 40 * SCANS
    far, angle = 199e3 * np.sqrt(rng.uniform(size=count)), rng.uniform(0, 2 * np.pi, count)
    times.append(RADAR.scan_period * rng.integers(0, SCANS, count))
    places.append(far[:, np.newaxis] * np.column_stack([np.sin(angle), np.cos(angle)]))
    of.append(np.full(count, -1))
    place, target = np.concatenate(places), np.concatenate(of)
    azimuth = np.arctan2(*place.T) % (2 * np.pi)
    time = np.concatenate(times) + RADAR.scan_period * azimuth / (2 * np.pi)
    order = np.argsort(time, kind="stable")
    plots = Plots(time[order], np.hypot(*place.T)[order], azimuth[order])
    return plots, [np.flatnonzero(target[order] == k) for k in range(len(targets))]


def plots_to_confirmation(found, own):
    """Which plot of the target, from 1, is the first of a confirmed track."""
    confirmed = np.isin(own, found.plot[found.confirmed])
    return 1 + int(np.argmax(confirmed))


def means(*targets):
    """Plots that confirm the last target, with plans and without."""
    counts = [], []
    for seed in range(12):
        plots, own = scene(seed, *targets)
        for model, each in zip((AIDED, None), counts, strict=True):
            found = track(plots, [RADAR], plans=PLANS, plan_model=model)
            each.append(plots_to_confirmation(found, own[-1]))
    return np.mean(counts, axis=1)


def test_two_plots_are_enough_where_a_flight_is_due():
    aided, plain = means(DUE)
    assert plain >= 3.0
    assert aided <= 2.3


def test_two_plots_are_enough_unless_false_ones_are_as_near_to_a_flight_as_often():
    """12 to 24 km behind, where flights are due with a standard deviation of 24 km."""
    late = [means((FIRST, 30e3, 200.0, behind)) for behind in (6e3, 18e3)]
    aided, plain = np.mean(late, axis=0)
    assert plain >= 3.0
    assert aided <= 2.1


def test_two_plots_are_enough_where_a_radar_has_channels():
    channels = {"psr": Channel(0.8), "ssr": Channel(0.7)}
    radar = replace(RADAR, detection_probability=None, channels=channels)
    shares = np.array([0.24, 0.14, 0.56]) / 0.94
    counts = [], []
    for seed in range(12):
        plots, (own,) = scene(seed, DUE)
        detection = np.zeros(len(plots), dtype=np.int64)
        detection[own] = np.random.default_rng([9, seed]).choice(3, size=own.size, p=shares)
        plots = replace(plots, detection=detection)
        for model, each in zip((AIDED, None), counts, strict=True):
            found = track(plots, [radar], plans=PLANS, plan_model=model)
            each.append(plots_to_confirmation(found, own))
    aided, plain = np.mean(counts, axis=1)
    assert plain >= 3.0
    assert aided <= 2.3


def test_targets_elsewhere_or_of_another_course_are_confirmed_as_ever():
    for target in ((FIRST, 75e3, 200.0, 0.0), (FIRST, 30e3, -200.0, 0.0)):
        aided, plain = means(target)
        assert abs(aided - plain) <= 0.35


def test_a_flight_that_has_a_track_is_not_expected_again():
    second = (FIRST + 5, 30e3, 200.0, 12e3)
    alone, _ = means(second)
    behind, plain = means(DUE, second)
    assert alone <= 2.3
    assert behind >= plain - 0.1


def test_the_track_has_the_plan_by_which_it_was_found_at_once():
    plots, (own,) = scene(1, DUE)
    plans = []
    for model in (AIDED, None):
        found = track(plots, [RADAR], plans=PLANS, plan_model=model)
        rows = np.flatnonzero(np.isin(found.plot, own) & found.confirmed)
        plans.append(found.plan[rows[0]])
    assert plans == [1, -1]


def test_no_say_without_plans_or_for_the_score_of_the_paper():
    plots, _ = scene(5, DUE)
    for options in ({}, {"plans": PLANS, "association": "paper", "motion": "window"}):
        plain = track(plots, [RADAR], **options)
        aided = track(plots, [RADAR], plan_model=AIDED, **options)
        for name in TrackTable.__slots__:
            np.testing.assert_array_equal(getattr(aided, name), getattr(plain, name))


def test_a_saved_tracker_goes_on_to_the_last_bit():
    plots, _ = scene(7, DUE)
    half = int(np.searchsorted(plots.time, RADAR.scan_period * (FIRST + 1.5)))
    whole = Tracker([RADAR], plans=PLANS, plan_model=AIDED)
    whole.update(plots[:half], time=float(plots.time[half]) - 1e-6)
    saved = pickle.loads(pickle.dumps(whole))
    tables = [tracker.update(plots[half:]) for tracker in (whole, saved)]
    for name in TrackTable.__slots__:
        np.testing.assert_array_equal(getattr(tables[0], name), getattr(tables[1], name))


@pytest.mark.parametrize("north", [0.0, 700.0])
def test_no_more_false_tracks_where_all_false_plots_are_on_routes(north):
    rng = np.random.default_rng(61)
    counts = []
    for model in (None, AIDED):
        confirmed = 0
        for _ in range(10):
            count = 60 * 100
            east = rng.uniform(-150e3, 150e3, count)
            aside = rng.normal(north, 700.0, count)
            place = np.column_stack([east, rng.choice([-90e3, 30e3, 60e3, 120e3], count) + aside])
            azimuth = np.arctan2(*place.T) % (2 * np.pi)
            time = RADAR.scan_period * (rng.integers(0, 100, count) + azimuth / (2 * np.pi))
            plots = Plots(time, np.hypot(*place.T), azimuth)
            found = track(plots, [RADAR], plans=PLANS, plan_model=model)
            confirmed += len(np.unique(found.track[found.confirmed]))
        counts.append(confirmed)
    assert counts[1] <= counts[0] + 2


def test_it_is_true_or_false():
    assert not PlanModel().initiation
    with pytest.raises(TypeError, match="initiation is 1; it must be True or False"):
        PlanModel(initiation=1)


def test_a_false_plot_does_not_delay_a_target():
    """Its first plot is near a false one, as if both were of one target."""
    time = RADAR.scan_period * np.arange(6)
    east = np.array([-1e3, 0.0, 0.0, 0.0, 0.0, 0.0])
    north = np.array([60e3, 60e3, 61.2e3, 62.4e3, 63.6e3, 64.8e3])
    plots = Plots(time, np.hypot(east, north), np.arctan2(east, north))
    found = track(plots, [RADAR], clutter_density=3e-9, registration=False)
    assert plots_to_confirmation(found, np.arange(1, 6)) == 4
    assert 0 not in found.plot[found.confirmed]
