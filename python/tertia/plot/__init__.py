"""Pictures of measurements, outliers and results.

This module needs the extra `plot` (Matplotlib). All functions return the axes on which they have
drawn, and do not show or save anything. They raise ImportError if Matplotlib is not installed, and
TypeError if an argument has the wrong type. Outliers differ from other measurements in shape as
well as in colour. The colours are those of Okabe and Ito, which colour-blind readers can
distinguish.
"""

from tertia.plot._audit import audit
from tertia.plot._axes import rounded as rounded
from tertia.plot._bias import bias
from tertia.plot._fused import fused
from tertia.plot._fused_series import fused_series
from tertia.plot._gates import gate_history, gates
from tertia.plot._location import accuracy_map, location
from tertia.plot._samples import bearing, screening
from tertia.plot._series import consistency, smoothing
from tertia.plot._tracks import tracks, update_probability
from tertia.plot._trajectory import trajectory

__all__ = [
    "accuracy_map",
    "audit",
    "bearing",
    "bias",
    "consistency",
    "fused",
    "fused_series",
    "gate_history",
    "gates",
    "location",
    "screening",
    "smoothing",
    "tracks",
    "trajectory",
    "update_probability",
]
