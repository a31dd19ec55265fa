//! `relume shaders`: the compiled default variants in `spirv/`.

use std::path::PathBuf;

use serde_json::json;

use crate::document::{SceneOptions, load_embedded, load_peer};
use crate::output::write_atomically;
use crate::plan::plan;
use crate::progress::Progress;
use crate::render::shaders_of;
use crate::scene::{Scene, Shading};
use crate::shader::Shader;

use super::{CliError, Report};

/// Arguments of `relume shaders`.
#[derive(Debug, clap::Args)]
#[group(skip)]
#[command(group(clap::ArgGroup::new("what").required(true).args(["write", "check"])))]
pub(crate) struct Args {
    /// Compile and write the shaders.
    #[arg(long)]
    write: bool,
    /// Compile the shaders and compare them with the files, byte by byte.
    #[arg(long)]
    check: bool,
    /// Folder of the compiled shaders.
    #[arg(long, default_value = "spirv", value_name = "FOLDER")]
    folder: PathBuf,
}

/// Shaders of the embedded scene, and of the benchmark scene for comparisons with other renderers, shaded and unshaded.
fn variants(progress: &dyn Progress) -> Result<Vec<(String, Shader)>, CliError> {
    let options = SceneOptions::default();
    let peer = load_peer(&options, progress)?.scene;
    let unshaded = Scene { shading: Shading::None, ..peer.clone() };
    let scenes = [("default", load_embedded(&options, progress)?.scene), ("peer", peer), ("peer_unshaded", unshaded)];
    let mut variants = Vec::new();
    for (name, scene) in scenes {
        for (stage, shader) in shaders_of(&plan(&scene, &crate::progress::Quiet)?.plan)? {
            variants.push((format!("{name}_{stage}"), shader));
        }
    }
    Ok(variants)
}

pub(crate) fn run(args: &Args, progress: &dyn Progress) -> Result<Report, CliError> {
    let mut names = Vec::new();
    for (name, shader) in variants(progress)? {
        let path = args.folder.join(format!("{name}.spv"));
        let bytes: Vec<u8> = shader.words().iter().flat_map(|word| word.to_le_bytes()).collect();
        if args.write {
            write_atomically(&path, |file| file.write_all(&bytes))?;
        } else {
            let committed = std::fs::read(&path)
                .map_err(|error| CliError::Failed(format!("cannot read {}: {error}", path.display())))?;
            if committed != bytes {
                let message =
                    format!("{} differs from the output of shaders/; run `relume shaders --write`", path.display());
                return Err(CliError::Failed(message));
            }
        }
        names.push(path.display().to_string());
    }
    let done = if args.write { "wrote" } else { "checked" };
    Ok(Report { text: format!("{done} {}\n", names.join(", ")), json: json!({ "done": done, "files": names }) })
}
