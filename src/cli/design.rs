//! `relume design`: solves a palette for spectra with its target colours.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::document::design::BACKGROUND;
use crate::document::{Source, session};
use crate::measure::Stopwatch;
use crate::output::page::escaped;
use crate::output::{write_atomically, write_drawing};
use crate::palette::{self, Facts, Member, Palette, SmoothCost, Smoothing, Solution};
use crate::progress::Progress;
use crate::spectrum::Spectrum;
use crate::spectrum::colour::{Xyz, d65_white, display_code, is_displayable, lab_from_xyz, linear_srgb_from_xyz};
use crate::spectrum::deficiency::Deficiency;

use super::page::{frame, patches_page};
use super::{CliError, Report, files};

const EXAMPLES: &str = "\
Examples:
  relume design palette.toml                          the reached colours, and the targets in conflict
  relume design palette.toml -o solved.toml --report palette.html
  relume design palette.toml --compare-smoothness     what smoother spectra cost
  relume design palette.toml --smoothness smoother -o solved.toml
  relume design wider.toml --start solved.toml        with wider bounds, not worse than before
  relume design edited.toml --save-scene solved.toml  a scene whose [palette.cells] were edited, with new spectra

The keys of a palette file are in docs/PALETTE.md; a scene takes its spectra from one with [palette] use = \"FILE\".";

/// Arguments of `relume design`.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// Palette file (TOML), or a scene with a [palette]: target colours of materials under lights, and the open
    /// spectra.
    palette: PathBuf,
    /// Write a palette file with all solved spectra.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Write the scene with the solved spectra in place of those that it has: for a scene with a [palette].
    #[arg(long, value_name = "FILE.toml")]
    save_scene: Option<PathBuf>,
    /// Start the search from the spectra of this palette file too, such as -o writes: a result within the same or wider bounds,
    /// and not smoother, is not worse.
    #[arg(long, value_name = "FILE")]
    start: Option<PathBuf>,
    /// Draw a report: matrix of colours, spectra, and contrasts by colour vision (.html, .svg or .png; repeatable).
    #[arg(long, value_name = "FILE")]
    report: Vec<PathBuf>,
    /// Smoothness of every open spectrum, in place of the palette's own: smooth (0.001), smoother (0.01), smoothest (0.1)
    /// or a number. Smoother spectra reach their targets less exactly.
    #[arg(long, value_name = "NAME|NUMBER", value_parser = smoothness)]
    smoothness: Option<f64>,
    /// Print the largest ΔE00 of the presets of --smoothness. Without this flag, they are printed only if a colour leans
    /// on the edge of the visible range.
    #[arg(long)]
    compare_smoothness: bool,
}

/// Parses a preset or a number.
fn smoothness(text: &str) -> Result<f64, String> {
    if let Some(preset) = Smoothing::ALL.into_iter().find(|preset| preset.name() == text) {
        return Ok(preset.smoothness());
    }
    let number = text.parse().ok().filter(|number: &f64| (1e-12..=1e6).contains(number));
    number.ok_or_else(|| "it must be smooth, smoother, smoothest, or a number from 1e-12 to 1000000".to_owned())
}

/// Kind of a report.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Html,
    Svg,
    Png,
}

fn kind(path: &Path) -> Result<Kind, CliError> {
    match path.extension().and_then(|extension| extension.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("html" | "htm") => Ok(Kind::Html),
        Some("svg") => Ok(Kind::Svg),
        Some("png") => Ok(Kind::Png),
        _ => Err(CliError::Usage(format!(
            "{}: unknown kind of report; end its name in .html, .svg or .png",
            path.display()
        ))),
    }
}

/// Warns of lights with spectra in the scene `text` that its palette does not have, where it has lights that are new to the
/// scene: most likely they were renamed.
fn warn_of_old_lights(scene: &Path, text: &str, palette: &Palette) {
    let table: toml::Table = text.parse().unwrap_or_default();
    let Some(lights) = table.get("lights").and_then(toml::Value::as_table) else { return };
    let named = |name: &str| palette.lights.iter().any(|light| light.name == name);
    let has_new = palette.lights.iter().any(|light| !lights.contains_key(&light.name));
    let old: Vec<&str> = lights.keys().map(String::as_str).filter(|name| !named(name)).collect();
    if has_new && !old.is_empty() {
        tracing::warn!(
            "{}: [palette.lights] does not have {}: what [lights] has and the palette does not keeps its spectrum; remove its table \
             if the palette replaces it",
            scene.display(),
            old.join(", ")
        );
    }
}

