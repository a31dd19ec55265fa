//! Module dependencies and vocabulary follow the map in ARCHITECTURE.md.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::fs;
use std::path::{Path, PathBuf};

/// Modules that each module may use; unlisted modules may use none.
const ARROWS: &[(&str, &[&str])] = &[
    ("input", &[]),
    ("memory", &[]),
    ("number", &[]),
    ("progress", &[]),
    ("spectrum", &["input"]),
    ("written", &["spectrum", "number"]),
    ("volume", &["input", "memory", "progress", "number"]),
    ("model", &["spectrum", "progress", "number"]),
    ("palette", &["input", "model", "spectrum", "progress", "number", "written"]),
    ("scene", &["model", "spectrum", "volume", "number"]),
    ("plan", &["scene", "model", "spectrum", "progress", "number"]),
    ("film", &["plan", "scene", "model", "spectrum", "number"]),
    ("tables", &["film", "plan", "scene", "model", "spectrum", "volume", "number"]),
    ("reference", &["film", "tables", "plan", "scene", "volume", "progress", "number"]),
    ("shader", &[]),
    ("vulkan", &["shader"]),
    ("present", &["vulkan"]),
    ("render", &["vulkan", "film", "shader", "tables", "plan", "scene", "model", "volume", "progress", "number"]),
    ("output", &["film", "plan", "scene", "input", "model", "spectrum", "volume", "progress"]),
    (
        "document",
        &["input", "output", "palette", "scene", "model", "spectrum", "volume", "progress", "number", "written"],
    ),
    (
        "measure",
        &[
            "document",
            "input",
            "output",
            "vulkan",
            "render",
            "reference",
            "film",
            "tables",
            "plan",
            "scene",
            "model",
            "spectrum",
            "volume",
            "progress",
            "number",
        ],
    ),
    (
        "view",
        &[
            "memory",
            "present",
            "document",
            "input",
            "output",
            "measure",
            "render",
            "reference",
            "film",
            "vulkan",
            "tables",
            "plan",
            "scene",
            "palette",
            "model",
            "spectrum",
            "volume",
            "progress",
            "number",
        ],
    ),
    (
        "cli",
        &[
            "document",
            "view",
            "input",
            "measure",
            "memory",
            "output",
            "render",
            "reference",
            "film",
            "vulkan",
            "shader",
            "tables",
            "plan",
            "scene",
            "palette",
            "model",
            "spectrum",
            "volume",
            "progress",
            "number",
        ],
    ),
];

/// Modules that may use each of these external crates; other crates are unrestricted. A crate includes those whose
/// names
/// start with it and `_`: `egui` includes `egui_winit`.
const CRATES: &[(&str, &[&str])] = &[
    ("ash", &["vulkan", "present"]),
    ("gpu_allocator", &["vulkan"]),
    ("naga", &["shader"]),
    ("egui", &["view", "present"]),
    ("winit", &["view", "present"]),
    ("clap", &["cli"]),
    ("indicatif", &["cli"]),
    ("tracing_subscriber", &["cli"]),
    ("tracing", &["cli", "document", "measure", "spectrum", "view", "vulkan"]),
    ("clarabel", &["palette"]),
    ("exr", &["output"]),
];

/// Words that modules must not use.
const WORDS: &[(&str, &[&str])] = &[
    ("spectrum", &["buffer"]),
    ("vulkan", &["spectrum", "spectra", "wavelength"]),
    ("shader", &["spectrum", "spectra", "wavelength"]),
];

/// Source file of the program.
struct Source {
    /// Path relative to the repository.
    path: PathBuf,
    /// Module of the map; `None` for the roots `lib.rs` and `main.rs`.
    module: Option<String>,
    text: String,
}

impl Source {
    fn new(path: &str, text: &str) -> Self {
        let module = path.strip_prefix("src/").map(|rest| rest.split('/').next().unwrap_or(rest));
        let module = module.map(|name| name.trim_end_matches(".rs").to_owned());
        let module = module.filter(|name| name != "lib" && name != "main");
        Self { path: path.into(), module, text: text.to_owned() }
    }

    /// Whether the file belongs to the binary, which uses the library by name.
    fn is_of_program(&self) -> bool {
        self.module.as_deref() == Some("cli")
    }
}

/// All files below `folder` with a name that ends in one of `endings`.
fn files(folder: &str, endings: &[&str]) -> Vec<Source> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut found = Vec::new();
    let mut folders = vec![root.join(folder)];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).into_iter().flatten() {
            let path = entry.unwrap().path();
            let name = path.strip_prefix(root).unwrap().to_string_lossy().replace('\\', "/");
            if path.is_dir() {
                folders.push(path);
            } else if endings.iter().any(|ending| name.ends_with(ending)) {
                found.push(Source::new(&name, &fs::read_to_string(&path).unwrap()));
            }
        }
    }
    found
}

