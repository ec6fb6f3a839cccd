//! Sensors, as typed objects.

use crate::arrays::value_error;
use pyo3::prelude::*;
use tertia::sensors;

/// A radar, checked.
#[pyclass(frozen, module = "tertia._core")]
pub struct Radar(pub sensors::Radar);

#[pymethods]
impl Radar {
    #[new]
    #[pyo3(signature = (*, position, range_sigma, azimuth_sigma, scan_period, max_range, detection_probability, resolution=None))]
    fn new(
        position: [f64; 3],
        range_sigma: f64,
        azimuth_sigma: f64,
        scan_period: f64,
        max_range: f64,
        detection_probability: f64,
        resolution: Option<[f64; 2]>,
    ) -> PyResult<Self> {
        let radar = sensors::Radar {
            position,
            range_sigma,
            azimuth_sigma,
            scan_period,
            max_range,
            detection_probability,
            resolution,
        };
        radar.check().map_err(value_error)?;
        Ok(Self(radar))
    }
}
