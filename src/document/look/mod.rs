//! Defaults for volumes without a scene: first looks, cameras that fit the visible voxels, camera moves, transfer functions
//! by name.

pub(crate) mod bands;
pub(crate) mod beside;
pub(crate) mod channels;
pub mod first_look;
mod fit;
pub mod moves;
mod otsu;
mod silhouette;
pub mod transfer_presets;
