//! `relume shaders`: the compiled default variants in `spirv/`.

use std::path::PathBuf;

use serde_json::json;

use relume::output::write_atomically;
use relume::render::default_variants;

use super::{CliError, Report};

/// `relume shaders`
#[derive(Debug, clap::Args)]
#[group(skip)]
#[command(group(clap::ArgGroup::new("what").required(true).args(["write", "check"])))]
pub(crate) struct Args {
    /// Compile them and write them.
    #[arg(long)]
    write: bool,
    /// Compile them and compare, byte for byte.
    #[arg(long)]
    check: bool,
    /// Where they are.
    #[arg(long, default_value = "spirv", value_name = "FOLDER")]
    folder: PathBuf,
}

pub(crate) fn run(args: &Args) -> Result<Report, CliError> {
    let mut names = Vec::new();
    for (name, shader) in default_variants()? {
        let path = args.folder.join(format!("{name}.spv"));
        let bytes: Vec<u8> = shader.words.iter().flat_map(|word| word.to_le_bytes()).collect();
        if args.write {
            write_atomically(&path, |file| file.write_all(&bytes))?;
        } else {
            let committed = std::fs::read(&path)
                .map_err(|error| CliError::Failed(format!("cannot read {}: {error}", path.display())))?;
            if committed != bytes {
                let message =
                    format!("{} is not what shaders/ compiles to; run `relume shaders --write`", path.display());
                return Err(CliError::Failed(message));
            }
        }
        names.push(path.display().to_string());
    }
    let done = if args.write { "wrote" } else { "checked" };
    Ok(Report { text: format!("{done} {}\n", names.join(", ")), json: json!({ "done": done, "files": names }) })
}
