"""The tracker, side by side with those of Stone Soup and norfair, on the same scans.

Aircraft that cross, fly abreast or one behind the other, five nautical miles apart, or anywhere,
half of them with a turn ("dense", three times as many), in clutter, seen by one terminal radar or
by two. Plots tell neither height nor identity. GOSPA (mean over the scans), switches of identity,
false tracks per hour, share of updates that are missing, and milliseconds of CPU time per scan of a
radar.

All trackers know the same: noise, probability of detection, the gate of .998, plots that confirm a
track (3 in 4), scans until it ends (5). Stone Soup: extended Kalman filter, straight flight with
Tertia's noise; "GNN" is the assignment by Mahalanobis distance, "JPDA" that with an efficient
hypothesis management. Out of the box it would try every plot for every track, and look for a
missed target at the end of the scan: here it is given the plots that are near, and the time of the
beam. Plots of a scan are one step of Stone Soup; Tertia gets those of both radars by their time.

norfair follows points of a plane, one step a scan, by the nearest in Euclidean distance: it is made
for boxes in pictures, and is told neither noise nor times.

Encounters last 300 s without clutter, 160 s with 50 false plots a scan and 80 s with 200, for Stone
Soup then takes seconds a scan.
"""

import argparse
import importlib
import itertools
import time
from collections import defaultdict
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from functools import cache

from timing import keep, optional

# isort: split
import numpy as np
from scipy.spatial import cKDTree

from tertia.metrics import Truth, gospa, indicators
from tertia.simulate import dense_traffic, encounter, radar_plots
from tertia.tracker import Radar, Tracker, track

PERIOD, RANGE, DETECTION = 4.0, 80e3, 0.95
NOISE = {"range_sigma": 50.0, "azimuth_sigma": np.radians(0.08).item()}
PLACES = [(0.0, 0.0), (25e3, -10e3)]
MIDDLE = (0.0, 42e3)
AREA = (90e3, 90e3)
# beams pass the aircraft half a scan one after the other; scans begin where there are none
PHASES = [0.0, PERIOD / 2]
STRAIGHT_SIGMA, SPEED_SIGMA = 0.1, 175.0
GATE, GATE_PROBABILITY = 12.429216196844, 0.998
COASTING = 5
CUTOFF = 1000.0
# false plots a scan, and seconds of the encounter
DURATIONS = {0: 300.0, 50: 160.0, 200: 80.0}
ENCOUNTERS = ("crossing", "formation", "in-trail", "dense")
START = datetime(2024, 1, 1)

MODULES = {
    "models.transition.linear": ("CombinedLinearGaussianTransitionModel", "ConstantVelocity"),
    "models.measurement.nonlinear": ("CartesianToBearingRange",),
    "predictor.kalman": ("KalmanPredictor",),
    "updater.kalman": ("ExtendedKalmanUpdater",),
    "hypothesiser.base": ("Hypothesiser",),
    "hypothesiser.distance": ("DistanceHypothesiser",),
    "hypothesiser.probability": ("PDAHypothesiser",),
    "dataassociator.neighbour": ("GNNWith2DAssignment",),
    "dataassociator.probability": ("JPDAwithEHM2",),
    "deleter.base": ("Deleter",),
    "deleter.time": ("UpdateTimeStepsDeleter",),
    "initiator.simple": ("MultiMeasurementInitiator",),
    "tracker.simple": ("MultiTargetTracker", "MultiTargetMixtureTracker"),
    "measures": ("Mahalanobis",),
    "types.array": ("StateVector",),
    "types.angle": ("Bearing",),
    "types.detection": ("Detection",),
    "types.state": ("GaussianState",),
    "types.update": ("Update",),
    "base": ("Property",),
}


@dataclass(frozen=True)
class Scene:
    traffic: object
    radars: list
    plots: object
    clutter: int

    @property
    def duration(self):
        return DURATIONS[self.clutter]


