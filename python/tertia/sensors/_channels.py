"""Channels of a rotating radar, and the channels by which a plot was detected."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from tertia._arrays import (
    IntArray,
    array_of,
    instance,
    not_negative,
    positive_number,
    probability,
    real,
)
from tertia.sensors._kinds import angle_sigma

ChannelName: TypeAlias = Literal["psr", "ssr", "mode-s"]
CHANNELS: tuple[str, ...] = get_args(ChannelName)
# what a plot may be detected by, in the order of the core
DETECTIONS = ("psr", "ssr", "psr+ssr", "mode-s", "psr+mode-s")
# of a plot of which that is not known
NO_DETECTION = -1
# a radar's beam is narrow: beyond this sigma its plots would lie along arcs
WIDEST_BEAM = 0.5


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Channel:
    """A channel of a radar: its echoes ("psr") or replies ("ssr", "mode-s").

    Parameters
    ----------
    degrees : bool
        Whether `azimuth_sigma` is given in degrees; radians are stored.

    Attributes
    ----------
    detection_probability : float
        Probability that the channel detects a target within range in a scan. For the reply
        channels, targets without a transponder count as not detected.
    range_sigma : float or None
        Standard deviation of the channel's ranges in metres; None: it is that of the radar.
    azimuth_sigma : float or None
        Standard deviation of the channel's azimuths in radians; None: it is that of the radar.
    clutter_per_scan : float or None
        Mean number of false plots per scan that are detected by this channel alone; None: it is
        estimated from the plots.

    Raises
    ------
    ValueError, TypeError
        If a number is outside its domain, or an argument has the wrong type.

    Examples
    --------
    >>> from tertia.sensors import Channel, Radar
    >>> radar = Radar(
    ...     range_sigma=50.0,
    ...     azimuth_sigma=0.0014,
    ...     scan_period=4.0,
    ...     channels={"psr": Channel(0.85, range_sigma=80.0), "ssr": Channel(0.95)},
    ... )
    >>> round(radar.detection_probability, 4)
    0.9925
    """

    detection_probability: float
    range_sigma: float | None
    azimuth_sigma: float | None
    clutter_per_scan: float | None

    def __init__(
        self,
        detection_probability: float,
        *,
        range_sigma: float | None = None,
        azimuth_sigma: float | None = None,
        clutter_per_scan: float | None = None,
        degrees: bool = False,
    ) -> None:
        detected = probability(detection_probability, "detection_probability")
        distance = None if range_sigma is None else positive_number(range_sigma, "range_sigma")
        angle = None
        if azimuth_sigma is not None:
            stated = real(azimuth_sigma, "azimuth_sigma")
            radians = angle_sigma(stated, "azimuth_sigma", degrees=degrees)
            angle = narrow(positive_number(radians, "azimuth_sigma"))
        false = clutter_per_scan
        if false is not None:
            false = not_negative(false, "clutter_per_scan")
        object.__setattr__(self, "detection_probability", detected)
        object.__setattr__(self, "range_sigma", distance)
        object.__setattr__(self, "azimuth_sigma", angle)
        object.__setattr__(self, "clutter_per_scan", false)


def narrow(azimuth_sigma: float) -> float:
    """Return a standard deviation of azimuths, after checking that a radar can have it."""
    if azimuth_sigma > WIDEST_BEAM:
        raise ValueError(
            f"azimuth_sigma is {azimuth_sigma:g}; that of a radar must be at most "
            f"{WIDEST_BEAM} rad; are these degrees? pass degrees=True"
        )
    return azimuth_sigma


def channels_of(value: Any) -> dict[str, Channel] | None:
    """Return the channels of a radar in the order psr, ssr, mode-s, after checking them."""
    if value is None:
        return None
    names = ", ".join(CHANNELS)
    if not isinstance(value, Mapping):
        raise TypeError(f"channels is {value!r}; it must be a mapping of {names} to Channel")
    for name, channel in value.items():
        if name not in CHANNELS:
            raise ValueError(f"channels has {name!r}; its keys must be among {names}")
        instance(channel, f"channels[{name!r}]", Channel)
    if not value:
        raise ValueError("channels is empty; there must be at least one")
    return {name: value[name] for name in CHANNELS if name in value}


def sigmas_of(
    channels: Mapping[str, Channel], detection: str, own: tuple[float, float]
) -> tuple[float, float]:
    """Return the standard deviations for a detection; `own` are those of the radar.

    A plot detected by echo and reply has the standard deviations of the reply channel.
    """
    channel = channels[detection.rpartition("+")[2]]
    sigmas = channel.range_sigma, channel.azimuth_sigma
    first, second = (size if mine is None else mine for mine, size in zip(sigmas, own, strict=True))
    return first, second


def ways(channels: Mapping[str, Channel]) -> dict[str, float]:
    """Return the probability of each combination of channels, and of no detection (empty name).

    Channels detect independently. A target has a transponder of one kind only. If a radar
    interrogates both kinds, half of the targets have a transponder of one kind, and the other half
    one of the other kind.
    """
    echo = channels["psr"].detection_probability if "psr" in channels else 0.0
    replies = {
        name: channels[name].detection_probability for name in CHANNELS[1:] if name in channels
    }
    answers = {name: chance / len(replies) for name, chance in replies.items()}
    answers[""] = 1.0 - sum(answers.values())
    found = {}
    for (first, p), (second, q) in product({"psr": echo, "": 1.0 - echo}.items(), answers.items()):
        if p > 0.0:
            found["+".join(filter(None, (first, second)))] = p * q
    return found


def detections(value: npt.ArrayLike) -> IntArray:
    """Return detections, which may be given as indices or names, as indices of `DETECTIONS`."""
    array = array_of(value, "detection")
    if array.dtype.kind in "iuf":
        # frames keep whole numbers as floats where some are missing
        numbers = np.where(np.isnan(array), NO_DETECTION, array)
        known = (numbers >= NO_DETECTION) & (numbers < len(DETECTIONS))
        wrong = np.flatnonzero(~known | (numbers != np.trunc(numbers)))
        if len(wrong):
            raise ValueError(
                f"detection[{wrong[0]}] is {array.flat[wrong[0]]:g}; it must be an index of "
                f"{', '.join(DETECTIONS)}, or {NO_DETECTION} or nan for none"
            )
        return numbers.astype(np.int64)
    names, place = np.unique(array.astype(str), return_inverse=True)
    found = np.full(len(names), NO_DETECTION)
    for at, name in enumerate(names.tolist()):
        if name in DETECTIONS:
            found[at] = DETECTIONS.index(name)
        elif name not in {"", "None", "nan"}:
            index = int(np.flatnonzero(place.ravel() == at)[0])
            raise ValueError(
                f"detection[{index}] is {name!r}; it must be one of {', '.join(DETECTIONS)}"
            )
    return found[place].reshape(array.shape)
