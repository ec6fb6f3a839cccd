"""Systematic errors of sensors as arrays, in the form that the core takes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tertia._arrays import BoolArray, FloatArray
from tertia.sensors import Bias, PositionSensor
from tertia.sensors._bias import KINDS, PLACED
from tertia.tracker._sensors import Sensor

# errors of a sensor that are the same in all directions, all errors, and the place of the azimuth
_KINDS, _ERRORS, _AZIMUTH = 4, 8, 2


def are_placed(sensors: Sequence[Sensor]) -> BoolArray:
    """Return which sensors report positions, (K,)."""
    return np.array([isinstance(one, PositionSensor) for one in sensors], dtype=bool)


def columns_of(bias: Bias, suffix: str = "") -> FloatArray:
    """Return the errors of K sensors, or their standard deviations, (K, 4).

    A sensor that reports positions has errors of east and north in the places of range and azimuth.
    """
    columns = np.stack([np.asarray(getattr(bias, kind + suffix)) for kind in KINDS], axis=-1)
    for j, kind in enumerate(PLACED[:3]):
        if kind is not None:
            columns[:, j] += getattr(bias, kind + suffix)
    return columns


def bias_of(value: FloatArray, sigma: FloatArray, placed: BoolArray, **deviation: Any) -> Bias:
    """Return the errors of K sensors from an array of shape (K, 4), as `columns_of` returns it."""
    columns: dict[str, Any] = deviation
    for suffix, array in (("", value), ("_sigma", sigma)):
        for j, (kind, other) in enumerate(zip(KINDS, PLACED, strict=True)):
            columns[kind + suffix] = array[:, j]
            if other not in {None, kind}:
                columns[kind + suffix] = np.where(placed, 0.0, array[:, j])
                columns[f"{other}{suffix}"] = np.where(placed, array[:, j], 0.0)
    return Bias(**columns)


def without_deviation(bias: Bias, sensors: Sequence[Sensor]) -> Bias:
    """Return biases that are the same in all directions; the sigmas contain the deviations."""
    unknown = with_deviation_sigma(bias)
    value = np.sqrt(0.5 * np.sum(values_of(bias)[:, _KINDS:] ** 2, axis=1))
    unknown[:, _AZIMUTH] = np.hypot(unknown[:, _AZIMUTH], value)
    return bias_of(columns_of(bias), unknown, are_placed(sensors))


def constants_of(covariance: FloatArray) -> FloatArray:
    """Return the covariance (4 K, 4 K) of the errors that are the same in all directions."""
    count = len(covariance) // _ERRORS
    parts = covariance.reshape(count, _ERRORS, count, _ERRORS)[:, :_KINDS, :, :_KINDS]
    return np.ascontiguousarray(parts).reshape(_KINDS * count, _KINDS * count)


def whole_covariance(found: Any) -> FloatArray:
    """Return the covariance of the estimated errors, with those of deviations if there are any."""
    whole: FloatArray | None = found.deviation_covariance
    constants: FloatArray = found.covariance
    return constants if whole is None else whole


def values_of(bias: Bias) -> FloatArray:
    """Return the errors of K sensors with the coefficients of their deviations, (K, 8)."""
    found = np.zeros((len(bias), _ERRORS))
    found[:, :_KINDS] = columns_of(bias)
    if bias.deviation_order > 0:
        found[:, _KINDS:] = bias.deviation
    return found


def with_deviation_sigma(bias: Bias) -> FloatArray:
    """Return the standard deviations (K, 4) of the errors, of the azimuth in any direction."""
    found = columns_of(bias, "_sigma")
    orders = np.arange(1, bias.deviation_order + 1)
    deviation = float(np.sqrt(np.sum((bias.deviation_sigma / orders) ** 2)))
    found[:, _AZIMUTH] = np.hypot(found[:, _AZIMUTH], deviation)
    return found


def bias_with_deviation(value: FloatArray, sigma: FloatArray, placed: BoolArray) -> Bias:
    """Return the errors of K sensors from an array (K, 8), as `values_of` returns it."""
    deviation: dict[str, Any] = {}
    if np.any(sigma[:, _KINDS:]):
        deviation = {
            "deviation_order": 2,
            "deviation": value[:, _KINDS:],
            "deviation_sigma": float(np.max(sigma[:, _KINDS:] * [1.0, 1.0, 2.0, 2.0])),
        }
    return bias_of(value[:, :_KINDS], sigma[:, :_KINDS], placed, **deviation)


def padded(columns: FloatArray) -> FloatArray:
    """Return errors (..., 4) as errors (..., 8) without deviations."""
    width = [(0, 0)] * (columns.ndim - 1) + [(0, _ERRORS - columns.shape[-1])]
    return np.pad(columns, width)
