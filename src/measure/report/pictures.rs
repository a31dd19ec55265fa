//! Pictures of a report: colours and maps of ΔE00.

use glam::DVec3;

use relume_colour::spectrum::colour::{LINEAR_SRGB_FROM_XYZ, encode_srgb};
use relume_document::output::{OutputError, ready_png};

/// A logarithmic scale of ΔE00.
#[derive(Clone, Copy)]
pub(super) struct Scale {
    pub(super) low: f64,
    pub(super) high: f64,
}

/// Inferno (Smith and van der Walt 2015, CC0) at equal distances.
const INFERNO: [[f64; 3]; 9] = [
    [0.001, 0.000, 0.014],
    [0.122, 0.047, 0.282],
    [0.333, 0.059, 0.427],
    [0.533, 0.133, 0.416],
    [0.729, 0.212, 0.333],
    [0.890, 0.349, 0.200],
    [0.976, 0.549, 0.039],
    [0.976, 0.788, 0.196],
    [0.988, 1.000, 0.643],
];

/// A picture of the page: a PNG in base64.
pub(super) struct Picture {
    pub(super) base64: String,
}

impl Picture {
    fn of(size: [usize; 2], samples: &[u8]) -> Result<Self, OutputError> {
        use base64::Engine as _;
        let bytes = ready_png(size[0], size[1], samples)?;
        Ok(Self { base64: base64::engine::general_purpose::STANDARD.encode(bytes) })
    }

    /// Encodes XYZ colours as sRGB.
    pub(super) fn of_colours(size: [usize; 2], colours: impl Iterator<Item = DVec3>) -> Result<Self, OutputError> {
        let samples: Vec<u8> = colours.flat_map(shown).collect();
        Self::of(size, &samples)
    }

    /// Encodes ΔE00 by the colours of a scale; grey where nothing was measured.
    pub(super) fn of_differences(
        size: [usize; 2],
        differences: impl Iterator<Item = Option<f64>>,
        scale: Scale,
    ) -> Result<Self, OutputError> {
        let heat = |difference| scale.heat(difference);
        let samples: Vec<u8> = differences.flat_map(|it| it.map_or([128, 128, 128], heat)).collect();
        Self::of(size, &samples)
    }
}

fn shown(xyz: DVec3) -> [u8; 3] {
    (*LINEAR_SRGB_FROM_XYZ * xyz).to_array().map(|part| level(encode_srgb(part.clamp(0.0, 1.0))))
}

impl Scale {
    /// Position of a ΔE00 on the scale, 0 to 1.
    pub(super) fn share(self, difference: f64) -> f64 {
        let [low, high] = [self.low, self.high].map(f64::log10);
        ((difference.max(1e-300).log10() - low) / (high - low)).clamp(0.0, 1.0)
    }

    /// ΔE00 at a position from 0 to 1.
    pub(super) fn at(self, share: f64) -> f64 {
        self.low * (self.high / self.low).powf(share)
    }

    /// Colour of a ΔE00.
    pub(super) fn heat(self, difference: f64) -> [u8; 3] {
        let place = self.share(difference) * relume_base::number::count(INFERNO.len() - 1);
        let before = relume_base::number::whole(place).min(INFERNO.len() - 2);
        let rest = place - relume_base::number::count(before);
        std::array::from_fn(|part| {
            let [one, two] = [INFERNO[before][part], INFERNO[before + 1][part]];
            level((two - one).mul_add(rest, one))
        })
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 255 after the clamp")]
fn level(share: f64) -> u8 {
    share.clamp(0.0, 1.0).mul_add(255.0, 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_goes_from_black_to_bright_and_ends_there() {
        let scale = Scale { low: 0.01, high: 10.0 };
        let heat = |difference| scale.heat(difference);
        let light = |difference| heat(difference).iter().map(|&part| u32::from(part)).sum::<u32>();
        assert!([0.0, 0.05, 0.2, 1.0, 5.0].windows(2).all(|pair| light(pair[0]) < light(pair[1])));
        assert!((scale.at(scale.share(0.5)) - 0.5).abs() <= 1e-12);
        assert_eq!((heat(0.0), heat(f64::INFINITY)), (heat(0.001), heat(100.0)));
    }
}
