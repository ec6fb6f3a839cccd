"""Warning of positions that oscillate about a smoothed path."""

from __future__ import annotations

import warnings

import numpy as np

from tertia._arrays import FloatArray


def warn_of_oscillations(frequency: FloatArray) -> None:
    """Warn if there are oscillations, of angular frequencies above 0."""
    if (frequency > 0).any():
        period = 2 * np.pi / frequency[frequency > 0][0]
        warnings.warn(
            f"the plots oscillate with a period of about {period:.2g}, as errors seldom do: this "
            "is taken for motion, as of waves, and is part of the estimate",
            UserWarning,
            stacklevel=3,
        )
