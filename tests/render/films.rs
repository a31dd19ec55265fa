//! Thin films: closed forms of interference, terms and tables against 81 bands, plans, and the device against the reference.

use crate::phases::opened;
use crate::shadows::{largest_difference, occluded};
use crate::support;

use std::path::Path;

use glam::DVec3;
use relume::document::{self, Document, Edit, SceneOptions, Source};
use relume::model::ModelKind;
use relume::plan::{Accumulate, FilmCounts, PlanWarning, Stale, plan};
use relume::progress::Quiet;
use relume::scene::{AccumulateAs, Placement, Scene};
use relume::spectrum::colour::xyz_of;
use relume::spectrum::{Layers, Spectrum, ThinFilm, ThinFilmAngle, standard, wavelength_nm};
use support::rungs::{Rungs, with_renderer};
use support::scenes::{self, float, of, sampled};
use support::tolerance::SAME_GRID;

/// Size of the pictures: not square, and no multiple of a workgroup.
const SIZE: [usize; 2] = [22, 18];

const SOAP: Layers = Layers { index: 1.33, thickness_nm: 400.0, above: 1.0, below: 1.0 };
const OIL: Layers = Layers { index: 1.47, thickness_nm: 600.0, above: 1.0, below: 1.33 };
const FLAKE: Layers = Layers { index: 2.6, thickness_nm: 120.0, above: 1.5, below: 1.5 };

/// Reflectance of the interface between two media by Fresnel's equations, for a real angle of refraction.
fn fresnel(above: f64, below: f64, cosine: f64) -> f64 {
    let refracted = (1.0 - (above / below).powi(2) * (1.0 - cosine * cosine)).sqrt();
    let s = (above * cosine - below * refracted) / (above * cosine + below * refracted);
    let p = (below * cosine - above * refracted) / (below * cosine + above * refracted);
    f64::midpoint(s * s, p * p)
}

#[test]
fn a_film_of_no_thickness_or_of_an_index_beside_it_is_the_bare_interface() {
    let bare = [
        Layers { thickness_nm: 0.0, below: 2.5, ..SOAP },
        Layers { index: 1.0, below: 2.5, ..SOAP },
        Layers { index: 2.5, below: 2.5, ..SOAP },
        // Soap in air without thickness, and air in air.
        Layers { thickness_nm: 0.0, ..SOAP },
        Layers { index: 1.0, ..SOAP },
    ];
    for layers in bare {
        for cosine in [1.0, 0.7, 0.2, 0.01] {
            let expected = fresnel(layers.above, layers.below, cosine);
            let found = layers.reflectance(cosine);
            assert!(
                found.samples().iter().all(|found| (found - expected).abs() <= 1e-12),
                "{layers:?} at {cosine}: {:?}, not {expected}",
                found.samples()
            );
        }
    }
}

#[test]
fn a_quarter_wave_reflects_by_its_closed_form() {
    // ((n1 n3 − n2²)/(n1 n3 + n2²))² at λ = 4 n2 d, nothing for n2² = n1 n3; the bare interface at half of it.
    for (index, below) in [(1.5_f64.sqrt(), 1.5), (1.38, 1.52), (2.3, 1.52)] {
        let layers = Layers { index, thickness_nm: 550.0 / (4.0 * index), above: 1.0, below };
        let expected = ((below - index * index) / (below + index * index)).powi(2);
        let found = layers.reflectance_at(1.0, 550.0);
        assert!((found - expected).abs() <= 1e-12, "{layers:?}: {found}, not {expected}");
        let half = layers.reflectance_at(1.0, 275.0);
        assert!((half - fresnel(1.0, below, 1.0)).abs() <= 1e-12, "{layers:?}, a half wave: {half}");
    }
    // At an angle, the path is n2 d cos θ2.
    let (cosine, index) = (0.6_f64, 1.5_f64);
    let inside = (1.0 - (1.0 - cosine * cosine) / (index * index)).sqrt();
    let layers = Layers { index, thickness_nm: 550.0 / (2.0 * index * inside), ..SOAP };
    assert!(layers.reflectance_at(cosine, 550.0) <= 1e-12, "a half wave in air reflects nothing");
    assert!(layers.reflectance_at(cosine, 440.0) > 0.05);
}

