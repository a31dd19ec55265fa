//! `NumPy` arrays and archives: those of the shared folder, and generated ones of every type, order and version; invalid
//! files.
#![expect(clippy::cast_possible_truncation, reason = "lengths are small")]
#![expect(clippy::cast_possible_wrap, clippy::cast_lossless, trivial_numeric_casts, reason = "one macro for all types")]

use crate::support::volumes;

use std::io::Write as _;

use flate2::Compression;
use flate2::write::DeflateEncoder;
use glam::DVec3;
use relume::volume::{Selection, Volume, VolumeError, Voxels};

#[test]
fn every_shared_file_reads_as_an_independent_reader_found_it() {
    volumes::check_below("numpy/", 4);
}

/// An array with this text as its header.
fn npy(version: u8, text: &str, data: &[u8]) -> Vec<u8> {
    let mut bytes = b"\x93NUMPY".to_vec();
    bytes.extend([version, 0]);
    let length = text.len() + 1;
    match version {
        1 => bytes.extend((length as u16).to_le_bytes()),
        _ => bytes.extend((length as u32).to_le_bytes()),
    }
    bytes.extend(text.as_bytes());
    bytes.push(b'\n');
    bytes.extend(data);
    bytes
}

fn header(descr: &str, fortran: &str, shape: &str) -> String {
    format!("{{'descr': {descr}, 'fortran_order': {fortran}, 'shape': {shape}, }}")
}

fn open_named(name: &str, bytes: &[u8], selection: &Selection) -> Result<Volume, VolumeError> {
    volumes::opened(name, bytes, selection)
}

fn open(bytes: &[u8]) -> Result<Volume, VolumeError> {
    open_named("v.npy", bytes, &Selection::default())
}

fn refused(bytes: &[u8], words: &[&str]) {
    volumes::refused(open(bytes), &[&["v.npy"], words].concat());
}

const TWELVE: [u8; 12] = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12];

#[test]
fn every_type_is_read_in_both_byte_orders() {
    macro_rules! check {
        ($($type:ident $variant:ident $code:literal;)*) => {$({
            let mut values: Vec<$type> = (1..13_u8).map(|i| i as $type).collect();
            (values[1], values[2]) = ($type::MIN, $type::MAX);
            for big in [false, true] {
                let bytes: Vec<u8> = values
                    .iter()
                    .flat_map(|value| if big { value.to_be_bytes() } else { value.to_le_bytes() })
                    .collect();
                let descr = format!("'{}{}'", if big { '>' } else { '<' }, $code);
                let volume = open(&npy(1, &header(&descr, "False", "(2, 2, 3)"), &bytes)).unwrap();
                assert!(volume.voxels == Voxels::$variant(values.clone()), "{descr}");
                assert_eq!(volume.geometry.dims, [3, 2, 2]);
            }
        })*};
    }
    check! {
        u8 U8 "u1"; i8 I8 "i1"; u16 U16 "u2"; i16 I16 "i2"; u32 U32 "u4"; i32 I32 "i4"; u64 U64 "u8"; i64 I64 "i8";
        f32 F32 "f4"; f64 F64 "f8";
    }
    let halves: Vec<u8> = (0..12_u8).flat_map(|i| half::f16::from_f32(f32::from(i) / 8.0).to_be_bytes()).collect();
    let volume = open(&npy(1, &header("'>f2'", "False", "(2, 2, 3)"), &halves)).unwrap();
    assert_eq!(volume.voxels, Voxels::F32((0..12_u8).map(|i| f32::from(i) / 8.0).collect()));
    let volume = open(&npy(1, &header("'|b1'", "False", "(2, 2, 3)"), &[1; 12])).unwrap();
    assert_eq!((volume.voxels, volume.has_labels), (Voxels::U8(vec![1; 12]), true));
    for descr in ["'|u1'", "\"|u1\"", "'u1'"] {
        assert_eq!(open(&npy(1, &header(descr, "False", "(2, 2, 3)"), &TWELVE)).unwrap().voxels.bytes(), TWELVE);
    }
}

