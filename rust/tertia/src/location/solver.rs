//! Location of instants: reads the measurements, descends from trusted starts, and writes the results.

pub(super) mod growth;
mod profile;
pub(super) mod record;
pub(super) mod summary;

use super::descent::lane::LANES;
use super::descent::minimum::Minimum;
use super::descent::{Cost, HUBER_STEPS, Loss, Outliers, TOLERANCE, TUKEY, TUKEY_TOLERANCE};
use super::search::fix::{Fix, Instant, Method, Output, Status};
use super::search::lenth::Weight;
use super::search::mirror::Side;
use super::search::{Buffers, Search, position};
use crate::base::distribution::chi_square_upper;
use crate::base::small::{Matrix, Vector, add, symmetrise};
use crate::sensors::KINDS;
use growth::growth;
use profile::Unbounded;
use record::{NOWHERE, Record, Room};
use summary::Summary;

/// Huber's steps from a trusted start end when they are shorter than this, in standard deviations.
const NEAR_HUBER: f64 = 0.5;
/// Number of repeated descents, each with the errors of angles that uncertain station positions cause at
/// the position before.
const SURVEYS: usize = 2;

/// Buffers of a thread.
#[derive(Debug, Default)]
pub struct Workspace<const D: usize> {
    pub(super) own: Room<D, D>,
    // with arrivals, whose emission is an additional unknown
    pub(super) plane: Room<2, 3>,
    pub(super) space: Room<3, 4>,
}

/// An estimator of positions.
#[derive(Clone, Copy, Debug)]
pub struct Locator {
    method: Method,
    /// Whether covariances grow if residuals are too large.
    pub(super) grows: bool,
    /// Whether covariances follow the cost where it is not a parabola.
    profiles: bool,
    /// Whether the better of two positions is taken even if the other one is nearly as good.
    decides: bool,
    /// Whether outliers of arrivals are mostly late.
    multipath: bool,
    /// Frequency of outliers.
    outliers: Outliers,
    /// Correlation of the errors of range differences.
    pub(super) correlation: f64,
    /// Share of the variance of each kind that all stations have in common.
    common: [f64; KINDS],
    /// Variance that each measurement of a kind may have in addition, divided by that used as its weight.
    unchecked: [f64; KINDS],
    /// Standard deviation of the relative error of the speed of the signals.
    speed_sigma: f64,
    /// The side of the stations on which the targets are, if it is known.
    pub(super) side: Option<Side>,
}

impl Locator {
    /// Returns an estimator with this method.
    pub fn new(method: Method) -> Self {
        Self {
            method,
            grows: false,
            profiles: false,
            decides: false,
            multipath: true,
            outliers: Outliers::FEW,
            correlation: 0.5,
            common: [0.0; KINDS],
            unchecked: [0.0; KINDS],
            speed_sigma: 0.0,
            side: None,
        }
    }

    /// Returns this estimator with covariances that grow if the residuals of an instant are larger than
    /// their sigmas allow.
    pub fn growing(self) -> Self {
        Self { grows: true, ..self }
    }

    /// Returns this estimator with covariances that are right even if errors are not small compared with
    /// the distances, and without a position if the 95 % ellipse has no end.
    pub fn profiling(self) -> Self {
        Self { profiles: true, ..self }
    }

    /// Returns this estimator for the cost of the best position only: it ignores whether another position
    /// is nearly as good, and how far the cost stays low around the best one.
    pub(super) fn deciding(self) -> Self {
        Self { profiles: false, decides: true, ..self }
    }

    /// Returns this estimator with outliers of arrivals that are mostly late, or equally late and early.
    pub fn with_multipath(self, multipath: bool) -> Self {
        Self { multipath, ..self }
    }

    /// Returns this estimator with this frequency of outliers.
    pub(super) fn with_outliers(self, outliers: Outliers) -> Self {
        Self { outliers, ..self }
    }

    /// Returns this estimator with this correlation of the errors of range differences, at least 0 and
    /// below 1: the share of their variance that is due to the first station.
    pub fn with_correlation(self, correlation: f64) -> Self {
        Self { correlation, ..self }
    }

    /// Returns this estimator with covariances that include errors which all stations share: these shares
    /// of the stated variances of each kind.
    pub fn with_common(self, common: [f64; KINDS]) -> Self {
        Self { common, ..self }
    }

    /// Returns this estimator with covariances that include the errors that each measurement of a kind may have
    /// in addition: these shares of the variances used as weights.
    pub fn with_unchecked(self, unchecked: [f64; KINDS]) -> Self {
        Self { unchecked, ..self }
    }

    /// Returns this estimator with covariances that include an error of the speed of the signals, whose
    /// relative value has this standard deviation.
    pub fn with_speed_sigma(self, speed_sigma: f64) -> Self {
        Self { speed_sigma, ..self }
    }

