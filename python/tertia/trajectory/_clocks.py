"""Estimated clocks of receivers over time."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tertia._arrays import FloatArray, finite
from tertia.sensors import Bias

if TYPE_CHECKING:
    from tertia.trajectory._arrivals_result import Arrivals


class ClockBias(Bias):
    """Systematic errors of clocks, which change over time.

    The attributes `time` and `time_sigma` are the error of the clock and its sigma at the middle of
    the record.

    Attributes
    ----------
    node : ndarray of shape (M,)
        Times of the nodes in seconds on the time base; between nodes, the errors of the clocks are
        linear.
    reading : ndarray of shape (..., M)
        Reading of the clock minus the time on the time base at each node, in seconds, of shape (K,
        M) for K receivers.
    variance : ndarray of shape (..., M)
        Variance of `reading` in s².
    covariance : ndarray of shape (..., M - 1)
        Covariance of `reading` at successive nodes in s².
    """

    __slots__ = ("covariance", "node", "reading", "variance")

    node: FloatArray
    reading: FloatArray
    variance: FloatArray
    covariance: FloatArray

    def __init__(
        self, node: FloatArray, reading: FloatArray, variance: FloatArray, covariance: FloatArray
    ) -> None:
        for name, value in (
            ("node", node),
            ("reading", reading),
            ("variance", variance),
            ("covariance", covariance),
        ):
            object.__setattr__(self, name, value)
        value, sigma = self.at()
        super().__init__(time=value, time_sigma=sigma)

    def __reduce__(self) -> tuple[type[ClockBias], tuple[FloatArray, ...]]:
        """Pickle only the fields from which the other fields follow."""
        return ClockBias, (self.node, self.reading, self.variance, self.covariance)

    def __getitem__(self, sensor: int) -> ClockBias:
        """Return the clock of one of the receivers."""
        len(self)
        return ClockBias(
            self.node, self.reading[sensor], self.variance[sensor], self.covariance[sensor]
        )

    def save(self, path: str | Path) -> None:
        """Write the clocks to a JSON file."""
        saved = {name: getattr(self, name).tolist() for name in ClockBias.__slots__}
        Path(path).write_text(json.dumps(saved), encoding="utf-8")

    @classmethod
    def load(cls, path: str | Path) -> ClockBias:
        """Read clocks from a file that `save` has written."""
        saved = json.loads(Path(path).read_text(encoding="utf-8"))
        return cls(**{name: np.array(values, dtype=np.float64) for name, values in saved.items()})

    def at(
        self, azimuth: npt.ArrayLike | None = None, time: npt.ArrayLike | None = None
    ) -> tuple[Any, Any]:
        """Return the errors of the clocks at given times on the time base, and their sigmas.

        Parameters
        ----------
        azimuth : array_like, optional
            Ignored, because errors of clocks do not depend on the azimuth.
        time : array_like, optional
            Times in seconds; by default the middle of the record. Before the first node and after
            the last node, the error is extrapolated linearly, and its sigma is inf.

        Returns
        -------
        value, sigma : float or ndarray
            The errors and their sigmas in seconds. The axis of the receivers comes first, followed
            by the axes of `time`.
        """
        del azimuth
        middle = 0.5 * (self.node[0] + self.node[-1])
        instants = finite(middle if time is None else time, "time")
        at, share = self._place(instants)
        value, variance = self.reading[..., at], self.variance[..., at]
        if self.node.size > 1:
            value = value * (1 - share) + self.reading[..., at + 1] * share
            variance = (
                variance * (1 - share) ** 2
                + self.variance[..., at + 1] * share**2
                + 2 * self.covariance[..., at] * share * (1 - share)
            )
        # the nodes themselves are rounded
        outside = (share < -1e-9) | (share > 1 + 1e-9)
        sigma = np.where(outside & (variance > 0), np.inf, np.sqrt(np.maximum(variance, 0.0)))
        return value[()], sigma[()]

    def correct(self, arrivals: Arrivals) -> FloatArray:
        """Convert times of arrival to the time base.

        Parameters
        ----------
        arrivals : Arrivals
            The arrivals; `sensor` is the index of the receiver among these clocks.

        Returns
        -------
        ndarray of shape (n,)
            Times of arrival in seconds on the time base.
        """
        corrected = np.array(arrivals.time)
        for sensor in np.unique(arrivals.sensor):
            if not 0 <= sensor < len(self):
                raise ValueError(f"sensor is {sensor}; there are clocks of {len(self)} receivers")
            own = arrivals.sensor == sensor
            clock = self.reading[sensor]
            if self.node.size == 1:
                corrected[own] -= clock[0]
                continue
            reading = self.node + clock
            at = np.clip(np.searchsorted(reading, corrected[own]) - 1, 0, self.node.size - 2)
            share = (corrected[own] - reading[at]) / (reading[at + 1] - reading[at])
            corrected[own] -= clock[at] * (1 - share) + clock[at + 1] * share
        return corrected

    def _place(self, time: FloatArray) -> tuple[npt.NDArray[np.intp], FloatArray]:
        """Return the node before each time, and the fraction of the interval that has passed."""
        if self.node.size == 1:
            return np.zeros(time.shape, dtype=np.intp), np.zeros(time.shape)
        at = np.clip(np.searchsorted(self.node, time) - 1, 0, self.node.size - 2)
        return at, (time - self.node[at]) / (self.node[at + 1] - self.node[at])
