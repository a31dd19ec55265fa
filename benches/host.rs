//! Host work of a frame: storing a volume, macrocells, the transfer table, and relighting on the CPU.
#![expect(clippy::expect_used, reason = "a benchmark that cannot start fails")]

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};

use relume::document::{SceneOptions, load_peer};
use relume::film::{Film, Relightable};
use relume::plan::plan;
use relume::progress::Quiet;
use relume::scene::Mix;
use relume::tables::{Cells, Storage, TransferTable};

fn host(criterion: &mut Criterion) {
    let scene = load_peer(&SceneOptions::default(), &Quiet).expect("the embedded scene").scene;
    let planned = plan(&scene, &Quiet).expect("weights need no fit");
    let statistics = scene.volume().statistics().expect("the phantom has values");
    let storage = Storage::new(&planned.plan, scene.volume(), &statistics);
    let table = TransferTable::new(&scene, &planned, &[storage.domain]);
    let cells = Cells::new(scene.volume(), &storage, None);
    let mut group = criterion.benchmark_group("host");
    group.sample_size(10);
    group.bench_function("statistics", |bencher| bencher.iter(|| scene.volume().statistics()));
    group.bench_function("store 16 slices", |bencher| bencher.iter(|| storage.slab(scene.volume(), black_box(60..76))));
    group.bench_function("cells", |bencher| bencher.iter(|| Cells::new(scene.volume(), &storage, None)));
    group.bench_function("occupancy", |bencher| bencher.iter(|| cells.occupancy(&black_box(&table).active_entries())));
    group.bench_function("transfer table", |bencher| {
        bencher.iter(|| TransferTable::new(&scene, &planned, &[black_box(storage.domain)]));
    });

    let (size, means, mix) = ([400, 400], Relightable::new(&scene, &planned), Mix::of_scene(&scene));
    let pixels = size[0] * size[1];
    let (components, accumulators) = (means.components.len(), vec![0.1_f32; means.components.len() * pixels]);
    let film = Film { size, components, accumulators, transmittance: vec![0.5; pixels] };
    group.bench_function("relight matrices", |bencher| {
        bencher.iter(|| means.under(black_box(&mix)));
    });
    let matrices = means.under(&mix);
    group.bench_function("relight 400×400", |bencher| bencher.iter(|| black_box(&film).relight(&matrices)));
    group.finish();
}

criterion_group!(benches, host);
criterion_main!(benches);
