"""Figures of docs/geo.md. Truth is from pyproj, which knows nothing of the kernels here."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pyproj

from studies.montecarlo import WITHIN_95
from studies.pages import markdown, repetitions
from tertia import simulate
from tertia._arrays import FloatArray
from tertia.geo import LocalFrame, SystemPlane
from tertia.metrics import nees
from tertia.registration import register
from tertia.sensors import Bias, Radar
from tertia.tables._sensors import Sensors, radars
from tertia.tracker import CvModel, Plots, Tracker, track

SEED = 41
EARTH = pyproj.Geod(ellps="WGS84")
AIRCRAFT = repetitions(4000, 200)
# the radars are so far from the first, in these directions; heights of aircraft
PLACES = ((0.0, 0.0, 300.0), (150e3, 60.0, 450.0), (270e3, 130.0, 600.0))
HEIGHTS = (5e3, 11e3)
# the radars see aircraft within this distance of the middle of all three
WITHIN = 200e3
ROUNDING = 1e-6
SCENES = repetitions(20, 1)
# seconds until tracks have settled
SETTLED = 120.0
FORMS = {"flat": True, "system plane": False}


def sites() -> FloatArray:
    """Return latitudes, longitudes and heights of three radars, (3, 3)."""
    rows = []
    for distance, azimuth, height in PLACES:
        longitude, latitude, _ = EARTH.fwd(14.0, 50.0, azimuth, distance)
        rows.append((latitude, longitude, height))
    return np.array(rows)


def sensors(places: FloatArray, *, flat: bool) -> Sensors[Radar]:
    """Return radars as a file describes them."""
    names = ("latitude_deg", "longitude_deg", "height_m")
    numbers = {"range_sigma_m": 50.0, "azimuth_sigma_deg": 0.1, "scan_period_s": 4.0}
    rows = [
        {"name": str(k), **dict(zip(names, place, strict=True)), **numbers}
        for k, place in enumerate(places.tolist())
    ]
    found = radars(rows, flat=flat)
    # positions are corrected for the noise of azimuths; here there is none
    return replace(found, items=[replace(one, azimuth_sigma=1e-9) for one in found.items])


def metres(value: float) -> str:
    """Format a distance that may be nothing but rounding."""
    return "below 1e-6 m" if value < ROUNDING else f"{value:.0f} m"


def aircraft(middle: FloatArray, within: float, seed: int) -> FloatArray:
    """Return places uniform over a disk, (3, N)."""
    random = np.random.default_rng([SEED, seed])
    distance = within * np.sqrt(random.uniform(size=AIRCRAFT))
    azimuth = random.uniform(0.0, 360.0, AIRCRAFT)
    start = np.full(AIRCRAFT, middle[1]), np.full(AIRCRAFT, middle[0])
    longitude, latitude, _ = EARTH.fwd(*start, azimuth, distance)
    return np.array([latitude, longitude, random.uniform(*HEIGHTS, AIRCRAFT)])


def view(site: FloatArray, places: FloatArray) -> FloatArray:
    """Return range and azimuth of places without noise, (2, N), by pyproj."""
    pipeline = pyproj.Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad "
        "+step +proj=cart +ellps=WGS84 +step +proj=topocentric +ellps=WGS84 "
        f"+lat_0={site[0]} +lon_0={site[1]} +h_0={site[2]}"
    )
    east, north, up = pipeline.transform(places[1], places[0], places[2])
    return np.array([np.sqrt(east**2 + north**2 + up**2), np.arctan2(east, north)])


def plane_positions(places: FloatArray, found: Sensors[Radar], seen: FloatArray) -> FloatArray:
    """Return what the radars make of an aircraft each in their plane, (K, N, 2)."""
    rows = []
    for k, (rho, azimuth) in enumerate(seen):
        plots = Plots(
            np.zeros(len(rho)),
            rho,
            azimuth + found.norths[k],
            sensor=np.full(len(rho), k),
            height=places[2],
        )
        rows.append(plots.to_cartesian(found.items)[0])
    return np.array(rows)


@cache
def positions(*, flat: bool) -> FloatArray:
    """Return what three radars make of each aircraft, (3, N, 2)."""
    own = sites()
    places = aircraft(own.mean(axis=0), WITHIN, 0)
    seen = np.array([view(site, places) for site in own])
    return plane_positions(places, sensors(own, flat=flat), seen)


def views() -> str:
    """Return how far apart the views of three radars are."""
    rows = []
    for name, flat in FORMS.items():
        found = positions(flat=flat)
        pairs = [np.linalg.norm(found[i] - found[j], axis=-1) for i, j in ((0, 1), (0, 2), (1, 2))]
        every = np.max(pairs, axis=0)
        cells = [np.median(pair) for pair in pairs] + [np.median(every), np.quantile(every, 0.95)]
        rows.append([name, *map(metres, cells)])
    head = ["plane", "first, second", "first, third", "second, third", "largest, median"]
    return markdown([*head, "largest, 95 % quantile"], rows)


def export() -> str:
    """Return how far latitudes and longitudes are off that become of plots."""
    rows = []
    site = sites()[:1]
    for distance in (100e3, 200e3, 400e3):
        longitude, latitude, _ = EARTH.fwd(
            np.full(360, site[0, 1]),
            np.full(360, site[0, 0]),
            np.arange(360.0),
            np.full(360, distance),
        )
        places = np.array([latitude, longitude, np.full(360, 10e3)])
        seen = view(site[0], places)[np.newaxis]
        cells = []
        for flat in FORMS.values():
            found = sensors(site, flat=flat)
            columns = found.geodetic(plane_positions(places, found, seen)[0], places[2])
            _, _, off = EARTH.inv(
                longitude, latitude, columns["longitude_deg"], columns["latitude_deg"]
            )
            cells.append(metres(np.max(off)))
        rows.append([f"{distance / 1e3:.0f} km", *cells])
    return markdown(["distance", *FORMS], rows)


@dataclass(frozen=True)
class Scene:
    """What a tracker and a registration make of one scene."""

    rmse: float
    claimed: float
    nees: float
    inside: float
    # biases of the ranges in metres, and all biases over their standard deviations
    bias: FloatArray
    deviations: FloatArray


@cache
def scenes(name: str) -> list[Scene]:
    """Return scenes of perfect radars: 30 straight flights, 10 minutes, no clutter."""
    return [scene(seed, name) for seed in range(SCENES)]


def scene(seed: int, name: str) -> Scene:
    """Simulate on the ellipsoid, and track in the plane that was chosen; or on a flat earth."""
    flat = name == "flat"
    numbers = {"range_sigma": 50.0, "azimuth_sigma": 0.08, "scan_period": 4.0, "degrees": True}
    places, plane = sites(), SystemPlane(*sites()[0, :2])
    earth = [plane.radar(*place, **numbers) for place in places]
    traffic = simulate.dense_traffic(
        30,
        area=(200e3, 200e3),
        turning_share=0.0,
        duration=600.0,
        rng=np.random.default_rng([SEED, seed]),
    )
    # the middle of the three radars
    middle = np.mean([radar.position[:2] for radar in earth], axis=0)
    traffic = replace(traffic, position=traffic.position + middle)
    if name == "flat, with aircraft and radars on a flat earth":
        earth = [replace(radar, frame=None) for radar in earth]
    record = simulate.radar_plots(traffic, earth, rng=np.random.default_rng([SEED, seed, 1]))
    plots, used = record.plots, earth
    if flat:
        found = sensors(places, flat=True)
        used = [
            replace(radar, position=own.position, frame=None)
            for radar, own in zip(earth, found.items, strict=True)
        ]
        azimuth = plots.azimuth + found.norths[plots.sensor]
        plots = replace(plots, azimuth=azimuth)
    table = track(plots, [replace(one, bias=Bias()) for one in used], motion="cv")
    table = table[(table.plot >= 0) & (table.time > SETTLED)]
    flight = record.target[table.plot]
    truth, _ = traffic.at(flight, table.time)
    if flat:
        latitude, longitude, _ = plane.to_geodetic(np.c_[truth, traffic.height[flight, 0]])
        truth = LocalFrame(*places[0]).to_local(latitude, longitude, 0.0)[:, :2]
    error, covariance = table.position - truth, table.covariance[:, :2, :2]
    known = np.isfinite(error).all(axis=1)
    square = nees(error[known], covariance[known])
    bias = register(plots, used).bias
    deviations = np.concatenate(
        [
            np.asarray(getattr(bias, kind)) / np.asarray(getattr(bias, f"{kind}_sigma"))
            for kind in ("range", "azimuth")
        ]
    )
    return Scene(
        np.sqrt(np.mean(np.sum(error[known] ** 2, axis=1))).item(),
        np.sqrt(np.mean(np.trace(covariance[known], axis1=1, axis2=2))).item(),
        np.mean(square).item() / 2,
        np.mean(square < WITHIN_95[2]).item(),
        np.asarray(bias.range),
        deviations,
    )


def tracking() -> str:
    """Return errors of tracks and the biases that are found where there are none."""
    rows = []
    for name in (*FORMS, "flat, with aircraft and radars on a flat earth"):
        found = scenes(name)
        rmse, claimed, square, inside = (
            np.mean([getattr(one, field) for one in found])
            for field in ("rmse", "claimed", "nees", "inside")
        )
        largest = np.max([np.max(np.abs(one.bias)) for one in found])
        deviation = np.max([np.max(np.abs(one.deviations)) for one in found])
        rows.append(
            [
                name,
                f"{rmse:.1f} m",
                f"{claimed:.1f} m",
                f"{square:.2f}",
                f"{inside:.1%}",
                f"{largest:.0f} m",
                f"{deviation:.1f}",
            ]
        )
    head = ["plane", "RMSE", "stated sigma", "NEES per axis", "within 95 %"]
    return markdown([*head, "largest estimated range bias", "largest bias in sigmas"], rows)


# accelerations of the straight model in m/s²: from that of "cv" to what fits flights without any
ACCELERATIONS = 0.1, 0.01, 0.001


def cruise() -> str:
    """Return whether covariances hold where radars are perfect, known to be so or not."""
    numbers = {"range_sigma": 50.0, "azimuth_sigma": 0.08, "scan_period": 4.0, "degrees": True}
    places, plane = sites(), SystemPlane(*sites()[0, :2])
    radars = [plane.radar(*place, **numbers) for place in places]
    middle = np.mean([radar.position[:2] for radar in radars], axis=0)
    found: dict[tuple[bool, float], list[tuple[float, FloatArray, FloatArray]]] = {}
    for seed in range(SCENES):
        # other scenes than those above
        random = np.random.default_rng([SEED, 7, seed])
        traffic = simulate.dense_traffic(
            30, area=(200e3, 200e3), turning_share=0.0, duration=600.0, rng=random
        )
        traffic = replace(traffic, position=traffic.position + middle)
        record = simulate.radar_plots(traffic, radars, rng=random)
        for trusted in (True, False):
            used = [replace(one, bias=Bias()) for one in radars] if trusted else radars
            for acceleration in ACCELERATIONS:
                tracker = Tracker(used, motion=CvModel(acceleration))
                table = tracker.update(record.plots)
                table = table[(table.plot >= 0) & (table.time > SETTLED)]
                truth, _ = traffic.at(record.target[table.plot], table.time)
                error = table.position - truth
                known = np.isfinite(error).all(axis=1)
                square = np.asarray(nees(error[known], table.covariance[known][:, :2, :2]))
                rmse = float(np.sqrt(np.mean(np.sum(error[known] ** 2, axis=1))))
                bias = _deviations(tracker.bias) if not trusted else np.zeros(0)
                found.setdefault((trusted, acceleration), []).append((rmse, square, bias))
    rows = []
    for (trusted, acceleration), each in found.items():
        squares = np.concatenate([square for _, square, _ in each])
        biases = np.array([np.abs(bias) for *_, bias in each])
        within = f"{np.sum(np.max(biases, axis=1) < 2.5)} of {SCENES}" if not trusted else "–"
        rows.append(
            [
                "no errors" if trusted else "estimated while tracking",
                f"{acceleration:g} m/s²",
                f"{np.mean([rmse for rmse, *_ in each]):.1f} m",
                f"{np.mean(squares) / 2:.2f}",
                f"{np.mean(squares < WITHIN_95[2]):.1%}",
                f"{np.max(biases):.1f}" if not trusted else "–",
                within,
            ]
        )
    head = ["errors of the radars", "model of motion", "RMSE", "NEES per axis", "within 95 %"]
    return markdown([*head, "largest bias in sigmas", "scenes with all below 2.5 sigma"], rows)


def _deviations(bias: Bias) -> FloatArray:
    """Return errors of radars over their standard deviations."""
    kinds = ("range", "range_gain", "azimuth", "time")
    each = [np.asarray(getattr(bias, kind) / getattr(bias, f"{kind}_sigma")) for kind in kinds]
    return np.concatenate(each)
