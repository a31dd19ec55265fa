//! Legacy VTK files: those of the shared folder, and generated ones of every type, attribute and spelling; invalid files.
#![expect(clippy::cast_lossless, trivial_numeric_casts, reason = "one macro for all types")]

use crate::support::volumes;

use glam::DVec3;
use relume::volume::{Selection, Volume, VolumeError, Voxels};

#[test]
fn every_shared_file_reads_as_an_independent_reader_found_it() {
    volumes::check_below("vtk/", 4);
}

fn select(bytes: &[u8], selection: &Selection) -> Result<Volume, VolumeError> {
    volumes::opened("v.vtk", bytes, selection)
}

fn open(bytes: &[u8]) -> Result<Volume, VolumeError> {
    select(bytes, &Selection::default())
}

fn array(name: &str) -> Selection {
    Selection { array: Some(name.to_owned()), ..Selection::default() }
}

fn component(component: usize) -> Selection {
    Selection { component: Some(component), ..Selection::default() }
}

fn refused(bytes: &[u8], words: &[&str]) {
    volumes::refused(open(bytes), &[&["v.vtk"], words].concat());
}

/// A grid of 3×2×2 points, and text behind it.
fn ascii(text: &str) -> Vec<u8> {
    let grid = "DATASET STRUCTURED_POINTS\nDIMENSIONS 3 2 2\nORIGIN -1 2 3\nSPACING 0.5 0.75 2\n";
    format!("# vtk DataFile Version 3.0\na title\nASCII\n{grid}{text}").into_bytes()
}

/// The same with binary values: parts of text and values, one after the other.
fn binary(parts: &[(&str, &[u8])]) -> Vec<u8> {
    let mut bytes = ascii("");
    let at = bytes.windows(5).position(|five| five == b"ASCII").unwrap();
    bytes.splice(at..at + 5, *b"BINARY");
    for (text, values) in parts {
        bytes.extend(text.as_bytes());
        bytes.extend(*values);
    }
    bytes
}

const TWELVE: [u8; 12] = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12];
const NUMBERS: &str = "1 2 3 4 5 6 7 8 9 10 11 12\n";

#[test]
fn every_type_is_read_as_text_and_as_big_endian_numbers() {
    macro_rules! check {
        ($($type:ident $variant:ident $names:expr;)*) => {$({
            let mut values: Vec<$type> = (1..13_u8).map(|i| i as $type).collect();
            (values[1], values[2]) = ($type::MIN, $type::MAX);
            let text: String = values.iter().map(|value| format!("{value} ")).collect();
            let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_be_bytes()).collect();
            for name in $names {
                let head = format!("POINT_DATA 12\nSCALARS v {name} 1\nLOOKUP_TABLE default\n");
                let expected = Voxels::$variant(values.clone());
                assert!(open(&ascii(&format!("{head}{text}"))).unwrap().voxels == expected, "{name}, text");
                assert!(open(&binary(&[(&head, &bytes)])).unwrap().voxels == expected, "{name}, binary");
            }
        })*};
    }
    check! {
        u8 U8 ["unsigned_char", "vtktypeuint8"];
        i8 I8 ["char", "signed_char", "vtktypeint8"];
        u16 U16 ["unsigned_short", "vtktypeuint16"];
        i16 I16 ["short", "SHORT", "vtktypeint16"];
        u32 U32 ["unsigned_int", "vtktypeuint32"];
        i32 I32 ["int", "vtktypeint32"];
        u64 U64 ["unsigned_long", "vtktypeuint64"];
        i64 I64 ["long", "vtktypeint64", "vtkIdType"];
        f32 F32 ["float"];
        f64 F64 ["double"];
    }
    let bits = [0b1010_0110, 0b1101_0000];
    let expected = Voxels::U8(vec![1, 0, 1, 0, 0, 1, 1, 0, 1, 1, 0, 1]);
    let head = "POINT_DATA 12\nSCALARS v bit\nLOOKUP_TABLE default\n";
    let volume = open(&binary(&[(head, &bits)])).unwrap();
    assert_eq!((volume.voxels, volume.has_labels), (expected.clone(), true), "eight to a byte");
    assert_eq!(open(&ascii(&format!("{head}1 0 1 0 0 1 1 0 1 1 0 1"))).unwrap().voxels, expected);
}

