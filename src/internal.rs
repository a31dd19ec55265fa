//! Modules that only the program and its tests use; they may change in any release.

#[path = "annotate/mod.rs"]
pub mod annotate;
#[path = "input.rs"]
pub mod input;
#[path = "memory.rs"]
pub mod memory;
#[path = "number/mod.rs"]
pub mod number;
#[cfg(feature = "window")]
#[expect(unsafe_code, reason = "Vulkan, Xlib and window handles")]
#[path = "present/mod.rs"]
pub mod present;
#[path = "ranks/mod.rs"]
pub mod ranks;
#[path = "shader.rs"]
pub mod shader;
#[path = "view/mod.rs"]
pub mod view;
