"""The tables of the page on association."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure

from studies.montecarlo import FloatArray, generator
from studies.pages import markdown, repetitions
from tertia import metrics, plot
from tertia._arrays import IntArray
from tertia.association import (
    Assignment,
    GateSector,
    Score,
    associate,
    gate_sectors,
    gate_threshold,
)
from tertia.tracker import Plots, Radar, track

PLOTS = repetitions(200_000)
SCENES = repetitions(20_000)
# metres between scenes, so that nothing of one is in a gate of another
APART = 1e7
SIGMA = 100.0
DETECTION = 0.9
# of the flight in the picture: seconds of a scan, m/s, the time when it begins to turn
SCAN, SPEED, BEGINS = 4.0, 220.0, 80.0
METHODS: tuple[tuple[Score, Assignment], ...] = (
    ("paper", "nearest"),
    ("paper", "gnn"),
    ("likelihood", "nearest"),
    ("likelihood", "gnn"),
)


def gates() -> str:
    """Tabulate the thresholds, and the shares of true plots within gates and in sectors."""
    rng = generator(50)
    covariance = np.array([[9.0, 4.0], [4.0, 6.0]])
    innovation = rng.multivariate_normal([0.0, 0.0], covariance, PLOTS)
    found = np.asarray(gate_sectors(innovation, covariance, [200.0, 50.0]))
    inner = np.mean(found == GateSector.INNER)
    outer = np.mean(found < GateSector.GUARD_AHEAD)
    guard = np.mean(found < GateSector.OUTSIDE)
    wedges = {
        "inner": None,
        "outer": (GateSector.AHEAD, GateSector.GUARD_AHEAD),
        "guard": (GateSector.GUARD_AHEAD, GateSector.OUTSIDE),
    }
    rows = []
    for (name, wedge), share, probability in zip(
        wedges.items(), (inner, outer, guard), (0.65, 0.95, 0.998), strict=True
    ):
        thresholds = [f"{gate_threshold(probability, m):.4f}" for m in (1, 2, 3)]
        sectors = ""
        if wedge is not None:
            sectors = ", ".join(f"{np.mean(found == r):.2%}" for r in range(*wedge))
        rows.append([name, f"{probability:.3f}", *thresholds, f"{share:.4f}", sectors])
    head = ["gate", "probability", "d², m = 1", "m = 2", "m = 3", "true plots within (m = 2)"]
    return markdown([*head, "ahead, behind, left, right"], rows)


def score_zero(q: float, m: int) -> float:
    """Return the d² at which the paper's score is zero."""
    return float(m * q * np.log(q) / (q - 1))


def zeros() -> str:
    """Tabulate where the paper's score changes its sign."""
    rows = [
        [f"{q:g}", f"{score_zero(q, 2):.4f}", f"{score_zero(q, 3):.4f}"]
        for q in (4.0, 10.0, 100.0, 493.7461)
    ]
    return markdown(["Q", "zero at d², m = 2", "m = 3"], rows)


@dataclass(frozen=True)
class Scenes:
    """Pairs of tracks, far from other pairs, and their plots."""

    predicted: FloatArray
    covariance: FloatArray
    plots: FloatArray
    # the track whose target a plot shows; -1 for a false one
    source: IntArray


def scenes(ratio: float, false_plots: float, *study: int) -> Scenes:
    """Return pairs of tracks, the second with `ratio` times the standard deviation of the first.

    On average `false_plots` are in the guard gate of the second.
    """
    rng = generator(51, *study)
    origin = APART * np.stack(np.divmod(np.arange(SCENES), 200), axis=-1)
    sigma = SIGMA * np.array([1.0, ratio])
    bearing = rng.uniform(0, 2 * np.pi, SCENES)
    offset = 1.5 * np.hypot(*sigma) * np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)
    predicted = np.stack([origin, origin + offset], axis=1)
    plots = predicted + sigma[:, np.newaxis] * rng.normal(size=predicted.shape)
    seen = rng.uniform(size=(SCENES, 2)) < DETECTION
    half = 5.0 * sigma[1]
    density = clutter_density(ratio, false_plots)
    count = rng.poisson(density * (2 * half) ** 2, SCENES)
    place = np.repeat(predicted.mean(axis=1), count, axis=0)
    false = place + rng.uniform(-half, half, (int(count.sum()), 2))
    tracks = np.arange(2 * SCENES).reshape(SCENES, 2)
    return Scenes(
        predicted.reshape(-1, 2),
        np.tile(sigma**2, SCENES)[:, np.newaxis, np.newaxis] * np.eye(2),
        np.concatenate([plots[seen], false]),
        np.concatenate([tracks[seen], np.full(len(false), -1)]),
    )


