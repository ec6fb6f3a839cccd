//! Hypotheses about the noise levels of a step, stored by field for SIMD vectors.

use super::levels::{EXCESSES, MANOEUVRES};
use crate::base::exponential::exp;

/// Levels of a plot, rounded up to a row that fills whole vectors.
const LANES: usize = 8;
/// One number for each level of a plot; elements beyond the last level have no weight.
pub(super) type Row = [f64; LANES];
/// Largest number of hypotheses that are followed from one plot of a step to the next.
pub(super) const FOLLOWED: usize = 12;
/// Hypotheses with at most this share of the largest probability are not followed.
const NEGLIGIBLE: f64 = 1e-5;

/// The hypotheses that are followed from one plot to the next.
#[derive(Clone, Copy, Debug)]
pub(super) struct Followed {
    pub count: usize,
    /// Probability of levels and plots, relative to that of the most probable hypothesis.
    pub weight: [f64; FOLLOWED],
    /// Mean of e, the error of the predicted angle; its variance is below.
    pub mean: [f64; FOLLOWED],
    pub variance: [f64; FOLLOWED],
    pub component: [u8; FOLLOWED],
    /// Index of the hypothesis before the last plot.
    pub parent: [u8; FOLLOWED],
    /// Level of the last plot, or level of the prediction before the first plot.
    pub level: [u8; FOLLOWED],
}

/// The hypotheses after a plot: for each hypothesis before the plot, a row with the levels of the plot.
#[derive(Clone, Debug)]
pub(super) struct Spread {
    rows: usize,
    /// Weights as in [`Followed`]; 0 if negligible.
    weight: [Row; FOLLOWED],
    /// Squared distance of the plot divided by its variance.
    square: [Row; FOLLOWED],
    mean: [Row; FOLLOWED],
    variance: [Row; FOLLOWED],
}

