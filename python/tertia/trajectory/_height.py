"""Heights of the target of a path, which are given or remain undetermined."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from tertia._arrays import BoolArray, FloatArray, positive, require_between, samples
from tertia.location import Location
from tertia.location._height import (
    ANYWHERE,
    azimuths_alone,
    given_height,
    lifted,
    without_height,
)
from tertia.sensors._kinds import KINDS

# share of the heights that contradict a path from which they are doubtful
_MOST = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Heights:
    """Heights of the target, (N,), nan where unknown, and their sigmas, (N,)."""

    value: FloatArray
    sigma: FloatArray

    @property
    def usual_sigma(self) -> float:
        """Median sigma of the known heights."""
        return float(np.median(self.sigma[~np.isnan(self.value)]))

    @property
    def for_path(self) -> tuple[FloatArray, FloatArray, float]:
        """Heights and sigmas, as the core has them for a path."""
        return self.value, self.sigma, self.usual_sigma


def read_heights(
    given: tuple[npt.ArrayLike | None, npt.ArrayLike | None],
    shape: tuple[int, int],
    way: tuple[str, str],
    flat: list[int] | None,
) -> Heights | None:
    """Return the heights of N instants in D dimensions; None if none is known.

    `given` are heights and sigmas. Raise an error if order, smoother, or kinds whose biases
    have a `flat` prior exclude heights.
    """
    n, d = shape
    both = given_height(*given, d)
    if both is None:
        return None
    if way != ("spatial-first", "rts"):
        raise ValueError("height needs order 'spatial-first' and smoother 'rts'")
    if flat is not None:
        raise ValueError(
            "bias has a sigma of inf, which excludes height; give finite sigmas, or None for "
            "biases that are to be estimated"
        )
    value, spread = samples(both[0], "height"), samples(both[1], "height_sigma")
    require_between(value, "height", "a finite number, or nan", missing=True)
    for name, array in {"height": value, "height_sigma": spread}.items():
        if array.shape not in {(), (n,)}:
            raise ValueError(f"{name} has shape {array.shape}; it must be () or ({n},)")
    lacks = np.isnan(value)
    if lacks.all():
        return None
    unknown = lacks & np.isnan(spread)
    if spread.ndim and not unknown.all():
        # where nothing was measured, the path begins with medians of heights nearby
        usual = np.median(spread[~unknown])
        spread = np.where(unknown, usual, spread)
    spread = positive(spread, "height_sigma")
    own = (np.ascontiguousarray(np.broadcast_to(array, (n,))) for array in (value, spread))
    return Heights(*own)


def fields_of(found: dict[str, Any]) -> dict[str, Any]:
    """Return the results for the heights; warn if most of them contradict the path."""
    if found["height"] is None:
        return {}
    residual, outlier, bias, sigma = found["height"]
    left_out, count = np.count_nonzero(outlier), np.count_nonzero(~np.isnan(residual))
    if left_out > _MOST * count:
        warnings.warn(
            f"{left_out} of {count} heights contradict the path and are left out: is height_sigma "
            "far too small, or do they refer to another level than the positions of the stations?",
            UserWarning,
            stacklevel=3,
        )
    return {
        "height_residual": residual,
        "height_outlier": outlier,
        "height_bias": bias,
        "height_bias_sigma": sigma,
    }


def in_space(found: dict[str, Any]) -> dict[str, Any]:
    """Return a path in the plane as one in space, whose heights are unknown."""
    mean, covariance = lifted(found["mean"], found["covariance"])
    smoothed = found["smoothed"]
    if smoothed is not None:
        spread, innovation, *others = smoothed
        _, spread = lifted(found["mean"], spread)
        innovation = np.pad(innovation, ((0, 0), (0, 1)), constant_values=np.nan)
        smoothed = spread, innovation, *others
    position, accuracy, *others = found["fixes"]
    fixes = *lifted(position, accuracy), *others
    return found | {"mean": mean, "covariance": covariance, "smoothed": smoothed, "fixes": fixes}


def with_heights(
    fixes: Location, found: dict[str, Any], values: FloatArray, heights: Heights | None
) -> Location:
    """Return single positions, without heights where only azimuths are left, (N, 5, K).

    Raise an error if the other instants do not determine the heights of the path.
    """
    if fixes.position.shape[-1] == 2:
        return fixes
    kept = np.where(found["outlier"], np.nan, values)
    alone = azimuths_alone(dict(zip(KINDS, np.moveaxis(kept, 1, 0), strict=True)))
    if heights is not None:
        alone = alone & _unknown(heights, found["height"][1])
    variance = found["covariance"][:, 2, 2]
    if alone.any() and ANYWHERE**2 < np.median(variance) < np.inf:
        raise ValueError(
            f"the height of the path is not determined: at {np.count_nonzero(alone)} of "
            f"{len(alone)} instants only azimuths were measured; measure more elevations or "
            "ranges, or leave out those that there are"
        )
    return without_height(fixes, alone)


def _unknown(heights: Heights, outlier: BoolArray) -> BoolArray:
    return np.asarray(np.isnan(heights.value) | outlier)
