//! Filters and smooths many series at once: side by side in lanes and on several threads; what they
//! have in common is computed once.

use super::block::run_block;
use super::filter::Filter;
use super::model::{Singer, Transition};
use super::series::{PerStep, Series, Summary};
use super::shared::Gains;
use super::smoother::{Workspace, smooth};
use super::state::{Innovation, State, wrapped};
use super::steps::Steps;
use super::tile::LANES;
use crate::base::angle::require_period;
use crate::base::batch::{RowError, for_each_row};
use crate::base::error::Result;
use std::num::NonZero;

/// Smallest number of series for which lanes are worth while.
const FEWEST_LANES: usize = 4;
/// Longest rows that are compared with each other.
const LONGEST_COMPARED: usize = 12;

/// Rows of numbers: a single row for all series, or one row for each.
#[derive(Clone, Copy, Debug)]
pub struct Table<'a> {
    values: &'a [f64],
    width: usize,
}

impl<'a> Table<'a> {
    /// Creates a table with rows of `width` numbers.
    pub fn new(values: &'a [f64], width: usize) -> Self {
        Self { values, width }
    }

    /// Returns all numbers.
    pub(super) fn values(&self) -> &'a [f64] {
        self.values
    }

    /// Returns a table of other numbers with rows of the same width.
    pub(super) fn with<'b>(&self, values: &'b [f64]) -> Table<'b> {
        Table { values, width: self.width }
    }

    pub(super) fn is_single(&self) -> bool {
        self.values.len() <= self.width
    }

    /// Returns the row of a series, which may be the only row.
    pub fn row(&self, index: usize) -> &'a [f64] {
        let start = if self.is_single() { 0 } else { index * self.width };
        self.values.get(start..start + self.width).unwrap_or(&[])
    }

    /// Whether all rows are the same.
    fn is_one_row(&self) -> bool {
        let first = || self.row(0);
        self.is_single()
            || (self.width <= LONGEST_COMPARED
                && self.values.chunks_exact(self.width).all(|row| row == first()))
    }
}

/// Series of the same length, with one model of the motion.
#[derive(Clone, Debug)]
pub struct Batch<'a> {
    z: &'a [f64],
    steps: usize,
    count: usize,
    variance: Table<'a>,
    dt: Table<'a>,
    initial: Option<Table<'a>>,
    model: Singer,
    period: Option<f64>,
    transitions: Transitions,
}

/// The transitions between steps.
#[derive(Clone, Debug)]
enum Transitions {
    /// The same transition between all steps of all series.
    Constant(Transition),
    /// One transition before each step but the first, the same for all series.
    Each(Vec<Transition>),
    /// Each series has its own transitions.
    Own,
}

/// Results at the end of a series.
#[derive(Clone, Copy, Debug)]
pub struct End {
    /// Mean after the last step, with the angle in [0, period).
    pub mean: [f64; 3],
    /// Covariance after the last step.
    pub covariance: [f64; 6],
    /// Log likelihood of all plots that have an innovation.
    pub log_likelihood: f64,
    /// Number of these plots.
    pub count: usize,
}

impl End {
    /// Result of a series that has not been filtered.
    pub const NONE: Self =
        Self { mean: [0.0; 3], covariance: [0.0; 6], log_likelihood: 0.0, count: 0 };

    fn new(summary: &Summary, period: Option<f64>) -> Self {
        let State { mut mean, covariance } = summary.filter.state();
        if let Some(period) = period {
            mean[0] = wrapped(mean[0], period);
        }
        let Summary { log_likelihood, count, .. } = *summary;
        Self { mean, covariance, log_likelihood, count }
    }
}

/// Buffers for the results of a series.
#[derive(Debug)]
pub struct Row<'a> {
    /// States after all steps, as far as there is room.
    pub steps: Steps<'a>,
    /// Results at the end.
    pub end: End,
}

