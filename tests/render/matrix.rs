//! Every scene of the list (`tests/scenes.toml`) against every invariant.
#![expect(clippy::print_stdout, reason = "invariants that do not apply, and why")]

use crate::{blocks, bricks, ladder, support};

use std::cell::OnceCell;
use std::fmt::Write as _;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use glam::DVec3;
use relume::film::Film;
use relume::number::Real;
use relume::output::film::{Dial, FilmFile};
use relume::plan::{
    Accumulate, ClipPlan, FilmCounts, Groups, Integrate, Planned, ScenePlan, ShadingTerms, Share, Shares, Specular,
    Stale, Transmittance, plan,
};
use relume::progress::Quiet;
use relume::render::{Dispatching, Renderer, TableMemory};
use relume::scene::{
    AccumulateAs, Direction, FieldFactor, Gradients, Interpolation, Labels, Lighting, Lookup, Material, Mix, Overlap,
    Placement, Scene, SceneLight, Shading, ShadowMethod, StoreAs, Term, VolumeAs,
};
use relume::spectrum::colour::{XYZ_FROM_LINEAR_SRGB, Xyz, ciede2000, d65_white, lab_from_xyz};
use relume::spectrum::{Layers, Light, Spectrum, ThinFilm, ThinFilmAngle, standard};
use support::device::open;
use support::rungs::Rungs;
use support::scenes::{self, SIZE, float};
use support::tolerance::{
    DEVICE_MEAN, HALF_OF_TWO, LABEL_IN_SEGMENTS, RELIT_ABSOLUTE, RELIT_RELATIVE, SAME_GRID, SAME_WEIGHTS,
    WEIGHTS_DEVICE, WEIGHTS_DEVICE_P99,
};

/// An invariant: `Err` has the reason why it does not apply to a scene.
type Invariant = fn(&Case<'_>) -> Result<(), &'static str>;

const INVARIANTS: [(&str, Invariant); 9] = [
    ("rungs agree", rungs_agree),
    ("relit = rendered", relit_is_rendered),
    ("any division gives the same bytes", any_division_is_the_same),
    ("bricked = whole", bricked_is_whole),
    ("in blocks = whole", in_blocks_is_whole),
    ("half storage keeps its bound", half_storage_keeps_its_bound),
    ("the plan equals its literal", the_plan_is_its_literal),
    ("switched off = absent", switched_off_is_absent),
    ("each field is seen", each_field_is_seen),
];

/// A scene, and the films that several invariants compare with.
struct Case<'a> {
    name: &'static str,
    rungs: Rungs,
    renderer: Option<&'a Renderer>,
    film: OnceCell<Film<f32>>,
    single: OnceCell<Film<f32>>,
    double: OnceCell<Film<f64>>,
}

/// Answer of invariants without a device.
const NO_DEVICE: &str = "GPU_TESTS=skip";

impl<'a> Case<'a> {
    fn renderer(&self) -> Result<&'a Renderer, &'static str> {
        self.renderer.ok_or(NO_DEVICE)
    }

    /// The film of the device.
    fn film(&self) -> Result<&Film<f32>, &'static str> {
        let renderer = self.renderer()?;
        Ok(self.film.get_or_init(|| self.rungs.gpu(renderer)))
    }

    /// The film of the reference in f32.
    fn single(&self) -> &Film<f32> {
        self.single.get_or_init(|| self.rungs.march(&self.rungs.stored::<f32>()))
    }

    /// The film of the reference in f64.
    fn double(&self) -> &Film<f64> {
        self.double.get_or_init(|| self.rungs.march(&self.rungs.stored::<f64>()))
    }

    /// The same scene with another plan.
    fn planned(&self, change: impl FnOnce(&mut ScenePlan)) -> Rungs {
        let mut rungs = self.rungs.clone();
        change(&mut rungs.planned.plan);
        rungs
    }

    fn plan(&self) -> &ScenePlan {
        &self.rungs.planned.plan
    }
}

/// Checks every invariant of the scene `name`.
fn check(name: &'static str) {
    let device = open();
    let renderer = device.map(Renderer::new);
    let case = Case {
        name,
        rungs: Rungs::new(scenes::named(name), SIZE),
        renderer: renderer.as_ref(),
        film: OnceCell::new(),
        single: OnceCell::new(),
        double: OnceCell::new(),
    };
    let mut broken = Vec::new();
    for (invariant, check) in INVARIANTS {
        match catch_unwind(AssertUnwindSafe(|| check(&case))) {
            Ok(Ok(())) => {}
            Ok(Err(reason)) => println!("{name}: {invariant}: not here: {reason}"),
            Err(_) => broken.push(invariant),
        }
    }
    assert!(broken.is_empty(), "{name}: broken: {}", broken.join("; "));
    let messages = renderer.map_or_else(Vec::new, |renderer| renderer.device().validation_messages());
    assert!(messages.is_empty(), "{name}: the validation layer says:\n{}", messages.join("\n"));
}