#[test]
fn every_version_and_any_order_of_keys_is_read() {
    let texts = [
        header("'|u1'", "False", "(2, 2, 3)"),
        "{'shape':(2,2,3),'fortran_order':False,'descr':'|u1'}".to_owned(),
        "{'fortran_order': False, 'other': [1, (2, 3)], 'shape': (2L, 2L, 3L), 'descr': '|u1', }   ".to_owned(),
    ];
    for (version, text) in [1, 2, 3].iter().flat_map(|version| texts.iter().map(move |text| (*version, text))) {
        let volume = open(&npy(version, text, &TWELVE)).unwrap();
        assert_eq!((volume.voxels.bytes(), volume.geometry.dims), (&TWELVE[..], [3, 2, 2]), "{version}: {text}");
        assert_eq!((volume.geometry.spacing, volume.unit), (DVec3::ONE, None));
        assert!(volume.notes[0].contains("no spacing"), "{:?}", volume.notes);
    }
    let by_content = open_named("v", &npy(1, &texts[0], &TWELVE), &Selection::default()).unwrap();
    assert_eq!(by_content.voxels.bytes(), TWELVE);
}

#[test]
fn the_last_index_is_x_whichever_order_the_numbers_have() {
    // a[z, y, x] = 100 z + 10 y + x.
    let value = |[x, y, z]: [usize; 3]| (100 * z + 10 * y + x) as u8;
    let [nx, ny, nz] = [4, 3, 2];
    let c: Vec<u8> = (0..nx * ny * nz).map(|i| value([i % nx, i / nx % ny, i / (nx * ny)])).collect();
    let fortran: Vec<u8> = (0..nx * ny * nz).map(|i| value([i / (nz * ny), i / nz % ny, i % nz])).collect();
    for (order, data) in [("False", c), ("True", fortran)] {
        let volume = open(&npy(1, &header("'|u1'", order, "(2, 3, 4)"), &data)).unwrap();
        assert_eq!(volume.geometry.dims, [nx, ny, nz]);
        for index in (0..nx).flat_map(|x| (0..ny).flat_map(move |y| (0..nz).map(move |z| [x, y, z]))) {
            assert_eq!(volume.value(index), Some(f64::from(value(index))), "{order}: {index:?}");
        }
    }
}

#[test]
fn more_axes_are_components_and_times_once_they_are_stated() {
    // a[t, c, z, y, x] = 100 t + 50 c + 20 z + 5 y + x.
    let sides = [2, 2, 2, 3, 4];
    let value = |[t, c, z, y, x]: [usize; 5]| (100 * t + 50 * c + 20 * z + 5 * y + x) as u8;
    let index = |mut number: usize, order: [usize; 5]| {
        let mut index = [0; 5];
        for axis in order {
            (index[axis], number) = (number % sides[axis], number / sides[axis]);
        }
        index
    };
    let all = |order| (0..96).map(|number| value(index(number, order))).collect::<Vec<u8>>();
    for (order, data) in [("False", all([4, 3, 2, 1, 0])), ("True", all([0, 1, 2, 3, 4]))] {
        let bytes = npy(1, &header("'|u1'", order, "(2, 2, 2, 3, 4)"), &data);
        let select = |component, time| {
            let axes = Some("tczyx".to_owned());
            open_named("v.npy", &bytes, &Selection { component, time, axes, ..Selection::default() })
        };
        for (t, c) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let volume = select(Some(c), Some(t)).unwrap();
            assert_eq!((volume.geometry.dims, volume.components), ([4, 3, 2], 2));
            for [x, y, z] in [[0, 0, 0], [3, 0, 0], [0, 2, 0], [0, 0, 1], [2, 1, 1]] {
                assert_eq!(volume.value([x, y, z]), Some(f64::from(value([t, c, z, y, x]))), "{order}: {t}, {c}");
            }
        }
        volumes::refused(select(None, Some(0)), &["2 components"]);
        volumes::refused(select(Some(0), None), &["2 time steps"]);
    }
    let three = npy(1, &header("'|u1'", "False", "(2, 2, 3)"), &TWELVE);
    for (letters, words) in
        [("czyx", "the axes czyx are 4, but the array has 3"), ("zqx", "letter q"), ("zzx", "axis 1")]
    {
        let selection = Selection { axes: Some(letters.to_owned()), ..Selection::default() };
        volumes::refused(open_named("v.npy", &three, &selection), &["v.npy", words]);
    }
}

