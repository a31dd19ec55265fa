//! The light dial: weights of its nodes, and its mixes.

use glam::{DVec2, dvec2};
use relume::document::{Dial, DialNode, SceneError, SceneFile, SceneOptions, parse};
use relume::progress::Quiet;
use relume::scene::{Mix, MixLight};
use relume::spectrum::{Light, Spectrum};

fn scene(more: &str) -> Result<SceneFile, SceneError> {
    let text = format!(
        "version = 1\n[volume]\nphantom = \"slab\"\ndims = [4, 4, 4]\n\
         [lights.a]\nspectrum = \"A\"\n[lights.b]\nspectrum = \"FL11\"\nintensity = 2\n[lights.c]\nspectrum = \"D65\"\n{more}"
    );
    parse("scene.toml", &text, std::path::Path::new(""), &SceneOptions::default(), &Quiet)
}

fn node(light: &str, place: DVec2) -> DialNode {
    DialNode { light: light.into(), place, on: true }
}

fn stated() -> Mix {
    let narrow = Light::new(Spectrum::gaussian(450.0, 10.0, 1.0).unwrap()).unwrap();
    let lights = [
        ("a", Light::blackbody(2856.0).unwrap(), 1.0),
        ("b", narrow, 3.0),
        ("c", Light::blackbody(6500.0).unwrap(), 0.5),
    ];
    Mix(lights.map(|(name, spectrum, weight)| MixLight { name: name.into(), spectrum, weight, position: 0 }).into())
}

/// Luminance of a white surface under a mix.
fn luminance(mix: &Mix) -> f64 {
    relume::spectrum::colour::xyz_of(&mix.light_at(0).1).0[1]
}

#[test]
fn weights_are_inverse_distances_and_add_up_to_one() {
    let nodes = vec![node("a", dvec2(0.0, 0.0)), node("b", dvec2(3.0, 0.0)), node("c", dvec2(0.0, 4.0))];
    let dial = Dial { nodes, normalise: true, master: 1.0, presets: vec![] };
    // Distances from (0, 1): 1, √10 and 3.
    let reciprocals = [1.0, 1.0 / 10_f64.sqrt(), 1.0 / 3.0];
    let sum: f64 = reciprocals.iter().sum();
    for (weight, reciprocal) in dial.weights(dvec2(0.0, 1.0)).into_iter().zip(reciprocals) {
        assert!((weight - reciprocal / sum).abs() < 1e-15);
    }
    for hand in [dvec2(1e-300, 0.0), dvec2(1e300, -1e300), dvec2(1.0, 5e-324), dvec2(f64::MAX, f64::MAX)] {
        let weights = dial.weights(hand);
        assert!(weights.iter().all(|weight| (0.0..=1.0).contains(weight)), "{hand}: {weights:?}");
        assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{hand}: {weights:?}");
    }
}

#[test]
fn on_a_node_its_light_shines_alone_and_exactly_as_it_does_without_the_dial() {
    for normalise in [true, false] {
        let mut dial = Dial::regular(["a", "b", "c"].into_iter());
        dial.normalise = normalise;
        let stated = Mix(stated().0.into_iter().map(|light| MixLight { weight: 1.0, ..light }).collect());
        for (index, node) in dial.nodes.iter().enumerate() {
            assert_eq!(dial.mix(node.place, &stated).0, [stated.0[index].clone()]);
        }
    }
}

#[test]
fn the_regular_dial_starts_at_the_top_and_goes_clockwise() {
    let places: Vec<DVec2> =
        Dial::regular(["a", "b", "c", "d"].into_iter()).nodes.iter().map(|node| node.place).collect();
    for (place, expected) in places.iter().zip([DVec2::Y, DVec2::X, DVec2::NEG_Y, DVec2::NEG_X]) {
        assert!(place.distance(expected) < 1e-15, "{place}");
    }
    let middle = Dial::regular(["a", "b", "c"].into_iter()).weights(DVec2::ZERO);
    assert!(middle.iter().all(|weight| (weight - 1.0 / 3.0).abs() < 1e-15), "{middle:?}");
}

#[test]
fn a_normalised_mix_keeps_the_luminance_of_white() {
    let mut dial = Dial::regular(["a", "b", "c"].into_iter());
    dial.master = 0.8;
    for step in 0..100 {
        let angle = f64::from(step);
        let mix = dial.mix(DVec2::from_angle(angle) * f64::from(step % 7) / 3.0, &stated());
        assert!((luminance(&mix) - 0.8).abs() < 1e-9, "step {step}: {}", luminance(&mix));
    }
    dial.normalise = false;
    assert!(
        (luminance(&dial.mix(dial.nodes[1].place, &stated())) - 2.4).abs() < 1e-9,
        "a light of intensity 3, at 0.8"
    );
}

