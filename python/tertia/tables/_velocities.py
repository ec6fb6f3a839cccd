"""Measured velocities in tables of positions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import polars as pl

from tertia._arrays import FloatArray
from tertia.geo import SystemPlane
from tertia.tables._parts import RecordError
from tertia.tables._records import Field, Schema, number

VELOCITY = ("velocity_east_m_s", "velocity_north_m_s")
_KNOT = 1852.0 / 3600.0
COURSE: Schema = {
    "speed": Field("number", {"speed_m_s": 1.0, "speed_kt": _KNOT}),
    "course": Field("number", {"course_deg": np.pi / 180}),
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
    """Return the matrices (rows, 2, 2) that turn velocities of true north into those of a plane."""
    scale, convergence = plane.scale_and_convergence(
        np.column_stack([position, np.zeros(len(position))])
    )
    sine, cosine = np.sin(convergence), np.cos(convergence)
    turn = np.array([[cosine, sine], [-sine, cosine]]) * scale
    return np.moveaxis(turn, -1, 0)


def _cells(frame: pl.DataFrame, names: Sequence[str]) -> FloatArray:
    """Return columns as floats; nan for those that a table does not have."""
    there = [frame[name] if name in frame.columns else None for name in names]
    missing = np.full(frame.height, np.nan)
    columns = [missing if one is None else one.cast(pl.Float64).to_numpy() for one in there]
    return np.column_stack(columns)
