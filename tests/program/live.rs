//! Live pages: browsers read the shaders, and march what the program marches.
#![expect(clippy::print_stdout, reason = "the differences of each scene")]

use crate::support;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::page::{LIVE_WIDGET, cell, in_script, png};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::{DMat3, DVec3};
use relume::annotate::{self, PATIENT};
use relume::film::Film;
use relume::live::{self, ForReaders, LiveNote};
use relume::output::page::{LIVE_SCRIPT, camera, frame};
use relume::plan::{Integrate, Planned, ScenePlan, Transmittance, plan};
use relume::progress::Quiet;
use relume::render::{BrowserMarch, Renderer, browser_shader};
use relume::scene::{Field, Fields, Interpolation, Lookup, Placement, Projection, Scene, Shading, Turned};
use relume::tables::RayTable;
use relume::volume::{Geometry, Volume, Voxels};
use serde_json::{Value, json};
use support::browser::{Browser, Page};
use support::program::Folder;
use support::rungs::with_renderer;
use support::scenes;

const SIZE: [usize; 2] = [40, 32];

/// A page without content, in which scripts run.
fn empty_page<'a>(browser: &'a mut Browser, folder: &Folder) -> Page<'a> {
    std::fs::write(folder.path("empty.html"), "<!DOCTYPE html><title>empty</title>").unwrap();
    let mut page = browser.navigated(&folder.path("empty.html"), "", [400, 300]);
    page.wait("document.readyState === 'complete'");
    page
}

#[test]
fn browsers_read_the_shader_of_every_scene() {
    let mut shaders: BTreeMap<String, String> = BTreeMap::new();
    for name in scenes::all().keys() {
        let planned = plan(&scenes::named(name), &Quiet).unwrap();
        if planned.plan.transmittance != Transmittance::Mixed {
            shaders.entry(browser_shader(&planned.plan, true).unwrap().text).or_insert_with(|| name.clone());
        }
    }
    assert!(shaders.len() > 50, "{} shaders", shaders.len());
    let folder = Folder::new();
    let mut browser = Browser::with_webgpu();
    let mut page = empty_page(&mut browser, &folder);
    page.value(
        "navigator.gpu.requestAdapter().then((it) => it.requestDevice({ requiredLimits: { maxStorageBuffersPerShaderStage: 10 } })).then((it) => { globalThis.device = it; })",
    );
    for (text, name) in &shaders {
        let read = format!(
            "(async () => {{
                device.pushErrorScope('validation');
                const module = device.createShaderModule({{ code: {} }}), info = await module.getCompilationInfo();
                const told = info.messages.map((it) => `${{it.lineNum}}: ${{it.message}}`);
                return [...told, (await device.popErrorScope())?.message ?? ''].join('\\n');
            }})()",
            json!(text)
        );
        let told = page.value(&read);
        assert_eq!(told.as_str().unwrap().trim(), "", "{name}:\n{text}");
    }
    println!("{} shaders", shaders.len());
}

/// Cameras around the one of `scene`, which is the first, and the only one if a light moves with the camera: lights of a page stay where they are.
fn cameras(scene: &Scene) -> Vec<Turned> {
    let opened = Turned::of(&scene.camera);
    let turns = [
        ([0.0, 0.0], 1.0, [0.0, 0.0]),
        ([137.0, -33.0], 1.0, [0.0, 0.0]),
        ([61.0, 20.0], 1.6, [0.1, 0.0]),
        ([-95.0, 48.0], 0.7, [-0.1, 0.2]),
        ([203.0, -12.0], 1.2, [0.0, 0.0]),
    ];
    let moves = scene.lights.iter().any(|light| light.placement == Placement::ThreePoint);
    let seen = |([a, e], zoom, pan): ([f64; 2], f64, [f64; 2])| Turned {
        azimuth: opened.azimuth + a,
        elevation: (opened.elevation + e).clamp(-80.0, 80.0),
        zoom,
        pan,
    };
    turns.into_iter().take(if moves { 1 } else { turns.len() }).map(seen).collect()
}

/// The numbers of a camera as `live.js` takes them.
fn seen(turned: Turned) -> Value {
    let Turned { azimuth, elevation, zoom, pan: [x, y] } = turned;
    json!({"azimuth": azimuth, "elevation": elevation, "zoom": zoom, "x": x, "y": y})
}

/// Scenes that have every feature of a plan between them; all with `RELUME_LIVE=all`, which takes ten minutes.
fn tested() -> Vec<&'static String> {
    let all = scenes::all();
    if std::env::var("RELUME_LIVE").is_ok_and(|it| it == "all") {
        return all.keys().collect();
    }
    let mut known = BTreeSet::new();
    let is_new = |(name, row): (&'static String, &'static scenes::Row)| {
        let features =
            row.plan.split([';', ',']).map(|it| it.trim().replace(|letter: char| letter.is_ascii_digit(), ""));
        let new = features.filter(|feature| known.insert(feature.clone())).count();
        (new > 0).then_some(name)
    };
    all.iter().filter_map(is_new).collect()
}

