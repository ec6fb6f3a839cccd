//! Standard deviations of range and azimuth over time, from the scatter about lines.

use super::lines::{FREE, Line};

/// Quantiles of χ² with [`FREE`] degrees of freedom, over their number: median, and 99.9 %.
const MEDIAN: f64 = 0.839174;
const LARGEST: f64 = 4.616710;
/// Least number of lines from which a standard deviation is estimated.
const FEWEST: usize = 4;
/// Number of rounds in which lines with an outlier are left out.
const ROUNDS: usize = 3;

/// A standard deviation and its standard error; nan if there are too few lines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// Standard deviation.
    pub value: f64,
    /// Standard error.
    pub sigma: f64,
}

/// The noise of a radar in range (m) and azimuth (rad).
#[derive(Clone, Debug, PartialEq)]
pub struct Noise {
    /// Noise of the whole recording.
    pub whole: [Level; 2],
    /// Noise in each stretch of time.
    pub stretches: Vec<[Level; 2]>,
}

/// Estimates the noise from all lines, and in the stretches of time between `edges`. The level is robust: it
/// starts from the median, and is then the mean of the values below the 99.9 % quantile of χ². For the whole
/// recording, stretches with too few lines are taken together.
pub fn noise(lines: &[Line], edges: &[f64]) -> Noise {
    let mut squares = vec![[(); 2].map(|()| Vec::new()); edges.len().saturating_sub(1)];
    for line in lines {
        let stretch = &mut squares[stretch_of(line.time, edges)];
        stretch[0].push(line.mean_square[0]);
        stretch[1].push(line.mean_square[1]);
    }
    let few = squares.iter().filter(|axes| axes[0].len() < FEWEST);
    let rest = [0, 1].map(|axis| {
        robust_mean(&mut few.clone().flat_map(|axes| &axes[axis]).copied().collect::<Vec<_>>())
    });
    let parts: Vec<[(f64, f64); 2]> =
        squares.into_iter().map(|axes| axes.map(|mut own| robust_mean(&mut own))).collect();
    let whole = [0, 1].map(|axis| {
        let parts = || parts.iter().chain([&rest]).map(|part| part[axis]);
        let known = || parts().filter(|(_, count)| *count > 0.0);
        let total: f64 = known().map(|(_, count)| count).sum();
        let value = (known().map(|(variance, count)| count * variance).sum::<f64>() / total).sqrt();
        // Var(mean square) = 2 σ⁴ / degrees of freedom
        let spread = 2.0
            * known().map(|(variance, count)| count * variance * variance).sum::<f64>()
            / (FREE * total * total);
        Level { value, sigma: spread.sqrt() / (2.0 * value) }
    });
    let level = |(variance, count): (f64, f64)| {
        let value = variance.sqrt();
        Level { value, sigma: value / (2.0 * FREE * count).sqrt() }
    };
    Noise { whole, stretches: parts.into_iter().map(|part| part.map(level)).collect() }
}

/// Index of the stretch of time between `edges` that contains a time; the first or last one if the time is
/// outside.
pub fn stretch_of(time: f64, edges: &[f64]) -> usize {
    let after = edges.partition_point(|&edge| edge <= time);
    after.saturating_sub(1).min(edges.len().saturating_sub(2))
}

/// Returns the mean of the squares without outliers and the number of squares; nan and 0 if there are too
/// few.
fn robust_mean(squares: &mut [f64]) -> (f64, f64) {
    if squares.len() < FEWEST {
        return (f64::NAN, 0.0);
    }
    squares.sort_by(f64::total_cmp);
    let n = squares.len();
    let mut level = 0.5 * (squares[(n - 1) / 2] + squares[n / 2]) / MEDIAN;
    let mut count = n;
    for _ in 0..ROUNDS {
        count = squares.partition_point(|&square| square <= LARGEST * level);
        level = squares[..count].iter().sum::<f64>() / count as f64;
    }
    (level, count as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outliers_do_not_count_and_few_lines_say_nothing() {
        let line = |time: f64, square: f64| Line { time, mean_square: [square, 4.0 * square] };
        let mut lines: Vec<Line> = (0..8).map(|k| line(f64::from(k), 25.0)).collect();
        lines.push(line(3.0, 1e6));
        lines.push(line(11.0, 25.0));
        let found = noise(&lines, &[0.0, 10.0, 20.0]);
        let [range, azimuth] = found.whole;
        assert_eq!((range.value, azimuth.value), (5.0, 10.0));
        assert!((range.sigma - 5.0 / 64.0_f64.sqrt()).abs() < 1e-12);
        assert_eq!(found.stretches[0][0], range);
        assert!(found.stretches[1][0].value.is_nan());
        assert!(noise(&[], &[0.0, 1.0]).whole[0].value.is_nan());
    }

    #[test]
    fn stretches_with_few_lines_count_together() {
        let line = |k: u32| Line { time: f64::from(k), mean_square: [25.0, 100.0] };
        let lines: Vec<Line> = (0..9).map(line).collect();
        let found = noise(&lines, &[0.0, 3.0, 6.0, 9.0]);
        assert_eq!(found.whole.map(|level| level.value), [5.0, 10.0]);
        assert!((found.whole[0].sigma - 5.0 / 72.0_f64.sqrt()).abs() < 1e-12);
        assert!(found.stretches.iter().flatten().all(|level| level.value.is_nan()));
    }
}