@dataclass(frozen=True)
class Picture:
    """What a tracker shows: rows of confirmed tracks, and its CPU seconds per scan of a radar."""

    time: np.ndarray
    track: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    cost: float


def scene(name, n, clutter, radars, seed):
    duration = DURATIONS[clutter]
    if name == "dense":
        traffic = dense_traffic(
            3 * n, area=AREA, speed=(150.0, 250.0), turning_share=0.5, duration=duration, rng=seed
        )
        traffic = replace(traffic, height=np.zeros_like(traffic.height))
    else:
        traffic = encounter(name, n=n, middle=MIDDLE, height=0.0, duration=duration, rng=seed)
    stations = [
        Radar(place, scan_period=PERIOD, max_range=RANGE, detection_probability=DETECTION, **NOISE)
        for place in PLACES[:radars]
    ]
    seen = radar_plots(
        traffic,
        stations,
        clutter=clutter,
        phase=PHASES[:radars],
        identity_missing_probability=1.0,
        height_missing_probability=1.0,
        rng=seed,
    )
    return Scene(traffic, stations, seen.plots, clutter)


def scans(scene, radar):
    """The scans of a radar, from south to south: their times, and the plots in them."""
    begin = PHASES[radar] - PERIOD / 2
    mine = np.flatnonzero(scene.plots.sensor == radar)
    number = np.floor((scene.plots.time[mine] - begin) / PERIOD).astype(int)
    for k in range(int((scene.duration - begin) / PERIOD) + 1):
        first = begin + k * PERIOD
        yield first, first + PERIOD, mine[number == k]


# Tertia


def tertia_tracker(motion="imm", confirmation=(3, 4), **options):
    def run(scene):
        steps = np.floor(scene.plots.time / PERIOD).astype(int)
        # the least of three: the first run warms up
        costs = []
        for _ in range(3):
            slices = [scene.plots[steps == k] for k in range(steps.max() + 1)]
            start = time.process_time()
            tracker = Tracker(
                scene.radars, motion=motion, confirmation=confirmation, coasting=COASTING, **options
            )
            tables = [tracker.update(plots) for plots in slices]
            costs.append((time.process_time() - start) / (len(slices) * len(scene.radars)))
        columns = ("time", "track", "position", "velocity")
        rows = [np.concatenate([getattr(table, name) for table in tables]) for name in columns]
        return Picture(*rows, min(costs))

    return run


# Stone Soup


@cache
def stonesoup():
    """The classes of Stone Soup by name, with two more."""
    ss = {
        name: getattr(importlib.import_module(f"stonesoup.{module}"), name)
        for module, names in MODULES.items()
        for name in names
    }

    class NearBeam(ss["Hypothesiser"]):
        """Hypotheses with the plots near a track, and its missed plot at the time of the beam."""

        hypothesiser = ss["Property"](ss["Hypothesiser"], doc="Weighs the plots.")
        scan = ss["Property"](
            dict, doc="Plots of the scan, their tree, its beginning, and the radar."
        )

        def hypothesise(self, track, detections, timestamp, **kwargs):
            scan, mean, covariance = self.scan, track.state_vector, track.covar
            radar, phase = scan["radar"], scan["phase"]
            age = (timestamp - track.timestamp).total_seconds() - PERIOD / 2
            place = np.array([mean[0] + age * mean[1], mean[2] + age * mean[3]], dtype=float)
            east, north = place - radar.position[:2]
            share = (
                (phase + PERIOD * np.arctan2(east, north) / (2 * np.pi) - scan["begin"]) / PERIOD
            ) % 1
            beam = max(START + timedelta(seconds=scan["begin"] + PERIOD * share), track.timestamp)
            t = (beam - track.timestamp).total_seconds()
            place = [float(mean[0] + t * mean[1]), float(mean[2] + t * mean[3])]
            spread = np.sqrt(covariance[0, 0] + covariance[2, 2])
            spread += (t + 0.1) * np.sqrt(covariance[1, 1] + covariance[3, 3])
            near = (
                scan["tree"].query_ball_point(place, 3.6 * (spread + 200.0)) if detections else []
            )
            chosen = [scan["detections"][i] for i in near]
            chosen = {d for d in chosen if d in detections and d.timestamp >= track.timestamp}
            return self.hypothesiser.hypothesise(track, chosen, beam, **kwargs)

    class TooFew(ss["Deleter"]):
        """Ends tentative tracks that have missed too many scans."""

        misses = ss["Property"](int, doc="Scans that may be missed.")

        def check_for_deletion(self, track, **kwargs):
            return sum(not isinstance(state, ss["Update"]) for state in track) > self.misses

    return ss | {"NearBeam": NearBeam, "TooFew": TooFew}


