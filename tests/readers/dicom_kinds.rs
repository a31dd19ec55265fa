//! DICOM files of kinds that users of other programs met: volumes of one series that one attribute tells apart, old multi-frame files,
//! mosaics, wrong encodings and types, and values that a mapping gives.
#![expect(clippy::float_cmp, reason = "whole numbers, and fractions of two")]

use crate::support;

use relume::progress::Quiet;
use relume::volume::{self, Selection, Several, Volume, VolumeError};
use support::dicom::{BIG, DEFLATED, EXPLICIT, Elements, IMPLICIT, RLE, Value, file, place, slice};
use support::volumes::{self, refused};

/// The bytes of a slice at a height.
type Bytes = Box<dyn Fn(f64) -> Vec<u8>>;

/// The functional groups of a frame of a volume.
type Groups = Box<dyn Fn(usize) -> Elements>;

/// Words of a tag.
fn words(tag: u32) -> [u16; 2] {
    [tag >> 16, tag & 0xffff].map(|half| u16::try_from(half).unwrap())
}

fn opened(bytes: &[u8]) -> Result<Volume, VolumeError> {
    volumes::opened("v.dcm", bytes, &Selection::default())
}

/// The volume of these slices, each in a file of its own.
fn folder(slices: &[Elements], selection: &Selection) -> Result<Volume, VolumeError> {
    let names: Vec<String> = (0..slices.len()).map(|index| format!("{index:03}")).collect();
    let files: Vec<_> = names.iter().zip(slices).map(|(name, slice)| (name.as_str(), file(slice, EXPLICIT))).collect();
    volume::open(volumes::folder(&files).path(), selection, &Quiet)
}

fn time(index: usize) -> Selection {
    Selection { time: Some(index), ..Selection::default() }
}

fn resampled() -> Selection {
    Selection { resample: true, ..Selection::default() }
}

/// Stored numbers of a volume.
fn stored(volume: &Volume) -> Vec<f64> {
    (0..volume.voxels.len()).map(|index| volume.voxels.value(index).unwrap()).collect()
}

/// The numbers of slices of 12 voxels that begin with these.
fn counted(firsts: &[u16]) -> Vec<f64> {
    firsts.iter().flat_map(|&first| (first..first + 12).map(f64::from)).collect()
}

fn says(volume: &Volume, words: &str) -> bool {
    volume.notes.iter().any(|note| note.contains(words))
}

/// Three slices of each of these volumes, whose attributes `with` adds; the numbers of volume v begin at 100 v, in slices of 12.
/// Slices of one position are neighbours in the order of the files.
fn volumes_of(count: u16, with: impl Fn(Elements, u16) -> Elements) -> Vec<Elements> {
    let one = |index: u16| {
        let (z, volume) = (index / count, index % count);
        let slice = slice(f64::from(z) * 1.5, 100 * volume + 12 * z);
        with(slice.text(0x0020_0013, "IS", &(1 + 3 * volume + z).to_string()), volume)
    };
    (0..3 * count).map(one).collect()
}

/// Asserts that the slices are volumes told apart by `axis`, in their order, with these values.
fn told_apart(name: &str, slices: &[Elements], axis: &str, values: &[&str]) {
    let error = refused(folder(slices, &Selection::default()), &["choose a time step from 0 to", axis, values[0]]);
    let VolumeError::Choose { there, .. } = error else { panic!("{name}: {error}") };
    let expected =
        Several::Steps { axis: axis.to_owned(), values: values.iter().map(|&value| value.to_owned()).collect() };
    assert_eq!(there, expected, "{name}");
    for index in 0..values.len() {
        let volume = folder(slices, &time(index)).unwrap();
        let first = 100 * u16::try_from(index).unwrap();
        assert_eq!(stored(&volume), counted(&[first, first + 12, first + 24]), "{name} {index}");
        assert_eq!((volume.geometry.dims, volume.geometry.spacing.z), ([4, 3, 3], 1.5), "{name}");
    }
}

