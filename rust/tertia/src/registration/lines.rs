//! Scatter of plots about short straight lines in the track of one radar.

/// Number of plots on a line.
const COUNT: usize = 6;
/// Number of plots on a line less the parameters of the line, in each axis.
pub(super) const FREE: f64 = 4.0;
/// Largest duration of a line relative to that without gaps.
const GAPS: f64 = 1.5;
/// Probability of a turn above which a track is not straight.
const STRAIGHT: f64 = 0.5;

/// A plot that has updated a track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PolarPlot {
    /// Number of the track.
    pub track: i64,
    /// Probability that the target turns.
    pub turn_probability: f64,
    /// Time of the row of the track, by which its plots are ordered, s.
    pub row_time: f64,
    /// Seconds.
    pub time: f64,
    /// Slant range, metres.
    pub range: f64,
    /// Radians, clockwise from north.
    pub azimuth: f64,
    /// Height above the radar, metres; nan if unknown.
    pub height: f64,
}

/// Scatter of six successive plots of a track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// Mean time of the plots.
    pub time: f64,
    /// Mean squares about the line in range (m²) and azimuth (rad²).
    pub mean_square: [f64; 2],
}

/// Returns the lines through each six successive plots of a track that is straight and has no long gap. If
/// some plots have heights, those without are left out: their slant range cannot be converted to ground
/// range.
pub fn lines(mut plots: Vec<PolarPlot>, azimuth_sigma: f64, scan_period: f64) -> Vec<Line> {
    if plots.iter().any(|plot| plot.height.is_finite()) {
        plots.retain(|plot| plot.height.is_finite());
    }
    plots.sort_by(|a, b| a.track.cmp(&b.track).then(a.row_time.total_cmp(&b.row_time)));
    plots
        .chunk_by(|a, b| a.track == b.track)
        .flat_map(|own| own.as_chunks::<COUNT>().0)
        .filter_map(|six| line(six, azimuth_sigma, scan_period))
        .collect()
}

fn line(plots: &[PolarPlot; COUNT], azimuth_sigma: f64, scan_period: f64) -> Option<Line> {
    let times = plots.map(|plot| plot.time);
    let last = times.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let first = times.iter().copied().fold(f64::INFINITY, f64::min);
    let is_straight = plots.iter().all(|plot| plot.turn_probability < STRAIGHT);
    if !is_straight || last - first >= GAPS * COUNT as f64 * scan_period {
        return None;
    }
    // averaging over the noise of the azimuth shortens the position vector by exp(−σ²/2)
    let unbiased = (0.5 * azimuth_sigma * azimuth_sigma).exp();
    let points = plots.map(|plot| {
        let height = if plot.height.is_nan() { 0.0 } else { plot.height };
        let ground = (plot.range * plot.range - height * height).max(0.0).sqrt() * unbiased;
        let (sine, cosine) = plot.azimuth.sin_cos();
        [ground * sine, ground * cosine]
    });
    let n = COUNT as f64;
    let mean_time = times.iter().sum::<f64>() / n;
    let since = times.map(|time| time - mean_time);
    let squares = since.iter().map(|t| t * t).sum::<f64>().max(1e-9);
    let fit = |axis: usize| {
        let centre = points.iter().map(|p| p[axis]).sum::<f64>() / n;
        let slope = since.iter().zip(&points).map(|(t, p)| t * p[axis]).sum::<f64>() / squares;
        (centre, slope)
    };
    let [(east, east_rate), (north, north_rate)] = [fit(0), fit(1)];
    let mut sums = [0.0; 2];
    for (t, p) in since.iter().zip(&points) {
        let fitted = [east + t * east_rate, north + t * north_rate];
        let distance = fitted[0].hypot(fitted[1]).max(1.0);
        let toward = fitted.map(|x| x / distance);
        let off = [p[0] - fitted[0], p[1] - fitted[1]];
        let along = toward[0] * off[0] + toward[1] * off[1];
        let across = (toward[1] * off[0] - toward[0] * off[1]) / distance;
        sums = [sums[0] + along * along, sums[1] + across * across];
    }
    Some(Line { time: mean_time, mean_square: sums.map(|sum| sum / FREE) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plots(count: usize) -> Vec<PolarPlot> {
        (0..count)
            .map(|k| {
                let (x, y) = (1e4 + 800.0 * k as f64, 5e4);
                let (range, azimuth) = (x.hypot(y), x.atan2(y));
                let (time, height) = (4.0 * k as f64, f64::NAN);
                let (track, turn_probability, row_time) = (1, 0.0, time);
                PolarPlot { track, turn_probability, row_time, time, range, azimuth, height }
            })
            .collect()
    }

    #[test]
    fn a_straight_flight_has_no_scatter() {
        let found = lines(plots(15), 0.0, 4.0);
        assert_eq!(found.len(), 2);
        assert_eq!(found[0].time, 10.0);
        assert!(found.iter().all(|line| line.mean_square[0] < 1e-12), "{found:?}");
    }

    #[test]
    fn an_error_of_range_is_no_error_of_azimuth() {
        let mut plots = plots(6);
        plots[2].range += 90.0;
        let [range, azimuth] = lines(plots.clone(), 0.0, 4.0)[0].mean_square;
        assert!(range > 500.0 && azimuth.sqrt() * 5e4 < 1.0, "{range} {azimuth}");
        // gaps, turns and unknown heights are left out
        assert!(lines(plots.clone(), 0.0, 2.0).is_empty());
        plots[5].turn_probability = 0.6;
        assert!(lines(plots.clone(), 0.0, 4.0).is_empty());
        plots[5].turn_probability = 0.0;
        plots[0].height = 100.0;
        assert!(lines(plots, 0.0, 4.0).is_empty());
    }
}