/// `a.min(b)` as a single instruction; returns b if either is nan.
#[inline(always)]
fn smaller(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// Largest of the numbers; 0 if none is positive.
#[inline(always)]
pub(super) fn largest(rows: &[Row]) -> f64 {
    let mut most = Row::default();
    for row in rows {
        for l in 0..LANES {
            most[l] = if row[l] > most[l] { row[l] } else { most[l] };
        }
    }
    let mut largest = 0.0;
    for most in most {
        largest = if most > largest { most } else { largest };
    }
    largest
}

/// Adds the elements in order, so that the result does not depend on the length of the vectors.
#[inline(always)]
pub(super) fn sum(row: &Row) -> f64 {
    let mut sum = 0.0;
    for value in row {
        sum += value;
    }
    sum
}

impl Followed {
    pub const NONE: Self = Self {
        count: 0,
        weight: [0.0; FOLLOWED],
        mean: [0.0; FOLLOWED],
        variance: [0.0; FOLLOWED],
        component: [0; FOLLOWED],
        parent: [0; FOLLOWED],
        level: [0; FOLLOWED],
    };

    /// Adds a hypothesis about the prediction; `e` is the mean and variance of its error.
    pub fn begin(&mut self, component: usize, level: usize, weight: f64, e: (f64, f64)) {
        let i = self.count;
        (self.component[i], self.level[i]) = (component as u8, level as u8);
        (self.weight[i], (self.mean[i], self.variance[i])) = (weight, e);
        self.count += 1;
    }

    /// Sums numbers of the hypotheses by the level of the last plot, and by the hypothesis before that plot.
    #[inline(always)]
    fn back(&self, numbers: &[f64; FOLLOWED], of_levels: &mut [f64]) -> [f64; FOLLOWED] {
        let mut of_parents = [0.0; FOLLOWED];
        for (i, number) in numbers[..self.count].iter().enumerate() {
            of_levels[usize::from(self.level[i])] += number;
            of_parents[usize::from(self.parent[i])] += number;
        }
        of_parents
    }

    /// Selects the most probable hypotheses after a plot; `before` are the hypotheses before the plot.
    #[inline(always)]
    pub fn choose(&mut self, spread: &Spread, before: &Self) {
        let bound = spread.cut();
        let mut places = [0_u8; FOLLOWED * LANES];
        let mut count = 0;
        for (row, weights) in spread.weights().iter().enumerate() {
            for (level, &weight) in weights[..EXCESSES.len()].iter().enumerate() {
                places[count] = (LANES * row + level) as u8;
                count += usize::from(weight > bound);
            }
        }
        self.count = count.min(FOLLOWED);
        for (i, &place) in places[..self.count].iter().enumerate() {
            let (row, level) = (usize::from(place) / LANES, usize::from(place) % LANES);
            self.weight[i] = spread.weight[row][level];
            self.mean[i] = spread.mean[row][level];
            self.variance[i] = spread.variance[row][level];
            self.component[i] = before.component[row];
            (self.parent[i], self.level[i]) = (row as u8, level as u8);
        }
    }
}

/// Sums numbers of the hypotheses after the last plot by the levels of each plot and of the prediction.
/// `followed` contains the hypotheses before each plot.
#[inline(always)]
pub(super) fn trace(
    followed: &[Followed],
    numbers: &[Row],
    of_plots: &mut [[f64; EXCESSES.len()]],
    of_prediction: &mut [f64; MANOEUVRES.len()],
) {
    let Some((last, of_plots)) = of_plots.split_last_mut() else { return };
    let mut of_parents = [0.0; FOLLOWED];
    let mut of_levels = Row::default();
    for (parent, numbers) in of_parents.iter_mut().zip(numbers) {
        for l in 0..LANES {
            of_levels[l] += numbers[l];
        }
        *parent = sum(numbers);
    }
    last.copy_from_slice(&of_levels[..EXCESSES.len()]);
    for (of_plot, followed) in of_plots.iter_mut().zip(&followed[1..]).rev() {
        of_parents = followed.back(&of_parents, of_plot);
    }
    followed[0].back(&of_parents, of_prediction);
}

impl Spread {
    pub const NONE: Self = {
        let none = [[0.0; LANES]; FOLLOWED];
        Self { rows: 0, weight: none, square: none, mean: none, variance: none }
    };

    /// Returns the weights, row by row.
    #[inline(always)]
    pub fn weights(&self) -> &[Row] {
        &self.weight[..self.rows]
    }

    /// Returns means and variances of e, row by row.
    #[inline(always)]
    pub fn errors(&self) -> impl Iterator<Item = (&Row, &Row)> {
        self.mean.iter().zip(&self.variance).take(self.rows)
    }

    /// Mean and variance of e under one hypothesis.
    #[inline(always)]
    pub fn error(&self, row: usize, level: usize) -> (f64, f64) {
        (self.mean[row][level], self.variance[row][level])
    }

    /// Combines a plot of variance r with the hypotheses before it. `chances` contains the probabilities of
    /// the plot's levels in each component.
    #[inline(always)]
    pub fn fill(&mut self, before: &Followed, innovation: f64, r: f64, chances: &[Row]) {
        self.rows = before.count;
        let mut noise = [r; LANES];
        for (noise, excess) in noise.iter_mut().zip(EXCESSES) {
            *noise *= excess;
        }
        let mut least = [f64::INFINITY; LANES];
        for i in 0..self.rows {
            let (weight, mean, variance) = (before.weight[i], before.mean[i], before.variance[i]);
            let chance = &chances[usize::from(before.component[i])];
            let away = innovation - mean;
            for l in 0..LANES {
                let s = 1.0 / (variance + noise[l]);
                let share = variance * s;
                let weight = weight * chance[l] * s.sqrt();
                // overflows for a distant plot
                let square = smaller(away * away * s, f64::MAX);
                let possible = if weight > 0.0 { square } else { f64::INFINITY };
                least[l] = smaller(possible, least[l]);
                (self.weight[i][l], self.square[i][l]) = (weight, square);
                (self.mean[i][l], self.variance[i][l]) = (mean + share * away, share * noise[l]);
            }
        }
        self.weigh(&least);
    }

    /// Multiplies the weights by the likelihoods of the plot, and divides them by the largest.
    #[inline(always)]
    fn weigh(&mut self, least: &Row) {
        let mut first = f64::INFINITY;
        for &least in least {
            first = smaller(least, first);
        }
        for i in 0..self.rows {
            for l in 0..LANES {
                self.weight[i][l] *= exp(0.5 * (first - self.square[i][l]));
            }
        }
        let most = largest(self.weights());
        for i in 0..self.rows {
            for l in 0..LANES {
                let weight = self.weight[i][l] / most;
                self.weight[i][l] = if weight > NEGLIGIBLE { weight } else { 0.0 };
            }
        }
    }

    /// Bound that at most [`FOLLOWED`] weights exceed, by bisection over the bits of positive numbers,
    /// whose order is that of the numbers.
    #[inline(always)]
    fn cut(&self) -> f64 {
        if self.above(0.0) <= FOLLOWED as u64 {
            return 0.0;
        }
        let (mut low, mut high) = (NEGLIGIBLE.to_bits(), 1.0_f64.to_bits());
        while high - low > 1 {
            let middle = low + (high - low) / 2;
            match self.above(f64::from_bits(middle)).cmp(&(FOLLOWED as u64)) {
                std::cmp::Ordering::Greater => low = middle,
                std::cmp::Ordering::Less => high = middle,
                std::cmp::Ordering::Equal => return f64::from_bits(middle),
            }
        }
        f64::from_bits(high)
    }

    /// Number of weights above the bound.
    #[inline(always)]
    fn above(&self, bound: f64) -> u64 {
        let mut count = [0; LANES];
        for weights in self.weights() {
            for l in 0..LANES {
                count[l] += u64::from(weights[l] > bound);
            }
        }
        count.iter().sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;

    /// Two hypotheses about the prediction, and three plots of variance 1.
    fn followed() -> ([Followed; 3], Spread) {
        let mut followed = [Followed::NONE; 3];
        followed[0].begin(0, 0, 0.999, (0.0, 1.0));
        followed[0].begin(0, 1, 0.001, (0.0, 64.0));
        let chances = [[0.125, 0.5, 0.125, 0.125, 0.12, 0.005, 0.0, 0.0]];
        let mut last = Spread::NONE;
        for (at, innovation) in [0.3, -0.8, 2.0].into_iter().enumerate() {
            last.fill(&followed[at], innovation, 1.0, &chances);
            if let [before, after, ..] = &mut followed[at..] {
                after.choose(&last, before);
            }
        }
        (followed, last)
    }

    #[test]
    fn the_most_probable_are_followed() {
        let (mut followed, last) = followed();
        assert_eq!(followed[2].count, FOLLOWED);
        let before = followed[2];
        followed[0].choose(&last, &before);
        let mut weights: Vec<f64> = last.weights().as_flattened().to_vec();
        weights.sort_by(|a, b| b.total_cmp(a));
        let mut chosen = followed[0].weight;
        chosen.sort_by(|a, b| b.total_cmp(a));
        assert_eq!(chosen, weights[..FOLLOWED]);
        assert_eq!(weights[0], 1.0);
    }

    /// The sum over the levels of any plot is the sum over all hypotheses.
    #[test]
    fn nothing_is_lost_on_the_way_back() {
        let (followed, last) = followed();
        let total: f64 = last.weights().iter().map(sum).sum();
        let (mut of_plots, mut of_prediction) = ([[0.0; EXCESSES.len()]; 3], [0.0; 2]);
        trace(&followed, last.weights(), &mut of_plots, &mut of_prediction);
        for of_levels in of_plots {
            assert_within(1e-14, of_levels.iter().sum(), total);
        }
        assert_within(1e-14, of_prediction.iter().sum(), total);
    }

    /// Plots at extreme distances neither overflow nor fail.
    #[test]
    fn plots_as_far_as_can_be() {
        let mut first = Followed::NONE;
        first.begin(0, 0, 1.0, (0.0, 1e-100));
        let mut last = Spread::NONE;
        last.fill(&first, 1e150, 1e-100, &[[0.125; LANES]]);
        assert!(largest(last.weights()) == 1.0);
    }
}
