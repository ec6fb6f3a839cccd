"""What a tracker says about units, largest speeds and errors of ranges that cannot be as stated."""

import pickle

import numpy as np
import pytest

from tertia.sensors import PositionSensor, Radar, Station
from tertia.tracker import Plots, Tracker, track

PERIOD = 4.0
RADARS = tuple(
    Radar(place, range_sigma=40.0, azimuth_sigma=0.0012, scan_period=PERIOD)
    for place in ((-30e3, 0.0), (30e3, 10e3))
)
UNITS = {"feet": 0.3048, "yards": 0.9144, "kilometres": 1e3, "nautical miles": 1852.0}


def seen(radar, random, scans=40, begin=0.0, slant=True):
    """Return times, ranges, azimuths and heights of fifteen aircraft, the same for all radars."""
    traffic = np.random.default_rng(5)
    place, course = traffic.uniform(-60e3, 60e3, (15, 2)), traffic.uniform(0, 2 * np.pi, 15)
    velocity = traffic.uniform(120, 250, 15) * np.stack([np.sin(course), np.cos(course)])
    height = traffic.uniform(3e3, 11e3, 15)
    number, scan = (one.ravel() for one in np.meshgrid(np.arange(15), np.arange(scans)))
    time = begin + PERIOD * scan
    for _ in range(4):
        away = place[number] + (velocity[:, number] * time).T - radar.position[:2]
        azimuth = np.arctan2(*away.T) % (2 * np.pi)
        time = begin + PERIOD * (scan + azimuth / (2 * np.pi))
    length = np.hypot(np.linalg.norm(away, axis=1), slant * height[number])
    length += radar.range_sigma * random.standard_normal(len(time))
    azimuth = azimuth + radar.azimuth_sigma * random.standard_normal(len(time))
    return np.stack([time, length, azimuth % (2 * np.pi), height[number]])


def plots(seed, slant=True, unit=1.0, scale=1.0, height_unit=1.0):
    """Return plots of two radars; the second one has ranges or heights that are not as stated."""
    random = np.random.default_rng(seed)
    first, second = (
        seen(radar, random, begin=1.3 * k, slant=slant or k == 0) for k, radar in enumerate(RADARS)
    )
    second[1] *= scale / unit
    second[3] /= height_unit
    both, sensor = np.concatenate([first, second], axis=1), np.repeat([0, 1], first.shape[1])
    order = np.argsort(both[0], kind="stable")
    time, length, azimuth, height = both[:, order]
    return Plots(time, length, azimuth, height=height, sensor=sensor[order])


def live(tracker, all_plots):
    """Update a tracker, which is saved and restored between the updates."""
    for begin in np.arange(0.0, np.max(all_plots.time), 10.0):
        now = (all_plots.time >= begin) & (all_plots.time < begin + 10.0)
        tracker.update(all_plots[now])
        tracker = pickle.loads(pickle.dumps(tracker))


def told(text, all_plots, sensors=RADARS, **options):
    """Check that recordings and live plots lead to this warning, once, and to no other."""
    for follow in (
        lambda: track(all_plots, sensors, **options),
        lambda: live(Tracker(sensors, **options), all_plots),
    ):
        with pytest.warns(UserWarning, match=text) as warned:
            follow()
        assert len(warned) == 1


def test_nothing_is_told_if_all_is_as_stated():
    for seed in range(3):
        track(plots(seed), RADARS)
        live(Tracker(RADARS), plots(seed))
    live(Tracker(RADARS, lag=8.0), plots(3))


@pytest.mark.parametrize("called", UNITS)
def test_ranges_in_another_unit_are_told(called):
    text = rf"sensors\[1\]: .*{UNITS[called]:g} times as long: are they in {called}\?"
    told(text, plots(11, unit=UNITS[called]))


def test_ranges_of_a_wrong_scale_are_told():
    for scale, text in ((1.02, r"\+(1\.9|2\.0) %"), (0.985, r"-1\.[45] %")):
        told(rf"sensors\[1\]: its ranges are {text} off", plots(12, scale=scale))


@pytest.mark.filterwarnings("ignore:.*its ranges are:UserWarning")
def test_ranges_of_a_wrong_scale_are_corrected():
    for scale in (1.02, 0.985):
        table = track(plots(20, scale=scale), RADARS)
        assert len(np.unique(table.track[table.confirmed])) == 15


def test_ranges_on_the_ground_and_heights_in_feet_are_told():
    text = r"sensors\[1\]: its plots agree with those of other sensors without the heights"
    told(text, plots(13, slant=False))
    told(text, plots(14, height_unit=0.3048))


def test_ranges_on_the_ground_are_told_with_a_lag():
    with pytest.warns(UserWarning, match="without the heights"):
        live(Tracker(RADARS, lag=8.0), plots(15, slant=False))


def test_stations_have_no_ranges():
    own, station = plots(16, slant=False), Station([0.0, 0.0], azimuth_sigma=0.01)
    columns = (own.time, own.range, own.azimuth, own.height, own.sensor)
    bearings = (own.time[:40], np.full(40, np.nan), own.azimuth[:40], np.full(40, np.nan), [2] * 40)
    both = [np.concatenate(parts) for parts in zip(columns, bearings, strict=True)]
    every = Plots(*both[:3], height=both[3], sensor=both[4])
    with pytest.warns(UserWarning, match="without the heights"):
        track(every, [*RADARS, station])


@pytest.mark.parametrize("most", [0.25, 80.0])
def test_targets_that_are_faster_than_the_largest_speed_are_told(most):
    told(rf"sensors\[0\].*about \d+ m/s, and max_speed is {most:g} m/s", plots(17), max_speed=most)


def irregular(random):
    """Return times, ranges and azimuths of eight aircraft that a phased array sees at any time."""
    time = np.cumsum(random.exponential(2.0, (8, 120)) + 0.2, axis=1)
    course, speed = random.uniform(0, 2 * np.pi, (8, 1)), random.uniform(100, 250, (8, 1))
    begin = random.uniform(-30e3, 30e3, (8, 2, 1))
    east, north = (
        begin[:, axis] + speed * turn(course) * time for axis, turn in enumerate((np.sin, np.cos))
    )
    length = np.hypot(east, north) + 20.0 * random.standard_normal(time.shape)
    azimuth = np.arctan2(east, north) + 0.002 * random.standard_normal(time.shape)
    order = np.argsort(time, axis=None)
    return [one.ravel()[order] for one in (time, length, azimuth % (2 * np.pi))]


def test_a_radar_without_a_beam_that_turns_is_told():
    radar = Radar(range_sigma=20.0, azimuth_sigma=0.002, scan_period=2.0)
    time, length, azimuth = irregular(np.random.default_rng(18))
    told("do not follow a beam that turns", Plots(time, length, azimuth), [radar])
    # all plots of a scan at the time of its end
    ended = Plots(2.0 * np.ceil(time / 2.0), length, azimuth)
    for follow in (lambda: track(ended, [radar]), lambda: live(Tracker([radar]), ended)):
        follow()


def test_reports_are_at_any_time():
    time, length, azimuth = irregular(np.random.default_rng(19))
    position = length[:, np.newaxis] * np.stack([np.sin(azimuth), np.cos(azimuth)], axis=-1)
    sensor = PositionSensor(position_sigma=60.0, update_interval=4.0)
    track(Plots(time, position=position), [sensor])
