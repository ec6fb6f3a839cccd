"""True positions of targets."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from tertia._arrays import BoolArray, FloatArray, IntArray, array_of, finite, samples
from tertia.sensors._identities import (
    KINDS,
    NO_CALLSIGN,
    NO_IDENTITY,
    TextArray,
    checked,
)


@dataclass(slots=True, frozen=True, eq=False, init=False)
class Truth:
    """True positions of targets over time, for comparison with tracks.

    Positions are interpolated linearly between the given times. A target is absent before its first
    and after its last given time.

    Parameters
    ----------
    time : array_like of shape (L,)
        Times in seconds, in any order.
    target : array_like of shape (L,)
        Identifiers of the targets: integers or strings.
    position : array_like of shape (L, m)
        Positions in metres, in m = 2 or 3 dimensions.
    covariance : array_like of shape (m, m) or (L, m, m), optional
        Covariances of the errors of the true positions, if these positions are not exact, for
        example because they are from GPS.
    height : array_like of shape (L,), optional
        True heights in metres, as tracks should report them; nan where a height is unknown.
    icao_address, mode_3a : array_like of int, shape (L,), optional
        True addresses and codes of the transponders, as tracks should report them; -1 where one is
        unknown.
    callsign : array_like of str, shape (L,), optional
        True aircraft identifications; empty where one is unknown.
    identity : array_like of int, shape (L,), optional
        Any other numbers of the targets; -1 where one is unknown. If it is the only kind, it is
        compared with the first kind of numbers that tracks have.

    Attributes
    ----------
    time : ndarray of shape (L,)
    position : ndarray of shape (L, m)
        True positions in metres. All columns are sorted by target and time.
    covariance : ndarray of shape (L, m, m) or None
        Covariances of the positions.
    height : ndarray of shape (L,) or None
        Heights in metres.
    icao_address, mode_3a, callsign, identity : ndarray of shape (L,) or None
        Identities of these kinds.
    target : ndarray of int, shape (L,)
        Index into `targets`.
    targets : ndarray of shape (K,)
        The identifiers of the targets, in increasing order.
    first, last : ndarray of shape (K,)
        First and last time of each target in seconds.

    Raises
    ------
    ValueError, TypeError
        If shapes do not fit, a number is not finite, a target has two positions at one time, there
        is no row, or an argument has the wrong type.

    Examples
    --------
    >>> from tertia.metrics import Truth
    >>> truth = Truth([0, 8, 0], ["KLM", "KLM", "BAW"], [[0, 0], [800, 0], [90, 0]])
    >>> truth
    Truth(2 targets, 3 positions)
    >>> truth.at([1, 0, 0], [4, 0, 4])
    array([[400.,   0.],
           [ 90.,   0.],
           [ nan,  nan]])
    """

    time: FloatArray
    target: IntArray
    position: FloatArray
    covariance: FloatArray | None
    height: FloatArray | None
    icao_address: IntArray | None
    mode_3a: IntArray | None
    callsign: TextArray | None
    identity: IntArray | None
    targets: npt.NDArray[Any]
    first: FloatArray
    last: FloatArray
    # a time is its rank among all, so that a target and a time together are one integer
    _ranks: FloatArray = field(repr=False)
    _keys: IntArray = field(repr=False)

    def __init__(
        self,
        time: npt.ArrayLike,
        target: npt.ArrayLike,
        position: npt.ArrayLike,
        *,
        covariance: npt.ArrayLike | None = None,
        height: npt.ArrayLike | None = None,
        icao_address: npt.ArrayLike | None = None,
        mode_3a: npt.ArrayLike | None = None,
        callsign: npt.ArrayLike | None = None,
        identity: npt.ArrayLike | None = None,
    ) -> None:
        times, labels, points = rows(time, target, position, "", "target")
        if len(times) == 0:
            raise ValueError("time is empty; there must be a target")
        targets, index = np.unique(labels, return_inverse=True)
        order = np.lexsort((times, index))
        index, times = index[order], times[order]
        again = np.flatnonzero((np.diff(index) == 0) & (np.diff(times) == 0))
        if len(again):
            name = targets[index[again[0]]]
            raise ValueError(f"target {name} has two positions at {times[again[0]]}; it needs one")
        ranks = np.unique(times)
        starts = np.flatnonzero(np.diff(index, prepend=-1))
        values = {
            "time": times,
            "target": index.astype(np.int64),
            "position": points[order],
            "covariance": None if covariance is None else _spread(covariance, points.shape)[order],
            "height": None if height is None else _heights(height, len(order))[order],
            **_in_order(checked(icao_address, mode_3a, callsign, identity), order),
            "targets": targets,
            "first": times[starts],
            "last": times[np.append(starts[1:], len(index)) - 1],
            "_ranks": ranks,
            "_keys": index * (len(ranks) + 1) + np.searchsorted(ranks, times) + 1,
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        """Return the number of targets."""
        return len(self.targets)

    def __repr__(self) -> str:
        """Return a text that states the numbers of targets and positions."""
        return f"Truth({len(self)} targets, {len(self.time)} positions)"

    def __iter__(self) -> Iterator[tuple[Any, FloatArray, FloatArray]]:
        """Yield each target with its times and positions, in order of time."""
        starts = np.flatnonzero(np.diff(self.target)) + 1
        paths = np.split(self.time, starts), np.split(self.position, starts)
        yield from zip(self.targets.tolist(), *paths, strict=True)

    def present(self, target: npt.ArrayLike, time: npt.ArrayLike) -> BoolArray:
        """Return whether targets are present at given times; the arguments are those of `at`."""
        k, when = np.asarray(target), np.asarray(time)
        return np.asarray((k >= 0) & (when >= self.first[k]) & (when <= self.last[k]))

    def at(self, target: npt.ArrayLike, time: npt.ArrayLike) -> FloatArray:
        """Return positions at given times by linear interpolation.

        Parameters
        ----------
        target : array_like of int, shape (...)
            Indices into `targets`; -1 means no target.
        time : array_like of shape (...)
            Times in seconds.

        Returns
        -------
        ndarray of shape (..., m)
            Positions in metres; nan where a target is absent.
        """
        k, when, there = self._asked(target, time)
        found = np.full((*k.shape, self.position.shape[1]), np.nan)
        found[there] = self._between(self.position, k[there], when[there])
        return found

    def covariance_at(self, target: npt.ArrayLike, time: npt.ArrayLike) -> FloatArray:
        """Return covariances of the positions at given times; the arguments are those of `at`.

        Returns
        -------
        ndarray of shape (..., m, m)
            Covariances in square metres. They are interpolated linearly, because errors of the
            truth are correlated over time; they are zero if no covariance was given, and nan where
            a target is absent.
        """
        k, when, there = self._asked(target, time)
        m = self.position.shape[1]
        found = np.full((*k.shape, m * m), np.nan)
        found[there] = 0.0
        if self.covariance is not None:
            flat = self.covariance.reshape(-1, m * m)
            found[there] = self._between(flat, k[there], when[there])
        return found.reshape(*k.shape, m, m)

    def height_at(self, target: npt.ArrayLike, time: npt.ArrayLike) -> FloatArray:
        """Return heights at given times by linear interpolation; the arguments are those of `at`.

        Returns
        -------
        ndarray of shape (...)
            Heights in metres; nan where a target is absent or its height is unknown.
        """
        k, when, there = self._asked(target, time)
        found = np.full(k.shape, np.nan)
        if self.height is not None:
            own = self.height[:, np.newaxis]
            found[there] = self._between(own, k[there], when[there])[..., 0]
        return found

    def identity_at(
        self, target: npt.ArrayLike, time: npt.ArrayLike, kind: str = "identity"
    ) -> npt.NDArray[Any]:
        """Return the last known identities at given times.

        Parameters
        ----------
        target, time : array_like of shape (...)
            As for `at`.
        kind : {"identity", "icao_address", "mode_3a", "callsign"}
            Kind of identity.

        Returns
        -------
        ndarray of int or str, shape (...)
            Identities; -1, or an empty callsign, where a target is absent or its identity is
            unknown.

        Raises
        ------
        ValueError
            If there is no such kind.
        """
        if kind not in KINDS:
            raise ValueError(f"kind is {kind!r}; it must be one of {', '.join(KINDS)}")
        k, when, there = self._asked(target, time)
        own = getattr(self, kind)
        none = NO_CALLSIGN if kind == "callsign" else NO_IDENTITY
        found = np.full(k.shape, none, dtype=None if own is None else own.dtype)
        if own is not None:
            found[there] = own[self._before(k[there], when[there])]
        return found

    def course(self, target: npt.ArrayLike, time: npt.ArrayLike) -> FloatArray:
        """Return courses in radians, clockwise from north; the arguments are those of `at`.

        Courses are interpolated between central differences of the positions; they are nan for a
        target with only one position.
        """
        k, when = np.broadcast_arrays(np.asarray(target), np.asarray(time, dtype=np.float64))
        found = np.full(k.shape, np.nan)
        for one, (_, times, position) in enumerate(self):
            own = k == one
            if len(times) > 1 and np.any(own):
                velocity = np.gradient(position[:, :2], times, axis=0).T
                found[own] = np.arctan2(*(np.interp(when[own], times, v) for v in velocity))
        return found

    def _asked(
        self, target: npt.ArrayLike, time: npt.ArrayLike
    ) -> tuple[IntArray, FloatArray, BoolArray]:
        """Return targets and times, broadcast to each other, and which of them are present."""
        k, when = np.broadcast_arrays(np.asarray(target), np.asarray(time, dtype=np.float64))
        return k, when, self.present(k, when)

    def _between(self, rows: FloatArray, target: IntArray, time: FloatArray) -> FloatArray:
        before = self._before(target, time)
        after = np.where(self.time[before] < time, before + 1, before)
        span = np.where(after > before, self.time[after] - self.time[before], 1.0)
        share = ((time - self.time[before]) / span)[..., np.newaxis]
        return np.asarray(rows[before] + share * (rows[after] - rows[before]))

    def _before(self, target: IntArray, time: FloatArray) -> IntArray:
        rank = np.searchsorted(self._ranks, time, side="right")
        return np.searchsorted(self._keys, target * (len(self._ranks) + 1) + rank, "right") - 1


def _heights(height: npt.ArrayLike, count: int) -> FloatArray:
    found = samples(height, "height")
    if found.shape != (count,):
        raise ValueError(f"height has shape {found.shape}; it must be ({count},), as time")
    return found


def _in_order(
    columns: dict[str, npt.NDArray[Any] | None], order: IntArray
) -> dict[str, npt.NDArray[Any] | None]:
    """Return columns in the order of the rows."""
    for name, column in columns.items():
        if column is not None and column.shape != order.shape:
            raise ValueError(
                f"{name} has shape {column.shape}; it must be ({len(order)},), as time"
            )
    return {name: None if column is None else column[order] for name, column in columns.items()}


def _spread(covariance: npt.ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """Return a covariance for each position, after a check of all covariances."""
    given, (count, m) = finite(covariance, "covariance"), shape
    if given.shape not in {(m, m), (count, m, m)}:
        raise ValueError(
            f"covariance has shape {given.shape}; it must be ({m}, {m}) or ({count}, {m}, {m})"
        )
    if not np.allclose(given, np.swapaxes(given, -1, -2)):
        raise ValueError("covariance is not symmetric")
    least = np.linalg.eigvalsh(given)[..., 0]
    if np.any(least < -1e-10 * np.abs(np.trace(given, axis1=-2, axis2=-1))):
        raise ValueError("covariance is not positive: it has a negative eigenvalue")
    return np.broadcast_to(given, (count, m, m))


def rows(
    time: npt.ArrayLike,
    label: npt.ArrayLike,
    position: npt.ArrayLike,
    prefix: str,
    noun: str,
) -> tuple[FloatArray, npt.NDArray[Any], FloatArray]:
    """Return the columns of a table of positions."""
    times, points = finite(time, f"{prefix}time"), finite(position, f"{prefix}position")
    labels = array_of(label, f"{prefix}{noun}")
    if labels.dtype.kind == "O" and all(isinstance(one, str) for one in labels.flat):
        labels = labels.astype(str)
    if labels.dtype.kind not in "iuUT":
        raise TypeError(
            f"{prefix}{noun} has dtype {labels.dtype}; it must hold integers or strings"
        )
    if times.ndim != 1:
        raise ValueError(f"{prefix}time has shape {times.shape}; it must be (N,)")
    n = len(times)
    if labels.shape != (n,):
        raise ValueError(
            f"{prefix}{noun} has shape {labels.shape}; it must be ({n},), as {prefix}time"
        )
    if points.ndim != 2 or len(points) != n or points.shape[1] not in (2, 3):
        raise ValueError(
            f"{prefix}position has shape {points.shape}; it must be ({n}, 2) or ({n}, 3)"
        )
    return times, labels, points
