"""Pictures: what was measured, what was flagged, and what came of it.

Needs the extra `plot` (Matplotlib). Nothing is shown or saved: the functions return the axes.
Flagged measurements differ in shape as well as in colour; the colours are those of Okabe and Ito,
which remain distinct for colour-blind readers.
"""

from tertia.plot._axes import rounded as rounded
from tertia.plot._combination import combination
from tertia.plot._locations import accuracy_map, location
from tertia.plot._samples import bearing, screening
from tertia.plot._smoothing import smoothing
from tertia.plot._tracker import tracks, update_probability
from tertia.plot._tracks import consistency, fusion
from tertia.plot._trajectory import trajectory

__all__ = [
    "accuracy_map",
    "bearing",
    "combination",
    "consistency",
    "fusion",
    "location",
    "screening",
    "smoothing",
    "tracks",
    "trajectory",
    "update_probability",
]
