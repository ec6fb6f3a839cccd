"""Conversion of series of plots to arguments of the core."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from tertia._arrays import FloatArray, finite, real, samples
from tertia.kalman._model import SingerModel, _require_model


def _batch(
    z: npt.ArrayLike,
    measurement_variance: npt.ArrayLike,
    model: SingerModel,
    initial: tuple[npt.ArrayLike, npt.ArrayLike] | None,
    *,
    time: npt.ArrayLike | None,
    period: float | None,
) -> tuple[dict[str, Any], FloatArray]:
    """Return the arguments in the form that the core requires, and the variances."""
    plots = samples(z, "z")
    if plots.ndim == 0:
        raise ValueError("z is a single number; it must be of shape (..., steps)")
    _require_model(model)
    variance = np.atleast_1d(samples(measurement_variance, "measurement_variance"))
    batch = plots.shape[:-1]
    steps = plots.shape[-1]
    variance = _rows(variance, (1, steps), batch, "measurement_variance")
    return {
        "z": plots,
        "variance": variance,
        "dt": _intervals(time, model, steps, batch),
        "initial": None if initial is None else _initial(initial, batch),
        "model": model,
        "period": None if period is None else real(period, "period"),
    }, variance


def _rows(
    array: FloatArray, lengths: tuple[int, ...], batch: tuple[int, ...], name: str
) -> FloatArray:
    """Return one row for all series, or one for each series."""
    if array.shape[-1] in lengths:
        if array.size == array.shape[-1]:
            return array.reshape(-1)
        try:
            return np.broadcast_to(array, (*batch, array.shape[-1]))
        except ValueError:
            pass
    shapes = " or ".join(f"(..., {length})" for length in dict.fromkeys(lengths))
    raise ValueError(f"{name} has shape {array.shape}; for series {batch} it must be {shapes}")


def _intervals(
    time: npt.ArrayLike | None, model: SingerModel, steps: int, batch: tuple[int, ...]
) -> FloatArray:
    if time is None:
        return np.array([model.dt])
    instants = finite(time, "time")
    if instants.ndim == 0:
        raise ValueError("time is a single number; it must be of shape (..., steps)")
    intervals = np.diff(_rows(instants, (steps,), batch, "time"), axis=-1)
    back = np.argwhere(intervals < 0)
    if len(back):
        place = ", ".join(map(str, (*back[0][:-1], back[0][-1] + 1)))
        raise ValueError(
            f"time[{place}] is before the time of the previous step; time must not decrease"
        )
    return intervals


def _initial(
    initial: tuple[npt.ArrayLike, npt.ArrayLike], batch: tuple[int, ...], size: int = 3
) -> FloatArray:
    """Return means and covariances of states: one row for all series, or one for each series."""
    try:
        mean, covariance = initial
    except (TypeError, ValueError):
        raise TypeError("initial must be a pair (mean, covariance)") from None
    x, p = finite(mean, "initial mean"), finite(covariance, "initial covariance")
    shapes = f"(..., {size}) and (..., {size}, {size})"
    if x.shape[-1:] != (size,) or p.shape[-2:] != (size, size):
        raise ValueError(f"initial has shapes {x.shape} and {p.shape}; they must be {shapes}")
    if x.ndim == 1 and p.ndim == 2:
        return np.concatenate([x, p.reshape(size**2)])
    flat = p.reshape(*p.shape[:-2], size**2)
    try:
        common = np.broadcast_shapes(x.shape[:-1], flat.shape[:-1])
    except ValueError:
        raise ValueError(
            f"initial has shapes {x.shape} and {p.shape}; their batches do not fit together"
        ) from None
    try:
        fits = np.broadcast_shapes(common, batch) == batch
    except ValueError:
        fits = False
    if not fits:
        raise ValueError(
            f"initial has shapes {x.shape} and {p.shape}; for series {batch} they must be {shapes}"
        )
    both = [np.broadcast_to(array, (*common, array.shape[-1])) for array in (x, flat)]
    return _rows(np.concatenate(both, axis=-1), (size + size**2,), batch, "initial")
