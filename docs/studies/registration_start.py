"""Tracks of aircraft where radars have large errors, or errors that change suddenly."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from studies.pages import markdown, repetitions
from tertia import simulate
from tertia._arrays import IntArray
from tertia.sensors import Bias, Radar
from tertia.tracker import Plots, Tracker, TrackTable, track

SEED, AIRCRAFT, SEEDS, SCENES = 53, 20, repetitions(3, 1), repetitions(100)
RANGE_SIGMA, AZIMUTH_SIGMA, FARTHEST = 50.0, 0.0014, 150e3
PLACES = ((-5e4, 0.0), (5e4, 0.0), (0.0, 6e4))
AZIMUTHS, RANGES = (0.0, 0.1, 0.2, 0.3, 0.5, 1.0), (0.0, 300.0, 500.0)
# with replies, false plots a scan
KINDS = ((True, 0.0), (False, 0.0), (False, 20.0))
# when errors change, and how long recordings last; seconds
CHANGE, DURATION, LONG = 150.0, float(repetitions(300, 100)), float(repetitions(600, 270))
CHANGES: tuple[tuple[str, dict[str, float]], ...] = (
    ("nothing", {}),
    ("0.2°", {"azimuth": np.radians(0.2).item()}),
    ("0.5°", {"azimuth": np.radians(0.5).item()}),
    ("1°", {"azimuth": np.radians(1.0).item()}),
    ("150 m", {"range": 150.0}),
    ("500 m", {"range": 500.0}),
    ("1 s", {"time": 1.0}),
)


def radars(count: int) -> list[Radar]:
    """Return radars of 4, 5, 6 s."""
    return [
        Radar(
            place,
            range_sigma=RANGE_SIGMA,
            azimuth_sigma=AZIMUTH_SIGMA,
            scan_period=4.0 + k,
            max_range=FARTHEST,
        )
        for k, place in enumerate(PLACES[:count])
    ]


def recording(
    seed: int,
    bias: Bias,
    count: int,
    *,
    coded: bool = True,
    clutter: float = 0.0,
    start: float = 0.0,
    duration: float = DURATION,
) -> simulate.RadarPlots:
    """Return plots and their targets."""
    random = np.random.default_rng([SEED, seed])
    traffic = simulate.dense_traffic(
        AIRCRAFT, area=(1e5, 1e5), turning_share=0.1, duration=duration, rng=random
    )
    return simulate.radar_plots(
        traffic,
        radars(count),
        clutter=clutter,
        bias=bias,
        bias_start=start,
        outlier_probability=0.01,
        identity_missing_probability=0.0 if coded else 1.0,
        rng=random,
    )


def followed(plots: Plots, count: int) -> tuple[Tracker, list[TrackTable]]:
    """Return the tables of scans of 4 s."""
    tracker = Tracker(radars(count))
    ends = np.arange(plots.time[0] + 4.0, plots.time[-1] + 4.0, 4.0)
    edges = np.concatenate([[0], np.searchsorted(plots.time, ends)])
    parts = zip(edges, edges[1:], ends, strict=False)
    return tracker, [tracker.update(plots[a:b], time=end) for a, b, end in parts]


def _counted(tables: Sequence[TrackTable], target: IntArray) -> tuple[int, int, int]:
    """Return the tracks of aircraft, false tracks, and aircraft without a track at the end."""
    number = np.concatenate([one.track[one.confirmed] for one in tables])
    plot = np.concatenate([one.plot[one.confirmed] for one in tables])
    last = np.concatenate([one.time[one.confirmed] for one in tables])
    seen = plot >= 0
    of = np.where(seen, target[np.maximum(plot, 0)], -1)
    true = {one for one in np.unique(number) if np.mean(of[seen & (number == one)] >= 0) > 0.5}
    end = of[seen & (last > np.max(last) - 30.0)]
    return (
        len(true),
        len(np.unique(number)) - len(true),
        AIRCRAFT - len(np.unique(end[end >= 0])),
    )


def _cell(counts: Sequence[tuple[int, int, int]]) -> str:
    """Return the largest number of tracks of aircraft, false tracks, and aircraft lost."""
    tracks, false, lost = np.array(counts).T
    return f"{np.min(tracks)}-{np.max(tracks)}, {np.sum(false)}, {np.sum(lost)}"


def _ways(record: simulate.RadarPlots, count: int) -> list[tuple[int, int, int]]:
    """Return the counts as they are, of a recording, and scan by scan from the first row on."""
    plots, target = record.plots, record.target
    live = followed(plots, count)[1]
    plain = track(plots, radars(count), registration=False)
    return [_counted(tables, target) for tables in ([plain], [track(plots, radars(count))], live)]


def grid() -> str:
    """Return the tracks of aircraft where one of two radars is off, or two of three."""
    cases = [
        (f"{azimuth}°, {offset:g} m", Bias(azimuth=[0.0, np.radians(azimuth)], range=[0.0, offset]))
        for offset in RANGES
        for azimuth in AZIMUTHS
    ]
    cases += [
        ("first: 0.5°", Bias(azimuth=np.radians([0.5, 0.0]))),
        ("second 0.5°, third -0.4°, 300 m", _three([0.5, -0.4], 300.0, 0.0)),
        ("second 0.3°, 200 m, third 1 s", _three([0.3, 0.0], 0.0, 1.0)),
        ("second 1°, third -1°, 500 m", _three([1.0, -1.0], 500.0, 0.0)),
    ]
    rows = []
    for name, bias in cases:
        row = [name]
        for coded, clutter in KINDS:
            found = [
                _ways(recording(seed, bias, len(bias), coded=coded, clutter=clutter), len(bias))
                for seed in range(SEEDS)
            ]
            plain, whole, live = zip(*found, strict=True)
            row += [f"{np.mean([one[0] for one in plain]):.0f}", _cell(whole), _cell(live)]
        rows.append(row)
    kinds = ("codes", "no codes", "20 false plots")
    ways = ("not registered", "recording", "scan by scan")
    return markdown(["errors", *(f"{a}: {b}" for a in kinds for b in ways)], rows)


def _three(azimuths: list[float], third: float, clock: float) -> Bias:
    """Return errors of two of three radars."""
    second = 200.0 if clock else 0.0
    return Bias(
        azimuth=np.radians([0.0, *azimuths]), range=[0.0, second, third], time=[0.0, 0.0, clock]
    )


def changes() -> str:
    """Return how soon a sudden change of the second of three radars is found."""
    rows = []
    for name, change in CHANGES:
        late, wrong, tracks = [], 0, []
        scenes = SCENES // 10 if change else SCENES
        for seed in range(max(scenes, 2)):
            azimuth, distance, clock = (
                [0.0, change.get(kind, 0.0), 0.0] for kind in ("azimuth", "range", "time")
            )
            bias = Bias(azimuth=azimuth, range=distance, time=clock)
            record = recording(1000 + seed, bias, 3, clutter=2.0, start=CHANGE, duration=LONG)
            tracker, tables = followed(record.plots, 3)
            registrar = tracker._registrar
            own = [] if registrar is None else registrar.changes
            right = [time - CHANGE for time, k in own if change and k == 1 and time > CHANGE]
            wrong += len(own) - sum(1 for time in right if time <= 60.0)
            late.append(min(right, default=np.inf))
            tracks.append(_counted(tables, record.target)[0])
        found = np.isfinite(late)
        times = f"{np.median(late):.0f}, {np.max(late):.0f}" if np.all(found) else "-"
        soon = str(np.count_nonzero(np.array(late) <= 60.0)) if change else "-"
        counts = f"{np.min(tracks)}-{np.max(tracks)}"
        rows.append([name, str(len(late)), soon, times, str(wrong), counts])
    head = ["change", "scenes", "found within 60 s", "delay of detection, median and largest, s"]
    return markdown([*head, "other changes found", "tracks of 20 aircraft"], rows)
