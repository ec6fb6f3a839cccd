"""The data from which a position was estimated, kept for later calculations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from tertia._arrays import BoolArray, FloatArray

Rows: TypeAlias = tuple[FloatArray, FloatArray | None, FloatArray, FloatArray]
Measured: TypeAlias = tuple[
    FloatArray,
    FloatArray | None,
    FloatArray,
    FloatArray,
    FloatArray | None,
    FloatArray | None,
    float,
    FloatArray,
    FloatArray,
]


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """The arguments of the kernels: one row for each instant, or one row for all of them."""

    places: FloatArray
    axes: FloatArray | None
    # of shape (..., kinds, K), nan where there is no measurement
    values: FloatArray
    sigmas: FloatArray
    # where a measurement was left out
    outlier: BoolArray
    # metres in the unit of a sigma that was estimated
    unit: float | FloatArray = 1.0
    # of the stations' coordinates; of the target, with its sigma; of range differences
    surveys: FloatArray | None = None
    height: FloatArray | None = None
    correlation: float = 0.0
    # whether all instants have the sigma of a measurement in common
    pooled: bool = False
    # of a posterior: the limit of range, and what the record says of the size of the errors
    max_range: float | None = None
    weights: FloatArray | None = None

    @property
    def rows(self) -> Rows:
        """Return stations, axes, measurements and standard deviations."""
        return self.places, self.axes, self.values, self.sigmas

    def at(self, position: FloatArray) -> Measured:
        """Return `rows` and the other data that the core needs for regions of given positions."""
        if self.height is not None:
            # also where it is no result
            level = self.height[..., 0]
            level = np.broadcast_to(
                level.reshape(()) if level.size == 1 else level, position.shape[:-1]
            )
            up = np.where(np.isnan(position[..., 2]), level, position[..., 2])
            position = np.concatenate([position[..., :2], up[..., np.newaxis]], axis=-1)
        models = self.correlation, self.outlier.astype(np.float64)
        return (*self.rows, self.surveys, self.height, *models, position)
