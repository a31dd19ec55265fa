//! What a volume is shown as before anybody has said so: its first look, the camera that fits what is visible, moves of the
//! camera, and transfer functions by name.

pub mod first_look;
mod fit;
pub mod moves;
mod otsu;
mod silhouette;
pub mod transfer_presets;
