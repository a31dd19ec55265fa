//! The commands of README.md and of docs/tutorial run, on small volumes with the names of the pages.
//!
//! A page marks a fenced block in the line above it, in a comment that readers do not see:
//! `<!-- tests skip: curl, relume view -->` skips the commands that begin with one of these texts, and
//! `<!-- tests add: -D accuracy.step=3 -->` adds arguments that save time. All other lines of `sh` blocks are commands of
//! Relume and must succeed. A `toml` block that begins with a file name (`# cells.toml`) is that file.
#![cfg(unix)]

use crate::support;

use std::path::Path;
use std::process::{Command, Stdio};

use support::program::{Folder, Outcome};

/// A fenced block of a page.
struct Block<'a> {
    language: &'a str,
    /// The line above it.
    above: &'a str,
    /// Number of its first line, from 1.
    first: usize,
    lines: &'a [&'a str],
}

impl<'a> Block<'a> {
    /// Blocks of a page.
    fn of(lines: &'a [&'a str]) -> Result<Vec<Self>, String> {
        let fences: Vec<usize> = (0..lines.len()).filter(|&at| lines[at].starts_with("```")).collect();
        if fences.len() % 2 == 1 {
            return Err("a fenced block has no end".to_owned());
        }
        let block = |fence: &[usize]| {
            let (open, close) = (fence[0], fence[1]);
            let above = open.checked_sub(1).map_or("", |above| lines[above]);
            Self { language: &lines[open][3..], above, first: open + 2, lines: &lines[open + 1..close] }
        };
        Ok(fences.chunks_exact(2).map(block).collect())
    }

    /// Text of the marker `what`; empty without one.
    fn marker(&self, what: &str) -> &'a str {
        let marker = self.above.strip_prefix("<!-- tests ").and_then(|rest| rest.strip_suffix(" -->"));
        marker.and_then(|rest| rest.strip_prefix(what)?.strip_prefix(": ")).unwrap_or_default()
    }

    /// Name of the file that a `toml` block is.
    fn file(&self) -> Option<&'a str> {
        let name = self.lines.first()?.strip_prefix("# ")?;
        (self.language == "toml" && name.ends_with(".toml") && !name.contains(' ')).then_some(name)
    }
}

/// Files that a command writes, by its flags.
fn outputs(command: &str) -> Vec<String> {
    let words: Vec<&str> = command.split_whitespace().collect();
    let named = words.windows(2).filter(|pair| ["-o", "--accumulators", "--save-scene", "--report"].contains(&pair[0]));
    let mut files: Vec<String> = named.map(|pair| pair[1].to_owned()).collect();
    match words[..] {
        ["relume", "convert", _, output, ..] => files.push(output.to_owned()),
        ["relume", "render", volume, ..] if files.is_empty() => {
            files.push(Path::new(volume).with_extension("png").to_str().unwrap().to_owned());
        }
        _ => {}
    }
    files
}

/// Runs one command in `folder`.
fn run(folder: &Folder, command: &str) -> Result<(), String> {
    let files = outputs(command);
    if let Some(file) = files.iter().find(|file| folder.path(file).exists()) {
        return Err(format!("{file} is there already, so the command proves nothing"));
    }
    let program = Path::new(env!("CARGO_BIN_EXE_relume")).parent().unwrap().to_str().unwrap();
    let path = format!("{program}:{}", std::env::var("PATH").unwrap_or_default());
    let mut shell = Command::new("sh");
    shell.args(["-c", command]).current_dir(folder.path("")).stdin(Stdio::null());
    let outcome = Outcome::of(shell.env("PATH", path).env("XDG_CACHE_HOME", folder.path("cache")));
    if outcome.code != Some(0) {
        return Err(format!("{:?}: {}", outcome.code, outcome.err));
    }
    for file in files {
        if !std::fs::metadata(folder.path(&file)).is_ok_and(|found| found.len() > 0) {
            return Err(format!("{file} is missing or empty; {}", outcome.out));
        }
    }
    Ok(())
}

/// Runs the commands of a page in `folder`, beside the folder `data` of the repository. Returns their number, or the first
/// failure with its line.
fn check(folder: &Folder, text: &str) -> Result<usize, String> {
    std::os::unix::fs::symlink(Path::new(env!("CARGO_MANIFEST_DIR")).join("data"), folder.path("data")).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    let mut ran = 0;
    for block in Block::of(&lines)? {
        if let Some(name) = block.file() {
            std::fs::write(folder.path(name), block.lines.join("\n")).unwrap();
        }
        if block.language != "sh" {
            continue;
        }
        let skipped: Vec<&str> = block.marker("skip").split(", ").filter(|start| !start.is_empty()).collect();
        if let Some(stale) = skipped.iter().find(|start| !block.lines.iter().any(|line| line.starts_with(**start))) {
            return Err(format!("line {}: no command begins with {stale:?}", block.first));
        }
        for (at, line) in block.lines.iter().enumerate() {
            if skipped.iter().any(|start| line.starts_with(start)) {
                continue;
            }
            let told = |message: String| format!("line {}: {line}: {message}", block.first + at);
            let command = line.split(" #").next().unwrap_or(line).trim_end();
            if !command.starts_with("relume ") {
                return Err(told("neither a command of Relume nor marked to be skipped".to_owned()));
            }
            run(folder, format!("{command} {}", block.marker("add")).trim_end()).map_err(told)?;
            ran += 1;
        }
    }
    Ok(ran)
}