#[test]
fn volumes_of_one_series_are_told_apart_by_the_one_attribute_that_differs() {
    let text = |tag: u32, vr: &'static str, values: &'static [&'static str]| {
        move |slice: Elements, volume: u16| slice.text(tag, vr, values[usize::from(volume)])
    };
    let values: &[&str] = &["3.25", "11.5", "20"];
    told_apart("echo times", &volumes_of(3, text(0x0018_0081, "DS", values)), "echo time", values);
    told_apart("inversion times", &volumes_of(3, text(0x0018_0082, "DS", values)), "inversion time", values);
    told_apart("flip angles", &volumes_of(3, text(0x0018_1314, "DS", values)), "flip angle", values);
    let components: &[&str] = &["PHASE", "MAGNITUDE"];
    told_apart("complex", &volumes_of(2, text(0x0008_9208, "CS", components)), "complex component", components);
    let kinds: &[&str] =
        &["DERIVED\\PRIMARY\\DIXON\\WATER", "DERIVED\\PRIMARY\\DIXON\\IN_PHASE", "DERIVED\\PRIMARY\\DIXON\\FAT"];
    let told = ["WATER", "IN_PHASE", "FAT"];
    told_apart("Dixon", &volumes_of(3, text(0x0008_0008, "CS", kinds)), "image type", &told);
    let frames: &[&str] = &["900", "2500", "15000"];
    told_apart("PET", &volumes_of(3, text(0x0054_1300, "DS", frames)), "frame reference time", frames);
    let kernels: &[&str] = &["B70f", "B30f"];
    told_apart("kernels", &volumes_of(2, text(0x0018_1210, "SH", kernels)), "kernel", kernels);

    let directions = [[0.0, 0.6, 0.8], [1.0, 0.0, 0.0], [-0.6, 0.8, 0.0]];
    let diffusion = |slice: Elements, volume: u16| {
        let b = slice.with(0x0018_9087, "FD", Value::Double(vec![if volume == 0 { 0.0 } else { 750.0 }]));
        match usize::from(volume) {
            0 => b,
            volume => b.with(0x0018_9089, "FD", Value::Double(directions[volume - 1].to_vec())),
        }
    };
    let told = ["none", "0 0.6 0.8", "1 0 0", "-0.6 0.8 0"];
    told_apart("gradients", &volumes_of(4, diffusion), "gradient direction", &told);
}

#[test]
fn several_attributes_and_times_tell_apart_what_one_does_not() {
    // Two echoes of magnitude and phase each.
    let both = |slice: Elements, volume: u16| {
        slice.text(0x0018_0081, "DS", ["2.5", "2.5", "6", "6"][usize::from(volume)]).text(
            0x0008_0008,
            "CS",
            ["ORIGINAL\\PRIMARY\\M", "ORIGINAL\\PRIMARY\\P"][usize::from(volume % 2)],
        )
    };
    told_apart("echoes", &volumes_of(4, both), "echo time and image type", &["2.5 M", "2.5 P", "6 M", "6 P"]);
    // Two shells of two directions, and two volumes without a gradient, which only the times of acquisition tell apart.
    let shells = |slice: Elements, volume: u16| {
        let (b, direction) = match volume {
            0 | 1 => (0.0, None),
            2 | 3 => (500.0, Some(volume)),
            _ => (1500.0, Some(volume)),
        };
        let slice = slice.with(0x0018_9087, "FD", Value::Double(vec![b]));
        let x = |volume: u16| f64::from(volume % 2);
        match direction {
            None => slice,
            Some(volume) => slice.with(0x0018_9089, "FD", Value::Double(vec![1.0 - x(volume), x(volume), 0.0])),
        }
    };
    let all = volumes_of(6, shells);
    let words = ["b-value and gradient direction and InstanceNumber", "500 1 0 0 ", "1500 0 1 0 "];
    refused(folder(&all, &Selection::default()), &words);
    for index in 0..6 {
        let volume = folder(&all, &time(index)).unwrap();
        assert_eq!(volume.voxels.value(0), Some(100.0 * f64::from(u32::try_from(index).unwrap())));
        assert!(says(&volume, "only their order tells them apart"), "{:?}", volume.notes);
    }
    // Times that differ from slice to slice order those of each position; midnight passes.
    let clock = |slice: Elements, volume: u16| {
        slice.text(0x0008_0022, "DA", ["20240229", "20240301"][usize::from(volume)]).without(0x0020_0013)
    };
    let mut timed = volumes_of(2, clock);
    for (index, slice) in timed.iter_mut().enumerate() {
        let seconds = if index % 2 == 0 { format!("2359{:02}.5", 10 + index) } else { format!("0000{index:02}") };
        slice.set(0x0008_0032, "TM", Value::Text(seconds));
    }
    let first = folder(&timed, &time(0)).unwrap();
    assert_eq!(stored(&first), counted(&[0, 12, 24]), "before midnight");
    assert!(
        first.metadata.iter().any(|(key, value)| key == "time axis" && value.contains("acquisition time 235910.5"))
    );
}

