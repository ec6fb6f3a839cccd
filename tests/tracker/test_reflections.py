"""Replies that reach a radar by way of a building or by a side lobe make no tracks of their own."""

import numpy as np
import pytest
from tracker.flights import RADAR, noisy

from tertia.tracker import Plots, PlotStatus, Tracker, TrackTable, track

SCANS = 60
PERIOD = 4.0
WALL = np.array([3e3, -1e3])
HEIGHT = 3000.0


def swept(place):
    """Times at which the beam passes places, one in each scan, and the places then."""
    azimuth = np.arctan2(*place(np.full(SCANS, 0.5)).T) % (2 * np.pi)
    for _ in range(3):
        part = azimuth / (2 * np.pi)
        azimuth = np.arctan2(*place(part).T) % (2 * np.pi)
    return PERIOD * (np.arange(SCANS) + azimuth / (2 * np.pi)), azimuth


def flown(start, velocity):
    """Positions of an aircraft in each scan, after a part of it."""

    def place(part):
        return np.array(start) + PERIOD * (np.arange(SCANS) + part)[:, np.newaxis] * velocity

    return place


def plotted(place, rng, **identities):
    """Plots of an aircraft at this height, one in each scan."""
    time, azimuth = swept(place)
    ground = np.hypot(*place(azimuth / (2 * np.pi)).T)
    distance, azimuth = noisy(
        ground[:, np.newaxis] * np.column_stack([np.sin(azimuth), np.cos(azimuth)]), RADAR, rng
    )
    return rows(time, np.hypot(distance, HEIGHT), azimuth, identities)


def rows(time, distance, azimuth, identities):
    """Columns of plots at the height of all aircraft."""
    columns = {"time": time, "range": distance, "azimuth": azimuth}
    columns["height"] = np.full(len(time), HEIGHT)
    return columns | {name: np.full(len(time), value) for name, value in identities.items()}


def reflected(place, rng, first, **identities):
    """Plots of an aircraft by way of a wall, from a scan on."""
    azimuth = np.arctan2(*WALL) % (2 * np.pi)
    part = azimuth / (2 * np.pi)
    leg = np.hypot(np.hypot(*(place(np.full(SCANS, part)) - WALL).T), HEIGHT)
    distance = np.hypot(*WALL) + leg + 50.0 * rng.standard_normal(SCANS)
    noise = np.radians(0.08) * rng.standard_normal(SCANS)
    found = rows(PERIOD * (np.arange(SCANS) + part), distance, azimuth + noise, identities)
    return {name: column[first:] for name, column in found.items()}


def lobe(place, rng, first, **identities):
    """Plots of an aircraft by a lobe to the side, at 0.6 rad from the beam, from a scan on."""
    found = plotted(place, rng, **identities)
    found["azimuth"] = (found["azimuth"] + 0.6) % (2 * np.pi)
    found["time"] = PERIOD * (np.arange(SCANS) + found["azimuth"] / (2 * np.pi))
    return {name: column[first:] for name, column in found.items()}


def joined(*parts):
    """All plots in the order of time, and the part that each is of."""
    number = np.repeat(np.arange(len(parts)), [len(part["time"]) for part in parts])
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    order = np.argsort(columns["time"], kind="stable")
    return Plots(**{name: column[order] for name, column in columns.items()}), number[order]


def live(plots):
    """Track scan by scan."""
    tracker, parts = Tracker([RADAR]), []
    for end in PERIOD * np.arange(1, SCANS + 2):
        now = (plots.time >= end - PERIOD) & (plots.time < end)
        parts.append(tracker.update(plots[now], time=end))
    return TrackTable.join(parts)


def shown(found):
    """Numbers of the confirmed tracks."""
    return np.unique(found.track[found.confirmed])


