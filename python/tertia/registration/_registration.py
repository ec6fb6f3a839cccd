"""Results of registration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from tertia._arrays import BoolArray, FloatArray
from tertia._result import Result
from tertia.sensors import Bias, ByKind, PositionSensor, Radar
from tertia.sensors._bias import KINDS
from tertia.tracker import Plots
from tertia.tracker._errors import BiasHistory, without_values


@dataclass(frozen=True, slots=True, eq=False)
class NoiseHistory:
    """Noise of radars over time, in T periods of equal length.

    Attributes
    ----------
    edges : ndarray of shape (T + 1,)
        Times in seconds at which the periods begin and end.
    factor : ByKind
        Ratio of the estimated to the stated noise, of shape (K, T), for range and for azimuth; nan
        if a period has too few straight tracks.
    sigma : ByKind
        Standard deviations of the factors, in the same arrangement.
    """

    edges: FloatArray
    factor: ByKind
    sigma: ByKind


@dataclass(frozen=True, slots=True, eq=False)
class Registration(Result):
    """Noise and systematic errors of K radars, estimated from their plots.

    Attributes
    ----------
    bias : Bias
        Biases of the range, of its gain, of the azimuth and of the time at the end of the
        recording, each of shape (K,), with their standard deviations. A bias that the plots do not
        determine keeps its value and sigma from before the registration; its sigma is larger if
        other biases of its kind exceed theirs.
    covariance : ndarray of shape (4 * K, 4 * K)
        Covariance of the biases of range, gain, azimuth and time at the end, radar by radar.
    deviation_covariance : ndarray of shape (8 * K, 8 * K) or None
        The same with the coefficients of the deviation after the time of each radar; None if `bias`
        has no deviations.
    changes : tuple of (float, int)
        Times in seconds at which biases changed suddenly, and the indices of the sensors.
    prior : Bias
        Biases and standard deviations as known before the registration.
    noise_factor : ByKind
        Ratio of the estimated to the stated noise, of shape (K,), for range and for azimuth; nan if
        there are too few straight tracks.
    noise_factor_sigma : ByKind
        Standard deviations of the factors, in the same arrangement.
    noise_history : NoiseHistory
        Noise over time.
    bias_history : BiasHistory
        Biases over time.
    sensors : tuple of K Radar or PositionSensor
        The sensors; the radars have the estimated noise, and the bias at the end of the recording.
        A deviation of the azimuth is part of the sigma of the azimuth bias.
    """

    _rows: ClassVar = "bias_range", 0
    _omitted: ClassVar = (
        "covariance",
        "deviation_covariance",
        "changes",
        "noise_history",
        "bias_history",
        "sensors",
    )

    bias: Bias
    covariance: FloatArray
    deviation_covariance: FloatArray | None
    changes: tuple[tuple[float, int], ...]
    prior: Bias
    noise_factor: ByKind
    noise_factor_sigma: ByKind
    noise_history: NoiseHistory
    bias_history: BiasHistory
    sensors: tuple[Radar | PositionSensor, ...]

    def _removed(self, plots: Plots) -> tuple[Plots, list[Radar | PositionSensor]]:
        """Return plots without biases, and sensors with the estimated noise and without biases."""
        return self.bias_history.correct(plots), without_values(self.sensors, self.bias)

    @property
    def observable(self) -> dict[str, BoolArray]:
        """Whether the sigma of each error is below half of its prior sigma, (K,) for each kind."""
        pairs = {
            kind: [np.asarray(getattr(one, f"{kind}_sigma")) for one in (self.bias, self.prior)]
            for kind in (*KINDS, "east", "north")
        }
        return {kind: np.asarray(after < before / 2) for kind, (after, before) in pairs.items()}

    def __repr__(self) -> str:
        """Return a text that states the biases and the noise factors of each radar."""
        bias, lines, seen = self.bias, [], self.observable
        units = {"range": (1.0, " m"), "azimuth": (180 / np.pi, "°"), "time": (1.0, " s")}
        for k, radar in enumerate(self.sensors):
            if not isinstance(radar, Radar):
                continue
            known = [
                _text(getattr(bias, kind), getattr(bias, f"{kind}_sigma"), k, scale, unit)
                for kind, (scale, unit) in units.items()
                if seen[kind][k]
            ]
            if bias.deviation_order > 0:
                rms = np.degrees(np.sqrt(0.5 * np.sum(np.square(bias.deviation[k]))))
                known.append(f"azimuth deviation {rms:.2g}° rms")
            factors = (self.noise_factor.range, self.noise_factor.azimuth)
            noise = " and ".join(f"{np.asarray(factor)[k]:.2f}" for factor in factors)
            shown = ", ".join(known) or "unknown"
            lines.append(f"{radar.name or k + 1}: bias {shown}; noise x {noise}")
        return f"Registration({'; '.join(lines)})"


def _text(value: object, sigma: object, k: int, scale: float, unit: str) -> str:
    """Return a bias with its standard deviation, as text."""
    number, error = (scale * float(np.asarray(x)[k]) for x in (value, sigma))
    return f"{number:.3g} ± {error:.2g}{unit}"
