"""Make bearings.csv: a simulated recording of four targets by one direction finder.

Nothing here was measured. The simulation is `tertia.simulate.direction_finder` with a fixed seed,
so the script makes the same file again. Every two seconds each target is measured once, 120 times
in all. The truth per target, with noise of 2.5 degrees:

north   bearing 0.5: the record crosses north again and again; single outliers
bursts  bearing 74: disturbances of 4 to 10 measurements, mostly of one polarity
gaps    bearing 161.3: single outliers; about every tenth measurement is missing
quiet   bearing 283: noise alone

The seed was chosen for several bursts that lie apart, not for the accuracy of the estimates.
"""

import csv
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tertia.simulate import direction_finder

SEED = 8
COUNT = 120
INTERVAL_S = 2.0
SIGMA_DEG = 2.5
BEARING_DEG = {"north": 0.5, "bursts": 74.0, "gaps": 161.3, "quiet": 283.0}
SINGLE_PROBABILITY = {"north": 0.04, "bursts": 0.02, "gaps": 0.04, "quiet": 0.0}
BURSTS_PER_100 = {"bursts": 2.5}
MISSING_PROBABILITY = {"gaps": 0.1}


def rows() -> Iterator[tuple[str, str, str]]:
    """Yield time, target and bearing in the order of time; an empty bearing is a missing one."""
    rng = np.random.default_rng(SEED)
    records = {target: _record(target, rng) for target in BEARING_DEG}
    for i in range(COUNT):
        for target, record in records.items():
            yield f"{i * INTERVAL_S:.1f}", target, record[i]


def _record(target: str, rng: np.random.Generator) -> list[str]:
    theta = direction_finder(
        COUNT,
        bearing=BEARING_DEG[target],
        sigma=SIGMA_DEG,
        single_probability=SINGLE_PROBABILITY[target],
        bursts_per_100=BURSTS_PER_100.get(target, 0.0),
        rng=rng,
    ).theta
    missing = rng.random(COUNT) < MISSING_PROBABILITY.get(target, 0.0)
    return ["" if gap else f"{angle:.2f}" for gap, angle in zip(missing, theta, strict=True)]


if __name__ == "__main__":
    with Path(__file__).with_name("bearings.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["time_s", "target", "azimuth_deg"])
        writer.writerows(rows())