PLACE = flown([10e3, 25e3], np.array([120.0, -60.0]))
NEAR = flown([3e3, 5e3], np.array([30.0, 15.0]))
ADDRESS = {"icao_address": 0x3C4DC1, "callsign": "CSA123"}


@pytest.mark.parametrize("recorded", [True, False])
@pytest.mark.parametrize("identities", [ADDRESS, {"mode_3a": 0o4204}])
@pytest.mark.parametrize("ghost", [(PLACE, reflected), (NEAR, lobe)])
def test_a_reflection_makes_no_track(ghost, identities, recorded):
    place, ways = ghost
    for seed in range(5):
        rng = np.random.default_rng(seed)
        parts = plotted(place, rng, **identities), ways(place, rng, 10, **identities)
        plots, of = joined(*parts)
        found = track(plots, [RADAR]) if recorded else live(plots)
        assert len(shown(found)) == 1
        assert np.all(found.track_of_plot[of == 1] == PlotStatus.REFLECTION)
        assert np.mean(found.track_of_plot[of == 0] > 0) > 0.95


@pytest.mark.parametrize("code", [0o4204, 0o7000])
def test_aircraft_with_one_code_at_one_height_are_two(code):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        angle = rng.uniform(0, 2 * np.pi, 2)
        other = flown(20e3 * np.array([np.sin(angle[0]), np.cos(angle[0])]), np.array([50.0, 70.0]))
        parts = [plotted(place, rng, mode_3a=code) for place in (NEAR, other)]
        plots, of = joined(*parts)
        found = track(plots, [RADAR])
        assert len(shown(found)) == 2
        for number in (0, 1):
            assert np.mean(found.track_of_plot[of == number] > 0) > 0.8


def test_aircraft_with_one_address_by_mistake_are_two():
    rng = np.random.default_rng(1)
    names = ("CSA123", "KLM1023")
    parts = [
        plotted(place, rng, icao_address=0x3C4DC1, callsign=name)
        for place, name in zip((NEAR, PLACE), names, strict=True)
    ]
    with pytest.warns(UserWarning, match="have the same address, 3C4DC1"):
        found = track(joined(*parts)[0], [RADAR])
    assert len(shown(found)) == 2
    assert not np.any(found.track_of_plot == PlotStatus.REFLECTION)


def of_part(found, part, number):
    """Times of the confirmed rows of tracks by the plots of a part."""
    seen = found[found.confirmed & (found.plot >= 0)]
    return seen.time[part[seen.plot] == number]


@pytest.mark.parametrize("way", [live, lambda plots: track(plots, [RADAR])])
@pytest.mark.parametrize("seed", range(3))
def test_a_side_lobe_that_begins_with_its_aircraft_ends(way, seed):
    rng = np.random.default_rng([61, seed])
    place = flown([6e3, 4e3], [-20.0, 50.0])
    beside = lobe(place, rng, 0, mode_3a=0o7000)
    often = np.arange(SCANS) % 5 < 3
    beside = {name: column[often] for name, column in beside.items()}
    plots, part = joined(plotted(place, rng, mode_3a=0o7000), beside)
    found = way(plots)
    assert np.max(of_part(found, part, 1), initial=0.0) < 50 * PERIOD
    assert len(of_part(found, part, 0)) > SCANS - 12


@pytest.mark.parametrize("way", [live, lambda plots: track(plots, [RADAR])])
def test_a_reflection_that_begins_before_its_aircraft_ends(way):
    rng = np.random.default_rng(62)
    place = flown([-9e3, 14e3], [100.0, 60.0])
    own = plotted(place, rng, icao_address=0x3C6586)
    own = {name: column[8:] for name, column in own.items()}
    plots, part = joined(own, reflected(place, rng, 0, icao_address=0x3C6586))
    found = way(plots)
    assert len(of_part(found, part, 1)) > 0
    assert np.max(of_part(found, part, 1)) < 25 * PERIOD
    assert len(of_part(found, part, 0)) > SCANS - 8 - 5
