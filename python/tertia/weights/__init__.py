"""Weights: matrices that combine estimates, and the loss when these matrices are estimated.

Source: Kulyavets et al. 2005, equations (1) to (14), for any number of sensors. `S_k` is the
covariance of the estimate of sensor k, `C_k` its inverse, `S_p` the inverse of the sum of all
`C_k`, and `W_k = S_p C_k` the weight of sensor k; vec stacks columns. `tertia.fusion.fuse` combines
the estimates.

No single covariance is inverted, only sums of two, so the covariance of one sensor may be (almost)
singular. Rounding leaves an error of about 1e-15 / p in the weights, in units of standard
deviations. Here p refers to the covariance of a sensor plus that of the others: it is the smallest
share of the variance of a component that the other components do not explain. If p is below 1e-13,
the sum counts as singular.
"""

from tertia.weights._jacobian import (
    JacobianOperator,
    jacobian,
    jacobian_operator,
)
from tertia.weights._loss import (
    FusionLoss,
    LossMethod,
    fusion_loss,
    required_samples,
)
from tertia.weights._matrices import (
    fused_covariance,
    scalar_information,
    weight_matrices,
)
from tertia.weights._samples import (
    Convention,
    covariance_factor,
    covariance_of_covariance,
    sample_covariance,
    shrink_covariance,
)
from tertia.weights._spread import Count, weight_bias, weight_covariance

__all__ = [
    "Convention",
    "Count",
    "FusionLoss",
    "JacobianOperator",
    "LossMethod",
    "covariance_factor",
    "covariance_of_covariance",
    "fused_covariance",
    "fusion_loss",
    "jacobian",
    "jacobian_operator",
    "required_samples",
    "sample_covariance",
    "scalar_information",
    "shrink_covariance",
    "weight_bias",
    "weight_covariance",
    "weight_matrices",
]
