"""Screening: finding the outliers of a sample of measurements.

Every function works along the last axis of an array of shape `(..., N)`. The leading axes are a
batch, which is shared among several threads if that is faster; the number of threads does not
affect the results.

Sources: Manoilov, Pysarchuk, Pavliuk 2006, equations (M1)-(M4); Motylev 2010, equations (R1)-(R3);
Fisch, Eckley, Fearnhead 2022 for points and bursts.
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
