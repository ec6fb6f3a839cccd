"""Results of registration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tertia._arrays import FloatArray
from tertia.sensors import Bias, ByKind, Radar


@dataclass(frozen=True, slots=True, eq=False)
class NoiseHistory:
    """Noise of radars over time, in T periods of equal length.

    Attributes
    ----------
    edges : ndarray of shape (T + 1,)
        Times in seconds at which the periods begin and end.
    factor : ByKind
        Ratio of estimated to stated noise, of shape (K, T), for range and azimuth; nan if a period
        has too few straight tracks.
    sigma : ByKind
        Standard deviations of the factors, likewise.
    """

    edges: FloatArray
    factor: ByKind
    sigma: ByKind


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """Noise and biases of K radars, estimated from their plots.

    Attributes
    ----------
    bias : Bias
        Biases of range and azimuth, of shape (K,), with their standard deviations. A bias that the
        plots do not determine is 0 with a standard deviation of inf.
    noise_factor : ByKind
        Ratio of estimated to stated noise, of shape (K,), for range and azimuth; nan if there are
        too few straight tracks.
    noise_factor_sigma : ByKind
        Standard deviations of the factors, likewise.
    history : NoiseHistory
        Noise over time.
    sensors : tuple of K Radar
        The radars with the estimated noise.
    """

    bias: Bias
    noise_factor: ByKind
    noise_factor_sigma: ByKind
    history: NoiseHistory
    sensors: tuple[Radar, ...]

    def __repr__(self) -> str:
        """Return the biases and factors of each radar."""
        bias, lines = self.bias, []
        for k, radar in enumerate(self.sensors):
            range_ = _text(bias.range, bias.range_sigma, k, 1.0, " m")
            azimuth = _text(bias.azimuth, bias.azimuth_sigma, k, 180 / np.pi, "°")
            factors = (self.noise_factor.range, self.noise_factor.azimuth)
            noise = " and ".join(f"{np.asarray(factor)[k]:.2f}" for factor in factors)
            lines.append(f"{radar.name or k + 1}: bias {range_}, {azimuth}; noise x {noise}")
        return f"Registration({'; '.join(lines)})"


def _text(value: object, sigma: object, k: int, scale: float, unit: str) -> str:
    """Return a bias with its standard deviation."""
    number, error = (scale * float(np.asarray(x)[k]) for x in (value, sigma))
    return f"{number:.3g} ± {error:.2g}{unit}" if np.isfinite(error) else "unknown"
