//! Warnings about a plan, as data.

use std::fmt;

use relume_colour::spectrum::observer::Observer;

/// A property of a plan that its user may want to change.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum PlanWarning {
    /// A stated setting has no effect, because pixels keep weights of the materials, which are exact here.
    Unused {
        /// The setting, such as "k = 8".
        setting: String,
    },
    /// A rule has no effect: one for several fields or clip planes, of which there is one, or adaptive samples.
    RuleUnused {
        /// The setting.
        setting: String,
        /// The reason.
        why: &'static str,
    },
    /// Phase functions of some materials have no effect, because gradients shade the scene, or a single value of a ray is seen.
    PhaseUnused {
        /// Names of the materials.
        materials: String,
        /// True if a single value is seen.
        is_extreme: bool,
    },
    /// Shadows, or scattered light, have no effect, because a single value of a ray is seen.
    ShadowsUnused {
        /// The keys that ask for them.
        settings: String,
    },
    /// Films of some materials have no effect.
    FilmUnused {
        /// Names of the materials.
        materials: String,
        /// The reason, and the way out.
        why: &'static str,
    },
    /// Neither terms nor coefficients approach the reflectance of a film within the tolerance.
    FilmInexact {
        /// Name of the material.
        material: String,
        /// Largest ΔE00.
        error: f64,
        /// The tolerance.
        tolerance: f64,
    },
    /// The absorption of some materials would amplify light in the colour model, and is clamped at 0.
    Amplified {
        /// A sentence for each material.
        sentences: Vec<String>,
    },
    /// A model with one coefficient less has smaller errors.
    FewerAreBetter {
        /// Stated number of coefficients, and its largest ΔE00.
        stated: (usize, f64),
        /// The smaller number, and its largest ΔE00.
        fewer: (usize, f64),
    },
    /// The colour model exceeds its tolerance for the observer of the display.
    Observer {
        /// The observer.
        observer: Observer,
        /// Largest ΔE00.
        error: f64,
        /// The tolerance.
        tolerance: f64,
    },
}

impl PlanWarning {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Unused { .. } => "setting-unused",
            Self::RuleUnused { .. } => "rule-unused",
            Self::PhaseUnused { .. } => "phase-unused",
            Self::ShadowsUnused { .. } => "shadows-unused",
            Self::FilmUnused { .. } => "film-unused",
            Self::FilmInexact { .. } => "film-over-tolerance",
            Self::Amplified { .. } => "absorption-clamped",
            Self::FewerAreBetter { .. } => "fewer-coefficients-better",
            Self::Observer { .. } => "observer-over-tolerance",
        }
    }
}

impl fmt::Display for PlanWarning {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unused { setting } => {
                write!(
                    formatter,
                    "{setting} has no effect: pixels keep material weights, which are exact for this scene"
                )
            }
            Self::RuleUnused { setting, why } => write!(formatter, "{setting} has no effect: {why}"),
            Self::PhaseUnused { materials, is_extreme } => {
                let why = if *is_extreme {
                    "a single value of a ray is seen; use blending = \"composite\""
                } else {
                    "gradients shade the scene; use shading = \"none\""
                };
                write!(formatter, "the phase function of {materials} has no effect: {why}, or remove `phase`")
            }
            Self::ShadowsUnused { settings } => write!(
                formatter,
                "{settings} has no effect: a single value of a ray is seen; use blending = \"composite\", or leave {} out",
                if settings.contains(", ") { "them" } else { "it" }
            ),
            Self::FilmUnused { materials, why } => write!(formatter, "the film of {materials} has no effect: {why}"),
            Self::FilmInexact { material, error, tolerance } => write!(
                formatter,
                "the colours of the film of {material} are off by up to ΔE00 {error:.2}, and the tolerance is {tolerance}: the film has more fringes than the numbers of a pixel represent; use a larger tolerance, a thinner film or, with a stated `dimension`, more coefficients"
            ),
            Self::Amplified { sentences } => formatter.write_str(sentences.join(" ").trim_end_matches('.')),
            Self::FewerAreBetter { stated: (k, error), fewer: (fewer, smaller) } => write!(
                formatter,
                "k = {fewer} has a smaller error here than k = {k}: at most ΔE00 {smaller:.3} instead of {error:.3}"
            ),
            Self::Observer { observer, error, tolerance } => write!(
                formatter,
                "the colour model was planned for the 1931 observer; for the {observer} observer, colours may differ by \
                 ΔE00 {error:.2}, over the tolerance of {tolerance}"
            ),
        }
    }
}
