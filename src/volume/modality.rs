//! Modalities of scanners, as files state them.

use super::Volume;

/// Kind of scanner, as a file states it (DICOM PS3.3 C.7.3.1.1.1; `Modality` of MetaImage).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Modality {
    /// X-ray computed tomography.
    Ct,
    /// Magnetic resonance.
    Mr,
    /// Positron emission tomography.
    Pet,
    /// Scintigraphy and single photon emission tomography.
    Nuclear,
    /// Ultrasound.
    Ultrasound,
    /// Optical coherence tomography.
    Oct,
}

impl Modality {
    /// The modality that a file calls `code`; `None` for all others.
    #[must_use]
    pub fn named(code: &str) -> Option<Self> {
        Some(match code.trim().to_uppercase().trim_start_matches("MET_MOD_") {
            "CT" => Self::Ct,
            "MR" => Self::Mr,
            "PT" | "PET" => Self::Pet,
            "NM" => Self::Nuclear,
            "US" => Self::Ultrasound,
            "OPT" | "OCT" => Self::Oct,
            _ => return None,
        })
    }

    /// Its name in a sentence, with the article.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ct => "a CT",
            Self::Mr => "an MR scan",
            Self::Pet => "a PET scan",
            Self::Nuclear => "a scintigram",
            Self::Ultrasound => "an ultrasound scan",
            Self::Oct => "an optical coherence tomogram",
        }
    }
}

impl Volume {
    /// The modality that the file states.
    #[must_use]
    pub fn modality(&self) -> Option<Modality> {
        let stated = self.metadata.iter().find(|(key, _)| key.eq_ignore_ascii_case("modality"));
        stated.and_then(|(_, code)| Modality::named(code))
    }
}
