//! Marches on a software device reuse the memory of earlier ones. Alone in its process, so that page faults can be
//! counted.
#![cfg(target_os = "linux")]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::print_stdout, reason = "a test shows what it measured")]

mod support;

use relume::progress::Quiet;
use relume::vulkan::DeviceKind;

use support::rungs::{Rungs, with_renderer};
use support::scenes;

const SIZE: [usize; 2] = [400, 400];
/// Page size.
const PAGE: u64 = 4096;

/// Minor page faults of this process, as counted by `proc_pid_stat(5)`.
fn faults() -> u64 {
    let text = std::fs::read_to_string("/proc/self/stat").unwrap();
    text.rsplit(") ").next().unwrap().split(' ').nth(7).unwrap().parse().unwrap()
}

#[test]
fn marches_after_the_first_need_no_more_memory_of_the_system() {
    let rungs = Rungs::new(scenes::named("coloured_three"), SIZE);
    let left = (SIZE[0] * SIZE[1]) as u64 * rungs.planned.plan.pixel_bytes();
    with_renderer(|renderer| {
        if renderer.device().info().kind != DeviceKind::Software {
            println!("NOT RUN: only a software device takes its memory from the system page by page");
            return;
        }
        let statistics = rungs.scene.volume().statistics().unwrap();
        let uploaded = renderer.upload(&rungs.scene, &rungs.planned, &statistics, &Quiet).unwrap();
        let counted = [(); 3].map(|()| {
            let before = faults();
            renderer.march(&rungs.scene, &rungs.planned, &uploaded, SIZE, &Quiet).unwrap();
            faults() - before
        });
        println!("{counted:?} pages, and {} hold what a march leaves", left / PAGE);
        assert!(counted[0] >= left / PAGE / 2, "the first march takes them: {counted:?}");
        assert!(counted[2] < left / PAGE / 20, "{counted:?} pages for {left} bytes");
    });
}
