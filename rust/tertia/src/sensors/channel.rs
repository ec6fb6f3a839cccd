//! Channels of a rotating radar, primary and secondary, and the ways in which it detects a target by
//! them.

use super::Radar;
use crate::base::error::{Result, require, require_positive};
use serde::{Deserialize, Serialize};

/// By what a plot was detected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Detection {
    /// By the echo alone.
    Psr,
    /// By a reply alone, of modes A and C.
    Ssr,
    /// By both.
    PsrSsr,
    /// By a reply of mode S alone.
    ModeS,
    /// By that and the echo.
    PsrModeS,
}

impl Detection {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Psr, Self::Ssr, Self::PsrSsr, Self::ModeS, Self::PsrModeS];

    /// The one with this index; none where there is none.
    #[inline]
    pub fn of(index: i64) -> Option<Self> {
        usize::try_from(index).ok().and_then(|index| Self::ALL.get(index).copied())
    }
}

/// How a radar detects targets by echoes, or by replies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Channel {
    /// Probability that it detects a target in a scan.
    pub detection_probability: f64,
    /// Standard deviations of range, m, and azimuth, rad.
    pub sigmas: [f64; 2],
    /// Its false plots in a scan; nan: estimated.
    pub clutter_per_scan: f64,
}

impl Channel {
    fn check(&self) -> Result<()> {
        let Self { detection_probability: p, sigmas: [range, azimuth], clutter_per_scan: n } =
            *self;
        require("detection_probability", p, p > 0.0 && p < 1.0, "between 0 and 1")?;
        require_positive("range_sigma", range)?;
        require_positive("azimuth_sigma", azimuth)?;
        let holds = n.is_nan() || n >= 0.0 && n.is_finite();
        require("clutter_per_scan", n, holds, "0 or a positive number")
    }
}

/// A way of detecting a target: by some of the channels, and by no other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Way {
    /// The channels.
    pub detection: Detection,
    /// Probability that a target is detected so in a scan.
    pub probability: f64,
    /// Standard deviations of range and azimuth as stated: those of the reply, where there is one.
    pub sigmas: [f64; 2],
    /// False plots in a scan; nan: estimated.
    pub clutter_per_scan: f64,
    /// The radar with the noise of its plots.
    radar: Radar,
}

/// The ways of a radar.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ways {
    each: Vec<Way>,
    /// The radar with the largest noise of all.
    worst: Radar,
}

/// The ways of channels that detect independently: primary, secondary and mode S. A target has a
/// transponder of one kind; where a radar asks for both, half of the targets have each.
fn ways(radar: &Radar, [psr, ssr, mode_s]: [Option<Channel>; 3]) -> Vec<Way> {
    let secondary =
        [(Detection::Ssr, Detection::PsrSsr, ssr), (Detection::ModeS, Detection::PsrModeS, mode_s)];
    let count = secondary.iter().filter(|(.., channel)| channel.is_some()).count();
    let echo = psr.map_or(0.0, |channel| channel.detection_probability);
    let (mut each, mut silent) = (Vec::new(), 1.0);
    let mut add = |detection, probability, channel: Channel, clutter_per_scan| {
        let Channel { sigmas, .. } = channel;
        let radar = with_noise(radar, sigmas);
        each.push(Way { detection, probability, sigmas, clutter_per_scan, radar });
    };
    for (alone, both, channel) in secondary {
        let Some(channel) = channel else { continue };
        let reply = channel.detection_probability / count as f64;
        silent -= reply;
        add(alone, reply * (1.0 - echo), channel, channel.clutter_per_scan);
        if psr.is_some() {
            add(both, reply * echo, channel, f64::NAN);
        }
    }
    if let Some(channel) = psr {
        add(Detection::Psr, echo * silent, channel, channel.clutter_per_scan);
    }
    each
}

fn with_noise(radar: &Radar, [range_sigma, azimuth_sigma]: [f64; 2]) -> Radar {
    Radar { range_sigma, azimuth_sigma, ways: None, ..*radar }
}

impl Ways {
    fn new(radar: &Radar, channels: [Option<Channel>; 3]) -> Self {
        let mut ways = Self { each: ways(radar, channels), worst: with_noise(radar, [0.0; 2]) };
        let own = [radar.range_sigma, radar.azimuth_sigma];
        ways.assume(own, own, [1.0; 2]);
        ways
    }

    /// All of them.
    pub fn all(&self) -> &[Way] {
        &self.each
    }

    fn of(&self, detection: Detection) -> Option<&Way> {
        self.each.iter().find(|way| way.detection == detection)
    }

    /// Sets the noise of all ways, where the radar itself is assumed to have these standard deviations
    /// in place of those that it states, and the variances of its noise are so many times as large.
    pub(crate) fn assume(&mut self, assumed: [f64; 2], stated: [f64; 2], factors: [f64; 2]) {
        let mut most = assumed;
        for way in &mut self.each {
            let used = [0, 1].map(|i| {
                let (own, more) = (way.sigmas[i], assumed[i].powi(2) - stated[i].powi(2));
                (own * own + more.max(0.0)).sqrt().max(factors[i].sqrt() * own)
            });
            most = [0, 1].map(|i| f64::max(most[i], used[i]));
            [way.radar.range_sigma, way.radar.azimuth_sigma] = used;
        }
        [self.worst.range_sigma, self.worst.azimuth_sigma] = most;
    }
}