/// `scene` from this camera, for a picture of `width / height = aspect`.
fn turned(scene: &Scene, turned: Turned, aspect: f64) -> Scene {
    let camera = turned.camera(&scene.camera, &scene.frame.geometry, aspect).unwrap();
    Scene { camera, ..scene.clone() }
}

/// Numbers of the film of a browser, as those of the program lie.
fn film_of(found: &Value, planned: &Planned) -> Film<f32> {
    let floats = |text: &Value| -> Vec<f32> {
        let bytes = STANDARD.decode(text.as_str().unwrap()).unwrap();
        bytes.chunks_exact(4).map(|bytes| f32::from_le_bytes(bytes.try_into().unwrap())).collect()
    };
    let (components, lanes) = (planned.plan.components(), planned.plan.lanes());
    let pixels = SIZE[0] * SIZE[1];
    let plane = |numbers: &[f32], layer: usize, part: usize| -> Vec<f32> {
        (0..pixels).map(|pixel| numbers[4 * (layer * pixels + pixel) + part]).collect()
    };
    let [accumulators, transmittance] = [&found[0], &found[1]].map(floats);
    let of_position = |position: usize| (0..components).map(move |i| (position * lanes + i / 4, i % 4));
    let accumulators = (0..planned.positions.len())
        .flat_map(of_position)
        .flat_map(|(layer, part)| plane(&accumulators, layer, part))
        .collect();
    let transmittance =
        (0..planned.plan.transmittance_numbers()).flat_map(|i| plane(&transmittance, i / 4, i % 4)).collect();
    Film { size: SIZE, components, accumulators, transmittance }
}

/// The data of a live page of `scene`, or the reason why there is none.
fn packed(renderer: &Renderer, scene: &Scene, planned: &Planned) -> Result<Value, String> {
    let statistics = scene.volume().statistics().unwrap();
    let uploaded = renderer.upload(scene, planned, &statistics, &Quiet).map_err(|error| error.to_string())?;
    let (packed, notes) =
        live::packed(renderer, (scene, planned), &uploaded, SIZE, [1; 3]).map_err(|error| error.to_string())?;
    if notes.iter().any(|note| matches!(note, LiveNote::Rounded { .. })) {
        return Err("values are rounded".to_owned());
    }
    let blocks: serde_json::Map<String, Value> =
        packed.blocks.iter().map(|(name, bytes)| ((*name).to_owned(), json!(STANDARD.encode(bytes)))).collect();
    Ok(json!({"live": serde_json::from_str::<Value>(&packed.json).unwrap(), "blocks": blocks}))
}

/// True if a ray decides by comparing numbers, so that rounding moves a pixel by more than itself: parts of a step, or the entry or label next to a
/// place.
fn decides(plan: &ScenePlan) -> bool {
    plan.integration != Integrate::Samples
        || plan.lookup == Lookup::Nearest
        || plan.interpolation == Interpolation::Nearest
        || plan.labels && !plan.smooth_labels
}

/// Differences of numbers, relative to the largest of them if that is above 1: light of narrow phase functions is hundreds of times that of a
/// diffuse reflector.
fn differences(one: &[f32], other: &[f32]) -> Vec<f32> {
    assert_eq!(one.len(), other.len(), "as many numbers");
    let peak = other.iter().fold(1.0_f32, |peak, number| peak.max(number.abs()));
    one.iter().zip(other).map(|(one, other)| (one - other).abs() / peak).collect()
}

/// Loads the script of live pages as `script`, and a device.
const PREPARED: &str = "(async () => {
    globalThis.script = await import(URL.createObjectURL(new Blob([TEXT], { type: 'text/javascript' })));
    globalThis.text = (bytes) => { let all = ''; for (let i = 0; i < bytes.length; i += 8192) all += String.fromCharCode(...bytes.subarray(i, i + 8192)); return btoa(all); };
    globalThis.device = await (await navigator.gpu.requestAdapter()).requestDevice({ requiredLimits: { maxStorageBuffersPerShaderStage: 10 } });
})()";

/// Films of a volume from several cameras.
const MARCHED: &str = "(async ({ live, blocks, cameras }) => {
    const machine = await script.marcher(live, (name) => script.inflated(script.fromBase64(blocks[name]), live.lengths[name]), device);
    const films = [];
    for (const seen of cameras) {
        await machine.march(seen, live.crop, live.size);
        films.push((await machine.numbers()).map((floats) => text(new Uint8Array(floats.buffer))));
    }
    return films;
})(GIVEN)";