/// All bits of a film.
pub(super) fn bits<R: Real>(film: &Film<R>) -> Vec<u64> {
    film.accumulators.iter().chain(&film.transmittance).map(|number| number.to_f64().to_bits()).collect()
}

fn assert_same_bytes(what: &str, found: &Film<f32>, expected: &Film<f32>) {
    let (found, expected) = (bits(found), bits(expected));
    let mut pairs = found.iter().zip(&expected).enumerate().filter(|(_, (one, other))| one != other);
    let first = pairs.next().map(|(i, (one, other))| (i, f64::from_bits(*one), f64::from_bits(*other)));
    let differ = pairs.count() + usize::from(first.is_some());
    assert!(
        found.len() == expected.len() && differ == 0,
        "{what}: {differ} of {} numbers differ; first index, found and expected: {first:?}",
        expected.len()
    );
}

/// ΔE00 of each pixel where white has Y = 1, sorted.
pub(super) fn differences(found: &[DVec3], expected: &[DVec3]) -> Vec<f64> {
    let lab = |xyz: &DVec3| lab_from_xyz(Xyz(xyz.to_array()), d65_white());
    let mut all: Vec<f64> = found.iter().zip(expected).map(|(a, b)| ciede2000(lab(a), lab(b))).collect();
    all.sort_by(f64::total_cmp);
    all
}