#[test]
fn the_order_of_instances_is_the_last_resort_and_noted() {
    let slices = volumes_of(3, |slice, _| slice);
    told_apart("instances", &slices, "InstanceNumber", &["1", "4", "7"]);
    assert!(says(&folder(&slices, &time(1)).unwrap(), "3 slices at each position; only their order tells them apart"));
    // Without it, nothing is guessed.
    let lost = volumes_of(2, |slice, _| slice.without(0x0020_0013));
    refused(
        folder(&lost, &Selection::default()),
        &["6 slices at 3 positions", "instance number", "is at the position"],
    );
    // Volumes of different extents are a choice of series.
    let by_echo = |slice: Elements, volume: u16| slice.text(0x0018_0081, "DS", ["5", "9"][usize::from(volume)]);
    let mut few = volumes_of(2, by_echo);
    few.truncate(5);
    let listed = "2 series: 5.1 «made» MR (echo time 5) 4×3×3, 5.2 «made» MR (echo time 9) 4×3×2";
    refused(folder(&few, &Selection::default()), &[listed]);
    let second = folder(&few, &Selection { series: Some("5.2".to_owned()), ..Selection::default() }).unwrap();
    assert_eq!(stored(&second), counted(&[100, 112]));
    // Nothing makes whole volumes of them.
    few.extend([few[1].clone(), few[2].clone()]);
    refused(folder(&few, &Selection::default()), &["7 slices at 3 positions", "what differs is echo time (5, 9)"]);
}

/// An enhanced file of these frames, of 12 pixels each, numbered in the order of the file.
fn enhanced(frames: Vec<Elements>) -> Elements {
    let pixels = 12 * u16::try_from(frames.len()).unwrap();
    slice(0.0, 0)
        .without(0x0020_0032)
        .text(0x0028_0008, "IS", &frames.len().to_string())
        .items(0x5200_9230, frames)
        .with(0x7fe0_0010, "OW", Value::Short((0..pixels).collect()))
}

#[test]
fn frames_of_an_enhanced_file_are_told_apart_by_their_groups() {
    let one = |elements: Elements| vec![elements];
    let empty = Elements::default;
    let cases: [(&str, Groups, &str); 5] = [
        (
            "echo time",
            Box::new(move |v| {
                place(0.0).items(0x0018_9114, one(empty().with(0x0018_9082, "FD", Value::Double(vec![[1.5, 8.25][v]]))))
            }),
            "1.5, 8.25",
        ),
        (
            "complex component",
            Box::new(move |v| {
                let component = ["REAL", "IMAGINARY"][v];
                place(0.0).items(0x0018_9226, one(empty().text(0x0008_9208, "CS", component)))
            }),
            "REAL, IMAGINARY",
        ),
        (
            "image type",
            Box::new(move |v| {
                let kind = ["DERIVED\\PRIMARY\\DIXON\\FAT", "DERIVED\\PRIMARY\\DIXON\\WATER"][v];
                place(0.0).items(0x0018_9226, one(empty().text(0x0008_9007, "CS", kind)))
            }),
            "FAT, WATER",
        ),
        (
            // A dimension that the file defines itself.
            "InversionTimes",
            Box::new(move |v| {
                let index = Value::Long(vec![1, u32::try_from(v).unwrap() + 1]);
                place(0.0).items(0x0020_9111, one(empty().with(0x0020_9157, "UL", index)))
            }),
            "1, 2",
        ),
        ("frame", Box::new(|_| place(0.0)), "1, 2"),
    ];
    for (axis, group, values) in cases {
        let frame = |index: usize| {
            let position = empty().text(0x0020_0032, "DS", &format!("0\\0\\{}", index / 2 * 3));
            group(index % 2).items(0x0020_9113, one(position))
        };
        let pointer = |tag: u32| empty().with(0x0020_9165, "AT", Value::Short(words(tag).to_vec()));
        let elements =
            enhanced((0..6).map(frame).collect()).items(0x0020_9222, vec![pointer(0x0020_9056), pointer(0x0018_9079)]);
        let bytes = file(&elements, EXPLICIT);
        refused(opened(&bytes), &["2 time steps; choose a time step from 0 to 1", &format!("({axis} {values})")]);
        for (index, firsts) in [(0, [0, 24, 48]), (1, [12, 36, 60])] {
            let volume = volumes::opened("v.dcm", &bytes, &time(index)).unwrap();
            assert_eq!((stored(&volume), volume.geometry.dims), (counted(&firsts), [4, 3, 3]), "{axis}");
            assert_eq!(says(&volume, "only their order"), axis == "frame", "{axis}: {:?}", volume.notes);
        }
    }
}

/// An old multi-frame file of `frames` frames, numbered in their order.
fn multi_frame(frames: u16) -> Elements {
    slice(7.0, 0).text(0x0028_0008, "IS", &frames.to_string()).with(
        0x7fe0_0010,
        "OW",
        Value::Short((0..12 * frames).collect()),
    )
}

