//! Sensors, as typed objects.

use crate::arrays::value_error;
use numpy::{PyArray1, PyFixedUnicode, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use tertia::sensors::{self, Identities, callsign_number, callsign_text};

/// A callsign, with trailing zeros.
type Text = PyFixedUnicode<8>;

/// A radar, validated.
#[pyclass(frozen, module = "tertia._core")]
pub struct Radar(pub sensors::Radar);

#[pymethods]
impl Radar {
    /// Channels are primary, secondary and mode S, each with its detection probability, standard
    /// deviations of range and azimuth, and mean number of false plots in a scan.
    #[new]
    #[pyo3(signature = (
        *, position, range_sigma, azimuth_sigma, scan_period, max_range, detection_probability, resolution=None,
        channels=None, extent=0.0
    ))]
    #[allow(clippy::too_many_arguments)] // the settings, by name
    fn new(
        position: [f64; 3],
        range_sigma: f64,
        azimuth_sigma: f64,
        scan_period: f64,
        max_range: f64,
        detection_probability: f64,
        resolution: Option<[f64; 2]>,
        channels: Option<[Option<[f64; 4]>; 3]>,
        extent: f64,
    ) -> PyResult<Self> {
        let radar = sensors::Radar {
            position,
            range_sigma,
            azimuth_sigma,
            scan_period,
            max_range,
            detection_probability,
            resolution,
            extent,
            ways: None,
        };
        radar.check().map_err(value_error)?;
        let Some(channels) = channels else { return Ok(Self(radar)) };
        radar.with_channels(channels.map(|own| own.map(channel))).map(Self).map_err(value_error)
    }
}

/// Creates a channel from its numbers.
fn channel([p, range_sigma, azimuth_sigma, clutter_per_scan]: [f64; 4]) -> sensors::Channel {
    let sigmas = [range_sigma, azimuth_sigma];
    sensors::Channel { detection_probability: p, sigmas, clutter_per_scan }
}

/// Columns of identities: numbers, addresses, codes and callsigns; `None` for kinds that are unknown.
#[derive(FromPyObject)]
pub struct IdentityColumns<'py>(
    PyReadonlyArray1<'py, i64>,
    Option<PyReadonlyArray1<'py, i64>>,
    Option<PyReadonlyArray1<'py, i64>>,
    Option<PyReadonlyArray1<'py, Text>>,
);

/// The columns of [`IdentityColumns`] in memory.
pub struct IdentityView<'a> {
    identity: &'a [i64],
    icao_address: Option<&'a [i64]>,
    mode_3a: Option<&'a [i64]>,
    callsign: Option<&'a [Text]>,
}

impl IdentityColumns<'_> {
    /// Returns the columns; each must have this number of rows.
    pub fn read(&self, count: usize) -> PyResult<IdentityView<'_>> {
        let Self(identity, icao_address, mode_3a, callsign) = self;
        let view = IdentityView {
            identity: identity.as_slice()?,
            icao_address: icao_address.as_ref().map(|own| own.as_slice()).transpose()?,
            mode_3a: mode_3a.as_ref().map(|own| own.as_slice()).transpose()?,
            callsign: callsign.as_ref().map(|own| own.as_slice()).transpose()?,
        };
        let whole = [Some(view.identity), view.icao_address, view.mode_3a];
        let is_whole = whole.into_iter().flatten().all(|column| column.len() == count)
            && view.callsign.is_none_or(|column| column.len() == count);
        let differs = || PyValueError::new_err("the columns of identities differ in length");
        is_whole.then_some(view).ok_or_else(differs)
    }
}

impl IdentityView<'_> {
    /// Returns the identities of a row.
    #[inline]
    pub fn get(&self, index: usize) -> Identities {
        Identities {
            identity: self.identity[index],
            callsign: self.callsign.map_or(-1, |own| callsign_number(own[index].0)),
            icao_address: self.icao_address.map_or(-1, |own| own[index] as i32),
            mode_3a: self.mode_3a.map_or(-1, |own| own[index] as i16),
        }
    }
}

/// Converts the numbers of callsigns to texts.
pub fn callsigns(py: Python<'_>, numbers: impl Iterator<Item = i64>) -> Py<PyAny> {
    let texts = numbers.map(|number| PyFixedUnicode(callsign_text(number))).collect();
    PyArray1::<Text>::from_vec(py, texts).into_any().unbind()
}

/// Converts the texts of callsigns to numbers.
pub fn callsign_numbers(texts: &PyReadonlyArray1<'_, Text>) -> PyResult<Vec<i64>> {
    Ok(texts.as_slice()?.iter().map(|text| callsign_number(text.0)).collect())
}

/// Number, address, code and callsign of a target; negative or empty if unknown.
pub type Named = (i64, i32, i16, String);

/// Converts the named identities of a target.
pub fn identities_of((identity, icao_address, mode_3a, callsign): Named) -> Identities {
    let mut text = [0; 8];
    text.iter_mut().zip(callsign.chars()).for_each(|(letter, c)| *letter = c.into());
    Identities { identity, callsign: callsign_number(text), icao_address, mode_3a }
}

/// Converts identities to named ones.
pub fn named(of: &Identities) -> Named {
    let text = callsign_text(of.callsign).into_iter().filter_map(char::from_u32);
    let callsign = text.filter(|letter| *letter != '\0').collect();
    (of.identity, of.icao_address, of.mode_3a, callsign)
}
