//! Parser of sweeps, which list the settings to measure.

use super::setting::{Knob, Setting, Value};
use relume_base::number::readable;
use relume_scene::key::Kind;

/// Maximum number of settings of one sweep.
const MOST: usize = 10_000;

/// An invalid sweep.
#[derive(Debug, thiserror::Error)]
#[error("{sweep}: {problem}")]
pub struct SweepError {
    sweep: String,
    problem: String,
}

/// Returns the settings of `sweeps` without duplicates, starting with the scene's own. Without sweeps, varies each of
/// the usual knobs by itself.
///
/// A sweep is `KNOB=VALUE,VALUE,…,KNOB=VALUE…` and combines every value of a knob with every value of the others.
/// `A..B` means the whole numbers from A to B for `k`, and A, 2A, 4A and so on up to B otherwise (A, 10A and so on for
/// `termination`). Combinations of RGB with k other than 3 are left out.
///
/// # Errors
///
/// [`SweepError`].
pub fn settings(sweeps: &[String]) -> Result<Vec<Setting>, SweepError> {
    // Each knob by itself, from the scene's own setting.
    let usual = |knob: Knob| Some(format!("{knob}={}", knob.key().knob?.tried)).filter(|sweep| !sweep.ends_with('='));
    let usual: Vec<String> = Knob::all().filter_map(usual).collect();
    let sweeps = if sweeps.is_empty() { &usual } else { sweeps };
    let mut all = vec![Setting::default()];
    for sweep in sweeps {
        let fail = |problem: String| SweepError { sweep: sweep.clone(), problem };
        let mut grid = vec![Setting::default()];
        for (knob, values) in knobs(sweep).map_err(fail)? {
            if grid.len().saturating_mul(values.len()) > MOST {
                return Err(fail(format!("more than {MOST} settings; use fewer values")));
            }
            let with = |setting: &Setting| {
                let setting = setting.clone();
                values.iter().map(|&value| setting.clone().with(knob.name(), value)).collect::<Vec<_>>()
            };
            grid = grid.iter().flat_map(with).collect();
        }
        grid.retain(Setting::is_possible);
        if grid.is_empty() {
            return Err(fail("no setting is left, because RGB has k = 3".to_owned()));
        }
        for setting in grid {
            if !all.contains(&setting) {
                all.push(setting);
            }
        }
    }
    Ok(all)
}

/// The knobs of a sweep and their values; a part without `=` is a further value of the preceding knob.
fn knobs(sweep: &str) -> Result<Vec<(Knob, Vec<Value>)>, String> {
    let mut found: Vec<(Knob, Vec<Value>)> = Vec::new();
    for part in sweep.split(',') {
        let text = match part.split_once('=') {
            None => part,
            Some((name, text)) => {
                let name = name.trim();
                let knob = Knob::named(name).ok_or_else(|| {
                    let names: Vec<&str> = Knob::all().map(Knob::name).collect();
                    format!("unknown knob {name:?}; the knobs are {}", names.join(", "))
                })?;
                if found.iter().any(|&(known, _)| known == knob) {
                    return Err(format!("{knob} occurs twice; separate its values by commas"));
                }
                found.push((knob, Vec::new()));
                text
            }
        };
        let Some((knob, values)) = found.last_mut() else {
            return Err("write KNOB=VALUES, such as k=3..12,step=0.25..4".to_owned());
        };
        for value in read(*knob, text.trim())? {
            if !values.contains(&value) {
                values.push(value);
            }
        }
    }
    Ok(found)
}

/// Parses the value or the range of values `text` for `knob`.
fn read(knob: Knob, text: &str) -> Result<Vec<Value>, String> {
    if let Some(names) = knob.names() {
        // Names of several words have an underscore in files; a hyphen is accepted.
        let name = names.iter().find(|name| name.replace('_', "-") == text.replace('_', "-"));
        let name = name.ok_or_else(|| format!("{knob} is one of {}, not {text:?}", names.join(", ")))?;
        return Ok(vec![Value::Name(name)]);
    }
    let (range, is_whole) = (knob.key().offered(), matches!(knob.key().kind, Kind::Whole(..)));
    let number = |text: &str| {
        let number = text.trim().parse().ok().filter(|number: &f64| range.contains(number));
        number.filter(|number| !is_whole || number.fract() == 0.0).ok_or_else(|| {
            let kind = if is_whole { "a whole number" } else { "a number" };
            let [least, most] = [readable(*range.start()), readable(*range.end())];
            format!("{knob} is {kind} from {least} to {most}, not {text:?}")
        })
    };
    let Some((first, last)) = text.split_once("..") else { return Ok(vec![Value::Number(number(text)?)]) };
    let (first, last) = (number(first)?, number(last)?);
    if first > last || first <= 0.0 {
        return Err(format!("{text}: a range starts above 0 and increases"));
    }
    let next = |&value: &f64| {
        let next = knob.key().knob.map_or(last, |knob| (knob.next)(value));
        // The range includes its end, even if no step reaches it exactly.
        (value < last).then_some(if next < last * (1.0 - 1e-9) { next } else { last })
    };
    Ok(std::iter::successors(Some(first), next).map(Value::Number).collect())
}

