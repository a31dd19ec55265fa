//! Output files: their contents, and the folder after a failure.
#![expect(clippy::print_stderr, reason = "a test that ran on nothing says so")]

use crate::support;

use std::fs::{self, File};
use std::io::{self, Read};
use std::os::unix::fs::{FileTypeExt, PermissionsExt, symlink};
use std::path::Path;

use exr::prelude::*;
use glam::DVec3;
use relume::output::film::{Component, Components, Dial, DialPreset, Frame, Light, Node, Position};
use relume::output::{
    Alpha, BANDS, Depth, FilmFile, OutputError, Picture, display_codes, png_bytes, write_atomically, write_exr,
    write_png, write_ready_png, write_spectral,
};
use relume::scene::{Backdrop, Placement, Tone};
use relume::spectrum::observer::Observer;
use support::exr::damage;

// ---- atomic writes ----

/// Sorted names in a folder.
fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn put(path: &Path, content: &[u8]) -> std::result::Result<(), OutputError> {
    write_atomically(path, |sink| sink.write_all(content))
}

#[test]
fn a_failure_half_way_leaves_the_old_file_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("picture");
    put(&path, b"old").unwrap();
    let failed = write_atomically(&path, |sink| {
        sink.write_all(&vec![7; 300_000])?;
        Err(io::Error::other("the march stopped"))
    });
    assert!(matches!(failed, Err(OutputError::Write { .. })), "{failed:?}");
    assert_eq!((fs::read(&path).unwrap(), names(folder.path())), (b"old".to_vec(), vec!["picture".to_owned()]));
}

#[test]
fn a_replaced_file_keeps_its_permissions_and_a_new_one_gets_the_usual() {
    let folder = tempfile::tempdir().unwrap();
    let mode = |name: &str| fs::metadata(folder.path().join(name)).unwrap().permissions().mode() & 0o777;
    File::create(folder.path().join("usual")).unwrap();
    put(&folder.path().join("new"), b"new").unwrap();
    assert_eq!(mode("new"), mode("usual"));
    let path = folder.path().join("old");
    put(&path, b"old").unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
    put(&path, b"newer").unwrap();
    assert_eq!((mode("old"), fs::read(&path).unwrap()), (0o640, b"newer".to_vec()));
}

#[test]
fn a_symbolic_link_stays_and_its_target_changes() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::create_dir(at("deep")).unwrap();
    put(&at("deep/target"), b"old").unwrap();
    symlink("deep/target", at("inner")).unwrap();
    symlink("inner", at("outer")).unwrap();
    symlink("deep/absent", at("dangling")).unwrap();
    put(&at("outer"), b"new").unwrap();
    put(&at("dangling"), b"made").unwrap();
    assert!(["outer", "inner", "dangling"].iter().all(|name| at(name).is_symlink()));
    assert_eq!(
        (fs::read(at("deep/target")).unwrap(), fs::read(at("deep/absent")).unwrap()),
        (b"new".to_vec(), b"made".to_vec())
    );
    symlink("circle", at("circle")).unwrap();
    assert!(matches!(put(&at("circle"), b"x"), Err(OutputError::Write { .. })));
}

#[test]
fn a_full_device_says_that_it_is_full_and_stays_a_device() {
    let full = Path::new("/dev/full");
    if !fs::metadata(full).is_ok_and(|metadata| metadata.file_type().is_char_device()) {
        eprintln!("there is no /dev/full here: ran on nothing");
        return;
    }
    let error = put(full, b"picture").unwrap_err();
    assert!(matches!(error, OutputError::DiskFull { written: 0, .. }), "{error:?}");
    assert!(error.to_string().contains("full after 0 bytes"), "{error}");
    let pixels = [0.5; 3];
    let error = write_exr(full, &Picture::new(1, 1, &pixels).unwrap()).unwrap_err();
    assert!(matches!(error, OutputError::DiskFull { .. }), "{error:?}");
    assert!(fs::metadata(full).unwrap().file_type().is_char_device());
}

