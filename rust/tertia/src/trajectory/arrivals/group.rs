//! Grouping of arrivals into emissions if the clocks of the receivers are not synchronised.
//!
//! Receivers join one after the other. Those that have joined give a list of emissions of each identity. The
//! differences between the arrivals at a further receiver and this list have a narrow peak at the offset of
//! its clock, because the intervals between emissions are irregular. A robust line through the peak gives the
//! rate of the clock. The times on one clock are then divided into emissions wherever a gap is larger than
//! the width of the peaks.

/// Reading of a clock less that of the first receiver: `offset + rate (t - origin)`, where t is the reading
/// of the clock.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Line {
    /// Seconds.
    pub offset: f64,
    /// Seconds per second.
    pub rate: f64,
    /// Seconds.
    pub origin: f64,
}

/// Clocks that share emissions, roughly aligned.
#[derive(Clone, Debug)]
pub struct Alignment {
    /// Line of each receiver; none if it shares too few emissions with the others.
    pub lines: Vec<Option<Line>>,
    /// Largest distance of matching arrivals from the lines, in seconds.
    pub width: f64,
}

/// Largest number of differences that are compared, for each receiver.
const PAIRS: f64 = 2e6;
/// A peak stands out from its surroundings if the logarithm of its likelihood ratio exceeds the logarithm of
/// the number of differences by at least this.
const MARGIN: f64 = 6.0;
/// Largest number of windows of each size that are examined.
const NARROWEST: usize = 256;
/// Neighbourhood of a peak, in widths of the peak.
const AROUND: f64 = 10.0;
/// Peaks with at least this share of the best score are compared by identities.
const RIVAL: f64 = 0.3;
/// Identities favour a peak if this is the lead of the logarithm of its likelihood ratio.
const TOLD: f64 = 6.0;
/// Of the peaks that identities do not distinguish and that have at least this share of the largest number of
/// matches, the one with the smallest offset is chosen.
const ALIKE: f64 = 0.75;
const LINES: usize = 4;
const REWEIGHTED: usize = 20;

impl Line {
    /// Returns the time of the first receiver's clock at this reading.
    pub fn corrected(&self, time: f64) -> f64 {
        time - self.offset - self.rate * (time - self.origin)
    }

    /// Returns the same clock relative to that of another receiver.
    #[must_use]
    pub fn relative_to(&self, base: &Line) -> Self {
        let offset = self.origin - base.reading(self.origin - self.offset);
        Self { offset, rate: 1.0 - (1.0 - self.rate) / (1.0 - base.rate), origin: self.origin }
    }

    /// Returns the reading at this time of the first receiver's clock.
    pub fn reading(&self, time: f64) -> f64 {
        (time + self.offset - self.rate * self.origin) / (1.0 - self.rate)
    }
}

/// Aligns the clocks by arrivals with equal labels. Cost N log N plus the number of pairs compared, for each
/// receiver.
pub fn align(time: &[f64], sensor: &[usize], label: &[usize], k: usize) -> Alignment {
    let labels = label.iter().max().map_or(0, |last| last + 1);
    let mut own = vec![vec![Vec::new(); labels]; k];
    let mut counts = vec![0_usize; k];
    for ((&time, &sensor), &label) in time.iter().zip(sensor).zip(label) {
        own[sensor][label].push(time);
        counts[sensor] += 1;
    }
    for times in own.iter_mut().flatten() {
        times.sort_by(f64::total_cmp);
    }
    let (low, high) = time
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &t| (low.min(t), high.max(t)));
    let span = (high - low).max(f64::MIN_POSITIVE);
    let mut waiting: Vec<usize> = (0..k).filter(|&at| counts[at] > 0).collect();
    waiting.sort_by_key(|&at| std::cmp::Reverse(counts[at]));
    let mut lines = vec![None; k];
    let mut width = 0.0_f64;
    if waiting.is_empty() {
        return Alignment { lines, width };
    }
    let first = waiting.remove(0);
    lines[first] = Some(Line::default());
    let mut known = own[first].clone();
    while let Some((at, line, reach)) = waiting.iter().enumerate().find_map(|(at, &receiver)| {
        let (line, reach) = peak_line(&known, &own[receiver], span)?;
        Some((at, line, reach))
    }) {
        let receiver = waiting.remove(at);
        (lines[receiver], width) = (Some(line), width.max(reach));
        for (known, times) in known.iter_mut().zip(&own[receiver]) {
            join(known, times.iter().map(|&t| line.corrected(t)), reach);
        }
    }
    Alignment { lines, width }
}

