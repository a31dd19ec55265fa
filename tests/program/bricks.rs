//! Volumes in bricks on the command line.

use std::path::Path;

use crate::support::exr::Exr;
use crate::support::program::Folder;

/// A long volume of 8-bit values, with a sidecar: 5000×14×15 voxels.
fn long(folder: Folder) -> Folder {
    let voxels: Vec<u8> = (0..5000 * 14 * 15_usize).map(|i| u8::try_from(i % 5000 / 10 % 251).unwrap()).collect();
    folder.with("long.raw", voxels)
}

const ARGUMENTS: [&str; 8] = ["render", "--volume", "long.raw", "--dims", "5000x14x15", "--type", "uint8", "--json"];

/// Lavapipe has textures of at most 4096 texels along an axis.
#[test]
fn a_long_volume_is_rendered_in_bricks_and_the_report_counts_them() {
    let folder = long(Folder::new());
    // Large enough for rays that meet it.
    let more = ["--size", "640x480", "--device-memory", "12MiB", "-o", "long.png"];
    let out = folder.done(&[&ARGUMENTS[..], &more].concat());
    let json = out.json();
    let bricks = &json["march"]["bricks"];
    if bricks.is_null() {
        // A device with longer textures holds it whole.
        assert!(json["march"]["volume_bytes"].as_u64().unwrap() <= 12 << 20);
        return;
    }
    assert!(bricks["loaded"].as_u64().unwrap() > 0 && bricks["again"] == 0, "{bricks}");
    assert!(json["march"]["volume_bytes"].as_u64().unwrap() <= 12 << 20, "{json}");
    assert!(Path::new(&folder.path("long.png")).exists());
}

#[test]
fn the_picture_is_the_same_however_little_memory_the_device_has() {
    let folder = long(Folder::new());
    let picture = |memory: &str, name: &str, size: &str| {
        let common = ["render", "--volume", "long.raw", "--dims", size, "--type", "uint8", "--size", "40x30"];
        let exact = ["-D", "accuracy.interpolation=\"exact_linear\"", "--device-memory", memory, "-o", name, "--json"];
        // Light behind bricks comes from a coarse level.
        let open = ["-D", "shadows.ambient=open", "-D", "lights.*.shadows=false"];
        let json = folder.done(&[&common[..], &open, &exact].concat()).json();
        (std::fs::read(folder.path(name)).unwrap(), json["march"]["bricks"].clone())
    };
    let (whole, none) = picture("1GiB", "whole.png", "250x210x20");
    assert!(none.is_null(), "{none}");
    let (bricked, counts) = picture("5000KiB", "bricked.png", "250x210x20");
    assert!(counts["rounds"].as_u64().unwrap() > 1, "{counts}");
    assert!(whole == bricked, "{counts}");
}

#[test]
fn memory_that_is_no_size_or_too_small_is_refused() {
    let folder = long(Folder::new());
    let with = |memory: &'static str| [&ARGUMENTS[..], &["--device-memory", memory, "-o", "long.png"]].concat();
    for wrong in ["much", "0", "1.5GiB", "GiB", "99999999999TiB"] {
        folder.refused(2, &with(wrong), &["--device-memory", "such as 512MiB"]);
    }
    let scene = ["render", "scene.toml", "--size", "8x8", "--device-memory", "100KiB", "-o", "p.png"];
    folder.refused(1, &scene, &["a brick of the volume needs", "102 kB", "--device-memory", "--downsample"]);
}

#[test]
fn bricks_that_fit_into_the_memory_are_read_like_their_volume() {
    let folder = long(Folder::new()).with("long.raw.toml", "dims = [5000, 14, 15]\ntype = \"uint8\"\n");
    let made = folder.done(&["bricks", "long.raw", "-o", "long.bricks", "--json"]).json();
    assert_eq!((&made["bricks"], &made["dims"][0]), (&79.into(), &5000.into()), "{made}");
    assert_eq!(made["levels"].as_array().unwrap().len(), 8, "{made}");
    let [of_raw, of_bricks] = ["long.raw", "long.bricks"].map(|file| {
        let picture = format!("{file}.png");
        folder.done(&["render", "scene.toml", "--volume", file, "--size", "40x30", "-o", &picture]);
        let info = folder.done(&["info", file, "--voxel", "4999,13,14", "--json"]).json();
        let told = ["dims", "type", "min", "max", "mean", "histogram", "voxels"].map(|key| info[key].clone());
        (std::fs::read(folder.path(&picture)).unwrap(), told)
    });
    assert!(of_raw.0 == of_bricks.0, "the same picture");
    assert_eq!(of_raw.1, of_bricks.1);
    // Coarser levels are listed and chosen as those of a store.
    let info = folder.done(&["info", "long.bricks", "--pyramid-level", "7"]);
    let told = info.out;
    let listed = ["40 × 1 × 1 of uint8", "pyramid = 8 levels: 0 5000×14×15, 1 2500×7×8, 2 1250×4×4", "level = 7"];
    assert!(listed.iter().all(|line| told.contains(line)), "{told}");
    folder.refused(
        1,
        &["info", "long.bricks", "--pyramid-level", "8"],
        &["level 8 does not exist", "--pyramid-level 8"],
    );
    let coarse = ["--pyramid-level", "1", "--size", "40x30", "-o", "coarse.png"];
    folder.done(&[&["render", "scene.toml", "--volume", "long.bricks"], &coarse[..]].concat());
    assert!(Path::new(&folder.path("coarse.png")).exists());
}

