//! Survey errors of the stations, which are the same at all instants.

use super::bias::{Biases, add_covariance, smoothed, weights};
use crate::base::small::{add_multiple, dot, rotated};
use crate::sensors::KINDS;
use crate::smoothing::ProcessNoise;
use crate::trajectory::instants::instant::{Instant, responses};
use crate::trajectory::measured::{Measured, Record};
use crate::trajectory::path::failure::Failure;
use crate::trajectory::search::fit::{Found, Setting};
use nalgebra::{DMatrix, DVector};

/// Adds to the covariance of the states (N, 3D, 3D) the effect of survey errors; `sigma` (K) holds their
/// standard deviations in each coordinate of the stations. Biases were estimated from stations at their wrong
/// positions. O(N K²).
pub(in crate::trajectory) fn add_errors<const D: usize, const N: usize>(
    setting: &mut Setting<'_, D, N>,
    found: &Found<D, N>,
    (sigma, biases): (&[f64], Option<&Biases>),
    motion: ProcessNoise,
    covariance: &mut [f64],
) -> Result<(), Failure> {
    let errors = effects(setting.record, found, sigma);
    add_effects(setting, found, (errors, biases), motion, None, covariance)
}

/// Adds to the covariance of the states the effect of systematic errors. Each is given by the errors that the
/// measurements have if it is as large as its standard deviation. They are independent unless their correlation
/// is given.
pub(in crate::trajectory) fn add_effects<const D: usize, const N: usize>(
    setting: &mut Setting<'_, D, N>,
    found: &Found<D, N>,
    (errors, biases): (impl Iterator<Item = Vec<f64>>, Option<&Biases>),
    motion: ProcessNoise,
    correlation: Option<DMatrix<f64>>,
    covariance: &mut [f64],
) -> Result<(), Failure> {
    let record = setting.record;
    let (weight, _) = weights(record, found, &found.lasting(record));
    let (mut responses, mut spread) = (Vec::new(), Vec::new());
    for errors in errors {
        let (response, inverse) = shifts(record, found, &errors, &weight, biases);
        responses.push(response);
        spread = inverse;
    }
    let means = smoothed(setting, &responses, &spread, motion)?;
    let independent = || DMatrix::identity(means.len(), means.len());
    add_covariance::<N>(&means, &correlation.unwrap_or_else(independent), covariance);
    Ok(())
}

/// Mean variances of the errors of each column (5 K) that survey errors cause; none if there are no survey
/// errors. These errors change with the direction of the target.
pub(in crate::trajectory) fn variances<const D: usize, const N: usize>(
    record: &Record<'_>,
    found: &Found<D, N>,
) -> Option<Vec<f64>> {
    let (sigma, measured) = (record.surveys?, &found.measured);
    let k = sigma.len();
    let (mut sum, mut count) = (vec![0.0; KINDS * k], vec![0.0; KINDS * k]);
    for t in 0..record.len() {
        let rows = measured.rows(t, found.place(t));
        for (m, row) in rows.filter(|(m, _)| measured.column[*m] < KINDS * k) {
            let square = dot(&row.gradient, &row.gradient) / measured.precision(m).powi(2);
            if square.is_finite() {
                let column = measured.column[m];
                sum[column] += square * sigma[column % k].powi(2);
                count[column] += 1.0;
            }
        }
    }
    Some(sum.iter().zip(&count).map(|(sum, count)| sum / f64::max(*count, 1.0)).collect())
}

/// Returns the stations of all instants with one coordinate changed.
fn moved<const D: usize>(record: &Record<'_>, coordinate: usize, by: f64) -> Vec<f64> {
    let mut own = record.stations.to_vec();
    let size = record.width() / KINDS * D;
    own.iter_mut().skip(coordinate).step_by(size).for_each(|v| *v += by);
    own
}

/// Returns the errors of the measurements (N, 5 K) due to an error of one standard deviation in each coordinate
/// of each station.
pub(in crate::trajectory) fn effects<'a, const D: usize, const N: usize>(
    record: &'a Record<'_>,
    found: &'a Found<D, N>,
    sigma: &'a [f64],
) -> impl Iterator<Item = Vec<f64>> + 'a {
    let uncertain = (0..sigma.len()).filter(|&station| sigma[station] > 0.0);
    let coordinates = uncertain.flat_map(|station| (0..D).map(move |axis| (station, axis)));
    coordinates.map(|(station, axis)| {
        let own = moved::<D>(record, station * D + axis, sigma[station]);
        let values = found.measured.values.clone();
        let measured = Measured::<D>::new(&Record { stations: &own, ..*record }, values);
        errors(record, found, &measured)
    })
}

/// Returns the changes of the residuals (N, 5 K) if `measured` replaces the measurements and stations.
pub(in crate::trajectory) fn errors<const D: usize, const N: usize>(
    record: &Record<'_>,
    found: &Found<D, N>,
    measured: &Measured<D>,
) -> Vec<f64> {
    let mut errors = vec![0.0; record.len() * record.width()];
    for (t, own) in errors.chunks_exact_mut(record.width()).enumerate() {
        let place = found.place(t);
        let pairs = measured.rows(t, place).zip(found.measured.rows(t, place));
        for ((m, there), (_, here)) in pairs {
            own[measured.column[m]] = (there.residual - here.residual) / measured.precision(m);
        }
    }
    errors
}

/// Returns by how much errors of the measurements (N, 5 K) move the positions (N, D), and the covariances of
/// the positions (N, D, D). Biases that were estimated from the measurements move, too.
pub(in crate::trajectory) fn shifts<const D: usize, const N: usize>(
    record: &Record<'_>,
    found: &Found<D, N>,
    errors: &[f64],
    weight: &[f64],
    biases: Option<&Biases>,
) -> (Vec<f64>, Vec<f64>) {
    let columns = biases.map_or(&[][..], |own| &own.columns);
    let instants: Vec<Instant<D>> =
        (0..record.len()).map(|t| found.instant(t, weight, columns)).collect();
    let (_, spread) = responses(&instants, 0);
    let mut shift = vec![f64::NAN; record.len() * D];
    let mut scores = DVector::zeros(columns.len());
    for (t, (instant, errors)) in
        instants.iter().zip(errors.chunks_exact(record.width())).enumerate()
    {
        let Some(inverse) = instant.inverse else { continue };
        instant.add_scores(errors, &mut scores);
        let mut pull = [0.0; D];
        for (column, w, _, gradient, _) in &instant.rows {
            add_multiple(&mut pull, w * errors[*column], gradient);
        }
        shift[t * D..][..D].copy_from_slice(&rotated(&inverse, &pull));
    }
    if let Some(biases) = biases {
        biases.remove_from_shifts(&scores, &mut shift);
    }
    (shift, spread)
}
