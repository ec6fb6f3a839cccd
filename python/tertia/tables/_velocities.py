"""Measured velocities in tables of positions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import polars as pl

from tertia._arrays import FloatArray, IntArray
from tertia.geo import SystemPlane
from tertia.tables._doubts import doubt
from tertia.tables._parts import RecordError
from tertia.tables._records import Field, Schema, number

ComplexArray: TypeAlias = npt.NDArray[np.complex128]
VELOCITY = ("velocity_east_m_s", "velocity_north_m_s")
_KNOT = 1852.0 / 3600.0
# how many times too large speeds are if they are in another unit than stated
_SPEEDS: Mapping[float, str] = {
    1.0: "",
    1 / _KNOT: "speeds were in knots",
    3.6: "speeds were in km/h",
    1 / 0.44704: "speeds were in miles per hour",
    1 / 0.3048: "speeds were in feet per second",
    _KNOT: "speeds were in m/s",
}
# from complex numbers east + i north to those under another convention
_COURSES: Mapping[str, Callable[[ComplexArray], ComplexArray]] = {
    "": lambda found: found,
    "courses were anticlockwise from east, or east and north were exchanged": lambda found: (
        1j * found.conj()
    ),
    "courses were anticlockwise from north": lambda found: -found.conj(),
    "courses were directions from which targets come": lambda found: -found,
}
# steps between positions that are compared, least number of these, and differences as a share of
# the speed that are too large, or agree
_STEPS, _FEW, _LARGE, _SMALL = (1, 4), 30, 0.3, 0.15
COURSE: Schema = {
    # 102.3 kt and 360° are 'not available' in AIS (ITU-R M.1371)
    "speed": Field(
        "number", {"speed_m_s": 1.0, "speed_kt": _KNOT}, unavailable={"speed_kt": 102.3}
    ),
    "course": Field("number", {"course_deg": np.pi / 180}, unavailable={"course_deg": 360.0}),
}


def fields(velocities: Sequence[str] | None) -> Schema:
    """Return the columns of velocities; by default those of a velocity or of speed and course."""
    if velocities is not None:
        return {name: number(name, required=True) for name in velocities}
    return {**{name: number(name) for name in VELOCITY}, **COURSE}


def velocities_of(
    frame: pl.DataFrame, velocities: Sequence[str] | None, plane: SystemPlane | None
) -> FloatArray:
    """Return the velocities of the rows, nan where missing, of shape (rows, axes).

    Velocities beside latitudes and longitudes are east and north of true north; they are rotated
    and scaled to `plane`. Then `frame` has the positions in the plane.
    """
    found = _cells(frame, velocities or VELOCITY)
    if velocities is None and np.isnan(found).all():
        found = of_speed(*_cells(frame, tuple(COURSE)).T)
    if np.isnan(found).all():
        names = " and ".join(velocities or VELOCITY)
        other = "" if velocities else ", or speed_m_s (speed_kt) and course_deg"
        raise RecordError(f"velocity_sigma is given, but there are no velocities: {names}{other}")
    if plane is None or velocities is not None:
        return found
    turn = to_plane(plane, frame.select("east_m", "north_m").to_numpy())
    return np.asarray(np.einsum("nij,nj->ni", turn, found))


def of_speed(speed: FloatArray, course: FloatArray) -> FloatArray:
    """Return velocities, (N, 2), from speeds and courses in radians."""
    return np.column_stack([speed * np.sin(course), speed * np.cos(course)])


def true_rates(
    mean: FloatArray, covariance: FloatArray, plane: SystemPlane
) -> tuple[FloatArray, FloatArray]:
    """Return states and their standard deviations, with rates east and north of true north.

    States in `plane` are positions, velocities and accelerations, of shape (rows, 6). The positions
    stay in the plane.
    """
    turn = np.zeros((len(mean), 6, 6))
    turn[:, :2, :2] = np.eye(2)
    turn[:, 2:4, 2:4] = turn[:, 4:, 4:] = np.linalg.inv(to_plane(plane, mean[:, :2]))
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    # unknown components are so in any direction
    known = np.where(np.isfinite(sigma), sigma, 0.0)
    correlated = np.where(np.isfinite(covariance), covariance, 0.0)
    variance = np.einsum("nij,njk,nik->ni", turn, correlated, turn)
    found = np.einsum("nij,nj->ni", turn, np.where(known > 0, mean, 0.0))
    return np.where(known > 0, found, np.nan), np.where(known > 0, np.sqrt(variance), sigma)


def to_plane(plane: SystemPlane, position: FloatArray) -> FloatArray:
    """Return the matrices (rows, 2, 2) that turn vectors of true north into those of a plane."""
    scale, convergence = plane.scale_and_convergence(
        np.column_stack([position, np.zeros(len(position))])
    )
    sine, cosine = np.sin(convergence), np.cos(convergence)
    turn = np.array([[cosine, sine], [-sine, cosine]]) * scale
    return np.moveaxis(turn, -1, 0)


def turned(turn: FloatArray, spread: FloatArray) -> FloatArray:
    """Return covariances (rows, 2, 2) in axes that are turned by the matrices `turn`."""
    found: FloatArray = turn @ spread @ turn.swapaxes(1, 2)
    return np.asarray(0.5 * (found + found.swapaxes(1, 2)))


def _cells(frame: pl.DataFrame, names: Sequence[str]) -> FloatArray:
    """Return columns as floats; nan for those that a table does not have."""
    there = [frame[name] if name in frame.columns else None for name in names]
    missing = np.full(frame.height, np.nan)
    columns = [missing if one is None else one.cast(pl.Float64).to_numpy() for one in there]
    return np.column_stack(columns)


def doubt_velocities(
    name: str, target: IntArray, time: FloatArray, place: FloatArray, velocity: FloatArray
) -> None:
    """Warn if velocities contradict the positions, and agree in another unit or convention."""
    for moved, stated in _movements(target, time, place, velocity):
        if _difference(moved, stated) < _LARGE:
            return
        found = {
            (unit, course): _difference(moved, turned(stated) / factor)
            for factor, unit in _SPEEDS.items()
            for course, turned in _COURSES.items()
        }
        best = min(found, key=lambda one: found[one])
        if found[best] < _SMALL:
            meant = " and ".join(part for part in best if part)
            doubt(f"velocities of {name} contradict the positions, and would agree if {meant}")
            return


def _movements(
    target: IntArray, time: FloatArray, place: FloatArray, velocity: FloatArray
) -> Iterator[tuple[ComplexArray, ComplexArray]]:
    """Yield velocities by positions and as stated, over shorter and longer times."""
    rows = np.flatnonzero(np.isfinite(np.column_stack([time, place, velocity])).all(axis=1))
    rows = rows[np.lexsort([time[rows], target[rows]])]
    position, stated = (one[rows] @ np.array([1.0, 1.0j]) for one in (place, velocity))
    for steps in _STEPS:
        duration = time[rows[steps:]] - time[rows[:-steps]]
        known = (target[rows[steps:]] == target[rows[:-steps]]) & (duration > 0.0)
        if np.sum(known) >= _FEW:
            moved = (position[steps:] - position[:-steps])[known] / duration[known]
            yield moved, 0.5 * (stated[steps:] + stated[:-steps])[known]


def _difference(moved: ComplexArray, stated: ComplexArray) -> float:
    """Return the median difference of velocities as a share of the median speed."""
    speed = float(np.median(np.abs(moved)))
    return float(np.median(np.abs(moved - stated))) / speed if speed > 0.0 else 0.0