/// Memory that a thread reuses.
#[derive(Default)]
struct Buffers {
    transitions: Vec<Transition>,
    kept: Vec<f64>,
}

/// Start and gains, if all series of a batch have the same.
struct Common {
    filter: Option<Filter>,
    gains: Option<Gains>,
}

impl<'a> Batch<'a> {
    /// Creates a batch of `count` series of `steps` plots each. Rows of `variance` contain one number,
    /// or one per plot; rows of `dt` contain one number, or one per plot but the first; rows of
    /// `initial` contain a mean and the rows of a covariance. Without `initial`, angle and rate are
    /// unknown at the start.
    ///
    /// # Errors
    /// If the period is not positive, or the model does not allow an interval.
    pub fn try_new(
        (z, steps, count): (&'a [f64], usize, usize),
        variance: Table<'a>,
        dt: Table<'a>,
        initial: Option<Table<'a>>,
        model: Singer,
        period: Option<f64>,
    ) -> Result<Self> {
        if let Some(period) = period {
            require_period(period)?;
        }
        let mut each = Vec::new();
        let transitions = if dt.is_single() {
            match model.over_all(dt.row(0), &mut each)? {
                PerStep::Constant(transition) => Transitions::Constant(transition),
                PerStep::Each(_) => Transitions::Each(each),
            }
        } else {
            Transitions::Own
        };
        Ok(Self { z, steps, count, variance, dt, initial, model, period, transitions })
    }

    /// Filters all series. `nanoseconds` is an estimate of the time this takes.
    ///
    /// # Errors
    /// If a series cannot be filtered, the error of the first such series: see [`Series::try_new`],
    /// [`State::try_new`] and [`Singer::over`].
    pub fn filter(
        &self,
        rows: &mut [Row<'_>],
        nanoseconds: f64,
        n_threads: Option<NonZero<usize>>,
    ) -> std::result::Result<(), RowError> {
        let common = self.common();
        let blocks = rows.chunks_mut(LANES).enumerate();
        let mut failed = vec![0; blocks.len()];
        let blocks = blocks.zip(&mut failed);
        let run = |buffers: &mut Buffers, ((block, rows), failed): ((usize, &mut [Row<'_>]), _)| {
            self.filter_rows(&common, block * LANES, rows, buffers, failed)
        };
        for_each_row(blocks, nanoseconds, n_threads, Buffers::default, run)
            .map_err(|error| RowError { row: failed[error.row], ..error })
    }

    /// Smooths all series and writes rows of means and covariances. `nanoseconds` is an estimate of the
    /// time this takes.
    ///
    /// # Errors
    /// As for [`Batch::filter`].
    pub fn smooth<'b>(
        &self,
        rows: impl ExactSizeIterator<Item = (&'b mut [f64], &'b mut [f64])> + Send,
        nanoseconds: f64,
        n_threads: Option<NonZero<usize>>,
    ) -> std::result::Result<(), RowError> {
        let new = || (Vec::new(), Workspace::default());
        let rows = rows.enumerate();
        for_each_row(rows, nanoseconds, n_threads, new, |(buffer, workspace), (row, out)| {
            let series = self.series(row, self.transitions(row, buffer)?)?;
            let (mean, covariance) = out;
            let mut steps = Steps { mean, covariance, innovation: &mut [], variance: &mut [] };
            smooth(&series, self.start(row)?, workspace, |step, state| {
                steps.put(step, state, Innovation::NONE, self.period);
            });
            Ok(())
        })
    }

    fn shared_transitions(&self) -> Option<PerStep<'_, Transition>> {
        match &self.transitions {
            Transitions::Constant(transition) => Some(PerStep::Constant(*transition)),
            Transitions::Each(each) => Some(PerStep::Each(each)),
            Transitions::Own => None,
        }
    }

    /// Returns the transitions of a series.
    fn transitions<'b>(
        &'b self,
        row: usize,
        buffer: &'b mut Vec<Transition>,
    ) -> Result<PerStep<'b, Transition>> {
        match self.shared_transitions() {
            Some(shared) => Ok(shared),
            None => self.model.over_all(self.dt.row(row), buffer),
        }
    }

