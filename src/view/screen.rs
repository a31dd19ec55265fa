//! The window and its device; a lost device is reopened without closing the window.

use std::sync::Arc;

use egui::{Context, ViewportId};
use egui_winit::accesskit_winit;
use winit::dpi::{LogicalSize, PhysicalSize, Size};
use winit::event_loop::{ActiveEventLoop, EventLoopProxy};
use winit::raw_window_handle::HasDisplayHandle;
use winit::window::Window;

use super::engine::DISPATCH;
use super::options::{Options, ViewError};
use crate::present::{self, Surface};
use crate::render::Renderer;
use crate::vulkan::VulkanError;

/// Texture size that every device supports; egui needs a limit before it makes its fonts.
const TEXELS: usize = 2048;

/// A window with its surface, egui state and renderer.
pub(super) struct Screen {
    // Declared before the window so that it is dropped first.
    pub(super) surface: Surface,
    pub(super) egui: egui_winit::State,
    pub(super) renderer: Renderer,
    pub(super) window: Arc<Window>,
    /// Number of times the device was opened.
    opened: usize,
}

impl Screen {
    /// Opens the window. Other threads send their events through `proxy`.
    pub(super) fn open<T: From<accesskit_winit::Event> + Send>(
        events: &ActiveEventLoop,
        options: &Options,
        context: &Context,
        proxy: &EventLoopProxy<T>,
    ) -> Result<Self, ViewError> {
        // Sizes given in options are in pixels; the default size is equal on every screen, in points.
        let usual = || Size::from(LogicalSize::new(1280.0, 800.0));
        let size = options.size.map_or_else(usual, |[width, height]| PhysicalSize::new(width, height).into());
        // Shown once AccessKit and the surface exist: Mesa waits for answers of a display that may be gone by then.
        let attributes = Window::default_attributes().with_title("Relume").with_inner_size(size).with_visible(false);
        let window = Arc::new(events.create_window(attributes)?);
        let scale = window.scale_factor();
        #[expect(clippy::cast_possible_truncation, reason = "egui counts pixels of a point in f32")]
        let scale = Some(scale as f32);
        let theme = window.theme();
        let mut egui = egui_winit::State::new(context.clone(), ViewportId::ROOT, &window, scale, theme, Some(TEXELS));
        egui.init_accesskit(events, &window, proxy.clone());
        let (surface, renderer) = device(options, &window)?;
        window.set_visible(true);
        Ok(Self { surface, egui, renderer, window, opened: 1 })
    }

    /// Reopens the lost device for the same window. Everything on the old device is lost.
    pub(super) fn renewed(self, options: &Options) -> Result<Self, ViewError> {
        let Self { surface, mut egui, renderer, window, opened } = self;
        // A window has one swapchain at a time.
        drop((surface, renderer));
        let (surface, renderer) = device(options, &window)?;
        // A changed texture limit makes egui upload its fonts again, which it believes to be on the device.
        egui.set_max_texture_side(TEXELS - opened % 2);
        Ok(Self { surface, egui, renderer, window, opened: opened + 1 })
    }
}

/// Opens a device that can present to `window`.
fn device(options: &Options, window: &Arc<Window>) -> Result<(Surface, Renderer), ViewError> {
    let display = window.display_handle().map_err(|_| VulkanError::NoWindow { lacking: "a display".to_owned() })?;
    let device = present::open_device(&options.device, options.validation, display.as_raw())?;
    let surface = Surface::new(&device, Arc::clone(window))?;
    let renderer = Renderer::new(device).with_dispatches_of(DISPATCH);
    let renderer = match options.device_memory {
        Some(bytes) => renderer.with_memory(bytes),
        None => renderer,
    };
    Ok((surface, renderer))
}
