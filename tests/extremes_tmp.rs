//! Rows.
use relume::measure::extremes::Group;
use relume::progress::Quiet;
use relume::render::Renderer;
use relume::vulkan::{Device, DeviceChoice, Validation};
#[test]
fn all() {
    let want = std::env::var("G").unwrap_or_default();
    let renderer = Renderer::new(Device::open(&DeviceChoice::Auto, Validation::On).unwrap());
    let begin = std::time::Instant::now();
    for group in Group::ALL {
        if !want.is_empty() && !format!("{group:?}").contains(&want) {
            continue;
        }
        for extreme in group.extremes() {
            let start = std::time::Instant::now();
            let rows = extreme.rows(Some(&renderer), &Quiet);
            let took = start.elapsed().as_millis();
            for row in rows {
                println!("{} {row} [{took} ms]", if row.holds { "  " } else { "!!" });
            }
        }
        println!("=== {group:?} {:?}", begin.elapsed());
    }
    let messages = renderer.device().validation_messages();
    println!("validation: {messages:?}");
}