/// Refuses materials of intervals and labels that neither the scene `table` nor its palette has, and warns of materials of the
/// palette that nothing shows: most likely they were renamed in one place alone.
fn check_materials(scene: &Path, table: &toml::Table, palette: &Palette) -> Result<(), CliError> {
    let mut shown = Vec::new();
    for list in ["transfer", "labels", "volumes"] {
        names_of_materials(table.get(list), false, &mut shown);
    }
    let rows = || palette.materials.iter().map(|row| row.name.as_str());
    let own =
        table.get("materials").and_then(toml::Value::as_table).into_iter().flatten().map(|(name, _)| name.as_str());
    let all: Vec<&str> = own.chain(rows()).collect();
    if let Some(missing) = shown.iter().find(|name| !all.contains(name)) {
        let scene = scene.display();
        return Err(CliError::Failed(format!(
            "{scene}: an interval or a label has the material {missing}, which neither [palette.materials] nor [materials] has"
        )));
    }
    let unshown: Vec<&str> = rows().filter(|name| *name != BACKGROUND && !shown.contains(name)).collect();
    if !shown.is_empty() && !unshown.is_empty() {
        tracing::warn!(
            "{}: no interval and no label has the material {}; a material that is renamed in [palette] has the new name in \
             [transfer] or [labels] and in [materials] too",
            scene.display(),
            unshown.join(" or ")
        );
    }
    Ok(())
}

/// Adds the names in the values of all keys `material` of a part of a scene; of the part itself if `is_material`.
fn names_of_materials<'a>(part: Option<&'a toml::Value>, is_material: bool, found: &mut Vec<&'a str>) {
    match part {
        Some(toml::Value::String(name)) if is_material => found.push(name),
        Some(toml::Value::Array(parts)) => parts.iter().for_each(|it| names_of_materials(Some(it), is_material, found)),
        Some(toml::Value::Table(parts)) => {
            parts.iter().for_each(|(key, it)| {
                names_of_materials(Some(it), is_material || key == "material" || key == "materials", found);
            });
        }
        _ => {}
    }
}

/// Reads the palette `path`, from whose spectra the search for those of `palette` starts; warns if it lacks some.
fn start(path: &Path, palette: &Palette) -> Result<Palette, CliError> {
    let wanted = "--start takes a palette file with spectra of the same names, which relume design -o writes";
    let path_shown = path.display();
    if Source::of(path).bare_volume().is_some() {
        return Err(CliError::Usage(format!("{path_shown} is a volume; {wanted}")));
    }
    let start = palette::load(path)?;
    let missing = palette.without_start(&start);
    let open = palette.materials.iter().chain(&palette.lights).filter(|member| member.spectrum.is_none()).count();
    if missing.len() == open {
        return Err(CliError::Usage(format!("{path_shown} has no spectrum for {}; {wanted}", missing.join(", "))));
    }
    if !missing.is_empty() {
        tracing::warn!("--start {path_shown} has no spectrum for {}", missing.join(", "));
    }
    Ok(start)
}

