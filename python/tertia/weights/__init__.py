"""Weights: matrices that combine estimates, and the loss if these matrices are estimated.

The source is Kulyavets et al. 2005, equations (1) to (14), generalised to any number of sensors.
`S_k` is the covariance of the estimate of sensor k, `C_k` its inverse, `S_p` the inverse of the sum
of all `C_k`, and `W_k = S_p C_k` the weight of sensor k; vec stacks the columns of a matrix.
`tertia.fusion.fuse` combines the estimates.

No single covariance is inverted, only sums of two covariances, so the covariance of one sensor may
be (almost) singular. Rounding causes an error of about 1e-15 / p in the weights, if components are
in units of their standard deviations. Here p is computed from the covariance of a sensor plus that
of the other sensors. It is the smallest fraction of the variance of a component that the other
components do not explain. If p is below 1e-13, the sum is treated as singular.
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
