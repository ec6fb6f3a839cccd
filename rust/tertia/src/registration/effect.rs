//! Effects of the errors of radars on a track, and the covariance of these errors.

use super::block::{Unknown, Unknowns};
use super::sighting::{AZIMUTH, ERRORS, Errors, KINDS, harmonics};
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

/// Change of position and velocity by each error of one radar, with errors in units of the prior; or the
/// covariance of the errors of two radars.
pub(super) type Part = [[f64; 4]; KINDS];

/// Effect of the errors of a radar on a track.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Effect {
    pub radar: usize,
    /// Time of the last plot of the confirmed track.
    pub time: f64,
    /// Sine and cosine of the azimuth of the last plot, in which the deviation of the azimuth is that of all
    /// plots that still matter.
    pub direction: [f64; 2],
    pub part: Part,
}

impl Effect {
    /// A radar that has not seen the track yet.
    pub fn new(radar: usize) -> Self {
        let (time, direction, part) = (f64::NEG_INFINITY, [0.0; 2], [[0.0; 4]; KINDS]);
        Self { radar, time, direction, part }
    }
}

/// Covariance of the errors of radars, `K` by `K` blocks; zero for errors that a radar does not have.
pub(super) struct Blocks {
    radars: usize,
    blocks: Vec<Part>,
    /// Covariances that include the deviations of azimuths; none if there are no deviations.
    deviating: Vec<[Errors; ERRORS]>,
}

impl Blocks {
    /// Arranges a covariance in units of the prior. Deviations are in units of the prior of the azimuth, as the
    /// effects on tracks are.
    pub fn new(covariance: &DMatrix<f64>, unknowns: &Unknowns) -> Self {
        let radars = unknowns.len();
        let of = |row: Option<(usize, f64)>, column: Option<(usize, f64)>| match (row, column) {
            (Some((row, _)), Some((column, _))) => covariance[(row, column)],
            _ => 0.0,
        };
        let constant = |own: &Unknown| [own[0], own[1], own[2], own[3]];
        let block = |n: usize| {
            let (rows, columns) = (&unknowns[n / radars], &unknowns[n % radars]);
            constant(rows).map(|row| constant(columns).map(|column| of(row, column)))
        };
        let whole = |n: usize| {
            let [rows, columns] = [n / radars, n % radars].map(|k| &unknowns[k]);
            let (row_units, column_units) = (units(rows), units(columns));
            std::array::from_fn(|i| {
                std::array::from_fn(|j| row_units[i] * column_units[j] * of(rows[i], columns[j]))
            })
        };
        let deviates = unknowns.iter().flat_map(|own| &own[KINDS..]).any(Option::is_some);
        let count = radars * radars;
        Self {
            radars,
            blocks: (0..count).map(block).collect(),
            deviating: if deviates { (0..count).map(whole).collect() } else { Vec::new() },
        }
    }

    /// Returns the covariance of the errors of two radars at a track.
    #[inline(always)]
    pub fn of(&self, own: &Effect, other: &Effect) -> Part {
        let place = own.radar * self.radars + other.radar;
        match self.deviating.get(place) {
            Some(whole) => deviated(whole, own.direction, other.direction),
            None => self.blocks[place],
        }
    }
}

/// Returns the covariance of the errors of two radars, with the deviations in these directions added to the
/// azimuth errors.
#[cold]
fn deviated(whole: &[Errors; ERRORS], own: [f64; 2], other: [f64; 2]) -> Part {
    let sum = |row: &Errors| {
        let along = harmonics(other).into_iter().zip(&row[KINDS..]).map(|(h, value)| h * value);
        let mut constant = [row[0], row[1], row[2], row[3]];
        constant[AZIMUTH] += along.sum::<f64>();
        constant
    };
    let mut part: Part = std::array::from_fn(|i| sum(&whole[i]));
    for (h, row) in harmonics(own).iter().zip(&whole[KINDS..]) {
        for (own, value) in part[AZIMUTH].iter_mut().zip(sum(row)) {
            *own += h * value;
        }
    }
    part
}

/// Returns the size of a unit of each error in units of the prior of the error that moves plots in the same way:
/// for deviations, that of the azimuth.
pub(super) fn units(unknowns: &Unknown) -> Errors {
    let mut units = [1.0; ERRORS];
    if let Some((_, azimuth)) = unknowns[AZIMUTH] {
        for (unit, own) in units.iter_mut().zip(unknowns).skip(KINDS) {
            *unit = own.map_or(0.0, |(_, sigma)| sigma / azimuth);
        }
    }
    units
}
