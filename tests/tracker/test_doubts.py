"""What a tracker says about periods of sensors, and about addresses of two tracks."""

import copy
import dataclasses
import pickle

import numpy as np
import pytest
from tracker.flights import RADAR

from tertia.sensors import Bias
from tertia.tracker import Plots, PositionSensor, Radar, Tracker, smooth_tracks, track

PERIOD = RADAR.scan_period


def beam():
    """Return plots of eight aircraft at all azimuths, at the times of the beam."""
    number, scan = np.meshgrid(np.arange(8), np.arange(30))
    azimuth = (2.0 * np.pi * (number + 0.5) / 8.0).ravel()
    time = PERIOD * (scan.ravel() + azimuth / (2.0 * np.pi))
    return Plots(time, 30e3 + 1e3 * number.ravel() + 150.0 * time, azimuth)


def reports(address=None):
    """Return reports of five aircraft every 4 s, 5 km apart."""
    number, step = np.meshgrid(np.arange(5), np.arange(40))
    time = 4.0 * step + 0.7 * number
    position = np.stack([150.0 * time, 5e3 * number], axis=-1).reshape(-1, 2)
    own = None if address is None else np.asarray(address)[number.ravel()]
    return Plots(time.ravel(), position=position, icao_address=own)


def live(tracker, plots):
    for begin in np.arange(0.0, np.max(plots.time), 10.0):
        tracker.update(plots[(plots.time >= begin) & (plots.time < begin + 10.0)])


def test_a_scan_period_that_is_half_or_twice_the_true_one_is_told_once():
    plots, text = beam(), r"sensors\[0\]: its beam turns once in about"
    for stated in (0.5 * PERIOD, 2.0 * PERIOD):
        radar = dataclasses.replace(RADAR, scan_period=stated)
        with pytest.warns(UserWarning, match=text) as told:
            track(plots, [radar])
        assert len(told) == 1
        tracker = Tracker([radar])
        tracker.update(plots[:20])
        tracker = pickle.loads(pickle.dumps(copy.copy(tracker)))
        with pytest.warns(UserWarning, match=text) as told:
            live(tracker, plots[20:])
        assert len(told) == 1
    live(Tracker([RADAR]), plots)


def test_an_update_interval_that_is_too_short_is_told():
    sensor = PositionSensor(position_sigma=20.0, update_interval=1.0)
    for follow in (lambda: track(reports(), [sensor]), lambda: live(Tracker([sensor]), reports())):
        with pytest.warns(UserWarning, match=r"come about every 4 s, and update_interval is 1 s"):
            follow()
    track(reports(), [dataclasses.replace(sensor, update_interval=4.0)])


def test_two_tracks_with_one_address_are_told_once():
    sensor = PositionSensor(position_sigma=20.0, update_interval=4.0)
    plots = reports([0x400000, 0x400001, 0x400002, 0x400003, 0x400001])
    text = "tracks 2 and 5 have the same address, 400001"
    for follow in (lambda: track(plots, [sensor]), lambda: live(Tracker([sensor]), plots)):
        with pytest.warns(UserWarning, match=text) as told:
            follow()
        assert len(told) == 1
    live(Tracker([sensor]), reports(0x400000 + np.arange(5)))


def test_the_deviation_of_a_direction_finder_is_refused():
    bias = Bias(deviation_order=1, deviation_sigma=0.3, degrees=True)
    radar = Radar(range_sigma=50.0, azimuth_sigma=0.001, scan_period=4.0, bias=bias)
    for use in (lambda: Tracker([radar]), lambda: smooth_tracks(beam(), [radar])):
        with pytest.raises(ValueError, match=r"sensors\[0\].bias has deviation_order 1"):
            use()
