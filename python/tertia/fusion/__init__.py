"""Fusion: plots of several radars into one track, estimates of several sensors into one.

Source: Panasyuk, Pudovkin, Rogachev 2018, equations (1) to (13), for K radars, with misprints
corrected (`method="paper"`), the usual rules, and a default that estimates the accuracy of each
radar.

All radars measure one angle in one frame; `common_azimuth` converts azimuths from other sites to
it.
"""

from tertia import _core
from tertia.fusion._azimuth import common_azimuth
from tertia.fusion._estimates import FusedEstimate, InstantMethod, fuse, fuse_scalar
from tertia.fusion._series import FusedSeries, FusionMethod, fuse_series

AngleFusion = _core.AngleFusion

__all__ = [
    "AngleFusion",
    "FusedEstimate",
    "FusedSeries",
    "FusionMethod",
    "InstantMethod",
    "common_azimuth",
    "fuse",
    "fuse_scalar",
    "fuse_series",
]