    fn series<'b>(&'b self, row: usize, transition: PerStep<'b, Transition>) -> Result<Series<'b>> {
        let z = &self.z[row * self.steps..][..self.steps];
        Series::try_new(z, self.noise(row), transition)
    }

    fn noise(&self, row: usize) -> PerStep<'a, f64> {
        match self.variance.row(row) {
            [single] => PerStep::Constant(*single),
            each => PerStep::Each(each),
        }
    }

    /// Returns the filter before the first plot.
    fn start(&self, row: usize) -> Result<Filter> {
        let Some(initial) = &self.initial else {
            return Ok(Filter::new(self.model.acceleration_variance(), self.period));
        };
        let (rows, _) = initial.row(row).as_chunks::<3>();
        let state = State::try_new(rows[0], &[rows[1], rows[2], rows[3]])?;
        Ok(Filter::from_state(state, self.period))
    }

    fn common(&self) -> Common {
        let one_start = self.initial.as_ref().is_none_or(Table::is_one_row);
        let filter = if one_start && self.count > 0 { self.start(0).ok() } else { None };
        let gains = filter.and_then(|filter| self.gains(filter));
        Common { filter, gains }
    }

    /// Returns the gains if they are the same for all series without a missing plot.
    fn gains(&self, filter: Filter) -> Option<Gains> {
        if self.count < FEWEST_LANES || !self.variance.is_one_row() {
            return None;
        }
        let z = vec![0.0; self.steps];
        // errors in the input are reported later, for the first series
        let series = Series::try_new(&z, self.noise(0), self.shared_transitions()?).ok()?;
        Some(Gains::new(&series, filter))
    }

    /// Filters rows from row `first` on, side by side if there are several. If there is an error,
    /// `failed` is the row to which it belongs.
    fn filter_rows(
        &self,
        common: &Common,
        first: usize,
        rows: &mut [Row<'_>],
        buffers: &mut Buffers,
        failed: &mut usize,
    ) -> Result<()> {
        if let Some(transition) = self.shared_transitions()
            && rows.len() >= FEWEST_LANES
            && self.filter_block(common, transition, first, rows, &mut buffers.kept, failed)?
        {
            return Ok(());
        }
        for (i, row) in rows.iter_mut().enumerate() {
            *failed = first + i;
            let transitions = self.transitions(first + i, &mut buffers.transitions)?;
            let series = self.series(first + i, transitions)?;
            let filter = common.filter.map_or_else(|| self.start(first + i), Ok)?;
            row.end = End::new(&series.fill(filter, &mut row.steps), self.period);
        }
        Ok(())
    }

    /// Filters rows side by side. Returns false if they must be filtered one by one.
    fn filter_block(
        &self,
        common: &Common,
        transition: PerStep<'_, Transition>,
        first: usize,
        rows: &mut [Row<'_>],
        kept: &mut Vec<f64>,
        failed: &mut usize,
    ) -> Result<bool> {
        let mut series = Vec::with_capacity(LANES);
        let mut filters = Vec::with_capacity(LANES);
        for i in 0..rows.len() {
            *failed = first + i;
            // the block refuses what `Series::try_new` refuses
            let z = &self.z[(first + i) * self.steps..][..self.steps];
            series.push(Series { z, variance: self.noise(first + i), transition });
            filters.push(common.filter.map_or_else(|| self.start(first + i), Ok)?);
        }
        let mut out: Vec<_> = rows.iter_mut().map(|row| &mut row.steps).collect();
        let summaries = run_block(&series, &filters, common.gains.as_ref(), &mut out, kept);
        let Some(summaries) = summaries else { return Ok(false) };
        for (row, summary) in rows.iter_mut().zip(&summaries) {
            row.end = End::new(summary, self.period);
        }
        Ok(true)
    }
}
