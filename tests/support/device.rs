//! Vulkan device for tests.

use relume::vulkan::{Device, DeviceChoice, Validation};

/// Opens a device with validation; `None` if GPU tests are skipped (`GPU_TESTS=skip`).
///
/// # Panics
///
/// If there is no such device; the error says how to get one.
#[expect(clippy::print_stderr, reason = "a test that ran on nothing says so")]
pub fn open() -> Option<Device> {
    if std::env::var("GPU_TESTS").as_deref() == Ok("skip") {
        eprintln!("skipped: GPU_TESTS=skip");
        return None;
    }
    match Device::open(&DeviceChoice::Auto, Validation::On) {
        Ok(device) => Some(device),
        Err(error) => panic!("this test needs a Vulkan device with validation: {error}"),
    }
}

/// Runs `test` on a device and fails on any validation message.
pub fn with_device(test: impl FnOnce(&Device)) {
    let Some(device) = open() else { return };
    test(&device);
    let messages = device.validation_messages();
    assert!(messages.is_empty(), "the validation layer says:\n{}", messages.join("\n"));
}
