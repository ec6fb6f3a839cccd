"""Make radars.csv: a simulated recording of one target by three radars.

Nothing here was measured. The simulation is `tertia.simulate.radars` with a fixed seed, so the file
can be made again. Each radar looks every five seconds, one after the other, 120 times; about every
twentieth plot is missing. The target crosses north and turns. The truth per radar:

north   noise of 0.1 degrees
south   noise of 0.1 degrees, and of 0.4 from 300 s on
east    noise of 0.2 degrees; from 150 to 250 s a third of its plots are outliers
"""

import csv
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tertia.kalman import SingerModel
from tertia.simulate import RadarRecord, radars

SEED = 4
SCANS = 120
SCAN_S = 5.0
SIGMA_DEG = {"north": 0.1, "south": 0.1, "east": 0.2}
MISSING_PROBABILITY = 0.05
NOISY_FROM_S, NOISY_FACTOR = 300.0, 4.0
OUTLIERS_S, OUTLIER_PROBABILITY = (150.0, 250.0), 0.3
# one radar looks at each step
MODEL = SingerModel(SCAN_S / len(SIGMA_DEG), 1 / 20, 0.003, exact=True)


def times() -> np.ndarray:
    """Return the times of all steps."""
    return MODEL.dt * np.arange(SCANS * len(SIGMA_DEG))


def record() -> RadarRecord:
    """Simulate the plots, (3, steps), and the truth."""
    time = times()
    turn = np.arange(time.size) % len(SIGMA_DEG)
    sees = turn == np.arange(len(SIGMA_DEG))[:, np.newaxis]
    sigma = np.array(list(SIGMA_DEG.values()))[:, np.newaxis] * np.ones(time.size)
    sigma[1, time >= NOISY_FROM_S] *= NOISY_FACTOR
    wrong = np.zeros(sigma.shape)
    wrong[2, (time >= OUTLIERS_S[0]) & (time < OUTLIERS_S[1])] = OUTLIER_PROBABILITY
    return radars(
        MODEL,
        time.size,
        sigma=sigma,
        detection_probability=(1 - MISSING_PROBABILITY) * sees,
        outlier_probability=wrong,
        turn=(200, 280, 0.1),
        angle=340.0,
        rate=0.08,
        period=360.0,
        rng=SEED,
    )


def rows() -> Iterator[tuple[str, str, str]]:
    """Yield time, radar and azimuth in the order of time; an empty azimuth is a missing one."""
    z = record().z
    names = list(SIGMA_DEG)
    for step, time in enumerate(times()):
        radar = step % len(names)
        angle = z[radar, step]
        yield f"{time:.2f}", names[radar], "" if np.isnan(angle) else f"{angle:.3f}"


if __name__ == "__main__":
    with Path(__file__).with_name("radars.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["time_s", "sensor", "azimuth_deg"])
        writer.writerows(rows())