#[test]
fn the_grid_is_read_in_any_order_and_spelling() {
    let volume = open(&ascii(&format!("POINT_DATA 12\nSCALARS v char\nLOOKUP_TABLE default\n{NUMBERS}"))).unwrap();
    assert_eq!(volume.geometry.dims, [3, 2, 2]);
    assert_eq!(
        (volume.geometry.origin, volume.geometry.spacing),
        (DVec3::new(-1.0, 2.0, 3.0), DVec3::new(0.5, 0.75, 2.0))
    );
    assert_eq!((volume.anatomical, volume.unit), (false, None));
    assert!(volume.metadata.contains(&("title".to_owned(), "a title".to_owned())) && volume.notes.is_empty());
    let text = "# vtk DataFile Version 1.0\r\n\r\nascii\r\n\r\nDataset\tStructured_Points\r\nAspect_Ratio 1\r\n2\t4\r\n\
                Origin 0 0 0\r\ndimensions 3 2\r\n 2 Point_Data 12 scalars v unsigned_char\r\nlookup_table default\r\n\
                1 2 3\r\n\r\n4 5 6 7 8 9 10 11 12\r\n";
    let volume = open(text.as_bytes()).unwrap();
    assert_eq!((volume.voxels.bytes(), volume.geometry.spacing), (&TWELVE[..], DVec3::new(1.0, 2.0, 4.0)));
}

#[test]
fn values_of_cells_lie_half_a_spacing_inside() {
    let volume = open(&ascii("CELL_DATA 2\nSCALARS v char\nLOOKUP_TABLE default\n1 2\n")).unwrap();
    assert_eq!(volume.geometry.dims, [2, 1, 1]);
    assert_eq!(volume.geometry.origin, DVec3::new(-0.75, 2.375, 4.0));
    assert!(volume.notes[0].contains("CELL_DATA"), "{:?}", volume.notes);
    let both =
        "CELL_DATA 2\nSCALARS v char\nLOOKUP_TABLE default\n1 2\nPOINT_DATA 12\nSCALARS v char\nLOOKUP_TABLE d\n";
    let both = ascii(&format!("{both}{NUMBERS}"));
    assert_eq!(open(&both).unwrap().voxels.len(), 12, "the points, without a choice");
    assert_eq!(select(&both, &array("CELL_DATA/v")).unwrap().voxels.len(), 2);
}