fn pointers(tags: &[u32]) -> Value {
    Value::Short(tags.iter().flat_map(|&tag| words(tag)).collect())
}

#[test]
fn frames_of_old_files_with_a_distance_of_slices_are_slices() {
    let apart = |step: &str| multi_frame(5).text(0x0018_0088, "DS", step);
    let volume = opened(&file(&apart("0.75"), EXPLICIT)).unwrap();
    assert_eq!((stored(&volume), volume.geometry.dims), (counted(&[0, 12, 24, 36, 48]), [4, 3, 5]));
    assert_eq!((volume.geometry.spacing.z, volume.geometry.origin.z, volume.anatomical), (0.75, 7.0, true));
    assert!(says(&volume, "the 5 frames are taken as slices, 0.75 mm apart"), "{:?}", volume.notes);
    // Without a place.
    let lost = apart("0.75").without(0x0020_0032).without(0x0020_0037);
    let volume = opened(&file(&lost, EXPLICIT)).unwrap();
    assert_eq!((volume.geometry.dims, volume.geometry.origin.z, volume.anatomical), ([4, 3, 5], 0.0, false));
    assert!(says(&volume, "no place in the patient"), "{:?}", volume.notes);
    // Frames of a film are times, whatever else the file says.
    for pointer in [0x0018_1063, 0x0018_1065, 0x0054_0090] {
        let film = apart("0.75").with(0x0028_0009, "AT", pointers(&[pointer]));
        refused(opened(&file(&film, EXPLICIT)), &["5 time steps"]);
    }

    // Nuclear medicine: the place is that of a detector, and a negative distance goes against the normal.
    let spect = |step: &str, vectors: &[(u32, &[u16])]| {
        let detector =
            Elements::default().text(0x0020_0032, "DS", "-8\\-6\\30").text(0x0020_0037, "DS", "1\\0\\0\\0\\1\\0");
        let tags: Vec<u32> = vectors.iter().map(|&(tag, _)| tag).collect();
        let elements = multi_frame(4)
            .without(0x0020_0032)
            .without(0x0020_0037)
            .text(0x0018_0088, "DS", step)
            .with(0x0028_0009, "AT", pointers(&tags))
            .items(0x0054_0022, vec![detector]);
        vectors.iter().fold(elements, |elements, &(tag, numbers)| elements.short(tag, numbers))
    };
    let slices: (u32, &[u16]) = (0x0054_0080, &[1, 2, 3, 4]);
    for (step, origin, firsts) in [("2.5", 30.0, [0, 12, 24, 36]), ("-2.5", 22.5, [36, 24, 12, 0])] {
        for syntax in [EXPLICIT, IMPLICIT, BIG] {
            let volume = opened(&file(&spect(step, &[slices]), syntax)).unwrap();
            assert_eq!(stored(&volume), counted(&firsts), "{step} {syntax}");
            assert_eq!((volume.geometry.origin.to_array(), volume.anatomical), ([-8.0, -6.0, origin], true), "{step}");
            assert_eq!(volume.geometry.spacing.z, 2.5, "{step}");
        }
    }
    let gated = spect("-2.5", &[(0x0054_0070, &[1, 1, 2, 2]), (0x0054_0080, &[1, 2, 1, 2])]);
    let bytes = file(&gated, EXPLICIT);
    refused(opened(&bytes), &["2 time steps", "(time slot 1, 2)"]);
    let second = volumes::opened("v.dcm", &bytes, &time(1)).unwrap();
    assert_eq!((stored(&second), second.geometry.origin.z), (counted(&[36, 24]), 27.5));
    let short = spect("2.5", &[(0x0054_0080, &[1, 2])]);
    refused(opened(&file(&short, EXPLICIT)), &["SliceVector (0054,0080)", "2 slices for 4 frames"]);
    let thick = spect("2.5", &[slices]).without(0x0018_0088);
    let volume = opened(&file(&thick, EXPLICIT)).unwrap();
    assert!(volume.geometry.spacing.z == 2.0 && says(&volume, "SliceThickness, 2 mm"), "{:?}", volume.notes);
}

