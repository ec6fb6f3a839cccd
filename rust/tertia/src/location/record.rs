//! What was measured at one instant, without gaps.

use super::arrivals;
use super::block::Block;
use super::descent::{Loss, Problem};
use super::fix::{Instant, Output};
use super::lane::LANES;
use super::search::{Buffers, Minimum, Search, least, states};
use super::starts;
use crate::base::small::{Vector, dot, norm};
use crate::sensors::{KINDS, Kind, Measurement, Row, read};

/// Where a height stands in the instant.
pub(super) const NOWHERE: usize = usize::MAX;

/// Measurements and where the search for their position stands; the state is a position and, of
/// arrivals, their emission.
#[derive(Clone, Debug)]
pub(super) struct Record<const D: usize, const N: usize> {
    pub measurements: Vec<Measurement<D>>,
    /// Where each stands in the instant, if a station measured it.
    pub places: Vec<usize>,
    /// The size of the geometry.
    pub extent: f64,
    /// Whether the standard deviation is to be estimated.
    pub unknown: bool,
    /// The variance that differences have from the first station, if they are read as arrivals.
    pub common: Option<f64>,
    /// A start, and the minimum it led to.
    pub start: Option<Vector<N>>,
    pub first: Option<Minimum<N>>,
    /// The points of which the start is the best, and their costs; none if it is trusted.
    pub points: Vec<Vector<N>>,
    pub costs: Vec<f64>,
    /// Residuals and their derivatives there.
    pub rows: Vec<Row<N>>,
}

impl<const D: usize, const N: usize> Default for Record<D, N> {
    fn default() -> Self {
        Self {
            measurements: Vec::new(),
            places: Vec::new(),
            extent: 0.0,
            unknown: false,
            common: None,
            start: None,
            first: None,
            points: Vec::new(),
            costs: Vec::new(),
            rows: Vec::new(),
        }
    }
}

impl Instant<'_> {
    /// The variance that range differences have from the first station, if any: that of their
    /// correlation, and what its survey adds.
    pub(super) fn common(&self, correlation: f64) -> Option<f64> {
        let k = self.values.len() / KINDS;
        let differences =
            Kind::RangeDifference as usize * k..(Kind::RangeDifference as usize + 1) * k;
        let least = self.sigmas[differences].iter().copied().fold(f64::NAN, f64::min);
        let own = if least.is_nan() { 1.0 } else { least };
        let common = correlation * own * own + self.survey(0).powi(2);
        (common > 0.0).then_some(common)
    }

    /// Standard deviation of a station's coordinates.
    fn survey(&self, station: usize) -> f64 {
        self.position_sigmas.map_or(0.0, |sigmas| sigmas[station])
    }
}

impl<const D: usize, const N: usize> Record<D, N> {
    pub fn clear(&mut self) {
        self.measurements.clear();
        self.places.clear();
        self.points.clear();
        self.costs.clear();
        (self.start, self.first, self.common) = (None, None, None);
        (self.extent, self.unknown) = (0.0, false);
    }

    /// Collects what was measured, station by station; differences that share an error as arrivals,
    /// that of the first station at zero.
    pub fn read(&mut self, instant: &Instant<'_>, correlation: f64) {
        self.clear();
        let Instant { stations, axes, values, sigmas, .. } = *instant;
        let k = values.len() / KINDS;
        let reference = Kind::RangeDifference as usize * k;
        let differences = reference..reference + k;
        if N > D && values[differences].iter().any(|v| !v.is_nan()) {
            self.common = instant.common(correlation);
        }
        if let Some(common) = self.common {
            let zero = Measurement::new(Kind::Arrival, 0, [0.0; D], 0.0, common.sqrt());
            self.measurements.push(zero);
            self.places.push(reference);
        }
        let (common, mut extent) = (self.common, 0.0_f64);
        let survey = |k: usize| instant.survey(k).powi(2);
        read(stations, axes, values, sigmas, |place, mut m: Measurement<D>| {
            let sigma = sigmas[place];
            self.unknown |= sigma.is_nan();
            let variance = m.precision.powi(-2) + survey(m.index);
            match (m.kind, common) {
                (Kind::RangeDifference, Some(common)) => {
                    let own = (variance - common + survey(0)).sqrt();
                    m = Measurement::new(Kind::Arrival, m.index, m.station, m.value, own);
                }
                (Kind::Range | Kind::Arrival | Kind::RangeDifference, _)
                    if survey(m.index) > 0.0 =>
                {
                    m.precision = variance.sqrt().recip();
                }
                _ => {}
            }
            if !m.kind.is_angle() {
                extent = extent.max(m.value.abs());
            }
            extent = extent.max(norm(&m.station));
            self.measurements.push(m);
            self.places.push(place);
        });
        if let Some((height, sigma)) = instant.height {
            let value = height - stations[D - 1];
            extent = extent.max(value.abs());
            self.measurements.push(Measurement::new(Kind::Height, k, [0.0; D], value, sigma));
            self.places.push(NOWHERE);
        }
        self.extent = extent;
    }