#[test]
fn pictures_lines_and_axes_of_one_voxel_are_volumes_and_four_axes_are_refused() {
    for (shape, dims) in [
        ("(3, 4)", [4, 3, 1]),
        ("(12,)", [12, 1, 1]),
        ("(12, 1, 1)", [1, 1, 12]),
        ("(1, 2, 1, 3, 2)", [2, 3, 2]),
        ("(1, 1, 12, 1)", [12, 1, 1]),
    ] {
        let volume = open(&npy(1, &header("'|u1'", "False", shape), &TWELVE)).unwrap();
        assert_eq!((volume.geometry.dims, volume.voxels.bytes()), (dims, &TWELVE[..]), "{shape}");
    }
    refused(&npy(1, &header("'|u1'", "False", "(2, 1, 2, 3, 2)"), &[0; 24]), &["2×1×2×3×2", "state the axes"]);
    refused(&npy(1, &header("'|u1'", "False", "()"), &[0]), &["shape is ()"]);
    refused(&npy(1, &header("'|u1'", "False", "(2, 0, 3)"), &TWELVE), &["(2, 0, 3)"]);
}

#[test]
fn headers_of_no_numbers_are_refused_by_name() {
    for (descr, word) in [
        ("'|O'", "objects"),
        ("'<U5'", "strings"),
        ("'|S5'", "strings"),
        ("[('a', '<i2'), ('b', '<f4')]", "structures"),
        ("'|V8'", "structures"),
        ("'<c8'", "complex"),
        ("'<M8[ns]'", "times"),
        ("'<f16'", "another size"),
        ("'<q'", "not a number type"),
    ] {
        refused(&npy(1, &header(descr, "False", "(2, 2, 3)"), &[0; 300]), &["descr", word]);
    }
}

#[test]
fn damaged_headers_are_refused_with_the_numbers() {
    let text = header("'|u1'", "False", "(2, 2, 3)");
    refused(b"\x93NUMPY\x01", &["7 bytes"]);
    refused(&npy(4, &text, &TWELVE), &["version 4"]);
    refused(&npy(1, "{'descr': '|u1', 'shape': (1,)}", &TWELVE), &["fortran_order is missing"]);
    refused(&npy(1, &header("'|u1'", "Maybe", "(1,)"), &TWELVE), &["Maybe"]);
    refused(&npy(1, &header("'|u1'", "False", "12"), &TWELVE), &["shape is 12"]);
    refused(&npy(1, &header("'|u1'", "False", "(a, 3)"), &TWELVE), &["(a, 3)"]);
    refused(&npy(1, &header("'|u1'", "False", "(-2, 3)"), &TWELVE), &["(-2, 3)"]);
    refused(&npy(1, "words", &TWELVE), &["words"]);
    refused(&npy(1, "{'descr': '|u1'", &TWELVE), &["dictionary"]);
    refused(&npy(2, &" ".repeat(1 << 17), &TWELVE), &["131073", "65536"]);
    refused(&npy(2, &text, &TWELVE)[..40], &["28 bytes of text"]);
    refused(&npy(1, &text, &TWELVE[..11]), &["11 bytes", "12"]);
    refused(&npy(1, &header("'<f8'", "False", "(60000, 60000, 60000)"), &TWELVE), &["12 bytes", "1728000000000000"]);
    refused(&npy(1, &header("'|u1'", "True", "(99999999999, 99999999999)"), &TWELVE), &["99999999999×99999999999"]);
    let longer = open(&npy(1, &text, &[0; 14])).unwrap();
    assert!(longer.notes.iter().any(|note| note.contains("14 bytes")), "{:?}", longer.notes);
}

/// A member of an archive: name, content, and whether it is deflated.
type Member<'a> = (&'a str, Vec<u8>, bool);