#[test]
fn what_makes_no_bricks_or_needs_more_memory_is_told_with_the_way_out() {
    let folder = long(Folder::new()).with("long.raw.toml", "dims = [5000, 14, 15]\ntype = \"uint8\"\n");
    folder.refused(2, &["bricks", "long.raw", "-o", "long.nrrd"], &["-o long.nrrd", ".bricks"]);
    folder.refused(2, &["bricks", "long.raw", "-o", "x.bricks", "--spacing", "1x1x2"], &["--spacing", "render"]);
    folder.refused(1, &["bricks", "nothing.nrrd", "-o", "x.bricks"], &["nothing.nrrd"]);
    let folder = folder.with("a.vtk", b"# vtk DataFile Version 3.0\n");
    let advised = ["a.vtk", "its format is read as a whole", "relume convert a.vtk a-whole.nrrd"];
    folder.refused(1, &["bricks", "a.vtk", "-o", "x.bricks"], &advised);
    folder.done(&["bricks", "long.raw", "-o", "long.bricks"]);
    let render = |file: &'static str, more: &[&'static str]| {
        [&["render", "scene.toml", "--volume", file, "-o", "p.png", "--memory", "1MiB"], more].concat()
    };
    let advised = ["the voxels take 2 MiB of memory, and may take 1 MiB", "relume bricks long.raw -o long.bricks"];
    folder.refused(1, &render("long.raw", &[]), &advised);
    folder.refused(1, &render("long.bricks", &[]), &["at least 17 MiB of memory", "--memory"]);
}

/// Parallel rays of a stated height: the cameras follow no voxels.
#[test]
fn a_turntable_of_a_volume_that_stays_in_its_file_shows_that_volume_and_keeps_its_bricks() {
    let voxels: Vec<u8> = (0..512 * 256 * 224_usize)
        .map(|i| u8::try_from((i % 512 / 2 + i / 512 % 256 / 3 + i / (512 * 256)) % 251).unwrap())
        .collect();
    let sidecar = "dims = [512, 256, 224]\ntype = \"uint8\"\n";
    let folder = Folder::new().with("v.raw", voxels).with("v.raw.toml", sidecar);
    folder.done(&["bricks", "v.raw", "-o", "v.bricks"]);
    let turn = |file: &'static str, name: &'static str, more: &[&'static str]| {
        let scene =
            ["render", "scene.toml", "--volume", file, "--size", "24x18", "--turntable", "3", "-o", name, "--json"];
        let exact = ["-D", "accuracy.interpolation=\"exact_linear\"", "-D", "camera.projection=\"orthographic\""];
        let height = ["-D", "camera.height=300"];
        folder.done(&[&scene[..], &exact, &height, more].concat()).json()
    };
    let pictures = |stem: &str| [1, 2, 3].map(|n| Exr::read(&folder.path(&format!("{stem}-000{n}.exr"))).rgba());
    turn("v.raw", "whole.exr", &[]);
    let whole = pictures("whole");
    assert!(whole[0] != whole[1] && whole[0].iter().any(|&number| number > 0.1), "it turns, and is not black");
    let small = ["--memory", "27MiB", "--device-memory", "8MiB"];
    let json = turn("v.bricks", "small.exr", &small);
    let bricks = &json["march"]["bricks"];
    assert!(bricks["again"].as_u64() > Some(0), "there is no room for all: {bricks}");
    assert!(pictures("small") == whole);
    assert!(json["march"]["host_bricks"]["loaded"].as_u64() > Some(0), "{json}");
    turn("v.bricks", "part.exr", &[&small[..], &["--part", "1/2"]].concat());
    let files = |stem: &str| [1, 3].map(|n| std::fs::read(folder.path(&format!("{stem}-000{n}.exr"))).unwrap());
    assert!(files("part") == files("small") && !folder.path("part-0002.exr").exists());
    // The level of its shadows is told.
    let dark =
        ["render", "scene.toml", "--volume", "v.bricks", "--memory", "27MiB", "--size", "24x18", "-o", "dark.png"];
    let told = folder.done(&[&dark[..], &["-D", "lights.day.shadows=true"]].concat()).out;
    let level =
        "shadows are from level 2 of the volume, means of 4×4×4 voxels, with a node of the light grid every 4 voxels";
    assert!(told.contains(level), "{told}");
}
