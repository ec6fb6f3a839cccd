"""Replies by way of buildings and by side lobes of an antenna: docs/tracker-false-tracks.md."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from studies.fixed_echoes import live
from studies.montecarlo import generator
from studies.pages import markdown, repetitions
from tertia._arrays import FloatArray, IntArray
from tertia.tracker import Plots, Radar, TrackTable, track

SCENES = repetitions(10, 1)
SCANS, PERIOD = 150, 4.0
RADAR = Radar(
    range_sigma=30.0,
    azimuth_sigma=np.radians(0.07),
    scan_period=PERIOD,
    max_range=110e3,
    detection_probability=0.95,
)
# airliners with codes of their own; aircraft under visual rules, all with the code 7000
AIRLINERS, VISUAL = 24, 6
FIRST_CODE, VISUAL_CODE, FIRST_ADDRESS = 0o1001, 0o7000, 0x400000
FOOT = 0.3048
# reflectors: number, distances, widths as seen by the radar, and how often a reply is reflected
WALLS, NEAREST, FARTHEST, WIDTHS, REFLECTED = 3, 1e3, 12e3, (1.0, 5.0), 0.7
# side lobes: azimuths from the beam, the range within which they detect, and how often
LOBES, REACH, BESIDE = (180.0, 25.0, -40.0), 10e3, 0.6
# kinds of plots that are of no target where they are
DIRECT, WALL, LOBE = range(3)
DEFECTS = {
    "neither": (False, False),
    "reflectors": (True, False),
    "side lobes": (False, True),
    "both": (True, True),
}


@dataclass(frozen=True)
class Aircraft:
    """Aircraft that fly straight: places at the middle of the time, velocities, heights, codes."""

    middle: FloatArray
    velocity: FloatArray
    height: FloatArray
    climb: FloatArray
    code: IntArray

    def at(self, who: IntArray, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return places and heights."""
        since = time - PERIOD * SCANS / 2
        place = self.middle[who] + since[:, np.newaxis] * self.velocity[who]
        return place, self.height[who] + since * self.climb[who]


def flown(random: np.random.Generator) -> Aircraft:
    """Return airliners, a third of which climb or descend, and slow aircraft at few levels."""
    n, count = AIRLINERS, AIRLINERS + VISUAL
    course, speed = random.uniform(0, 2 * np.pi, count), random.uniform(100.0, 230.0, count)
    speed[n:] = random.uniform(45.0, 70.0, VISUAL)
    reach = np.where(np.arange(count) < n, 50e3, 20e3)[:, np.newaxis]
    height = random.uniform(4000.0, 11000.0, count)
    height[n:] = 500.0 * FOOT * random.integers(4, 10, VISUAL)
    climb = random.choice([-1.0, 0.0, 0.0, 0.0, 0.0, 1.0], count) * random.uniform(3.0, 8.0, count)
    climb[n:] = 0.0
    code = np.append(FIRST_CODE + 7 * np.arange(n), np.full(VISUAL, VISUAL_CODE))
    velocity = speed[:, np.newaxis] * np.column_stack([np.sin(course), np.cos(course)])
    return Aircraft(reach * random.uniform(-1, 1, (count, 2)), velocity, height, climb, code)