def tertia_recording(scene):
    """The whole recording in one call."""
    costs = []
    for _ in range(3):
        start = time.process_time()
        table = track(scene.plots, scene.radars, motion="imm", coasting=COASTING)
        costs.append(time.process_time() - start)
    table = table[table.confirmed]
    count = sum(1 for radar in range(len(scene.radars)) for _ in scans(scene, radar))
    return Picture(table.time, table.track, table.position, table.velocity, min(costs) / count)


def stonesoup_steps(scene, scan):
    """Times and sets of detections, which are noted in `scan`."""
    ss = stonesoup()
    models = [
        ss["CartesianToBearingRange"](
            ndim_state=4,
            mapping=(0, 2),
            noise_covar=np.diag([radar.azimuth_sigma**2, radar.range_sigma**2]),
            translation_offset=radar.position[:, np.newaxis],
        )
        for radar in scene.radars
    ]
    places, _ = scene.plots.to_cartesian(scene.radars)
    steps = []
    for radar, model in enumerate(models):
        for begin, end, plots in scans(scene, radar):
            detections = [
                ss["Detection"](
                    ss["StateVector"](
                        [ss["Bearing"](np.pi / 2 - scene.plots.azimuth[i]), scene.plots.range[i]]
                    ),
                    timestamp=START + timedelta(seconds=scene.plots.time[i]),
                    measurement_model=model,
                )
                for i in plots
            ]
            steps.append((end, begin, radar, plots, detections))
    steps.sort(key=lambda step: step[:2])
    for end, begin, radar, plots, detections in steps:
        scan.update(
            begin=begin,
            radar=scene.radars[radar],
            phase=PHASES[radar],
            detections=detections,
            tree=cKDTree(places[plots]) if len(plots) else None,
        )
        yield START + timedelta(seconds=end), set(detections)