#[test]
fn films_of_a_browser_are_those_of_the_program() {
    let folder = Folder::new();
    let mut browser = Browser::with_webgpu();
    let mut page = empty_page(&mut browser, &folder);
    page.value(&PREPARED.replace("TEXT", &json!(LIVE_SCRIPT).to_string()));
    with_renderer(|renderer| {
        let (mut marched, mut refused, mut wrong) = (0, BTreeMap::<String, usize>::new(), Vec::new());
        for name in tested() {
            let mut scene = scenes::named(name);
            scene.accuracy.rays = 1;
            let planned = plan(&scene, &Quiet).unwrap();
            if planned.plan.transmittance == Transmittance::Mixed {
                continue;
            }
            let given = match packed(renderer, &scene, &planned) {
                Ok(given) => given,
                Err(why) => {
                    *refused.entry(why).or_default() += 1;
                    continue;
                }
            };
            let cameras = cameras(&scene);
            let mut given = given;
            given["cameras"] = cameras.iter().copied().map(seen).collect();
            let films = page.value(&MARCHED.replace("GIVEN", &given.to_string()));
            for (camera, found) in cameras.iter().zip(films.as_array().unwrap()) {
                let scene = turned(&scene, *camera, scenes::float(SIZE[0]) / scenes::float(SIZE[1]));
                let expected = support::rungs::Rungs::planned(scene, planned.clone(), SIZE).gpu(renderer);
                let found = film_of(found, &planned);
                let mut off: Vec<f32> = differences(&found.accumulators, &expected.accumulators);
                off.extend(differences(&found.transmittance, &expected.transmittance));
                let light = &planned.plan.light;
                // A filter mixes depths of a light grid, of which light is an exponential.
                let bound = if light.reads_grid() || light.gathered.is_some() { 1e-4 } else { 3e-5 };
                let over = off.iter().filter(|&&off| off > bound).count();
                let largest = off.iter().copied().fold(0.0, f32::max);
                println!("{name} {camera:?}: at most {largest:e}, {over} of {} above {bound:e}", off.len());
                let most = if decides(&planned.plan) { off.len() / 1000 } else { 0 };
                if over > most || largest > 0.05 {
                    wrong.push(format!("{name} {camera:?}: at most {largest:e}, {over} of {}", off.len()));
                }
            }
            marched += 1;
        }
        println!("{marched} scenes; refused: {refused:#?}");
        assert!(marched > 20, "{marched}");
        let known = ["values are rounded"];
        assert!(refused.keys().all(|why| known.iter().any(|known| why.contains(known))), "{refused:?}");
        assert!(wrong.is_empty(), "{wrong:#?}");
    });
}

/// Views of the program as the script finds them.
#[test]
fn the_script_sees_as_the_program() {
    let folder = Folder::new();
    let mut browser = Browser::new();
    let mut page = empty_page(&mut browser, &folder);
    page.value(&PREPARED.replace("TEXT", &json!(LIVE_SCRIPT).to_string()).replace("globalThis.device =", "//"));
    let numbers = |vector: DVec3| vector.to_array().to_vec();
    let mut seed = 7_u64;
    let mut random = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        f64::from(u32::try_from(seed >> 32).unwrap()) / f64::from(u32::MAX)
    };
    let names: Vec<&String> = scenes::all().keys().filter(|name| !name.contains("fields")).collect();
    for i in 0..1000 {
        let name = names[i * 37 % names.len()];
        let mut scene = scenes::named(name);
        scene.camera.projection = match i % 3 {
            0 => Projection::Orthographic { height: None },
            1 => Projection::Orthographic { height: Some(10.0 + 90.0 * random()) },
            _ => Projection::Perspective { fov_degrees: 5.0 + 90.0 * random() },
        };
        let turn = Turned {
            azimuth: 720.0 * random() - 360.0,
            elevation: 170.0 * random() - 85.0,
            zoom: 0.3 + 3.0 * random(),
            pan: [random() - 0.5, random() - 0.5],
        };
        let aspect = 0.5 + random();
        let given =
            json!({"camera": camera(&scene.camera, &scene.frame.geometry), "frame": frame(&scene.frame.geometry)});
        scene = turned(&scene, turn, aspect);
        let seen = seen(turn);
        let view = scene.camera.view(&scene.frame.geometry, aspect).unwrap();
        let rays = RayTable::new(&scene, &view).unwrap();
        // The base of parallel rays is in the eye or not where the eye is as far as the diagonal is long.
        let eye = rays.base - rays.eye_distance * rays.direction;
        let found = page.value(&format!(
            "(() => {{ const live = {given}, rays = script.raysOf(live, script.viewOf(live, {seen}, {aspect}));
                const eye = rays.base.map((at, axis) => at - rays.eye_distance * rays.direction[axis]);
                return [eye, rays.base_u, rays.base_v, rays.direction, rays.direction_u, rays.direction_v, [rays.spread_u], [rays.spread_v]]; }})()"
        ));
        let expected = [
            numbers(eye),
            numbers(rays.base_u),
            numbers(rays.base_v),
            numbers(rays.direction),
            numbers(rays.direction_u),
            numbers(rays.direction_v),
            vec![rays.spread_u],
            vec![rays.spread_v],
        ];
        let letters = page.value(&format!("script.lettersOf({}, {:?})", json!(PATIENT), numbers(view.right)));
        assert_eq!(letters, annotate::letters(view.right), "{name} {seen}");
        for (found, expected) in found.as_array().unwrap().iter().zip(&expected) {
            let size = expected.iter().fold(1e-3_f64, |size, number| size.max(number.abs()));
            for (found, expected) in found.as_array().unwrap().iter().zip(expected) {
                let off = (found.as_f64().unwrap() - expected).abs() / size;
                assert!(off <= 1e-11, "{name} {seen}: {found} is not {expected}");
            }
        }
    }
}