/// A ZIP archive, as its application note describes it.
fn zip(members: &[Member<'_>]) -> Vec<u8> {
    let (mut bytes, mut table) = (Vec::new(), Vec::new());
    for (name, content, deflated) in members {
        let mut crc = flate2::Crc::new();
        crc.update(content);
        let packed = if *deflated {
            let mut encoder = DeflateEncoder::new(Vec::new(), Compression::default());
            encoder.write_all(content).unwrap();
            encoder.finish().unwrap()
        } else {
            content.clone()
        };
        let mut common = vec![20, 0, 0, 0, if *deflated { 8 } else { 0 }, 0, 0, 0, 0x21, 0];
        common.extend(crc.sum().to_le_bytes());
        common.extend((packed.len() as u32).to_le_bytes());
        common.extend((content.len() as u32).to_le_bytes());
        common.extend((name.len() as u16).to_le_bytes());
        common.extend([0, 0]);
        table.extend(b"PK\x01\x02\x14\x00");
        table.extend(&common);
        table.extend([0; 10]);
        table.extend((bytes.len() as u32).to_le_bytes());
        table.extend(name.as_bytes());
        bytes.extend(b"PK\x03\x04");
        bytes.extend(&common);
        bytes.extend(name.as_bytes());
        bytes.extend(packed);
    }
    let (at, count) = ((bytes.len() as u32).to_le_bytes(), (members.len() as u16).to_le_bytes());
    bytes.extend(&table);
    bytes.extend(b"PK\x05\x06\0\0\0\0");
    bytes.extend(count);
    bytes.extend(count);
    bytes.extend((table.len() as u32).to_le_bytes());
    bytes.extend(at);
    bytes.extend([0, 0]);
    bytes
}

#[test]
fn the_arrays_of_an_archive_are_chosen_by_name() {
    let array = |first: u8| npy(1, &header("'|u1'", "False", "(2, 2, 3)"), &TWELVE.map(|byte| byte + first));
    for deflated in [false, true] {
        let one = zip(&[("ct.npy", array(0), deflated), ("readme.txt", b"words".to_vec(), false)]);
        for name in ["v.npz", "v.data"] {
            let volume = open_named(name, &one, &Selection::default()).unwrap();
            assert_eq!(volume.voxels.bytes(), TWELVE, "{name}, deflated: {deflated}");
            assert_eq!(volume.notes.len(), 1, "{:?}", volume.notes);
        }
        let two = zip(&[("ct.npy", array(0), deflated), ("pet.npy", array(50), deflated)]);
        let error = open_named("v.npz", &two, &Selection::default()).map(drop).unwrap_err();
        assert!(matches!(error, VolumeError::Choose { .. }) && error.to_string().contains("ct, pet"), "{error}");
        let pet = Selection { array: Some("pet".to_owned()), ..Selection::default() };
        assert_eq!(open_named("v.npz", &two, &pet).unwrap().voxels.bytes(), TWELVE.map(|byte| byte + 50));
        let other = Selection { array: Some("mr".to_owned()), ..Selection::default() };
        let error = open_named("v.npz", &two, &other).map(drop).unwrap_err();
        assert!(matches!(error, VolumeError::NoSuch { .. }), "{error}");
    }
}

#[test]
fn archives_that_lie_are_refused() {
    let open = |bytes: &[u8]| {
        volumes::whole_message(&open_named("v.npz", bytes, &Selection::default()).map(drop).unwrap_err())
    };
    let text = header("'|u1'", "False", "(2, 2, 3)");
    let none = open(&zip(&[("readme.txt", b"words".to_vec(), false)]));
    assert!(none.contains("none of its 1 files"), "{none}");
    assert!(open(b"PK\x03\x04").contains("not a ZIP archive"));
    let short = open(&zip(&[("a.npy", npy(1, &text, &TWELVE[..11]), true)]));
    assert!(short.contains("11 bytes") && short.contains("12"), "{short}");
    let huge = npy(1, &header("'<f8'", "False", "(60000, 60000, 60000)"), &TWELVE);
    let message = open(&zip(&[("a.npy", huge, true)]));
    assert!(message.contains("1728000000000000"), "{message}");
    let objects = open(&zip(&[("a.npy", npy(1, &header("'|O'", "False", "(1,)"), &TWELVE), true)]));
    assert!(objects.contains("header of a") && objects.contains("objects"), "{objects}");
    // A wrong checksum, which is in both tables.
    let mut damaged = zip(&[("a.npy", npy(1, &text, &TWELVE), true)]);
    let table = damaged.windows(4).position(|four| four == b"PK\x01\x02").unwrap();
    for at in [14, table + 16] {
        damaged[at] ^= 1;
    }
    let message = open(&damaged);
    assert!(message.contains("damaged deflate") && message.contains("checksum"), "{message}");
    // A wrong voxel of an array that is only stored.
    let mut damaged = zip(&[("a.npy", npy(1, &text, &TWELVE), false)]);
    let voxels = damaged.windows(12).position(|twelve| twelve == TWELVE).unwrap();
    damaged[voxels] ^= 1;
    let message = open(&damaged);
    assert!(message.contains("v.npz, a: the array is damaged") && message.contains("checksum"), "{message}");
}