#[test]
fn a_film_never_reflects_more_light_than_there_is() {
    for layers in [
        SOAP,
        OIL,
        FLAKE,
        Layers { thickness_nm: 5000.0, index: 5.0, above: 5.0, below: 1.0 },
        Layers { thickness_nm: 30.0, index: 1.0, above: 1.5, below: 1.5 },
        Layers { thickness_nm: 0.0, index: 1.0, above: 1.0, below: 1.0 },
    ] {
        for i in 0..=50 {
            let cosine = float(i) / 50.0;
            let found = layers.reflectance(cosine);
            assert!(found.samples().iter().all(|part| (0.0..=1.0).contains(part)), "{layers:?} at {cosine}: {found:?}");
        }
    }
    // Beyond the critical angle a thick gap of air reflects everything, and a thin one lets light through.
    let gap = |thickness_nm| Layers { thickness_nm, index: 1.0, above: 1.5, below: 1.5 }.reflectance_at(0.5, 500.0);
    assert!((gap(5000.0) - 1.0).abs() <= 1e-9 && gap(50.0) < 0.5, "{} and {}", gap(5000.0), gap(50.0));
}

#[test]
fn at_the_critical_angle_a_film_without_thickness_reflects_nothing() {
    // 1.25² · (1 − 0.6²) is 1 exactly.
    let layers = Layers { index: 1.0, thickness_nm: 0.0, above: 1.25, below: 1.25 };
    for cosine in [0.59, 0.6, 0.61] {
        let found = layers.reflectance_at(cosine, 500.0);
        assert!(found <= 1e-6, "{found} at {cosine}");
    }
}

#[test]
fn a_band_is_the_mean_of_its_wavelengths() {
    let thick = Layers { thickness_nm: 2000.0, ..SOAP };
    let found = thick.reflectance(0.8);
    let mut point = 0.0_f64;
    for (band, found) in found.samples().iter().enumerate() {
        let nm = wavelength_nm(band);
        let mean = (0..500).map(|i| thick.reflectance_at(0.8, nm - 2.5 + 0.01 * (float(i) + 0.5))).sum::<f64>() / 500.0;
        assert!((found - mean).abs() <= 2e-4, "{nm} nm: {found}, not {mean}");
        point = point.max((thick.reflectance_at(0.8, nm) - mean).abs());
    }
    assert!(point > 5e-4, "single wavelengths are off by {point}");
}

/// Largest ΔE00 of a film's terms and of its table, at cosines between those that the film itself checks, each shown as bright
/// as white or ten times as bright as it is.
fn approached(film: &ThinFilm, terms: usize) -> [f64; 2] {
    let nodes = film.at_angles();
    let between = |cosine: f64, of: &dyn Fn(usize) -> Spectrum| {
        let place = cosine * float(nodes.len() - 1);
        let low = relume::number::whole(place).min(nodes.len() - 2);
        let part = place - float(low);
        &of(low).scaled(1.0 - part) + &of(low + 1).scaled(part)
    };
    let table = |i: usize| nodes[i].clone();
    let summed = |i: usize| {
        let (found, factors) = (film.terms(), &film.terms().factors[i]);
        let pairs = found.spectra.iter().zip(factors).take(terms);
        pairs.fold(Spectrum::constant(0.0), |sum, (term, &factor)| &sum + &term.scaled(factor))
    };
    let mut largest = [0.0_f64; 2];
    for light in ["D65", "A", "FL11", "LED-RGB1"].map(|name| standard::light(name).unwrap()) {
        for i in 0..80 {
            let cosine = 0.015 + float(i) * 0.012_3;
            let colour = |spectrum: &Spectrum| DVec3::from_array(xyz_of(&(light.spectrum() * spectrum)).0);
            let exact = colour(&film.layers().reflectance(cosine));
            let shown = exact.y.recip().min(10.0);
            for (largest, of) in largest.iter_mut().zip([&summed as &dyn Fn(usize) -> Spectrum, &table]) {
                let found = colour(&between(cosine, of));
                *largest = largest.max(largest_difference(&[found * shown], &[exact * shown]));
            }
        }
    }
    largest
}

