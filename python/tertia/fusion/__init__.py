"""Fusion of the plots of several radars into one track, and of several estimates into one.

`method="paper"` is that of Panasyuk, Pudovkin, Rogachev 2018, equations (1) to (13), extended to K
radars and with misprints corrected. The other methods are rules in common use, except for the
default method for series, which also estimates the accuracy of each radar.

All radars measure the same angle in the same frame; `common_azimuth` converts the azimuths of
radars at different sites to a common frame.
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
