"""Registration: the noise and the biases of radars, estimated from their plots.

`calibrate` estimates the bias of one sensor from targets whose positions are known.

`register` estimates the noise from the scatter of plots about short straight lines in each radar's
own tracks, and the biases from the differences between tracks of different radars.

In the core, the kernels stand to the left of the tracker, where a tracker that registers its radars
during operation can use them. This module stands to the right of `tertia.tracker`, because it takes
recordings and makes the tracks that the kernels need.
"""

from tertia.registration._calibrate import calibrate
from tertia.registration._register import register
from tertia.registration._registration import NoiseHistory, Registration

__all__ = ["NoiseHistory", "Registration", "calibrate", "register"]