pub(crate) fn run(args: &Args, progress: &dyn Progress) -> Result<Report, CliError> {
    let reports = args.report.iter().map(|path| Ok((path, kind(path)?))).collect::<Result<Vec<_>, CliError>>()?;
    if Source::of(&args.palette).bare_volume().is_some() {
        return Err(CliError::Usage(format!(
            "{0} is a volume: design solves a palette file, or a scene with a [palette], such as relume render {0} \
             --save-scene scene.toml writes",
            args.palette.display()
        )));
    }
    let stated = palette::load(&args.palette)?;
    let palette = args.smoothness.map_or_else(|| stated.clone(), |smoothness| stated.smoothed(smoothness));
    let untargeted = palette.without_target();
    if !untargeted.is_empty() {
        tracing::warn!(
            "{}: no cell has a target for {}, so any spectrum will do",
            args.palette.display(),
            untargeted.join(", ")
        );
    }
    let start = args.start.as_deref().map(|path| start(path, &palette)).transpose()?;
    let outputs: Vec<&PathBuf> = args.output.iter().chain(&args.save_scene).chain(&args.report).collect();
    let inputs = palette.inputs.iter().chain([&args.palette]).chain(&args.start).map(PathBuf::as_path);
    let inputs: Vec<&Path> = inputs.collect();
    files::check_outputs(&outputs, &inputs)?;
    let scene_text = std::fs::read_to_string(&args.palette).unwrap_or_default();
    let scene: Option<toml::Table> =
        scene_text.parse().ok().filter(|table: &toml::Table| table.contains_key("palette"));
    if args.save_scene.is_some() && scene.is_none() {
        let palette = args.palette.display();
        return Err(CliError::Usage(format!(
            "--save-scene is for a scene with a [palette], and {palette} is a palette; use -o"
        )));
    }
    if let Some(table) = &scene {
        check_materials(&args.palette, table, &palette)?;
    }
    let clock = Stopwatch::start();
    let solution = match &start {
        Some(start) => palette::solve_from(&palette, start, progress)?,
        None => palette::solve(&palette, progress)?,
    };
    let times = clock.read();
    // Before any file is written, because it may be cancelled.
    let smoother = if args.compare_smoothness || !solution.edges().is_empty() {
        palette::smoother(&solution.palette, progress)?
    } else {
        Vec::new()
    };
    if let Some(path) = &args.output {
        write_text(path, &solution.to_toml())?;
    }
    if let Some(path) = &args.save_scene {
        let scene = session::solved_text(path, &args.palette, &scene_text, &solution)
            .map_err(|error| CliError::Failed(format!("--save-scene {}: {error}", path.display())))?;
        write_text(path, &scene)?;
        warn_of_old_lights(&args.palette, &scene_text, &solution.palette);
    } else if let Some(names) = scene.as_ref().and_then(|scene| with_own_spectra(scene, &solution.palette)) {
        tracing::warn!(
            "{} has spectra of its own for {names}, and its pictures show those; --save-scene FILE.toml writes the scene \
             with the spectra that were solved here",
            args.palette.display()
        );
    }
    for (path, kind) in reports {
        let svg = solution.to_svg();
        match kind {
            Kind::Svg => write_text(path, &svg)?,
            Kind::Png => {
                const PIXELS: f32 = 1.5;
                if !write_drawing(path, &svg, PIXELS)? {
                    tracing::warn!(
                        "{}: this system has no fonts, so the picture has no text; write .svg or .html for text",
                        path.display()
                    );
                }
            }
            Kind::Html => write_text(path, &html(&solution, &svg, progress)?)?,
        }
    }
    let written: Vec<String> = outputs.iter().map(|path| path.display().to_string()).collect();
    let mut text = text(&solution);
    text.push_str(&edge_text(&solution));
    text.push_str(&smoother_text(&smoother, args.compare_smoothness));
    text.push_str(&format!("solved in {:.2} s\n", times.wall_ms / 1e3));
    if !written.is_empty() {
        text.push_str(&format!("wrote {}\n", written.join(", ")));
    }
    let mut json = json(&solution);
    json["outputs"] = json!(written);
    let palette = &solution.palette;
    json["edges"] = solution
        .edges()
        .iter()
        .map(|edge| {
            json!({
                "material": palette.materials[edge.material].name,
                "light": palette.lights[edge.light].name,
                "below_410_nm": edge.shares[0],
                "above_690_nm": edge.shares[1],
            })
        })
        .collect();
    json["smoother"] = smoother
        .iter()
        .map(|one| {
            json!({
                "name": one.smoothing.name(),
                "smoothness": one.smoothing.smoothness(),
                "worst": one.worst,
                "edge": one.edge,
            })
        })
        .collect();
    json["times"] = json!({ "solve": times });
    Ok(Report { text, json })
}

/// HTML of the report: the drawing, and the materials under any light.
fn html(solution: &Solution, svg: &str, progress: &dyn Progress) -> Result<String, CliError> {
    let palette = &solution.palette;
    let materials = palette.materials.iter().map(|member| member.name.as_str()).zip(&solution.materials);
    let lights = palette.lights.iter().map(|member| member.name.as_str()).zip(&solution.lights);
    let page = patches_page(&materials.collect::<Vec<_>>(), &lights.collect::<Vec<_>>(), progress)?;
    let names: Vec<String> =
        palette.materials.iter().map(|member| format!("<bdi>{}</bdi>", escaped(&member.name))).collect();
    let frame = frame(&page, "The materials under any light");
    Ok(format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width\">\n\
         <title>Palette</title>\n</head>\n<body style=\"margin: 0\">\n{svg}\
         <section style=\"font: 15px/1.5 system-ui, sans-serif; max-width: 1000px; padding: 24px\">\n<h2>Under any light</h2>\n\
         <p>The materials as squares, row by row: {}. Switch, mix and exchange their lights; a click on a square shows its spectrum.</p>\n\
         {frame}</section>\n</body>\n</html>\n",
        names.join(", ")
    ))
}

