"""Heights of aircraft that begin and end climbs and descents: a table of docs/tracker-motion.md."""

from __future__ import annotations

import math
from itertools import product

import numpy as np

from studies.montecarlo import generator
from studies.pages import markdown, repetitions
from tertia._arrays import FloatArray, IntArray
from tertia.tracker import Plots, Radar, track

RUNS = repetitions(10)
AIRCRAFT, DURATION, FOOT = 40, 300.0, 0.3048
# vertical rates, the acceleration with which they begin, and when climbs begin and end
RATES, ACCELERATIONS, BEGIN, END = (15.0, 40.0), (2.0, 40.0), (90.0, 100.0), (160.0, 190.0)
# a change of the rate, then a steady rate
CHANGE = 30.0
PHASES = ("level", "change", "climb or descent")
PERIODS, GARBLED = (4.0, 6.0, 10.0, 12.0), (0.0, 0.01, 0.05)


def flown(time: FloatArray, random: np.random.Generator) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return heights, vertical rates and phases at times of the aircraft, (scans, aircraft)."""
    rate = random.uniform(*RATES, AIRCRAFT) * random.choice([-1.0, 1.0], AIRCRAFT)
    least, most = map(math.log, ACCELERATIONS)
    until = np.abs(rate) / np.exp(random.uniform(least, most, AIRCRAFT))
    begin, end = random.uniform(*BEGIN, AIRCRAFT), random.uniform(*END, AIRCRAFT)

    def changed(since: FloatArray) -> tuple[FloatArray, FloatArray]:
        share = np.clip(since / until, 0.0, 1.0)
        return share, np.where(since < until, since * share / 2, since - until / 2).clip(0.0)

    (one, up), (two, down) = changed(time - begin), changed(time - end)
    height = random.uniform(4e3, 11e3, AIRCRAFT) + rate * (up - down)
    since = np.where(time < end, time - begin, time - end)
    phase = np.where(since < 0.0, 0, np.where(since < CHANGE, 1, np.where(time < end, 2, 0)))
    return height, rate * (one - two), phase


def garbled(height: FloatArray, share: float, random: np.random.Generator) -> FloatArray:
    """Return heights in hundreds of feet, some of them wrong: by one bit, or anywhere."""
    step = 100.0 * FOOT
    size = height.shape
    sign, bit = random.choice([-1.0, 1.0], size), random.integers(0, 8, size)
    near = random.random(size) < 0.5
    wrong = np.where(near, height + sign * step * 2.0**bit, random.uniform(0.0, 12e3, size))
    return np.round(np.where(random.random(size) < share, wrong, height) / step) * step


def errors(run: int, period: float, share: float) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return errors of the heights and the vertical rates of tracks, and the phases."""
    random = generator(5300, run)
    radar = Radar(range_sigma=40.0, azimuth_sigma=np.radians(0.07), scan_period=period)
    scan = np.arange(int(DURATION / period))[:, np.newaxis]
    course = random.uniform(0.0, 2 * np.pi, AIRCRAFT)
    speed, across = random.uniform(120.0, 230.0, AIRCRAFT), random.uniform(-9e4, 9e4, AIRCRAFT)
    velocity = speed * np.array([np.sin(course), np.cos(course)])
    middle = np.array([across, random.choice([-1.0, 1.0], AIRCRAFT) * 70e3])
    time = period * scan + np.zeros(AIRCRAFT)
    for _ in range(3):
        place = middle[:, np.newaxis] + (time - DURATION / 2) * velocity[:, np.newaxis]
        azimuth = np.arctan2(*place) % (2 * np.pi)
        time = period * (scan + azimuth / (2 * np.pi))
    height, rate, phase = flown(time, random)
    noise = random.standard_normal((2, *time.shape))
    reach = np.hypot(np.hypot(*place), height) + radar.range_sigma * noise[0]
    rows = [time, reach, azimuth + radar.azimuth_sigma * noise[1], garbled(height, share, random)]
    order = np.argsort(time, axis=None, kind="stable")
    times, ranges, azimuths, heights = (row.ravel()[order] for row in rows)
    address = (0x400000 + np.arange(AIRCRAFT) + np.zeros_like(scan)).ravel()[order]
    table = track(Plots(times, ranges, azimuths, height=heights, icao_address=address), [radar])
    table = table[(table.plot >= 0) & table.confirmed & (table.time > 20.0)]
    plot = order[table.plot]
    apart = table.height - height.ravel()[plot], table.vertical_rate - rate.ravel()[plot]
    return *apart, phase.ravel()[plot]


def table() -> str:
    """Tabulate errors of heights and of vertical rates by phase."""
    rows = []
    for period, share in product(PERIODS, GARBLED):
        found = [
            np.concatenate(one)
            for one in zip(*(errors(k, period, share) for k in range(RUNS)), strict=True)
        ]
        height, rate, phase = found
        cells = []
        for k in range(len(PHASES)):
            own = phase == k
            rms = [np.sqrt(np.mean(one[own] ** 2)) for one in (height, rate)]
            cells += [f"{rms[0]:.0f}", f"{np.max(np.abs(height[own])):.0f}", f"{rms[1]:.1f}"]
        rows.append([f"{period:.0f} s", f"{share:.0%}", *cells])
    head = ["scan", "wrong heights"]
    for name in PHASES:
        head += [f"RMSE, {name}, m", "largest, m", "RMSE of the rate, m/s"]
    return markdown(head, rows)
