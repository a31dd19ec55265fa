//! The window with what draws in it; a device that is lost is opened anew under it.

use std::sync::Arc;

use egui::{Context, ViewportId};
use egui_winit::accesskit_winit;
use winit::dpi::{LogicalSize, PhysicalSize, Size};
use winit::event_loop::{ActiveEventLoop, EventLoopProxy};
use winit::raw_window_handle::HasDisplayHandle;
use winit::window::Window;

use super::engine::DISPATCH;
use super::window::{Options, ViewError};
use crate::present::{self, Surface};
use crate::render::Renderer;
use crate::vulkan::VulkanError;

/// Texels along a side of a texture that every device has; egui asks before it makes its fonts.
const TEXELS: usize = 2048;

/// A window and what draws in it.
pub(super) struct Screen {
    // Before the window it draws in.
    pub(super) surface: Surface,
    pub(super) egui: egui_winit::State,
    pub(super) renderer: Renderer,
    pub(super) window: Arc<Window>,
    /// How often the device was opened.
    opened: usize,
}

impl Screen {
    /// Opens the window. Other threads tell it of what happens through `proxy`.
    pub(super) fn open<T: From<accesskit_winit::Event> + Send>(
        events: &ActiveEventLoop,
        options: &Options,
        context: &Context,
        proxy: &EventLoopProxy<T>,
    ) -> Result<Self, ViewError> {
        // Pictures are measured in pixels; a hand wants its window as large on every screen.
        let usual = || Size::from(LogicalSize::new(1280.0, 800.0));
        let size = options.size.map_or_else(usual, |[width, height]| PhysicalSize::new(width, height).into());
        // Seen once AccessKit is there, and what can draw in it: Mesa asks for answers of a display that may be gone by then.
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

    /// The same window on a device that is opened anew; the one it had is lost, with all that was on it.
    pub(super) fn renewed(self, options: &Options) -> Result<Self, ViewError> {
        let Self { surface, mut egui, renderer, window, opened } = self;
        // A window has one swapchain at a time.
        drop((surface, renderer));
        let (surface, renderer) = device(options, &window)?;
        // Another size makes egui send its fonts once more: it believes that they are on the device.
        egui.set_max_texture_side(TEXELS - opened % 2);
        Ok(Self { surface, egui, renderer, window, opened: opened + 1 })
    }
}

/// A device that shows pictures in `window`.
fn device(options: &Options, window: &Arc<Window>) -> Result<(Surface, Renderer), ViewError> {
    let display = window.display_handle().map_err(|_| VulkanError::NoWindow { lacking: "a display".to_owned() })?;
    let device = present::open_device(&options.device, options.validation, display.as_raw())?;
    let surface = Surface::new(&device, Arc::clone(window))?;
    Ok((surface, Renderer::new(device).with_dispatches_of(DISPATCH)))
}
