"""How times grow: the exponents of tracker, tables, `locate`, `reconstruct` and weights.

Times are fitted by a power of the size, over all sizes; the smaller ones cost little more than the
call. Tracker and tables are measured in processes of their own, by wall clock, the others by CPU
time on one thread. Exponents are those of the time of a plot (0: linear), of a recording, of an
instant with so many stations, of a trajectory, and of a covariance of weights.
"""

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
from tertia.trajectory import reconstruct

FAULTY = 0.05
# elements of the covariances that fit into a cache
IN_CACHE = 2**17


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


def main():
    positions()
    trajectories()
    covariances()
    for script in ("large_tables.py", "tracker_throughput.py"):
        subprocess.run([sys.executable, str(Path(__file__).with_name(script))], check=True)


if __name__ == "__main__":
    main()
