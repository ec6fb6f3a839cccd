"""Sensors that report positions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tertia._arrays import instance, positive_number, probability, real
from tertia.sensors._bias import Bias

# in seconds; as that of radars
_FASTEST = 1e-3
# in metres; an extent beyond it is a mistake of the unit
_LARGEST = 100e3


@dataclass(frozen=True, slots=True, eq=False, init=False)
class PositionSensor:
    """A sensor that reports positions at any time: multilateration, ADS-B, a lidar or a tracker.

    Such a sensor has no scan. A report of each target is expected once every `update_interval`, but
    there may be more reports.

    Attributes
    ----------
    position_sigma : float or None
        Standard deviation of each of the coordinates east and north in metres, for reports without
        a covariance; None: such reports are not used.
    velocity_sigma : float or None
        Standard deviation of each of the components of velocities in m/s, for velocities without a
        covariance; None: such velocities are not used.
    update_interval : float
        Expected time between reports of a target in seconds, at least 0.001. If no report is
        received within this time, one report counts as missed.
    detection_probability : float
        Probability that a target reports in an update interval.
    target_extent : float
        Length in metres of the largest targets, if a target gives several positions at a time, such
        as a vehicle near a lidar: the positions of one target are combined. With 0 (default), a
        target gives one position at a time.
    bias : Bias or None
        Systematic errors of the reports: `time`, which is how late they are, `east` and `north`.
        Those with a sigma are estimated during registration. None: only `time` is estimated if
        there is another sensor; before that, its standard deviation is assumed to be 0.2 s.
        `Bias()`: there are no systematic errors.
    name : str or None
        Label of the sensor in pictures and reports.

    Raises
    ------
    ValueError, TypeError
        If a number is outside its domain, or an argument has the wrong type.

    Examples
    --------
    >>> from tertia.sensors import PositionSensor
    >>> PositionSensor(position_sigma=15.0, update_interval=1.0).detection_probability
    0.97
    """

    position_sigma: float | None
    velocity_sigma: float | None
    update_interval: float
    detection_probability: float
    target_extent: float
    bias: Bias | None
    name: str | None

    def __init__(
        self,
        *,
        position_sigma: float | None = None,
        velocity_sigma: float | None = None,
        bias: Bias | None = None,
        update_interval: float = 1.0,
        detection_probability: float = 0.97,
        target_extent: float = 0.0,
        name: str | None = None,
    ) -> None:
        if position_sigma is not None:
            position_sigma = float(positive_number(position_sigma, "position_sigma"))
        if velocity_sigma is not None:
            velocity_sigma = float(positive_number(velocity_sigma, "velocity_sigma"))
        interval = float(positive_number(update_interval, "update_interval"))
        if not _FASTEST <= interval < np.inf:
            raise ValueError(
                f"update_interval is {interval:g}; it must be at least {_FASTEST} s, and finite"
            )
        if bias is not None:
            instance(bias, "bias", Bias)
            if np.ndim(bias.time) > 0:
                raise ValueError(f"bias is that of {len(bias)} sensors; it must be that of one")
            for kind in ("range", "range_gain", "azimuth", "elevation"):
                if getattr(bias, kind) != 0.0:
                    raise ValueError(
                        f"bias.{kind} is {getattr(bias, kind):g}; a PositionSensor has no {kind}"
                    )
        detected = probability(detection_probability, "detection_probability")
        object.__setattr__(self, "position_sigma", position_sigma)
        object.__setattr__(self, "velocity_sigma", velocity_sigma)
        object.__setattr__(self, "update_interval", interval)
        object.__setattr__(self, "detection_probability", detected)
        object.__setattr__(self, "target_extent", extent(target_extent))
        object.__setattr__(self, "bias", bias)
        object.__setattr__(self, "name", name)


def extent(value: float) -> float:
    """Return the length of the largest targets in metres, after checking it."""
    length = real(value, "target_extent")
    if not 0.0 <= length <= _LARGEST:
        raise ValueError(f"target_extent is {length}; it must be 0 or positive, at most 100 km")
    return length