/// A CSA header with these elements, of the first or the second kind.
fn csa(elements: &[(&str, &[&str])], is_second: bool) -> Vec<u8> {
    let word = |number: usize| u32::try_from(number).unwrap().to_le_bytes();
    let mut bytes = if is_second { b"SV10\x04\x03\x02\x01".to_vec() } else { Vec::new() };
    bytes.extend(word(elements.len()));
    bytes.extend(word(77));
    for (name, values) in elements {
        let mut padded = name.as_bytes().to_vec();
        padded.push(0);
        // Whatever was in the memory of the scanner.
        padded.resize(64, 0xcd);
        bytes.extend(padded);
        bytes.extend([word(values.len()), *b"FD\0\0", word(0), word(6), word(77)].concat());
        for index in 0..6 {
            let mut text = values.get(index).map_or(Vec::new(), |value| format!("{value}\0").into_bytes());
            let length = text.len();
            let lengths = if is_second { [length, length, 77, length] } else { [length + 6, length, 77, length] };
            bytes.extend(lengths.map(word).concat());
            text.resize(length.next_multiple_of(4), 0);
            bytes.extend(text);
        }
    }
    bytes
}

#[test]
fn a_mosaic_is_taken_apart_at_the_places_of_its_slices() {
    // Five slices of 4×3 pixels in 3×3 places, the last four of which are empty.
    let number = |x: usize, y: usize| -> u16 {
        let (tile, within) = (x / 4 + 3 * (y / 3), x % 4 + 4 * (y % 3));
        if tile < 5 { u16::try_from(50 * tile + within).unwrap() } else { 0 }
    };
    let pixels: Vec<u16> = (0..9).flat_map(|y| (0..12).map(move |x| number(x, y))).collect();
    let mosaic = slice(-3.0, 0)
        .text(0x0008_0008, "CS", "ORIGINAL\\PRIMARY\\M\\MOSAIC")
        .text(0x0018_0088, "DS", "2.5")
        .short(0x0028_0010, &[9])
        .short(0x0028_0011, &[12])
        .with(0x7fe0_0010, "OW", Value::Short(pixels));
    let expected: Vec<f64> =
        (0..5_u32).flat_map(|tile| (0..12).map(move |pixel| f64::from(50 * tile + pixel))).collect();
    let reversed: Vec<f64> = expected.chunks(12).rev().flatten().copied().collect();
    let private = mosaic.clone().text(0x0019_0010, "LO", "SIEMENS MR HEADER").short(0x0019_100a, &[5]);
    let header = |elements: &[(&str, &[&str])], is_second| {
        let bytes = Value::Bytes(csa(elements, is_second));
        mosaic.clone().text(0x0029_0010, "LO", "SIEMENS CSA HEADER").with(0x0029_1010, "OB", bytes)
    };
    let stated: (&str, &[&str]) = ("NumberOfImagesInMosaic", &["5"]);
    let up: (&str, &[&str]) = ("SliceNormalVector", &["0.0", "0.0", "1.0"]);
    let down: (&str, &[&str]) = ("SliceNormalVector", &["0.0", "0.0", "-1.0"]);
    for (name, elements, origin, numbers) in [
        ("private", &private, -3.0, &expected),
        ("second", &header(&[("EchoLinePosition", &["64"]), stated, up], true), -3.0, &expected),
        ("first", &header(&[up, stated], false), -3.0, &expected),
        ("downwards", &header(&[stated, down], true), -13.0, &reversed),
    ] {
        for syntax in [EXPLICIT, IMPLICIT] {
            let volume = opened(&file(elements, syntax)).unwrap_or_else(|error| panic!("{name}: {error}"));
            assert_eq!((volume.geometry.dims, &stored(&volume)), ([4, 3, 5], numbers), "{name}");
            // Half of the further 8 columns of 0.25 mm and of the further 6 rows of 0.5 mm.
            assert_eq!(volume.geometry.origin.to_array(), [2.0, 3.5, origin], "{name}");
            assert_eq!(volume.geometry.spacing.to_array(), [0.25, 0.5, 2.5], "{name}");
            assert!(says(&volume, "a mosaic of 5 slices of 4×3 pixels"), "{:?}", volume.notes);
        }
    }
    refused(opened(&file(&mosaic, EXPLICIT)), &["ImageType", "MOSAIC", "12×9 pixels", "(0019,100A)", "CSA"]);
    let many = mosaic.clone().short(0x0019_100a, &[17]);
    refused(opened(&file(&many, EXPLICIT)), &["12×9 pixels cannot hold 17 slices in 5 rows"]);
    let cut = csa(&[up, stated], true);
    for length in [0, 3, 8, 12, 20, 100, cut.len() - 70] {
        let part = mosaic.clone().with(0x0029_1010, "OB", Value::Bytes(cut[..length].to_vec()));
        refused(opened(&file(&part, EXPLICIT)), &["MOSAIC"]);
    }
    // Two of them are two volumes.
    let moved = |number: &str| private.clone().text(0x0020_0012, "IS", number);
    refused(folder(&[moved("3"), moved("4")], &Selection::default()), &["2 time steps", "(acquisition 3, 4)"]);
    assert_eq!(stored(&folder(&[moved("3"), moved("4")], &time(1)).unwrap()), expected);
}

