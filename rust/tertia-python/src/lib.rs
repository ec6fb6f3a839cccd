//! Python bindings of Tertia. They convert arrays, release the GIL and call kernels; there is no
//! arithmetic here.

mod arrays;
mod association;
mod asterix;
mod bearing;
mod flightplan;
mod fusion;
mod geo;
mod kalman;
mod location;
mod metrics;
mod registration;
mod screening;
mod sensors;
mod simulate;
mod smoothing;
mod tertiary;
mod tracker;
mod trajectory;
mod weights;

use pyo3::prelude::*;

/// The compiled core of the `tertia` package.
#[pymodule(name = "_core", gil_used = false)]
mod core_module {
    #[pymodule_export]
    use super::arrays::first_outside;
    #[pymodule_export]
    use super::association::{
        assign_pairs, associate, gate_pairs, gate_sectors, gate_threshold, likelihood_score,
        paper_score,
    };
    #[pymodule_export]
    use super::asterix::{
        asterix_blocks, asterix_definitions, asterix_recording, asterix_records, asterix_times,
    };
    #[pymodule_export]
    use super::bearing::estimate_bearing;
    #[pymodule_export]
    use super::flightplan::{Route, conformance, correlate, plan_speeds, times_over};
    #[pymodule_export]
    use super::fusion::{AngleFusion, fuse, fuse_scalar, fuse_series, series_biases};
    #[pymodule_export]
    use super::geo::{
        Frame, cartesian_states, ecef_to_geodetic, geodetic_to_ecef, plots_flattened,
        plots_in_plane, polar_states, pressure_heights,
    };
    #[pymodule_export]
    use super::kalman::{
        AngleFilter, consistency_bounds, filter_series, fit_noise, singer_transition,
        smooth_series, steady_state,
    };
    #[pymodule_export]
    use super::location::{
        explanation, locate, locate_posterior, location_accuracy, location_radii, location_regions,
        posterior_radii, posterior_regions, predicted, protection_levels,
    };
    #[pymodule_export]
    use super::metrics::{
        chi_square_quantile, indicator_powers, lasting, mean_interval, rank_interval,
        share_interval,
    };
    #[pymodule_export]
    use super::registration::{
        calibrate, common_states, correct_states, register_errors, register_noise, register_start,
    };
    #[pymodule_export]
    use super::screening::{
        bursts, cochran, critical_value, false_alarm_probability, grubbs, k_sigma, leave_one_out,
        leave_one_out_mask, leave_one_out_statistics, moving_polynomial, t_test, thompson_tau,
        unwrap_about_median, z_test,
    };
    #[pymodule_export]
    use super::sensors::Radar;
    #[pymodule_export]
    use super::simulate::{Flights, beam_meetings, traffic_states};
    #[pymodule_export]
    use super::smoothing::{local_polynomial, smooth};
    #[pymodule_export]
    use super::tertiary::FusionCentre;
    #[pymodule_export]
    use super::tracker::{
        Geometry, Motion, PlotTracker, Registrar, TrackAssociation, TrackColumns, TrackerSettings,
        height_offsets, plots_to_cartesian, shown_covariances, smooth_tracks, track_columns,
    };
    #[pymodule_export]
    use super::trajectory::arrivals::{group_arrivals, reconstruct_arrivals};
    #[pymodule_export]
    use super::trajectory::reconstruct;
    #[pymodule_export]
    use super::weights::{least_count, simulated_factors, student_factor, weigh, wishart_law};
    #[pymodule_export]
    const VERSION: &str = env!("CARGO_PKG_VERSION");
    #[pymodule_export]
    const DEBUG_BUILD: bool = cfg!(debug_assertions);
    /// Mode 3/A codes that are given to many targets.
    #[pymodule_export]
    const CODES_OF_MANY: [i16; 5] = tertia::tracker::CODES_OF_MANY;
}
