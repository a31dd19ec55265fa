//! Pages cited by code and documentation exist.

use std::fs;
use std::path::{Path, PathBuf};

/// All text files of the repository below `folder`, with paths from the root.
fn texts(folder: &str) -> Vec<(PathBuf, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut found = Vec::new();
    let mut folders = vec![root.join(folder)];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
            if path.is_dir() {
                folders.push(path);
            } else if ["rs", "wgsl", "md", "py", "toml"].contains(&ending) {
                found.push((path.strip_prefix(root).unwrap().to_owned(), fs::read_to_string(&path).unwrap()));
            }
        }
    }
    found
}

/// Markdown pages named in a text: words of letters, digits and `._/-` that end in `.md` and start with a folder or a
/// capital
/// letter. URLs are excluded.
fn pages(text: &str) -> Vec<&str> {
    let is_part = |c: char| c.is_ascii_alphanumeric() || "._/-".contains(c);
    let words = text.split(|c: char| !is_part(c)).map(|word| word.trim_end_matches('.'));
    let is_page = |word: &&str| {
        let begins = word.contains('/') || word.starts_with(|c: char| c.is_ascii_uppercase());
        word.ends_with(".md") && begins && !word.starts_with("//")
    };
    words.filter(is_page).collect()
}

/// Relative links of a Markdown text, without anchors.
fn links(text: &str) -> Vec<&str> {
    let targets = text.split("](").skip(1).filter_map(|rest| rest.split(')').next());
    let paths = targets.filter(|target| !target.contains("://") && !target.starts_with('#'));
    paths.map(|target| target.split('#').next().unwrap_or(target)).collect()
}

/// Pages and links of a file that do not exist.
fn missing(path: &Path, text: &str) -> Vec<String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let beside = root.join(path.parent().unwrap_or(Path::new("")));
    let mut wrong = Vec::new();
    // A page may be named from the root, from its own folder or from docs.
    for page in pages(text) {
        if ![root.join(page), beside.join(page), root.join("docs").join(page)].iter().any(|path| path.is_file()) {
            wrong.push(format!("{}: {page} is not in the repository", path.display()));
        }
    }
    if path.extension().is_some_and(|ending| ending == "md") {
        for link in links(text) {
            if !beside.join(link).exists() {
                wrong.push(format!("{}: the link {link} leads nowhere", path.display()));
            }
        }
    }
    wrong
}

#[test]
fn every_cited_page_is_in_the_repository() {
    let mut sources = Vec::new();
    for folder in ["src", "shaders", "tests", "benches", "examples", "data", "docs"] {
        sources.extend(texts(folder));
    }
    for page in ["README.md", "ARCHITECTURE.md", "CHANGELOG.md", "CONTRIBUTING.md"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(page);
        sources.push((page.into(), fs::read_to_string(path).unwrap()));
    }
    assert!(sources.len() > 100, "the repository was not read");
    let own = |path: &Path| path == Path::new("tests/house/citations.rs");
    let others = sources.iter().filter(|(path, _)| !own(path));
    let wrong: Vec<String> = others.flat_map(|(path, text)| missing(path, text)).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn a_wrong_citation_is_caught() {
    let wrong = |path: &str, text: &str| missing(Path::new(path), text).len();
    assert_eq!(wrong("src/scene/plan.rs", "/// See docs/theory/march.md, Compositing."), 0, "a page that is there");
    assert_eq!(wrong("src/scene/plan.rs", "/// See NOTES.md A4."), 1, "a page outside");
    assert_eq!(
        wrong("docs/CLI.md", "[a](VIEW.md) [b](https://example.org/x.md#y) [c](#d)"),
        0,
        "addresses and anchors"
    );
    assert_eq!(wrong("docs/CLI.md", "[a](nowhere.png)"), 1, "a link to nothing");
}
