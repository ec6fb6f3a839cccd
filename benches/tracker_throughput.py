"""Plots per second of the tracker, from a hundred aircraft to twenty thousand.

Aircraft everywhere in a square, one in 4.2 km by 4.2 km whatever their number, a fifth of them with
a turn; four radars of four seconds that see all of them, nine times in ten; one false plot for ten
aircraft in every scan of each radar; nine in ten plots with height and identity.

"scan by scan" is `Tracker.update` every four seconds, "recording" one call of `track`; the least of
the runs. The memory is what `track` needs beside the plots, tables included. The exponent is that
of the time per plot, fitted to all numbers of aircraft: 0 is linear.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.append(str(Path(__file__).parent / "peers"))

from timing import report_growth

# isort: split
import numpy as np

from tertia.simulate import dense_traffic, radar_plots
from tertia.tracker import Plots, Radar, Tracker, track

SPACING, PERIOD, DETECTION = 4200.0, 4.0, 0.9
CORNERS = [(x, y) for x in (-0.25, 0.25) for y in (-0.25, 0.25)]
COLUMNS = ("time", "range", "azimuth", "sensor", "height", "identity")


def stations(aircraft):
    extent = SPACING * aircraft**0.5
    return [
        Radar(
            (x * extent, y * extent),
            range_sigma=50.0,
            azimuth_sigma=np.radians(0.08),
            scan_period=PERIOD,
            max_range=1.2 * extent + 20e3,
            detection_probability=DETECTION,
        )
        for x, y in CORNERS
    ]


def recording(aircraft, duration, false_share):
    """The plots of all radars, by time."""
    extent, radars = SPACING * aircraft**0.5, stations(aircraft)
    traffic = dense_traffic(aircraft, area=(extent, extent), duration=duration, rng=1)
    # false plots are uniform over the range of the radar, which is larger than the square
    share = np.pi * (radars[0].max_range / extent) ** 2
    seen = radar_plots(
        traffic,
        radars,
        clutter=false_share * aircraft * share,
        height_missing_probability=0.1,
        identity_missing_probability=0.1,
        rng=2,
    )
    return seen.plots[np.argsort(seen.plots.time, kind="stable")]


def peak():
    """The largest memory so far, in megabytes."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


CLOCKS = {"wall": time.perf_counter, "cpu": time.process_time}


def measure(path, aircraft, runs, now, options):
    """Print seconds of a recording, of the same scan by scan, and megabytes."""
    columns = dict(np.load(path))
    plots = Plots(**columns)
    radars, before = stations(aircraft), peak()
    whole, scans = [], []
    for _ in range(runs):
        begin = now()
        rows = len(track(plots, radars, **options))
        whole.append(now() - begin)
        assert rows > aircraft
    memory = peak() - before
    steps = np.searchsorted(plots.time, np.arange(PERIOD, plots.time[-1] + PERIOD, PERIOD))
    pieces = [plots[slice(*ends)] for ends in zip([0, *steps[:-1]], steps, strict=True)]
    for _ in range(runs):
        tracker, begin = Tracker(radars, **options), now()
        for piece in pieces:
            tracker.update(piece)
        scans.append(now() - begin)
    print(len(plots), min(whole), min(scans), memory)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--aircraft", type=int, nargs="*", default=(100, 1000, 5000, 20_000))
    parser.add_argument("--threads", type=int, nargs="*", default=(1, 2))
    parser.add_argument("--false", type=float, default=0.1, help="false plots per aircraft")
    parser.add_argument("--duration", type=float, default=48.0, help="seconds")
    parser.add_argument("--runs", type=int, default=2)
    parser.add_argument("--clock", choices=CLOCKS, default="wall", help="cpu: of all threads")
    parser.add_argument("--no-registration", action="store_true", help="take errors as known")
    parser.add_argument("--measure", help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.measure:
        now = CLOCKS[chosen.clock]
        options = {"n_threads": chosen.threads[0]}
        options |= {"registration": False} if chosen.no_registration else {}
        return measure(chosen.measure, *chosen.aircraft, chosen.runs, now, options)
    print("| aircraft | plots | threads | recording, plots/s | scan by scan, plots/s | MB |")
    print("| --- | --- | --- | --- | --- | --- |")
    costs = {}
    with tempfile.TemporaryDirectory() as folder:
        for aircraft in chosen.aircraft:
            path = Path(folder) / "plots.npz"
            plots = recording(aircraft, chosen.duration, chosen.false)
            np.savez(path, **{name: getattr(plots, name) for name in COLUMNS})
            for n_threads in chosen.threads:
                # a process of its own, for its memory
                command = [sys.executable, __file__, "--measure", str(path), "--runs"]
                command += [str(chosen.runs), "--aircraft", str(aircraft)]
                command += ["--threads", str(n_threads), "--clock", chosen.clock]
                command += ["--no-registration"] if chosen.no_registration else []
                printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
                count, whole, scans, memory = (float(word) for word in printed.split())
                costs[n_threads, aircraft] = whole / count, scans / count
                print(
                    f"| {aircraft} | {count:.0f} | {n_threads} | {count / whole:,.0f} "
                    f"| {count / scans:,.0f} | {memory:.0f} |",
                    flush=True,
                )
    for n_threads in chosen.threads if len(chosen.aircraft) > 1 else ():
        threads = "1 thread" if n_threads == 1 else f"{n_threads} threads"
        for way, name in enumerate(("recording", "scan by scan")):
            times = [1e9 * costs[n_threads, aircraft][way] for aircraft in chosen.aircraft]
            title = f"track, {name}, {threads}, a plot"
            report_growth(title, "aircraft", chosen.aircraft, times, "µs")
    return None


if __name__ == "__main__":
    main()
