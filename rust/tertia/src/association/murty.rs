//! The best assignments in descending order (Murty 1968; Cox, Hingorani 1996).

use super::assignment::Assigner;
use super::event::{Event, Limits, sort};
use super::pair::Pair;

/// Added to the gains of rows that must have a column; larger than the sum of all gains.
const MUST: f64 = 1e7;

/// Restriction of a row.
#[derive(Clone, Debug, PartialEq)]
enum Rule {
    /// Any column except these; `or_none` is whether the row may be without a column.
    Free { but: Vec<u32>, or_none: bool },
    /// Exactly this column, or none.
    Fixed(Option<u32>),
}

/// An assignment, and the rules under which it is the best one.
struct Node {
    event: Event,
    rules: Vec<Rule>,
}

/// Returns the `limits.count` best assignments within `limits.cut` of the best one, which is that of
/// [`Assigner`]. Each is the best of those that differ from all better ones. Cost O(count × rows)
/// assignments.
pub(super) fn best(
    pairs: &[Pair],
    rows: usize,
    columns: usize,
    limits: Limits,
    assigner: &mut Assigner,
) -> Vec<Event> {
    let free = vec![Rule::Free { but: Vec::new(), or_none: true }; rows];
    let mut solver = Solver { pairs, rows, columns, allowed: Vec::new(), assigner };
    let Some(first) = solver.solve(free) else { return Vec::new() };
    let least = first.event.gain - limits.cut;
    let mut open = vec![first];
    let mut found: Vec<Event> = Vec::new();
    while found.len() < limits.count {
        let order = |&a: &usize, &b: &usize| {
            open[a].event.gain.total_cmp(&open[b].event.gain).then(b.cmp(&a))
        };
        let Some(next) = (0..open.len()).max_by(order) else { break };
        let node = open.remove(next);
        let mut rules = node.rules;
        for (row, column) in node.event.columns.iter().enumerate() {
            if let Some(rules) = without(&rules, row, *column) {
                open.extend(solver.solve(rules).filter(|node| node.event.gain >= least));
            }
            rules[row] = Rule::Fixed(*column);
        }
        found.push(node.event);
    }
    sort(&mut found);
    found
}

/// Returns the rules with one choice excluded; `None` if the row then has no choice.
fn without(rules: &[Rule], row: usize, column: Option<u32>) -> Option<Vec<Rule>> {
    let mut rules = rules.to_vec();
    match (&mut rules[row], column) {
        (Rule::Fixed(_), _) => return None,
        (Rule::Free { but, .. }, Some(column)) => but.push(column),
        (Rule::Free { or_none, .. }, None) => *or_none = false,
    }
    Some(rules)
}

struct Solver<'a> {
    pairs: &'a [Pair],
    rows: usize,
    columns: usize,
    allowed: Vec<Pair>,
    assigner: &'a mut Assigner,
}

impl Solver<'_> {
    /// Finds the best assignment under these rules; `None` if there is none.
    fn solve(&mut self, rules: Vec<Rule>) -> Option<Node> {
        let is_fixed = |column: u32| rules.contains(&Rule::Fixed(Some(column)));
        let lifted = |pair: &Pair| match &rules[pair.row as usize] {
            Rule::Fixed(own) => (*own == Some(pair.column)).then_some(MUST),
            Rule::Free { but, .. } if but.contains(&pair.column) || is_fixed(pair.column) => None,
            Rule::Free { or_none, .. } => Some(if *or_none { 0.0 } else { MUST }),
        };
        self.allowed.clear();
        for pair in self.pairs.iter().filter(|pair| pair.counts()) {
            if let Some(more) = lifted(pair) {
                self.allowed.push(Pair { gain: pair.gain + more, ..*pair });
            }
        }
        let columns = self.assigner.assign(&self.allowed, self.rows, self.columns).to_vec();
        let must =
            |rule: &Rule| matches!(rule, Rule::Fixed(Some(_)) | Rule::Free { or_none: false, .. });
        if rules.iter().zip(&columns).any(|(rule, own)| must(rule) && own.is_none()) {
            return None;
        }
        let gain = |(row, column): (usize, &Option<u32>)| {
            let same = |pair: &&Pair| pair.row as usize == row && Some(pair.column) == *column;
            self.pairs.iter().filter(same).map(|pair| pair.gain).fold(0.0, f64::max)
        };
        let gain = columns.iter().enumerate().map(gain).sum();
        Some(Node { event: Event { gain, columns }, rules })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::association::events::events;
    use crate::base::random::Random;

    #[test]
    fn the_same_as_by_enumeration() {
        let mut random = Random::new(11);
        for (rows, columns) in [(1, 3), (3, 2), (3, 4), (4, 5)] {
            for _ in 0..60 {
                let mut pairs = Vec::new();
                for row in 0..rows {
                    for column in 0..columns {
                        if random.uniform() < 0.7 {
                            pairs.push(Pair { row, column, gain: random.symmetric(6.0) + 4.0 });
                        }
                    }
                }
                let mut assigner = Assigner::default();
                for limits in
                    [Limits { count: 10_000, cut: f64::INFINITY }, Limits { count: 7, cut: 5.0 }]
                {
                    let rows = rows as usize;
                    let expected = events(&pairs, rows, &[], limits, &mut assigner);
                    let found = best(&pairs, rows, columns as usize, limits, &mut assigner);
                    assert_eq!(found.len(), expected.len());
                    for (a, b) in found.iter().zip(&expected) {
                        assert_eq!(a.columns, b.columns);
                        assert!((a.gain - b.gain).abs() < 1e-9);
                    }
                }
            }
        }
    }

    /// More rows than can be enumerated.
    #[test]
    fn many_rows() {
        let mut pairs = Vec::new();
        for row in 0..12_u32 {
            for column in 0..12_u32 {
                let gain = 10.0 - 0.3 * f64::from(row.abs_diff(column)) * f64::from(row + 1);
                pairs.push(Pair { row, column, gain });
            }
        }
        let limits = Limits { count: 20, cut: 7.0 };
        let found = events(&pairs, 12, &[], limits, &mut Assigner::default());
        assert!(found.len() == 20 && found.is_sorted_by(|a, b| a.gain >= b.gain));
        assert!(found[0].columns.iter().enumerate().all(|(row, own)| *own == Some(row as u32)));
        let mut sorted = found.clone();
        sorted.dedup_by(|a, b| a.columns == b.columns);
        assert_eq!(sorted.len(), 20);
    }
}
