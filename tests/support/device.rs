//! A device to test on.

use relume::vulkan::{Device, DeviceChoice, Validation};

/// A device with validation; none where tests that need one are to be skipped.
///
/// # Panics
///
/// Where there is no such device: the error says how to get one.
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

/// Runs `test` on a device, and fails where the validation layer has something to say.
pub fn with_device(test: impl FnOnce(&Device)) {
    let Some(device) = open() else { return };
    test(&device);
    let messages = device.validation_messages();
    assert!(messages.is_empty(), "the validation layer says:\n{}", messages.join("\n"));
}