/// A small live page, and the flags of its scene.
fn small_page(folder: &Folder) -> Vec<String> {
    let changes = ["-D", "volume.dims=[64, 60, 36]", "-D", "camera.fill=1.1"].map(str::to_owned);
    let mut command = vec!["page".to_owned()];
    command.extend(changes.clone());
    command.extend(["--live", "--size", "96x80", "-o", "live.html"].map(str::to_owned));
    folder.done(&command.iter().map(String::as_str).collect::<Vec<_>>());
    changes.to_vec()
}

/// Opens a live page, and waits until it is marched.
fn opened<'a>(browser: &'a mut Browser, folder: &Folder, hash: &str) -> Page<'a> {
    let mut page = browser.open(&folder.path("live.html"), hash, [1200, 900]);
    page.value("relumeLive.then((it) => { globalThis.live = it; })");
    page.wait("document.getElementById('relume').dataset.ready === 'WebGPU' && live.settled");
    page
}

/// Asserts that the page shows what the program renders with its flags.
fn is_as_rendered(page: &mut Page<'_>, folder: &Folder, changes: &[String]) {
    let flags = page.value("document.querySelector('[aria-label=\"Flags of Relume for this view\"]').value");
    let flags: Vec<&str> = flags.as_str().unwrap().split('\'').filter(|part| !part.contains("-D")).collect();
    let mut command = vec!["render", "-o", "seen.png", "--size", "96x80"];
    command.extend(changes.iter().map(String::as_str));
    for flag in flags.iter().filter(|flag| !flag.trim().is_empty()) {
        command.extend(["-D", flag]);
    }
    folder.done(&command);
    let (shown, expected) = (page.pixels(), png(&folder.path("seen.png")));
    assert_eq!(shown.len(), expected.len(), "pictures of one size");
    let off: Vec<u8> = shown.iter().zip(&expected).map(|(one, other)| one.abs_diff(*other)).collect();
    let over = off.iter().filter(|&&off| off > 1).count();
    assert!(expected.iter().any(|&code| code > 60), "a black picture proves nothing");
    assert!(
        over * 1000 <= off.len(),
        "{command:?}: {over} of {} codes are off by up to {:?}",
        off.len(),
        off.iter().max()
    );
}

#[test]
fn a_live_page_is_turned_cut_and_relit() {
    let folder = Folder::new();
    let changes = small_page(&folder);
    let mut browser = Browser::with_webgpu();
    let mut page = opened(&mut browser, &folder, "#march=always");
    is_as_rendered(&mut page, &folder, &changes);
    // By keys.
    page.value("relume.frame.focus()");
    for key in ["ArrowRight", "ArrowRight", "ArrowUp", "+"] {
        page.press(key);
    }
    page.wait("relume.state.seen !== '' && live.settled");
    is_as_rendered(&mut page, &folder, &changes);
    // Relit without a march.
    page.value("relume.set({ by: 'sliders', solo: 1 })");
    let marched = page.value("live.settled");
    assert_eq!(marched, true, "a light needs no march");
    page.value("relume.set({ solo: -1 })");
    // Cut by a slider, and moved.
    page.value(
        "{ const it = document.querySelector('[aria-label=\"Cut z, to\"]'); it.value = 20; it.dispatchEvent(new Event('input')); }",
    );
    page.value("relume.set({ seen: '35,20,1.3,0.1,-0.05' })");
    page.wait("live.settled");
    is_as_rendered(&mut page, &folder, &changes);
    // The spectrum of a pixel comes from the device.
    page.value("relume.set({ pixel: [48, 40] })");
    page.wait(
        "!document.querySelector('.probe').hidden && document.querySelector('.probe').textContent.includes('sRGB')",
    );
    // The address has the view.
    page.wait("location.hash.includes('seen=')");
    let hash = page.value("location.hash");
    assert_eq!(page.complaints(), Vec::<String>::new());
    let mut again = opened(&mut browser, &folder, &format!("{}&march=always", hash.as_str().unwrap()));
    assert_eq!(again.value("relume.state.seen"), "35,20,1.3,0.1,-0.05");
    is_as_rendered(&mut again, &folder, &changes);
    again.value("[...document.querySelectorAll('button')].find((it) => it.textContent === 'Reset view').click()");
    again.wait("live.settled && relume.state.cut === ''");
    is_as_rendered(&mut again, &folder, &changes);
}