#[test]
fn a_pipe_receives_a_file_that_needs_seeking() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("pipe");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status().unwrap();
    assert!(made.success());
    let reader = std::thread::spawn({
        let pipe = pipe.clone();
        move || {
            let mut received = Vec::new();
            File::open(pipe).unwrap().read_to_end(&mut received).unwrap();
            received
        }
    });
    let pixels = [0.25, 0.5, 1.0, 1.0, 2.0, 4.0];
    let picture = Picture::new(2, 1, &pixels).unwrap();
    write_exr(&pipe, &picture).unwrap();
    let plain = folder.path().join("plain.exr");
    write_exr(&plain, &picture).unwrap();
    assert_eq!(reader.join().unwrap(), fs::read(plain).unwrap());
    assert!(fs::metadata(pipe).unwrap().file_type().is_fifo());
}

#[test]
fn what_cannot_be_written_to_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let error = put(&folder.path().join("absent/picture"), b"").unwrap_err();
    assert!(matches!(&error, OutputError::NoFolder { folder, .. } if folder.ends_with("absent")), "{error:?}");
    let error = put(folder.path(), b"").unwrap_err();
    assert!(matches!(error, OutputError::IsFolder { .. }), "{error:?}");
    // A file cannot contain a folder.
    put(&folder.path().join("file"), b"").unwrap();
    let error = put(&folder.path().join("file/picture"), b"").unwrap_err();
    assert!(matches!(error, OutputError::Write { .. } | OutputError::NoFolder { .. }), "{error:?}");
    // No user, not even root, can create files in /proc.
    if Path::new("/proc/self").is_dir() {
        let error = put(Path::new("/proc/self/picture"), b"").unwrap_err();
        assert!(matches!(error, OutputError::NoFile { .. }), "{error:?}");
    }
    assert_eq!(names(folder.path()), ["file"]);
}

/// The limit on file sizes applies to a process and is set by a shell: this test runs itself again under it.
#[test]
fn a_file_that_may_not_grow_says_so_and_leaves_the_old_one() {
    const CHILD: &str = "RELUME_TEST_FILE_LIMIT";
    if let Some(path) = std::env::var_os(CHILD) {
        let failed = put(Path::new(&path), &vec![7; 100_000]).unwrap_err();
        assert!(matches!(failed, OutputError::FileLimit { written: 8192, .. }), "{failed:?}");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("picture");
    put(&path, b"old").unwrap();
    let script = "trap '' XFSZ; ulimit -f 8; exec \"$0\" a_file_that_may_not_grow";
    let run = std::process::Command::new("bash")
        .args(["-c", script])
        .arg(std::env::current_exe().unwrap())
        .env(CHILD, &path)
        .output()
        .unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stdout));
    assert_eq!((fs::read(&path).unwrap(), names(folder.path())), (b"old".to_vec(), vec!["picture".to_owned()]));
}

// ---- PNG ----

/// Stored samples of a PNG, its type, and whether it is marked as sRGB.
fn read_png(path: &Path) -> (Vec<u8>, (png::ColorType, png::BitDepth), bool) {
    let mut reader = png::Decoder::new(io::BufReader::new(File::open(path).unwrap())).read_info().unwrap();
    let mut data = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut data).unwrap();
    let info = reader.info();
    (data, (info.color_type, info.bit_depth), info.srgb.is_some())
}

#[test]
fn a_png_holds_the_codes_of_srgb() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("picture.png");
    // 0.214041140482 is 0.5 in sRGB (IEC 61966-2-1), code 127.5 of 255; 0.0025 encodes to 12.92 times that.
    let pixels = [0.0, 1.0, 0.214_1, f32::NAN, -1.0, 0.002_5];
    let picture = Picture::new(2, 1, &pixels).unwrap();
    write_png(&path, &picture, Depth::Eight, Alpha::OverBlack).unwrap();
    let (data, kind, srgb) = read_png(&path);
    assert_eq!((data, kind, srgb), (vec![0, 255, 128, 0, 0, 8], (png::ColorType::Rgb, png::BitDepth::Eight), true));
    write_png(&path, &picture, Depth::Sixteen, Alpha::OverBlack).unwrap();
    let (data, kind, srgb) = read_png(&path);
    assert_eq!((kind, srgb), ((png::ColorType::Rgb, png::BitDepth::Sixteen), true));
    let values: Vec<u16> = data.chunks_exact(2).map(|pair| u16::from_be_bytes([pair[0], pair[1]])).collect();
    // 0.2141 encodes to 0.500064, and 0.0025 to 0.0323.
    assert_eq!((values[0], values[1], values[3], values[4]), (0, 65_535, 0, 0));
    assert!(values[2].abs_diff(32_772) <= 1 && values[5].abs_diff(2117) <= 1, "{values:?}");
}