/// Returns the numbers of the emissions of arrivals at aligned clocks, in no particular order. Arrivals at a
/// clock that is not aligned have none, and neither have the later arrivals (echoes) of an emission at the
/// same receiver. Arrivals of one emission are at most `spread` apart, or as far as the uncertainty of the
/// lines allows.
pub fn group(
    alignment: &Alignment,
    time: &[f64],
    sensor: &[usize],
    identity: &[usize],
    spread: f64,
) -> Vec<Option<usize>> {
    let gap = (0.5 * alignment.width).max(spread);
    let mut order: Vec<(usize, f64, usize)> = (0..time.len())
        .filter_map(|at| {
            let line = alignment.lines[sensor[at]]?;
            Some((identity[at], line.corrected(time[at]), at))
        })
        .collect();
    order.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let mut emission = vec![None; time.len()];
    let mut last_heard = vec![usize::MAX; alignment.lines.len()];
    let mut number = 0;
    for (i, &(name, t, at)) in order.iter().enumerate() {
        if i > 0 && (order[i - 1].0 != name || t - order[i - 1].1 > gap) {
            number += 1;
        }
        if last_heard[sensor[at]] != number {
            (last_heard[sensor[at]], emission[at]) = (number, Some(number));
        }
    }
    emission
}

/// Adds emissions that are farther than `reach` from all known ones.
fn join(known: &mut Vec<f64>, times: impl Iterator<Item = f64>, reach: f64) {
    let before = known.len();
    for time in times {
        let at = known[..before].partition_point(|&t| t < time);
        let near = |at: usize| known[..before].get(at).is_some_and(|t| (t - time).abs() <= reach);
        if !(near(at) || at > 0 && near(at - 1)) {
            known.push(time);
        }
    }
    known.sort_by(f64::total_cmp);
}

/// Returns the line through the peak of the differences, and the largest distance of its points from the
/// line.
fn peak_line(known: &[Vec<f64>], own: &[Vec<f64>], span: f64) -> Option<(Line, f64)> {
    let all: f64 = known.iter().zip(own).map(|(a, b)| a.len() as f64 * b.len() as f64).sum();
    let range = span * (PAIRS / all.max(1.0)).min(1.0);
    // (reading, difference)
    let mut points = Vec::new();
    for (known, own) in known.iter().zip(own) {
        for &t in own {
            let from = known.partition_point(|&other| other < t - range);
            let near = known[from..].iter().take_while(|&&other| other <= t + range);
            points.extend(near.map(|&other| (t, t - other)));
        }
    }
    points.sort_by(|a, b| a.1.total_cmp(&b.1));
    let differences: Vec<f64> = points.iter().map(|point| point.1).collect();
    let most = own.iter().map(Vec::len).sum();
    let (low, high) = told_apart(&peaks(&differences, most, range), known, own)?;
    let resolution = differences[differences.len() - 1].abs().max(span) * f64::EPSILON * 64.0;
    let mut width = (high - low).max(resolution);
    let mut line = Line { offset: 0.5 * (low + high), ..Line::default() };
    for _ in 0..LINES {
        let near: Vec<(f64, f64)> =
            points.iter().copied().filter(|point| distance(&line, point) <= width).collect();
        if near.is_empty() {
            // sums of the times are beyond the largest number
            return None;
        }
        line = robust_line(&near);
        let mut distances: Vec<f64> = near.iter().map(|point| distance(&line, point)).collect();
        distances.sort_by(f64::total_cmp);
        width = (4.0 * distances[(distances.len() - 1) * 9 / 10]).max(resolution);
    }
    Some((line, width))
}

fn distance(line: &Line, point: &(f64, f64)) -> f64 {
    (point.1 - line.offset - line.rate * (point.0 - line.origin)).abs()
}

/// A window of sorted values that stands out from its surroundings.
#[derive(Clone, Copy, Debug)]
struct Peak {
    score: f64,
    low: f64,
    high: f64,
}

impl Peak {
    fn middle(&self) -> f64 {
        0.5 * (self.low + self.high)
    }

    fn width(&self) -> f64 {
        self.high - self.low
    }
}

/// Returns the windows of at most `most` sorted values that stand out most from their surroundings: the best,
/// and those elsewhere whose score is not far below the best.
fn peaks(values: &[f64], most: usize, range: f64) -> Vec<Peak> {
    let n = values.len();
    let floor = range * f64::EPSILON * 64.0;
    let (mut least, mut found) = ((n as f64).ln() + MARGIN, Vec::new());
    let mut k = n.min(most);
    let mut narrow: Vec<usize> = Vec::new();
    // the expected number in the surroundings is at least 1 / (AROUND - 1)
    while k >= 3 && k as f64 * ((k as f64 * (AROUND - 1.0)).ln() - 1.0) > least {
        let width = |i: usize| values[i + k - 1] - values[i];
        narrow.clear();
        // the narrowest of the windows that overlap, so that all peaks of equal height are examined
        let starts = (0..=n - k).step_by(k).map(|from| from..(from + k).min(n - k + 1));
        narrow.extend(starts.filter_map(|mut own| {
            let first = own.next()?;
            Some(own.fold(first, |best, i| if width(i) < width(best) { i } else { best }))
        }));
        if narrow.len() > NARROWEST {
            narrow.select_nth_unstable_by(NARROWEST, |&a, &b| width(a).total_cmp(&width(b)));
            narrow.truncate(NARROWEST);
        }
        for &i in &narrow {
            let wide = width(i).max(floor) * (k + 1) as f64 / (k - 1) as f64;
            let (middle, half) = (values[i] + 0.5 * width(i), 0.5 * AROUND * wide);
            let before = values.partition_point(|&v| v < middle - half);
            let after = values.partition_point(|&v| v <= middle + half);
            let others = ((after - before - k) as f64).max(1.0) / (AROUND - 1.0);
            let count = k as f64;
            let score = if count > others { excess(count, others) } else { 0.0 };
            if score > least {
                found.push(Peak { score, low: values[i], high: values[i + k - 1] });
                least = least.max(RIVAL * score);
            }
        }
        k = (k - 1).min(k * 4 / 5);
    }
    found.retain(|peak| peak.score >= least);
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut apart: Vec<Peak> = Vec::new();
    for peak in found {
        let is_same = |other: &Peak| {
            (peak.middle() - other.middle()).abs() <= peak.width().max(other.width())
        };
        if !apart.iter().any(is_same) {
            apart.push(peak);
        }
    }
    apart
}