/// Nested ellipsoids in a box, at 95, 80, 50 and 25 % of it: `inside` from the outermost to the core. x fastest.
fn body([nx, ny, nz]: [usize; 3], outside: i16, inside: [i16; 4]) -> Vec<i16> {
    // Square of the distance from the middle, in ten-thousandths of half the box.
    let part = |index: usize, size: usize| 10_000 * (2 * index + 1).abs_diff(size).pow(2) / (size * size);
    let mut voxels = Vec::with_capacity(nx * ny * nz);
    for z in 0..nz {
        for y in 0..ny {
            for x in 0..nx {
                voxels.push(match part(x, nx) + part(y, ny) + part(z, nz) {
                    0..625 => inside[3],
                    625..2500 => inside[2],
                    2500..6400 => inside[1],
                    6400..9025 => inside[0],
                    _ => outside,
                });
            }
        }
    }
    voxels
}

/// A body in Hounsfield units: air, skin, flesh and a core of bone.
fn ct(dims: [usize; 3]) -> Vec<u8> {
    body(dims, -1000, [-250, 60, 60, 900]).into_iter().flat_map(i16::to_le_bytes).collect()
}

/// A `MetaImage` file.
fn metaimage([nx, ny, nz]: [usize; 3], kind: &str, voxels: &[u8]) -> Vec<u8> {
    let header = format!("NDims = 3\nDimSize = {nx} {ny} {nz}\nElementType = {kind}\nElementDataFile = LOCAL\n");
    [header.as_bytes(), voxels].concat()
}

/// The chest of the tutorial: 0 to 255, in the dimensions of its scene's crop box.
fn chest() -> Vec<u8> {
    let dims = [256, 256, 133];
    let voxels = body(dims, 0, [20, 70, 125, 220]).into_iter().map(|value| u8::try_from(value).unwrap());
    metaimage(dims, "MET_UCHAR", &voxels.collect::<Vec<u8>>())
}

/// A folder with the CT as `name`, of the format by its ending.
fn with_scan(folder: Folder, name: &str) -> Folder {
    let dims = [64, 64, 48];
    let folder = folder.with("body.mha", metaimage(dims, "MET_SHORT", &ct(dims)));
    folder.done(&["convert", "body.mha", name]);
    folder
}

/// An OME-TIFF of two channels.
fn ome_tiff() -> Vec<u8> {
    let [nx, ny, nz] = [48_u32, 48, 20];
    let dims = [nx, ny, nz].map(|size| usize::try_from(size).unwrap());
    let description = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?><OME xmlns=\"http://www.openmicroscopy.org/Schemas/OME/2016-06\">\
         <Image ID=\"Image:0\"><Pixels ID=\"Pixels:0\" DimensionOrder=\"XYZCT\" Type=\"uint16\" SizeX=\"{nx}\" \
         SizeY=\"{ny}\" SizeZ=\"{nz}\" SizeC=\"2\" SizeT=\"1\" PhysicalSizeX=\"0.25\" PhysicalSizeY=\"0.25\" \
         PhysicalSizeZ=\"0.6\"><Channel ID=\"Channel:0:0\" Name=\"nuclei\" SamplesPerPixel=\"1\"/>\
         <Channel ID=\"Channel:0:1\" Name=\"membranes\" SamplesPerPixel=\"1\"/><TiffData IFD=\"0\" \
         PlaneCount=\"{}\"/></Pixels></Image></OME>",
        2 * nz
    );
    let channels = [[60, 60, 400, 3000], [60, 1800, 60, 60]].map(|inside| body(dims, 50, inside));
    let values: Vec<u16> = channels.concat().into_iter().map(|value| u16::try_from(value).unwrap()).collect();
    // A header, the description, the planes, and then a directory a page.
    let mut bytes = b"II*\0\0\0\0\0".to_vec();
    let offset = |bytes: &[u8]| u32::try_from(bytes.len()).unwrap();
    bytes.extend(description.bytes().chain([0]));
    let planes: Vec<u32> = values
        .chunks_exact(dims[0] * dims[1])
        .map(|plane| {
            let start = offset(&bytes);
            bytes.extend(plane.iter().flat_map(|value| value.to_le_bytes()));
            start
        })
        .collect();
    // Position of the offset of the next directory.
    let mut next = 4;
    for (page, plane) in planes.into_iter().enumerate() {
        let start = offset(&bytes);
        bytes[next..next + 4].copy_from_slice(&start.to_le_bytes());
        let described = (270, 2, u32::try_from(description.len() + 1).unwrap(), 8);
        // Tag, type (2 text, 4 number of 32 bits), count and value: width, height, bits, compression, photometric
        // interpretation, strip, samples, rows and bytes of the strip.
        let tags = [(256, 4, 1, nx), (257, 4, 1, ny), (258, 4, 1, 16), (259, 4, 1, 1), (262, 4, 1, 1)];
        let strip = [(273, 4, 1, plane), (277, 4, 1, 1), (278, 4, 1, ny), (279, 4, 1, 2 * nx * ny)];
        let tags: Vec<(u16, u16, u32, u32)> =
            tags.into_iter().chain((page == 0).then_some(described)).chain(strip).collect();
        bytes.extend(u16::try_from(tags.len()).unwrap().to_le_bytes());
        for (tag, kind, count, value) in tags {
            bytes.extend([tag.to_le_bytes(), kind.to_le_bytes()].concat());
            bytes.extend([count.to_le_bytes(), value.to_le_bytes()].concat());
        }
        next = bytes.len();
        bytes.extend([0; 4]);
    }
    bytes
}