#[test]
fn a_png_with_alpha_is_not_premultiplied() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("picture.png");
    // Half opaque and white; transparent; opaque and grey.
    let pixels = [0.5, 0.5, 0.5, 0.5, 0.0, 0.0, 0.0, 0.0, 0.214_1, 0.214_1, 0.214_1, 1.0];
    let picture = Picture::new(1, 3, &pixels).unwrap();
    write_png(&path, &picture, Depth::Eight, Alpha::Kept).unwrap();
    let expected = vec![255, 255, 255, 128, 0, 0, 0, 0, 128, 128, 128, 255];
    assert_eq!(read_png(&path), (expected, (png::ColorType::Rgba, png::BitDepth::Eight), true));
    write_png(&path, &picture, Depth::Eight, Alpha::OverBlack).unwrap();
    assert_eq!(read_png(&path).0, [188, 188, 188, 0, 0, 0, 128, 128, 128]);
}

#[test]
fn a_png_for_programs_that_mix_codes_shows_over_black_the_codes_of_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("picture.png");
    // Dim and bright pixels of all opacities; white that is hardly opaque; nothing; what is too bright.
    let mut pixels: Vec<f32> = (0..60_u8)
        .flat_map(|n| {
            let n = f32::from(n) / 59.0;
            [0.9 * n * n, 0.3 * n, 0.05, 0.2 + 0.8 * n]
        })
        .collect();
    pixels.extend([1.0, 1.0, 1.0, 0.1, 0.0, 0.0, 0.0, 0.0, 2.0, 0.5, 0.0, 0.7]);
    let picture = Picture::new(pixels.len() / 4, 1, &pixels).unwrap();
    // Half a code each for the colour, the alpha and the picture over black.
    let off = 1.5;
    for (depth, largest) in [(Depth::Eight, 255.0), (Depth::Sixteen, 65_535.0)] {
        let codes = |alpha: Alpha| -> Vec<f64> {
            write_png(&path, &picture, depth, alpha).unwrap();
            assert_eq!(png_bytes(&picture, depth, alpha).unwrap(), fs::read(&path).unwrap());
            assert_eq!(display_codes(&picture, depth, alpha), read_png(&path).0);
            let data = read_png(&path).0;
            match depth {
                Depth::Eight => data.into_iter().map(f64::from).collect(),
                Depth::Sixteen => data.chunks_exact(2).map(|it| u16::from_be_bytes([it[0], it[1]]).into()).collect(),
            }
        };
        let (over_black, kept) = (codes(Alpha::OverBlack), codes(Alpha::KeptForCodes));
        for (index, (expected, pixel)) in over_black.chunks(3).zip(kept.chunks(4)).enumerate() {
            let least = f64::from(pixels[4 * index + 3]) * largest;
            assert!(pixel[3] >= least - 0.51, "{index}: an alpha of {} for {least}", pixel[3]);
            for (code, expected) in pixel.iter().zip(expected) {
                let shown = code * pixel[3] / largest;
                assert!((shown - expected).abs() <= off, "{index}: {shown}, not {expected}");
            }
        }
    }
}