#[test]
fn terms_and_angles_of_a_film_keep_the_tolerance_at_all_angles() {
    for (layers, expected) in [(SOAP, 7), (OIL, 5), (FLAKE, 7)] {
        let film = ThinFilm::new(layers, ThinFilmAngle::Facing).unwrap();
        let terms = film.terms_within(1.0);
        assert!(terms <= expected, "{layers:?} needs {terms} terms");
        assert!(terms <= film.terms_within(0.3), "a smaller error needs no fewer terms");
        // Between the checked angles, the error can be a little larger.
        let [of_terms, of_table] = approached(&film, terms);
        assert!(of_terms <= 1.05, "{layers:?} with {terms} terms: ΔE00 {of_terms}");
        assert!(of_table <= 0.5, "{layers:?}, table: ΔE00 {of_table}");
        let [fewer, _] = approached(&film, terms - 1);
        assert!(fewer > 1.0, "{layers:?} with {} terms: ΔE00 {fewer}", terms - 1);
    }
}

/// `scene` with these films in the parts that they replace.
fn with_film(mut scene: Scene, index: usize, layers: Layers, angle: ThinFilmAngle) -> Scene {
    if let Some(material) = scene.materials.get_mut(index) {
        material.film = Some(ThinFilm::new(layers, angle).unwrap());
        if angle == ThinFilmAngle::Lobe {
            (material.specular, material.exponent) = (0.7, 9);
        }
    }
    scene
}

/// `scene` with a soap film, an oil film in highlights, and a flake.
fn filmed(scene: Scene) -> Scene {
    let scene = with_film(scene, 0, SOAP, ThinFilmAngle::Facing);
    with_film(with_film(scene, 1, OIL, ThinFilmAngle::Lobe), 2, FLAKE, ThinFilmAngle::Facing)
}

/// A ramp along z of a white material, seen along a slanted line, lit from `light`; normals are ±z.
fn ramp(light: DVec3, material: &str) -> Scene {
    let DVec3 { x, y, z } = light;
    let text = format!(
        r#"
        [materials.only]
        reflectance = 1
        {material}
        [transfer]
        opacity_length = 1
        [[transfer.intervals]]
        material = "only"
        range = [-1e9, 1e9]
        opacity = 0.1
        [lights.day]
        spectrum = "D65"
        kind = "directional"
        direction = [{x}, {y}, {z}]
        [camera]
        projection = "orthographic"
        height = 1
        position = [4, 40, -60]
        target = [4, 4, 4]
        up = [0, 1, 0]
        [accuracy]
        termination = 0
    "#
    );
    of(&text, sampled([9, 9, 9], |p| 20000.0 * (1.5 + p.z)))
}

/// All 81 bands of the middle pixel of `scene`.
fn bands(scene: Scene) -> Vec<f64> {
    let rungs = Rungs::new(scene, [1, 1]).full_spectrum();
    rungs.march::<f64>(&rungs.exact()).accumulators
}

#[test]
fn surfaces_reflect_as_the_film_at_their_angle() {
    let view = DVec3::new(0.0, 36.0, -64.0).normalize();
    for light in [DVec3::new(0.1, 0.2, -1.0), DVec3::new(1.0, 0.3, -0.2), DVec3::new(0.5, -0.4, 0.7)] {
        let light = light.normalize();
        let film =
            |angle: &str| format!("film = {{ index = 2.6, thickness = 120, above = 1.5, below = 1.5, {angle} }}");
        // Facing: the diffuse part has the reflectance of the film.
        let cosine = f64::midpoint(light.z.abs(), view.z.abs());
        let reflected = FLAKE.reflectance(cosine);
        let shares = "ambient = 0.25\ndiffuse = 0.6\n";
        let white = bands(ramp(light, shares))[0] / 0.6_f64.mul_add(light.z.abs(), 0.25);
        let found = bands(ramp(light, &[shares, &film("angle = \"facing\"")].concat()));
        for (band, (found, part)) in found.iter().zip(reflected.samples()).enumerate() {
            let expected = white * (0.6 * light.z.abs()).mul_add(*part, 0.25);
            assert!((found - expected).abs() <= 2e-5 * white, "facing, {light}, band {band}: {found}, not {expected}");
        }
        // Lobe: the highlight has it.
        let halfway = (light + view).normalize();
        let reflected = FLAKE.reflectance(light.dot(halfway));
        let shares = "ambient = 0.1\ndiffuse = 0\nspecular = 0.8\nexponent = 3\n";
        let found = bands(ramp(light, &[shares, &film("angle = \"lobe\"")].concat()));
        for (band, (found, part)) in found.iter().zip(reflected.samples()).enumerate() {
            let expected = white * (0.8 * halfway.z.abs().powi(3)).mul_add(*part, 0.1);
            assert!((found - expected).abs() <= 2e-5 * white, "lobe, {light}, band {band}: {found}, not {expected}");
        }
    }
}

