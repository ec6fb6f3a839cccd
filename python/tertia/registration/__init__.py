"""Registration: how much noise radars have, and by how much they are biased.

`register` finds both from the plots themselves: the noise from their scatter about short straight
lines in each radar's own tracks, the biases from differences between tracks of different radars.

The kernels stand left of the tracker in the core, where a tracker that registers its radars while
it runs can use them. This module stands right of `tertia.tracker`: it takes recordings, and makes
the tracks that the kernels need, several times over.
"""

from tertia.registration._register import register
from tertia.registration._registration import NoiseHistory, Registration

__all__ = ["NoiseHistory", "Registration", "register"]
