"""Positions of an emitter from one direction finder that drives by and is misaligned."""

from contextlib import suppress

import numpy as np

from studies.montecarlo import FloatArray, generator, in_region
from studies.pages import markdown, repetitions
from tertia.location import Location, locate
from tertia.sensors import Bias, Station

RUNS = repetitions(100)
SIGMA = np.radians(2.0)
COUNTS = (30, 100)
COLUMNS = {"no names": (None, None), "one name": ("car", None), "one name, stated": ("car", SIGMA)}


def scene(count: int, way: str, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return places of the finder, and the emitter."""
    u = np.linspace(-1.0, 1.0, count)
    if way == "around the emitter":
        places = 300.0 * np.column_stack([np.cos(2.5 * u), np.sin(2.5 * u)])
        return places, rng.uniform(-100.0, 100.0, 2)
    places = np.column_stack([400.0 * u, 20.0 * np.sin(3.0 * u)])
    return places, np.array([rng.uniform(-100.0, 100.0), 300.0])


def located(places: FloatArray, azimuth: FloatArray, name: str | None, bias: float) -> Location:
    """Locate the emitter, with a misalignment of a stated size if there is one."""
    stated = Bias(azimuth_sigma=bias) if bias else None
    stations = [Station(place, azimuth_sigma=SIGMA, name=name, bias=stated) for place in places]
    return locate(stations, azimuth=azimuth)


def moving_finder() -> str:
    """Tabulate errors and coverage, by what is said of the finder."""
    rows = []
    for number, way in enumerate(("along a line", "around the emitter")):
        for offset in (0.0, 2.0):
            for count in COUNTS:
                row = [way, f"{offset:g}°" if offset else "none", f"{count}"]
                for name, stated in COLUMNS.values():
                    row.append(_cell((number, way), offset, count, (name, stated)))
                rows.append(row)
    return markdown(["way", "misalignment, σ", "bearings", *COLUMNS], rows)


def _cell(
    way: tuple[int, str], offset: float, count: int, said: tuple[str | None, float | None]
) -> str:
    errors, covariances = [], []
    for run in range(RUNS):
        rng = generator(351, way[0], round(offset), count, run)
        places, emitter = scene(count, way[1], rng)
        away = emitter - places
        azimuth = np.arctan2(away[:, 0], away[:, 1]) + SIGMA * rng.standard_normal(count)
        azimuth += np.radians(offset) * rng.standard_normal()
        with suppress(ValueError):
            found = located(places, azimuth, said[0], said[1] or 0.0)
            errors.append(found.position - emitter)
            covariances.append(found.covariance)
    inside = in_region(np.array(errors), np.array(covariances))
    return f"{np.sqrt(np.mean(np.sum(np.square(errors), axis=1))):.1f}; {inside.mean():.0%}"