/// Returns `text` without line comments.
fn code(text: &str) -> String {
    text.lines().map(|line| line.split("//").next().unwrap_or(line)).collect::<Vec<_>>().join("\n")
}

/// Positions of `name` in `code` as a whole path: `$crate::` counts as `crate::`, `my_crate::` does not.
fn paths<'a>(code: &'a str, name: &'a str) -> impl Iterator<Item = usize> + 'a {
    code.match_indices(name).map(|(at, _)| at).filter(|&at| {
        let before = code[..at].chars().next_back();
        !before.is_some_and(|before| before.is_alphanumeric() || before == '_' || before == ':')
    })
}

/// Modules that a file uses through `crate::…` or, in the binary, `relume::…`: one name or a braced list at the first
/// level.
fn reached(source: &Source) -> Vec<String> {
    let code = code(&source.text);
    let mut found = Vec::new();
    let library = if source.is_of_program() { "relume::" } else { "crate::" };
    for at in paths(&code, library) {
        let rest = &code[at + library.len()..];
        match rest.strip_prefix('{') {
            None => found.push(first_word(rest)),
            Some(list) => {
                let (mut depth, mut item) = (0, String::new());
                for character in list.chars() {
                    match character {
                        '}' if depth == 0 => break,
                        ',' if depth == 0 => found.push(first_word(&std::mem::take(&mut item))),
                        '{' => depth += 1,
                        '}' => depth -= 1,
                        _ if depth == 0 => item.push(character),
                        _ => (),
                    }
                }
                found.push(first_word(&item));
            }
        }
    }
    // Capitalised names and function calls are items of the crate root.
    found.retain(|name| name.chars().next().is_some_and(char::is_lowercase));
    found
}

fn first_word(text: &str) -> String {
    text.trim_start().chars().take_while(|&character| character.is_alphanumeric() || character == '_').collect()
}

/// Dependencies of a file that are not on the map.
fn wrong_arrows(source: &Source) -> Vec<String> {
    let Some(module) = &source.module else { return Vec::new() };
    let Some((_, allowed)) = ARROWS.iter().find(|(name, _)| name == module) else {
        return vec![format!("{}: the module `{module}` is not on the map", source.path.display())];
    };
    let reached = reached(source).into_iter();
    let wrong = reached.filter(|name| name != module && !allowed.contains(&&**name));
    wrong.map(|name| format!("{}: {module} may not use {name}", source.path.display())).collect()
}

/// External crates of a file that its module may not use.
fn wrong_crates(source: &Source) -> Vec<String> {
    let Some(module) = &source.module else { return Vec::new() };
    let code = code(&source.text);
    let is_used = |name: &str| {
        paths(&code, name).any(|at| {
            let rest = code[at + name.len()..]
                .trim_start_matches(|character: char| character.is_alphanumeric() || character == '_');
            let family = code[at + name.len()..].starts_with(['_', ':']);
            family && rest.starts_with("::")
        })
    };
    let wrong = CRATES.iter().filter(|(name, modules)| !modules.contains(&&**module) && is_used(name));
    wrong.map(|(name, _)| format!("{}: {module} may not use the crate {name}", source.path.display())).collect()
}

/// Words of a file that its module may not use.
fn wrong_words(source: &Source) -> Vec<String> {
    let named = source.path.file_stem().map(|name| name.to_string_lossy().into_owned());
    let module = source.module.clone().or(named).unwrap_or_default();
    let words = WORDS.iter().find(|(name, _)| **name == module).map_or(&[][..], |(_, words)| words);
    let text = source.text.to_lowercase();
    let wrong = words.iter().filter(|word| text.contains(**word));
    wrong.map(|word| format!("{}: {module} may not say {word:?}", source.path.display())).collect()
}

/// Whether the file starts with a statement of its purpose.
fn opens_with_a_purpose(source: &Source) -> bool {
    let mark = if source.path.extension().is_some_and(|ending| ending == "rs") { "//! " } else { "// " };
    source.text.starts_with(mark)
}

