//! Covariance that positions would have, before anything is measured.

use super::descent::{self, Loss, NEAR};
use super::search::fix::Instant;
use super::solver::record::Record;
use super::solver::summary::Spread;
use super::solver::{Locator, Workspace, first};
use crate::base::small::{Factor, Vector, norm, undetermined};

impl Locator {
    /// Computes the covariance that a position estimated by the stations would have, for arguments as in
    /// [`Instant`] with `sigmas` that are nan for what stations do not measure. The covariance is infinite
    /// if the position is not determined. Returns the dilution of precision. O(K).
    pub fn accuracy<const D: usize>(
        &self,
        instant: &Instant<'_>,
        position: &[f64],
        covariance: &mut [f64],
        workspace: &mut Workspace<D>,
    ) -> f64 {
        let Workspace { own, plane, space } = workspace;
        match (D, self.has_arrivals(instant)) {
            (_, false) => self.accuracy_of(instant, position, covariance, &mut own.records[0]),
            (2, true) => self.accuracy_of(instant, position, covariance, &mut plane.records[0]),
            _ => self.accuracy_of(instant, position, covariance, &mut space.records[0]),
        }
    }

    fn accuracy_of<const D: usize, const N: usize>(
        &self,
        instant: &Instant<'_>,
        position: &[f64],
        covariance: &mut [f64],
        record: &mut Record<D, N>,
    ) -> f64 {
        record.read(instant, self.correlation);
        let origin = first::<D>(instant.stations);
        let p: Vector<D> = std::array::from_fn(|i| position[i] - origin[i]);
        if record.is_blurred(instant) {
            record.blur(instant, &p);
        }
        let mut state = [0.0; N];
        state[..D].copy_from_slice(&p);
        let Record { measurements, extent, .. } = &*record;
        let extent = *extent;
        let near = NEAR * (extent + norm(&p));
        let problem = descent::Problem { measurements, extent };
        let matrix = problem.normal(&state, Loss::SQUARE, 1.0).matrix;
        let blind = measurements.iter().any(|m| m.is_blind(&p, near));
        let inverse = Factor::try_new(&matrix, 0.0).filter(|_| !blind).map(|f| f.inverse());
        let all = inverse.unwrap_or_else(undetermined);
        for (own, row) in covariance.chunks_exact_mut(D).zip(&all) {
            own.copy_from_slice(&row[..D]);
        }
        if inverse.is_none() {
            return f64::INFINITY;
        }
        let mut spread = Spread::<N>::of(measurements);
        for m in measurements {
            spread.add(m, &m.row_at(&state), true);
        }
        spread.dop(D)
    }
}
