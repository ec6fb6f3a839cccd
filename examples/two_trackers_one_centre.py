"""A tracker for each radar in a process of its own, and a centre that makes one picture of them.

Nothing here was measured. Two radars 80 km apart see thirty aircraft for five minutes. Each process
tracks the plots of its radar and sends its tracks through a pipe every five seconds; the centre
registers, associates and fuses them. The picture has the same bits as that of one process.

Prints how many targets there are, and their largest distance from the aircraft.
"""

import multiprocessing
from collections.abc import Iterator
from contextlib import closing
from multiprocessing.connection import Connection

import numpy as np

from tertia import simulate
from tertia.sensors import Radar
from tertia.simulate import RadarPlots
from tertia.tertiary import FusionCentre, SensorTracks, SystemTracks
from tertia.tracker import Plots, Tracker

INTERVAL, END, AIRCRAFT = 5.0, 300.0, 30


def radars() -> list[Radar]:
    """Return the radars."""
    return [
        Radar(
            [east, 0.0],
            range_sigma=50.0,
            azimuth_sigma=0.0015,
            scan_period=4.0 + k,
            max_range=200e3,
        )
        for k, east in enumerate((-40e3, 40e3))
    ]


def record() -> tuple[simulate.Traffic, RadarPlots]:
    """Return the aircraft and the plots of all radars."""
    traffic = simulate.dense_traffic(AIRCRAFT, area=(1e5, 1e5), rng=1)
    return traffic, simulate.radar_plots(traffic, radars(), rng=2)


def tracked(plots: Plots, sensor: int) -> Iterator[SensorTracks]:
    """Track the plots of one radar; yield its tracks interval by interval."""
    own = plots[plots.sensor == sensor]
    own = Plots(own.time, own.range, own.azimuth, height=own.height)
    tracker = Tracker([radars()[sensor]])
    for end in np.arange(INTERVAL, END + INTERVAL, INTERVAL):
        now = (own.time > end - INTERVAL) & (own.time <= end)
        yield SensorTracks.of(tracker.update(own[now], time=end), sensor=sensor)


def send(pipe: Connection, sensor: int) -> None:
    """Send the tracks of a radar, in a process of its own."""
    with closing(pipe):
        for tracks in tracked(record()[1].plots, sensor):
            pipe.send(tracks)


def picture(parts: list[Iterator[SensorTracks]]) -> list[SystemTracks]:
    """Return the pictures of a centre, by what comes from each tracker."""
    centre = FusionCentre(radars())
    return [
        centre.update(SensorTracks.concatenate(list(tracks)), time=INTERVAL * (k + 1))
        for k, tracks in enumerate(zip(*parts, strict=True))
    ]


def received(pipe: Connection) -> Iterator[SensorTracks]:
    """Yield what comes through a pipe until its other end is closed."""
    while True:
        try:
            yield pipe.recv()
        except EOFError:
            return


def of_processes() -> list[SystemTracks]:
    """Return the pictures, with a process for each tracker."""
    context = multiprocessing.get_context("spawn")
    processes, parts = [], []
    for sensor in range(len(radars())):
        ours, theirs = context.Pipe(duplex=False)
        process = context.Process(target=send, args=(theirs, sensor))
        process.start()
        # only the process holds its end: then we notice when it is closed
        theirs.close()
        processes.append(process)
        parts.append(received(ours))
    found = picture(parts)
    for process in processes:
        process.join()
    return found


def of_one_process() -> list[SystemTracks]:
    """Return the same pictures without other processes."""
    plots = record()[1].plots
    return picture([tracked(plots, sensor) for sensor in range(len(radars()))])


def main() -> None:
    """Print what the centre shows at the end."""
    last = of_processes()[-1]
    traffic, _ = record()
    places, _ = traffic.at(np.arange(len(traffic)), np.full(len(traffic), last.time[0]))
    away = np.linalg.norm(last.position[:, np.newaxis] - places, axis=-1).min(axis=1)
    print(f"{last.count} targets, at most {away.max():.0f} m from an aircraft")


if __name__ == "__main__":
    main()