#[test]
fn samples_that_are_ready_arrive_unchanged() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("picture.png");
    let samples: Vec<u8> = (0..=239).collect();
    write_ready_png(&path, 10, 6, &samples).unwrap();
    assert_eq!(read_png(&path), (samples.clone(), (png::ColorType::Rgba, png::BitDepth::Eight), true));
    write_ready_png(&path, 8, 10, &samples).unwrap();
    assert_eq!(read_png(&path), (samples.clone(), (png::ColorType::Rgb, png::BitDepth::Eight), true));
    let error = write_ready_png(&path, 7, 10, &samples).unwrap_err();
    assert_eq!(error.to_string(), "a PNG of 7×10 pixels needs 210 (RGB) or 280 (RGBA) samples, and has 240");
}

#[test]
fn pictures_without_pixels_and_monstrous_ones_are_refused() {
    for (width, height) in [(0, 5), (5, 0), (100_000, 5), (5, usize::MAX)] {
        let error = Picture::new(width, height, &[]).unwrap_err();
        assert!(matches!(error, OutputError::Size { .. }), "{error:?}");
    }
    assert!(matches!(Picture::new(2, 2, &[0.0; 13]), Err(OutputError::Shape { found: 13, .. })));
}

// ---- OpenEXR ----

/// Reads every channel of a file with the exr library.
fn read_channels(path: &Path) -> (Layer<AnyChannels<FlatSamples>>, ImageAttributes) {
    let image = read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
    let image = image.all_attributes().from_file(path).unwrap();
    (image.layer_data, image.attributes)
}

fn values(layer: &Layer<AnyChannels<FlatSamples>>, name: &str) -> Vec<f32> {
    let channels = &layer.channel_data.list;
    let channel = channels.iter().find(|channel| channel.name == *name).unwrap();
    channel.sample_data.values_as_f32().collect()
}

#[test]
fn an_exr_holds_what_was_given_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("picture.exr");
    let (width, height) = (5, 37);
    let samples: Vec<f32> =
        (0..width * height * 4).map(|sample| f32::from(u16::try_from(sample).unwrap()).sin()).collect();
    write_exr(&path, &Picture::new(width, height, &samples).unwrap()).unwrap();
    let (layer, attributes) = read_channels(&path);
    assert_eq!(layer.size, Vec2(width, height));
    for (channel, name) in ["R", "G", "B", "A"].into_iter().enumerate() {
        let expected: Vec<f32> = samples.iter().skip(channel).step_by(4).copied().collect();
        assert_eq!(values(&layer, name), expected, "{name}");
    }
    let primaries = attributes.chromaticities.unwrap();
    assert_eq!((primaries.red, primaries.white), (Vec2(0.64, 0.33), Vec2(0.3127, 0.329)));
    let software = layer.attributes.software_name.unwrap().to_string();
    assert_eq!(software, format!("relume {}", env!("CARGO_PKG_VERSION")));
}

#[test]
fn a_spectral_exr_has_the_channels_and_words_of_its_layout() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("spectral.exr");
    let (width, height) = (3, 20);
    let number = |value: usize| f32::from(u16::try_from(value).unwrap());
    write_spectral(&path, width, height, &[("note", "by hand")], |y, row| {
        for (x, (radiance, preview)) in row.radiance.iter_mut().zip(row.preview).enumerate() {
            for (band, value) in radiance.iter_mut().enumerate() {
                *value = number((y * width + x) * 100 + band);
            }
            *preview = [0.0, 1.0, 2.0].map(|channel| channel + number(y));
        }
    })
    .unwrap();
    let (layer, _) = read_channels(&path);
    assert_eq!(layer.channel_data.list.len(), 84);
    for (name, band) in [("S0.380,000nm", 0), ("S0.550,000nm", 34), ("S0.780,000nm", 80)] {
        let expected: Vec<f32> = (0..width * height).map(|pixel| number(pixel * 100 + band)).collect();
        assert_eq!(values(&layer, name), expected, "{name}");
    }
    assert_eq!(values(&layer, "G")[width * 7..][..width], [8.0; 3]);
    let words = |name: &str| layer.attributes.other[&Text::from(name)].to_text().unwrap().to_string();
    assert_eq!(words("spectralLayoutVersion"), "1.0");
    assert_eq!(words("emissiveUnits"), "W.m^-2.sr^-1");
    assert_eq!(words("polarisationHandedness"), "right");
    assert_eq!(words("note"), "by hand");
}

