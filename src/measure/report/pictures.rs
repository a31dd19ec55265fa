//! Pictures of a report: colours, and how far they are off.

use glam::DVec3;

use crate::output::{OutputError, ready_png};
use crate::spectrum::colour::{LINEAR_SRGB_FROM_XYZ, encode_srgb};

/// The ends of the scale of ΔE00, which is logarithmic.
pub(super) const SCALE: [f64; 2] = [0.01, 10.0];

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

/// A picture of the page: PNG as text.
pub(super) struct Picture {
    pub(super) base64: String,
}

impl Picture {
    fn of(size: [usize; 2], samples: &[u8]) -> Result<Self, OutputError> {
        use base64::Engine as _;
        let bytes = ready_png(size[0], size[1], samples)?;
        Ok(Self { base64: base64::engine::general_purpose::STANDARD.encode(bytes) })
    }

    /// Colours as the display shows them.
    pub(super) fn of_colours(size: [usize; 2], colours: impl Iterator<Item = DVec3>) -> Result<Self, OutputError> {
        let samples: Vec<u8> = colours.flat_map(shown).collect();
        Self::of(size, &samples)
    }

    /// ΔE00 on [`SCALE`]; grey where nothing was measured.
    pub(super) fn of_differences(
        size: [usize; 2],
        differences: impl Iterator<Item = Option<f64>>,
    ) -> Result<Self, OutputError> {
        let samples: Vec<u8> = differences.flat_map(|it| it.map_or([128, 128, 128], heat)).collect();
        Self::of(size, &samples)
    }
}

fn shown(xyz: DVec3) -> [u8; 3] {
    (*LINEAR_SRGB_FROM_XYZ * xyz).to_array().map(|part| level(encode_srgb(part.clamp(0.0, 1.0))))
}

/// The colour of a ΔE00.
pub(super) fn heat(difference: f64) -> [u8; 3] {
    let [low, high] = SCALE.map(f64::log10);
    let share = ((difference.max(1e-300).log10() - low) / (high - low)).clamp(0.0, 1.0);
    let place = share * crate::number::count(INFERNO.len() - 1);
    let before = crate::number::whole(place).min(INFERNO.len() - 2);
    let rest = place - crate::number::count(before);
    std::array::from_fn(|part| {
        let [one, two] = [INFERNO[before][part], INFERNO[before + 1][part]];
        level((two - one).mul_add(rest, one))
    })
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
        let light = |difference| heat(difference).iter().map(|&part| u32::from(part)).sum::<u32>();
        assert!([0.0, 0.05, 0.2, 1.0, 5.0].windows(2).all(|pair| light(pair[0]) < light(pair[1])));
        assert_eq!((heat(0.0), heat(f64::INFINITY)), (heat(0.001), heat(100.0)));
    }
}
