#![no_main]

#[path = "../../tests/support/hostile.rs"]
mod hostile;

use std::sync::LazyLock;

#[global_allocator]
static ALLOCATOR: hostile::Counting = hostile::Counting;

static PLACE: LazyLock<hostile::Place> = LazyLock::new(|| hostile::Place::new(hostile::Reader::Mgh, 1024));

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    PLACE.read(bytes);
});
