"""Tracks of two boats from a ferry that moves, beside those of Stone Soup.

The recording of lidar, radar and cameras does not belong to the project. Positions of lidar and
radar are relative to the ferry, which knows its own place; the cameras measure azimuths. Truth is
by satellite, on the boats.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import partial
from typing import Any

import numpy as np

from studies.pages import DATA, markdown, repetitions, table_of
from studies.recordings import SHIP_SIGMAS
from tertia._arrays import FloatArray, IntArray
from tertia.metrics import gospa
from tertia.sensors import PositionSensor, Station
from tertia.tracker import Plots, Tracker

FOLDER = DATA / "autoferry"
# of the lidar and the radar, s, as the recording has them
INTERVALS = 0.5, 1.7
# seconds between the instants of GOSPA, and before the first; metres
STEP, SETTLED, CUTOFF = 1.0, 10.0, 20.0
# standard deviation of the speed of a boat of which one position is known, m/s
SPEED = 10.0
# spectral densities of acceleration among which Stone Soup has the best, m²/s³
DENSITIES = 0.01, 0.05, 0.25
# false plots per square metre and scan where trackers are given a number
CLUTTER = 1e-4
START = datetime(2021, 5, 4)
# positions at an instant, (N, 2), and names of their tracks
Picture = tuple[FloatArray, IntArray]


@dataclass(frozen=True)
class Recording:
    """Plots of lidar, radar and two cameras, east and north, and positions of the boats."""

    plots: Plots
    truth: Callable[[float], FloatArray]
    instants: FloatArray


def recording() -> Recording:
    """Read the recording."""
    seen, truths = (
        json.loads((FOLDER / f"scenario2_{name}.json").read_text("utf-8"))
        for name in ("detections", "groundTruth")
    )
    paths: dict[int, dict[float, list[float]]] = {}
    for row in (row for at in truths for row in at):
        paths.setdefault(row["targetID"], {})[row["time"]] = row["position"][1::-1]
    begin = min(one["time"] for one in seen)
    rows = []
    for one in seen:
        ferry, k = np.array(one["ownshipPosition"])[::-1], one["sensorID"] - 1
        for measured in _measured(one["measurement"], k < len(INTERVALS)):
            rows.append([one["time"] - begin, k, *ferry, *measured])
    table = np.array(rows)
    sensor = table[:, 1].astype(np.int64)
    polar = sensor < len(INTERVALS)
    spread = np.full((len(table), 2, 2), np.nan)
    for k in range(len(INTERVALS)):
        spread[sensor == k] = _covariance(table[sensor == k, 5:7], SHIP_SIGMAS[k])
    plots = Plots(
        table[:, 0],
        azimuth=np.where(polar, np.nan, table[:, 4]),
        sensor=sensor,
        position=table[:, 2:4] + table[:, 5:7],
        covariance=spread,
        sensor_position=np.where(polar[:, np.newaxis], np.nan, table[:, 2:4]),
    )

    def truth(t: float) -> FloatArray:
        each = []
        for path in paths.values():
            times = np.array(sorted(path)) - begin
            places = np.array([path[at] for at in sorted(path)])
            each.append([np.interp(t, times, places[:, axis]) for axis in (0, 1)])
        return np.array(each)

    instants = np.arange(SETTLED, np.max(table[:, 0]), STEP)
    return Recording(plots, truth, instants[: repetitions(len(instants), 15)])


def _measured(measured: Any, is_position: bool) -> Iterator[list[float]]:
    """Yield azimuth, east and north of what was detected; nan where there is none."""
    values = np.asarray(measured, dtype=float)
    if is_position and values.size:
        for north, east in values.reshape(2, -1).T:
            yield [np.nan, east, north]
    else:
        for azimuth in values.ravel():
            yield [azimuth, np.nan, np.nan]


def _covariance(offset: FloatArray, sigmas: tuple[float | None, float]) -> FloatArray:
    """Return covariances (N, 2, 2) of what is measured by range and azimuth."""
    distance = np.hypot(*offset.T)
    along = offset / distance[:, np.newaxis]
    across = np.column_stack([along[:, 1], -along[:, 0]])
    far, angle = float(sigmas[0] or 0.0), np.radians(sigmas[1])
    wide = distance[:, np.newaxis, np.newaxis] * angle
    return np.asarray(
        far**2 * along[:, :, np.newaxis] * along[:, np.newaxis]
        + wide**2 * across[:, :, np.newaxis] * across[:, np.newaxis]
    )


def tertia(one: Recording, cameras: bool, density: float | None = None) -> list[Picture]:
    """Return what the tracker shows at each instant."""
    sensors = [PositionSensor(update_interval=interval) for interval in INTERVALS]
    stations = [
        Station([0.0, 0.0], azimuth_sigma=sigma, degrees=True)
        for _, sigma in SHIP_SIGMAS[len(INTERVALS) :]
    ]
    plots = one.plots if cameras else one.plots[one.plots.sensor < len(INTERVALS)]
    everything: list[PositionSensor | Station] = [*sensors, *stations] if cameras else [*sensors]
    tracker = Tracker(everything, profile="vessel", clutter_density=density)
    shown, done = [], 0.0
    for instant in one.instants:
        tracker.update(plots[(plots.time > done) & (plots.time <= instant)], time=instant)
        names, places = tracker.extrapolate(0.0)
        shown.append((places, names))
        done = instant
    return shown


def stone_soup(one: Recording, kind: str, density: float, patient: bool) -> list[Picture]:
    """Return what a tracker of Stone Soup shows, of lidar and radar."""
    ss = _classes()
    axis = ss["ConstantVelocity"](density)
    transition = ss["CombinedLinearGaussianTransitionModel"]([axis, axis])
    predictor, updater = ss["KalmanPredictor"](transition), ss["KalmanUpdater"](None)
    distance = ss["DistanceHypothesiser"](
        predictor, updater, measure=ss["Mahalanobis"](), missed_distance=3
    )
    nearest = ss["GNNWith2DAssignment"](distance)
    deleter = ss["UpdateTimeDeleter"](timedelta(seconds=5.5 * max(INTERVALS)))
    prior = ss["GaussianState"]([[0], [0], [0], [0]], np.diag([0.0, SPEED**2, 0.0, SPEED**2]))
    initiator = ss["MultiMeasurementInitiator"](
        prior_state=prior,
        deleter=ss["UpdateTimeDeleter"](timedelta(seconds=2.5 * max(INTERVALS)))
        if patient
        else ss["UpdateTimeStepsDeleter"](3),
        data_associator=nearest,
        updater=updater,
        min_points=3,
    )
    tracker = {"initiator": initiator, "deleter": deleter, "updater": updater}
    if kind == "GNN":
        made = ss["MultiTargetTracker"](data_associator=nearest, detector=None, **tracker)
    else:
        likely = ss["PDAHypothesiser"](
            predictor, updater, clutter_spatial_density=CLUTTER, prob_detect=0.9
        )
        made = ss["MultiTargetMixtureTracker"](
            data_associator=ss["JPDA"](likely), detector=None, **tracker
        )
    made.detector = list(_detections(one.plots, one.instants[-1], ss))
    shown, current, steps = [], set(), iter(made)
    pending = next(steps, None)
    for instant in one.instants:
        when = START + timedelta(seconds=float(instant))
        while pending is not None and pending[0] <= when:
            current = set(pending[1])
            pending = next(steps, None)
        places, names = [], []
        for track in current:
            age = (when - track.timestamp).total_seconds()
            x = np.asarray(track.state_vector, dtype=float).ravel()
            places.append([x[0] + age * x[1], x[2] + age * x[3]])
            names.append(hash(track.id))
        shown.append((np.reshape(places, (-1, 2)), np.array(names, dtype=np.int64)))
    return shown


def _detections(
    plots: Plots, end: float, ss: dict[str, Any]
) -> Iterator[tuple[datetime, set[Any]]]:
    """Yield the detections of lidar and radar until the end, those of one instant together."""
    position, covariance = plots.position, plots.covariance
    assert position is not None
    assert covariance is not None
    own = np.flatnonzero((plots.sensor < len(INTERVALS)) & (plots.time <= end))
    for at in np.unique(plots.time[own]):
        when = START + timedelta(seconds=float(at))
        found = set()
        for i in own[plots.time[own] == at]:
            model = ss["LinearGaussian"](4, (0, 2), covariance[i])
            state = ss["StateVector"](position[i][:, np.newaxis])
            found.add(ss["Detection"](state, timestamp=when, measurement_model=model))
        yield when, found


def _classes() -> dict[str, Any]:
    modules = {
        "models.transition.linear": ("CombinedLinearGaussianTransitionModel", "ConstantVelocity"),
        "models.measurement.linear": ("LinearGaussian",),
        "predictor.kalman": ("KalmanPredictor",),
        "updater.kalman": ("KalmanUpdater",),
        "hypothesiser.distance": ("DistanceHypothesiser",),
        "hypothesiser.probability": ("PDAHypothesiser",),
        "dataassociator.neighbour": ("GNNWith2DAssignment",),
        "dataassociator.probability": ("JPDA",),
        "deleter.time": ("UpdateTimeStepsDeleter", "UpdateTimeDeleter"),
        "initiator.simple": ("MultiMeasurementInitiator",),
        "tracker.simple": ("MultiTargetTracker", "MultiTargetMixtureTracker"),
        "measures": ("Mahalanobis",),
        "types.array": ("StateVector",),
        "types.detection": ("Detection",),
        "types.state": ("GaussianState",),
    }
    return {
        name: getattr(importlib.import_module(f"stonesoup.{module}"), name)
        for module, names in modules.items()
        for name in names
    }


def judged(one: Recording, shown: list[Picture]) -> list[float]:
    """Return GOSPA, its parts, tracks shown at a time and total number of tracks."""
    parts, names = [], set()
    for instant, (places, own) in zip(one.instants, shown, strict=True):
        found = gospa(places, one.truth(instant), CUTOFF)
        parts.append([found.distance**2, found.localisation, found.missed, found.false])
        names |= set(own.tolist())
    rms = np.sqrt(np.mean(parts, axis=0))
    return [*rms.tolist(), float(np.mean([len(own) for _, own in shown])), float(len(names))]


def table() -> str:
    """Tabulate; without the recording or Stone Soup, the table is that of the page."""
    if not FOLDER.is_dir() or importlib.util.find_spec("stonesoup") is None:
        return table_of("position-sensors.md", "boats")
    one = recording()
    runs: dict[str, list[Callable[[], list[Picture]]]] = {
        "Tertia": [lambda: tertia(one, False)],
        "Tertia, with the cameras": [lambda: tertia(one, True)],
        "Tertia, clutter density given": [lambda: tertia(one, False, CLUTTER)],
        "Tertia, clutter density given, with the cameras": [lambda: tertia(one, True, CLUTTER)],
    }
    for kind in ("GNN", "JPDA"):
        for patient, name in ((False, ""), (True, ", patient initiator")):
            runs[f"Stone Soup {kind}{name}"] = [
                partial(stone_soup, one, kind, density, patient) for density in DENSITIES
            ]
    rows = []
    for name, each in runs.items():
        found = []
        for run in each:
            start = time.process_time()
            shown = run()
            found.append((judged(one, shown), time.process_time() - start))
        (whole, *parts, count, tracks), cost = min(found)
        # not in the table, which other machines make, too
        print(f"{name}: {cost:.2f} s of CPU", file=sys.stderr)
        cells = [f"{whole:.1f} m", *(f"{part:.1f} m" for part in parts), f"{count:.1f}"]
        rows.append([name, *cells, f"{tracks:.0f}"])
    head = ["", "GOSPA", "localisation", "missed boats", "false tracks", "mean number of tracks"]
    return markdown([*head, "total number of tracks"], rows)
