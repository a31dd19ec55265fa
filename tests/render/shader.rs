//! WGSL to SPIR-V: constants, excerpts, layouts, determinism.
#![expect(clippy::unwrap_used, clippy::expect_used, reason = "a test fails by panicking")]

use std::{
    io::Write as _,
    process::{Command, Stdio},
};

use relume::shader::{Constants, FieldLayout, ShaderError, StructLayout, compile, struct_layout};

/// Uses every construct of the renderer's shaders.
const EVERYTHING: &str = "
struct Band { first_row: u32, rows: u32 }
var<immediate> band: Band;
@group(0) @binding(0) var volume: texture_3d<f32>;
@group(0) @binding(1) var linear: sampler;
@group(0) @binding(2) var<storage, read> table: array<vec4<f32>>;
@group(0) @binding(3) var accumulator: texture_storage_2d_array<rgba32float, read_write>;
@group(0) @binding(4) var transmittance: texture_storage_2d_array<r32float, read_write>;
@group(0) @binding(5) var picture: texture_storage_2d_array<rgba8unorm, write>;

@compute @workgroup_size(WIDTH, HEIGHT)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2(id.x, id.y + band.first_row);
    var lanes: array<vec4<f32>, LANES>;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        lanes[lane] = table[lane] * textureSampleLevel(volume, linear, vec3(SCALE), 0.0).x;
        let before = textureLoad(accumulator, pixel, lane);
        textureStore(accumulator, pixel, lane, before + lanes[lane]);
    }
    if (SHADED) { lanes[0] *= 0.5; }
    let left = textureLoad(transmittance, pixel, 0u).x;
    textureStore(transmittance, pixel, 0u, vec4(left * 0.5));
    textureStore(picture, pixel, 0u, lanes[0]);
}
";

fn constants() -> Constants {
    Constants::new().u32("WIDTH", 8).u32("HEIGHT", 8).u32("LANES", 2).f32("SCALE", 0.1).bool("SHADED", false)
}

fn excerpt(error: ShaderError) -> String {
    let ShaderError::Source { excerpt } = error else { panic!("not an error in the text: {error:?}") };
    excerpt
}

#[test]
fn equal_texts_give_equal_words() {
    let first = compile(&[("everything.wgsl", EVERYTHING)], &constants()).unwrap();
    let second = compile(&[("everything.wgsl", EVERYTHING)], &constants()).unwrap();
    assert_eq!(first, second);
}