/// Names of the open materials and lights of `palette` whose spectra `scene` states.
fn with_own_spectra(scene: &toml::Table, palette: &Palette) -> Option<String> {
    let of = |list: &str, key: &str, members: &[Member]| -> Vec<String> {
        let member = |name: &str| scene.get(list).and_then(|all| all.get(name)).and_then(|it| it.get(key));
        let open = members.iter().filter(|it| it.spectrum.is_none() && member(&it.name).is_some());
        open.map(|it| it.name.clone()).collect()
    };
    let names =
        [of("materials", "reflectance", &palette.materials), of("lights", "spectrum", &palette.lights)].concat();
    (!names.is_empty()).then(|| names.join(", "))
}

fn percent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share)
}

/// Says which colours lean on the ends of the visible range.
fn edge_text(solution: &Solution) -> String {
    let mut text = String::new();
    for edge in solution.edges() {
        text.push_str(&format!(
            "{} under {} leans on the edge of the visible range: {} of its colour comes from below 410 nm, {} from above 690 nm.\n",
            solution.palette.materials[edge.material].name,
            solution.palette.lights[edge.light].name,
            percent(edge.shares[0]),
            percent(edge.shares[1])
        ));
    }
    text
}

/// Says what smoother spectra cost; `asked` also if nothing is smoother.
fn smoother_text(smoother: &[SmoothCost], asked: bool) -> String {
    let mut text = match (smoother.is_empty(), asked) {
        (true, false) => return String::new(),
        (true, true) => "No preset is smoother than the open spectra of this palette.\n".to_owned(),
        (false, _) => "Smoother spectra, with this `smoothness` for every open one (--smoothness NAME):\n".to_owned(),
    };
    for one in smoother {
        let edge = if one.edge > 0.0 { format!("up to {}", percent(one.edge)) } else { "below 25 %".to_owned() };
        text.push_str(&format!(
            "  {:<9} smoothness = {}: largest ΔE00 {:.3}; from the edge {edge}\n",
            one.smoothing.name(),
            one.smoothing.smoothness(),
            one.worst
        ));
    }
    text
}

fn write_text(path: &Path, text: &str) -> Result<(), CliError> {
    Ok(write_atomically(path, |out| out.write_all(text.as_bytes()))?)
}

fn code(xyz: Xyz) -> String {
    display_code(linear_srgb_from_xyz(xyz))
}

/// The matrix of colours, the spectra and the verdicts as text.
fn text(solution: &Solution) -> String {
    let palette = &solution.palette;
    let mut table = vec![vec![String::new()]];
    table[0].extend(palette.lights.iter().map(|light| light.name.clone()));
    let mut beyond = false;
    for (row, material) in palette.materials.iter().enumerate() {
        let mut line = vec![material.name.clone()];
        for column in 0..palette.lights.len() {
            line.push(solution.cell(row, column).map_or_else(String::new, |cell| {
                let is_shown = is_displayable(linear_srgb_from_xyz(cell.xyz));
                beyond |= !is_shown;
                let difference = cell.difference.map_or_else(String::new, |difference| format!("  {difference:.3}"));
                let model = cell.shown.map_or_else(String::new, |(_, off)| format!(" (model off by {off:.3})"));
                let mark = if is_shown { "" } else { "!" };
                format!("{} → {}{mark}{difference}{model}", palette.target_text(row, column), code(cell.xyz))
            }));
        }
        table.push(line);
    }
    let mut text = format!(
        "{}: target colour of each material under each light → reached colour, and their ΔE00\n{}",
        palette.source,
        aligned(&table)
    );
    if beyond {
        text.push_str("! outside sRGB; the colour code is clipped\n");
    }
    text.push_str(&format!("The largest ΔE00 is {:.4}.\n\n", solution.worst()));
    let mut table = vec![["spectrum", "", "lowest", "highest", "at bounds", "negative"].map(str::to_owned).to_vec()];
    let sides = [
        (&palette.materials, &solution.material_facts, "material"),
        (&palette.lights, &solution.light_facts, "light, mean 1"),
    ];
    for (members, facts, what) in sides {
        for (member, facts) in members.iter().zip(facts) {
            table.push(facts_line(member, facts, what));
        }
    }
    text.push_str(&aligned(&table));
    let sentences = solution.sentences();
    if !sentences.is_empty() {
        text.push_str(&format!("\n{}\n", sentences.join("\n")));
    }
    text
}

