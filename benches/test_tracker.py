"""Scans of plots through the Python interface."""

import numpy as np
import pytest

from tertia import simulate
from tertia.tracker import Tracker, track

RADAR = simulate.set_up("middle").radar


def recording(aircraft):
    traffic = simulate.dense_traffic(aircraft, duration=120.0, rng=1)
    return simulate.radar_plots(traffic, [RADAR], clutter=50, rng=2).plots


@pytest.mark.parametrize("aircraft", [10, 100, 1000])
def test_a_recording(benchmark, aircraft):
    plots = recording(aircraft)
    benchmark.extra_info["plots"] = len(plots)
    assert len(benchmark(track, plots, [RADAR])) > aircraft


def test_scans_of_four_plots(benchmark):
    traffic = simulate.encounter("crossing", n=4, rng=1)
    plots = simulate.radar_plots(traffic, [RADAR], rng=2).plots
    steps = np.floor(plots.time / RADAR.scan_period).astype(int)
    scans = [plots[steps == k] for k in range(steps.max() + 1)]

    def run():
        tracker = Tracker([RADAR])
        return [tracker.update(scan) for scan in scans]

    benchmark.extra_info["scans"] = len(scans)
    assert len(benchmark(run)) == len(scans)


def test_a_plot_at_a_time(benchmark):
    plots = recording(1)
    pieces = [plots[[k]] for k in range(len(plots))]

    def run():
        tracker = Tracker([RADAR])
        for piece in pieces:
            tracker.update(piece)
        return tracker

    benchmark.extra_info["plots"] = len(plots)
    assert benchmark(run).extrapolate(0.0) is not None
