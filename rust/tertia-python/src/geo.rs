//! Bindings of `tertia::geo`. Latitudes and longitudes are in radians.

use crate::arrays::{Array, Input, Output, array, release, vector};
use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use tertia::geo::{self as core, Geodetic, LocalFrame, SystemPlane, View, ellipsoid, states};

/// Cost of a point, for the decision whether to release the interpreter's lock.
const POINT_NS: f64 = 200.0;

/// Calls `work` on each row of M numbers, and returns the K results of each.
fn each<'py, const M: usize, const K: usize>(
    py: Python<'py>,
    points: &Input<'_>,
    work: impl Fn([f64; M]) -> [f64; K] + Send + Sync,
) -> PyResult<Output<'py>> {
    let rows = points.points::<M>("points", 1)?;
    let mut out = Output::new(py, &[rows.len()], &[K])?;
    let values = out.values()?;
    release(py, POINT_NS * rows.len() as f64, || {
        for (point, result) in rows.iter().zip(values.as_chunks_mut::<K>().0) {
            *result = work(*point);
        }
    })?;
    Ok(out)
}

pub fn place([latitude, longitude, height]: [f64; 3]) -> Geodetic {
    Geodetic { latitude, longitude, height }
}

fn numbers(place: Geodetic) -> [f64; 3] {
    [place.latitude, place.longitude, place.height]
}

/// Converts latitudes, longitudes and heights to geocentric positions.
#[pyfunction]
pub fn geodetic_to_ecef<'py>(py: Python<'py>, points: Input<'py>) -> PyResult<Output<'py>> {
    each(py, &points, |point| ellipsoid::to_ecef(&place(point)))
}

/// Converts geocentric positions to latitudes, longitudes and heights.
#[pyfunction]
pub fn ecef_to_geodetic<'py>(py: Python<'py>, points: Input<'py>) -> PyResult<Output<'py>> {
    each(py, &points, |point: [f64; 3]| {
        if point.iter().any(|x| x.is_nan()) {
            return [f64::NAN; 3];
        }
        numbers(ellipsoid::from_ecef(&point))
    })
}

/// A local frame or a system plane.
#[pyclass(frozen, module = "tertia._core")]
pub struct Frame(core::Frame);

impl Frame {
    /// Returns the local frame at the origin.
    fn site(&self) -> LocalFrame {
        LocalFrame::new(self.0.origin())
    }

    pub fn plane(&self) -> PyResult<SystemPlane> {
        match self.0 {
            core::Frame::Plane(plane) => Ok(plane),
            core::Frame::Local(_) => Err(PyValueError::new_err("this is no system plane")),
        }
    }
}

#[pymethods]
impl Frame {
    #[new]
    fn new(origin: [f64; 3], is_plane: bool) -> Self {
        Self(if is_plane {
            core::Frame::Plane(SystemPlane::new(place(origin)))
        } else {
            core::Frame::Local(LocalFrame::new(place(origin)))
        })
    }

    /// Converts geocentric positions to coordinates, (N, 3).
    #[allow(clippy::wrong_self_convention)] // the frame converts from
    fn from_ecef<'py>(&self, py: Python<'py>, points: Input<'py>) -> PyResult<Output<'py>> {
        each(py, &points, |point| self.0.from_ecef(&point))
    }

    /// Converts coordinates to geocentric positions, (N, 3).
    fn to_ecef<'py>(&self, py: Python<'py>, points: Input<'py>) -> PyResult<Output<'py>> {
        each(py, &points, |point| self.0.to_ecef(point))
    }

    /// Converts ranges, azimuths and heights to latitudes, longitudes and heights, (N, 3); nan if there
    /// is no such place.
    fn polar_to_geodetic<'py>(&self, py: Python<'py>, points: Input<'py>) -> PyResult<Output<'py>> {
        let site = self.site();
        each(py, &points, |[range, azimuth, height]| {
            site.polar_to_geodetic(range, azimuth, height).map_or([f64::NAN; 3], numbers)
        })
    }

    /// Converts latitudes, longitudes and heights to ranges, azimuths and elevations, (N, 3).
    fn geodetic_to_polar<'py>(&self, py: Python<'py>, points: Input<'py>) -> PyResult<Output<'py>> {
        let site = self.site();
        each(py, &points, |point| site.geodetic_to_polar(&place(point)))
    }

    /// Scale, and azimuth of true north, at coordinates of a plane, (N, 2).
    fn scale_and_convergence<'py>(
        &self,
        py: Python<'py>,
        points: Input<'py>,
    ) -> PyResult<Output<'py>> {
        let plane = self.plane()?;
        each(py, &points, |[u, v, height]| plane.scale_and_convergence(u, v, height))
    }

    /// Converts states (N, 3, 6 or 9) to another frame, with their covariances if there are any.
    fn transform<'py>(
        &self,
        py: Python<'py>,
        target: &Self,
        states: Input<'py>,
        covariance: Option<Input<'py>>,
    ) -> PyResult<(Output<'py>, Option<Output<'py>>)> {
        let states = states.rows("state", 3)?;
        let (count, n) = (states.count(), states.len());
        if ![3, 6, 9].contains(&n) {
            return Err(PyValueError::new_err("a state has 3, 6 or 9 components"));
        }
        let mut moved = Output::new(py, &[count], &[n])?;
        moved.values()?.copy_from_slice(&states.values);
        let mut turned = match covariance {
            None => None,
            Some(covariance) => {
                let given = covariance.blocks("covariance", 2)?;
                given.require(n * n, count)?;
                let mut turned = Output::new(py, &[count], &[n, n])?;
                turned.values()?.copy_from_slice(&given.values);
                Some(turned)
            }
        };
        let rows = moved.values()?;
        let mut blocks = match &mut turned {
            None => None,
            Some(turned) => Some(turned.values()?),
        };
        release(py, 5.0 * POINT_NS * count as f64, || {
            for (i, state) in rows.chunks_exact_mut(n).enumerate() {
                let turn = self.0.transform(&target.0, state);
                if let Some(blocks) = &mut blocks {
                    let own = &mut blocks[i * n * n..(i + 1) * n * n];
                    core::Frame::transform_covariance(&turn, own);
                }
            }
        })?;
        Ok((moved, turned))
    }
}