#[test]
fn data_sets_of_another_encoding_than_stated_or_without_any_are_read() {
    let elements = |z: f64| slice(z, if z > 0.0 { 1012 } else { 1000 }).text(0x0008_0005, "CS", "ISO_IR 100");
    let bare = |is_implicit, is_big| move |z: f64| elements(z).bytes(is_implicit, is_big);
    let claims = |syntax: &'static str, is_implicit, is_big| {
        move |z: f64| [file(&Elements::default(), syntax), elements(z).bytes(is_implicit, is_big)].concat()
    };
    let explicit_meta = move |z: f64| file(&elements(z), EXPLICIT)[132..].to_vec();
    let cases: [(&str, Bytes, bool); 11] = [
        ("bare implicit", Box::new(bare(true, false)), false),
        ("bare explicit", Box::new(bare(false, false)), false),
        ("bare big", Box::new(bare(false, true)), false),
        ("without preamble", Box::new(explicit_meta), false),
        ("explicit is implicit", Box::new(claims(EXPLICIT, true, false)), true),
        ("implicit is explicit", Box::new(claims(IMPLICIT, false, false)), true),
        ("little is big", Box::new(claims(EXPLICIT, false, true)), true),
        ("big is little", Box::new(claims(BIG, false, false)), true),
        ("big is implicit", Box::new(claims(BIG, true, false)), true),
        (
            "deflated is not",
            Box::new(move |z| {
                let meta = Elements::default().text(0x0002_0010, "UI", DEFLATED).bytes(false, false);
                [vec![0; 128], b"DICM".to_vec(), meta, elements(z).bytes(false, false)].concat()
            }),
            true,
        ),
        ("no uid", Box::new(move |z| [vec![0; 128], b"DICM".to_vec(), elements(z).bytes(true, false)].concat()), false),
    ];
    for (name, bytes, is_wrong) in cases {
        let files = [("one", bytes(0.0)), ("two.ima", bytes(4.0)), ("notes.txt", b"\x08 is no data set".to_vec())];
        let folder = volumes::folder(&files);
        let volume = volume::open(folder.path(), &Selection::default(), &Quiet);
        let volume = volume.unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!((volume.geometry.dims, stored(&volume)), ([4, 3, 2], counted(&[1000, 1012])), "{name}");
        assert_eq!(says(&volume, "the stated transfer syntax"), is_wrong, "{name}: {:?}", volume.notes);
        // A file alone, whose name says nothing.
        let alone = volume::open(&folder.path().join("one"), &Selection::default(), &Quiet).unwrap();
        assert_eq!(stored(&alone), counted(&[1000]), "{name}");
    }
}

#[test]
fn wrong_and_private_transfer_syntaxes_are_read_or_refused_by_name() {
    const GE: &str = "1.2.840.113619.5.2";
    let ge = |is_implicit| {
        let swapped = Value::Bytes((700..712_u16).flat_map(u16::to_be_bytes).collect());
        let elements = slice(0.0, 0).with(0x7fe0_0010, "OW", swapped);
        [file(&Elements::default(), GE), elements.bytes(is_implicit, false)].concat()
    };
    assert_eq!(stored(&opened(&ge(true)).unwrap()), counted(&[700]), "big-endian pixels");
    // Which byte of the pixels comes first is not known.
    refused(opened(&ge(false)), &["TransferSyntaxUID", GE]);
    let private = [file(&Elements::default(), "1.3.46.670589.33.1.4.1"), slice(0.0, 0).bytes(true, false)].concat();
    refused(opened(&private), &["TransferSyntaxUID", "1.3.46.670589.33.1.4.1", "does not decode"]);
    let cut = [file(&Elements::default(), "1.2.3.4"), vec![8, 0, 0x16, 0, b'U', b'I', 90, 0, b'1']].concat();
    refused(opened(&cut), &["TransferSyntaxUID", "1.2.3.4"]);

    let coded =
        |bytes: &[u8]| slice(0.0, 0).with(0x7fe0_0010, "OB", Value::Fragments(vec![Vec::new(), bytes.to_vec()]));
    let jpeg =
        |marker: u8, bits: u8| vec![0xff, 0xd8, 0xff, marker, 0, 11, bits, 0, 3, 0, 4, 1, 1, 0x11, 0, 0xff, 0xd9];
    refused(opened(&file(&coded(&[1; 64]), EXPLICIT)), &["TransferSyntaxUID", EXPLICIT, "in fragments"]);
    refused(opened(&file(&slice(0.0, 0), RLE)), &["24 bytes", "in one piece", RLE]);
    let jpeg_2000 = "1.2.840.10008.1.2.4.90";
    refused(opened(&file(&coded(&jpeg(0xc0, 8)), jpeg_2000)), &["the pixels are JPEG, but", "one of JPEG 2000"]);
    refused(opened(&file(&coded(&jpeg(0xf7, 12)), jpeg_2000)), &["the pixels are JPEG-LS, but"]);
    // 12 bits are not damaged.
    for marker in [0xc1, 0xc2] {
        let bytes = file(&coded(&jpeg(marker, 12)), "1.2.840.10008.1.2.4.51");
        let error = refused(opened(&bytes), &["frame 1", "JPEG with 12 bits by DCT", "convert the file"]);
        assert!(!error.to_string().contains("damaged"), "{error}");
    }
}

