"""Estimation of the noise and of the motion model from recordings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import BoolArray, FloatArray, real, threads
from tertia._result import Result
from tertia.kalman._batch import _batch
from tertia.kalman._model import SingerModel

Limit: TypeAlias = Literal[
    "white acceleration", "constant acceleration", "constant rate", "no noise"
]


@dataclass(frozen=True, slots=True, eq=False)
class NoiseFit(Result):
    """Maximum-likelihood estimates of the noise of the plots and of the parameters of the motion.

    The likelihood may have its maximum where a parameter is 0 or infinite; `limits` then names the
    case:

    - "white acceleration": alpha is infinite. The recording determines only `density`, a
      combination of alpha and `acceleration_sigma`.
    - "constant acceleration": alpha is 0. Each series has a single acceleration, so
      `acceleration_sigma` cannot be applied to other series.
    - "constant rate": there is no acceleration. `density` and `acceleration_sigma` are 0.
    - "no noise": the noise is negligible compared with the motion.

    If alpha is infinite, it is replaced by 1e6 divided by the usual interval between plots. If the
    noise is 0, it is replaced by a tiny number. `model` and the filter can therefore be used in
    these cases, too.

    Attributes
    ----------
    alpha, acceleration_sigma, measurement_sigma : float
        Estimates of the parameters of `SingerModel` and of the standard deviation of the plots.
    sigma : ndarray of shape (3,)
        Standard uncertainties of these three estimates, to first order: each estimate times the
        uncertainty of its logarithm. It is inf for a parameter that the recording does not
        determine.
    log_likelihood : float
        Log-likelihood at the maximum.
    count : int
        Number of plots with an innovation.
    density_sigma : float
        Standard uncertainty of `density`, to first order.
    limits : tuple of str
        Names of the cases above; empty if no parameter is 0 or infinite.
    outlier : ndarray of bool, of the shape of the plots
        Plots that were left out of the fit.
    """

    _rows: ClassVar = "alpha", 0
    _omitted: ClassVar = ("outlier",)

    alpha: float
    acceleration_sigma: float
    measurement_sigma: float
    sigma: FloatArray
    log_likelihood: float
    count: int
    density_sigma: float
    limits: tuple[Limit, ...]
    outlier: BoolArray

    @property
    def density(self) -> float:
        """Spectral density of acceleration at frequency 0, `2 acceleration_sigma**2 / alpha`."""
        if self.acceleration_sigma == 0:
            return 0.0
        return 2 * self.acceleration_sigma**2 / self.alpha if self.alpha > 0 else float("inf")

    def model(self, dt: float) -> SingerModel:
        """Return the fitted motion model, for plots `dt` apart."""
        return SingerModel(dt, self.alpha, self.acceleration_sigma, exact=True)

    def __repr__(self) -> str:
        """Return the estimates with their uncertainties; at a limit, only those determined."""
        names = ["alpha", "acceleration_sigma", "measurement_sigma"]
        sigmas = dict(zip(names, self.sigma, strict=True))
        if "white acceleration" in self.limits:
            sigmas = {"density": self.density_sigma} | sigmas
        if self.limits:
            sigmas = {name: sigma for name, sigma in sigmas.items() if np.isfinite(sigma)}
        estimates = ", ".join(
            f"{name} {value:.3g} ± {sigma / value:.0%}"
            for name, sigma in sigmas.items()
            if (value := getattr(self, name))
        )
        limits = ", ".join(self.limits)
        return f"NoiseFit({': '.join(filter(None, (limits, estimates)))})"


def fit_noise(
    z: npt.ArrayLike,
    *,
    dt: float | None = None,
    time: npt.ArrayLike | None = None,
    period: float | None = None,
    outlier_gate: float | None = None,
    n_threads: int | None = None,
) -> NoiseFit:
    """Estimate the noise of the plots and the motion model from a recording.

    Parameters
    ----------
    z : array_like of shape (..., steps)
        At least 10 measured angles; nan where there is none. All series share the same parameters.
    dt : float, optional
        Time between plots.
    time : array_like of shape (steps,) or (..., steps), optional
        Times of the steps, instead of `dt`.
    period : float, optional
        Period of the angles: 360.0 for degrees, 2*pi for radians, None for data that do not wrap.
    outlier_gate : float, optional
        Plots that deviate by more than this many standard deviations from the track through all
        other plots are left out, and the model is fitted again, up to ten times. By default all
        plots are used.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    NoiseFit
        Parameters of an exact `SingerModel` and the standard deviation of the plots, with their
        uncertainties.

    Raises
    ------
    ValueError, TypeError
        If there are too few plots, a line or parabola fits the plots exactly, shapes do not fit,
        times decrease, neither or both of `dt` and `time` are given, or an argument has the wrong
        type.

    Notes
    -----
    The method is maximum likelihood. The scale of the noise has a closed form. Alpha and the ratio
    of acceleration to noise are found on a grid and then by Newton's method, which takes about 150
    runs of the filter in total. The uncertainties follow from the curvature of the log-likelihood
    at its maximum. Recordings often contain little information about alpha, and its uncertainty is
    then large. If the maximum is at a limit, the uncertainty is inf and `limits` names the limit.

    A batch gives one fit, because its series share the parameters. For separate fits, call the
    function once for each series.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.kalman import fit_noise
    >>> rng = np.random.default_rng(1)
    >>> angle = 30 + 0.2 * np.arange(200) + 2 * np.sin(np.arange(200) / 30)
    >>> fit = fit_noise(angle + 0.1 * rng.standard_normal(200), dt=5.0)
    >>> round(fit.measurement_sigma, 2)
    0.09
    """
    if (dt is None) == (time is None):
        raise ValueError("give either dt or time")
    unit = SingerModel(1.0 if dt is None else dt, 0.0, 0.0, exact=True)
    batch, _ = _batch(z, 1.0, unit, None, time=time, period=period)
    fitted, outlier = _core.fit_noise(
        batch["z"],
        batch["dt"],
        batch["period"],
        None if outlier_gate is None else real(outlier_gate, "outlier_gate"),
        threads(n_threads),
    )
    (alpha, acceleration, noise), sigma, density_sigma, log_likelihood, count, limits = fitted
    return NoiseFit(
        alpha,
        acceleration,
        noise,
        np.array(sigma),
        log_likelihood,
        count,
        density_sigma,
        tuple(limits),
        outlier,
    )
