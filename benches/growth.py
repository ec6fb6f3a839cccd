"""How times grow: the exponents of tracker, tables, `locate`, `reconstruct` and weights.

Times are fitted by a power of the size, over all sizes; the smaller ones cost little more than the
call. Tracker and tables are measured in processes of their own, by wall clock unless `--clock cpu`
says otherwise, the others by CPU time on one thread. Exponents are those of the time of a plot (0:
linear), of a recording, of an instant with so many stations, of a trajectory, of a covariance of
weights, and of smoothed tracks by how long they are.

    python benches/growth.py           # tracker up to 20,000 aircraft, tables up to 10 million rows
    python benches/growth.py --long    # up to 50,000 and 100 million: 4 GB of memory, 3 of disk
"""

import argparse
import subprocess
import sys
from functools import partial
from pathlib import Path

sys.path.append(str(Path(__file__).parent / "peers"))

from timing import least, report_growth

# isort: split
import numpy as np

from tertia import weights
from tertia.location import Station, locate
from tertia.sensors import Bias, Radar
from tertia.tracker import Plots, smooth_tracks, track
from tertia.trajectory import reconstruct

FAULTY = 0.05
# elements of the covariances that fit into a cache
IN_CACHE = 2**17
LONG = {
    "large_tables.py": ("--rows", *(str(10**power) for power in (5, 6, 7, 8))),
    "tracker_throughput.py": ("--aircraft", "100", "1000", "5000", "20000", "50000"),
}


def positions():
    """Ranges and azimuths by stations on a circle, one in twenty wrong."""
    for faulty in (0.0, FAULTY):
        counts, problems = (3, 5, 8, 12, 20, 35, 50), {}
        for count in counts:
            stations, target, measured = measurements(count, 1_000, faulty)
            problems[count] = (partial(locate, stations, **measured, n_threads=1), len(target))
        costs = list(least(problems).values())
        report_growth(f"locate, {faulty:.0%} faults, an instant", "stations", counts, costs, "µs")


def measurements(count, instants, faulty):
    rng = np.random.default_rng(count)
    turn = 2 * np.pi * np.arange(count) / count
    places = 2000 * np.stack([np.sin(turn), np.cos(turn)], axis=-1)
    stations = [Station(place, range_sigma=10.0, azimuth_sigma=0.005) for place in places]
    target = np.linspace([-500.0, -500.0], [500.0, 700.0], instants)
    offset = target[:, np.newaxis] - places
    noise = rng.standard_normal((2, instants, count))
    noise += np.where(rng.random(noise.shape) < faulty, 30.0, 0.0)
    measured = {
        "range": np.linalg.norm(offset, axis=-1) + 10 * noise[0],
        "azimuth": np.arctan2(offset[..., 0], offset[..., 1]) + 0.005 * noise[1],
    }
    return stations, target, measured


def trajectories():
    sizes, problems = (100, 300, 1_000, 3_000, 10_000), {}
    for steps in sizes:
        stations, _, measured = measurements(3, steps, 0.0)
        call = partial(reconstruct, stations, np.arange(float(steps)), **measured, n_threads=1)
        problems[steps] = (call, 1)
    report_growth(
        "reconstruct, 3 stations", "instants", sizes, list(least(problems).values()), "ms"
    )


def covariances():
    orders, problems = (2, 3, 4, 6, 8, 12, 16), {}
    for m in orders:
        count = max(1, IN_CACHE // m**4)
        root = np.random.default_rng(1).standard_normal((count, 2, m, 2 * m))
        s = root @ np.swapaxes(root, -1, -2) / (2 * m)
        problems[m] = (partial(weights.weight_covariance, s, 30, n_threads=1), count)
    report_growth("weight_covariance", "components", orders, list(least(problems).values()), "µs")


def smoothed_tracks():
    """Five aircraft that turn now and then, seen by ten radars."""
    sizes, problems = (0.25, 0.5, 1.0, 2.0, 4.0), {}
    for hours in sizes:
        plots, radars = flown(hours)
        tracks = track(plots, radars, registration=False)
        problems[hours] = (partial(smooth_tracks, plots, radars, tracks, n_threads=1), len(plots))
    costs = list(least(problems).values())
    report_growth("smooth_tracks, 10 radars, a plot", "hours", sizes, costs, "µs")


def flown(hours, aircraft=5):
    rng = np.random.default_rng(5)
    radars = [
        Radar(
            position=tuple(rng.uniform(-150e3, 150e3, 2)),
            range_sigma=rng.uniform(40.0, 100.0),
            azimuth_sigma=np.radians(0.08),
            scan_period=period,
            bias=Bias(),
        )
        for period in np.resize([4.0, 5.0, 6.0, 8.0, 10.0, 12.0], 10)
    ]
    end, columns = 3600.0 * hours, []
    second = np.arange(0.0, end + 20.0)
    for identity in range(aircraft):
        turns = np.repeat(rng.choice([0.0, 0.0, 0.0, -1.5, 1.5, 3.0], len(second) // 60 + 1), 60)
        course = rng.uniform(0.0, 2 * np.pi) + np.cumsum(np.radians(turns[: len(second)]))
        step = rng.uniform(120.0, 240.0) * np.stack([np.sin(course), np.cos(course)])
        place = rng.uniform(-80e3, 80e3, (2, 1)) + np.cumsum(step, axis=1)
        for k, radar in enumerate(radars):
            time = np.arange(rng.uniform(0.0, radar.scan_period), end, radar.scan_period)
            time = time[rng.random(len(time)) < 0.9]
            x, y = (
                np.interp(time, second, axis) - own
                for axis, own in zip(place, radar.position[:2], strict=True)
            )
            noise = rng.standard_normal((2, len(time)))
            distance = np.hypot(x, y) + radar.range_sigma * noise[0]
            azimuth = np.arctan2(x, y) + radar.azimuth_sigma * noise[1]
            columns.append([time, distance, azimuth, *np.full((2, len(time)), [[k], [identity]])])
    time, distance, azimuth, sensor, identity = np.hstack(columns)
    order = np.argsort(time, kind="stable")
    plots = Plots(time, distance, azimuth, sensor=sensor.astype(int), identity=identity.astype(int))
    return plots[order], radars


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--long", action="store_true", help="the largest tables and pictures, too")
    parser.add_argument("--clock", choices=("wall", "cpu"), default="wall", help="of these two")
    options = parser.parse_args()
    positions()
    smoothed_tracks()
    trajectories()
    covariances()
    for script, sizes in LONG.items():
        command = [sys.executable, str(Path(__file__).with_name(script)), "--clock", options.clock]
        subprocess.run([*command, *(sizes if options.long else ())], check=True)


if __name__ == "__main__":
    main()
