//! Slices of volumes as pictures, and the listing of files that hold several volumes.

use serde_json::json;

use crate::support::dicom;
use crate::support::program::Folder;

const DIMS: [usize; 3] = [12, 10, 7];

/// Voxel `[x, y, z]` holds 5·x + 9·y + 17·z.
fn value([x, y, z]: [usize; 3]) -> u8 {
    u8::try_from(5 * x + 9 * y + 17 * z).unwrap()
}

/// An NRRD of [`DIMS`] with these further lines of its header.
fn nrrd(further: &str, value: impl Fn([usize; 3]) -> u8) -> Vec<u8> {
    let [nx, ny, nz] = DIMS;
    let header = format!("NRRD0005\ntype: uint8\ndimension: 3\nsizes: {nx} {ny} {nz}\n{further}encoding: raw\n\n");
    let voxels = (0..nx * ny * nz).map(|i| value([i % nx, i / nx % ny, i / (nx * ny)]));
    [header.into_bytes(), voxels.collect()].concat()
}

/// Width, height and RGB codes of a PNG.
fn png(folder: &Folder, name: &str) -> ([usize; 2], Vec<[u8; 3]>) {
    let file = std::io::BufReader::new(std::fs::File::open(folder.path(name)).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    let size = [info.width, info.height].map(|side| usize::try_from(side).unwrap());
    (size, bytes[..info.buffer_size()].as_chunks::<3>().0.to_vec())
}

/// Code of a value in a window from 0 to 255.
fn grey(value: u8) -> [u8; 3] {
    [value; 3]
}

#[test]
fn a_slice_is_what_the_window_shows() {
    let spacing = "spacings: 1 2 4\n";
    let labels = |[x, _, z]: [usize; 3]| u8::from(x < 6 && z == 3) * 2;
    let scene = "version = 1\n[materials.gut]\nreflectance = \"white 9.5\"\n[transfer]\nintervals = []\n\
                 [labels.2]\nname = \"gut\"\nmaterial = \"gut\"\nopacity = 0.3\n[lights.day]\nspectrum = \"D65\"\nkind = \"ambient\"\n";
    let folder =
        Folder::new().with("v.nrrd", nrrd(spacing, value)).with("l.nrrd", nrrd(spacing, labels)).with("s.toml", scene);
    let all = ["--window", "255", "--level", "127.5"];
    let slice = |more: &[&str], name: &str| {
        let json = folder.done(&[&["slice", "v.nrrd", "-o", name, "--json"], &all[..], more].concat()).json();
        (json, png(&folder, name))
    };
    // A pixel a voxel: 12 × 10 voxels of 1 × 2 are 12 × 20 pixels.
    let (told, (size, pixels)) = slice(&["--at", "4", "--size", "12x20"], "z.png");
    assert_eq!(size, [12, 20]);
    for (i, pixel) in pixels.iter().enumerate() {
        assert_eq!(*pixel, grey(value([i % 12, i / 24, 4])), "pixel {i}");
    }
    let expected = json!({"plane": "XY", "axis": "z", "at": 4, "slices": 7, "window": [0.0, 255.0], "size": [12, 20], "pixel": 1.0});
    for (key, value) in expected.as_object().unwrap() {
        assert_eq!(&told[key], value, "{key}");
    }
    // The middle across y, z upwards; in a square, in the middle of black. 12 × 28 units at 2 a pixel.
    let (told, (size, pixels)) = slice(&["--axis", "y", "--size", "14x14"], "y.png");
    assert_eq!((size, &told["at"], &told["plane"]), ([14, 14], &json!(5), &json!("XZ")));
    for (i, pixel) in pixels.iter().enumerate() {
        let (x, y) = (i % 14, i / 14);
        let inside = (4..10).contains(&x).then(|| grey(value([2 * (x - 4) + 1, 5, 6 - y / 2])));
        assert_eq!(*pixel, inside.unwrap_or_default(), "pixel {x} {y}");
    }
    // Alone: 800 pixels along the longer side.
    assert_eq!(slice(&["--axis", "x"], "x.png").1.0, [571, 800]);

    // Half of the label's white over the values, in its slice alone.
    let labelled = |at: &str, name: &str| {
        let arguments =
            ["slice", "s.toml", "--volume", "v.nrrd", "--labels", "l.nrrd", "--at", at, "--size", "12x20", "-o", name];
        folder.done(&[&arguments[..], &all].concat());
        png(&folder, name).1
    };
    let [with, without] = [labelled("3", "with.png"), labelled("2", "without.png")];
    let base = value([2, 4, 3]);
    assert!(with[8 * 12 + 2][0] > base + 60 && with[8 * 12 + 8] == grey(value([8, 4, 3])), "{:?}", with[8 * 12 + 2]);
    assert_eq!(without[8 * 12 + 2], grey(value([2, 4, 2])));

    // Annotations: drawn over the same values, each by itself.
    let plain = slice(&["--size", "240x240"], "plain.png").1.1;
    let mut seen = vec![plain];
    for annotate in ["scale", "letters", "scale,letters"] {
        let drawn = slice(&["--size", "240x240", "--annotate", annotate], "a.png").1.1;
        assert!(!seen.contains(&drawn), "{annotate}");
        seen.push(drawn);
    }
    folder.refused(2, &["slice", "v.nrrd", "--at", "7", "-o", "p.png"], &["--at 7", "7 slices along z, from 0 to 6"]);
    folder.refused(2, &["slice", "v.nrrd", "--axis", "axial", "-o", "p.png"], &["anatomical", "--axis z"]);
    folder.refused(2, &["slice", "v.nrrd", "-o", "p.bmp"], &["p.bmp"]);
    folder.refused(2, &["slice", "v.nrrd", "-o", "./v.nrrd"], &["v.nrrd"]);
}

#[test]
fn a_slice_of_a_patient_is_named_by_its_plane() {
    let axes = "space: left-posterior-superior\nspace directions: (0,3,0) (0,0,-2) (1,0,0)\nspace origin: (0,0,0)\n";
    let folder = Folder::new().with("v.nrrd", nrrd(axes, value));
    // The axes of the file are posterior, inferior and left: x is across coronal slices.
    for (name, axis) in [("coronal", "x"), ("axial", "y"), ("sagittal", "z")] {
        let told = |by: &str, file: &str| {
            let size = ["--size", "40x40", "--at", "3"];
            let json =
                folder.done(&[&["slice", "v.nrrd", "--axis", by, "-o", file, "--json"], &size[..]].concat()).json();
            (json["plane"].clone(), json["axis"].clone(), std::fs::read(folder.path(file)).unwrap())
        };
        let [one, other] = [told(name, "one.png"), told(axis, "other.png")];
        assert_eq!((&one.0, &one.1), (&json!(name), &json!(axis)));
        assert!(one == other, "{name} is {axis}");
    }
}

#[test]
fn info_of_several_lists_all_choices_at_once() {
    // 4 components of 3×2×5 voxels in 6 times, as NRRD.
    let header = "NRRD0005\ntype: int16\ndimension: 5\nsizes: 4 3 2 5 6\nkinds: vector space space space time\n\
                  endian: little\nspacings: nan 0.5 1.5 2 nan\nencoding: raw\n\n";
    let numbers: Vec<u8> = (0..4 * 3 * 2 * 5 * 6_i16).flat_map(i16::to_le_bytes).collect();
    let folder = Folder::new().with("both.nrrd", [header.as_bytes(), &numbers].concat());
    let outcome = folder.done(&["info", "both.nrrd"]);
    for words in ["3 × 2 × 5 of int16, spacing 0.5 × 1.5 × 2", "component  3", "0 to 5", "--component N", "--time N"]
    {
        assert!(outcome.out.contains(words), "no {words:?} in {}", outcome.out);
    }
    let json = folder.done(&["info", "both.nrrd", "--json"]).json();
    let expected = json!({"components": 4, "times": 6, "dims": [3, 2, 5], "type": "int16", "spacing": [0.5, 1.5, 2.0],
                          "choose": ["--component N", "--time N"]});
    for (key, value) in expected.as_object().unwrap() {
        let found = &json[key];
        assert!(found == value || key == "choose" && found.as_array().unwrap().len() == 2, "{key}: {json}");
    }
    // One of them is chosen: the other is left.
    let one = folder.done(&["info", "both.nrrd", "--component", "2", "--json"]).json();
    assert_eq!((&one["times"], &one["choose"]), (&json!(6), &json!(["--time N"])), "{one}");
    let both = folder.done(&["info", "both.nrrd", "--component", "2", "--time", "5", "--json"]).json();
    assert_eq!((&both["min"], &both["dims"]), (&json!(602.0), &json!([3, 2, 5])));

    // Series of a folder: each with its type and spacing.
    std::fs::create_dir(folder.path("scans")).unwrap();
    let second = |z, first| dicom::slice(z, first).text(0x0020_0011, "IS", "8").text(0x0020_000e, "UI", "1.2.8");
    let slices = [dicom::slice(0.0, 0), dicom::slice(3.5, 12), second(0.0, 100), second(2.5, 130)];
    for (index, slice) in slices.iter().enumerate() {
        std::fs::write(folder.path("scans").join(index.to_string()), dicom::file(slice, dicom::EXPLICIT)).unwrap();
    }
    let listed = folder.done(&["info", "scans"]).out;
    let json = folder.done(&["info", "scans", "--json"]).json();
    for (index, spacing) in [3.5, 2.5].into_iter().enumerate() {
        let volume = &json["volumes"][index];
        assert_eq!(
            (&volume["spacing"][2], &volume["dims"], &volume["type"]),
            (&json!(spacing), &json!([4, 3, 2]), &json!("uint16"))
        );
        assert!(listed.contains(&format!("× {spacing} mm")), "{listed}");
    }
}