#[test]
fn without_a_device_the_finished_view_stays() {
    let folder = Folder::new();
    small_page(&folder);
    let mut browser = Browser::new();
    let mut page = browser.open(&folder.path("live.html"), "", [900, 700]);
    page.wait("document.querySelector('.status').textContent.includes('cannot be turned')");
    let told = page.value("document.querySelector('.status').textContent");
    assert!(told.as_str().unwrap().contains("Its finished view is shown"), "{told}");
    assert!(page.pixels().iter().any(|&code| code > 60));
    // Chromium itself tells that it has no device.
    let told = page.complaints();
    assert!(told.iter().all(|line| line.contains("No available adapters")), "{told:?}");
    // Lost once, it marches again; twice, the view stays.
    let mut browser = Browser::with_webgpu();
    let mut page = opened(&mut browser, &folder, "#march=always");
    let before = page.pixels();
    page.value("globalThis.first = live.machine; live.machine.device.destroy()");
    page.wait("live.machine && live.machine !== first && live.settled");
    page.wait("document.getElementById('relume').dataset.ready === 'WebGPU'");
    assert_eq!(page.pixels(), before);
    page.value("live.machine.device.destroy()");
    page.wait("document.getElementById('relume').dataset.ready !== 'WebGPU'");
    page.wait("document.querySelector('.status').textContent.includes('lost twice')");
    assert!(page.pixels().iter().any(|&code| code > 60));
}

/// Pages that lie or are damaged show their finished view, and say why they are not turned.
#[test]
fn a_damaged_volume_leaves_the_finished_view() {
    let folder = Folder::new();
    small_page(&folder);
    let html = std::fs::read_to_string(folder.path("live.html")).unwrap();
    let block = |name: &str| {
        let start = html.find(&format!("id=\"relume-live-{name}\">")).unwrap();
        let first = start + html[start..].find('>').unwrap() + 1;
        first..first + html[first..].find("</script>").unwrap()
    };
    let replaced = |name: &str, by: &dyn Fn(&str) -> String| {
        let range = block(name);
        format!("{}{}{}", &html[..range.start], by(&html[range.clone()]), &html[range.end..])
    };
    let cases = [
        ("half of the voxels", replaced("voxels-0", &|text| text[..text.len() / 8 * 4].to_owned())),
        ("no base64", replaced("voxels-0", &|_| "*** <b>".to_owned())),
        ("another shader", replaced("shader", &|_| STANDARD.encode(b"\x03\x00"))),
        ("no tables", replaced("tables", &|_| String::new())),
        ("a larger volume", html.replace("\"dims\":[64,60,36]", "\"dims\":[64,60,37]")),
        ("an axis too long", html.replace("\"dims\":[64,60,36]", "\"dims\":[64,2160,1000001]")),
        ("a name that is none", html.replacen("march_uniform", "</script><b>", 1)),
    ];
    let mut browser = Browser::with_webgpu();
    for (what, text) in cases {
        assert!(text != html, "{what}");
        std::fs::write(folder.path("damaged.html"), text).unwrap();
        let mut page = browser.open(&folder.path("damaged.html"), "#march=always", [900, 700]);
        page.wait("document.querySelector('.status')?.textContent.includes('cannot be turned')");
        let told = page.value("document.querySelector('.status').textContent");
        println!("{what}: {told}");
        assert!(page.pixels().iter().any(|&code| code > 60), "{what}");
    }
}

/// Of each table of a page: the largest change with densities of 1, and with such that are 1 within rounding, as a part of the number, and of
/// integrals of the largest one, if that is above 1; the largest number without densities; whether half of them dims less.
const TABLES: &str = "(async ({ live, blocks }) => {
    const tables = await script.inflated(script.fromBase64(blocks.tables), live.lengths.tables), bytes = {};
    let at = 0;
    for (const [name, length] of live.buffers) bytes[name] = tables.slice(at, at += length).buffer;
    const largest = (numbers) => numbers.reduce((found, number) => Math.max(found, Math.abs(number)), 0), all = [];
    for (const [of, kind] of [['table', live.tables], ['label', live.tables === 'steps' ? 'steps' : 'densities']]) {
        const [source, opacity] = [bytes[`${of}_source`], bytes[`${of}_opacity`]];
        if (!source) continue;
        const by = (part) => script.thinned(live, kind, source.slice(), opacity.slice(), live.densities.map(() => part)), before = by(1);
        const given = [source, opacity].map((bytes) => new before[0].constructor(bytes));
        const sizes = given.map(largest), off = (tables) => Math.max(...tables.map((table, i) => largest(Array.from(table, (number, n) => (number - given[i][n]) / Math.max(1, kind === 'integrals' ? sizes[i] : Math.abs(given[i][n]))))));
        const nothing = by(0);
        all.push([off(before), off(by(0.9999999)), Math.max(...nothing.map(largest)), largest(by(0.5)[1]) < largest(given[1]) || !largest(given[1])]);
    }
    return all;
})(GIVEN)";

