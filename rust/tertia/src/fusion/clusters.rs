//! Clusters of hypotheses that agree on the error of the prediction.

use super::hypotheses::{Followed, Row, Spread, largest, sum};

/// Two hypotheses disagree if their squared distance exceeds this multiple of the sum of their variances.
const DISAGREEMENT: f64 = 1.0;
/// A cluster begins only with hypotheses that have at least this share of the largest probability.
const LEAST_SHARE: f64 = 0.02;
/// Largest number of clusters per step.
const CLUSTERS: usize = 5;

/// A cluster: hypotheses of one component that agree on the error e of the predicted angle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cluster {
    /// Index of the component that the cluster becomes.
    pub component: usize,
    /// Probability of the cluster; below, mean and variance of e, initially those of its central hypothesis.
    pub weight: f64,
    pub mean: f64,
    pub variance: f64,
}

/// All clusters of a step.
#[derive(Clone, Debug, Default)]
pub(super) struct Clusters {
    pub all: Vec<Cluster>,
    /// For each cluster, the probability of each hypothesis after the last plot; 0 if the hypothesis is
    /// not a member of the cluster.
    members: Vec<Row>,
    /// Probabilities of the hypotheses that are not yet in any cluster.
    left: Vec<Row>,
}

impl Clusters {
    /// Returns the clusters and the probabilities of their members.
    #[inline(always)]
    pub fn members(&self) -> impl Iterator<Item = (&Cluster, &[Row])> {
        self.all.iter().zip(self.members.chunks_exact(self.left.len()))
    }

    /// Divides the hypotheses of each component into clusters: one around the most probable hypothesis,
    /// further ones around the most probable of those that disagree with it. The remaining hypotheses join
    /// the nearest cluster of their component; components without a cluster are dropped. Components for
    /// which `whole` returns true are not divided.
    #[inline(always)]
    pub fn divide(&mut self, last: &Spread, before: &Followed, whole: impl Fn(usize) -> bool) {
        self.all.clear();
        self.members.clear();
        self.left.clear();
        self.left.extend_from_slice(last.weights());
        let mut most = largest(&self.left);
        let least = LEAST_SHARE * most;
        while most > least && self.all.len() < CLUSTERS {
            self.begin(most, last, before, &whole);
            most = largest(&self.left);
        }
        if most > 0.0 {
            self.share_out(last, before);
        }
        self.sum_up(last);
    }

    /// Begins a cluster with the hypothesis that has this weight, and adds the hypotheses that agree with it.
    #[inline(always)]
    fn begin(
        &mut self,
        weight: f64,
        last: &Spread,
        before: &Followed,
        whole: impl Fn(usize) -> bool,
    ) {
        let weights = self.left.as_flattened();
        let place = weights.iter().position(|&of| of == weight).unwrap_or(0);
        let (row, level) = (place / Row::default().len(), place % Row::default().len());
        let component = usize::from(before.component[row]);
        let whole = whole(component);
        let (mean, variance) = last.error(row, level);
        self.all.push(Cluster { component, weight: 0.0, mean, variance });
        for (row, (left, (means, variances))) in self.left.iter_mut().zip(last.errors()).enumerate()
        {
            let mut members = Row::default();
            if usize::from(before.component[row]) == component {
                for l in 0..members.len() {
                    let away = means[l] - mean;
                    let agrees = away * away <= DISAGREEMENT * (variances[l] + variance);
                    let taken = if agrees || whole { left[l] } else { 0.0 };
                    members[l] = taken;
                    left[l] -= taken;
                }
            }
            self.members.push(members);
        }
    }

    /// Adds the remaining hypotheses to the nearest cluster of their component.
    fn share_out(&mut self, last: &Spread, before: &Followed) {
        let rows = self.left.len();
        for (row, (weights, (means, variances))) in self.left.iter().zip(last.errors()).enumerate()
        {
            let component = usize::from(before.component[row]);
            for level in (0..weights.len()).filter(|&level| weights[level] > 0.0) {
                let distance = |cluster: &Cluster| {
                    (means[level] - cluster.mean).powi(2) / (variances[level] + cluster.variance)
                };
                let own = self.all.iter().enumerate().filter(|(_, c)| c.component == component);
                let nearest = own.min_by(|(_, a), (_, b)| distance(a).total_cmp(&distance(b)));
                if let Some((index, _)) = nearest {
                    self.members[index * rows + row][level] = weights[level];
                }
            }
        }
    }

    /// Normalises the weights to probabilities, and sets probability, mean and variance of the clusters.
    #[inline(always)]
    fn sum_up(&mut self, last: &Spread) {
        let mut total = 0.0;
        let members = self.members.chunks_exact(self.left.len());
        for (cluster, members) in self.all.iter_mut().zip(members) {
            let (mut weight, mut mean, mut square) = <(Row, Row, Row)>::default();
            for (of, (means, variances)) in members.iter().zip(last.errors()) {
                for l in 0..of.len() {
                    let away = means[l] - cluster.mean;
                    weight[l] += of[l];
                    mean[l] += of[l] * away;
                    square[l] += of[l] * (variances[l] + away * away);
                }
            }
            cluster.weight = sum(&weight);
            let away = sum(&mean) / cluster.weight;
            cluster.mean += away;
            cluster.variance = sum(&square) / cluster.weight - away * away;
            total += cluster.weight;
        }
        for cluster in &mut self.all {
            cluster.weight /= total;
        }
        for weight in self.members.as_flattened_mut() {
            *weight /= total;
        }
    }
}