#[test]
fn vectors_fields_colours_and_tables_are_found_and_skipped() {
    let halves: Vec<u8> = (0..36_u8).flat_map(|i| f32::from(i).to_be_bytes()).collect();
    let file = binary(&[
        ("FIELD before 1\nTIME 1 1 double\n", &7.0_f64.to_be_bytes()),
        ("\nPOINT_DATA 12\nVECTORS flow float\n", &halves),
        ("\nSCALARS density unsigned_char 1\nLOOKUP_TABLE own\n", &TWELVE),
        ("\nLOOKUP_TABLE own 2\n", b"\x0a\x20\x0a\x20abcd"),
        ("\nCOLOR_SCALARS paint 3\n", &[5; 36]),
        ("\nMETADATA\nINFORMATION 1\nNAME L2\n\nFIELD more 2\nwith%20blank 1 12 unsigned_char\n", &TWELVE),
        ("\nMETADATA\nINFORMATION 0\n\nlast 2 12 unsigned_char\n", &[3; 24]),
        ("\nNORMALS up float\n", &halves),
    ]);
    let volume = open(&file).unwrap();
    assert_eq!((volume.voxels.bytes(), volume.selection.array), (&TWELVE[..], Some("density".to_owned())));
    assert!(volume.notes.is_empty(), "{:?}", volume.notes);
    assert_eq!(select(&file, &array("with blank")).unwrap().voxels.bytes(), TWELVE);
    let chosen = Selection { component: Some(2), ..array("flow") };
    let volume = select(&file, &chosen).unwrap();
    assert_eq!((volume.components, volume.value([1, 0, 0])), (3, Some(5.0)));
    let error = select(&file, &array("last")).map(drop).unwrap_err();
    assert!(error.to_string().contains("2 components"), "{error}");
    let paint = Selection { component: Some(0), ..array("paint") };
    assert_eq!(select(&file, &paint).unwrap().voxels, Voxels::U8(vec![5; 12]));
    let asks = Selection { asks: true, ..Selection::default() };
    let error = select(&file, &asks).map(drop).unwrap_err().to_string();
    assert!(error.contains("flow, density, paint, with blank, last, up"), "{error}");
    let error = select(&file, &array("TIME")).map(drop).unwrap_err();
    assert!(matches!(error, VolumeError::NoSuch { .. }), "values of no grid: {error}");

    let text = ascii("POINT_DATA 12\nCOLOR_SCALARS paint 1\n0 0.5 1 0 0 0 0 0 0 0 0 0.25\nTENSORS t float\n");
    let text = [text, "1 0 0 0 1 0 0 0 1\n".repeat(12).into_bytes()].concat();
    let volume = select(&text, &array("paint")).unwrap();
    assert_eq!((volume.value([1, 0, 0]), volume.value([2, 1, 1])), (Some(0.5), Some(0.25)), "colours as text");
    let tensor = Selection { component: Some(4), ..array("t") };
    assert_eq!(select(&text, &tensor).unwrap().value([2, 1, 1]), Some(1.0));
    // Without a table, the values begin at once.
    let plain = ascii(&format!("POINT_DATA 12\nSCALARS v unsigned_char\n{NUMBERS}"));
    assert_eq!(open(&plain).unwrap().voxels.bytes(), TWELVE);
    let three = ascii(&format!("POINT_DATA 4\nSCALARS v unsigned_char 3\nLOOKUP_TABLE d\n{NUMBERS}"));
    let three = String::from_utf8(three).unwrap().replace("3 2 2", "2 2 1");
    assert_eq!(select(three.as_bytes(), &component(1)).unwrap().voxels, Voxels::U8(vec![2, 5, 8, 11]));
}

fn rectilinear(x: &str) -> Vec<u8> {
    let axes = format!("X_COORDINATES 3 float\n{x}\nY_COORDINATES 2 double\n5 7\nZ_COORDINATES 2 int\n-4 -1\n");
    let text = format!("# vtk DataFile Version 3.0\n\nASCII\nDATASET RECTILINEAR_GRID\nDIMENSIONS 3 2 2\n{axes}");
    format!("{text}POINT_DATA 12\nSCALARS v unsigned_char\nLOOKUP_TABLE d\n{NUMBERS}").into_bytes()
}

#[test]
fn a_rectilinear_grid_is_read_if_it_is_even() {
    let volume = open(&rectilinear("1 1.5 2")).unwrap();
    let geometry = volume.geometry;
    assert_eq!((geometry.origin, geometry.spacing), (DVec3::new(1.0, 5.0, -4.0), DVec3::new(0.5, 2.0, 3.0)));
    assert_eq!(volume.voxels.bytes(), TWELVE);
    refused(&rectilinear("1 1.6 2"), &["X_COORDINATES are not even", "1.6", "1.5"]);
    refused(&rectilinear("1 nan 2"), &["not even"]);
    refused(&rectilinear("1 1 1"), &["spacing is 0"]);
    let text = String::from_utf8(rectilinear("1 1.5 2")).unwrap().replace("DIMENSIONS 3", "DIMENSIONS 4");
    refused(text.as_bytes(), &["3 X_COORDINATES", "4"]);
    let text = String::from_utf8(rectilinear("1 1.5 2")).unwrap();
    let absurd = text.replace("X_COORDINATES 3", "X_COORDINATES 9223372036854775807");
    refused(absurd.as_bytes(), &["9223372036854775807 X_COORDINATES", "DIMENSIONS states 3"]);
}