/// Logarithm of the likelihood ratio of an observed count to the expected one.
fn excess(count: f64, expected: f64) -> f64 {
    count * (count / expected).ln() - count + expected
}

/// Returns the ends of the peak at the offset of the clock, if there is a peak. An identity with a constant
/// interval has equally many matches at each multiple of the interval. Therefore the score of a peak is the
/// excess of the matches of each identity over those at most peaks.
fn told_apart(peaks: &[Peak], known: &[Vec<f64>], own: &[Vec<f64>]) -> Option<(f64, f64)> {
    if peaks.is_empty() {
        return None;
    }
    let reach = peaks.iter().map(Peak::width).fold(0.0, f64::max);
    let (mut scores, mut totals) = (vec![0.0; peaks.len()], vec![0.0; peaks.len()]);
    for (known, own) in known.iter().zip(own) {
        let counts: Vec<f64> =
            peaks.iter().map(|peak| matched(known, own, peak.middle(), reach)).collect();
        let mut sorted = counts.clone();
        sorted.sort_by(f64::total_cmp);
        let usual = sorted[(counts.len() - 1) / 2].max(1.0);
        for (at, &count) in counts.iter().enumerate() {
            totals[at] += count;
            scores[at] += if count > usual { excess(count, usual) } else { 0.0 };
        }
    }
    let best = scores.iter().copied().fold(0.0, f64::max);
    let told = |at: &usize| scores[*at] >= best - TOLD;
    let most = (0..peaks.len()).filter(told).map(|at| totals[at]).fold(0.0, f64::max);
    let alike = (0..peaks.len()).filter(told).filter(|&at| totals[at] >= ALIKE * most);
    let offset = |at: usize| peaks[at].middle().abs();
    let nearest = alike.min_by(|&a, &b| offset(a).total_cmp(&offset(b)))?;
    Some((peaks[nearest].low, peaks[nearest].high))
}

/// Number of arrivals that are within `reach` of a known emission if the clock has this offset.
fn matched(known: &[f64], own: &[f64], offset: f64, reach: f64) -> f64 {
    let is_near = |&&t: &&f64| {
        let from = known.partition_point(|&other| other < t - offset - reach);
        known.get(from).is_some_and(|&other| other <= t - offset + reach)
    };
    own.iter().filter(is_near).count() as f64
}

/// Returns the line with the least sum of distances, by reweighted least squares.
fn robust_line(points: &[(f64, f64)]) -> Line {
    let origin = points.iter().map(|point| point.0).sum::<f64>() / points.len() as f64;
    let middle = points[points.len() / 2].1;
    let mut weights = vec![1.0; points.len()];
    let mut line = Line { offset: middle, rate: 0.0, origin };
    for _ in 0..REWEIGHTED {
        let (mut w, mut x, mut y, mut xx, mut xy) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (&(t, value), &weight) in points.iter().zip(&weights) {
            let (t, value) = (t - origin, value - middle);
            w += weight;
            x += weight * t;
            y += weight * value;
            xx += weight * t * t;
            xy += weight * t * value;
        }
        let determinant = w * xx - x * x;
        line.rate = if determinant > 1e-12 * w * xx { (w * xy - x * y) / determinant } else { 0.0 };
        line.offset = middle + (y - line.rate * x) / w;
        let mut sizes: Vec<f64> = points.iter().map(|point| distance(&line, point)).collect();
        for (weight, size) in weights.iter_mut().zip(&sizes) {
            *weight = *size;
        }
        sizes.sort_by(f64::total_cmp);
        let floor = 1e-3 * sizes[sizes.len() / 2] + f64::MIN_POSITIVE;
        if sizes[sizes.len() - 1] <= floor {
            break;
        }
        for weight in &mut weights {
            *weight = floor / weight.max(floor);
        }
    }
    line
}
