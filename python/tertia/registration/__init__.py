"""Registration: estimation of the noise and the biases of radars from their plots.

`calibrate` estimates the bias of one sensor from targets whose positions are known.

`register` estimates noise and biases. The noise is estimated from the scatter of plots about short
straight lines in the tracks of each radar. The biases are estimated from the differences between
tracks of different radars.

In the core, the tracker depends on the kernels of registration, so that it can register its radars
during operation. This module depends on `tertia.tracker`, because it takes recordings and makes the
tracks that the kernels need.
"""

from tertia.registration._calibrate import calibrate
from tertia.registration._register import register
from tertia.registration._registration import NoiseHistory, Registration
from tertia.tracker._errors import BiasHistory

__all__ = ["BiasHistory", "NoiseHistory", "Registration", "calibrate", "register"]
