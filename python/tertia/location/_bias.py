"""Given and estimated systematic errors of the stations that locate a target."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from tertia._arrays import BoolArray, FloatArray, Systematic, instance
from tertia.sensors import Bias, Kind, Station
from tertia.sensors._kinds import KINDS

# what one station measures alone, and the field of its error
ERRORS: dict[Kind, str] = {
    "range": "range",
    "azimuth": "azimuth",
    "elevation": "elevation",
    "arrival_time": "time",
}
_ROWS = {kind: at for at, kind in enumerate(ERRORS)}


@dataclass(frozen=True, slots=True, eq=False)
class Given:
    """Given biases of K stations, for each kind of measurement that one station can make alone.

    Attributes
    ----------
    value, sigma : ndarray of shape (4, K)
        Values of the biases and their sigmas; for clocks, both are in seconds. A sigma that is to
        be estimated is nan.
    """

    value: FloatArray
    sigma: FloatArray
    # whether anything was
    known: bool
    # biases of the stations whose azimuth error depends on the direction
    deviating: Mapping[int, Bias] = field(default_factory=dict)

    def corrected(
        self, kind: Kind, value: FloatArray, unit: FloatArray | float = 1.0
    ) -> FloatArray:
        """Return measurements minus the biases; nan if the bias of a station is unknown."""
        if kind not in ERRORS or not self.known:
            return value
        at = _ROWS[kind]
        plain = not self.deviating and not np.any(self.value[at])
        if plain and not np.any(np.isinf(self.sigma[at])):
            return value
        return self.usable(kind, self.subtracted(kind, value, unit))

    def subtracted(
        self, kind: Kind, value: FloatArray, unit: FloatArray | float = 1.0
    ) -> FloatArray:
        """Return measurements minus the stated biases."""
        if kind == "azimuth" and self.deviating:
            return value - self._by_direction(value)[0]
        return value - self.value[_ROWS[kind]] * unit if kind in ERRORS else value

    def usable(self, kind: Kind, value: FloatArray) -> FloatArray:
        """Return `value` with nan for stations whose bias is unknown."""
        if kind not in ERRORS or not self.known:
            return value
        return np.where(np.isinf(self.sigma[_ROWS[kind]]), np.nan, value)

    def widened(
        self,
        kind: Kind,
        sigma: FloatArray,
        unit: FloatArray | float = 1.0,
        measured: FloatArray | None = None,
    ) -> FloatArray:
        """Return standard deviations of random and systematic errors combined.

        Those of errors that depend on the direction are those of the `measured` azimuths.
        """
        if kind not in ERRORS or not self.known:
            return sigma
        systematic = self.sigma[_ROWS[kind]]
        if kind == "azimuth" and self.deviating:
            if measured is None:
                station = next(iter(self.deviating))
                raise ValueError(
                    f"the bias of station {station} deviates with the azimuth; it must be constant"
                )
            systematic = self._by_direction(measured)[1]
        own = np.nan_to_num(systematic, nan=0.0, posinf=0.0)
        if not np.any(own):
            return sigma
        if np.any(np.isnan(sigma) & (own > 0)):
            name = f"{ERRORS[kind]}_sigma"
            raise ValueError(f"bias has a {name}; then {kind}_sigma is needed, too")
        total: FloatArray = np.hypot(sigma, own * unit)
        return total

    def _by_direction(self, azimuth: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the biases of measured azimuths and their sigmas, (..., K)."""
        constant = self.value[_ROWS["azimuth"]], self.sigma[_ROWS["azimuth"]]
        value, sigma = (np.array(np.broadcast_to(one, azimuth.shape)) for one in constant)
        for k, bias in self.deviating.items():
            towards = bias._without(np.nan_to_num(azimuth[..., k]))
            value[..., k], sigma[..., k] = bias.at(towards)
        return value, sigma

    def free(self, kinds: Sequence[Kind]) -> BoolArray:
        """Return for which measurements (kinds, K) no systematic errors were stated."""
        if not self.known:
            return _all_free(tuple(kinds), self.sigma.shape[-1])
        free = np.zeros((len(KINDS), self.sigma.shape[-1]), dtype=bool)
        unknown = np.isnan(self.sigma)
        for kind in kinds:
            # what several stations measure is only trusted if all of them are
            own = unknown[_ROWS[kind]] if kind in ERRORS else unknown.any()
            free[KINDS.index(kind)] = own
        return free

    def found(self, stated: Mapping[Kind, FloatArray], growth: Sequence[float]) -> Bias:
        """Return biases (K,) with sigmas that are as large as the inconsistencies require."""
        if not (self.known or any(each > 1.0 for each in growth)):
            return _nothing_found(self.sigma.shape[-1])
        demanded = np.zeros(self.sigma.shape)
        columns: dict[str, Any] = dict(zip(ERRORS.values(), self.value, strict=True))
        for at, kind in enumerate(ERRORS):
            grown = growth[KINDS.index(kind)]
            if kind in stated and grown > 1.0:
                sigma = stated[kind]
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", RuntimeWarning)  # stations without a sigma
                    typical = np.nanmedian(sigma.reshape(-1, sigma.shape[-1]), axis=0)
                demanded[at] = np.nan_to_num(typical) * np.sqrt(grown - 1.0)
        sigmas = np.where(np.isnan(self.sigma), demanded, self.sigma) if self.known else demanded
        names = (f"{error}_sigma" for error in ERRORS.values())
        columns |= zip(names, sigmas, strict=True)
        return Bias._of(columns)


