//! Units of length.

use std::fmt;

/// Unit of length of the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// 1e-2 m
    Centimetre,
    /// 1e-3 m
    Millimetre,
    /// 1e-6 m
    Micrometre,
    /// 1e-9 m
    Nanometre,
    /// 1e-10 m
    Angstrom,
}

impl Unit {
    /// The unit that a file calls `name`; `None` for an unknown one.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Some(match name.trim().to_lowercase().as_str() {
            "cm" | "centimeter" | "centimetre" | "centimeters" | "centimetres" => Self::Centimetre,
            "mm" | "millimeter" | "millimetre" | "millimeters" | "millimetres" => Self::Millimetre,
            "µm" | "μm" | "um" | "micron" | "microns" | "micrometer" | "micrometre" | "micrometers" => {
                Self::Micrometre
            }
            "nm" | "nanometer" | "nanometre" | "nanometers" => Self::Nanometre,
            // The letter, and the sign of the unit.
            "å" | "\u{212b}" | "angstrom" | "angstroms" => Self::Angstrom,
            _ => return None,
        })
    }
}

impl fmt::Display for Unit {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Centimetre => "cm",
            Self::Millimetre => "mm",
            Self::Micrometre => "µm",
            Self::Nanometre => "nm",
            Self::Angstrom => "Å",
        })
    }
}