/// Films of a volume with these densities of all materials.
const THINNED: &str = "(async ({ live, blocks, parts }) => {
    const machine = await script.marcher(live, (name) => script.inflated(script.fromBase64(blocks[name]), live.lengths[name]), device);
    const { azimuth, elevation } = live.camera, films = [];
    for (const part of parts) {
        machine.thin(live.densities.map(() => part));
        await machine.march({ azimuth, elevation, zoom: 1, x: 0, y: 0 }, live.crop, live.size);
        films.push((await machine.numbers()).map((floats) => text(new Uint8Array(floats.buffer))));
    }
    return films;
})(GIVEN)";

/// Densities of materials: with 1 the tables of the program, and otherwise the film of a scene with a longer opacity length.
#[test]
fn films_of_other_densities_are_those_of_the_program() {
    let folder = Folder::new();
    let mut browser = Browser::with_webgpu();
    let mut page = empty_page(&mut browser, &folder);
    page.value(&PREPARED.replace("TEXT", &json!(LIVE_SCRIPT).to_string()));
    let shown =
        ["diffuse_three", "specular_three", "occludes_three", "labels", "segments_unshaded_three", "refined_shape"];
    let shown = shown.map(str::to_owned);
    with_renderer(|renderer| {
        let mut kinds = BTreeSet::new();
        for name in tested().into_iter().chain(&shown).collect::<BTreeSet<_>>() {
            let mut scene = scenes::named(name);
            scene.accuracy.rays = 1;
            let planned = plan(&scene, &Quiet).unwrap();
            let Ok(mut given) = packed(renderer, &scene, &planned) else { continue };
            if given["live"]["densities"].as_array().unwrap().is_empty() {
                assert!(!shown.contains(name), "{name}");
                continue;
            }
            assert_eq!(given["live"]["densities"].as_array().unwrap().len(), planned.materials.len(), "{name}");
            kinds.insert(given["live"]["tables"].to_string());
            if planned.plan.light.reads_grid() || planned.plan.light.gathered.is_some() {
                // Light of a page stays as it was rendered.
                continue;
            }
            let tables = page.value(&TABLES.replace("GIVEN", &given.to_string()));
            assert!(!tables.as_array().unwrap().is_empty(), "{name}");
            for table in tables.as_array().unwrap() {
                let [as_they_are, made_anew, nothing] = [0, 1, 2].map(|i| table[i].as_f64().unwrap());
                assert!(as_they_are <= 0.0 && made_anew <= 1e-6 && nothing <= 0.0, "{name}: {tables}");
                assert_eq!(table[3], true, "{name}: half is less: {tables}");
            }
            // The tables of entries are made anew, too, though their numbers hardly change.
            let parts = [1.0, 0.9999999, 0.5, 1.6, 0.0];
            given["parts"] = json!(parts);
            let films = page.value(&THINNED.replace("GIVEN", &given.to_string()));
            for (part, found) in parts.iter().zip(films.as_array().unwrap()) {
                let mut scene = scene.clone();
                if *part > 0.0 {
                    scene.transfer.opacity_length /= part;
                } else {
                    scene.transfer.terms.clear();
                }
                let found = film_of(found, &planned);
                if *part == 0.0 {
                    assert!(found.accumulators.iter().all(|&sum| sum == 0.0), "{name}: nothing is left");
                    assert!(found.transmittance.iter().all(|&left| left >= 1.0), "{name}: nothing dims");
                    continue;
                }
                let expected = support::rungs::Rungs::planned(scene, planned.clone(), SIZE).gpu(renderer);
                let mut off = differences(&found.accumulators, &expected.accumulators);
                off.extend(differences(&found.transmittance, &expected.transmittance));
                let over = off.iter().filter(|&&off| off > 1e-4).count();
                let largest = off.iter().copied().fold(0.0, f32::max);
                println!("{name}, {part}: at most {largest:e}, {over} of {}", off.len());
                let most = match (planned.plan.crossings && (*part - 1.0).abs() > 0.1, decides(&planned.plan)) {
                    // Further samples are taken where the densities of the scene asked for them.
                    (true, _) => off.len() / 50,
                    (false, true) => off.len() / 500,
                    (false, false) => 0,
                };
                assert!(over <= most && largest < 0.05, "{name}, {part}: at most {largest:e}, {over} of {}", off.len());
            }
        }
        assert_eq!(kinds.len(), 3, "{kinds:?}");
    });
}