#[test]
fn a_three_point_light_on_films_equals_three_directional_lights() {
    let mut scene = filmed(scenes::named("diffuse_three"));
    scene.accuracy.accumulate = AccumulateAs::Weights;
    scene.lights.truncate(1);
    scene.materials.iter_mut().for_each(|material| material.ambient = 0.0);
    for shadows in [false, true] {
        scene.lights[0].shadows = shadows;
        let view = scene.camera.view(&scene.frame.geometry, float(SIZE[0]) / float(SIZE[1])).unwrap();
        let lit = |placement: Placement| {
            let mut scene = scene.clone();
            scene.lights[0].placement = placement;
            let rungs = Rungs::new(scene, SIZE);
            rungs.march::<f64>(&rungs.exact()).accumulators
        };
        let apart = relume::scene::three_point(&view)
            .map(|(direction, weight)| (lit(Placement::Directional(direction)), weight));
        for (i, found) in lit(Placement::ThreePoint).into_iter().enumerate() {
            let expected: f64 = apart.iter().map(|(light, part)| part * light[i]).sum();
            assert!((found - expected).abs() <= 1e-5, "shadows {shadows}: {found}, not {expected}");
        }
    }
}

/// Two interfaces without a film between them: all light is transmitted.
#[test]
fn films_that_reflect_nothing_take_no_weights() {
    for name in ["diffuse_one", "diffuse_three", "specular_three"] {
        for angle in [ThinFilmAngle::Facing, ThinFilmAngle::Lobe] {
            let mut scene = with_film(scenes::named(name), 0, Layers { thickness_nm: 0.0, ..SOAP }, angle);
            scene.accuracy.accumulate = AccumulateAs::Weights;
            let rungs = Rungs::new(scene.clone(), SIZE);
            assert_eq!(rungs.planned.plan.thin_films, FilmCounts::default(), "{name}, {angle:?}");
            let matrices = rungs.xyz_matrices();
            let reference = rungs.march(&rungs.stored::<f32>()).relight(&matrices);
            with_renderer(|renderer| {
                let difference = largest_difference(&rungs.gpu(renderer).relight(&matrices), &reference);
                assert!(difference <= SAME_GRID, "{name}, {angle:?}: {difference}");
            });
            // Beside one that does.
            let both = Rungs::new(with_film(scene, 1, OIL, ThinFilmAngle::Facing), SIZE);
            if name != "diffuse_one" {
                assert_eq!(both.planned.plan.thin_films.total(), 1, "{name}, {angle:?}");
                with_renderer(|renderer| both.gpu(renderer));
            }
        }
    }
}

#[test]
fn plans_have_the_terms_of_films_or_a_model_that_is_narrower() {
    let mut scene = filmed(scenes::named("diffuse_three"));
    scene.accuracy.accumulate = AccumulateAs::Weights;
    let weights = plan(&scene, &Quiet).unwrap();
    let terms = |layers| ThinFilm::new(layers, ThinFilmAngle::Facing).unwrap().terms_within(scene.accuracy.tolerance);
    let counts = FilmCounts { facing: 2, lobe: 1, terms: terms(SOAP) + terms(OIL) + terms(FLAKE), exponent_bits: 4 };
    assert_eq!(weights.plan.thin_films, counts);
    assert_eq!(weights.plan.components(), 3 + counts.terms, "no white: the only highlight is a film's");
    // A smaller tolerance needs more terms; light spectra change nothing.
    scene.accuracy.tolerance = 0.4;
    assert!(plan(&scene, &Quiet).unwrap().plan.thin_films.terms > counts.terms);
    scene.accuracy.tolerance = 1.0;
    let mut relit = scene.clone();
    relit.lights[0].spectrum = standard::light("LED-RGB1").unwrap();
    assert_eq!(Stale::between(&scene, &weights, &relit), Stale::Picture);
    // Fewer coefficients than weights in vectors.
    scene.accuracy.accumulate = AccumulateAs::Auto;
    scene.accuracy.tolerance = 2.0;
    let chosen = plan(&scene, &Quiet).unwrap();
    let Accumulate::Spectral { dimension, .. } = chosen.plan.accumulate else { panic!("{:?}", chosen.plan) };
    assert!(dimension.div_ceil(4) < weights.plan.lanes(), "{dimension} against {}", weights.plan.components());
    assert_eq!(chosen.plan.thin_films, FilmCounts { terms: 0, ..counts });
    let told = chosen.explain(&scene).join("\n");
    assert!(told.contains("128 angles") && told.contains("Thin films"), "{told}");
    // One thin film: weights are as narrow.
    let mut one =
        with_film(scenes::named("diffuse_one"), 0, Layers { thickness_nm: 100.0, ..SOAP }, ThinFilmAngle::Facing);
    one.materials.truncate(1);
    one.transfer.terms.retain(|term| term.material.0.iter().all(|point| point.1 == 0));
    let kept = plan(&one, &Quiet).unwrap();
    assert!(kept.model.is_none(), "{:?}", kept.plan);
    let told = kept.explain(&one).join("\n");
    assert!(told.contains("sum of terms") && told.contains("100 nm of index 1.33"), "{told}");
}