def stonesoup_tracker(method, confirmation=(3, 4), sigma=STRAIGHT_SIGMA):
    def run(scene):
        ss, scan, radars = stonesoup(), {}, len(scene.radars)
        q = sigma**2 * PERIOD
        motion = ss["CombinedLinearGaussianTransitionModel"]([ss["ConstantVelocity"](q)] * 2)
        parts = {
            "predictor": ss["KalmanPredictor"](motion),
            "updater": ss["ExtendedKalmanUpdater"](None),
        }
        nearest = ss["DistanceHypothesiser"](
            **parts, measure=ss["Mahalanobis"](), missed_distance=GATE**0.5
        )
        gnn = ss["GNNWith2DAssignment"](ss["NearBeam"](nearest, scan))
        initiator = ss["MultiMeasurementInitiator"](
            prior_state=ss["GaussianState"](
                [[0], [0], [0], [0]], np.diag([0, SPEED_SIGMA**2, 0, SPEED_SIGMA**2])
            ),
            deleter=ss["TooFew"]((confirmation[1] - confirmation[0]) * radars),
            data_associator=gnn,
            updater=parts["updater"],
            min_points=confirmation[0],
        )
        associator = gnn
        if method == "JPDA":
            distance = np.hypot(*MIDDLE)
            probable = ss["PDAHypothesiser"](
                **parts,
                # per radian and metre
                clutter_spatial_density=max(scene.clutter, 1.0) * distance / (np.pi * RANGE**2),
                prob_detect=DETECTION,
                prob_gate=GATE_PROBABILITY,
            )
            associator = ss["JPDAwithEHM2"](ss["NearBeam"](probable, scan))
        name = "MultiTargetMixtureTracker" if method == "JPDA" else "MultiTargetTracker"
        steps = list(scans_of(scene, scan))
        tracker = ss[name](
            initiator=initiator,
            deleter=ss["UpdateTimeStepsDeleter"](COASTING * radars + 1),
            detector=replayed(steps, scan),
            data_associator=associator,
            updater=parts["updater"],
        )
        rows, last = [], {}
        numbers = defaultdict(itertools.count(1).__next__)
        cost = -time.process_time()
        for _, tracks in tracker:
            for shown in tracks:
                state = shown.state
                if last.get(shown.id) is not state:
                    last[shown.id] = state
                    rows.append((numbers[shown.id], state))
        cost += time.process_time()
        means = np.array([np.asarray(s.state_vector, dtype=float)[:, 0] for _, s in rows])
        means = means.reshape(-1, 4)
        return Picture(
            np.array([(s.timestamp - START).total_seconds() for _, s in rows]),
            np.array([number for number, _ in rows], dtype=np.int64),
            means[:, [0, 2]],
            means[:, [1, 3]],
            cost / len(steps),
        )

    return run


def norfair_tracker(scene):
    """Points within six sigmas of the farther plots, confirmed after three."""
    places, _ = scene.plots.to_cartesian(scene.radars)
    tracker = norfair.Tracker(
        distance_function="euclidean",
        distance_threshold=PERIOD * SPEED_SIGMA + 6 * RANGE * NOISE["azimuth_sigma"],
        initialization_delay=2,
        hit_counter_max=COASTING,
    )
    steps = [
        (end, plots) for radar in range(len(scene.radars)) for _, end, plots in scans(scene, radar)
    ]
    steps.sort(key=lambda step: step[0])
    rows, cost = [], 0.0
    for end, plots in steps:
        points = places[plots]
        start = time.process_time()
        shown = tracker.update([norfair.Detection(point[np.newaxis]) for point in points])
        cost += time.process_time() - start
        rows += [(end, one.id, *one.estimate[0], *one.estimate_velocity[0]) for one in shown]
    table = np.array(rows, dtype=float).reshape(-1, 6)
    velocity = table[:, 4:] / PERIOD
    return Picture(
        table[:, 0], table[:, 1].astype(np.int64), table[:, 2:4], velocity, cost / len(steps)
    )


def scans_of(scene, scan):
    """All steps, with what `scan` holds at each."""
    for when, detections in stonesoup_steps(scene, scan):
        yield when, detections, dict(scan)


def replayed(steps, scan):
    for when, detections, what in steps:
        scan.clear()
        scan.update(what)
        yield when, detections


# figures


def mean_gospa(picture, scene):
    """Mean GOSPA at the end of every scan, with tracks brought there."""
    order, traffic = np.argsort(picture.time, kind="stable"), scene.traffic
    values = []
    for now in np.arange(PERIOD, scene.duration, PERIOD):
        recent = order[(picture.time[order] <= now) & (picture.time[order] > now - 1.5 * PERIOD)]
        # of each track the last row
        _, backward = np.unique(picture.track[recent][::-1], return_index=True)
        rows = recent[::-1][backward]
        lag = (now - picture.time[rows])[:, np.newaxis]
        shown = picture.position[rows] + lag * picture.velocity[rows]
        truth, _ = traffic.at(np.arange(len(traffic)), np.full(len(traffic), now))
        values.append(gospa(shown, truth, CUTOFF).distance)
    return np.mean(values)