fn facts_line(member: &Member, facts: &Facts, what: &str) -> Vec<String> {
    vec![
        member.name.clone(),
        format!("{what}, {}", if facts.open { "open" } else { "given" }),
        format!("{:.3}", facts.lowest),
        format!("{:.3}", facts.highest),
        if facts.open { format!("{} low, {} high", facts.at_low, facts.at_high) } else { String::new() },
        if facts.negative > 0.0 { format!("{:.1} %", 100.0 * facts.negative) } else { String::new() },
    ]
}

/// Formats columns as wide as their widest entry.
fn aligned(table: &[Vec<String>]) -> String {
    let width = |column: usize| {
        table.iter().filter_map(|line| line.get(column)).map(|entry| entry.chars().count()).max().unwrap_or(0)
    };
    let line = |line: &Vec<String>| {
        let entries: Vec<String> =
            line.iter().enumerate().map(|(column, entry)| format!("{entry:<width$}", width = width(column))).collect();
        format!("{}\n", entries.join("  ").trim_end())
    };
    table.iter().map(line).collect()
}

fn json(solution: &Solution) -> Value {
    let palette = &solution.palette;
    let colour = |xyz: Xyz| {
        let linear = linear_srgb_from_xyz(xyz);
        json!({
            "xyz": xyz.0,
            "lab": lab_from_xyz(xyz, d65_white()).0,
            "srgb": display_code(linear),
            "displayable": is_displayable(linear),
        })
    };
    let name = |material: usize, light: usize| json!({ "material": palette.materials[material].name, "light": palette.lights[light].name });
    let cells: Vec<Value> = solution
        .cells
        .iter()
        .map(|cell| {
            let mut value = name(cell.material, cell.light);
            value["target"] = json!(palette.target_text(cell.material, cell.light));
            value["wanted"] = json!(cell.target.map(colour));
            value["reached"] = colour(cell.xyz);
            value["delta_e"] = json!(cell.difference);
            value["model"] = json!(cell.shown.map(|(xyz, off)| json!({ "shown": colour(xyz), "delta_e": off })));
            value
        })
        .collect();
    let spectra = |members: &[Member], facts: &[Facts], spectra: Vec<&Spectrum>| -> Vec<Value> {
        let lines = members.iter().zip(facts).zip(spectra);
        lines
            .map(|((member, facts), spectrum)| {
                json!({
                    "name": member.name,
                    "open": facts.open,
                    "bounds": member.bounds,
                    "lowest": facts.lowest,
                    "highest": facts.highest,
                    "at_low": facts.at_low,
                    "at_high": facts.at_high,
                    "negative": facts.negative,
                    "samples": spectrum.samples().to_vec(),
                })
            })
            .collect()
    };
    let names =
        |cells: &[(usize, usize)]| -> Vec<Value> { cells.iter().map(|&(row, column)| name(row, column)).collect() };
    let contrasts: Vec<Value> = solution
        .contrasts()
        .iter()
        .map(|contrast| {
            let mut value = json!({
                "light": palette.lights[contrast.light].name,
                "materials": contrast.materials.map(|row| palette.materials[row].name.clone()),
                "all_cones": contrast.normal,
            });
            for (deficiency, difference) in Deficiency::ALL.iter().zip(contrast.deficient) {
                value[deficiency.to_string()] = json!(difference);
            }
            value
        })
        .collect();
    json!({
        "palette": palette.source,
        "worst": solution.worst(),
        "cells": cells,
        "materials": spectra(&palette.materials, &solution.material_facts, solution.materials.iter().map(|row| row.spectrum()).collect()),
        "lights": spectra(&palette.lights, &solution.light_facts, solution.lights.iter().map(|light| light.spectrum()).collect()),
        "conflicts": solution.conflicts.iter().map(|conflict| json!({
            "cells": names(&conflict.cells),
            "part": names(&conflict.part),
            "least": conflict.least,
            "reached": conflict.reached,
            "reason": conflict.reason,
            "ways_out": conflict.ways_out.iter().map(ToString::to_string).collect::<Vec<_>>(),
        })).collect::<Vec<_>>(),
        "dark_merges": solution.dark_merges.iter().map(|merge| json!({
            "cell": name(merge.cell.0, merge.cell.1),
            "like": name(merge.like.0, merge.like.1),
        })).collect::<Vec<_>>(),
        "contrasts": contrasts,
    })
}
