//! Owned Vulkan handles.