/// All 81 bands, f64 on the stored tables, f32 and the device: within derived bounds where there are some
/// (`ladder::climb`), otherwise as colours, the brightest of which is white.
fn rungs_agree(case: &Case<'_>) -> Result<(), &'static str> {
    let (rungs, name, plan) = (&case.rungs, case.name, case.plan());
    // In the phantom of glass, more rays end on a whole step than the bounds leave out.
    if ladder::has_bounds(plan) && !name.starts_with("glass_") {
        ladder::climb(name, rungs, case.renderer);
        return Ok(());
    }
    let matrices = rungs.xyz_matrices();
    let double = case.double().relight(&matrices);
    let brightest = double.iter().map(|xyz| xyz.y).fold(0.0, f64::max);
    assert!(brightest > 0.05, "{name} is dark: {brightest}");
    let apart = |found: &[DVec3], expected: &[DVec3]| {
        let shown = |all: &[DVec3]| all.iter().map(|&xyz| xyz / brightest).collect::<Vec<_>>();
        let all = differences(&shown(found), &shown(expected));
        [all[all.len() * 99 / 100], all[all.len() - 1]]
    };
    // 81 bands divide segments otherwise, and a stated k keeps no tolerance.
    let is_exact = rungs.planned.model.is_none() && plan.thin_films == FilmCounts::default();
    let mut expected = double.clone();
    if plan.integration == Integrate::Samples && rungs.scene.accuracy.dimension.is_none() && plan.rays == 1 {
        let truth = rungs.stored_truth();
        let limit = if is_exact { SAME_WEIGHTS } else { rungs.scene.accuracy.tolerance };
        let [_, error] = apart(&double, &truth);
        assert!(error <= limit, "{name}: f64 against 81 bands: ΔE00 {error}");
        if is_exact {
            expected = truth;
        }
    }
    let is_plain = !plan.light.is_dimmed() && plan.phases == 0 && plan.thin_films == FilmCounts::default();
    let limits = match (plan.integration, plan.labels) {
        (Integrate::Segments, true) => LABEL_IN_SEGMENTS,
        (Integrate::Segments | Integrate::Refined, false) if is_plain => [WEIGHTS_DEVICE_P99, WEIGHTS_DEVICE],
        _ => [SAME_GRID; 2],
    };
    let single = case.single().relight(&matrices);
    let device = case.film().ok().map(|film| film.relight(&matrices));
    for (rung, found) in [("f32", Some(&single)), ("the device", device.as_ref())] {
        let Some(found) = found else { continue };
        let [p99, largest] = apart(found, &expected);
        assert!(p99 <= limits[0] && largest <= limits[1], "{name}: {rung}: ΔE00 {p99} in 99 %, {largest} in all");
    }
    // Of a filter with eight bits, exact interpolation takes the place (`Rungs::gpu`).
    let is_smooth = plan.interpolation != Interpolation::Nearest && plan.integration == Integrate::Samples;
    if let Some(device) = device.filter(|_| is_smooth && !plan.light.is_dimmed()) {
        let apart = device.iter().zip(&single).map(|(a, b)| (*a - *b).abs().max_element());
        let mean = apart.sum::<f64>() / float(device.len());
        // Narrow phase functions are thousands of times as bright as white.
        let scale = if plan.phases > 0 { brightest.max(1.0) } else { 1.0 };
        assert!(mean <= DEVICE_MEAN * scale, "{name}: mean XYZ {mean} apart");
    }
    Ok(())
}

/// Other spectra and intensities leave the film as it is, and a light outside the scene at the place of one of its lights, from
/// a film file, gives the picture that is rendered under it.
fn relit_is_rendered(case: &Case<'_>) -> Result<(), &'static str> {
    let (rungs, name, renderer, film) = (&case.rungs, case.name, case.renderer()?, case.film()?);
    let (scene, planned) = (&rungs.scene, &rungs.planned);
    let mut other = scene.clone();
    for (light, name) in other.lights.iter_mut().zip(["FL11", "A", "LED-RGB1"].into_iter().cycle()) {
        light.spectrum = standard::light(name).unwrap();
        light.intensity *= 3.0;
    }
    if planned.model.is_none() {
        assert_eq!(Stale::between(scene, planned, &other), Stale::Picture, "{name}: nothing else is stale");
        assert_eq!(plan(&other, &Quiet).unwrap().plan, planned.plan, "{name}: the plan under other lights");
    }
    let fresh = Rungs::planned(other, planned.clone(), SIZE).gpu(renderer);
    assert_same_bytes(&format!("{name}, other lights"), &fresh, film);

    let dial = Dial { hand: None, normalise: false, master: 1.0, nodes: Vec::new(), presets: Vec::new() };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("film.exr");
    FilmFile::of_march(scene, planned, &rungs.mix, dial, film.clone()).unwrap().write(&path).unwrap();
    let mut file = FilmFile::read(&path).unwrap();
    let means = file.relightable().unwrap();
    let stored = file.take_film();
    // Without gradients, segments are divided otherwise (docs/theory/segments.md): there, a directed light.
    let placement = |position: usize| planned.positions[position].placement;
    let suits = |position| planned.plan.integration == Integrate::Samples || placement(position) != Placement::Ambient;
    let directed = rungs.mix.0.iter().filter(|light| suits(light.position));
    let all: Vec<_> = if directed.clone().next().is_some() { directed.collect() } else { rungs.mix.0.iter().collect() };
    // Phase functions give each direction numbers of its own.
    let few = planned.plan.phases > 0 && planned.plan.light.arrivals.len() <= 4;
    for light in all.into_iter().take(if few { 4 } else { 1 }) {
        let mut light = light.clone();
        (light.spectrum, light.weight) = (Light::new(Spectrum::gaussian(540.0, 25.0, 1.0).unwrap()).unwrap(), 1.7);
        let relit = means.relight(&stored, &Mix(vec![light.clone()]));
        let mut alone = scene.clone();
        alone.lights = vec![SceneLight {
            name: "new".into(),
            spectrum: light.spectrum,
            intensity: light.weight,
            placement: placement(light.position),
            shadows: planned.positions[light.position].shadows,
        }];
        alone.accuracy.accumulate =
            if planned.model.is_some() { AccumulateAs::Spectral } else { AccumulateAs::Weights };
        alone.accuracy.dimension = planned.model.as_ref().map(|model| model.dimension());
        let replanned = Planned { model: planned.model.clone(), ..plan(&alone, &Quiet).unwrap() };
        let alone = Rungs::planned(alone, replanned, SIZE);
        let marched = alone.gpu_accumulators(renderer);
        let plan_of_alone = ScenePlan { light: planned.plan.light.clone(), ..alone.planned.plan.clone() };
        // Ambient light has numbers of its own in a step.
        let is_same = plan_of_alone == planned.plan && alone.planned.plan.parts() == planned.plan.parts();
        // The texts of more than four directions differ, and a device may round one unit otherwise.
        if is_same && planned.plan.light.arrivals.len() <= 4 {
            let part = alone.planned.plan.components() * SIZE[0] * SIZE[1];
            let own = renderer.read(&marched).unwrap().accumulators;
            assert!(own == film.accumulators[light.position * part..][..part], "{name}: {} alone", light.name);
        } else if !is_same && planned.plan.integration != Integrate::Samples {
            return Err("steps are divided by the largest number of a step, and one light has other numbers");
        }
        let shown = renderer.relight_linear(&marched).unwrap();
        shown.run(&alone.matrices()).unwrap();
        let in_xyz = |rgb: DVec3| *XYZ_FROM_LINEAR_SRGB * rgb;
        for (relit, [r, g, b, _]) in relit.into_iter().zip(shown.read::<[f32; 4]>().unwrap()) {
            let (relit, fresh) = (in_xyz(relit), in_xyz([r, g, b].map(f64::from).into()));
            let limit = RELIT_RELATIVE * fresh.abs().max_element() + RELIT_ABSOLUTE;
            assert!((relit - fresh).abs().max_element() <= limit, "{name}: {relit} for {fresh} under one light");
        }
    }
    Ok(())
}

/// Bands, slices, workgroups and the memory of tables, with and without empty-space skipping.
fn any_division_is_the_same(case: &Case<'_>) -> Result<(), &'static str> {
    let (name, renderer, film) = (case.name, case.renderer()?, case.film()?);
    let usual = Dispatching::default();
    // The fill of a light grid is cut too.
    let cut = Dispatching { samples: Some(64), slice: 7, ..usual };
    let ways = [
        cut,
        Dispatching { samples: Some(1), slice: 7, ..usual },
        Dispatching { samples: Some(3000), slice: 64, ..usual },
        Dispatching { group: [16, 4], ..usual },
        Dispatching { group: [1, 64], ..usual },
        Dispatching { group: [64, 1], samples: Some(1), slice: 31, ..usual },
        Dispatching { tables: TableMemory::Storage, ..usual },
        Dispatching { tables: TableMemory::Uniform, ..usual },
    ];
    // Workgroups and memory have pipelines of their own, which take long: in one scene of each kind.
    let everywhere = if EVERY_WAY.contains(&name) { ways.len() } else { 1 };
    // There, rays end early too.
    let mut ended = case.rungs.clone();
    ended.scene.accuracy.termination = if everywhere > 1 { 1e-3 } else { case.rungs.scene.accuracy.termination };
    let whole = if everywhere > 1 { &ended.gpu(renderer) } else { film };
    for (i, way) in ways.into_iter().take(everywhere).flat_map(|way| [(0, way), (1, way)]).skip(1) {
        let mut rungs = ended.clone();
        rungs.planned.plan.skipping &= i == 0;
        rungs.scene.accuracy.skipping = rungs.planned.plan.skipping;
        let renderer = renderer.clone().with_dispatching(way);
        let cut = rungs.gpu_accumulators(&renderer);
        assert!(cut.dispatches > 1 || way.samples.is_none(), "{name}: {way:?}: {} dispatches", cut.dispatches);
        assert_same_bytes(&format!("{name}, {way:?}"), &renderer.read(&cut).unwrap(), whole);
    }
    Ok(())
}

/// Scenes that are marched in every way: highlights, labels, the eye inside, X-ray materials and coloured absorption.
const EVERY_WAY: [&str; 12] = [
    "specular_three",
    "labels",
    "inside",
    "xray",
    "coloured_three",
    "segments_specular_three",
    "segments_labels",
    "segments_inside",
    "segments_xray",
    "segments_coloured_three",
    "refined_specular",
    "refined_inside",
];

/// A volume of several bricks along each axis, in pools of two slots, of some, and of all.
fn bricked_is_whole(case: &Case<'_>) -> Result<(), &'static str> {
    let (renderer, plan) = (case.renderer()?, case.plan());
    if plan.light.grid_lights() > 0 {
        return Err(
            "shadows of bricks come from a coarse level (`bricks::shadows_from_means_of_a_ramp_are_those_of_the_ramp`)",
        );
    }
    if plan.phases > 0 || plan.thin_films != FilmCounts::default() || plan.light.is_dimmed() {
        return Err("light is scattered behind the fetch: the scene without these features checks it");
    }
    if plan.interpolation != Interpolation::Linear || plan.gradients != Gradients::Packed {
        return Err("`bricks::every_interpolation_and_gradient_reads_the_voxels_around_a_brick`");
    }
    if plan.rays > 1 || !plan.skipping {
        return Err("`bricks::slices_rays_of_a_pixel_and_unskipped_macrocells_change_no_bit`");
    }
    if case.rungs.scene.volume().voxels.voxel_type() != relume::volume::VoxelType::U16 && !plan.labels {
        return Err("a phantom of fractions, and `large` has 16 bits");
    }
    let rungs = Rungs::new(bricks::large(case.rungs.scene.clone()), bricks::SIZE);
    let counts = bricks::assert_same(case.name, &rungs, renderer, &[2, 6, 1000]);
    assert!(counts[0].rounds > 3 && counts[2].rounds == case.plan().rays, "{counts:?}");
    assert!(counts[2].loaded == counts[2].visible, "{counts:?}");
    assert!(
        case.plan().rays > 1 || counts.iter().all(|counts| counts.again == 0),
        "a brick is loaded twice: {counts:?}"
    );
    Ok(())
}

/// Films of blocks composite to the film of one march, and a march that goes on from block to block is one march to the bit.
fn in_blocks_is_whole(case: &Case<'_>) -> Result<(), &'static str> {
    let (film, plan) = (case.film()?, case.plan());
    if plan.rays > 1 {
        return Err("rays of a pixel are not relayed");
    }
    if plan.blending.is_extreme() {
        return Err("the film of a part of a ray does not hold its values: refused");
    }
    if plan.integration == Integrate::Refined {
        return Err(
            "a part of a ray does not know the light that is left: `blocks::blocks_refine_steps_alike_and_more_than_one_march`",
        );
    }
    if plan.phases > 0 || plan.thin_films != FilmCounts::default() || plan.light.is_dimmed() {
        return Err("light is scattered behind the ends of a ray: `blocks::cases` has films and shadows");
    }
    // The others have the same kinds of films.
    if ladder::has_bounds(plan) {
        blocks::composite_is_whole(case.name, &case.rungs, case.renderer, &[3]);
    }
    let relayed = blocks::relayed(&case.rungs, case.renderer()?, 3, SIZE[1]);
    assert_same_bytes(&format!("{}, from block to block", case.name), &relayed, film);
    Ok(())
}

/// Numbers in 16 bits are the nearest ones on every rung, and colours move by no more than is reported.
fn half_storage_keeps_its_bound(case: &Case<'_>) -> Result<(), &'static str> {
    let name = case.name;
    let half = case.planned(|plan| plan.storage = StoreAs::Half);
    if !case.plan().light.is_dimmed() {
        assert_nearest(&format!("{name}, f64"), &half, case.double(), &half.march(&half.stored::<f64>()));
    }
    assert_nearest(&format!("{name}, f32"), &half, case.single(), &half.march(&half.stored::<f32>()));
    let (film, stored) = (case.film()?, half.gpu(case.renderer()?));
    assert_nearest(&format!("{name}, device"), &half, film, &stored);
    // Lights that add up to a white of Y = 1.
    let mut mix = half.mix.clone();
    let total: f64 = mix.0.iter().map(|light| light.weight).sum();
    mix.0.iter_mut().for_each(|light| light.weight /= total);
    let matrices = support::rungs::in_xyz(&half.matrices_under(&mix));
    let worst = differences(&stored.relight(&matrices), &film.relight(&matrices)).pop().unwrap();
    let reported = half.planned.half_precision_error(&half.scene).unwrap();
    assert!(worst > 0.0 && worst <= reported + HALF_OF_TWO, "{name}: ΔE00 {worst}, reported {reported}");
    Ok(())
}

/// Asserts that `half` is `full` rounded to the nearest value.
fn assert_nearest<R: Real>(what: &str, rungs: &Rungs, full: &Film<R>, half: &Film<R>) {
    let nearest = |number: R| half::f16::from_f64(number.to_f64()).to_f64();
    let same = |full: &[R], half: &[R], rounded: bool| {
        assert_eq!(full.len(), half.len(), "{what}");
        for (&full, &half) in full.iter().zip(half) {
            let expected = if rounded { nearest(full) } else { full.to_f64() };
            assert!((half.to_f64() - expected).abs() <= 0.0, "{what}: {half:?} for {full:?}");
        }
    };
    same(&full.accumulators, &half.accumulators, true);
    same(&full.transmittance, &half.transmittance, rungs.planned.plan.transmittance == Transmittance::Coloured);
}

fn the_plan_is_its_literal(case: &Case<'_>) -> Result<(), &'static str> {
    assert_eq!(features(case.plan()), scenes::all()[case.name].plan, "{}", case.name);
    Ok(())
}

/// The features of `plan` in words; those that every plan has are left out.
pub(super) fn features(plan: &ScenePlan) -> String {
    let ScenePlan {
        accumulate,
        transmittance,
        light,
        shading,
        phases,
        thin_films,
        groups,
        clip,
        labels,
        smooth_labels,
        labels_by_value,
        background,
        lookup,
        integration,
        blending,
        interpolation,
        volume,
        gradients,
        skipping,
        rays,
        jitter,
        crossings,
        compensated,
        storage,
    } = plan;
    let mut words = match *accumulate {
        Accumulate::Weights { materials } => format!("{materials} weights"),
        Accumulate::Spectral { dimension, shares, exponents } => {
            let own = if shares == Shares::Own { ", own shares" } else { "" };
            let shiny = if exponents > 0 { format!(", {exponents} exponents") } else { String::new() };
            format!("k = {dimension}{own}{shiny}")
        }
    };
    match transmittance {
        Transmittance::Grey => {}
        Transmittance::Coloured => words += ", coloured",
        Transmittance::Mixed => words += ", a matrix",
    }
    words += "; light ";
    for (i, arrival) in light.arrivals.iter().enumerate() {
        let before = i.checked_sub(1).map(|before| light.arrivals[before].accumulator);
        words += match before {
            None => "",
            Some(before) if before == arrival.accumulator => "+",
            Some(_) => ", ",
        };
        words += match arrival.direction {
            Direction::Everywhere => "ambient",
            Direction::Eye => "eye",
            Direction::Infinity => "direction",
            Direction::Place => "point",
        };
        match arrival.share {
            Share::Open => {}
            Share::OfRay => words += " of ray",
            Share::Behind(number) => _ = write!(words, " behind {number}"),
        }
    }
    let mut add = |is_there: bool, what: String| {
        if is_there {
            words += "; ";
            words += &what;
        }
    };
    add(light.occluded, "occluded".into());
    add(light.method != ShadowMethod::Grid, format!("{:?}", light.method));
    add(light.gathered.is_some(), "scattered".into());
    add(light.absorbers > 0, format!("{} absorbers", light.absorbers));
    if let Some(ShadingTerms { diffuse, specular, one_sided }) = shading {
        add(true, if *diffuse { "diffuse" } else { "flat" }.into());
        match specular {
            None => {}
            Some(Specular { one_exponent: Some(exponent), .. }) => add(true, format!("exponent {exponent}")),
            Some(Specular { exponent_bits, .. }) => add(true, format!("exponents of {exponent_bits} bits")),
        }
        add(*one_sided, "one-sided".into());
    }
    add(*phases > 0, format!("{phases} phases"));
    let FilmCounts { facing, lobe, terms, exponent_bits } = *thin_films;
    add(
        *thin_films != FilmCounts::default(),
        format!("films: {facing} facing, {lobe} lobes, {terms} terms, {exponent_bits} bits"),
    );
    let Groups { number, points, by_fields: [by, by_points], shapes, fields: _, further, sharing, overlap, lit: _ } =
        *groups;
    let lit = groups.lit_fields().count();
    let apart = if number > 1 && further == 0 { format!(" in {number} groups") } else { String::new() };
    add(points > 0, format!("thinned at {points}{apart}"));
    let placed = if further > sharing { format!(", {} placed", further - sharing) } else { String::new() };
    let lit = if lit > 0 { format!(", {lit} shaded") } else { String::new() };
    add(shapes[0] > 0, format!("{} shapes, {} by the gradient", shapes[0], shapes[1]));
    let by = if by > 0 { format!(", by {by} at {by_points}") } else { String::new() };
    let alone = if overlap == Overlap::Add { String::new() } else { format!(", {overlap:?} alone") };
    add(further > 0, format!("{} fields in {number} groups{by}{placed}{lit}{alone}", further + 1));
    let ClipPlan { planes, shortening, keeps_any, caps } = *clip;
    let own = if planes > shortening { format!(", {} of fields", planes - shortening) } else { String::new() };
    let any = if keeps_any { ", any keeps" } else { "" };
    add(planes > 0, format!("{planes} planes{own}{any}{}", if caps { " with caps" } else { "" }));
    let by_value = if *labels_by_value { " by value" } else { "" };
    add(*labels, format!("{}{by_value}", if *smooth_labels { "labels" } else { "nearest labels" }));
    add(*background, "background".into());
    add(*lookup != Lookup::Linear, "nearest entry".into());
    add(*integration == Integrate::Segments, "segments".into());
    add(*integration == Integrate::Refined, "refined".into());
    add(*crossings, "crossed intervals".into());
    add(blending.is_extreme(), format!("{blending:?}"));
    add(*interpolation != Interpolation::Linear, format!("{interpolation:?}"));
    add(*volume != VolumeAs::Auto, format!("{volume:?}"));
    add(*gradients != Gradients::Packed, format!("{gradients:?}"));
    add(!skipping, "unskipped".into());
    add(*rays > 1, format!("{rays} rays"));
    add(*jitter, "jitter".into());
    add(*compensated, "compensated".into());
    add(*storage != StoreAs::Single, format!("{storage:?}"));
    words
}

/// A change that has no effect, and its name.
type Neutral = (&'static str, fn(&mut Scene));

/// Features at values without an effect.
const NEUTRAL: [Neutral; 10] = [
    ("phase functions of -0", |scene| {
        scene.materials.iter_mut().filter(|it| it.phase == 0.0).for_each(|it| it.phase = -0.0);
    }),
    ("an opacity factor of 1", |scene| {
        if scene.transfer.gradient_opacity.is_empty() {
            scene.transfer.gradient_opacity = vec![(0.0, 1.0), (100.0, 1.0)];
        }
    }),
    ("an overlap of one field", |scene| {
        if scene.fields.further().is_empty() {
            scene.overlap = Overlap::Last;
        }
    }),
    ("factors of 1 by another field", |scene| {
        let names: Vec<String> = scene.fields.further().iter().map(|field| field.name.clone()).collect();
        if let Some((field, term)) = names.into_iter().next().zip(scene.transfer.terms.first_mut())
            && term.by.is_empty()
        {
            term.by = vec![FieldFactor { field, points: vec![(0.0, 1.0), (1.0, 1.0)] }];
        }
    }),
    ("thin films where no light has an angle", |scene| {
        let layers = Layers { index: 1.33, thickness_nm: 400.0, above: 1.0, below: 1.0 };
        for material in scene.materials.iter_mut().filter(|it| it.film.is_none()) {
            let angle = match (scene.shading, material.specular > 0.0) {
                (Shading::None, _) => ThinFilmAngle::Facing,
                _ if material.diffuse <= 0.0 => ThinFilmAngle::Facing,
                (_, false) => ThinFilmAngle::Lobe,
                _ => continue,
            };
            material.film = Some(ThinFilm::new(layers, angle).unwrap());
        }
    }),
    ("a material that nothing shows", |scene| {
        let unseen = Material { name: "unseen".into(), specular: 0.7, phase: 0.9, ..scene.materials[0].clone() };
        scene.materials.push(unseen);
    }),
    ("labels that are not declared", |scene| {
        let zeros = relume::volume::phantom::slab(scene.frame.geometry.dims, 0).unwrap();
        scene.labels.get_or_insert_with(|| Labels { volume: Arc::new(zeros), declared: Vec::new() });
    }),
    ("a reach beyond the volume", |scene| scene.shadows.reach = scene.shadows.reach.or(Some(1e30))),
    ("one-sided lighting without shading", |scene| {
        if scene.shading == Shading::None {
            scene.lighting = Lighting::OneSided;
        }
    }),
    ("settings of shadows without any", |scene| {
        if !scene.asks_for_shadows() {
            (scene.shadows.spacing, scene.shadows.start, scene.shadows.directions) = (4.0, Some(7.0), 9);
        }
    }),
];

/// Features at values without an effect leave plan and bytes, and so does what is never seen: empty space that is marched.
fn switched_off_is_absent(case: &Case<'_>) -> Result<(), &'static str> {
    let name = case.name;
    let mut scene = case.rungs.scene.clone();
    for (what, change) in NEUTRAL {
        change(&mut scene);
        let found = plan(&scene, &Quiet).unwrap().plan;
        assert_eq!(&found, case.plan(), "{name} with {what}");
    }
    let neutral = Rungs::new(scene, SIZE);
    assert_same_bytes(
        &format!("{name} with features switched off"),
        &neutral.march(&neutral.stored::<f32>()),
        case.single(),
    );
    let film = case.film()?;
    assert_same_bytes(&format!("{name} with features switched off, device"), &neutral.gpu(case.renderer()?), film);
    let mut walking = case.planned(|plan| plan.skipping = !plan.skipping);
    walking.scene.accuracy.skipping = walking.planned.plan.skipping;
    assert_same_bytes(&format!("{name} without empty-space skipping"), &walking.gpu(case.renderer()?), film);
    Ok(())
}

/// Without what a further field shows, the picture is another: a scene of several fields checks all of them.
fn each_field_is_seen(case: &Case<'_>) -> Result<(), &'static str> {
    let scene = &case.rungs.scene;
    if scene.fields.further().is_empty() {
        return Err("there is one");
    }
    let further = scene.fields.further().iter().enumerate();
    for (index, field) in further.filter(|(index, _)| !scene.hidden[index + 1]) {
        let flat = |points: &[(f64, f64)]| points.iter().map(|point| (point.0, 0.0)).collect();
        let hidden =
            |term: &Term| Term { opacity: flat(&term.opacity), absorption: flat(&term.absorption), ..term.clone() };
        let mut without = scene.clone();
        without.fields.show(index, field.terms.iter().map(hidden).collect());
        if field.terms.is_empty() {
            // A mask is seen in what it scales.
            let unscaled = |term: &Term| Term { by: Vec::new(), ..term.clone() };
            without.transfer.terms = scene.transfer.terms.iter().map(unscaled).collect();
        }
        let without = Rungs::planned(without, case.rungs.planned.clone(), SIZE);
        let found = without.march(&without.stored::<f32>());
        assert!(bits(&found) != bits(case.single()), "{}: volumes.{} is not seen", case.name, field.name);
    }
    Ok(())
}

macro_rules! matrix {
    ($($name:ident)*) => {$(
        #[test]
        fn $name() {
            check(stringify!($name));
        }
    )*

        #[test]
        fn every_scene_of_the_list_is_checked() {
            let mut names = [$(stringify!($name)),*];
            names.sort_unstable();
            assert_eq!(scenes::all().keys().map(String::as_str).collect::<Vec<_>>(), names);
        }
    };
}

matrix! {
    unshaded_one unshaded_three diffuse_one diffuse_three specular_one specular_three xray labels nearest_labels
    background orthographic inside negative cropped rotated nearest ambient_only coloured_one coloured_three
    coloured_labels coloured_background coloured_xray sharpened sharpened_semigroup segments_unshaded_three
    segments_diffuse_three segments_specular_three segments_xray segments_labels segments_background segments_inside
    segments_cropped segments_rotated segments_ambient_only segments_coloured_three segments_coloured_labels
    segments_coloured_xray segments_sharpened_semigroup segments_central segments_cubic segments_exact_linear
    segments_nearest_lookup segments_thinned segments_unskipped segments_long_steps segments_unshaded_cubic
    segments_unshaded_exact_linear thinned_unshaded_one thinned_diffuse_three thinned_specular_three thinned_labels
    thinned_xray thinned_coloured_three thinned_coloured_labels thinned_sharpened rectangles_unshaded rectangles_diffuse_three rectangles_coloured rectangles_labels rectangles_segments rectangles_segments_coloured rectangles_central rectangles_nearest rectangles_cropped rectangles_shadows fields_two fields_four fields_coloured clipped_unshaded clipped_diffuse_three clipped_coloured_three clipped_labels clipped_segments clipped_segments_coloured clipped_central clipped_rectangles clipped_shadows clipped_rotated clipped_fields placed_two placed_three placed_coloured placed_cubic placed_exact_linear placed_nearest placed_shaded placed_central placed_shadows placed_clipped placed_unskipped maximum_one maximum_shaded maximum_shadows maximum_coloured maximum_background maximum_xray maximum_four maximum_placed maximum_placed_coloured maximum_clipped maximum_cropped maximum_inside maximum_nearest maximum_cubic maximum_rays maximum_unskipped minimum_one minimum_placed rows rows_nearest rows_equal rows_nearest_lookup rows_rectangles rows_coloured rows_shadows rows_fields labels_fields labels_fields_nearest labels_fields_shared labels_fields_shadows labels_absorbing lit_placed lit_central lit_exact_linear lit_cubic lit_channels lit_beside_flat lit_specular lit_coloured lit_shadows lit_labels lit_clipped lit_clipped_channels lit_one_sided labels_fields_alone lit_alone shape_triangle shape_unshaded shape_coloured shape_central shape_thinned shape_shadows shape_ratio shape_placed shape_lit overlap_first overlap_last overlap_four overlap_cubic overlap_coloured overlap_xray overlap_lit overlap_lit_channels overlap_labels overlap_shadows overlap_by overlap_cut corner_unshaded corner_diffuse_three corner_coloured_three corner_labels corner_central corner_thinned corner_shadows corner_fields corner_inside cut_first cut_coloured cut_shadows cut_lit cut_lit_channels cut_labels cut_cropped by_two by_four by_mask by_mask_cubic by_mask_coloured by_thinned by_shadows by_lit by_lit_channels by_labels fields_cubic fields_exact_linear fields_xray fields_unskipped fields_cropped fields_thinned fields_shadows interpolation_nearest_three
    interpolation_exact_linear_three interpolation_cubic_three interpolation_nearest_unshaded
    interpolation_exact_linear_unshaded interpolation_cubic_unshaded interpolation_nearest_labels
    interpolation_exact_linear_labels interpolation_cubic_labels interpolation_nearest_coloured
    interpolation_exact_linear_coloured interpolation_cubic_coloured rays_three rays_segments_three rays_background
    rays_segments_background rays_coloured rays_segments_coloured rays_inside rays_segments_inside rays_specular
    segments_nearest_labels segments_orthographic glass_k_3 glass_k_8
    glass_tolerance glass_sharpened glass_rgb shadows_unshaded shadows_gradient shadows_one_of_two shadows_headlight
    shadows_headlight_unshaded shadows_highlights shadows_cropped shadows_exact_linear shadows_nearest_lookup
    shadows_thinned shadows_segments shadows_five shadows_three_kinds shadows_labels shadows_rotated shadows_one_sided
    scattered scattered_sky scattered_lit scattered_labels scattered_coloured scattered_fields scattered_clip
    shadows_sky_unshaded shadows_sky shadows_sky_beside_one shadows_sky_second_texel shadows_sky_segments
    shadows_sky_few_directions shadows_sky_reach shadows_ambient shadows_ambient_of_open shadows_ambient_reach
    shadows_ambient_three_point shadows_point_outside shadows_point_inside shadows_points_beside_all shadows_three_point
    shadows_three_point_unshaded shadows_three_point_beside_one shadows_three_point_third_number
    shadows_three_point_fourth_number shadows_three_point_second_texel shadows_three_point_and_open stained
    stained_unshaded stained_two stained_three_point stained_every stained_every_unshaded stained_phases
    stained_own_shares stained_labels stained_xray stained_background stained_one_of_two stained_exact_linear
    stained_one_sided stained_thinned stained_cropped stained_segments stained_semigroup stained_bands phases_one
    phases_three phases_four phases_orthographic phases_inside phases_rotated phases_cropped phases_labels
    phases_nearest_labels phases_background phases_xray phases_thinned phases_exact_linear phases_shadows phases_every
    phases_five phases_forwards phases_backwards phases_grey phases_grey_shadows phases_coloured phases_coloured_labels
    phases_coloured_xray phases_alike phases_sharpened phases_segments phases_grey_segments phases_coloured_thinned
    fields_hidden fields_hidden_mask occludes_unshaded occludes_three occludes_coloured occludes_segments occludes_shadows
    occludes_labels occludes_fields occludes_sharpened refined_unshaded refined_three refined_specular refined_xray refined_coloured
    refined_labels refined_nearest_labels refined_rows refined_background refined_cropped refined_inside refined_rotated
    refined_nearest refined_central refined_cubic refined_exact_linear refined_thinned refined_rectangles refined_shape
    refined_shadows refined_phases refined_films refined_clipped refined_rays refined_unskipped refined_long_steps
    refined_finely refined_own_shares refined_orthographic crossed_unshaded crossed_three crossed_coloured crossed_thinned
    crossed_cropped crossed_nearest crossed_unskipped crossed_rays jitter_unshaded jitter_three jitter_coloured jitter_labels
    jitter_cropped jitter_inside jitter_segments jitter_refined jitter_rays jitter_fields jitter_maximum jitter_clipped
    jitter_shadows jitter_unskipped slices_z slices_x slices_y slices_central slices_refined slices_segments slices_fields
    slices_placed slices_shadows slices_labels
    films_three films_highlights films_labels films_shadows films_every films_grey films_coloured_shadows films_segments
}
