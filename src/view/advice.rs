//! Controls of the window that help against an error.

use std::error::Error;

use super::LoadError;
use super::export::ExportError;
use crate::document::{OpenError, SceneError};
use crate::measure::{Goal, MeasureError};
use crate::model::ModelError;
use crate::output::page::PageError;
use crate::render::RenderError;
use crate::volume::VolumeError;

/// Returns `error` and its causes in one line, with the controls that help.
pub(super) fn line(error: &(dyn Error + 'static)) -> String {
    let mut text = format!("{error}{}", control(error).unwrap_or_default());
    let mut cause = error.source();
    while let Some(error) = cause {
        text = format!("{text}: {error}{}", control(error).unwrap_or_default());
        cause = error.source();
    }
    text
}

/// Control that helps against `error`, as the end of its sentence. A transparent error passes on that of its cause.
fn control(error: &(dyn Error + 'static)) -> Option<&'static str> {
    if let Some(error) = error.downcast_ref() {
        return match error {
            LoadError::Open(OpenError::Scene(error)) => control(error),
            LoadError::Open(OpenError::Volume(error)) => control(error),
            LoadError::Open(OpenError::Look(_) | OpenError::Preset(_)) => None,
            LoadError::Render(error) => control(error),
        };
    }
    match error.downcast_ref() {
        Some(ExportError::Render(error)) => return control(error),
        Some(ExportError::Page(PageError::Tolerance { .. })) => {
            return Some("; `relume page` with --tolerance writes it");
        }
        _ => {}
    }
    if let Some(error) = error.downcast_ref() {
        return match error {
            MeasureError::None { goal: Goal::MaxError(_), .. } => Some("; allow a larger error"),
            MeasureError::None { goal: Goal::Budget(_), .. } => Some("; allow more time, or make the window smaller"),
            MeasureError::Render(error) => control(error),
            _ => None,
        };
    }
    if let Some(SceneError::NoScene(error)) = error.downcast_ref() {
        return control(error);
    }
    match error.downcast_ref() {
        Some(RenderError::Volume(error)) => return control(error),
        Some(RenderError::Matrix) => return Some("; choose another model"),
        Some(RenderError::Slot { .. }) => return Some("; start relume view with more --device-memory"),
        Some(RenderError::PictureSize { .. } | RenderError::PictureMemory { .. }) => {
            return Some("; make the window smaller, or use fewer light positions");
        }
        _ => {}
    }
    match (error.downcast_ref(), error.downcast_ref()) {
        (Some(VolumeError::UnknownFormat { is_known: false, .. }), _) => {
            Some("; if it holds headerless voxels, name it .raw")
        }
        (Some(VolumeError::BrickMemory { .. }), _) => Some("; start relume view with more --memory"),
        (Some(VolumeError::Exceeds { .. }), _) => {
            Some("; start relume view with more --memory, or make bricks of the file with relume bricks")
        }
        (Some(VolumeError::InFile { .. }), _) => Some("; start relume view with more --memory, or leave that out"),
        (_, Some(ModelError::Tolerance { .. })) => Some("; set a larger tolerance, or k"),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_that_is_too_large_names_the_window_once() {
        let error = || RenderError::PictureSize { asked: [9, 8, 7], device: "d".to_owned(), limit: [6, 5, 4] };
        let alone = line(&error());
        assert!(alone.starts_with("a picture of 9×8 pixels") && alone.contains("make the window smaller"), "{alone}");
        assert_eq!(line(&ExportError::from(error())), alone);
        assert_eq!(line(&LoadError::from(error())), alone);
        assert_eq!(line(&MeasureError::from(error())), alone);
    }
}