    pub fn search(&self, loss: Loss) -> Search<'_, D, N> {
        let Self { measurements, extent, unknown, start, first, .. } = self;
        let problem = Problem { measurements, extent: *extent };
        Search { problem, loss, unknown: *unknown, start: *start, first: *first, decides: false }
    }

    /// Whether errors of the stations' positions are errors of angles.
    pub fn is_blurred(&self, instant: &Instant<'_>) -> bool {
        let angles = self.measurements.iter().filter(|m| m.kind.is_angle());
        !self.unknown && angles.into_iter().any(|m| instant.survey(m.index) > 0.0)
    }

    /// Gives angles the errors that those of their stations' positions make at a position.
    pub fn blur(&mut self, instant: &Instant<'_>, p: &Vector<D>) {
        for (m, &place) in self.measurements.iter_mut().zip(&self.places) {
            if m.kind.is_angle() {
                let gradient = m.row(p).gradient;
                let slope = dot(&gradient, &gradient) / (m.precision * m.precision);
                let survey = instant.survey(m.index).powi(2);
                let sigma = instant.sigmas[place];
                m.precision = (sigma * sigma + survey * slope).sqrt().recip();
            }
        }
        self.first = None;
    }

    /// Whitened residuals and marks of differences in place of those of arrivals.
    pub fn tell_differences(&self, out: &mut Output<'_>) {
        let reference = self.places[0];
        let sigma = |at: usize| self.measurements[at].precision.recip();
        let (first, wrong) = (out.residual[reference] * sigma(0), out.outlier[reference]);
        let differences = Kind::RangeDifference as usize;
        let k = out.residual.len() / KINDS;
        for (at, &place) in self.places.iter().enumerate().skip(1) {
            if place / k == differences {
                let total = sigma(0).hypot(sigma(at));
                out.residual[place] = (out.residual[place] * sigma(at) - first) / total;
                out.outlier[place] |= wrong;
            }
        }
        (out.residual[reference], out.outlier[reference]) = (f64::NAN, false);
    }
}

/// Instants side by side, all of them with arrivals or none.
#[derive(Debug)]
pub(super) struct Room<const D: usize, const N: usize> {
    pub records: Vec<Record<D, N>>,
    pub block: Block<D, N>,
    pub buffers: Buffers<D, N>,
}

impl<const D: usize, const N: usize> Default for Room<D, N> {
    fn default() -> Self {
        Self {
            records: vec![Record::default(); LANES],
            block: Block::default(),
            buffers: Buffers::default(),
        }
    }
}

impl<const D: usize, const N: usize> Room<D, N> {
    /// Reads an instant, and looks for a start for a loss of so many measurements if there is one:
    /// where many measurements agree, or the best point of all where a few do.
    pub fn read(
        &mut self,
        at: usize,
        instant: &Instant<'_>,
        correlation: f64,
        loss: impl Fn(usize) -> Option<Loss>,
    ) {
        let record = &mut self.records[at];
        record.read(instant, correlation);
        let count = record.measurements.len();
        if count < N || instant.initial.is_some() || record.unknown {
            return;
        }
        let Some(loss) = loss(count) else { return };
        let Buffers { candidates, scratch, .. } = &mut self.buffers;
        record.start = if N > D {
            arrivals::start(&record.measurements)
        } else {
            let middle = candidates.middle(&record.measurements);
            middle.map(|p| std::array::from_fn(|i| p[i]))
        };
        if record.start.is_none() {
            let Record { measurements, points, costs, .. } = record;
            candidates.find(measurements, record.extent);
            states(measurements, &candidates.points, points, scratch);
            starts::costs(measurements, points, loss, costs);
            record.start = least(costs).map(|at| points[at]);
        }
    }

    pub fn clear(&mut self, count: usize) {
        self.records[..count].iter_mut().for_each(Record::clear);
    }
}