def clutter_density(ratio: float, false_plots: float) -> float:
    """Return how many false plots per square metre there are."""
    area = np.pi * gate_threshold("guard") * (ratio * SIGMA) ** 2
    return float(false_plots / area)


def ambiguity() -> str:
    """Tabulate how often a track gets a wrong plot, or none although it was seen."""
    rows = []
    for at, (ratio, false_plots) in enumerate(
        [(1.0, 0.1), (3.0, 0.1), (10.0, 0.1), (1.0, 1.0), (3.0, 1.0), (10.0, 1.0)]
    ):
        drawn = scenes(ratio, false_plots, at)
        cells = []
        for score, method in METHODS:
            result = associate(
                drawn.predicted,
                drawn.covariance,
                drawn.plots,
                method=method,
                score=score,
                clutter_density=clutter_density(ratio, false_plots),
                detection_probability=DETECTION,
            )
            cells.append(f"{errors(result.plot_of_track, drawn):.1%}")
        rows.append([f"{ratio:g}", f"{false_plots:g}", *cells])
    head = [f"{score}, {method}" for score, method in METHODS]
    return markdown(["σ₂/σ₁", "false plots in the gate", *head], rows)


def errors(plot_of_track: IntArray, drawn: Scenes) -> float:
    """Return the share of tracks with a wrong plot, or with none although there was one."""
    tracks = np.arange(len(plot_of_track))
    own = np.full(len(tracks), -1)
    true = np.flatnonzero(drawn.source >= 0)
    own[drawn.source[true]] = true
    return float(np.mean(plot_of_track != own))


def updates() -> str:
    """Compare figures of surveillance with their expectation for independent misses."""
    period, targets, scans = 4.0, 100, repetitions(400, 100)
    rows = []
    for at, probability in enumerate((0.90, 0.95, 0.97, 0.99)):
        rng = generator(52, at)
        time = period * np.arange(scans)
        seen = rng.uniform(size=(targets, scans)) < probability
        track, scan = np.nonzero(seen)
        north = 1e4 * np.arange(targets)
        place = np.column_stack([150.0 * time[scan], north[track]])
        ends = np.repeat([0.0, time[-1]], targets)
        when = time[scan] + rng.uniform(-0.1, 0.1, len(scan)) * period
        truth = metrics.Truth(
            ends + np.repeat([-1.0, 1.0], targets) * 0.1 * period,
            np.tile(np.arange(targets), 2),
            np.column_stack([150.0 * ends, np.tile(north, 2)]),
        )
        tracks = SimpleNamespace(time=when, track=track, position=place)
        found = metrics.indicators(tracks, truth, max_distance=500.0, update_interval=period)
        miss = 1.0 - probability
        # m in a row, m >= 3, between two updates: m miss^m probability^2 a scan
        long = miss**3 * (3 - 2 * miss)
        rows.append(
            [f"{probability:.2f}", f"{found.probability_of_update.value:.4f}",
             f"{found.long_gap_ratio.value:.5f}", f"{long:.5f}"]
        )  # fmt: skip
    head = ["probability of detection", "probability of update", "long-gap ratio", "expected"]
    return markdown(head, rows)


def gates_figure() -> Figure:
    """Draw the gates of one track in straight flight, where a turn begins, and within it."""
    radar = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=SCAN)
    time = np.arange(0.0, 160.0, SCAN)
    course = np.radians(60.0 + 3.0 * np.maximum(time - BEGINS, 0.0))
    steps = SPEED * SCAN * np.column_stack([np.sin(course), np.cos(course)])
    noise = generator(120).normal(0.0, radar.range_sigma, steps.shape)
    place = np.array([10e3, 30e3]) + np.cumsum(steps, axis=0) + noise
    plots = Plots(time, np.hypot(*place.T), np.arctan2(*place.T))
    table = track(plots, [radar])
    figure = Figure(figsize=(12, 4.9), layout="constrained")
    axes = figure.subplots(1, 3)
    for ax, moment in zip(axes, (BEGINS - 20.0, BEGINS + 8.0, BEGINS + 32.0), strict=True):
        plot.gates(table, int(np.flatnonzero(table.time >= moment)[0]), plots, [radar], ax=ax)
    shown: dict[str, Artist] = {}
    for ax in axes:
        handles, labels = ax.get_legend_handles_labels()
        shown = dict(zip(labels, handles, strict=True)) | shown
        ax.get_legend().remove()
    figure.legend(shown.values(), shown.keys(), loc="outside lower center", ncols=5)
    return figure
