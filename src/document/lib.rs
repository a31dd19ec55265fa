//! Documents: a scene together with its file, its light dial and mix, and the history of its edits. No GPU, no window.
#![forbid(unsafe_code)]

pub mod annotate;
mod define;
pub mod design;
mod dial;
mod error;
mod file;
mod history;
pub mod import;
mod kept_film;
mod light_request;
pub mod look;
mod mixing;
pub mod output;
mod quality;
mod recolour;
pub mod session;
mod source;
mod state;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

pub use define::Definition;
pub(crate) use dial::along;
pub use dial::{Dial, DialNode, DialPreset};
pub use error::SceneError;
pub use error::chain;
pub use file::{
    InMemory, SceneOptions, clip_plane, load, load_embedded, load_peer, parse, parse_on, parse_ready, redefined,
};
pub use first_look::{Look, Wish};
pub use history::Document;
pub use kept_film::KeptFilm;
pub use light_request::{LightRequest, Placed, Requested, Shares, requested, spread};
pub use look::{first_look, moves, transfer_presets};
pub use mixing::{LightState, Mixing, Slider};
pub use quality::Quality;
pub use recolour::{in_colour, recoloured, shown_colour};
pub use session::SessionError;
pub use source::{OpenError, Question, Series, Source, Unknown, first_look_of, is_no_scene, is_sidecar};
pub use state::{Edit, State, THINNEST, polygon, reset_nodes};

use relume_scene::{Mix, Scene};

/// A scene file as read: the scene, and the initial state of its document.
#[derive(Clone, Debug)]
pub struct SceneFile {
    /// Its name in messages, without definitions.
    pub name: String,
    /// The scene.
    pub scene: Scene,
    /// The light dial.
    pub dial: Dial,
    /// Initial mix of the lights.
    pub light: LightState,
    /// Text of the file with its definitions applied.
    pub text: Arc<str>,
    /// Folder of its relative paths.
    pub base: PathBuf,
    /// Files that it names: volume, labels, palette and spectra.
    pub inputs: Vec<PathBuf>,
    /// The guess, in a sentence, if the scene was made from its volume.
    pub guess: Option<String>,
}

impl SceneFile {
    /// Initial mix: all lights as stated, unless the file says otherwise.
    #[must_use]
    pub fn opening_mix(&self) -> Mix {
        self.light.mix(Mix::of_scene(&self.scene), &self.scene.lights, &self.dial)
    }

    /// Spectrum of each light as stated in the text, by light name; without spectra stated in numbers.
    #[must_use]
    pub fn stated_spectra(&self) -> BTreeMap<String, String> {
        let text: toml::Table = self.text.parse().unwrap_or_default();
        let stated = |name: &str| Some(text.get("lights")?.get(name)?.get("spectrum")?.as_str()?.to_owned());
        self.scene.lights.iter().filter_map(|light| Some((light.name.clone(), stated(&light.name)?))).collect()
    }
}
