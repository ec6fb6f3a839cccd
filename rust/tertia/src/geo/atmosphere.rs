//! Pressure altitudes, as reported by transponders, and heights.

/// International standard atmosphere (ISO 2533): pressure, Pa, and temperature, K, at sea level; lapse rate,
/// K/m; height of the tropopause, m.
const PRESSURE: f64 = 101_325.0;
const TEMPERATURE: f64 = 288.15;
const LAPSE: f64 = 0.0065;
const TROPOPAUSE: f64 = 11_000.0;
/// Gas constant of air, J/(kg K), and acceleration of gravity, m/s².
const GAS: f64 = 287.052_87;
const GRAVITY: f64 = 9.806_65;
/// Exponent g / (R β) of the troposphere.
const EXPONENT: f64 = GRAVITY / (GAS * LAPSE);
/// Radius of the earth in the definition of geopotential heights, m.
const GEOPOTENTIAL_RADIUS: f64 = 6_356_766.0;

/// Weather and geoid at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Atmosphere {
    /// Pressure setting with which altimeters show the height above sea level, Pa.
    pub qnh: f64,
    /// Temperature of the air minus that of the standard atmosphere, K.
    pub isa_deviation: f64,
    /// Height of sea level above the ellipsoid, m.
    pub undulation: f64,
}

/// Pressure in the standard atmosphere at a pressure altitude, Pa.
fn pressure(altitude: f64) -> f64 {
    let tropopause = TEMPERATURE - LAPSE * TROPOPAUSE;
    if altitude <= TROPOPAUSE {
        PRESSURE * (1.0 - LAPSE * altitude / TEMPERATURE).powf(EXPONENT)
    } else {
        let above = (altitude - TROPOPAUSE) * GRAVITY / (GAS * tropopause);
        PRESSURE * (tropopause / TEMPERATURE).powf(EXPONENT) * (-above).exp()
    }
}

impl Atmosphere {
    /// Height above the ellipsoid of a pressure altitude. Above sea level it is
    /// `h_p − h_ISA(QNH) + ΔT R/g ln(QNH/p)` in geopotential metres.
    pub fn height(&self, altitude: f64) -> f64 {
        let set = TEMPERATURE / LAPSE * (1.0 - (self.qnh / PRESSURE).powf(1.0 / EXPONENT));
        let warm = self.isa_deviation * GAS / GRAVITY * (self.qnh / pressure(altitude)).ln();
        let over_sea = altitude - set + warm;
        GEOPOTENTIAL_RADIUS * over_sea / (GEOPOTENTIAL_RADIUS - over_sea) + self.undulation
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;

    /// Values of the prototype; the second is that of ISO 2533, with 226.32 hPa at the tropopause.
    #[test]
    fn heights_and_pressures() {
        assert_within(1e-12, pressure(10_668.0), 23_842.272_920_891_48);
        assert_within(1e-5, pressure(11_000.0), 22_632.0);
        for (altitude, qnh, isa_deviation, expected) in [
            (10_668.0, 101_325.0, 0.0, 10_685.933_259_776),
            (10_668.0, 101_325.0, 15.0, 11_323.411_353_900),
            (10_668.0, 99_325.0, -10.0, 10_098.504_188_091),
            (3_048.0, 103_000.0, 0.0, 3_188.104_717_803),
            (12_000.0, 101_325.0, 10.0, 12_509.492_702_720),
        ] {
            let air = Atmosphere { qnh, isa_deviation, undulation: 0.0 };
            assert_within(1e-13, air.height(altitude), expected);
        }
    }
}