#[test]
fn a_long_axis_is_uneven_if_a_point_is_off_by_part_of_a_step() {
    let line = |points: &[f64]| {
        let x: String = points.iter().map(|point| format!("{point} ")).collect();
        let head = "# vtk DataFile Version 3.0\n\nASCII\nDATASET RECTILINEAR_GRID\nDIMENSIONS 4096 1 1\n";
        let axes = format!("X_COORDINATES 4096 float\n{x}\nY_COORDINATES 1 float\n0\nZ_COORDINATES 1 float\n0\n");
        let values = "1 ".repeat(4096);
        format!("{head}{axes}POINT_DATA 4096\nSCALARS v unsigned_char\nLOOKUP_TABLE d\n{values}").into_bytes()
    };
    let mut points: Vec<f64> = (0..4096).map(|i| 0.1 * f64::from(i) + 500.0).collect();
    assert_eq!(open(&line(&points)).unwrap().geometry.dims, [4096, 1, 1], "rounded to 32 bits");
    points[2000] += 0.03;
    refused(&line(&points), &["X_COORDINATES are not even", "point 2000", "limit: 1.9e-3"]);
}

#[test]
fn an_array_without_components_is_refused() {
    for components in ["0", "65537"] {
        let text = format!("POINT_DATA 12\nFIELD more 1\nempty {components} 12 unsigned_char\n");
        refused(&ascii(&text), &["\"empty\"", &format!("{components} components")]);
    }
}

#[test]
fn files_that_contradict_themselves_are_refused_with_the_numbers() {
    let head = "POINT_DATA 12\nSCALARS v short 1\nLOOKUP_TABLE default\n";
    refused(&ascii(&format!("{head}1 2 3")), &["v", "3 of 12"]);
    refused(&ascii(&format!("{head}{}", NUMBERS.replace('5', "five"))), &["five"]);
    refused(&ascii(&format!("{head}{}", NUMBERS.replace('5', "70000"))), &["70000", "int16"]);
    refused(&binary(&[(head, &TWELVE)]), &["24 bytes", "12 more"]);
    refused(&ascii("POINT_DATA 5\nSCALARS v char\nLOOKUP_TABLE d\n1 2 3 4 5"), &["5 values", "3×2×2"]);
    refused(&ascii(""), &["neither POINT_DATA nor CELL_DATA"]);
    refused(&ascii("POINT_DATA 12\nSCALARS v word 1\nLOOKUP_TABLE d\n"), &["line 9", "not of numbers"]);
    refused(&ascii("POINT_DATA 12\nSCALARS v char 0\nLOOKUP_TABLE d\n"), &["0 components"]);
    refused(&ascii("POINT_DATA 12\nSCALARS v char x\n"), &["\"x\""]);
    refused(&ascii("SCALARS v char\n"), &["before POINT_DATA"]);
    refused(&ascii("POINT_DATA many\n"), &["line 8", "many"]);
    refused(&ascii("NOVELTY 3\n"), &["NOVELTY"]);
    refused(&ascii("FIELD f 99999999\n"), &["99999999"]);
    refused(&ascii(&"x".repeat(70000)), &["65536"]);
    refused(b"a letter\nto a friend\n", &["line 1", "\"a letter\" is not # vtk DataFile Version"]);
    for kind in ["UNSTRUCTURED_GRID", "POLYDATA", "STRUCTURED_GRID"] {
        let text = String::from_utf8(ascii("")).unwrap().replace("STRUCTURED_POINTS", kind);
        refused(text.as_bytes(), &["line 4", kind]);
    }
    for (was, is, word) in [
        ("3 2 2", "3 0 2", "3×0×2"),
        ("3 2 2", "3 -2 2", "-2"),
        ("3 2 2", "99999999 99999999 99999999", "99999999×99999999"),
        ("0.5 0.75 2", "0.5 0 2", "spacing is 0.5 0 2"),
        ("-1 2 3", "nan 2 3", "origin NaN"),
        ("ASCII", "TEXT", "TEXT"),
    ] {
        let text = ascii(&format!("{head}{NUMBERS}"));
        refused(String::from_utf8(text).unwrap().replace(was, is).as_bytes(), &[word]);
    }
    let huge = "POINT_DATA 216000000000000\nSCALARS v double 1\nLOOKUP_TABLE default\n";
    let text = String::from_utf8(ascii("")).unwrap().replace("3 2 2", "60000 60000 60000");
    refused(format!("{text}{huge}{NUMBERS}").as_bytes(), &["12 of 216000000000000"]);
}
