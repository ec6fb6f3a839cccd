"""Systematic errors of the stations of a fix: what was given, and what was found."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from tertia._arrays import BoolArray, FloatArray, Systematic, instance
from tertia.sensors import Bias, Kind, Station
from tertia.sensors._kinds import KINDS, STATION_KINDS

_SIGMAS = tuple(f"{kind}_sigma" for kind in STATION_KINDS)


@dataclass(frozen=True, slots=True, eq=False)
class Given:
    """What was given of the biases of K stations, per kind that one station measures alone.

    Attributes
    ----------
    value, sigma : ndarray of shape (3, K)
        nan where the sigma is to be estimated.
    """

    value: FloatArray
    sigma: FloatArray
    # whether anything was
    known: bool

    def corrected(self, kind: Kind, value: FloatArray) -> FloatArray:
        """Return measurements less the biases; nan where nothing is known of the bias."""
        if kind not in STATION_KINDS or not self.known:
            return value
        at = STATION_KINDS.index(kind)
        if not np.any(self.value[at]) and not np.any(np.isinf(self.sigma[at])):
            return value
        return self.usable(kind, value - self.value[at])

    def usable(self, kind: Kind, value: FloatArray) -> FloatArray:
        """Return nan instead of what belongs to a station whose bias may be anything."""
        if kind not in STATION_KINDS or not self.known:
            return value
        return np.where(np.isinf(self.sigma[STATION_KINDS.index(kind)]), np.nan, value)

    def widened(self, kind: Kind, sigma: FloatArray) -> FloatArray:
        """Return standard deviations of random and systematic errors together."""
        if kind not in STATION_KINDS or not self.known:
            return sigma
        own = np.nan_to_num(self.sigma[STATION_KINDS.index(kind)], nan=0.0, posinf=0.0)
        if not np.any(own):
            return sigma
        if np.any(np.isnan(sigma) & (own > 0)):
            raise ValueError(f"bias has a {kind}_sigma; then {kind}_sigma is needed, too")
        total: FloatArray = np.hypot(sigma, own)
        return total

    def free(self, kinds: Sequence[Kind]) -> BoolArray:
        """Return which measurements may have errors that nobody stated, (kinds, K)."""
        if not self.known:
            return _all_free(tuple(kinds), self.sigma.shape[-1])
        free = np.zeros((len(KINDS), self.sigma.shape[-1]), dtype=bool)
        unknown = np.isnan(self.sigma)
        for kind in kinds:
            alone = kind in STATION_KINDS
            # what several stations measure is only trusted if all of them are
            own = unknown[STATION_KINDS.index(kind)] if alone else unknown.any()
            free[KINDS.index(kind)] = own
        return free

    def found(self, stated: Mapping[Kind, FloatArray], growth: Sequence[float]) -> Bias:
        """Return the biases with the sigmas that the contradictions demand, (K,)."""
        if not (self.known or any(each > 1.0 for each in growth)):
            return _nothing_found(self.sigma.shape[-1])
        demanded = np.zeros(self.sigma.shape)
        columns: dict[str, Any] = dict(zip(STATION_KINDS, self.value, strict=True))
        for at, kind in enumerate(STATION_KINDS):
            if kind in stated and growth[at] > 1.0:
                sigma = stated[kind]
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", RuntimeWarning)  # stations without a sigma
                    typical = np.nanmedian(sigma.reshape(-1, sigma.shape[-1]), axis=0)
                demanded[at] = np.nan_to_num(typical) * np.sqrt(growth[at] - 1.0)
        sigmas = np.where(np.isnan(self.sigma), demanded, self.sigma) if self.known else demanded
        columns |= zip(_SIGMAS, sigmas, strict=True)
        return Bias._of(columns)


def given_biases(bias: Bias | None, stations: Sequence[Station] | npt.ArrayLike, k: int) -> Given:
    """Return the biases of the call or, without one, those of the stations."""
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
    value, sigma = np.zeros((len(STATION_KINDS), k)), np.full((len(STATION_KINDS), k), np.nan)
    for j, one in enumerate(own):
        if one is None:
            continue
        if one.deviation_order > 0:
            raise ValueError(
                f"the bias of station {j} deviates with the azimuth; it must be constant"
            )
        for at, kind in enumerate(STATION_KINDS):
            value[at, j] = getattr(one, kind)
            known = getattr(one, f"{kind}_sigma")
            sigma[at, j] = np.nan if known is None else known
    return Given(value, sigma, known=True)


@lru_cache
def _nothing_given(k: int) -> Given:
    value, sigma = np.zeros((len(STATION_KINDS), k)), np.full((len(STATION_KINDS), k), np.nan)
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
    """Return what a sigma says of systematic errors; `tells`: something could contradict."""
    if not free.any():
        return "given"
    return "estimated" if tells else "not included"
