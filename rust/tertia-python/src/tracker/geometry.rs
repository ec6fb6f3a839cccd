//! Conversion of the plots of a sensor to positions.

use crate::geo::{Frame, place};
use pyo3::prelude::*;
use tertia::geo::{LocalFrame, View};
use tertia::tracker;

/// The geometry of a sensor; the constructors are named after its kinds.
#[pyclass(frozen, module = "tertia._core")]
pub struct Geometry(pub tracker::Geometry);

#[pymethods]
impl Geometry {
    #[staticmethod]
    fn flat() -> Self {
        Self(tracker::Geometry::Flat)
    }

    #[staticmethod]
    fn space() -> Self {
        Self(tracker::Geometry::Space)
    }

    /// Positions and velocities with these standard deviations; nan if each report comes with its own
    /// covariance.
    #[staticmethod]
    fn position(sigmas: [f64; 2]) -> Self {
        Self(tracker::Geometry::Position(sigmas))
    }

    /// Azimuths alone, with this standard deviation.
    #[staticmethod]
    fn azimuth(sigma: f64) -> Self {
        Self(tracker::Geometry::Azimuth(sigma))
    }

    /// A site (latitude and longitude in radians, height), a system plane, and the largest range.
    #[staticmethod]
    fn earth(site: [f64; 3], plane: &Frame, max_range: f64) -> PyResult<Self> {
        let view = View::new(LocalFrame::new(place(site)), plane.plane()?);
        Ok(Self(tracker::Geometry::Earth(view, max_range)))
    }
}