def given_biases(bias: Bias | None, stations: Sequence[Station] | npt.ArrayLike, k: int) -> Given:
    """Return the biases given in the call or, if there are none, those of the stations."""
    if bias is not None:
        instance(bias, "bias", Bias)
        if np.ndim(bias.range) > 0 and len(bias) != k:
            raise ValueError(f"bias is that of {len(bias)} sensors; there are {k} stations")
        own: list[Bias | None] = [bias if np.ndim(bias.range) == 0 else bias[j] for j in range(k)]
    elif isinstance(stations, Sequence):
        own = [s.bias if isinstance(s, Station) else None for s in stations]
    else:
        own = [None] * k
    if own.count(None) == len(own):
        return _nothing_given(k)
    value, sigma = np.zeros((len(ERRORS), k)), np.full((len(ERRORS), k), np.nan)
    for j, one in enumerate(own):
        if one is None:
            continue
        if one.range_gain or one.range_gain_sigma:
            raise ValueError(f"the bias of station {j} has a range_gain; that is for radars")
        for at, error in enumerate(ERRORS.values()):
            value[at, j] = getattr(one, error)
            known = getattr(one, f"{error}_sigma")
            sigma[at, j] = np.nan if known is None else known
    deviating = {j: one for j, one in enumerate(own) if one is not None and one.deviation_order > 0}
    return Given(value, sigma, known=True, deviating=deviating)


@lru_cache
def _nothing_given(k: int) -> Given:
    value, sigma = np.zeros((len(ERRORS), k)), np.full((len(ERRORS), k), np.nan)
    value.flags.writeable = sigma.flags.writeable = False
    return Given(value, sigma, known=False)


@lru_cache
def _all_free(kinds: tuple[Kind, ...], k: int) -> BoolArray:
    free = np.zeros((len(KINDS), k), dtype=bool)
    free[[KINDS.index(kind) for kind in kinds]] = True
    free.flags.writeable = False
    return free


@lru_cache
def _nothing_found(k: int) -> Bias:
    bias = Bias._of({"range": np.zeros(k)})
    for name in Bias.__slots__:
        if isinstance(column := getattr(bias, name), np.ndarray):
            column.flags.writeable = False
    return bias


def said(free: BoolArray, *, tells: bool) -> Systematic:
    """Return how a sigma treats systematic errors; `tells` means that they could be detected."""
    if not np.count_nonzero(free):
        return "given"
    return "estimated" if tells else "not included"
