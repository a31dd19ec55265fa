//! A volume that exceeds its memory is rendered from bricks, truly and within the memory.
#![cfg(unix)]

use std::path::Path;
use std::time::Duration;

#[path = "../../benches/instruments/out_of_core.rs"]
#[allow(dead_code, reason = "the instrument prints more")]
mod instrument;

use instrument::{OutOfCore, out_of_core};

#[test]
fn a_volume_larger_than_its_memory_is_that_of_its_formula_and_takes_no_more() {
    let folder = tempfile::tempdir().unwrap();
    let program = Path::new(env!("CARGO_BIN_EXE_relume"));
    // 768 MiB with 96 MiB on the host and 64 MiB on the device.
    let (dims, memory) = OutOfCore::sizes(768);
    let row = out_of_core(program, folder.path(), dims, memory, Duration::from_millis(100)).unwrap();
    assert!(row.is_true(), "{row:?}");
    let voxels = 768.0 * f64::from(1 << 20);
    assert!(row.peak[1] - row.beside <= row.allowed() && row.allowed() < voxels / 2.0, "{row:?}");
    let [on_device, on_device_again, read, again] = row.loaded;
    assert!(on_device_again == 0, "no brick is loaded twice: {row:?}");
    assert!(on_device > 0 && read > on_device, "bricks have neighbours: {row:?}");
    assert!(again > 0, "there is no room for all: {row:?}");
    // 16×16×12 bricks. Block by block each is read 2.1 times.
    assert!(2 * read < 5 * 3072, "rounds read bricks again: {row:?}");
    // The slab of 64 slices takes 64 MiB.
    assert!(row.peak[0] <= voxels / 2.0, "{row:?}");
}