impl Radar {
    /// The same with a primary channel, a secondary one and one of mode S, or some of them: it detects
    /// what one of them detects.
    ///
    /// # Errors
    /// A number outside its domain, or no channel.
    pub fn with_channels(self, channels: [Option<Channel>; 3]) -> Result<Self> {
        channels.iter().flatten().try_for_each(Channel::check)?;
        let any = channels.iter().any(Option::is_some);
        require("channels", 0.0, any, "one channel or more")?;
        let ways = Ways::new(&self, channels);
        let detection_probability = ways.each.iter().map(|way| way.probability).sum();
        Ok(Self { detection_probability, ways: Some(Box::new(ways)), ..self })
    }

    /// The detection of a plot, if it is one of this radar's.
    #[inline]
    pub(crate) fn known(&self, detection: Option<Detection>) -> Option<Detection> {
        let ways = self.ways.as_ref()?;
        detection.filter(|detection| ways.of(*detection).is_some())
    }

    /// The way of a plot.
    #[inline]
    pub(crate) fn way(&self, detection: Option<Detection>) -> Option<&Way> {
        detection.and_then(|detection| self.ways.as_ref()?.of(detection))
    }

    /// The radar with the noise of plots that were detected so.
    #[inline]
    pub(crate) fn detecting(&self, detection: Option<Detection>) -> &Self {
        self.way(detection).map_or(self, |way| &way.radar)
    }

    /// The radar with the largest noise of its plots.
    #[inline]
    pub(crate) fn at_worst(&self) -> &Self {
        self.ways.as_ref().map_or(self, |ways| &ways.worst)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;
    use crate::sensors::radar_of;

    fn channel(detection_probability: f64, sigmas: [f64; 2]) -> Option<Channel> {
        Some(Channel { detection_probability, sigmas, clutter_per_scan: f64::NAN })
    }

    fn probability(radar: &Radar, detection: Detection) -> f64 {
        radar.way(Some(detection)).unwrap().probability
    }

    #[test]
    fn channels_detect_independently() {
        let [psr, ssr] = [channel(0.85, [60.0, 2e-3]), channel(0.95, [30.0, 1e-3])];
        let radar = radar_of([50.0, 1e-3]).with_channels([psr, ssr, None]).unwrap();
        for (detection, expected) in
            [(Detection::PsrSsr, 0.8075), (Detection::Ssr, 0.1425), (Detection::Psr, 0.0425)]
        {
            assert_within(1e-14, probability(&radar, detection), expected);
        }
        assert_within(1e-14, 1.0 - radar.detection_probability, 0.0075);
        assert_eq!(radar.known(Some(Detection::ModeS)), None);
        assert_eq!(radar_of([50.0, 1e-3]).known(Some(Detection::Psr)), None);
    }

    #[test]
    fn a_target_answers_one_kind_of_interrogation() {
        let [psr, ssr, mode_s] = [0.8, 0.9, 0.98].map(|p| channel(p, [50.0, 1e-3]));
        let radar = radar_of([50.0, 1e-3]).with_channels([psr, ssr, mode_s]).unwrap();
        assert_within(1e-14, probability(&radar, Detection::PsrModeS), 0.8 * 0.49);
        assert_within(1e-14, probability(&radar, Detection::Ssr), 0.2 * 0.45);
        assert_within(1e-14, probability(&radar, Detection::Psr), 0.8 * (0.05 + 0.01));
        assert_within(1e-14, radar.detection_probability, 1.0 - 0.2 * 0.06);
        assert!(radar_of([50.0, 1e-3]).with_channels([None; 3]).is_err());
        assert!(
            radar_of([50.0, 1e-3]).with_channels([channel(1.0, [1.0; 2]), None, None]).is_err()
        );
    }

    #[test]
    fn noise_is_that_of_the_reply_and_grows_with_what_is_assumed() {
        let [psr, ssr] = [channel(0.85, [60.0, 2e-3]), channel(0.95, [30.0, 1e-3])];
        let mut radar = radar_of([50.0, 1e-3]).with_channels([psr, ssr, None]).unwrap();
        let sigma = |radar: &Radar, detection| radar.detecting(Some(detection)).range_sigma;
        assert_within(1e-14, sigma(&radar, Detection::PsrSsr), 30.0);
        assert_within(1e-14, sigma(&radar, Detection::Psr), 60.0);
        assert_within(1e-14, radar.detecting(None).range_sigma, 50.0);
        let ways = radar.ways.as_mut().unwrap();
        ways.assume([130.0, 1e-3], [50.0, 1e-3], [1.0, 1.0]);
        assert_within(1e-14, sigma(&radar, Detection::Psr), f64::hypot(60.0, 120.0));
        let ways = radar.ways.as_mut().unwrap();
        ways.assume([50.0, 1e-3], [50.0, 1e-3], [4.0, 1.0]);
        assert_within(1e-14, sigma(&radar, Detection::Ssr), 60.0);
        assert_within(1e-14, radar.at_worst().range_sigma, 120.0);
        assert_within(1e-14, radar.at_worst().azimuth_sigma, 2e-3);
    }
}