#[test]
fn a_film_marches_again_only_where_it_has_an_effect() {
    let stale = |scene: &Scene, change: fn(&mut Scene)| {
        let mut after = scene.clone();
        change(&mut after);
        Stale::between(scene, &plan(scene, &Quiet).unwrap(), &after)
    };
    let thicker = |scene: &mut Scene| {
        scene.materials[0].film =
            Some(ThinFilm::new(Layers { thickness_nm: 410.0, ..SOAP }, ThinFilmAngle::Facing).unwrap());
    };
    let with = with_film(occluded("gradient"), 0, SOAP, ThinFilmAngle::Facing);
    assert_eq!(stale(&with, thicker), Stale::Tables);
    assert_eq!(stale(&with, |scene| scene.materials[0].film = None), Stale::Tables);
    assert_eq!(stale(&occluded("gradient"), thicker), Stale::Tables);
    assert_eq!(stale(&occluded("none"), thicker), Stale::Nothing);
    assert_eq!(stale(&with, |scene| scene.lights[0].intensity = 2.0), Stale::Picture);
}

#[test]
fn the_key_of_a_film_is_read_and_checked() {
    let of = |film: &str| opened(film, "gradient").unwrap().scene.materials[0].film.clone();
    assert_eq!(of(""), None);
    let film = of("film = { index = 1.33, thickness = 400 }").unwrap();
    assert_eq!((film.layers(), film.angle()), (SOAP, ThinFilmAngle::Facing));
    let film =
        of("specular = 1\nfilm = { index = 1.47, thickness = 0, above = 1.1, below = 2, angle = \"lobe\" }").unwrap();
    let layers = Layers { index: 1.47, thickness_nm: 0.0, above: 1.1, below: 2.0 };
    assert_eq!((film.layers(), film.angle()), (layers, ThinFilmAngle::Lobe));
    for (wrong, words) in [
        ("index = 0, thickness = 400", "materials.wing.film.index = 0; it must be a number from 1 to 5"),
        ("index = nan, thickness = 400", "film.index = NaN; it must be a number from 1 to 5"),
        ("index = 1.33, thickness = -5", "film.thickness = -5; it must be a number from 0 to 5000"),
        ("index = 1.33, thickness = 1e9", "film.thickness"),
        ("index = 1.33, thickness = inf", "from 0 to 5000"),
        ("index = 1.33, thickness = 400, below = 0.5", "film.below = 0.5; it must be a number from 1 to 5"),
        ("index = 1.33", "missing field `thickness`"),
        ("thickness = 400", "missing field `index`"),
        ("index = 1.33, thickness = 400, angle = \"wide\"", "lobe"),
        ("index = 1.33, thickness = 400, colour = 3", "colour"),
    ] {
        let error = opened(&format!("film = {{ {wrong} }}"), "gradient").unwrap_err();
        let told = format!("{error:?} {error}");
        assert!(told.contains(words), "{wrong}: {told}");
    }
    let error = ThinFilm::new(Layers { index: f64::NAN, ..SOAP }, ThinFilmAngle::Lobe).unwrap_err();
    assert!(error.to_string().contains("film.index = NaN; it must be a number from 1 to 5"), "{error}");
}