    /// Estimates the positions of instants, preferably [`location::BLOCK`](super::BLOCK) at a time, which
    /// are processed side by side. Position and covariance are nan for instants that cannot be located. The
    /// result for an instant does not depend on the others.
    ///
    /// # Panics
    /// If the numbers of instants, outputs and fixes differ.
    pub fn locate_all<const D: usize>(
        &self,
        instants: &[Instant<'_>],
        out: &mut [Output<'_>],
        fixes: &mut [Fix],
        workspace: &mut Workspace<D>,
    ) {
        assert!(instants.len() == out.len() && instants.len() == fixes.len());
        let blocks = instants.chunks(LANES).zip(out.chunks_mut(LANES));
        for ((instants, out), fixes) in blocks.zip(fixes.chunks_mut(LANES)) {
            self.descend(instants, workspace);
            for (at, instant) in instants.iter().enumerate() {
                fixes[at] = self.one(instant, at, &mut out[at], workspace);
            }
        }
    }

    /// Estimates the position of one instant, as [`Locator::locate_all`] does.
    pub fn locate<const D: usize>(
        &self,
        instant: &Instant<'_>,
        out: &mut Output<'_>,
        workspace: &mut Workspace<D>,
    ) -> Fix {
        self.descend(std::slice::from_ref(instant), workspace);
        self.one(instant, 0, out, workspace)
    }

    /// Whether outliers are searched for.
    pub(super) fn is_robust(&self) -> bool {
        matches!(self.method, Method::Robust(_))
    }

    /// Returns this estimator with least squares as the method.
    pub(super) fn plain(&self) -> Self {
        Self { method: Method::LeastSquares, ..*self }
    }

    /// Returns this estimator with covariances that follow from the sigmas alone, whatever the residuals.
    pub(super) fn trusting(&self) -> Self {
        Self { grows: false, ..*self }
    }

    /// Returns the loss for this number of degrees of freedom.
    pub(super) fn loss(&self, redundancy: usize, of_arrivals: bool) -> Loss {
        match self.method {
            Method::Robust(least) if redundancy < least.max(1) => Loss::SQUARE,
            Method::Robust(_) if of_arrivals => {
                Loss::of_arrivals(self.multipath, self.outliers.odds)
            }
            Method::Robust(_) if self.outliers != Outliers::FEW => {
                Loss::of_many(self.outliers.odds, self.outliers.late)
            }
            Method::Robust(_) => Loss::Alike(Cost::Tukey(TUKEY)),
            _ => Loss::SQUARE,
        }
    }

    /// Finishes an instant of a block, with the emission as an unknown if there are arrivals.
    pub(super) fn one<const D: usize>(
        &self,
        instant: &Instant<'_>,
        at: usize,
        out: &mut Output<'_>,
        workspace: &mut Workspace<D>,
    ) -> Fix {
        let Workspace { own, plane, space } = workspace;
        match (D, self.has_arrivals(instant)) {
            (_, false) => self.finish(instant, at, out, own),
            (2, true) => self.finish(instant, at, out, plane),
            _ => self.finish(instant, at, out, space),
        }
    }

    /// Whether there are arrivals, or range differences that are converted into arrivals.
    pub(super) fn has_arrivals(&self, instant: &Instant<'_>) -> bool {
        let k = instant.values.len() / KINDS;
        let [.., differences, arrivals] =
            std::array::from_fn::<_, KINDS, _>(|kind| &instant.values[kind * k..(kind + 1) * k]);
        let any = |values: &[f64]| values.iter().any(|v| !v.is_nan());
        any(arrivals) || any(differences) && instant.common(self.correlation).is_some()
    }

    /// Reads instants, and descends from their trusted starts side by side.
    pub(super) fn descend<const D: usize>(
        &self,
        instants: &[Instant<'_>],
        workspace: &mut Workspace<D>,
    ) {
        let Workspace { own, plane, space } = workspace;
        let count = instants.len();
        own.clear(count);
        plane.clear(count);
        space.clear(count);
        for (at, instant) in instants.iter().enumerate() {
            match (D, self.has_arrivals(instant)) {
                (_, false) => self.read(at, instant, own),
                (2, true) => self.read(at, instant, plane),
                _ => self.read(at, instant, space),
            }
        }
        self.descend_in(own, count);
        self.descend_in(plane, count);
        self.descend_in(space, count);
    }

    fn read<const D: usize, const N: usize>(
        &self,
        at: usize,
        instant: &Instant<'_>,
        room: &mut Room<D, N>,
    ) {
        let loss = |count| self.lenth().is_none().then(|| self.loss(count - N, N > D));
        room.read(at, instant, self.correlation, loss);
    }

    fn descend_in<const D: usize, const N: usize>(&self, room: &mut Room<D, N>, count: usize) {
        let Room { records, block, .. } = room;
        let records = &mut records[..count];
        let mut tried = [false; LANES];
        for from in 0..records.len() {
            let first = &records[from];
            let Some(start) = first.start.filter(|_| !tried[from]) else { continue };
            block.begin(&first.measurements, &start);
            let mut members = [false; LANES];
            for (lane, record) in records.iter().enumerate().skip(from) {
                let Some(start) = record.start.filter(|_| !tried[lane]) else { continue };
                members[lane] = block.fits(&record.measurements);
                if members[lane] {
                    block.set(lane, &record.measurements, &start);
                }
            }
            let loss = self.loss(first.measurements.len() - N, N > D);
            let tolerance = if loss == Loss::SQUARE { TOLERANCE } else { TUKEY_TOLERANCE };
            block.descend(loss, (HUBER_STEPS, NEAR_HUBER), tolerance);
            for (lane, record) in records.iter_mut().enumerate().filter(|(lane, _)| members[*lane])
            {
                let arrival = block.arrival(lane, record.extent, &mut record.rows);
                // other records are left to the descent with safeguards
                record.first = arrival.map(Minimum::of);
                tried[lane] = true;
            }
        }
    }

    /// Returns the status of an instant of a block, and its degrees of freedom. The residuals remain in the
    /// workspace.
    pub(super) fn status<const D: usize>(
        &self,
        instant: &Instant<'_>,
        at: usize,
        workspace: &mut Workspace<D>,
    ) -> (Status, i64) {
        fn of<const D: usize, const N: usize>(
            locator: &Locator,
            instant: &Instant<'_>,
            at: usize,
            room: &mut Room<D, N>,
        ) -> (Status, i64) {
            let settled = locator.settle(instant, &mut room.records[at], &mut room.buffers);
            let redundancy = room.records[at].measurements.len() as i64 - N as i64;
            (settled.err().unwrap_or(Status::None), redundancy)
        }
        let Workspace { own, plane, space } = workspace;
        match (D, self.has_arrivals(instant)) {
            (_, false) => of(self, instant, at, own),
            (2, true) => of(self, instant, at, plane),
            _ => of(self, instant, at, space),
        }
    }

    /// Returns the minimum that the start of a record led to, or another one, with its covariance, and sets the
    /// rows of the record.
    fn settle<const D: usize, const N: usize>(
        &self,
        instant: &Instant<'_>,
        record: &mut Record<D, N>,
        buffers: &mut Buffers<D, N>,
    ) -> Result<Settled<D, N>, Status> {
        let count = record.measurements.len();
        if count < N {
            return Err(Status::TooFew);
        }
        let minimum = self.minimum(instant, record, buffers)?;
        if record.first.is_none_or(|first| first.state != minimum.state) {
            record.rows.clear();
            record.rows.extend(record.measurements.iter().map(|m| m.row_at(&minimum.state)));
        }
        let search = record.search(self.loss(count - N, N > D));
        let summary = search.summary(&minimum, self.lenth(), &record.rows);
        let growth = match summary.kept {
            (square, freedom) if self.grows && !record.unknown => growth::<D>(square, freedom),
            _ => 1.0,
        };
        let covariance = self.covariance(record, &search, &minimum, &summary, growth);
        let covariance = covariance.map_err(|Unbounded| Status::IllConditioned)?;
        Ok(Settled { minimum, summary, growth, covariance })
    }

    /// Computes the results of a record.
    fn finish<const D: usize, const N: usize>(
        &self,
        instant: &Instant<'_>,
        at: usize,
        out: &mut Output<'_>,
        room: &mut Room<D, N>,
    ) -> Fix {
        let Room { records, buffers, .. } = room;
        let record = &mut records[at];
        out.position.fill(f64::NAN);
        out.covariance.fill(f64::NAN);
        out.residual.fill(f64::NAN);
        out.outlier.fill(false);
        let count = record.measurements.len();
        let failed =
            |status| Fix { status, degrees_of_freedom: count as i64 - N as i64, ..Fix::UNKNOWN };
        let Settled { minimum, summary, growth, mut covariance } =
            match self.settle(instant, record, buffers) {
                Ok(settled) => settled,
                Err(status) => return failed(status),
            };
        let search = record.search(self.loss(count - N, N > D));
        let origin = first::<D>(instant.stations);
        for (i, (value, o)) in out.position.iter_mut().zip(origin).enumerate() {
            *value = minimum.state[i] + o;
        }
        let stretch = search.stretched(&minimum, &record.rows, self.speed_sigma);
        for (i, row) in covariance.iter_mut().enumerate() {
            row.iter_mut().zip(&stretch).for_each(|(v, s)| *v += stretch[i] * s);
        }
        // products of three numbers depend on their order
        symmetrise(&mut covariance);
        for (own, row) in out.covariance.chunks_exact_mut(D).zip(&covariance) {
            own.copy_from_slice(row);
        }
        let statistic = self.judge(record, &search, &minimum, summary.sigma, out);
        let (emission, emission_sigma) = match N > D {
            true => {
                let own = (growth * summary.covariance[D][D]).sqrt();
                (minimum.state[D], own.hypot(stretch[D]))
            }
            false => (f64::NAN, f64::NAN),
        };
        Fix {
            statistic,
            pvalue: match count - N {
                _ if record.unknown => f64::NAN,
                0 => 1.0,
                redundancy => chi_square_upper(statistic, redundancy),
            },
            dop: summary.dop,
            sigma: if record.unknown { summary.sigma } else { f64::NAN },
            emission,
            emission_sigma,
            ..failed(Status::None)
        }
    }

    /// Returns the minimum of the cost. If station positions are uncertain, the sigmas of angles include the
    /// effect of this uncertainty at the minimum.
    fn minimum<const D: usize, const N: usize>(
        &self,
        instant: &Instant<'_>,
        record: &mut Record<D, N>,
        buffers: &mut Buffers<D, N>,
    ) -> Result<Minimum<N>, Status> {
        let loss = self.loss(record.measurements.len() - N, N > D);
        let origin = first::<D>(instant.stations);
        let initial = instant.initial.map(|p| std::array::from_fn(|i| p[i] - origin[i]));
        let side = self.side.map(|side| (side, origin));
        let search = Search { decides: self.decides, side, ..record.search(loss) };
        let found = match self.lenth() {
            None => search.minimum(initial, (&record.points, &record.costs), buffers),
            Some(weight) => search.lenth(initial, weight, buffers),
        };
        let mut minimum = search.checked(found?)?;
        if record.is_blurred(instant) {
            for _ in 0..SURVEYS {
                record.blur(instant, &position(&minimum.state));
                let search = record.search(loss);
                minimum = search.checked(search.refine_steadily(minimum.state))?;
            }
        }
        Ok(minimum)
    }

    /// Returns the covariance of a position, including the effects of residuals, curvature and common
    /// errors.
    fn covariance<const D: usize, const N: usize>(
        &self,
        record: &Record<D, N>,
        search: &Search<'_, D, N>,
        minimum: &Minimum<N>,
        summary: &Summary<N>,
        growth: f64,
    ) -> Result<Matrix<D>, Unbounded> {
        let mut covariance: Matrix<D> =
            std::array::from_fn(|i| std::array::from_fn(|j| summary.covariance[i][j] * growth));
        let scale = if record.unknown { summary.sigma / minimum.scale } else { 1.0 };
        if self.profiles && self.lenth().is_none() {
            let curved = search.curved(minimum, &covariance, growth * scale * scale)?;
            covariance = curved.unwrap_or(covariance);
        }
        if self.common != [0.0; KINDS] {
            add(&mut covariance, &search.shared(minimum, &record.rows, &self.common));
        }
        if self.unchecked != [0.0; KINDS] {
            add(&mut covariance, &search.separate(minimum, &record.rows, &self.unchecked));
        }
        Ok(covariance)
    }

    /// Writes residuals in units of `sigma`, and outliers; returns the sum of the squared residuals.
    fn judge<const D: usize, const N: usize>(
        &self,
        record: &Record<D, N>,
        search: &Search<'_, D, N>,
        minimum: &Minimum<N>,
        sigma: f64,
        out: &mut Output<'_>,
    ) -> f64 {
        let mut statistic = 0.0;
        let [own, robust] = [sigma, minimum.scale].map(f64::recip);
        let rows = record.measurements.iter().zip(&record.rows).zip(&record.places);
        for ((m, row), &place) in rows {
            let u = row.residual * own;
            statistic += u * u;
            if place != NOWHERE {
                out.residual[place] = u;
                out.outlier[place] = search.is_fault(m, row.residual * robust, self.lenth());
            }
        }
        if record.common.is_some() {
            record.tell_differences(out);
        }
        statistic
    }

    pub(super) fn lenth(&self) -> Option<Weight> {
        match self.method {
            Method::LenthMle => Some(Weight::One),
            Method::LenthHuber => Some(Weight::Huber),
            Method::LenthAndrews => Some(Weight::Andrews),
            _ => None,
        }
    }
}

/// The minimum of a record, and what its results follow from.
struct Settled<const D: usize, const N: usize> {
    minimum: Minimum<N>,
    summary: Summary<N>,
    growth: f64,
    covariance: Matrix<D>,
}

/// Returns the first station. Positions are relative to it, so that large coordinates do not cost digits.
pub(super) fn first<const D: usize>(stations: &[f64]) -> Vector<D> {
    std::array::from_fn(|i| stations[i])
}
