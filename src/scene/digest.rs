//! Digest of a scene, which recognises the results of an earlier run.

use std::hash::{DefaultHasher, Hash, Hasher};

use super::Scene;
use relume_volume::Volume;

impl Scene {
    /// Digest of everything that the pictures of the scene depend on: voxels, materials, lights, camera and settings, but
    /// not the name of the scene. Another version of the program may compute another digest.
    #[must_use]
    pub fn digest(&self) -> u64 {
        // Complete on purpose: a new field does not compile until somebody decides.
        let Self {
            name: _,
            frame,
            fields,
            labels,
            materials,
            transfer,
            lights,
            blending,
            overlap,
            hidden,
            shading,
            lighting,
            background,
            camera,
            crop,
            clip,
            block,
            accuracy,
            shadows,
            scattering,
            display,
        } = self;
        let mut hasher = DefaultHasher::new();
        format!(
            "{materials:?} {transfer:?} {lights:?} {blending:?} {overlap:?} {hidden:?} {shading:?} {lighting:?} {background:?}"
        )
        .hash(&mut hasher);
        format!("{camera:?} {crop:?} {clip:?} {accuracy:?} {shadows:?} {scattering:?} {display:?}").hash(&mut hasher);
        if let Some(block) = block {
            block.hash(&mut hasher);
        }
        format!("{frame:?}").hash(&mut hasher);
        for field in fields.iter() {
            hash_voxels(&field.volume, &mut hasher);
        }
        format!("{:?}", fields.terms()).hash(&mut hasher);
        if let Some(labels) = labels {
            format!("{:?}", labels.declared).hash(&mut hasher);
            hash_voxels(&labels.volume, &mut hasher);
        }
        hasher.finish()
    }
}

fn hash_voxels(volume: &Volume, hasher: &mut impl Hasher) {
    format!("{:?} {:?} {:?}", volume.geometry, volume.slope, volume.intercept).hash(hasher);
    std::mem::discriminant(&volume.voxels).hash(hasher);
    volume.voxels.bytes().hash(hasher);
    volume.bricks.as_ref().map(|cache| cache.digest()).hash(hasher);
}
