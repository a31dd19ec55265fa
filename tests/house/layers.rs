//! Module dependencies and vocabulary follow the map in ARCHITECTURE.md.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// The crates below `src/`: folder, the module that is the crate itself, and its other modules of the map. Modules of the folder
/// that are not listed are parts of the first.
const HOUSE: &[(&str, &str, &[&str])] = &[
    ("base", "", &["input", "memory", "number", "parallel", "progress"]),
    ("volume", "volume", &[]),
    ("colour", "", &["model", "palette", "spectrum", "written"]),
    ("scene", "scene", &["film", "plan", "reference", "tables"]),
    ("vulkan", "vulkan", &["present", "shader"]),
    ("render", "render", &[]),
    ("document", "document", &["annotate", "look", "output"]),
    ("measure", "measure", &[]),
];

/// Modules that each module may use; unlisted modules may use none.
const ARROWS: &[(&str, &[&str])] = &[
    ("input", &[]),
    ("memory", &[]),
    ("number", &[]),
    ("parallel", &[]),
    ("progress", &[]),
    ("spectrum", &["input", "number"]),
    ("written", &["spectrum", "number"]),
    ("volume", &["input", "memory", "progress", "number", "parallel"]),
    ("model", &["spectrum", "progress", "number"]),
    ("palette", &["input", "model", "spectrum", "progress", "number", "written"]),
    ("scene", &["model", "spectrum", "volume", "progress", "number", "written"]),
    ("plan", &["scene", "model", "spectrum", "progress", "number"]),
    ("film", &["plan", "scene", "model", "spectrum", "number", "parallel"]),
    ("ranks", &["film", "scene"]),
    ("annotate", &["film", "plan", "scene", "spectrum", "volume", "number", "written"]),
    ("tables", &["film", "plan", "scene", "model", "spectrum", "volume", "progress", "number", "parallel"]),
    (
        "reference",
        &["film", "tables", "plan", "scene", "model", "spectrum", "volume", "memory", "progress", "number", "parallel"],
    ),
    ("shader", &[]),
    ("vulkan", &["shader"]),
    ("present", &["vulkan"]),
    (
        "render",
        &[
            "vulkan",
            "reference",
            "film",
            "shader",
            "tables",
            "plan",
            "scene",
            "model",
            "spectrum",
            "volume",
            "memory",
            "progress",
            "number",
        ],
    ),
    ("output", &["annotate", "film", "plan", "scene", "input", "model", "spectrum", "volume", "progress", "number"]),
    ("look", &["scene", "spectrum", "volume", "written", "progress", "number", "parallel"]),
    (
        "document",
        &[
            "annotate", "film", "input", "look", "output", "palette", "scene", "model", "spectrum", "volume",
            "progress", "number", "written",
        ],
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
            "written",
        ],
    ),
    (
        "view",
        &[
            "annotate",
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
    ("live", &["output", "render", "plan", "scene", "tables", "volume", "progress", "number"]),
    (
        "cli",
        &[
            "annotate",
            "document",
            "live",
            "view",
            "input",
            "measure",
            "memory",
            "output",
            "ranks",
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
    ("zarrs", &["volume"]),
    ("mpi", &["ranks"]),
];

/// Words that modules must not use.
const WORDS: &[(&str, &[&str])] = &[
    ("spectrum", &["buffer"]),
    ("vulkan", &["spectrum", "spectra", "wavelength"]),
    ("shader", &["spectrum", "spectra", "wavelength"]),
];

/// Siblings that use each other, and why they stay: folder, its modules, reason. None at present.
const CIRCLES: &[(&str, &[&str], &str)] = &[];
/// Modules whose texts may name a flag of the command line. A page of `measure` shows commands to copy.
const NAMING_FLAGS: &[&str] = &["src/cli/", "src/view/", "src/measure/report/"];

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
        let mut parts = path.strip_prefix("src/").into_iter().flat_map(|rest| rest.split('/'));
        let mut next =
            || parts.next().map(|part| part.trim_end_matches(".rs")).filter(|name| !["lib", "main"].contains(name));
        let module = next().and_then(|folder| match house(folder) {
            None => Some(folder),
            Some((itself, others)) => {
                next().filter(|name| others.contains(name)).or(Some(itself)).filter(|name| !name.is_empty())
            }
        });
        Self { path: path.into(), module: module.map(str::to_owned), text: text.to_owned() }
    }

    /// Folder of the file's crate; `None` for the program.
    fn home(&self) -> Option<String> {
        let folder = self.path.components().nth(1)?.as_os_str().to_string_lossy().into_owned();
        house(&folder).map(|_| folder)
    }
}

/// The module that a crate is, and its others.
fn house(folder: &str) -> Option<(&'static str, &'static [&'static str])> {
    HOUSE.iter().find(|(name, ..)| *name == folder).map(|(_, itself, others)| (*itself, *others))
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

/// Modules that a file uses through `crate::…`, `relume::…` or a crate of the house.
fn reached(source: &Source) -> Vec<String> {
    let code = code(&source.text);
    let mut found = Vec::new();
    for start in
        ["crate", "relume"].into_iter().map(str::to_owned).chain(HOUSE.iter().map(|(it, ..)| format!("relume_{it}")))
    {
        let home = start.strip_prefix("relume_").map(str::to_owned);
        let home = home.or_else(|| source.home().filter(|_| start == "crate"));
        for at in paths(&code, &format!("{start}::")) {
            for path in listed(&code[at..]) {
                let Some(name) = path.get(1) else { continue };
                match home.as_deref().and_then(house) {
                    Some((itself, others)) if !others.contains(&&**name) => found.push(itself.to_owned()),
                    // Capitalised names are items of the root.
                    _ if name.starts_with(char::is_lowercase) => found.push(name.clone()),
                    _ => (),
                }
            }
        }
    }
    found.retain(|name| !name.is_empty());
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

/// Uses of siblings, by the path of their parent: who uses whom, and where.
type Uses = BTreeMap<String, BTreeMap<(String, String), BTreeSet<String>>>;

/// Module path of a file: `src/view/ui/mod.rs` is `view`, `ui`. `None` for the roots.
fn module_path(source: &Source) -> Option<Vec<String>> {
    source.module.as_ref()?;
    let path = source.path.with_extension("");
    let parts = path.components().skip(1).map(|part| part.as_os_str().to_string_lossy().into_owned());
    Some(parts.filter(|part| part != "mod" && part != "lib").collect())
}

/// Paths that start at the beginning of `text`, with braced lists at every level resolved: `a::{b, c::d}` is `a::b` and
/// `a::c::d`.
fn listed(text: &str) -> Vec<Vec<String>> {
    let text = text.trim_start();
    if let Some(list) = text.strip_prefix('{') {
        let (mut depth, mut items, mut item) = (0, Vec::new(), String::new());
        for character in list.chars() {
            match character {
                '}' if depth == 0 => break,
                ',' if depth == 0 => items.push(std::mem::take(&mut item)),
                _ => {
                    depth += i32::from(character == '{') - i32::from(character == '}');
                    item.push(character);
                }
            }
        }
        items.push(item);
        return items.iter().flat_map(|item| listed(item)).collect();
    }
    let name = first_word(text);
    if name.is_empty() {
        return Vec::new();
    }
    let rest = text[name.len()..].strip_prefix("::").map(listed).unwrap_or_default();
    if rest.is_empty() {
        vec![vec![name]]
    } else {
        rest.into_iter().map(|rest| [vec![name.clone()], rest].concat()).collect()
    }
}

/// Code of a file before its unit tests, which may use what they like.
fn code_of_product(text: &str) -> String {
    let code = code(text);
    code.split("#[cfg(test)]\nmod ").next().unwrap_or_default().to_owned()
}

/// Names that each module re-exports from its own modules, with the module that each comes from.
fn exported(modules: &BTreeMap<Vec<String>, String>) -> BTreeMap<Vec<String>, BTreeMap<String, Vec<String>>> {
    let mut found: BTreeMap<_, BTreeMap<_, _>> = BTreeMap::new();
    for (module, code) in modules {
        for at in paths(code, "use ") {
            let line = code[..at].rsplit('\n').next().unwrap_or_default();
            if !line.trim_start().starts_with("pub") {
                continue;
            }
            for mut path in listed(&code[at + "use ".len()..]) {
                path.retain(|part| part != "self");
                let name = path.pop().unwrap_or_default();
                if path
                    .first()
                    .is_some_and(|first| modules.contains_key(&[&module[..], std::slice::from_ref(first)].concat()))
                {
                    found.entry(module.clone()).or_default().insert(name, path);
                }
            }
        }
    }
    found
}

/// Uses between siblings of every folder. A name that a folder re-exports counts as that of the file it comes from;
/// what the folder's own file defines is free to all.
fn uses_of_siblings(sources: &[Source]) -> Uses {
    let modules = sources.iter().filter_map(|source| Some((module_path(source)?, code_of_product(&source.text))));
    let modules: BTreeMap<Vec<String>, String> = modules.collect();
    let root = |module: &[String]| usize::from(module.first().is_some_and(|folder| house(folder).is_some()));
    let exported = exported(&modules);
    let mut uses = Uses::new();
    for (module, code) in &modules {
        for start in ["crate::", "super::", "self::"] {
            for at in paths(code, start) {
                for path in listed(&code[at..]) {
                    let mut place = module.clone();
                    for part in &path {
                        match part.as_str() {
                            "crate" => place.truncate(root(module)),
                            "super" => drop(place.pop()),
                            "self" => (),
                            _ if modules.contains_key(&[&place[..], std::slice::from_ref(part)].concat()) => {
                                place.push(part.clone());
                            }
                            _ => {
                                let from = exported.get(&place).and_then(|names| names.get(part));
                                place.extend(from.into_iter().flatten().cloned());
                                break;
                            }
                        }
                    }
                    let shared = module.iter().zip(&place).take_while(|(one, two)| one == two).count();
                    if let (Some(one), Some(two)) = (module.get(shared), place.get(shared)) {
                        let of_folder = uses.entry(module[..shared].join("/")).or_default();
                        let known = of_folder.entry((one.clone(), two.clone())).or_default();
                        known.insert(format!("{}: {}", module.join("/"), path.join("::")));
                    }
                }
            }
        }
    }
    uses
}

/// Circles of siblings, each with the uses that make it one.
fn circles(uses: &Uses) -> Vec<(String, BTreeSet<String>, Vec<String>)> {
    let mut found: Vec<(String, BTreeSet<String>, Vec<String>)> = Vec::new();
    for (folder, edges) in uses {
        // Everything that a module reaches along the uses.
        let reached = |from: &String| {
            let (mut all, mut new) = (BTreeSet::new(), vec![from.clone()]);
            while let Some(one) = new.pop() {
                let next = edges.keys().filter(|(user, _)| *user == one).map(|(_, used)| used.clone());
                new.extend(next.filter(|used| all.insert(used.clone())));
            }
            all
        };
        let names: BTreeSet<&String> = edges.keys().map(|(user, _)| user).collect();
        for name in names {
            let all = reached(name);
            if !all.contains(name) || found.iter().any(|(known, members, _)| known == folder && members.contains(name))
            {
                continue;
            }
            let members: BTreeSet<String> = all.iter().filter(|other| reached(other).contains(name)).cloned().collect();
            let inside = edges.iter().filter(|((one, two), _)| members.contains(one) && members.contains(two));
            let told = inside.map(|((one, two), at)| format!("{one} uses {two}: {at:?}")).collect();
            found.push((folder.clone(), members, told));
        }
    }
    found
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

/// Texts of a file that name a flag although its module may not. In code, two minus signs never precede a word.
fn wrong_flags(source: &Source) -> Vec<String> {
    let path = source.path.to_string_lossy().replace('\\', "/");
    if NAMING_FLAGS.iter().any(|folder| path.starts_with(folder)) {
        return Vec::new();
    }
    let code = code(&source.text);
    let flags = code.match_indices("--").map(|(at, _)| &code[at..]);
    let flags = flags.filter(|rest| rest[2..].starts_with(|letter: char| letter.is_ascii_lowercase()));
    flags.map(|rest| format!("{path} names the flag {}", rest.split([' ', '"', '\n']).next().unwrap())).collect()
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
fn siblings_do_not_use_each_other_in_a_circle() {
    let uses = uses_of_siblings(&files("src", &[".rs"]));
    assert!(uses.len() > 10 && uses["render"].len() > 3, "the uses are found: {uses:?}");
    let known = |folder: &str, members: &BTreeSet<String>| {
        CIRCLES.iter().any(|(known, names, _)| *known == folder && names.iter().copied().eq(members.iter()))
    };
    let found = circles(&uses);
    let new: Vec<String> = found
        .iter()
        .filter(|(folder, members, _)| !known(folder, members))
        .map(|(folder, members, told)| format!("{folder}: {members:?}\n  {}", told.join("\n  ")))
        .collect();
    assert!(new.is_empty(), "{}", new.join("\n"));
    assert_eq!(found.len(), CIRCLES.len(), "a listed circle is there no more");
}

#[test]
fn every_module_is_on_the_map() {
    let root = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("src/lib.rs")).unwrap();
    let declared = root.lines().filter_map(|line| line.trim_start_matches("pub ").strip_prefix("mod ")).map(first_word);
    let of_crates =
        HOUSE.iter().flat_map(|(_, itself, others)| others.iter().chain([itself])).map(|name| (*name).to_owned());
    for module in declared.chain(of_crates).filter(|name| !name.is_empty()) {
        assert!(ARROWS.iter().any(|(name, _)| *name == module), "{module} is not on the map");
    }
    let members = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml")).unwrap();
    for (folder, ..) in HOUSE {
        assert!(members.contains(&format!("\"src/{folder}\"")), "{folder} is no member");
    }
}

#[test]
fn modules_keep_to_their_words() {
    let wrong: Vec<String> = files("src", &[".rs"]).iter().flat_map(wrong_words).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn only_the_command_line_and_the_window_name_flags() {
    let wrong: Vec<String> = files("src", &[".rs"]).iter().flat_map(wrong_flags).collect();
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
        wrong("src/colour/spectrum/cie.rs", "use relume_vulkan::Device;"),
        ["src/colour/spectrum/cie.rs: spectrum may not use vulkan"]
    );
    assert_eq!(wrong("src/scene/camera.rs", "use crate::{\n    lights::{Mix, plan},\n    plan::Planned,\n};").len(), 1);
    assert_eq!(wrong("src/vulkan/lib.rs", "fn f() -> relume_colour::spectrum::Spectrum { pub(crate) x }").len(), 1);
    assert_eq!(wrong("src/vulkan/shader.rs", "let x = $crate::Device::make(); let y = relume::cli::run();").len(), 2);
    assert_eq!(wrong("src/extra/mod.rs", "").len(), 1);
    assert_eq!(
        wrong("src/scene/reference/march.rs", "use crate::{tables::Tables, Scene, reference::real::Real};"),
        [""; 0]
    );
    assert_eq!(wrong("src/colour/spectrum/cie.rs", "// relume_render draws this\nuse my_crate::vulkan;"), [""; 0]);
    assert_eq!(wrong("src/lib.rs", "use crate::render::Frame;"), [""; 0]);
    assert_eq!(
        wrong("src/cli/info.rs", "use crate::written::number;\nuse super::scene;"),
        ["src/cli/info.rs: cli may not use written"]
    );
}

#[test]
fn a_circle_of_siblings_is_caught() {
    let found = |texts: &[(&str, &str)]| {
        let sources: Vec<Source> = texts.iter().map(|(path, text)| Source::new(path, text)).collect();
        let members = |(folder, members, _): (String, BTreeSet<String>, Vec<String>)| {
            format!("{folder}: {}", members.into_iter().collect::<Vec<_>>().join(" "))
        };
        circles(&uses_of_siblings(&sources)).into_iter().map(members).collect::<Vec<_>>()
    };
    let of = |root: &str, one: &str, two: &str, three: &str| {
        let texts = [root, one, two, three];
        let paths =
            ["src/scene/film/mod.rs", "src/scene/film/one.rs", "src/scene/film/two.rs", "src/scene/film/three.rs"];
        found(&paths.into_iter().zip(texts).collect::<Vec<_>>())
    };
    assert_eq!(of("", "use super::two::Two;", "use super::one::One;", ""), ["scene/film: one two"]);
    assert_eq!(
        of("", "use super::two;", "fn f() { super::three::g() }", "use crate::film::{one::One};"),
        ["scene/film: one three two"]
    );
    assert_eq!(
        of("pub use two::{One, Two};", "use super::{Film, Two};", "use super::one::X;", ""),
        ["scene/film: one two"]
    );
    assert_eq!(
        of("", "use super::two::Two;", "use super::Film;\nuse super::three::Three;", "use super::Film;"),
        [""; 0]
    );
    assert_eq!(
        of("", "use super::two::Two;", "// super::one\n#[cfg(test)]\nmod tests {\n use super::super::one;\n}", ""),
        [""; 0]
    );
    let deep = [("src/view/ui/mod.rs", "use super::window::Options;"), ("src/view/window.rs", "use super::ui::Shown;")];
    assert_eq!(found(&deep), ["view: ui window"]);
    let inner = [
        ("src/view/mod.rs", ""),
        ("src/view/ui/mod.rs", ""),
        ("src/view/ui/dial.rs", "use crate::view::{tour::Tour};"),
        ("src/view/tour.rs", "use super::ui;"),
    ];
    assert_eq!(found(&inner), ["view: tour ui"]);
}

#[test]
fn a_wrong_crate_is_caught() {
    let wrong = |path: &str, text: &str| wrong_crates(&Source::new(path, text)).len();
    assert_eq!(wrong("src/scene/lib.rs", "use egui::Rect;\nuse egui_winit::State;"), 1);
    assert_eq!(wrong("src/measure/lib.rs", "fn f() -> ash::vk::Image {}"), 1);
    assert_eq!(wrong("src/view/ui.rs", "use egui::Rect; use crate::vulkan::Surface;"), 0);
    assert_eq!(wrong("src/measure/lib.rs", "let ash = 1; let hash_of = crash::it();"), 0);
}

#[test]
fn a_wrong_word_is_caught() {
    let wrong = |path: &str, text: &str| wrong_words(&Source::new(path, text)).len();
    assert_eq!(wrong("src/colour/spectrum/mod.rs", "//! Fills a Buffer."), 1);
    assert_eq!(wrong("src/vulkan/image.rs", "//! One layer per wavelength of a spectrum."), 2);
    assert_eq!(wrong("src/vulkan/shader.rs", "/// Spectral."), 1);
    assert_eq!(wrong("src/render/lib.rs", "//! Buffers of spectra."), 0);
}

#[test]
fn a_flag_in_a_message_of_the_library_is_caught() {
    let wrong = |path: &str, text: &str| wrong_flags(&Source::new(path, text)).len();
    let message = "#[error(\"too large: take --downsample or --size\")]";
    assert_eq!(wrong("src/render/lib.rs", message), 2);
    assert_eq!(wrong("src/cli/advice.rs", message), 0);
    assert_eq!(wrong("src/colour/model/fit.rs", "// As --model does.\nlet x = -1 - -y;"), 0);
}

#[test]
fn a_missing_purpose_is_caught() {
    let opens = |path: &str, text: &str| opens_with_a_purpose(&Source::new(path, text));
    assert!(
        opens("src/scene/plan.rs", "//! What this scene needs.\n") && opens("shaders/march.wgsl", "// The march.\n")
    );
    assert!(
        !opens("src/scene/plan.rs", "// What this scene needs.\n") && !opens("shaders/march.wgsl", "fn main() {}\n")
    );
}