// ---- film files ----

fn ramp(scale: f64) -> [f64; BANDS] {
    std::array::from_fn(|band| scale * f64::from(u8::try_from(band).unwrap()) / 7.0 - 0.1)
}

fn example() -> FilmFile {
    let (width, height) = (4, 18);
    let weight = |index: usize| f32::from(u16::try_from(index).unwrap()) / 3.0;
    FilmFile {
        width,
        height,
        components: Components::Surfaces(vec![
            Component { name: "Knöchel".to_owned(), spectrum: ramp(0.1) },
            Component { name: "white".to_owned(), spectrum: [1.0; BANDS] },
        ]),
        positions: vec![
            Position {
                name: "key".to_owned(),
                placement: Placement::Directional(DVec3::from_array([0.3, -1.0, 2.5])),
                shadows: true,
            },
            Position { name: "all around".to_owned(), placement: Placement::Ambient, shadows: false },
            Position {
                name: "lamp".to_owned(),
                placement: Placement::Point(DVec3::from_array([1e-9, 1e9, 0.0])),
                shadows: false,
            },
        ],
        lights: vec![
            Light { name: "D65".to_owned(), position: 2, weight: 0.7, shown: Some(0.25), spectrum: ramp(1e-3) },
            Light { name: "A".to_owned(), position: 0, weight: 2.0, shown: None, spectrum: ramp(3.0) },
        ],
        background: Some(ramp(0.5)),
        exposure: Some(1.25),
        tone: Tone::Soft,
        backdrop: Backdrop::Dark,
        adapt: true,
        observer: Observer::default(),
        dial: Some(Dial {
            hand: Some([0.25, -1.5]),
            normalise: false,
            master: 2.5,
            nodes: vec![Node { light: "A".to_owned(), place: [0.1, -1e3], on: false }],
            presets: vec![DialPreset {
                name: "night".to_owned(),
                caption: "the eyes".to_owned(),
                hand: [0.5, 1.0],
                off: vec!["A".to_owned()],
                on: vec!["A".to_owned()],
            }],
        }),
        frame: Some(Frame {
            pixel: Some(0.125),
            parallel: true,
            unit: Some("µm".to_owned()),
            edges: Some(["R", "LA", "S", ""].map(str::to_owned)),
        }),
        part: None,
        accumulators: (0..6 * width * height).map(weight).collect(),
        transmittance: (0..width * height).map(|pixel| weight(pixel) / 24.0).collect(),
    }
}

#[test]
fn accumulators_come_back_as_they_were() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("accumulators.exr");
    let full = example();
    full.write(&path).unwrap();
    assert_eq!(FilmFile::read(&path).unwrap(), full);
    // The same in memory.
    let bytes = full.to_bytes().unwrap();
    assert_eq!(bytes, fs::read(&path).unwrap());
    assert_eq!(FilmFile::from_bytes(&bytes, "memory").unwrap(), full);
    let error = FilmFile::from_bytes(&bytes[..bytes.len() / 2], "half a film").unwrap_err();
    assert!(error.to_string().contains("half a film"), "{error}");
    let (layer, _) = read_channels(&path);
    // Position 1, component 0.
    assert_eq!(values(&layer, "all around.KnÃ¶chel"), full.accumulators[2 * 72..3 * 72]);
    let empty = FilmFile {
        transmittance: full.transmittance,
        ..FilmFile::empty([full.width, full.height], Components::Surfaces(vec![]))
    };
    empty.write(&path).unwrap();
    assert_eq!(FilmFile::read(&path).unwrap(), empty);
}

/// Writes a file from the module's documentation alone, without its code.
fn write_by_hand(path: &Path, text: &str, channels: &[(&str, FlatSamples)]) {
    let list = channels.iter().map(|(name, samples)| AnyChannel::new(*name, samples.clone())).collect();
    let mut layer = Layer::new(
        (2, 2),
        LayerAttributes::default(),
        Encoding {
            compression: Compression::PIZ,
            blocks: Blocks::Tiles(Vec2(16, 16)),
            line_order: LineOrder::Increasing,
        },
        AnyChannels::sort(list),
    );
    layer.attributes.other.insert(Text::from("relume"), AttributeValue::Text(Text::from(text)));
    Image::from_layer(layer).write().to_file(path).unwrap();
}

