//! Colour accuracy on the command line: flags, reports on colour models, and lights for which they were not planned.

use crate::support;

use serde_json::Value;

use support::exr::{Exr, assert_same};
use support::program::Folder;
use support::scenes::GLASS;

fn folder() -> Folder {
    Folder::new().with("glass.toml", GLASS).with("line.csv", "390 0\n395 0\n400 1\n405 0\n410 0\n")
}

/// Plan of a scene from `info --json`, and the reported source of its k.
fn planned(folder: &Folder, arguments: &[&str]) -> (Value, String) {
    let json = folder.done(&[&["info", "--json"], arguments].concat()).json();
    (json["plan"].clone(), json["scene"].as_str().unwrap().to_owned())
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

#[test]
fn flags_take_the_place_of_the_scenes_accuracy() {
    let stated = GLASS.replace("[accuracy]", "[accuracy]\nk = 12\nmodel = \"bands\"");
    let folder = folder().with("stated.toml", stated);
    let (plan, source) = planned(&folder, &["stated.toml"]);
    assert_eq!((&plan["model"]["k"], &plan["model"]["kind"], &*source), (&12.into(), &"bands".into(), "stated.toml"));
    let (plan, source) = planned(&folder, &["stated.toml", "--k", "5", "--model", "nodes"]);
    assert_eq!((&plan["model"]["k"], &plan["model"]["kind"]), (&5.into(), &"nodes".into()));
    assert_eq!(plan["model"]["nodes_nm"].as_array().unwrap().len(), 5);
    assert_eq!(source, "stated.toml with --model nodes --k 5");
    // A tolerance replaces a given k.
    let (plan, source) = planned(&folder, &["stated.toml", "--tolerance", "2", "--model", "nodes"]);
    assert!(plan["model"]["k"].as_u64().unwrap() < 12 && number(&plan["model"]["max"]) <= 2.0, "{plan}");
    assert_eq!(source, "stated.toml with --model nodes --tolerance 2");
    for light in plan["model"]["lights"].as_array().unwrap() {
        assert!(number(&light["mean"]) <= number(&light["p95"]) && number(&light["p95"]) <= number(&light["max"]));
        assert_eq!(light["planned"], true);
    }
    for kind in ["nodes", "sharpened", "sharpened-semigroup", "bands", "rgb"] {
        let (plan, _) = planned(&folder, &["glass.toml", "--model", kind, "--k", "3"]);
        assert_eq!(plan["model"]["kind"], kind);
    }
    let (plan, _) = planned(&folder, &["scene.toml"]);
    assert_eq!((&plan["accumulate"], &plan["model"]), (&"weights".into(), &Value::Null));
    let (plan, _) = planned(&folder, &["scene.toml", "--accumulate", "spectral"]);
    assert_eq!((&plan["accumulate"], &plan["transmittance"]), (&"spectral".into(), &"grey".into()));
    let (plan, _) = planned(&folder, &["glass.toml", "-D", "accuracy.k=auto"]);
    assert!(number(&plan["model"]["max"]) <= 1.0, "{plan}");
}

#[test]
fn flags_that_mean_nothing_are_refused() {
    let folder = folder().with("v.raw", [7; 64]);
    let folder = folder.with("v.mhd", "NDims = 3\nDimSize = 4 4 4\nElementType = MET_UCHAR\nElementDataFile = v.raw\n");
    folder.refused(2, &["info", "glass.toml", "--k", "3", "--tolerance", "1"], &["--k <N>", "--tolerance <DE>"]);
    folder.refused(2, &["info", "glass.toml", "--k", "32"], &["--k 32", "from 1 to 31"]);
    folder.refused(2, &["info", "glass.toml", "--tolerance", "0"], &["--tolerance 0", "from 0.001 to 100"]);
    folder.refused(2, &["info", "glass.toml", "--tolerance", "nan"], &["--tolerance nan", "from 0.001 to 100"]);
    folder.refused(2, &["info", "glass.toml", "--model", "knots"], &["knots", "sharpened-semigroup"]);
    folder.refused(2, &["info", "glass.toml", "-D", "accuracy.k=few"], &["-D accuracy.k=few", "\"auto\""]);
    for rays in ["0", "257", "-1"] {
        let definition = format!("accuracy.rays={rays}");
        folder.refused(2, &["info", "glass.toml", "-D", &definition], &["rays", rays, "from 1 to 256"]);
    }
    folder.refused(2, &["info", "glass.toml", "-D", "accuracy.labels=round"], &["round", "smooth", "nearest"]);
    folder.refused(1, &["info", "glass.toml", "--accumulate", "weights"], &["green, red", "not possible"]);
    folder.refused(2, &["info", "v.mhd", "--k", "3"], &["--k has no effect", "is a volume"]);
    folder.refused(2, &["bench", "load", "--k", "3"], &["--k has no effect"]);
    folder.refused(2, &["bench", "load", "-D", "accuracy.k=3"], &["-D has no effect"]);
    folder.done(&["render", "glass.toml", "--size", "8x8", "--accumulators", "acc.exr"]);
    folder.refused(2, &["info", "acc.exr", "--tolerance", "3"], &["--tolerance has no effect"]);
    folder.refused(2, &["relight", "acc.exr", "-o", "p.png", "--tolerance", "0"], &["--tolerance", "above 0"]);
}

/// 31 coefficients, such as the 10 nm bands of many tables, and as many of other models: rendered, stored and relit.
#[test]
fn models_of_thirty_one_numbers_are_rendered_stored_and_relit() {
    let folder = folder();
    for model in ["nodes", "bands", "sharpened-semigroup"] {
        let render = ["render", "glass.toml", "--size", "8x8", "--k", "31", "--model", model, "-o", "p.exr"];
        let json = folder.done(&[&render[..], &["--accumulators", "acc.exr", "--json"]].concat()).json();
        assert_eq!((&json["plan"]["model"]["k"], &json["plan"]["model"]["kind"]), (&31.into(), &model.into()));
        folder.done(&["relight", "acc.exr", "-o", "q.exr"]);
        let [rendered, relit] = ["p.exr", "q.exr"].map(|name| Exr::read(&folder.path(name)).rgba());
        assert_same(&rendered, &relit, 1e-4);
        folder.done(&["relight", "acc.exr", "--light", "FL2", "-o", "q.exr"]);
    }
    // The filter of a device may have eight bits.
    let exact = ["render", "glass.toml", "--size", "8x8", "-D", "accuracy.interpolation=exact_linear"];
    let truth = folder.done(&[&exact[..], &["--reference", "-o", "r.exr", "--json"]].concat()).json();
    assert_eq!(truth["plan"]["model"]["lights"], serde_json::json!([]), "all bands are fitted to no light");
    folder.done(&[&exact[..], &["--k", "31", "-o", "p.exr"]].concat());
    let [truth, nodes] = ["r.exr", "p.exr"].map(|name| Exr::read(&folder.path(name)).rgba());
    assert_same(&truth, &nodes, 2e-3);
    // An automatic k is at most 16.
    folder.refused(1, &["info", "glass.toml", "--tolerance", "0.001"], &["any k up to 16"]);
}

/// If no k meets the tolerance, the message suggests options, and these work.
#[test]
fn a_tolerance_that_cannot_be_kept_is_told_with_what_to_type() {
    let folder = folder();
    for flags in [&["--tolerance", "0.001"][..], &["--tolerance", "0.5", "--model", "sharpened"]] {
        let render = [&["render", "glass.toml", "--size", "8x8"], flags].concat();
        let refused = folder.refused(1, &[&render[..], &["-o", "p.png"]].concat(), &["any k up to 16", "--k "]);
        let words: Vec<&str> = refused.err.split([' ', ';', '\n']).collect();
        let after = |flag: &str| words[words.iter().rposition(|&word| word == flag).unwrap() + 1];
        let model = &flags[2..];
        let kept = after("--tolerance");
        let way_out = [&["info", "glass.toml", "--json", "--tolerance", kept], model].concat();
        let plan = &folder.done(&way_out).json()["plan"]["model"];
        assert!(number(&plan["max"]) <= kept.parse().unwrap(), "{plan}");
        let stated = [&["info", "glass.toml", "--json", "--k", after("--k")], model].concat();
        assert_eq!(folder.done(&stated).json()["plan"]["model"]["k"], after("--k").parse::<u64>().unwrap());
    }
    folder.done(&["render", "glass.toml", "--size", "4x4", "--tolerance", "0.001", "--reference", "-o", "p.png"]);
}

#[test]
fn a_light_that_was_not_planned_for_is_reported_and_planned_for_on_request() {
    let folder = folder();
    let render = ["render", "glass.toml", "--size", "8x8", "--light", "line.csv", "--json"];
    let new = |json: &Value| {
        let lights = json["model"]["lights"].as_array().unwrap();
        lights.iter().find(|light| light["name"] == "line.csv").unwrap().clone()
    };
    // A spectral line, at which daylight and a tube have little power.
    let outcome = folder.done(&[&render[..], &["-o", "p.exr", "--accumulators", "acc.exr"]].concat());
    let light = new(&outcome.json()["plan"]);
    assert!(light["planned"] == false && number(&light["max"]) > 1.0, "{light}");
    for word in ["the light line.csv", "tolerance of 1;", "--replan"] {
        assert!(outcome.err.contains(word), "no {word:?} in {}", outcome.err);
    }
    let rendered = light;
    // From the file the error is the same, and the message suggests rendering again.
    let outcome = folder.done(&["relight", "acc.exr", "--light", "line.csv", "-o", "q.png", "--json"]);
    assert!(outcome.err.contains("render again with this --light and --replan"), "{}", outcome.err);
    let mut relit = new(&outcome.json());
    relit["planned"] = rendered["planned"].clone();
    assert_eq!(relit, rendered, "one error, by either way");
    assert_eq!(relit["on_unseen_colours"], true);
    // Lights of the scene are recognised by their spectra, whatever their names.
    let known = folder.done(&["relight", "acc.exr", "--light", "D65", "--light", "FL11@key", "-o", "q.png", "--json"]);
    let json = known.json();
    assert!(json["model"]["lights"].as_array().unwrap().iter().all(|light| light["planned"] == true), "{json}");
    let relit = ["relight", "acc.exr", "--light", "line.csv", "-o", "q.png", "--tolerance", "100"];
    let outcome = folder.done(&relit);
    assert_eq!(outcome.err, "", "within this tolerance");
    assert!(outcome.out.contains("line.csv is new to the colour model: ΔE00 "), "{}", outcome.out);
    // A model planned for this light meets the tolerance.
    let outcome = folder.done(&[&render[..], &["-o", "p.exr", "--replan"]].concat());
    let light = new(&outcome.json()["plan"]);
    assert!(light["planned"] == true && number(&light["max"]) <= 1.0, "{light}");
    assert!(!outcome.err.contains("planned without the light"), "{}", outcome.err);
    // A k that is stated stretches no tolerance.
    let few = ["render", "glass.toml", "--size", "8x8", "-o", "p.exr", "--k", "3", "--light", "FL2"];
    let outcome = folder.done(&few);
    assert!(outcome.out.contains("FL2 is new") && outcome.err.contains("a larger --k"), "{}", outcome.err);
    // A light that was rendered with stretches no tolerance.
    folder.done(&[&few[..8], &["--light", "line.csv", "--accumulators", "few.exr"]].concat());
    let outcome = folder.done(&["relight", "few.exr", "--light", "line.csv", "-o", "q.png"]);
    assert!(outcome.err.contains("the tolerance of"), "{}", outcome.err);
    // Weights are exact for every light.
    folder.done(&["render", "scene.toml", "--size", "8x8", "--accumulators", "w.exr"]);
    folder.refused(2, &["relight", "w.exr", "-o", "q.png", "--tolerance", "1"], &["--tolerance has no effect"]);
    let weights = ["render", "scene.toml", "--size", "8x8", "-o", "p.exr", "--light", "line.csv", "--replan", "--json"];
    let outcome = folder.done(&weights);
    assert!(outcome.json()["plan"]["model"].is_null() && outcome.err.is_empty(), "{}", outcome.err);
}

#[test]
fn what_states_an_accuracy_without_use_is_told_so() {
    let folder = folder();
    let size = ["--size", "8x8", "-o", "p.png"];
    let render = |scene: &'static str, flags: &[&'static str]| [&["render", scene], &size[..], flags].concat();
    for flags in [["--k", "8"], ["--model", "rgb"]] {
        let said = folder.done(&render("scene.toml", &flags)).err;
        assert!(
            said.contains("has no effect: pixels keep material weights") && said.contains("--accumulate spectral"),
            "{said}"
        );
        assert!(!folder.done(&render("glass.toml", &["--k", "8"])).err.contains("has no effect"));
    }
    for flags in [&["--k", "8"][..], &["--model", "rgb"], &["--accumulate", "spectral"], &["--replan"]] {
        let reference = render("glass.toml", &[&["--reference"], flags].concat());
        folder.refused(2, &reference, &[flags[0], "has no effect", "all wavelengths"]);
        let relight = [&["relight", "acc.exr", "-o", "p.png"], flags].concat();
        folder.refused(2, &relight, &[flags[0], "is for `relume render`"]);
    }
    folder.refused(2, &["info", "glass.toml", "--k", "-3"], &["--k -3", "from 1 to 31"]);
    folder.refused(2, &["info", "glass.toml", "--tolerance", "-1"], &["--tolerance -1", "from 0.001 to 100"]);
    let bench = ["bench", "peer", "peer-k8", "--size", "8x8", "--frames", "1", "--shading", "none"];
    let said = folder.done(&[&bench[..], &["--k", "4", "--accumulate", "spectral"]].concat());
    assert!(said.err.contains("--k has no effect on peer-k8"), "{}", said.err);
    assert!(said.out.contains("k = 4 (nodes)") && said.out.contains("k = 8 (nodes)"), "{}", said.out);
    let said = folder.done(&["bench", "peer", "--size", "8x8", "--frames", "1", "--shading", "none", "--model", "rgb"]);
    assert!(
        said.err.contains("the model rgb has no effect") && said.out.contains("4 weights"),
        "{}{}",
        said.err,
        said.out
    );
}

#[test]
fn a_larger_k_that_is_worse_is_remarked_on() {
    let folder = folder();
    let worst = |k: &str| number(&planned(&folder, &["glass.toml", "--k", k]).0["model"]["max"]);
    let ks = ["1", "2", "3", "4", "5", "6", "7", "8", "9", "10", "11", "12", "13", "14", "15", "16"];
    let errors = ks.map(worst);
    for (pair, k) in errors.windows(2).zip(&ks[1..]) {
        let said = folder.done(&["info", "glass.toml", "--k", k]).err;
        assert_eq!(said.contains("has a smaller error here than"), pair[0] < pair[1], "k = {k}: {errors:?}: {said}");
    }
}

#[test]
fn bench_measures_with_the_accuracy_asked_for() {
    let arguments =
        ["bench", "peer", "--size", "8x8", "--frames", "1", "--shading", "none", "--json", "-D", "volume.dims=[9,9,9]"];
    let json = folder().done(&[&arguments[..], &["--accumulate", "spectral", "--k", "6"]].concat()).json();
    let row = &json["rows"][0];
    assert_eq!(
        (&row["accumulate"], &row["model"]["k"], &row["components"]),
        (&"spectral".into(), &6.into(), &6.into())
    );
}
