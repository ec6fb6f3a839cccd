//! Judges the times of plots that come live: by the times of all sensors, and by what each sensor goes on to send.
//!
//! A plot is off the time of the tracker if it is later than plots may be, or if it comes after a longer silence
//! than tracks survive. Such plots are refused until they go on for more than a scan, and no sensor sends plots in
//! time meanwhile: then time goes on from them, or starts anew.

use super::{Plot, Plots};
use serde::{Deserialize, Serialize};

/// Time for which plots must go on until they are believed, in scans of the slowest sensor; late ones for longer, as
/// a sensor in time may miss its targets meanwhile.
const PROGRESS: f64 = 1.5;
const LATE: f64 = 2.5;

/// A sensor whose plots go on at other times than those of the tracker.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ClockDoubt {
    /// Index of the sensor.
    pub sensor: usize,
    /// Seconds by which its plots are ahead; negative if they are late.
    pub ahead: f64,
    /// Whether the tracker starts anew at the time of these plots; otherwise they are refused.
    pub is_believed: bool,
}

/// Time of the tracker, and what plots in time keep to.
pub(in crate::tracker) struct Limits<'a> {
    /// Time of the tracker, s; negative infinity at first.
    pub now: f64,
    /// Earliest time of a plot of each sensor, s.
    pub oldest: &'a [f64],
    /// Time without plots that tracks survive, s.
    pub silence: f64,
    /// Longest scan, s.
    pub period: f64,
    /// Time up to which all plots have come, s, if it was stated.
    pub end: Option<f64>,
}

/// What follows from the times of the plots of a call.
#[derive(Debug, PartialEq)]
pub(in crate::tracker) enum Verdict {
    /// Indices of plots that are refused because they are ahead.
    Refused(Vec<usize>),
    /// Late plots are believed: the tracker must start anew.
    Restart,
}

/// Plots of a sensor that are off time, since its last plot in time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Off {
    /// Newest time after the first call with such plots, and after the first one since any sensor was in time.
    begun: f64,
    since: Option<f64>,
    /// Newest time of all.
    last: f64,
    is_told: bool,
}

impl Off {
    /// Goes on with plots between two times; anew if they do not follow.
    fn next(before: Option<Self>, [first, last]: [f64; 2], limits: &Limits<'_>) -> Self {
        let follows =
            |own: &Self| first - own.last <= limits.silence && last > own.last - limits.period;
        let new = Self { begun: last, since: None, last, is_told: false };
        let own = before.filter(follows).unwrap_or(new);
        let last = last.max(own.last);
        Self { last, since: own.since.or(Some(last)), ..own }
    }
}

/// The times of one sensor in a call: whether any is in time, and the first and the last that are late or ahead.
#[derive(Clone, Copy, Default)]
struct Seen {
    in_time: bool,
    late: Option<[f64; 2]>,
    ahead: Option<[f64; 2]>,
}

fn extend(span: &mut Option<[f64; 2]>, time: f64) {
    let [first, last] = span.unwrap_or([time; 2]);
    *span = Some([first.min(time), last.max(time)]);
}

/// What is known about sensors whose plots are off time.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Clock {
    /// By sensor; empty if all are in time.
    off: Vec<Option<Off>>,
    doubts: Vec<ClockDoubt>,
}

impl Clock {
    /// Returns the sensors that came into doubt since the last call of this function.
    pub fn take_doubts(&mut self) -> Vec<ClockDoubt> {
        std::mem::take(&mut self.doubts)
    }