#[test]
fn numbers_of_a_wrong_type_are_read() {
    let text = |tag: u32, vr: &str, text: &str| (tag, vr.to_owned(), Value::Text(text.to_owned()));
    let cases = [
        text(0x0028_0030, "UT", "0.7500\\1.250"),
        text(0x0028_0030, "LO", "0.75\\1.25"),
        text(0x0028_0030, "ST", "0.75\\1.25 "),
        text(0x0028_0030, "OB", "0.75\\1.25"),
        text(0x0028_0030, "UN", "0.75\\1.25"),
        (0x0028_0030, "FD".to_owned(), Value::Double(vec![0.75, 1.25])),
    ];
    for (tag, vr, value) in cases {
        let volume = opened(&file(&slice(0.0, 0).with(tag, &vr, value), EXPLICIT)).unwrap();
        assert_eq!(volume.geometry.spacing.to_array(), [1.25, 0.75, 2.0], "{vr}");
    }
    let wrong = slice(0.0, 0)
        .text(0x0020_0032, "UT", "3\\4\\5.5")
        .text(0x0020_0037, "LT", "1\\0\\0\\0\\1\\0")
        .text(0x0028_0010, "IS", "3")
        .with(0x0028_0011, "UL", Value::Long(vec![4]))
        .text(0x0028_1053, "LO", "0.5");
    let volume = opened(&file(&wrong, EXPLICIT)).unwrap();
    assert_eq!((volume.geometry.origin.to_array(), volume.slope), ([3.0, 4.0, 5.5], 0.5));
    refused(opened(&file(&slice(0.0, 0).text(0x0028_0030, "UT", "half"), EXPLICIT)), &["PixelSpacing", "NaN"]);
}

#[test]
fn equal_identifiers_at_different_places_are_no_copies() {
    let same = |z: f64, first: u16| slice(z, first).text(0x0008_0018, "UI", "1.9");
    let volume = folder(&[same(0.0, 0), same(2.0, 12), same(4.0, 24), same(2.0, 12)], &Selection::default()).unwrap();
    assert_eq!(stored(&volume), counted(&[0, 12, 24]));
    assert!(says(&volume, "2 files have the SOPInstanceUID of another file"), "{:?}", volume.notes);
    assert!(says(&volume, "1 file is a copy of another"), "{:?}", volume.notes);
}

#[test]
fn planes_of_an_ultrasound_volume_lie_in_the_volume() {
    let plane = |z: f64| {
        let position = Elements::default().with(0x0020_9301, "FD", Value::Double(vec![1.0, -2.0, z]));
        let turn = Elements::default().with(0x0020_9302, "FD", Value::Double(vec![0.0, 1.0, 0.0, -1.0, 0.0, 0.0]));
        Elements::default().items(0x0020_930e, vec![position]).items(0x0020_930f, vec![turn])
    };
    let elements = enhanced([2.5, 0.0, 1.25].map(plane).to_vec()).without(0x0020_0037);
    let volume = opened(&file(&elements, EXPLICIT)).unwrap();
    assert_eq!((stored(&volume), volume.geometry.dims), (counted(&[12, 24, 0]), [4, 3, 3]));
    assert_eq!((volume.geometry.origin.to_array(), volume.geometry.spacing.z), ([1.0, -2.0, 0.0], 1.25));
    assert_eq!(volume.geometry.direction.x_axis.to_array(), [0.0, 1.0, 0.0]);
    assert!(!volume.anatomical, "the axes are those of the probe");
}

