"""Constant systematic errors of the radars of a series, estimated while plots are fused."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import BoolArray, FloatArray, require_between, samples

# with the noise as stated, then as found
_ROUNDS = 2


@dataclass(frozen=True, slots=True)
class Registered:
    """Output of the core: plots without the radars' constant errors, and these errors (..., K).

    `added` (..., steps, 6) is what the uncertainty of these errors adds to the covariances of the
    track. It is None if every radar is free of systematic errors.
    """

    fused: tuple[list[FloatArray], list[BoolArray]]
    value: FloatArray
    sigma: FloatArray
    added: FloatArray | None = None


def trusted(fused: tuple[list[FloatArray], list[BoolArray]], shape: tuple[int, ...]) -> Registered:
    """Return a series whose radars have no systematic errors."""
    return Registered(fused, np.zeros(shape), np.zeros(shape))


def deviations(bias_sigma: npt.ArrayLike, sensors: int) -> FloatArray:
    """Return the standard deviations of systematic errors: one for all radars, or one for each."""
    bias = samples(bias_sigma, "bias_sigma")
    require_between(bias, "bias_sigma", "a number that is not negative, or inf", 0.0, np.inf)
    if bias.shape not in {(), (sensors,)}:
        raise ValueError(f"bias_sigma has shape {bias.shape}; it must be () or ({sensors},)")
    return bias


def prior_of(bias_sigma: npt.ArrayLike, radars: int) -> FloatArray | None:
    """Return the prior standard deviation of each radar's systematic error; None if all are 0."""
    given = deviations(bias_sigma, radars)
    if not np.count_nonzero(given):
        return None
    prior = np.full(radars, given)
    if np.all(prior == np.inf):
        raise ValueError(
            "bias_sigma is infinite for every radar; it must be finite for at least one"
        )
    return prior


def registered(
    arguments: dict[str, Any],
    first: FloatArray,
    prior: FloatArray,
    growth: FloatArray,
    n_threads: int | None,
) -> Registered:
    """Fuse the plots after removing systematic errors that are estimated from inconsistencies.

    `first` (..., steps) is the angle that is fused as if there were no such errors. `growth` (...,
    K) contains the factors by which time-correlated noise increases the variances.
    """
    z, period = arguments["z"], arguments["period"]
    plots = z if period is None else _unwrapped(z, first, period)
    stated = np.broadcast_to(arguments["variance"], z.shape)
    variance = stated
    for _ in range(_ROUNDS):
        value, sigma, added = _core.series_biases(
            (plots, variance * growth[..., np.newaxis], arguments["dt"]),
            prior,
            arguments["model"],
            n_threads,
        )
        corrected = plots - value[..., np.newaxis]
        if period is not None:
            corrected %= period
        fused = _core.fuse_series(arguments | {"z": corrected}, n_threads)
        noise, outlier = fused[0][3], fused[1][0]
        variance = np.where(outlier, np.inf, np.where(np.isnan(noise), stated, noise))
    return Registered(fused, value, sigma, added)


def _unwrapped(z: FloatArray, angle: FloatArray, period: float) -> FloatArray:
    """Return plots (..., K, steps) unwrapped to near the unwrapped fused angle (..., steps)."""
    steps = np.arange(angle.shape[-1])
    latest = np.maximum.accumulate(np.where(np.isnan(angle), -1, steps), axis=-1)
    filled = np.take_along_axis(angle, np.maximum(latest, 0), axis=-1)
    near = np.unwrap(np.nan_to_num(filled), period=period)[..., np.newaxis, :]
    return near + (z - near + 0.5 * period) % period - 0.5 * period
