"""Screening: finding the outliers of a sample of measurements.

Every function works along the last axis of an array of shape `(..., N)`. The leading axes are a
batch, whose elements are divided among several threads if that is faster. The number of threads
does not affect the results.

Equations (M1)-(M4) are from Manoilov, Pysarchuk, Pavliuk 2006, and equations (R1)-(R3) from Motylev
2010. The search for single outliers and bursts is that of Fisch, Eckley, Fearnhead 2022.
"""

from tertia.screening._hypothesis import (
    ExtremeTest,
    OutlierTest,
    TestName,
    cochran,
    critical_value,
    false_alarm_probability,
    grubbs,
    t_test,
    thompson_tau,
    z_test,
)
from tertia.screening._rules import (
    Screening,
    bursts,
    k_sigma,
    leave_one_out,
    leave_one_out_mask,
    leave_one_out_statistics,
    moving_polynomial,
    unwrap_about_median,
)

__all__ = [
    "ExtremeTest",
    "OutlierTest",
    "Screening",
    "TestName",
    "bursts",
    "cochran",
    "critical_value",
    "false_alarm_probability",
    "grubbs",
    "k_sigma",
    "leave_one_out",
    "leave_one_out_mask",
    "leave_one_out_statistics",
    "moving_polynomial",
    "t_test",
    "thompson_tau",
    "unwrap_about_median",
    "z_test",
]