#[test]
fn spirv_val_accepts_the_words() {
    let shader = compile(&[("everything.wgsl", EVERYTHING)], &constants()).unwrap();
    let bytes: Vec<u8> = shader.words().iter().flat_map(|word| word.to_le_bytes()).collect();
    let mut child = Command::new("spirv-val")
        .args(["--target-env", "vulkan1.2", "-"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("spirv-val is needed: apt-get install spirv-tools");
    child.stdin.take().unwrap().write_all(&bytes).unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn what_a_constant_switches_off_is_neither_compiled_nor_bound() {
    let source = "@group(0) @binding(3) var<storage, read_write> out: array<f32>;
        @group(0) @binding(7) var<storage, read> extra: array<f32>;
        fn twice(x: f32) -> f32 { return 2.0 * x; }
        @compute @workgroup_size(1) fn main() {
            if (EXTRA) { let more = extra[0]; out[0] = twice(more); } else { out[0] = 1.0; }
        }";
    let with = |extra| compile(&[("x.wgsl", source)], &Constants::new().bool("EXTRA", extra)).unwrap();
    assert_eq!(with(true).resources(), ["out", "extra"]);
    assert_eq!(with(false).resources(), ["out"]);
    let plain = "@group(0) @binding(0) var<storage, read_write> out: array<f32>;
        @compute @workgroup_size(1) fn main() { out[0] = 1.0; }";
    // Only the declaration of the switch remains: OpTypeBool and OpConstantFalse.
    let declaration = 2 + 3;
    let plain = compile(&[("x.wgsl", plain)], &Constants::new()).unwrap();
    assert_eq!(with(false).words().len(), plain.words().len() + declaration);
}

#[test]
fn constants_set_the_workgroup_size() {
    let shader = compile(&[("everything.wgsl", EVERYTHING)], &constants()).unwrap();
    // OpExecutionMode (16, six words): entry point, LocalSize (17), x, y, z.
    let local_size = shader.words().windows(6).find(|window| window[0] == (6 << 16 | 16) && window[2] == 17);
    assert_eq!(&local_size.expect("no LocalSize")[3..], [8, 8, 1]);
}

#[test]
fn constants_reach_the_words_with_all_their_bits() {
    let source = "@group(0) @binding(0) var<storage, read_write> out: array<f32>;
        @compute @workgroup_size(1) fn main() { out[0] = X; }";
    for value in [0.1_f32, 1.0, -0.0, 1e-7, f32::MIN_POSITIVE, f32::MAX, 16_777_215.0] {
        let shader = compile(&[("x.wgsl", source)], &Constants::new().f32("X", value)).unwrap();
        // OpConstant (43, four words): type, result, value.
        let found = shader.words().windows(4).any(|window| window[0] == (4 << 16 | 43) && window[3] == value.to_bits());
        assert!(found, "{value} is not in the module");
    }
}

#[test]
fn a_constant_that_is_not_finite_is_refused_by_name() {
    for value in [f32::NAN, f32::INFINITY] {
        let error = compile(&[("everything.wgsl", EVERYTHING)], &constants().f32("STEP", value)).unwrap_err();
        assert!(error.to_string().contains("STEP"), "{error}");
    }
}

#[test]
fn an_excerpt_has_the_line_of_its_own_part() {
    let common = "fn half(x: f32) -> f32 {\n    return x * 0.5;\n}\n";
    let stage = "// the stage\n@compute @workgroup_size(1)\nfn main() {\n    let y = half(1u) +;\n}\n";
    let text = excerpt(compile(&[("common.wgsl", common), ("stage.wgsl", stage)], &Constants::new()).unwrap_err());
    assert!(text.contains("stage.wgsl:4:"), "{text}");
    assert!(text.contains("let y = half(1u) +;"), "{text}");
}

#[test]
fn an_excerpt_of_what_the_validator_refuses_has_the_line_too() {
    let common = "fn half(x: f32) -> f32 { return x * 0.5; }\n";
    // Only the validator checks the layout of a struct's fields.
    let stage = "struct S { a: f32, b: array<f32, 3> }\n@group(0) @binding(0) var<uniform> s: S;\n\
        @compute @workgroup_size(1)\nfn main() { _ = s.a; }\n";
    let text = excerpt(compile(&[("common.wgsl", common), ("stage.wgsl", stage)], &Constants::new()).unwrap_err());
    assert!(text.contains("stage.wgsl:2:"), "{text}");
}

#[test]
fn a_missing_constant_is_named() {
    let text = excerpt(compile(&[("everything.wgsl", EVERYTHING)], &Constants::new()).unwrap_err());
    assert!(text.contains("WIDTH") || text.contains("LANES") || text.contains("SCALE"), "{text}");
    assert!(text.contains("everything.wgsl:"), "{text}");
}

#[test]
fn a_brace_that_is_missing_at_the_end_has_an_excerpt() {
    let stage = "@compute @workgroup_size(1)\nfn main() {\n";
    let text = excerpt(compile(&[("stage.wgsl", stage)], &Constants::new()).unwrap_err());
    assert!(text.contains("┌─"), "{text}");
}

#[test]
fn an_excerpt_shows_both_parts_of_a_clash() {
    let stage = "@compute @workgroup_size(1) fn main() {}\nfn half() {}\n";
    let parts = [("common.wgsl", "// common\n\nfn half() {}\n"), ("stage.wgsl", stage)];
    let text = excerpt(compile(&parts, &Constants::new()).unwrap_err());
    assert!(text.contains("common.wgsl:3:4") && text.contains("stage.wgsl:2:4"), "{text}");
}

#[test]
fn text_that_ends_too_early_is_an_error_and_no_panic() {
    for end in 0..EVERYTHING.len() {
        let text = &EVERYTHING[..end];
        if let Err(error) = compile(&[("cut.wgsl", text)], &constants()) {
            assert!(!error.to_string().is_empty());
        }
    }
}

#[test]
fn a_shader_without_main_is_refused() {
    let error = compile(&[("a.wgsl", "@compute @workgroup_size(1) fn other() {}")], &Constants::new()).unwrap_err();
    assert!(matches!(error, ShaderError::Write { .. }), "{error:?}");
}

#[test]
fn structs_lie_where_wgsl_says() {
    // WGSL, "Alignment and Size": vec3 aligns to 16 and has 12 bytes; a mat4x4 has 64; a struct ends at its alignment.
    let source =
        "struct March { world: mat4x4<f32>, step: f32, size: vec3<u32>, cutoff: f32, lanes: array<vec4<f32>, LANES> }";
    let layout = struct_layout(&[("march.wgsl", source)], &Constants::new().u32("LANES", 3), "March").unwrap();
    let field = |name: &str, offset, size| FieldLayout { name: name.to_owned(), offset, size };
    let fields = vec![
        field("world", 0, 64),
        field("step", 64, 4),
        field("size", 80, 12),
        field("cutoff", 92, 4),
        field("lanes", 96, 48),
    ];
    assert_eq!(layout, StructLayout { fields, size: 144 });
}

#[test]
fn layouts_that_do_not_exist_are_refused() {
    let source = "struct Open { n: u32, rest: array<f32> }\nstruct Other { a: f32 }";
    let layout = |name| struct_layout(&[("open.wgsl", source)], &Constants::new(), name);
    assert!(matches!(layout("Missing"), Err(ShaderError::NoStruct { .. })), "a struct that is not there");
    assert!(matches!(layout("Open"), Err(ShaderError::NoLayout { .. })), "a struct with an open end");
}