#[test]
fn arrows_go_one_way() {
    let sources = files("src", &[".rs"]);
    assert!(!sources.is_empty());
    let wrong: Vec<String> = sources.iter().flat_map(wrong_arrows).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_arrow_is_used() {
    let sources = files("src", &[".rs"]);
    let mut unused = Vec::new();
    for (module, allowed) in ARROWS {
        let of_module = sources.iter().filter(|source| source.module.as_deref() == Some(module));
        let used: Vec<String> = of_module.flat_map(reached).collect();
        let not_used = allowed.iter().filter(|other| !used.iter().any(|name| name == **other));
        unused.extend(not_used.map(|other| format!("{module} does not use {other}")));
    }
    assert!(unused.is_empty(), "{}", unused.join("\n"));
}

#[test]
fn external_crates_stay_in_their_modules() {
    let sources = files("src", &[".rs"]);
    let wrong: Vec<String> = sources.iter().flat_map(wrong_crates).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    for (name, modules) in CRATES {
        for module in *modules {
            let here = sources.iter().filter(|source| source.module.as_deref() == Some(module));
            let uses = here.map(|source| code(&source.text)).any(|code| paths(&code, name).next().is_some());
            assert!(uses, "{module} does not use {name}");
        }
    }
}

#[test]
fn the_map_has_no_circles() {
    // A module listed earlier cannot depend on one listed later.
    let rank = |name: &str| ARROWS.iter().position(|(other, _)| *other == name).unwrap();
    for (module, allowed) in ARROWS {
        for other in *allowed {
            assert!(rank(other) < rank(module), "{module} and {other}");
        }
    }
}

#[test]
fn every_module_is_on_the_map() {
    let lib = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("src/lib.rs")).unwrap();
    let declared = lib.lines().filter_map(|line| line.trim_start_matches("pub ").strip_prefix("mod "));
    for module in declared.map(first_word) {
        assert!(ARROWS.iter().any(|(name, _)| *name == module), "{module} is not on the map");
    }
}

#[test]
fn modules_keep_to_their_words() {
    let wrong: Vec<String> = files("src", &[".rs"]).iter().flat_map(wrong_words).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_file_opens_with_its_purpose() {
    let mut sources = files("src", &[".rs"]);
    sources.extend(files("shaders", &[".wgsl"]));
    sources.extend(files("tests", &[".rs"]));
    sources.extend(files("benches", &[".rs"]));
    let silent: Vec<String> = sources
        .iter()
        .filter(|source| !opens_with_a_purpose(source))
        .map(|source| source.path.display().to_string())
        .collect();
    assert!(silent.is_empty(), "no purpose in the first line of: {}", silent.join(", "));
}

#[test]
fn a_wrong_arrow_is_caught() {
    let wrong = |path: &str, text: &str| wrong_arrows(&Source::new(path, text));
    assert_eq!(
        wrong("src/spectrum/cie.rs", "use crate::vulkan::Device;"),
        ["src/spectrum/cie.rs: spectrum may not use vulkan"]
    );
    assert_eq!(wrong("src/plan.rs", "use crate::{\n    scene::{Scene, render},\n    render::Frame,\n};").len(), 1);
    assert_eq!(wrong("src/vulkan/mod.rs", "fn f() -> crate::spectrum::Spectrum { pub(crate) x }").len(), 1);
    assert_eq!(wrong("src/shader.rs", "let x = $crate::tables::make(); let y = crate::cli::run();").len(), 2);
    assert_eq!(wrong("src/extra/mod.rs", "").len(), 1);
    assert_eq!(wrong("src/reference/march.rs", "use crate::{tables::Tables, scene, reference::real::Real};"), [""; 0]);
    assert_eq!(wrong("src/spectrum/cie.rs", "// crate::render draws this\nuse my_crate::vulkan;"), [""; 0]);
    assert_eq!(wrong("src/lib.rs", "use crate::render::Frame;"), [""; 0]);
    assert_eq!(
        wrong("src/cli/info.rs", "use relume::written::number;\nuse super::scene;"),
        ["src/cli/info.rs: cli may not use written"]
    );
}

#[test]
fn a_wrong_crate_is_caught() {
    let wrong = |path: &str, text: &str| wrong_crates(&Source::new(path, text)).len();
    assert_eq!(wrong("src/scene/mod.rs", "use egui::Rect;\nuse egui_winit::State;"), 1);
    assert_eq!(wrong("src/measure/mod.rs", "fn f() -> ash::vk::Image {}"), 1);
    assert_eq!(wrong("src/view/ui.rs", "use egui::Rect; use crate::vulkan::Surface;"), 0);
    assert_eq!(wrong("src/measure/mod.rs", "let ash = 1; let hash_of = crash::it();"), 0);
}

#[test]
fn a_wrong_word_is_caught() {
    let wrong = |path: &str, text: &str| wrong_words(&Source::new(path, text)).len();
    assert_eq!(wrong("src/spectrum/mod.rs", "//! Fills a Buffer."), 1);
    assert_eq!(wrong("src/vulkan/image.rs", "//! One layer per wavelength of a spectrum."), 2);
    assert_eq!(wrong("src/shader.rs", "/// Spectral."), 1);
    assert_eq!(wrong("src/render/mod.rs", "//! Buffers of spectra."), 0);
}

#[test]
fn a_missing_purpose_is_caught() {
    let opens = |path: &str, text: &str| opens_with_a_purpose(&Source::new(path, text));
    assert!(opens("src/plan.rs", "//! What this scene needs.\n") && opens("shaders/march.wgsl", "// The march.\n"));
    assert!(!opens("src/plan.rs", "// What this scene needs.\n") && !opens("shaders/march.wgsl", "fn main() {}\n"));
}
