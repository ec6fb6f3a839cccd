"""Metrics: how large errors are, whether they are as large as they are said to be, and tracking.

`nees`, `nis`, `consistency_bounds`, `autocorrelation` and `rmse` are about errors, `track_errors`
turns them along and across a course, `gospa` compares sets of positions, `match_tracks` and
`surveillance` a whole picture of tracks with the truth.
"""

from tertia.metrics._consistency import autocorrelation, consistency_bounds, nees, nis, rmse
from tertia.metrics._gospa import Gospa, gospa
from tertia.metrics._matching import Matching, match_tracks, track_errors
from tertia.metrics._surveillance import Surveillance, surveillance

__all__ = [
    "Gospa",
    "Matching",
    "Surveillance",
    "autocorrelation",
    "consistency_bounds",
    "gospa",
    "match_tracks",
    "nees",
    "nis",
    "rmse",
    "surveillance",
    "track_errors",
]