/// Converts polar states (N, 6) relative to the radar to states of east and north, with the derivatives
/// (N, 6, 6).
#[pyfunction]
pub fn polar_states<'py>(
    py: Python<'py>,
    points: Input<'py>,
) -> PyResult<(Array<'py>, Array<'py>)> {
    let rows = points.points::<{ states::SIZE }>("state", 1)?;
    let (found, slopes): (Vec<_>, Vec<_>) = rows.iter().map(states::to_cartesian).unzip();
    let n = rows.len();
    let slopes = slopes.into_iter().flatten().flatten();
    Ok((
        array(py, &[n, states::SIZE], found.into_iter().flatten())?,
        array(py, &[n, states::SIZE, states::SIZE], slopes)?,
    ))
}

/// Converts states of east and north to polar states; nan at the radar.
#[pyfunction]
pub fn cartesian_states<'py>(py: Python<'py>, points: Input<'py>) -> PyResult<Output<'py>> {
    each(py, &points, |state| states::to_polar(&state).unwrap_or([f64::NAN; states::SIZE]))
}

/// Heights of pressure altitudes (N,), with QNH, temperature deviation from the standard, and undulation.
#[pyfunction]
pub fn pressure_heights<'py>(
    py: Python<'py>,
    altitude: Input<'py>,
    atmosphere: [f64; 3],
) -> PyResult<Array<'py>> {
    let [qnh, isa_deviation, undulation] = atmosphere;
    let air = core::Atmosphere { qnh, isa_deviation, undulation };
    let altitude = altitude.numbers("altitude")?;
    vector(py, altitude.iter().map(|&altitude| air.height(altitude)))
}

/// Returns what `work` computes of each plot (N, 3), which also has an index, from the view of its site in the plane;
/// nan if that is nothing. Sites are given by latitude, longitude and height.
fn seen<'py, const K: usize>(
    py: Python<'py>,
    (sites, plane, sensor): (&Input<'_>, &Frame, &PyReadonlyArray1<'_, i64>),
    plots: &Input<'_>,
    work: impl Fn(&View, [f64; 3], usize) -> Option<[f64; K]> + Send + Sync,
) -> PyResult<Output<'py>> {
    let (plane, sites) = (plane.plane()?, sites.points::<3>("sites", 1)?);
    let view = |site| View::new(LocalFrame::new(place(site)), plane);
    let views: Vec<_> = sites.into_iter().map(view).collect();
    let (plots, sensor) = (plots.points::<3>("plots", 1)?, sensor.as_slice()?);
    let is_site = |k: &i64| (0..views.len() as i64).contains(k);
    if sensor.len() != plots.len() || !sensor.iter().all(is_site) {
        return Err(PyValueError::new_err("there must be the index of a site for each plot"));
    }
    let mut out = Output::new(py, &[plots.len()], &[K])?;
    let rows = out.values()?.as_chunks_mut::<K>().0;
    release(py, POINT_NS * plots.len() as f64, || {
        for (i, (row, (plot, &k))) in rows.iter_mut().zip(plots.iter().zip(sensor)).enumerate() {
            *row = work(&views[k as usize], *plot, i).unwrap_or([f64::NAN; K]);
        }
    })?;
    Ok(out)
}

/// Converts plots (N, 3) of range, azimuth and height to a system plane: u and v, and their derivatives by
/// range, azimuth and height, (N, 8); nan if there is no such position.
#[pyfunction]
pub fn plots_in_plane<'py>(
    py: Python<'py>,
    sites: Input<'py>,
    plane: &Frame,
    sensor: PyReadonlyArray1<'py, i64>,
    plots: Input<'py>,
) -> PyResult<Output<'py>> {
    seen(py, (&sites, plane, &sensor), &plots, |view, [range, azimuth, height], _| {
        let seen = view.see(range, azimuth, height)?;
        let [[a, b], [c, d], [e, f]] = seen.by;
        Some([seen.position[0], seen.position[1], a, b, c, d, e, f])
    })
}

/// Converts plots (N, 3) to the range and azimuth, (N, 2), that radars in a flat plane at their sites would
/// measure; plots without a height are assumed to be at `level`, (N,).
#[pyfunction]
pub fn plots_flattened<'py>(
    py: Python<'py>,
    sites: Input<'py>,
    plane: &Frame,
    sensor: PyReadonlyArray1<'py, i64>,
    plots: Input<'py>,
    level: Input<'py>,
) -> PyResult<Output<'py>> {
    let level = level.numbers("level")?;
    if plots.shape()[..] != [level.len(), 3] {
        return Err(PyValueError::new_err("there must be a level for each plot"));
    }
    seen(py, (&sites, plane, &sensor), &plots, |view, plot, i| view.flattened(plot, level[i]))
}
