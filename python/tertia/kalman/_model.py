"""The motion model, and the steady state of its filter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from tertia import _core
from tertia._arrays import FloatArray, flag, real
from tertia._result import Result

# the place of every element of a covariance in its upper triangle
_FULL = np.array([0, 1, 2, 1, 3, 4, 2, 4, 5])


@dataclass(frozen=True, slots=True)
class SingerModel:
    """Motion with an acceleration of constant variance and autocorrelation `exp(-alpha |t|)`.

    If `alpha` is 0, the acceleration is constant; if `acceleration_sigma` is 0, the rate is
    constant.

    Attributes
    ----------
    dt : float
        Time between plots; used if no times are given.
    alpha : float
        Manoeuvre frequency: the reciprocal of the time constant of the acceleration.
    acceleration_sigma : float
        Standard deviation of the acceleration.
    exact : bool
        Whether the discretisation is exact. If False, it is as printed in the source: with `1 -
        alpha T` instead of `exp(-alpha T)`, and with process noise in the acceleration only; `alpha
        T` must then be less than 1.

    Examples
    --------
    >>> from tertia.kalman import SingerModel
    >>> model = SingerModel(4.0, 0.05, 1.0)
    >>> model.transition()
    array([[1. , 4. , 8. ],
           [0. , 1. , 4. ],
           [0. , 0. , 0.8]])
    >>> model.process_noise()[2, 2].round(2)
    np.float64(0.36)
    """

    dt: float
    alpha: float
    acceleration_sigma: float
    exact: bool = False

    def __post_init__(self) -> None:
        """Check the parameters."""
        for name in ("dt", "alpha", "acceleration_sigma"):
            object.__setattr__(self, name, real(getattr(self, name), name))
        object.__setattr__(self, "exact", flag(self.exact, "exact"))
        _core.singer_transition(self, self.dt)

    def transition(self, dt: float | None = None) -> FloatArray:
        """Return the transition matrix F, (3, 3), over a time step, by default over `self.dt`."""
        (f01, f02, f12, f22), _ = self._over(dt)
        return np.array([[1.0, f01, f02], [0.0, 1.0, f12], [0.0, 0.0, f22]])

    def process_noise(self, dt: float | None = None) -> FloatArray:
        """Return the process noise Q, (3, 3), over a time step, which is by default `self.dt`."""
        return _full(np.array(self._over(dt)[1]))

    def _over(self, dt: float | None) -> tuple[list[float], list[float]]:
        return _core.singer_transition(self, self.dt if dt is None else real(dt, "dt"))


def steady_state(model: SingerModel, measurement_variance: float) -> tuple[FloatArray, FloatArray]:
    """Return the gain and the covariance of the filter in the steady state.

    Parameters
    ----------
    model : SingerModel
        Model of the motion of the target, which has a plot every `model.dt`.
    measurement_variance : float
        Variance of the noise of the plots.

    Returns
    -------
    gain : ndarray of shape (3,)
        Kalman gain.
    covariance : ndarray of shape (3, 3)
        Covariance of the state after a plot.

    Raises
    ------
    ValueError, TypeError
        If the variance is not positive, if it differs from the process noise by so much that no
        digits are left, if the model has no process noise and therefore no steady state, or if
        an argument has the wrong type.

    Notes
    -----
    The doubling algorithm (Anderson 1978) is used, in double-double arithmetic.

    Examples
    --------
    >>> from tertia.kalman import SingerModel, steady_state
    >>> steady_state(SingerModel(5.0, 0.05, 0.003), 0.01)[0].round(3)
    array([0.754, 0.102, 0.005])
    """
    variance = real(measurement_variance, "measurement_variance")
    if not 1e-100 <= variance <= 1e100:
        raise ValueError(f"measurement_variance is {variance}; it must be a positive number")
    _require_model(model)
    gain, upper = _core.steady_state(model, variance)
    return np.array(gain), _full(np.array(upper))


def _full(upper: FloatArray) -> FloatArray:
    covariance: FloatArray = upper[..., _FULL].reshape(*upper.shape[:-1], 3, 3)
    return covariance


class States(Result):
    """Angle, rate and acceleration over time; `upper` are the upper triangles of covariances."""

    __slots__ = ()

    _rows: ClassVar = "mean", 1
    _omitted: ClassVar = ("upper",)

    mean: FloatArray
    upper: FloatArray

    @property
    def covariance(self) -> FloatArray:
        """Covariances of `mean`, of shape (..., steps, 3, 3)."""
        return _full(self.upper)

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations of `mean`, of shape (..., steps, 3)."""
        sigma: FloatArray = np.sqrt(self.upper[..., [0, 3, 5]])
        return sigma


def _require_model(model: Any) -> None:
    if not isinstance(model, SingerModel):
        raise TypeError(f"model is {model!r}; it must be a SingerModel")
