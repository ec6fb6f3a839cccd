"""How many times faster than real time a fusion centre is, from 200 aircraft to 20,000.

Aircraft everywhere in a square, one in 4.2 km by 4.2 km whatever their number, a fifth of them with
a turn; four radars of four seconds see all of them, nine times in ten, each with a tracker of its
own; heights and no identities. The centre gets their tracks every five seconds, and learns the
errors of the radars. Counted is the time of its cycles after the first minute, the least of the
runs: processor time of one thread, elapsed time of several. The exponent is that of the time per
cycle.
"""

import argparse
import time

import numpy as np
from tracker_throughput import SPACING, stations

from tertia.sensors import Bias
from tertia.simulate import dense_traffic, radar_plots
from tertia.tertiary import FusionCentre, SensorTracks
from tertia.tracker import Plots, track

CYCLE, WARM = 5.0, 60.0


def tracks(aircraft, duration, radars):
    """The tracks of each radar's own tracker, by time."""
    extent = SPACING * aircraft**0.5
    traffic = dense_traffic(aircraft, area=(extent, extent), duration=duration, rng=1)
    several = []
    for k, radar in enumerate(radars):
        own = radar_plots(traffic, [radar], identity_missing_probability=1.0, rng=2 + k).plots
        own = Plots(own.time, own.range, own.azimuth, height=own.height)
        several.append(SensorTracks.of(track(own, [radar], registration=False), sensor=k))
    rows = SensorTracks.concatenate(several)
    return rows[np.argsort(rows.time, kind="stable")]


def cycles(rows, radars, duration, n_threads):
    """Time of each cycle after the first minute, and the targets of the last."""
    centre, spent = FusionCentre(radars, n_threads=n_threads), []
    clock = time.process_time if n_threads == 1 else time.perf_counter
    ends = np.arange(CYCLE, duration, CYCLE)
    places = np.searchsorted(rows.time, ends, side="right")
    for begin, end, instant in zip([0, *places], places, ends, strict=False):
        some = rows[begin:end]
        start = clock()
        picture = centre.update(some, time=instant)
        spent.append(clock() - start)
    return np.array(spent)[ends > WARM], picture.count


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--aircraft", type=int, nargs="+", default=[200, 2000, 20_000])
    parser.add_argument("--duration", type=float, default=120.0, help="seconds of the recording")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    found = []
    for aircraft in options.aircraft:
        radars = stations(aircraft)
        for radar in radars:
            object.__setattr__(radar, "bias", Bias(range_sigma=150.0, azimuth_sigma=0.0026))
        rows = tracks(aircraft, options.duration, radars)
        several = [
            cycles(rows, radars, options.duration, options.threads) for _ in range(options.runs)
        ]
        least = np.mean(np.min([spent for spent, _ in several], axis=0))
        found.append(least)
        print(
            f"{aircraft:6} aircraft: {1e3 * least:8.2f} ms a cycle, {CYCLE / least:7.1f} times "
            f"real time, {several[0][1]} targets",
            flush=True,
        )
    if len(found) > 1:
        slope = np.polyfit(np.log(options.aircraft), np.log(found), 1)[0]
        print(f"exponent {slope:.2f}")


if __name__ == "__main__":
    main()