def figures(picture, scene):
    traffic = scene.traffic
    when = traffic.time
    target = np.broadcast_to(np.arange(len(traffic))[:, np.newaxis], when.shape)
    truth = Truth(when.ravel(), target.ravel(), traffic.position.reshape(-1, 2))
    found = indicators(picture, truth, max_distance=CUTOFF, update_interval=PERIOD)
    return np.array(
        [
            mean_gospa(picture, scene),
            found.switches,
            found.false_tracks * 3600 / scene.duration,
            100 * (1 - found.probability_of_update.value),
            1e3 * picture.cost,
        ]
    )


TRACKERS = {
    "Tertia": tertia_tracker(),
    "Tertia, recording": tertia_recording,
    "Tertia, 4 of 5": tertia_tracker(confirmation=(4, 5)),
    "Tertia, 4 of 6": tertia_tracker(confirmation=(4, 6)),
    "Tertia, 5 of 7": tertia_tracker(confirmation=(5, 7)),
    "Tertia, cv": tertia_tracker("cv"),
    "Stone Soup GNN": stonesoup_tracker("GNN"),
    "Stone Soup GNN, 4 of 5": stonesoup_tracker("GNN", (4, 5)),
    # for those that turn
    "Stone Soup GNN, 1 m/s2": stonesoup_tracker("GNN", sigma=1.0),
    "Stone Soup GNN, 3 m/s2": stonesoup_tracker("GNN", sigma=3.0),
    "Stone Soup JPDA": stonesoup_tracker("JPDA"),
    "norfair": norfair_tracker,
}
if optional("stonesoup") is None:
    TRACKERS = {name: one for name, one in TRACKERS.items() if not name.startswith("Stone Soup")}
if (norfair := optional("norfair")) is None:
    del TRACKERS["norfair"]


def report(title, found):
    own, peer = found["Tertia"], found.get("Stone Soup GNN")
    print(f"\n{title}")
    print(f"  {'':<24}{'GOSPA/m':>9}{'switches':>10}{'false/h':>9}{'missing/%':>11}{'ms/scan':>10}")
    for name, row in found.items():
        print(
            f"  {name:<24}{row[0]:9.0f}{row[1]:10.2f}{row[2]:9.0f}{row[3]:11.2f}{row[4]:10.3f}"
            f"{row[4] / own[4]:9.0f} times"
        )
    keep(work=f"tracker, {title}, a scan", unit="ms", costs={k: row[4] for k, row in found.items()})
    if peer is None:
        return
    verdict = "no worse" if own[0] <= peer[0] and own[1] <= peer[1] else "WORSE"
    print(f"  Tertia / GNN: GOSPA {own[0] / peer[0]:.3f}, {verdict}", flush=True)


def main():
    parser = argparse.ArgumentParser(description="The tracker and those of Stone Soup.")
    parser.add_argument("--clutter", type=int, nargs="*", choices=DURATIONS, default=DURATIONS)
    parser.add_argument("--radars", type=int, nargs="*", choices=(1, 2), default=(1, 2))
    parser.add_argument("--aircraft", type=int, nargs="*", default=(2, 4))
    parser.add_argument("--encounters", nargs="*", choices=ENCOUNTERS, default=ENCOUNTERS)
    parser.add_argument("--trackers", nargs="*", choices=TRACKERS, default=TRACKERS)
    parser.add_argument("--runs", type=int, default=1)
    chosen = parser.parse_args()
    for clutter, radars, name, n in itertools.product(
        chosen.clutter, chosen.radars, chosen.encounters, chosen.aircraft
    ):
        scenes = [scene(name, n, clutter, radars, seed) for seed in range(chosen.runs)]
        found = {
            tracker: np.mean([figures(TRACKERS[tracker](s), s) for s in scenes], axis=0)
            for tracker in chosen.trackers
        }
        title = f"{n} {name}, {clutter} false plots a scan, {radars} radar(s), {len(scenes)} runs"
        report(title, found)


if __name__ == "__main__":
    main()
