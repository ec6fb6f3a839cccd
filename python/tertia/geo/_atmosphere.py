"""Conversion of pressure altitudes to heights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy.typing as npt

from tertia import _core
from tertia._arrays import FloatArray, finite, positive_number, real, scalar_or_array
from tertia.geo._arrays import numbers


@dataclass(frozen=True, slots=True, init=False)
class Atmosphere:
    """Weather data for the conversion of pressure altitudes to heights.

    Transponders report pressure altitudes (mode C, flight levels), which are heights in the
    standard atmosphere (ISO 2533). Without weather data, pressure altitudes are used as heights
    above the ellipsoid; the error is up to 700 m at cruising level. Heights in ADS-B reports
    (I021/140) and in system tracks (I062/130) are geometric and need no conversion.

    Attributes
    ----------
    qnh : float
        Pressure reduced to sea level with the standard atmosphere, as airports report it, in Pa.
    isa_deviation : float
        Temperature of the air minus that of the standard atmosphere, in K.
    undulation : float
        Height of the geoid (mean sea level) above the ellipsoid in metres; about 45 in Central
        Europe.

    Raises
    ------
    ValueError, TypeError
        If the pressure is not positive, or a number is not finite.

    Examples
    --------
    Flight level 350, in air that is 15 K warmer than the standard atmosphere:

    >>> from tertia.geo import Atmosphere
    >>> round(Atmosphere(isa_deviation=15.0).to_height(35_000 * 0.3048))
    11323
    """

    qnh: float
    isa_deviation: float
    undulation: float

    def __init__(
        self, qnh: float = 101_325.0, isa_deviation: float = 0.0, undulation: float = 0.0
    ) -> None:
        object.__setattr__(self, "qnh", positive_number(qnh, "qnh"))
        for name, value in (("isa_deviation", isa_deviation), ("undulation", undulation)):
            object.__setattr__(self, name, float(finite(real(value, name), name)))

    def to_height(self, altitude: npt.ArrayLike) -> float | FloatArray:
        """Return heights above the ellipsoid.

        Parameters
        ----------
        altitude : array_like of shape (...)
            Pressure altitudes in metres; nan where one is missing.

        Returns
        -------
        float or ndarray of shape (...)
            Heights in metres; nan where the altitude is missing.

        Raises
        ------
        ValueError
            If a number is infinite.

        Examples
        --------
        >>> from tertia.geo import Atmosphere
        >>> round(Atmosphere(99_325.0, -10.0).to_height(10_668.0), 3)
        10098.504
        """
        array = numbers(altitude, "altitude")
        weather = [self.qnh, self.isa_deviation, self.undulation]
        found: float | FloatArray = scalar_or_array(
            _core.pressure_heights(array.reshape(-1), weather).reshape(array.shape)
        )
        return found
