//! Python bindings of Tertia: arrays in, GIL released, kernel, arrays out. No arithmetic here.

mod arrays;
mod bearing;
mod screening;

use pyo3::prelude::*;

/// The compiled core of the `tertia` package.
#[pymodule(name = "_core", gil_used = false)]
mod core_module {
    #[pymodule_export]
    use super::bearing::estimate_bearing;
    #[pymodule_export]
    use super::screening::{
        bursts, cochran, critical_value, false_alarm_probability, grubbs, k_sigma, known_sigma,
        leave_one_out, leave_one_out_mask, leave_one_out_statistics, thompson_tau, unknown_sigma,
        unwrap,
    };
    #[pymodule_export]
    const VERSION: &str = env!("CARGO_PKG_VERSION");
    #[pymodule_export]
    const DEBUG_BUILD: bool = cfg!(debug_assertions);
}