fn spectrum(value: &str) -> String {
    format!("[{}]", vec![value; BANDS].join(", "))
}

/// Text with one component, one position and one light.
fn small_text() -> String {
    format!(
        "version = 1\n[[components]]\nname = \"bone\"\nspectrum = {}\n\
         [[positions]]\nname = \"key\"\nkind = \"headlight\"\n\
         [[lights]]\nname = \"E\"\nposition = \"key\"\nweight = 2\nspectrum = {}\n",
        spectrum("0.5"),
        spectrum("1.0"),
    )
}

fn floats(values: [f32; 4]) -> FlatSamples {
    FlatSamples::F32(values.to_vec())
}

fn halves(values: [f32; 4]) -> FlatSamples {
    FlatSamples::F16(values.map(f16::from_f32).to_vec())
}

#[test]
fn a_file_of_another_program_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("foreign.exr");
    let (weights, transmittance) = ([0.1, 0.2, 0.3, 0.4], [1.0, 0.5, 0.25, 0.0]);
    write_by_hand(&path, &small_text(), &[("transmittance", halves(transmittance)), ("key.bone", floats(weights))]);
    let found = FilmFile::read(&path).unwrap();
    let bone = Component { name: "bone".to_owned(), spectrum: [0.5; BANDS] };
    let expected = FilmFile {
        positions: vec![Position { name: "key".to_owned(), placement: Placement::Headlight, shadows: false }],
        lights: vec![Light { name: "E".to_owned(), position: 0, weight: 2.0, shown: None, spectrum: [1.0; BANDS] }],
        accumulators: weights.to_vec(),
        transmittance: transmittance.to_vec(),
        ..FilmFile::empty([2, 2], Components::Surfaces(vec![bone]))
    };
    assert_eq!(found, expected);
}

#[test]
fn a_wrong_text_is_refused_with_its_line_and_reason() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("foreign.exr");
    let good = small_text();
    let cases = [
        (good.replace("version = 1", "version = 7"), "unknown version 7"),
        (good.replace("version = 1", "version = 4"), "a file of version 4 needs a `[part]`"),
        (good.replace("version = 1", "version = 2"), "version 2 needs a `[model]`"),
        (good.replace("version = 1\n", ""), "missing field `version`"),
        (good.replace("weight = 2", "wieght = 2"), "line 11: unknown field `wieght`"),
        (good.replace("version = 1", "version = 1\ngamma = 2"), "line 2: unknown field `gamma`"),
        (good.replace("headlight", "torch"), "line 7: unknown variant `torch`"),
        (good.replace("headlight", "point"), "the position \"key\" needs a `vector`"),
        (good.replace("kind =", "vector = [0, 0, 1]\nkind ="), "the position \"key\" has a `vector`"),
        (good.replace("position = \"key\"", "position = \"kay\""), "at the position \"kay\", which is not listed"),
        (good.replacen("[0.5, ", "[", 1), "the component \"bone\" has 80 numbers"),
        (good.replacen("[1.0, ", "[1.0, 1.0, ", 1), "the light \"E\" has 82 numbers"),
        (good.replace("version = 1", "version = 1\nbackground = [1.0]"), "`background` has 1 numbers"),
        (good.replacen("[0.5", "[nan", 1), "\"bone\" holds NaN"),
        (good.replace("version = 1", "version = 1\nexposure = inf"), "\"exposure\" holds inf"),
        (good.replace("\"bone\"", "\"\""), "a component has an empty name"),
        (good.replace("\"bone\"", "\"bo\\nne\""), "contains a control character"),
        (format!("{good}[[positions]]\nname = \"key\"\nkind = \"ambient\"\n"), "two positions have the name \"key\""),
        (good.replace("version = 1", "version = "), "line 1: "),
    ];
    for (text, reason) in cases {
        write_by_hand(&path, &text, &[("transmittance", floats([1.0; 4])), ("key.bone", floats([1.0; 4]))]);
        let error = FilmFile::read(&path).unwrap_err();
        assert!(matches!(error, OutputError::Attribute { .. }), "{error:?}");
        assert!(error.to_string().contains(reason), "{error}\nshould say: {reason}");
        assert!(!error.to_string().contains('\n'), "{error}");
    }
}