#[cfg(test)]
#[expect(clippy::unwrap_used, reason = "a test fails by panicking")]
mod tests {
    use super::*;

    fn shown(sweeps: &[&str]) -> Vec<String> {
        let sweeps: Vec<String> = sweeps.iter().map(|sweep| (*sweep).to_owned()).collect();
        settings(&sweeps).unwrap().iter().map(ToString::to_string).collect()
    }

    #[test]
    fn a_sweep_is_every_value_with_every_other_after_the_scenes_own() {
        assert_eq!(
            shown(&["k=3..4,step=0.5..2"]),
            [
                "as the scene says",
                "k=3 step=0.5",
                "k=3 step=1",
                "k=3 step=2",
                "k=4 step=0.5",
                "k=4 step=1",
                "k=4 step=2",
            ]
        );
    }

    #[test]
    fn several_sweeps_follow_one_another_and_no_setting_is_measured_twice() {
        let expected = ["as the scene says", "model=nodes", "model=bands", "termination=0", "termination=0.5"];
        assert_eq!(shown(&["model=nodes,bands", "termination=0,0.5", "model=bands"]), expected);
    }

    #[test]
    fn ranges_grow_as_their_knob_does_and_include_their_end() {
        assert_eq!(shown(&["entries=256..1000"])[1..], ["entries=256", "entries=512", "entries=1000"]);
        assert_eq!(shown(&["termination=0.001..0.1"]).len(), 4);
        assert_eq!(shown(&["k=3..12"]).len(), 11);
        assert_eq!(shown(&["step=0.25..4"]).len(), 6);
        assert_eq!(shown(&["scale=0.5..0.5"]).len(), 2);
    }

    #[test]
    fn rgb_has_three_numbers_and_others_are_left_out() {
        let expected = ["as the scene says", "model=nodes k=3", "model=nodes k=8", "model=rgb-fitted k=3"];
        assert_eq!(shown(&["model=nodes,rgb-fitted,k=3,8"]), expected);
        assert!(settings(&["model=rgb,k=8".to_owned()]).is_err());
    }

    #[test]
    fn what_is_no_sweep_is_told_with_what_would_be_one() {
        for (sweep, words) in [
            ("k", "write KNOB=VALUES"),
            ("size=3", "the knobs are model, k,"),
            ("k=32", "k is a whole number from 1 to 31, not \"32\""),
            ("k=3.5", "whole"),
            ("step=4..1", "increases"),
            ("step=nan", "a number from"),
            ("model=pca", "one of nodes,"),
            ("k=3,k=4", "twice"),
            ("step=0.01..1000,k=1..16,entries=2..65536,storage=f32,f16,lookup=linear,nearest", "more than 10000"),
            ("", "write KNOB=VALUES"),
        ] {
            let told = settings(&[sweep.to_owned()]).unwrap_err().to_string();
            assert!(told.contains(words) && told.starts_with(&format!("{sweep}: ")), "{told}");
        }
    }

    #[test]
    fn the_usual_sweep_turns_every_knob_but_eight_one_at_a_time() {
        let usual = settings(&[]).unwrap();
        assert!(usual.iter().all(|setting| setting.knobs().count() <= 1), "{usual:?}");
        // Without segments, the variation has no effect; without shadows, spacing and directions of the light grid; labels of their own
        // are rare; so is scattered light. Several rays take a truth of many rays.
        let lit = ["spacing", "directions", "scattering.spacing", "scattering.directions"];
        let idle = ["accumulate", "rays", "variation", "labels"].into_iter().chain(lit).collect::<Vec<_>>();
        for knob in Knob::all() {
            let is_turned = usual.iter().any(|setting| setting.get(knob.name()).is_some());
            assert_eq!(is_turned, !idle.contains(&knob.name()), "{knob}");
        }
    }
}
