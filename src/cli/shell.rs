//! `relume completions` and `relume man`: the command line for shells and `man`.

use std::path::PathBuf;

use clap::CommandFactory as _;
use serde_json::json;

use super::{Cli, CliError, Report};

const EXAMPLES: &str = "\
Examples:
  relume completions bash > ~/.local/share/bash-completion/completions/relume
  relume completions zsh > ~/.zfunc/_relume
  relume completions fish > ~/.config/fish/completions/relume.fish";

/// Arguments of `relume completions`.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct CompletionsArgs {
    /// The shell.
    #[arg(value_name = "SHELL")]
    shell: clap_complete::Shell,
}

/// Arguments of `relume man`.
#[derive(Debug, clap::Args)]
pub(crate) struct ManArgs {
    /// Folder for `relume.1`, `relume-render.1` and so on.
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
}

pub(crate) fn completions(args: &CompletionsArgs) -> Report {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "relume", &mut script);
    let text = String::from_utf8_lossy(&script).into_owned();
    let json = json!({"shell": args.shell.to_string(), "script": text});
    Report { text, json }
}

pub(crate) fn man(args: &ManArgs) -> Result<Report, CliError> {
    let failed = |error: std::io::Error| CliError::Failed(format!("-o {}: {error}", args.output.display()));
    std::fs::create_dir_all(&args.output).map_err(failed)?;
    // `relume help` describes the others.
    clap_mangen::generate_to(Cli::command().disable_help_subcommand(true), &args.output).map_err(failed)?;
    let mut pages: Vec<String> = std::fs::read_dir(&args.output)
        .map_err(failed)?
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| name.starts_with("relume") && name.ends_with(".1"))
        .collect();
    pages.sort();
    let text = format!("wrote {} pages to {}\n", pages.len(), args.output.display());
    let outputs: Vec<String> = pages.iter().map(|page| args.output.join(page).display().to_string()).collect();
    Ok(Report { text, json: json!({"outputs": outputs}) })
}