#[test]
fn spacings_of_the_detector_stand_in_with_a_note() {
    for (tag, keyword) in [(0x0018_1164, "ImagerPixelSpacing"), (0x0018_2010, "NominalScannedPixelSpacing")] {
        let elements = slice(0.0, 0).without(0x0028_0030).text(tag, "DS", "0.375\\0.625");
        let volume = opened(&file(&elements, EXPLICIT)).unwrap();
        assert_eq!(volume.geometry.spacing.to_array(), [0.625, 0.375, 2.0]);
        assert!(says(&volume, keyword) && !says(&volume, "1 mm"), "{:?}", volume.notes);
        let both = opened(&file(&slice(0.0, 0).text(tag, "DS", "7\\9"), EXPLICIT)).unwrap();
        assert!(both.geometry.spacing.x == 0.25 && !says(&both, keyword), "{:?}", both.notes);
    }
}

#[test]
fn real_world_values_are_used_or_told() {
    let mapping = |slope: f64, intercept: f64, name: &str| {
        Elements::default()
            .with(0x0040_9224, "FD", Value::Double(vec![intercept]))
            .with(0x0040_9225, "FD", Value::Double(vec![slope]))
            .text(0x0040_9210, "SH", name)
            .items(0x0040_08ea, vec![Elements::default().text(0x0008_0100, "SH", "mm2/s")])
    };
    let one = || vec![mapping(0.25, -1.5, "ADC")];
    let told = |volume: &Volume, words: &str| {
        volume.metadata.iter().any(|(key, value)| key == "real-world values" && value.contains(words))
    };
    let volume = opened(&file(&slice(0.0, 6).items(0x0040_9096, one()), EXPLICIT)).unwrap();
    assert_eq!((volume.value([0, 0, 0]), volume.slope), (Some(0.0), 0.25));
    assert!(says(&volume, "ADC = 0.25 × stored − 1.5 (mm2/s)") && told(&volume, "ADC"), "{:?}", volume.notes);
    // In functional groups.
    let frames = [0.0, 2.0].map(|z| place(z).items(0x0040_9096, one())).to_vec();
    assert_eq!(opened(&file(&enhanced(frames), EXPLICIT)).unwrap().value([0, 0, 1]), Some(1.5));
    // A scaling of the file, or several mappings: they are told.
    let scaled = slice(0.0, 6).text(0x0028_1053, "DS", "2").items(0x0040_9096, one());
    let volume = opened(&file(&scaled, EXPLICIT)).unwrap();
    assert_eq!(volume.value([0, 0, 0]), Some(12.0));
    assert!(says(&volume, "does not use: ADC") && told(&volume, "ADC"), "{:?}", volume.notes);
    let two = slice(0.0, 6).items(0x0040_9096, vec![mapping(0.25, 1.0, "ADC"), mapping(3.0, 0.0, "T2")]);
    let volume = opened(&file(&two, EXPLICIT)).unwrap();
    assert!(volume.slope == 1.0 && says(&volume, "T2 = 3 × stored + 0"), "{:?}", volume.notes);
}

#[test]
fn no_value_between_padding_and_voxels_arises() {
    // Slices that lean by 3 mm in 4 mm, and one of two rows of padding; values are from 1000 on, padding is 20 or below.
    let leaning = |index: u16| {
        let numbers = (0..12).map(|pixel: u16| match pixel / 4 {
            0 => 20,
            1 => 11 + pixel,
            _ => 1000 + 10 * index + pixel,
        });
        slice(0.0, 0)
            .text(0x0020_0032, "DS", &format!("0\\{}\\{}", f64::from(index) * 0.75, f64::from(index)))
            .text(0x0028_0030, "DS", "0.5\\0.5")
            .short(0x0028_0120, &[20])
            .short(0x0028_0121, &[11])
            .with(0x7fe0_0010, "OW", Value::Short(numbers.collect()))
    };
    let all: Vec<Elements> = (0..5).map(leaning).collect();
    let between = |volume: &Volume| stored(volume).into_iter().any(|number| number > 20.0 && number < 1000.0);
    let volume = folder(&all, &resampled()).unwrap();
    assert!(!between(&volume) && stored(&volume).iter().any(|&number| number >= 1000.0), "{:?}", stored(&volume));
    // A missing slice.
    let gap: Vec<Elements> = [0, 1, 3, 4]
        .map(|index| {
            let place = format!("0\\0\\{}", f64::from(index));
            leaning(index).text(0x0020_0032, "DS", &place).short(0x0028_0120, &[if index == 3 { 1038 } else { 20 }])
        })
        .to_vec();
    let volume = folder(&gap, &resampled()).unwrap();
    assert!(volume.geometry.dims == [4, 3, 5] && !between(&volume), "{:?}", stored(&volume));
}
