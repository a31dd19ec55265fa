//! Completions and manual pages of the command line.

use crate::support;
use support::program::Folder;

#[test]
fn completions_know_the_commands_and_their_flags() {
    let folder = Folder::new();
    for shell in ["bash", "elvish", "fish", "powershell", "zsh"] {
        let script = folder.done(&["completions", shell]).out;
        for word in ["relume", "relight", "accumulators", "save-scene", "tolerance"] {
            assert!(script.contains(word), "{shell}: {word}");
        }
        let json = folder.done(&["completions", shell, "--json"]).json();
        assert_eq!(json["script"].as_str().unwrap(), script, "{shell}");
    }
    folder.refused(2, &["completions", "tcsh"], &["tcsh", "bash", "zsh"]);
}

#[test]
fn there_is_a_manual_page_of_each_command() {
    let folder = Folder::new();
    folder.done(&["man", "-o", "man"]);
    let page = |name: &str| std::fs::read_to_string(folder.path("man").join(name)).unwrap();
    assert!(page("relume.1").contains("relume\\-render(1)") && page("relume.1").contains("relume\\-page(1)"));
    assert!(page("relume-render.1").contains("\\-\\-accumulators"));
    let json = folder.done(&["man", "-o", "man", "--json"]).json();
    let outputs = json["outputs"].as_array().unwrap();
    assert!(outputs.len() > 15, "{outputs:?}");
    let blocked = folder.with("file", "no folder");
    blocked.refused(1, &["man", "-o", "file"], &["file"]);
}
