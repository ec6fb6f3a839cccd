"""Radars whose plots say what they were detected by: a table of docs/tracker-false-tracks.md."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from studies.pages import markdown, repetitions
from studies.unhealthy import Scene, outcome, places, stays
from tertia import simulate
from tertia._arrays import FloatArray
from tertia.sensors import Channel
from tertia.tracker import Plots, Radar, TrackTable, track

RUNS = repetitions(10, 1)
SEED = 8100
AIRCRAFT, END, REACH = 30, 600.0, 150e3
# of echoes and of replies
PSR, SSR = (80.0, np.radians(0.16)), (30.0, np.radians(0.06))
# detection probabilities of both, and false echoes a scan
CASES = (
    (0.85, 0.95, 20.0),
    (0.85, 0.6, 20.0),
    (0.85, 0.6, 150.0),
    (0.85, 0.6, 800.0),
    (0.7, 0.3, 150.0),
)


def radar_with(psr: float, ssr: float) -> Radar:
    """Return a radar with two channels."""
    channels = {
        "psr": Channel(psr, range_sigma=PSR[0], azimuth_sigma=PSR[1]),
        "ssr": Channel(ssr, range_sigma=SSR[0], azimuth_sigma=SSR[1]),
    }
    return Radar(
        (0.0, 0.0, 0.0), range_sigma=PSR[0], azimuth_sigma=PSR[1], scan_period=4.0, max_range=REACH,
        channels=channels,
    )  # fmt: skip


def plain(radar: Radar) -> Radar:
    """Return a radar that detects as often, with the mean noise of its plots of targets."""
    assert radar.channels is not None
    own = [radar.channels[name].detection_probability for name in ("psr", "ssr")]
    echoes = own[0] * (1 - own[1]) / radar.detection_probability
    sigmas = [
        float(np.sqrt(echoes * a**2 + (1 - echoes) * b**2)) for a, b in zip(PSR, SSR, strict=True)
    ]
    return replace(radar, channels=None, range_sigma=sigmas[0], azimuth_sigma=sigmas[1])


def seen(radar: Radar, clutter: float, seed: int) -> Scene:
    """Simulate aircraft on routes, and what the radar sees; replies have heights and no codes."""
    traffic = simulate.flights(
        simulate.routes("middle", AIRCRAFT, rng=seed), wind=15.0, rng=seed + 1
    )
    found = simulate.radar_plots(
        traffic, [radar], clutter=clutter, identity_missing_probability=1.0,
        rng=seed + 2,
    )  # fmt: skip
    early = found.plots.time < END
    plots, target = found.plots[early], found.target[early]
    return Scene(plots, target, places(traffic, plots.time, target), stays(plots, target))


def delays(scene: Scene, found: TrackTable) -> FloatArray:
    """Return the seconds from the first plot of each target to its first confirmed row."""
    rows = found[found.confirmed & (found.plot >= 0)]
    target = scene.target[rows.plot]
    first = {
        one: scene.plots.time[scene.target == one].min() for one in np.unique(target[target >= 0])
    }
    return np.array([rows.time[target == one].min() - begin for one, begin in first.items()])


def without(plots: Plots) -> Plots:
    """Return plots that do not say what they were detected by."""
    return replace(plots, detection=np.full(len(plots), -1))


def channels(seed: int = SEED, runs: int = RUNS) -> str:
    """Compare tracks of a radar whose channels are known with those of one mean radar."""
    rows = []
    for psr, ssr, clutter in CASES:
        radar = radar_with(psr, ssr)
        scenes = [seen(radar, clutter, seed + 10 * run) for run in range(runs)]
        for name, own in (("known", radar), ("not known", plain(radar))):
            tables = [
                track(one.plots if own is radar else without(one.plots), [own]) for one in scenes
            ]
            results = [outcome(*pair) for pair in zip(scenes, tables, strict=True)]
            waits = np.concatenate([delays(*pair) for pair in zip(scenes, tables, strict=True)])
            error = np.concatenate([one.error for one in results])
            nees = np.concatenate([one.nees for one in results])
            more = np.mean([one.tracks - one.aircraft for one in results])
            rows.append(
                [
                    f"{psr:g}, {ssr:g}, {clutter:g}",
                    name,
                    f"{np.sqrt(np.mean(error**2)):.0f}",
                    f"{np.mean(nees):.2f}",
                    f"{np.mean(nees < 2.996):.0%}",
                    f"{np.mean(waits):.1f}",
                    f"{more:+.1f}",
                ]
            )
    head = ["P_D of echoes, P_D of replies, false echoes per scan", "channels", "RMSE, m"]
    head += ["NEES per axis", "within the 95 % ellipse", "first plot to first confirmed row, s"]
    return markdown([*head, "surplus tracks, mean"], rows)


if __name__ == "__main__":
    print(channels())
