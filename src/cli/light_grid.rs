//! The light grid of a film in the report of a command.

use crate::number::brief;
use crate::render::DeviceFilm;

/// States the level that shadows of a volume in bricks come from.
pub(crate) fn told(film: &DeviceFilm) -> String {
    let Some(([x, y, z], spacing)) = film.light_block.zip(film.light_spacing) else { return String::new() };
    let level = x.max(y).max(z).ilog2();
    format!(
        "shadows are from level {level} of the volume, means of {x}×{y}×{z} voxels, with a node of the light grid every {} voxels \
         (docs/SCALE.md)\n",
        brief(spacing)
    )
}

/// The light grid of a film.
pub(crate) fn json(film: &DeviceFilm) -> serde_json::Value {
    film.light_spacing
        .map_or(serde_json::Value::Null, |spacing| serde_json::json!({"spacing": spacing, "block": film.light_block}))
}