@dataclass(frozen=True)
class Wall:
    """A vertical wall: distance and azimuth of its middle, its width, azimuth of its normal."""

    distance: float
    azimuth: float
    width: float
    normal: float

    def see(self, place: FloatArray, height: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return slant ranges and azimuths by way of the wall."""
        normal = np.array([np.sin(self.normal), np.cos(self.normal)])
        middle = self.distance * np.array([np.sin(self.azimuth), np.cos(self.azimuth)])
        image = place - 2 * ((place - middle) @ normal)[:, np.newaxis] * normal
        to = image / np.linalg.norm(image, axis=1)[:, np.newaxis]
        spot = np.abs(middle @ normal / (to @ normal))
        leg = np.hypot(np.linalg.norm(place - spot[:, np.newaxis] * to, axis=1), height)
        on_wall = np.abs((np.arctan2(*to.T) - self.azimuth + np.pi) % (2 * np.pi) - np.pi)
        in_front = ((place - middle) @ normal) * (middle @ normal) < 0
        is_seen = (on_wall < self.width / 2) & in_front
        return np.where(is_seen, spot + leg, np.inf), np.arctan2(*to.T)


def walls(random: np.random.Generator) -> list[Wall]:
    """Return walls about the radar."""
    azimuth = random.uniform(0, 2 * np.pi, WALLS)
    distance = np.exp(random.uniform(np.log(NEAREST), np.log(FARTHEST), WALLS))
    width = np.radians(random.uniform(*WIDTHS, WALLS))
    each = zip(distance, azimuth, width, azimuth + random.uniform(-0.9, 0.9, WALLS), strict=True)
    return [Wall(*(float(number) for number in one)) for one in each]


def directly(place: FloatArray, height: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return slant ranges and azimuths."""
    return np.hypot(np.linalg.norm(place, axis=1), height), np.arctan2(*place.T)


def seen(
    aircraft: Aircraft, kind: int, random: np.random.Generator, wall: Wall | None, lobe: float = 0.0
) -> FloatArray:
    """Return times, ranges, azimuths, heights, aircraft and kinds of plots, (N, 6)."""
    see = directly if wall is None else wall.see
    grid = np.meshgrid(np.arange(SCANS), np.arange(len(aircraft.code)), indexing="ij")
    scan, who = (index.ravel() for index in grid)
    time = np.asarray(PERIOD * (scan + 0.5), np.float64)
    for _ in range(4):
        place, height = aircraft.at(who, time)
        distance, azimuth = see(place, height)
        time = PERIOD * (scan + (azimuth + lobe) % (2 * np.pi) / (2 * np.pi))
    often = {DIRECT: RADAR.detection_probability, WALL: REFLECTED, LOBE: BESIDE}[kind]
    limit = REACH if kind == LOBE else RADAR.max_range
    is_seen = (random.random(len(time)) < often) & (distance < limit) & (height < 0.8 * distance)
    noise = random.standard_normal((2, len(time)))
    columns = [
        time,
        distance + RADAR.range_sigma * noise[0],
        (azimuth + lobe + RADAR.azimuth_sigma * noise[1]) % (2 * np.pi),
        np.round(height / (100 * FOOT)) * 100 * FOOT,
        who,
        np.full(len(time), kind),
    ]
    return np.column_stack(columns)[is_seen]


def scene(run: int, defects: tuple[bool, bool], *, has_addresses: bool) -> tuple[Plots, IntArray]:
    """Return plots, and the aircraft of each; -1 for those that are of none there."""
    random = generator(4800, run)
    aircraft, with_walls, with_lobes = flown(random), *defects
    parts = [seen(aircraft, DIRECT, random, None)]
    if with_walls:
        parts += [seen(aircraft, WALL, random, wall) for wall in walls(random)]
    if with_lobes:
        parts += [seen(aircraft, LOBE, random, None, np.radians(lobe)) for lobe in LOBES]
    rows = np.concatenate(parts)
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    who = rows[:, 4].astype(np.int64)
    address = np.where(who < AIRLINERS, FIRST_ADDRESS + who, -1) if has_addresses else None
    plots = Plots(
        *rows[:, :3].T, height=rows[:, 3], mode_3a=aircraft.code[who], icao_address=address
    )
    return plots, np.where(rows[:, 5] == DIRECT, who, -1)


def judged(table: TrackTable, target: IntArray) -> tuple[int, float, float, float]:
    """Return false tracks, their minutes, and shares of plots in tracks: airliners, visual."""
    own = table[table.confirmed & (table.plot >= 0)]
    whose = target[own.plot]
    _, number = np.unique(own.track, return_inverse=True)
    is_false = 2 * np.bincount(number, whose >= 0) < np.bincount(number)
    is_held = np.isin(np.arange(len(target)), own.plot[~is_false[number]])
    rules = [(target >= 0) & (target < AIRLINERS), target >= AIRLINERS]
    scans = int(np.sum(is_false[number]))
    shares = [float(np.mean(is_held[some])) for some in rules]
    return int(np.sum(is_false)), scans * PERIOD / 60, shares[0], shares[1]


def recorded(plots: Plots) -> TrackTable:
    """Track a whole recording."""
    return track(plots, [RADAR])


def scan_by_scan(plots: Plots) -> TrackTable:
    """Track as the plots come."""
    return live(plots, RADAR)


def table() -> str:
    """Tabulate false tracks by reflections and side lobes, and what becomes of aircraft."""
    rows = []
    for identities in ("addresses and codes", "codes"):
        for name, defects in DEFECTS.items():
            cells = []
            for way in (recorded, scan_by_scan):
                found, extra = [], []
                for run in range(SCENES):
                    plots, target = scene(
                        run, defects, has_addresses=identities.startswith("addresses")
                    )
                    found.append(judged(way(plots), target))
                    extra.append(np.mean(target < 0))
                false, minutes, airliners, visual = np.mean(found, axis=0)
                cells += [f"{false:.1f}", f"{minutes:.1f}", f"{airliners:.1%}", f"{visual:.1%}"]
            rows.append([identities, name, f"{np.mean(extra):.0%}", *cells])
    head = ["identities", "defects", "such plots"]
    for called in ("recorded", "live"):
        head += [f"false tracks, {called}", "minutes of these", "plots of airliners in tracks"]
        head += ["of aircraft with 7000"]
    return markdown(head, rows)
