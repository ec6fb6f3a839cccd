"""Aircraft close to one another: Stone Soup's trackers beside Tertia's, on the same plots.

    python benches/peers/encounters.py --runs 40

Tracks of Stone Soup begin at the truth, with a constant velocity and 1 m/s² of noise: with .1 m/s²
it loses the flights in their turns. Its multi-frame assignment needs OR-Tools and is left out.
"""

import argparse
import sys
import time
from datetime import datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
from stonesoup.dataassociator.probability import JPDA
from stonesoup.functions import gm_reduce_single
from stonesoup.hypothesiser.distance import DistanceHypothesiser
from stonesoup.hypothesiser.probability import PDAHypothesiser
from stonesoup.measures import Mahalanobis
from stonesoup.models.measurement.nonlinear import CartesianToBearingRange
from stonesoup.models.transition.linear import (
    CombinedLinearGaussianTransitionModel,
    ConstantVelocity,
)
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.types.array import StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.state import GaussianState
from stonesoup.types.track import Track
from stonesoup.types.update import GaussianStateUpdate
from stonesoup.updater.kalman import ExtendedKalmanUpdater

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))
from studies import ambiguity as cells
from studies.montecarlo import generator

from tertia.tracker import track

START = datetime(2026, 1, 1)
NOISE = 1.0
CELLS = (
    cells.abreast(300.0),
    cells.abreast(500.0),
    cells.abreast(600.0),
    cells.abreast(600.0, 10),
    *(cell for cell in cells.CELLS if cell.name in ("crossing at 5°", "crossing at 10°")),
    cells.Cell("600 m abreast, 50 false plots", "abreast", 600.0, 30, 60e3, 50.0),
)


def stone_soup(cell, flown, plots, method):
    motion = CombinedLinearGaussianTransitionModel([ConstantVelocity(NOISE**2 * cells.PERIOD)] * 2)
    noise = np.diag([np.radians(0.08) ** 2, 50.0**2])
    sensor = CartesianToBearingRange(ndim_state=4, mapping=(0, 2), noise_covar=noise)
    predictor, updater = KalmanPredictor(motion), ExtendedKalmanUpdater(sensor)
    if method == "GNN":
        associator = GNNWith2DAssignment(
            DistanceHypothesiser(predictor, updater, Mahalanobis(), missed_distance=12.4**0.5)
        )
    else:
        # per radian and metre
        density = max(cell.clutter, 0.1) / (2 * np.pi * 1.3 * cell.distance)
        associator = JPDA(
            PDAHypothesiser(predictor, updater, clutter_spatial_density=density,
                            prob_detect=cells.DETECTION, prob_gate=0.998)
        )  # fmt: skip
    velocity = (flown.position[1] - flown.position[0]) / cells.PERIOD
    begin = START - timedelta(seconds=cells.PERIOD)
    tracks = [
        Track([GaussianState([x - cells.PERIOD * u, u, y - cells.PERIOD * v, v],
                             np.diag([100.0**2, 10.0**2] * 2), timestamp=begin)])
        for (x, y), (u, v) in zip(flown.position[0], velocity, strict=True)
    ]  # fmt: skip
    rows = []
    cost = 0.0
    for scan in range(len(flown.position)):
        own = np.flatnonzero(np.round(plots.time / cells.PERIOD) == scan)
        now = START + timedelta(seconds=cells.PERIOD * scan)
        detections = {
            Detection([np.pi / 2 - plots.azimuth[i], plots.range[i]], timestamp=now,
                      measurement_model=sensor)
            for i in own
        }  # fmt: skip
        cost -= time.process_time()
        found = associator.associate(set(tracks), detections, now)
        for each in tracks:
            each.append(updated(found[each], updater, method))
        cost += time.process_time()
        rows += [(cells.PERIOD * scan, number, each.state) for number, each in enumerate(tracks)]
    place = [0, 2]
    table = SimpleNamespace(
        time=np.array([t for t, _, _ in rows]),
        track=np.array([number for _, number, _ in rows]),
        confirmed=np.ones(len(rows), dtype=bool),
        position=np.array([np.ravel(s.state_vector)[place] for _, _, s in rows], dtype=float),
        covariance=np.array([s.covar[np.ix_(place, place)] for _, _, s in rows], dtype=float),
    )
    return table, cost / len(flown.position)


def updated(found, updater, method):
    if method == "GNN":
        return updater.update(found) if found else found.prediction
    states = [updater.update(one) if one else one.prediction for one in found]
    weights = np.array([float(one.probability) for one in found])
    means = StateVectors([state.state_vector for state in states])
    covariances = np.stack([state.covar for state in states], axis=2)
    mean, covariance = gm_reduce_single(means, covariances, weights)
    return GaussianStateUpdate(mean, covariance, found, found[0].prediction.timestamp)


def tertia(flown, plots, association):
    cost = -time.process_time()
    table = track(plots, [cells.RADAR], association=association, n_threads=1)
    return table, (cost + time.process_time()) / len(flown.position)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=40)
    runs = parser.parse_args().runs
    methods = {
        "Tertia, gnn": lambda c, f, p: tertia(f, p, "gnn"),
        "Tertia, mht": lambda c, f, p: tertia(f, p, "mht"),
        "Stone Soup, GNN": lambda c, f, p: stone_soup(c, f, p, "GNN"),
        "Stone Soup, JPDA": lambda c, f, p: stone_soup(c, f, p, "JPDA"),
    }
    print("| GOSPA m ± / swaps % / lost % / µs a scan |", " | ".join(methods), "|")
    print("| --- |" + " --- |" * len(methods))
    for at, cell in enumerate(CELLS):
        found = {name: [] for name in methods}
        cost = dict.fromkeys(methods, 0.0)
        for run in range(runs):
            rng = generator(58, at, run)
            flown = cells.encounter(cell, rng)
            plots = cells.plots_of(cell, flown, cells.RADAR, rng)
            for name, method in methods.items():
                table, seconds = method(cell, flown, plots)
                found[name].append(cells.outcome(flown, table))
                cost[name] += seconds / runs
        texts = []
        for name, outcomes in found.items():
            gospa = np.array([one.gospa for one in outcomes])
            swaps, lost = (
                100 * np.mean([getattr(o, k) for o in outcomes]) for k in ("swapped", "lost")
            )
            texts.append(
                f"{gospa.mean():.1f} ± {gospa.std() / np.sqrt(runs):.1f} / {swaps:.0f} / {lost:.0f}"
                f" / {1e6 * cost[name]:.0f}"
            )
        print(f"| {cell.name} |", " | ".join(texts), "|", flush=True)


if __name__ == "__main__":
    main()
