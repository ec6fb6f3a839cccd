"""Metrics: errors, their consistency with covariances, and the quality of tracks.

`nees`, `nis`, `consistency_bounds`, `autocorrelation` and `rmse` evaluate errors. `track_errors`
resolves them along and across a course, `gospa` compares sets of positions, and `match_tracks` and
`indicators` compare tracks with the truth.
"""

from tertia.metrics._consistency import autocorrelation, consistency_bounds, nees, nis, rmse
from tertia.metrics._gospa import Gospa, gospa
from tertia.metrics._indicators import Indicators, indicators
from tertia.metrics._matching import Matching, Tracks, match_tracks, track_errors
from tertia.metrics._truth import Truth

__all__ = [
    "Gospa",
    "Indicators",
    "Matching",
    "Tracks",
    "Truth",
    "autocorrelation",
    "consistency_bounds",
    "gospa",
    "indicators",
    "match_tracks",
    "nees",
    "nis",
    "rmse",
    "track_errors",
]