#[test]
fn a_node_that_is_off_keeps_its_place_and_does_not_shine() {
    let mut dial = Dial::regular(["a", "b", "c"].into_iter());
    let place = dial.nodes[1].place;
    dial.node_mut("b").unwrap().on = false;
    let weights = dial.weights(place);
    assert!((weights[0] - 0.5).abs() < 1e-12 && (weights[2] - 0.5).abs() < 1e-12, "{weights:?}");
    assert_eq!(dial.mix(place, &stated()).0.len(), 2, "what weighs nothing is left out");
    assert_eq!(dial.nodes[1].place, place);
    for name in ["a", "c"] {
        dial.node_mut(name).unwrap().on = false;
    }
    assert_eq!(dial.mix(place, &stated()), Mix(vec![]), "all off is dark");
}

#[test]
fn nodes_at_one_place_share_the_light_there() {
    let nodes = vec![node("a", DVec2::ONE), node("b", DVec2::ONE), node("c", DVec2::ZERO)];
    assert_eq!(Dial { nodes, normalise: true, master: 1.0, presets: vec![] }.weights(DVec2::ONE), [0.5, 0.5, 0.0]);
}

#[test]
fn ways_of_the_hand_meet_their_nodes_exactly() {
    let mut dial = Dial::regular(["a", "b", "c"].into_iter());
    let way = Dial::sweep(&dial.nodes[0], &dial.nodes[2], 7);
    assert_eq!((way.len(), way[0], way[6]), (7, dial.nodes[0].place, dial.nodes[2].place));
    assert_eq!(Dial::sweep(&dial.nodes[0], &dial.nodes[2], 1), [dial.nodes[0].place]);
    let path = dial.closed_path(9);
    assert_eq!(
        (path.len(), path[0], path[3], path[6]),
        (9, dial.nodes[0].place, dial.nodes[1].place, dial.nodes[2].place)
    );
    dial.node_mut("b").unwrap().on = false;
    assert_eq!(dial.closed_path(4)[2], dial.nodes[2].place, "what is off is no stop");
    dial.nodes.clear();
    assert!(dial.closed_path(4).is_empty());
}

#[test]
fn a_scene_states_its_dial() {
    let plain = scene("").unwrap().dial;
    assert_eq!(plain, Dial::regular(["a", "b", "c"].into_iter()));
    let stated = scene(
        "[dial]\nnormalise = false\nmaster = 2\noff = [\"c\"]\n[dial.nodes]\nb = [0.25, -0.5]\n\
                        [[dial.presets]]\nname = \"dusk\"\nhand = \"b\"\noff = [\"a\"]\n\
                        [[dial.presets]]\nname = \"noon\"\nhand = [1, 2]\ncaption = \"bright\"\n",
    )
    .unwrap()
    .dial;
    assert_eq!((stated.normalise, stated.master), (false, 2.0));
    assert_eq!(stated.nodes[1].place, dvec2(0.25, -0.5));
    assert_eq!(stated.nodes.iter().map(|node| node.on).collect::<Vec<_>>(), [true, true, false]);
    let (dial, dusk) = stated.preset("dusk").unwrap();
    assert_eq!(dusk.hand, dvec2(0.25, -0.5), "the node's place");
    assert_eq!(dial.nodes.iter().map(|node| node.on).collect::<Vec<_>>(), [false, true, false]);
    let (dial, noon) = stated.preset("noon").unwrap();
    assert_eq!((dial, noon.hand, noon.caption.as_str()), (stated.clone(), dvec2(1.0, 2.0), "bright"));
    assert!(stated.preset("dawn").unwrap_err().contains("there are: dusk, noon"));
}

#[test]
fn a_dial_of_lights_that_are_not_there_is_refused() {
    for (text, words) in [
        ("[dial.nodes]\nd = [0, 0]\n", ["dial.nodes.d", "there are: a, b, c"]),
        ("[dial]\noff = [\"d\"]\n", ["dial.off: d", "there are: a, b, c"]),
        ("[dial]\nmaster = -1\n", ["dial.master = -1", "from 0 to"]),
        ("[[dial.presets]]\nname = \"x\"\nhand = \"d\"\n", ["dial.presets, x: d", "there are: a, b, c"]),
        ("[dial.nodes]\na = [inf, 0]\n", ["dial.nodes.a", "not finite"]),
    ] {
        let message = scene(text).unwrap_err().to_string();
        assert!(words.iter().all(|word| message.contains(word)), "{message}");
    }
}