/// The widget of notebooks: Python turns, cuts and thins what the browser shows, and hears of what its user does.
#[test]
fn the_live_widget_shares_its_view_with_python() {
    let folder = Folder::new();
    small_page(&folder);
    // Traits as those of the page.
    let html = std::fs::read_to_string(folder.path("live.html")).unwrap();
    let block = |id: &str| {
        let first = html.find(&format!("id=\"relume-{id}\">")).unwrap() + format!("id=\"relume-{id}\">").len();
        html[first..first + html[first..].find("</script>").unwrap()].to_owned()
    };
    let names = ["shader", "tables", "voxels-0"];
    let blocks: Vec<String> =
        names.iter().map(|name| format!("'{name}': data({})", json!(block(&format!("live-{name}"))))).collect();
    let live: Value = serde_json::from_str(&block("live")).unwrap();
    let camera = json!({"azimuth": live["camera"]["azimuth"], "elevation": live["camera"]["elevation"], "zoom": 1, "pan": [0, 0]});
    let traits = format!(
        "{{_page: {}, _views: [data({})], _volume: {}, _blocks: {{{}}}, always: true, camera: {camera}, crop: {}, densities: {{}}, hand: [0, 0], picked: []}}",
        in_script(&block("page")),
        json!(block("view-0")),
        in_script(&block("live")),
        blocks.join(", "),
        live["crop"],
    );
    std::fs::write(folder.path("cell.html"), cell(LIVE_WIDGET, &traits, "")).unwrap();
    let mut browser = Browser::with_webgpu();
    let mut page = browser.open(&folder.path("cell.html"), "", [1200, 900]);
    page.value("root.live.then((it) => { globalThis.live = it; })");
    page.wait("root.dataset.ready === 'WebGPU' && live.settled");
    let opened = page.pixels();
    assert!(opened.iter().any(|&code| code > 60), "a black picture proves nothing");
    // Python turns it, and cuts it.
    page.value("model.tell({ camera: { ...model.get('camera'), azimuth: 75, zoom: 1.2 } })");
    page.wait("live.settled");
    let turned = page.pixels();
    assert!(turned != opened);
    page.value("model.tell({ crop: [[0, 0, 0], [63, 30, 35]] })");
    page.wait("live.settled");
    assert!(page.pixels() != turned);
    let cut = page.pixels();
    page.value("model.tell({ densities: Object.fromEntries(JSON.parse(model.get('_page')).components.map(({ name }) => [name, 0.1])) })");
    page.wait("live.settled");
    assert!(page.pixels() != cut);
    // Its user turns it by keys: linked widgets follow at once, Python hears of it at rest.
    page.value("globalThis.told = saved; document.querySelector('.frame').focus()");
    page.press("ArrowRight");
    page.wait("model.get('camera').azimuth === 80");
    page.wait("saved > told");
    assert_eq!(page.value("model.get('camera')")["zoom"], 1.2);
    // As it opened.
    page.value(&format!("model.tell({{ camera: {camera}, crop: {}, densities: {{}} }})", live["crop"]));
    page.wait("live.settled");
    assert_eq!(page.pixels(), opened);
    assert_eq!(page.complaints(), Vec::<String>::new());
    page.value("leave()");
    assert_eq!(page.value("document.querySelector('.frame')"), Value::Null);
}

#[test]
fn what_a_page_cannot_turn_is_refused_by_name() {
    let folder = Folder::new();
    folder.done(&["render", "-D", "volume.dims=[64, 60, 36]", "--size", "16x16", "--accumulators", "film.exr"]);
    folder.refused(2, &["page", "film.exr", "--live", "-o", "film.html"], &["--live", "is for a scene"]);
    let small = ["page", "-D", "volume.dims=[64, 60, 36]", "--size", "16x16", "--live", "-o", "live.html"];
    folder.refused(1, &[&small[..], &["--max-bytes", "20000"]].concat(), &["20000"]);
    // One ray a pixel is marched, which is said.
    let told = folder.done(&[&small[..], &["-D", "accuracy.rays=4"]].concat());
    assert!(told.err.contains("one ray a pixel, not 4"), "{}", told.err);
}

#[test]
fn voxels_beyond_the_crop_box_are_not_in_the_page() {
    with_renderer(|renderer| {
        let mut scene = scenes::named("labels");
        scene.crop = Some([DVec3::new(4.0, 6.0, 5.0), DVec3::new(9.5, 12.0, 11.0)]);
        let planned = plan(&scene, &Quiet).unwrap();
        let statistics = scene.volume().statistics().unwrap();
        let uploaded = renderer.upload(&scene, &planned, &statistics, &Quiet).unwrap();
        let march = BrowserMarch::new(renderer, &scene, &planned, &uploaded, SIZE).unwrap();
        let [width, height, _] = scene.frame.geometry.dims;
        let (texels, bytes) = march.labels.unwrap();
        let numbers = &march.fields[0].numbers;
        // Four voxels more are read along the faces.
        let is_beyond = |i: usize| {
            let at = [i % width, i / width % height, i / (width * height)];
            at[0] > 14 || at[1] < 2 || at[1] > 16 || at[2] < 1 || at[2] > 15
        };
        let beyond: Vec<usize> = (0..numbers.len()).filter(|&i| is_beyond(i)).collect();
        assert!(beyond.len() > 1000 && beyond.iter().all(|&i| numbers[i] == 0), "voxels");
        assert!(beyond.iter().all(|&i| texels[i * bytes..(i + 1) * bytes].iter().all(|&byte| byte == 0)), "labels");
        assert!(numbers.iter().any(|&number| number > 0) && texels.iter().any(|&byte| byte > 0), "what is left");
    });
}