    /// Judges the times of valid plots. Cost O(P), and O(P log P) if there are plots ahead.
    pub fn judge<P: Plots + ?Sized>(
        &mut self,
        plots: &P,
        limits: &Limits<'_>,
        is_valid: &impl Fn(&Plot) -> bool,
    ) -> Verdict {
        let (mut seen, mut ahead) = (vec![Seen::default(); limits.oldest.len()], Vec::new());
        let mut newest = limits.now;
        for i in 0..plots.len() {
            let plot = plots.get(i);
            if !is_valid(&plot) {
                continue;
            }
            let own = &mut seen[plot.radar];
            if plot.time < limits.oldest[plot.radar] {
                extend(&mut own.late, plot.time);
            } else if plot.time <= limits.now + limits.silence {
                own.in_time = true;
                newest = newest.max(plot.time);
            } else {
                ahead.push((plot.time, i));
            }
        }
        let refused = follow(&mut ahead, plots, (&mut seen, newest), limits);
        if self.off.is_empty() && seen.iter().all(|own| own.late.is_none() && own.ahead.is_none()) {
            return Verdict::Refused(refused);
        }
        self.off.resize(seen.len(), None);
        self.go_on(&seen, limits);
        if seen.iter().any(|own| own.in_time) {
            self.off.iter_mut().flatten().for_each(|own| own.since = None);
        } else if let Some(sensor) = self.believed(&seen, limits) {
            self.off.clear();
            if let Some([now, _]) = seen[sensor].ahead {
                return self.judge(plots, &Limits { now, ..*limits }, is_valid);
            }
            let last = seen[sensor].late.map_or(limits.now, |[_, last]| last);
            self.doubts.push(ClockDoubt { sensor, ahead: last - limits.now, is_believed: true });
            return Verdict::Restart;
        }
        self.tell(newest, limits);
        if self.off.iter().all(Option::is_none) {
            self.off.clear();
        }
        Verdict::Refused(refused)
    }

    fn go_on(&mut self, seen: &[Seen], limits: &Limits<'_>) {
        for (off, seen) in self.off.iter_mut().zip(seen) {
            match seen.ahead.or(seen.late) {
                _ if seen.in_time => *off = None,
                Some(span) => *off = Some(Off::next(*off, span, limits)),
                None => {}
            }
        }
    }

    /// Returns a sensor of this call whose plots are believed: they went on for long enough, or those of all of
    /// several sensors are ahead by the same time.
    fn believed(&self, seen: &[Seen], limits: &Limits<'_>) -> Option<usize> {
        let is_stated = limits.end.is_some_and(|end| end >= limits.now);
        let goes_on = |sensor: &usize| {
            self.off[*sensor].is_some_and(|own| {
                let gone_on = (own.last - own.since.unwrap_or(own.last)) / limits.period;
                let is_ahead = own.last > limits.now;
                if is_ahead { gone_on >= PROGRESS } else { gone_on >= LATE && !is_stated }
            })
        };
        let here = |sensor: &usize| seen[*sensor].ahead.or(seen[*sensor].late).is_some();
        let all = 0..seen.len();
        all.clone().filter(here).find(goes_on).or_else(|| {
            let own = |sensor: usize| self.off[sensor].filter(|own| own.since.is_some());
            let times: Vec<f64> = all.clone().filter_map(|k| own(k).map(|own| own.last)).collect();
            let first = times.iter().copied().fold(f64::INFINITY, f64::min);
            let last = times.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let agree = times.len() == seen.len() && last - first <= limits.silence;
            let are_ahead = first > limits.now + limits.silence;
            (seen.len() > 1 && agree && are_ahead).then(|| all.clone().find(here))?
        })
    }

    /// Notes, once, the sensors whose plots go on off time while others are in time.
    fn tell(&mut self, newest: f64, limits: &Limits<'_>) {
        for (sensor, own) in self.off.iter_mut().enumerate() {
            let long = |own: &&mut Off| own.last - own.begun >= LATE * limits.period;
            if let Some(own) = own.as_mut().filter(|own| !own.is_told).filter(long) {
                own.is_told = true;
                let ahead = own.last - newest;
                self.doubts.push(ClockDoubt { sensor, ahead, is_believed: false });
            }
        }
    }
}

