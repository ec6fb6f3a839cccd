"""Metrics for errors, for their consistency with covariances, and for the quality of tracks.

`nees`, `nis`, `consistency_bounds`, `autocorrelation` and `rmse` evaluate errors. `track_errors`
resolves errors along and across a course, `audit` compares errors with the stated covariances, and
`gospa` compares sets of positions. `match_tracks` and `indicators` compare tracks with the truth.
"""

from tertia.metrics._audit import Audit, audit, audit_split
from tertia.metrics._consistency import autocorrelation, consistency_bounds, nees, nis, rmse
from tertia.metrics._gospa import Gospa, gospa
from tertia.metrics._indicator import Indicator
from tertia.metrics._indicators import Indicators, indicators
from tertia.metrics._matching import Matching, Tracks, match_tracks, track_errors
from tertia.metrics._truth import Truth

__all__ = [
    "Audit",
    "Gospa",
    "Indicator",
    "Indicators",
    "Matching",
    "Tracks",
    "Truth",
    "audit",
    "audit_split",
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