#[test]
fn wrong_channels_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("foreign.exr");
    let (transmittance, bone) = (("transmittance", floats([1.0; 4])), ("key.bone", floats([1.0; 4])));
    let integers = FlatSamples::U32(vec![1; 4]);
    let hole = floats([1.0, 1.0, f32::NAN, 1.0]);
    let cases: [(Vec<(&str, FlatSamples)>, &str); 5] = [
        (vec![transmittance.clone()], "the channel \"key.bone\" is missing"),
        (vec![bone.clone()], "the channel \"transmittance\" is missing"),
        (vec![transmittance.clone(), bone, ("key.skin", floats([0.0; 4]))], "its channel \"key.skin\" matches no"),
        (vec![transmittance.clone(), ("key.bone", integers)], "its channel \"key.bone\" holds integers"),
        (vec![transmittance, ("key.bone", hole)], "the channel \"key.bone\" has no finite value at pixel (0, 1)"),
    ];
    for (channels, reason) in cases {
        write_by_hand(&path, &small_text(), &channels);
        let error = FilmFile::read(&path).unwrap_err();
        assert!(error.to_string().contains(reason), "{error}\nshould say: {reason}");
    }
    let pixels = [0.0; 3];
    write_exr(&path, &Picture::new(1, 1, &pixels).unwrap()).unwrap();
    let error = FilmFile::read(&path).unwrap_err();
    assert!(error.to_string().contains("attribute `relume`"), "{error}");
    fs::write(&path, b"\x89PNG\r\n").unwrap();
    assert!(matches!(FilmFile::read(&path), Err(OutputError::Damaged { .. })));
    assert!(matches!(FilmFile::read(&folder.path().join("absent")), Err(OutputError::Read { .. })));
    assert!(FilmFile::read(folder.path()).is_err());
}

#[test]
fn accumulators_that_contradict_themselves_are_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("accumulators.exr");
    let refused = |change: fn(&mut FilmFile), reason: &str| {
        let mut accumulators = example();
        change(&mut accumulators);
        let error = accumulators.write(&path).unwrap_err();
        assert!(error.to_string().contains(reason), "{error}\nshould say: {reason}");
    };
    refused(|it| it.accumulators.push(0.0), "432 numbers in the accumulators, and has 433");
    refused(|it| it.transmittance.clear(), "72 transmittances, and has 0");
    refused(|it| it.lights[0].position = 3, "the light \"D65\" is at position 3, but there are 3");
    refused(|it| it.lights[0].weight = f64::NAN, "the light \"D65\" holds NaN");
    refused(|it| it.accumulators[5] = f32::INFINITY, "\"key.Knöchel\" has no finite value at pixel (1, 1)");
    refused(|it| it.width = 0, "each side must be 1 to 65536");
    refused(
        |it| {
            it.positions[0].name = "a.b".to_owned();
            it.positions[1].name = "a".to_owned();
            let Components::Surfaces(surfaces) = &mut it.components else { panic!("weights") };
            surfaces[0].name = "c".to_owned();
            surfaces[1].name = "b.c".to_owned();
        },
        "two pairs of position and component have the channel name \"a.b.c\"",
    );
    assert_eq!(names(folder.path()), [""; 0]);
}

#[test]
fn no_damage_to_a_file_is_a_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("accumulators.exr");
    let small = FilmFile { width: 2, height: 2, accumulators: vec![0.5; 24], transmittance: vec![0.5; 4], ..example() };
    small.write(&path).unwrap();
    damage(&path, || FilmFile::read(&path).is_ok());
}