/// Sorts times that are perhaps ahead, given with the indices of their plots. Those that follow the `newest` time
/// are in time; so are those after a silence that go on for long enough, if no sensor that was in time before it is
/// missing, and those that are most of the plots at the beginning. Returns the indices of the others.
fn follow<P: Plots + ?Sized>(
    ahead: &mut [(f64, usize)],
    plots: &P,
    (seen, newest): (&mut [Seen], f64),
    limits: &Limits<'_>,
) -> Vec<usize> {
    ahead.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut refused, mut before, mut kept) = (Vec::new(), newest, 0);
    for group in ahead.chunk_by(|a, b| b.0 - a.0 <= limits.silence) {
        let (first, last) = (group[0].0, group[group.len() - 1].0);
        let sensors = || group.iter().map(|(_, i)| plots.get(*i).radar);
        let is_complete =
            || (0..seen.len()).all(|k| !seen[k].in_time || sensors().any(|own| own == k));
        let goes_on = last - first >= PROGRESS * limits.period && is_complete();
        let is_most = limits.now == f64::NEG_INFINITY && group.len() > kept;
        if is_most || first - before <= limits.silence || goes_on {
            sensors().for_each(|sensor| seen[sensor].in_time = true);
            (before, kept) = (last, kept + group.len());
        } else {
            for &(time, i) in group {
                extend(&mut seen[plots.get(i).radar].ahead, time);
                refused.push(i);
            }
        }
    }
    refused
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensors::Identities;

    /// Plots of sensors, by their numbers, at these times.
    fn at(times: &[(usize, f64)]) -> Vec<Plot> {
        let plot = |&(radar, time): &(usize, f64)| {
            let (height, identities) = (f64::NAN, Identities::NONE);
            let (report, detection, range, azimuth) = (None, None, 4e4, 0.5);
            Plot { time, range, azimuth, radar, height, identities, detection, report }
        };
        times.iter().map(plot).collect()
    }

    /// Judges plots that come at the time `now`, with scans of 4 s.
    fn judged(clock: &mut Clock, now: f64, times: &[(usize, f64)]) -> Verdict {
        let oldest = [now - 4.0; 2];
        let limits = Limits { now, oldest: &oldest, silence: 22.0, period: 4.0, end: None };
        clock.judge(&at(times)[..], &limits, &|_: &Plot| true)
    }

    fn refused(clock: &mut Clock, now: f64, times: &[(usize, f64)]) -> usize {
        match judged(clock, now, times) {
            Verdict::Refused(refused) => refused.len(),
            Verdict::Restart => usize::MAX,
        }
    }

    #[test]
    fn plots_ahead_are_believed_when_they_go_on_alone() {
        let mut clock = Clock::default();
        assert_eq!(refused(&mut clock, f64::NEG_INFINITY, &[(0, 0.0), (0, 1.0), (0, 900.0)]), 1);
        assert_eq!(refused(&mut clock, 1.0, &[(0, 900.0), (0, 903.9)]), 2);
        // the first sensor is in time meanwhile
        for time in [5.0, 9.0, 13.0, 17.0] {
            assert_eq!(refused(&mut clock, time - 4.0, &[(0, time), (1, 903.0 + time)]), 1);
        }
        assert_eq!(clock.take_doubts().len(), 1);
        assert_eq!(refused(&mut clock, 17.0, &[(1, 924.0)]), 1);
        assert_eq!(refused(&mut clock, 17.0, &[(1, 928.0)]), 1);
        assert_eq!(refused(&mut clock, 17.0, &[(1, 932.0)]), 0);
        // those of all sensors need not go on
        assert_eq!(refused(&mut clock, 932.0, &[(0, 1500.0)]), 1);
        assert_eq!(refused(&mut clock, 932.0, &[(1, 1501.0)]), 0);
        // nor those that are in one call for long enough
        assert_eq!(refused(&mut clock, 1501.0, &[(0, 1505.0), (0, 2500.0), (0, 2507.0)]), 0);
        assert_eq!(refused(&mut clock, 1501.0, &[(1, 1505.0), (0, 2500.0), (0, 2507.0)]), 2);
        assert_eq!(clock.take_doubts(), []);
    }

    #[test]
    fn late_plots_are_believed_when_they_go_on_alone() {
        let mut clock = Clock::default();
        for time in [10.0, 14.0, 18.0] {
            assert_eq!(refused(&mut clock, 100.0, &[(0, time)]), 0);
        }
        assert_eq!(judged(&mut clock, 100.0, &[(0, 22.0)]), Verdict::Restart);
        assert!(clock.take_doubts()[0].is_believed);
        for time in [10.0, 14.0, 18.0, 22.0] {
            assert_eq!(refused(&mut clock, 100.0 + time, &[(0, time), (1, 100.0 + time)]), 0);
        }
        let doubts = clock.take_doubts();
        assert_eq!(doubts.len(), 1);
        assert!(doubts[0].sensor == 0 && !doubts[0].is_believed && doubts[0].ahead == -100.0);
    }
}
