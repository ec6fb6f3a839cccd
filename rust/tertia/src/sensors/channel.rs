//! Channels of a rotating radar, primary and secondary, and the combinations of channels by which it detects
//! a target.

use crate::base::error::{Result, require, require_positive};
use serde::{Deserialize, Serialize};

/// Channels that detected a plot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Detection {
    /// The echo alone.
    Psr,
    /// A reply in modes A and C alone.
    Ssr,
    /// Both the echo and a reply in modes A and C.
    PsrSsr,
    /// A reply in mode S alone.
    ModeS,
    /// Both the echo and a reply in mode S.
    PsrModeS,
}

impl Detection {
    /// All combinations.
    pub const ALL: [Self; 5] = [Self::Psr, Self::Ssr, Self::PsrSsr, Self::ModeS, Self::PsrModeS];

    /// Returns the combination with this index; `None` if there is none.
    #[inline]
    pub fn of(index: i64) -> Option<Self> {
        usize::try_from(index).ok().and_then(|index| Self::ALL.get(index).copied())
    }
}

/// Properties of a radar's detection by echoes, or by replies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Channel {
    /// Probability that the channel detects a target in a scan.
    pub detection_probability: f64,
    /// Standard deviations of range, m, and azimuth, rad.
    pub sigmas: [f64; 2],
    /// Mean number of false plots of the channel in a scan; nan if it is to be estimated.
    pub clutter_per_scan: f64,
}

impl Channel {
    pub(super) fn check(&self) -> Result<()> {
        let Self { detection_probability: p, sigmas: [range, azimuth], clutter_per_scan: n } =
            *self;
        require("detection_probability", p, p > 0.0 && p < 1.0, "between 0 and 1")?;
        require_positive("range_sigma", range)?;
        require_positive("azimuth_sigma", azimuth)?;
        let holds = n.is_nan() || n >= 0.0 && n.is_finite();
        require("clutter_per_scan", n, holds, "0 or a positive number")
    }
}

/// A way of detecting a target: by exactly this combination of channels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Way {
    /// The channels.
    pub detection: Detection,
    /// Probability that a target is detected in this way in a scan.
    pub probability: f64,
    /// Stated standard deviations of range, m, and azimuth, rad: those of the reply if there is one.
    pub sigmas: [f64; 2],
    /// Mean number of false plots in a scan; nan if it is to be estimated.
    pub clutter_per_scan: f64,
}

/// Returns the ways of detection for channels that detect independently: primary, secondary and mode S. A
/// target has a transponder of one kind; if the radar interrogates both, half of the targets have each kind.
pub(super) fn ways([psr, ssr, mode_s]: [Option<Channel>; 3]) -> Vec<Way> {
    let secondary =
        [(Detection::Ssr, Detection::PsrSsr, ssr), (Detection::ModeS, Detection::PsrModeS, mode_s)];
    let count = secondary.iter().filter(|(.., channel)| channel.is_some()).count();
    let echo = psr.map_or(0.0, |channel| channel.detection_probability);
    let (mut each, mut silent) = (Vec::new(), 1.0);
    let mut add = |detection, probability, channel: Channel, clutter_per_scan| {
        each.push(Way { detection, probability, sigmas: channel.sigmas, clutter_per_scan });
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
