//! What the measurements of an axis determine, whatever their precision.

/// Quantity that is measured along an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Quantity {
    Position,
    Velocity,
}

/// Number of independent measurements of an axis that determine position, velocity and acceleration.
pub(super) const ENOUGH: usize = 3;
/// Share of a step by which a time may differ from its middle.
const ROUNDING: f64 = 1e-9;

/// Independent measurements of an axis, up to three: a parabola has three unknowns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Seen {
    pub count: usize,
    first: [(Quantity, f64); 2],
}

impl Quantity {
    /// Quantity of a component of a plot: positions of all axes come first, then velocities.
    #[inline(always)]
    pub fn of(number: usize, axes: usize) -> Self {
        if number < axes { Self::Position } else { Self::Velocity }
    }
}

impl Seen {
    pub const NONE: Self = Self { count: 0, first: [(Quantity::Position, f64::NAN); 2] };
    pub const ALL: Self = Self { count: ENOUGH, ..Self::NONE };

    /// Adds a measurement at `time`, if it is independent of those before.
    pub fn add(&mut self, quantity: Quantity, time: f64) {
        let new = (quantity, time);
        let is_independent = match self.count {
            0 => true,
            1 => self.first[0] != new,
            2 => self.is_completed_by(new),
            _ => false,
        };
        if is_independent {
            if let Some(place) = self.first.get_mut(self.count) {
                *place = new;
            }
            self.count += 1;
        }
    }

    /// Whether no parabola except zero vanishes in all three measurements.
    fn is_completed_by(&self, new: (Quantity, f64)) -> bool {
        let mut all = [self.first[0], self.first[1], new];
        all.sort_by_key(|(quantity, _)| *quantity == Quantity::Velocity);
        let [a, b, c] = all.map(|(_, time)| time);
        match all.iter().filter(|(quantity, _)| *quantity == Quantity::Position).count() {
            3 => c != a && c != b,
            // the slope of a chord is the velocity halfway between its ends
            2 => a != b && !is_halfway(c, a, b),
            1 => b != c,
            _ => false,
        }
    }

    /// Whether position, velocity and acceleration at `time` are determined. A parabola through two positions
    /// may have any curvature, but its slope halfway between them is that of the chord.
    pub fn determines(&self, time: f64) -> [bool; 3] {
        use Quantity::{Position, Velocity};
        let [(one, a), (other, b)] = self.first;
        match (self.count, one, other) {
            (0, ..) => [false; 3],
            (1, Position, _) => [time == a, false, false],
            (1, Velocity, _) => [false, time == a, false],
            (2, Position, Position) => [time == a || time == b, is_halfway(time, a, b), false],
            (2, Velocity, Velocity) => [false, true, true],
            (2, ..) => {
                let (p, v) = if one == Position { (a, b) } else { (b, a) };
                [time == p || is_halfway(v, p, time), time == v, false]
            }
            _ => [true; 3],
        }
    }

    /// Whether position, velocity and acceleration have to be fixed so that the rest is determined.
    pub fn open(&self) -> [bool; 3] {
        use Quantity::Velocity;
        match (self.count, self.first[0].0, self.first[1].0) {
            (0, ..) => [true; 3],
            (1, Velocity, _) => [true, false, true],
            (1, ..) => [false, true, true],
            (2, Velocity, Velocity) => [true, false, false],
            (2, ..) => [false, false, true],
            _ => [false; 3],
        }
    }
}

fn is_halfway(time: f64, a: f64, b: f64) -> bool {
    ((time - a) - (b - time)).abs() <= ROUNDING * (b - a).abs()
}

#[cfg(test)]
mod tests {
    use super::Quantity::{Position, Velocity};
    use super::*;

    fn seen(measurements: &[(Quantity, f64)]) -> Seen {
        let mut seen = Seen::NONE;
        measurements.iter().for_each(|&(quantity, time)| seen.add(quantity, time));
        seen
    }

    /// Rank of the values of parabolas at these measurements, in integers.
    fn rank(measurements: &[(Quantity, f64)]) -> usize {
        let row = |&(quantity, t): &(Quantity, f64)| match quantity {
            Position => [2.0, 2.0 * t, t * t],
            Velocity => [0.0, 2.0, 2.0 * t],
        };
        let mut rows: Vec<[f64; 3]> = measurements.iter().map(row).collect();
        let mut rank = 0;
        for column in 0..3 {
            let Some(pivot) = (rank..rows.len()).find(|&i| rows[i][column] != 0.0) else {
                continue;
            };
            rows.swap(rank, pivot);
            let own = rows[rank];
            for row in &mut rows[rank + 1..] {
                let factor = row[column];
                (0..3).for_each(|i| row[i] = row[i] * own[column] - own[i] * factor);
            }
            rank += 1;
        }
        rank
    }

    /// Any three or four measurements at five instants must count for what they determine, now and later.
    #[test]
    fn what_is_determined_is_the_rank() {
        let all: Vec<(Quantity, f64)> = (0..10)
            .map(|i| (if i % 2 == 0 { Position } else { Velocity }, f64::from(i / 2)))
            .collect();
        for code in 0..10_000_usize {
            let chosen = [code / 1000, code / 100 % 10, code / 10 % 10, code % 10].map(|i| all[i]);
            for count in 0..=4 {
                let found = seen(&chosen[..count]);
                assert_eq!(found.count, rank(&chosen[..count]), "{:?}", &chosen[..count]);
                for time in [0.0, 1.0, 1.5, 2.0, 6.0] {
                    for (quantity, known) in [Position, Velocity].iter().zip(found.determines(time))
                    {
                        let mut with = chosen[..count].to_vec();
                        with.push((*quantity, time));
                        assert_eq!(
                            known,
                            rank(&with) == found.count,
                            "{quantity:?} {time} {found:?}"
                        );
                    }
                }
                assert_eq!(found.open().iter().filter(|open| **open).count(), ENOUGH - found.count);
            }
        }
    }
}
