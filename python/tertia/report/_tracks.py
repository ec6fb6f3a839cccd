"""Rows of confirmed tracks, and tracks of single radars fused at common instants."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tertia import fusion
from tertia._arrays import FloatArray
from tertia.metrics._evaluation import Rows
from tertia.registration._states import Common
from tertia.sensors._identities import NUMBERS, leading
from tertia.tracker import TrackTable


def confirmed_rows(table: TrackTable) -> Rows:
    """Return the rows of confirmed tracks, for evaluation."""
    own = table[table.confirmed]
    kept = own.time, own.track, own.sensor, own.position, own.velocity
    spread = own.covariance[:, :2, :2]
    return Rows(*kept, spread, own.plot >= 0, own.height, getattr(own, leading(own, NUMBERS)))


@dataclass(frozen=True, slots=True, eq=False)
class Combined:
    """Fused tracks of single radars; `weight` has the weights of K radars in position, (M, K)."""

    state: FloatArray
    covariance: FloatArray
    weight: FloatArray
    pvalue: FloatArray


def combine(states: Common, method: fusion.InstantMethod) -> Combined:
    """Fuse the states at each instant; a weight is the mean of the weights for east and north."""
    found = fusion.fuse(states.state, states.covariance, method=method)
    weight = np.trace(found.weights[..., :2, :2], axis1=-2, axis2=-1) / 2
    weight[~states.present] = np.nan
    return Combined(found.mean, found.covariance, weight, np.asarray(found.pvalue))
