//! A volume that exceeds its memory is rendered from bricks, truly and within the memory.
#![cfg(unix)]

use std::path::Path;
use std::time::Duration;

#[path = "../../benches/instruments/out_of_core.rs"]
#[allow(dead_code, reason = "the instrument prints more")]
mod instrument;

use instrument::out_of_core;

#[test]
fn a_volume_larger_than_its_memory_is_that_of_its_formula_and_takes_no_more() {
    let folder = tempfile::tempdir().unwrap();
    let program = Path::new(env!("CARGO_BIN_EXE_relume"));
    // 150 MiB with 30 MiB on the host and 16 MiB on the device.
    let dims = [512, 512, 600];
    let memory = [30 << 20, 16 << 20];
    let row = out_of_core(program, folder.path(), dims, memory, Duration::from_millis(100)).unwrap();
    assert!(row.is_true(), "{row:?}");
    let voxels = 150.0 * f64::from(1 << 20);
    assert!(row.peak[1] - row.beside <= row.allowed() && row.allowed() < voxels / 2.0, "{row:?}");
    let [on_device, on_device_again, read, again] = row.loaded;
    assert!(on_device_again == 0, "no brick is loaded twice: {row:?}");
    assert!(on_device > 0 && read > on_device, "bricks have neighbours: {row:?}");
    assert!(again > 0, "there is no room for all: {row:?}");
    // 8×8×10 bricks, and room for about 60 in memory and 27 on the device. Block by block each is read 7.0 times. The nearest ones
    // first read it 8.4 times, with room for 80.
    assert!(read < 8 * 640, "rounds read bricks again: {row:?}");
    // The slab of 64 slices takes 16 MiB.
    assert!(row.peak[0] <= voxels, "{row:?}");
}