/// A volume of `dims` voxels `spacing` apart that begins at `origin`, with 1 in every voxel, along these axes.
fn ones(dims: [usize; 3], spacing: f64, origin: DVec3, direction: DMat3) -> Arc<Volume> {
    let geometry = Geometry::new("ones", dims, DVec3::splat(spacing), origin, direction).unwrap();
    Arc::new(Volume::new("ones", Voxels::U8(vec![200; dims.iter().product()]), geometry).unwrap())
}

/// A scene of these volumes, which all show what the volume of a test scene does.
fn of_volumes(first: Arc<Volume>, further: Vec<Arc<Volume>>) -> Scene {
    let mut scene = scenes::named("diffuse_three");
    scene.set_volume(Arc::clone(&first));
    let terms = scene.transfer.terms.clone();
    let field = |(i, volume)| Field::new(format!("further_{i}"), volume, terms.clone());
    scene.fields = Fields::of(first).with(further.into_iter().enumerate().map(field).collect());
    scene
}

#[test]
fn voxels_of_a_volume_at_an_angle_are_left_out_beyond_the_crop_box() {
    with_renderer(|renderer| {
        let turned = DMat3::from_rotation_z(0.8) * DMat3::from_rotation_x(0.4);
        let other = ones([50, 40, 30], 0.5, DVec3::new(6.0, -4.0, 0.0), turned);
        let mut scene = of_volumes(ones([24, 20, 16], 1.0, DVec3::ZERO, DMat3::IDENTITY), vec![Arc::clone(&other)]);
        for crop in [None, Some([DVec3::new(4.0, 6.0, 5.0), DVec3::new(9.5, 12.0, 11.0)])] {
            scene.crop = crop;
            let planned = plan(&scene, &Quiet).unwrap();
            let statistics = scene.volume().statistics().unwrap();
            let uploaded = renderer.upload(&scene, &planned, &statistics, &Quiet).unwrap();
            let march = BrowserMarch::new(renderer, &scene, &planned, &uploaded, SIZE).unwrap();
            let numbers = &march.fields[1].numbers;
            let [low, high] = scene.crop.unwrap_or_else(|| scene.frame.whole_box());
            let [width, height, _] = other.geometry.dims;
            let (mut kept, mut beyond) = (0, 0);
            for (i, &number) in numbers.iter().enumerate() {
                let index = DVec3::from_array([i % width, i / width % height, i / (width * height)].map(scenes::float));
                let world = other.geometry.origin + turned * (other.geometry.spacing * index);
                // The volume's own voxels are places of the world.
                let away = (world - world.clamp(low, high)).length();
                // Four voxels along each axis are at most that far.
                if away > 4.0 * 0.5 * 3.0_f64.sqrt() + 1e-9 {
                    assert_eq!(number, 0, "{index} is {away} beyond {crop:?}");
                    beyond += 1;
                }
                if away < 4.0 * 0.5 - 1e-9 {
                    assert!(number > 0, "{index} is {away} beyond {crop:?}");
                    kept += 1;
                }
            }
            assert!(kept > 1000 && beyond > 1000, "{kept}, {beyond}");
        }
    });
}

#[test]
fn a_coarse_page_keeps_its_channels_and_volumes() {
    let big = || ones([300, 300, 250], 1.0, DVec3::ZERO, DMat3::IDENTITY);
    let other = ones([20, 20, 20], 3.0, DVec3::splat(7.0), DMat3::from_rotation_z(0.3));
    let scene = of_volumes(big(), vec![big(), Arc::clone(&other)]);
    let ForReaders { scene: fewer, block, notes } = ForReaders::new(&scene, SIZE, &Quiet).unwrap();
    assert_eq!((block, fewer.frame.geometry.dims), ([2; 3], [150, 150, 125]));
    assert!(matches!(notes[..], [LiveNote::Means { block: [2, 2, 2], dims: [150, 150, 125], .. }]), "{notes:?}");
    let names = |scene: &Scene| scene.fields.iter().map(|field| field.name.clone()).collect::<Vec<_>>();
    assert_eq!(names(&fewer), names(&scene));
    assert_eq!(fewer.fields.terms(), scene.fields.terms());
    assert_eq!(fewer.fields.sharing()[0].volume.geometry, fewer.frame.geometry);
    assert!(Arc::ptr_eq(&fewer.fields.beside()[0].volume, &other), "a volume on its own grid stays as it is");
    // One number in a texel each: both have room.
    let mut scene = of_volumes(big(), vec![Arc::clone(&other)]);
    scene.shading = Shading::None;
    assert_eq!(ForReaders::new(&scene, SIZE, &Quiet).unwrap().block, [1; 3]);
    // A volume on its own grid that takes most of the room is refused by its size.
    let scene = of_volumes(other, vec![big()]);
    let refused = ForReaders::new(&scene, SIZE, &Quiet).unwrap_err();
    assert_eq!(refused.code(), "page-volume-too-large");
    assert!(refused.to_string().contains("need 300×300×250 texels of 8 bytes"), "{refused}");
}