#[test]
fn a_film_without_an_effect_or_a_model_is_told() {
    let film = "film = { index = 1.33, thickness = 400 }";
    let warned = |film: &str, shading: &str| {
        let scene = opened(film, shading).unwrap().scene;
        plan(&scene, &Quiet).unwrap().warnings.iter().map(|it| (it.code(), it.to_string())).collect::<Vec<_>>()
    };
    assert_eq!(warned(film, "gradient"), []);
    for (film, shading, words) in [
        (film.to_owned(), "none", "shading = \"gradient\""),
        (format!("diffuse = 0\n{film}"), "gradient", "the diffuse factor is 0"),
        (film.replace("400", "400, angle = \"lobe\""), "gradient", "the specular factor is 0"),
    ] {
        let told = warned(&film, shading);
        let [(code, text)] = &told[..] else { panic!("{told:?}") };
        assert!(*code == "film-unused" && text.contains("wing") && text.contains(words), "{text}");
    }
    // Light from everywhere has no angle.
    let mut ambient = opened(film, "gradient").unwrap().scene;
    for light in &mut ambient.lights {
        light.placement = Placement::Ambient;
    }
    let told = plan(&ambient, &Quiet).unwrap().warnings;
    assert!(matches!(&told[..], [PlanWarning::FilmUnused { why, .. }] if why.contains("ambient")), "{told:?}");
    // More fringes than angles.
    let mut thick = opened(&film.replace("400", "5000"), "gradient").unwrap().scene;
    (thick.accuracy.accumulate, thick.accuracy.tolerance) = (AccumulateAs::Weights, 0.1);
    let told = plan(&thick, &Quiet).unwrap().warnings;
    assert!(matches!(&told[..], [PlanWarning::FilmInexact { .. }]), "{told:?}");
    assert_eq!(told[0].code(), "film-over-tolerance");
    // Coefficients are measured between the angles that they are fitted to.
    thick.materials[0].film =
        Some(ThinFilm::new(Layers { thickness_nm: 5000.0, ..FLAKE }, ThinFilmAngle::Facing).unwrap());
    (thick.accuracy.accumulate, thick.accuracy.dimension) = (AccumulateAs::Spectral, Some(5));
    let told = plan(&thick, &Quiet).unwrap().warnings;
    assert!(told.iter().any(|warning| warning.code() == "film-over-tolerance"), "{told:?}");
    // Matrices have no number per component.
    let mut matrix = filmed(scenes::named("coloured_one"));
    (matrix.accuracy.model, matrix.accuracy.dimension) = (ModelKind::Peercy, Some(4));
    let error = plan(&matrix, &Quiet).unwrap_err();
    assert_eq!(error.code(), "film-matrix", "{error}");
}

#[test]
fn a_material_keeps_its_film_in_a_session_and_in_the_history() {
    let mut edited = Document::new(opened("film = { index = 1.33, thickness = 400 }", "gradient").unwrap());
    let of = |document: &Document| document.state().scene.materials[0].film.clone();
    let session = |edited: &Document| {
        let path = Path::new("session.toml");
        let text = document::session::text(path, &Source::default(), edited.opened(), edited.state()).unwrap();
        document::parse("again", &text, Path::new(""), &SceneOptions::default(), &Quiet).unwrap().scene
    };
    let oil = ThinFilm::new(OIL, ThinFilmAngle::Facing).unwrap();
    edited.edit(&Edit::Film(0, Some(oil.clone())));
    assert_eq!(of(&edited), Some(oil.clone()));
    assert!(!edited.is_saved());
    assert_eq!(session(&edited).materials[0].film, Some(oil));
    edited.edit(&Edit::Film(0, None));
    assert_eq!(session(&edited).materials[0].film, None);
    edited.undo();
    edited.undo();
    assert_eq!(of(&edited).unwrap().layers(), SOAP);
    edited.edit(&Edit::Film(9, None));
    assert_eq!(of(&edited).unwrap().layers(), SOAP, "there is no such material");
    // The digest of a scene does not depend on spectra that were computed meanwhile.
    let scene = opened("film = { index = 1.33, thickness = 400 }", "gradient").unwrap().scene;
    let before = scene.digest();
    assert!(!scene.materials[0].film.as_ref().unwrap().terms().spectra.is_empty());
    assert_eq!(scene.digest(), before);
    let other = opened("film = { index = 1.34, thickness = 400 }", "gradient").unwrap().scene;
    assert_ne!(other.digest(), before);
}
