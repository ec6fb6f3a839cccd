//! Association of the plots of one scan with tracks: gates, scores, assignment.

use super::assignment::Assigner;
use super::gate::{self, Gated, Scan};
use super::pair::Pair;
use super::score::{self, PaperScore, Surroundings};
use crate::base::error::Result;

/// Score of a pair.
#[derive(Clone, Copy, Debug)]
pub enum Scoring {
    /// The log-likelihood ratio; the gain is the ratio minus the log-likelihood of a missed detection.
    Likelihood(Surroundings),
    /// The paper's score with this ratio; the gain is the score minus that at the edge of the gate.
    Paper(f64),
}

/// Plots assigned to tracks.
#[derive(Clone, Debug, PartialEq)]
pub struct Association {
    /// Plot of each track.
    pub plot_of_track: Vec<Option<u32>>,
    /// Score of this plot; nan if there is none.
    pub score: Vec<f64>,
    /// Normalised innovation squared of this plot; nan if there is none.
    pub nis: Vec<f64>,
}

/// Assigns plots to the tracks in whose gates they are: for the largest sum of the gains if `is_global`,
/// otherwise the best remaining pair first. Cost as [`gate::pairs`] and [`Assigner`].
///
/// # Errors
/// As [`gate::pairs`], or a ratio that is not above 1.
pub fn associate<const M: usize>(
    scan: &Scan<'_>,
    threshold: f64,
    scoring: Scoring,
    is_global: bool,
) -> Result<Association> {
    let found = gate::pairs::<M>(scan, threshold)?;
    let size = [scan.predicted.len() / M, scan.plots.len() / M];
    match scoring {
        Scoring::Likelihood(surroundings) => {
            let density = |g: &Gated| score::log_density(g.nis, g.ln_determinant, M);
            let worth = |g: &Gated| surroundings.likelihood(density(g));
            Ok(assigned(&found, size, worth, surroundings.missed(), is_global))
        }
        Scoring::Paper(q) => {
            let paper = PaperScore::new(q, M)?;
            Ok(assigned(&found, size, |g| paper.of(g.nis), paper.of(threshold), is_global))
        }
    }
}

/// Assigns this number of tracks and plots; the gain of a pair is its worth minus a base.
fn assigned(
    found: &[Gated],
    [tracks, plots]: [usize; 2],
    worth: impl Fn(&Gated) -> f64,
    base: f64,
    is_global: bool,
) -> Association {
    let pair = |g: &Gated| Pair { row: g.track, column: g.plot, gain: worth(g) - base };
    let mut assigner = Assigner::default();
    let plot_of_track = if is_global {
        assigner.assign_all(found.iter().map(pair), tracks, plots).to_vec()
    } else {
        let pairs: Vec<_> = found.iter().map(pair).collect();
        assigner.nearest(&pairs, tracks, plots).to_vec()
    };
    let (mut score, mut nis) = (vec![f64::NAN; tracks], vec![f64::NAN; tracks]);
    for (track, plot) in plot_of_track.iter().enumerate() {
        let Some(plot) = plot else { continue };
        // pairs are sorted by track and plot
        let at = found.partition_point(|g| (g.track as usize, g.plot) < (track, *plot));
        (score[track], nis[track]) = (worth(&found[at]), found[at].nis);
    }
    Association { plot_of_track, score, nis }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_of_two_plots_goes_to_the_second_track() {
        let scan = Scan {
            predicted: &[0.0, 0.0, 3.0, 0.0],
            covariance: &[1.0, 0.0, 0.0, 1.0].repeat(2),
            plots: &[0.9, 0.0, 0.0, 0.5, 80.0, 0.0],
            plot_covariance: None,
        };
        let likelihood = Scoring::Likelihood(Surroundings::new(0.9, 1e-3).unwrap());
        for scoring in [likelihood, Scoring::Paper(2.0)] {
            let found = associate::<2>(&scan, 12.4, scoring, true).unwrap();
            assert_eq!(found.plot_of_track, [Some(1), Some(0)]);
            assert!((found.nis[0] - 0.25).abs() < 1e-15 && (found.nis[1] - 4.41).abs() < 1e-14);
        }
        let greedy = associate::<2>(&scan, 12.4, likelihood, false).unwrap();
        assert_eq!(greedy.plot_of_track[0], Some(1));
        assert!(associate::<2>(&scan, 12.4, Scoring::Paper(0.5), true).is_err());
    }
}