/// Text of a page of the repository.
fn page(name: &str) -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(name)).unwrap()
}

/// Runs a page; `commands` is the least number of commands that it has.
fn runs(folder: &Folder, name: &str, commands: usize) {
    match check(folder, &page(name)) {
        Ok(ran) => assert!(ran >= commands, "{name}: {ran} commands ran"),
        Err(failure) => panic!("{name}, {failure}"),
    }
}

#[test]
fn the_readme_leads_from_a_scan_to_three_lights_and_from_a_volume_to_its_pictures() {
    let folder = with_scan(Folder::new().with("LIDC2.mha", chest()), "scan.nrrd");
    runs(&folder, "README.md", 11);
    let pictures = ["day.png", "organs.png", "bone.png"].map(|name| std::fs::read(folder.path(name)).unwrap());
    assert!(pictures[0] != pictures[1] && pictures[1] != pictures[2] && pictures[0] != pictures[2], "three lights");
}

#[test]
fn a_first_ct_is_converted_shown_changed_relit_and_turned() {
    let folder = Folder::new().with("matrix.dat", ct([256, 256, 108]));
    runs(&folder, "docs/tutorial/first-ct.md", 12);
}

#[test]
fn the_chest_is_designed_merged_revealed_and_shared() {
    runs(&Folder::new().with("LIDC2.mha", chest()), "docs/tutorial/chest.md", 9);
}

#[test]
fn channels_of_a_stack_are_shown_from_one_place() {
    let folder = Folder::new().with("cells.ome.tif", ome_tiff());
    runs(&folder, "docs/tutorial/microscopy.md", 17);
    let pictures = ["nuclei.png", "membranes.png"].map(|name| std::fs::read(folder.path(name)).unwrap());
    assert!(pictures[0] != pictures[1], "two channels");
}

#[test]
fn a_preset_of_slicer_is_a_scene() {
    runs(&with_scan(Folder::new(), "scan.nii.gz"), "docs/tutorial/from-paraview-and-slicer.md", 6);
}

#[test]
fn an_error_is_asked_for_found_and_told() {
    runs(&Folder::new(), "docs/tutorial/error.md", 6);
}

#[test]
fn every_tutorial_has_a_test() {
    let tested = page("tests/program/tutorials.rs");
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/tutorial");
    let names = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let pages: Vec<String> = names.filter(|name| name.ends_with(".md") && name != "README.md").collect();
    assert!(pages.len() >= 5, "{pages:?}");
    for name in pages {
        assert!(tested.contains(&format!("\"docs/tutorial/{name}\"")), "{name} has no test");
    }
}

#[test]
fn a_wrong_page_is_caught() {
    let failure = |text: &str| check(&Folder::new(), text).unwrap_err();
    let scene = "relume render scene.toml --size 8x8";
    assert_eq!(check(&Folder::new(), &format!("```sh\n{scene} -o a.png   # a comment\n```\n")), Ok(1));
    assert!(failure(&format!("```sh\n{scene} -o a.png\n")).contains("no end"), "an open block");
    assert!(failure("text\n```sh\nrelume render nowhere.toml -o a.png\n```\n").starts_with("line 3"), "a failure");
    assert!(failure(&format!("```sh\n{scene} -o a.png\n{scene} -o a.png\n```\n")).contains("already"), "no new file");
    assert!(failure("```sh\ncurl -O x\n```\n").contains("neither"), "a command that nobody marked");
    assert!(failure("<!-- tests skip: curl -->\n```sh\n```\n").contains("begins with"), "a stale marker");
    let added = format!("<!-- tests add: --size 8x8 -->\n```sh\n{scene} -o a.png\n```\n");
    assert!(failure(&added).contains("--size"), "arguments are added");
}
