//! Reads the clip planes of a scene file.

use crate::define::place_among;

use super::keys::{ClipFile, ClipNumbers, ClipPlaneFile, ClipText, KeepFile};
use super::*;
use relume_scene::{Fields, Frame, Keep};

/// Sides of a patient and their directions in a left-posterior-superior world.
const SIDES: [(&str, DVec3); 6] = [
    ("left", DVec3::X),
    ("right", DVec3::NEG_X),
    ("posterior", DVec3::Y),
    ("anterior", DVec3::NEG_Y),
    ("superior", DVec3::Z),
    ("inferior", DVec3::NEG_Z),
];

impl Text<'_> {
    /// The clip planes of a scene with these fields.
    pub(super) fn clip(&self, ClipFile { planes, keep, cap }: &ClipFile, fields: &Fields) -> Result<Clip, SceneError> {
        let frame = Frame::of(&fields.first().volume);
        let cut = |plane: ClipPlane, on: Option<bool>, volumes: Option<&Vec<String>>| {
            let fields = volumes.map_or(Ok(plane.fields), |volumes| cut_fields(volumes, fields))?;
            Ok(ClipPlane { on: on.unwrap_or(true), fields, ..plane })
        };
        let plane = |place: &At<ClipPlaneFile>| {
            match place.get_ref() {
                ClipPlaneFile::Short(text) => clip_plane(text, &frame),
                ClipPlaneFile::Text(ClipText { plane, on, volumes }) => {
                    clip_plane(plane, &frame).and_then(|plane| cut(plane, *on, volumes.as_ref()))
                }
                &ClipPlaneFile::Numbers(ClipNumbers { point, normal, on, ref volumes }) => {
                    let plane = ClipPlane::new(point.into(), normal.into()).ok_or_else(|| {
                        if point.iter().any(|number| !number.is_finite()) {
                            return format!("a clip plane through the point {point:?}; its numbers are finite");
                        }
                        format!("a clip plane with the normal {normal:?}; write a direction, such as [0, 0, 1]: what lies that way goes")
                    });
                    plane.and_then(|plane| cut(plane, on, volumes.as_ref()))
                }
            }
            .map_err(|message| self.invalid(place, message))
        };
        if let Some(place) = planes.get(CLIP_PLANES) {
            let message = format!("{} clip planes; a scene may have {CLIP_PLANES}", planes.len());
            return Err(self.invalid(place, message));
        }
        let keep = match keep {
            KeepFile::All => Keep::All,
            KeepFile::Any => Keep::Any,
        };
        Ok(Clip { planes: planes.iter().map(plane).collect::<Result<_, _>>()?, keep, cap: cap.unwrap_or(true) })
    }
}

/// The fields with these `names`, by their indices; `what` names them in the message of an unknown one.
pub(super) fn fields_named(names: &[String], what: &str, fields: &Fields) -> Result<[bool; FIELDS], String> {
    let all: Vec<&str> = fields.iter().map(|field| field.name.as_str()).collect();
    let mut named = [false; FIELDS];
    for name in names {
        match place_among(&all, name) {
            Some(index) => named[index] = true,
            None => return Err(format!("there is no {name:?} for {what}; there are: {}", all.join(", "))),
        }
    }
    Ok(named)
}

/// The fields that a plane cuts, by their names.
fn cut_fields(volumes: &[String], fields: &Fields) -> Result<[bool; FIELDS], String> {
    let named = fields_named(volumes, "a clip plane", fields)?;
    let number = fields.iter().count();
    match named.iter().filter(|named| **named).count() {
        0 => {
            let names: Vec<&str> = fields.iter().map(|field| field.name.as_str()).collect();
            Err(format!("a clip plane of no volume; name some of {}, or leave out `volumes`", names.join(", ")))
        }
        // A plane of all fields is one of all that a scene may have.
        cut if cut == number => Ok([true; FIELDS]),
        _ => Ok(named),
    }
}

/// The clip plane of a `text` such as `z:50%`, in `frame`: the direction in which all goes, and a place on the plane.
///
/// # Errors
///
/// The fault, and the right form.
pub fn clip_plane(text: &str, frame: &Frame) -> Result<ClipPlane, String> {
    let wrong = |what: &str| {
        format!(
            "the clip plane {text:?}: {what}; write DIRECTION:PLACE. What lies in that direction goes: x, -y, 1,0,1, or of a patient left, \
             right, anterior, posterior, superior, inferior. The place is a coordinate, a point such as 12,3,4, or the part that stays, \
             such as 50%"
        )
    };
    let (direction, place) = text.split_once(':').ok_or_else(|| wrong("there is no colon"))?;
    let (direction, place) = (direction.trim(), place.trim());
    let triple = |text: &str| -> Option<DVec3> {
        let numbers: Vec<f64> = text.split(',').map(|number| number.trim().parse().ok()).collect::<Option<_>>()?;
        <[f64; 3]>::try_from(numbers).ok().map(DVec3::from_array).filter(|vector| vector.is_finite())
    };
    let axis = |name: &str| Some(DVec3::AXES[["x", "y", "z"].iter().position(|axis| *axis == name)?]);
    let along_axis = match direction.strip_prefix('-') {
        Some(name) => axis(name).map(|axis| -axis),
        None => axis(direction.strip_prefix('+').unwrap_or(direction)),
    };
    let side = SIDES.iter().find(|side| side.0 == direction).map(|side| side.1);
    if side.is_some() && !frame.anatomical {
        return Err(wrong("the volume does not state where a patient's sides are"));
    }
    let normal = along_axis.or(side).or_else(|| triple(direction).filter(|vector| vector.try_normalize().is_some()));
    let normal = normal.ok_or_else(|| wrong("there is no such direction"))?;
    let outward = normal.normalize();
    let number = |text: &str| text.parse::<f64>().ok().filter(|number| number.is_finite());
    let plane = |point: DVec3| ClipPlane::new(point, normal).ok_or_else(|| wrong("its numbers are too large"));
    if let Some(percent) = place.strip_suffix('%') {
        let part = number(percent).filter(|percent| (0.0..=100.0).contains(percent));
        let part = part.ok_or_else(|| wrong("a part is from 0% to 100%"))? / 100.0;
        return Ok(plane(frame.middle())?.with_part(frame, part));
    }
    match number(place) {
        // Along an axis, its coordinate, also where what is below it goes.
        Some(coordinate) if outward.abs().max_element() >= 1.0 => plane(outward.abs() * coordinate),
        Some(coordinate) => plane(outward * coordinate),
        None => plane(triple(place).ok_or_else(|| wrong("there is no such place"))?),
    }
}

#[cfg(test)]
#[expect(clippy::unwrap_used, reason = "a test fails by panicking")]
mod tests {
    use super::*;

    #[test]
    fn a_short_plane_is_a_direction_and_a_place() {
        let mut volume = Volume::phantom(Phantom::Shells, Some([5, 5, 9])).unwrap();
        volume.geometry.spacing = DVec3::splat(2.0);
        volume.geometry.origin = DVec3::new(-4.0, 10.0, 0.0);
        let mut frame = Frame::of(&volume);
        let plane = |text: &str, frame: &Frame| {
            let plane = clip_plane(text, frame)?;
            Ok::<_, String>((plane.outward().to_array(), plane.beyond(DVec3::ZERO)))
        };
        assert_eq!(plane("z:12", &frame), Ok(([0.0, 0.0, 1.0], -12.0)));
        assert_eq!(plane("-z: 12", &frame), Ok(([0.0, 0.0, -1.0], 12.0)), "what is below 12 goes");
        assert_eq!(plane("z:25%", &frame), Ok(([0.0, 0.0, 1.0], -4.0)), "a quarter stays");
        assert_eq!(plane("-y:25%", &frame), Ok(([0.0, -1.0, 0.0], 16.0)));
        assert_eq!(plane("0,2,0:1,12,3", &frame), Ok(([0.0, 1.0, 0.0], -12.0)));
        for text in ["z", "w:1", "z:101%", "0,0,0:1", "1,2:1", "z:nan", "z:1,2"] {
            let message = plane(text, &frame).unwrap_err();
            assert!(message.contains(text) && message.contains("DIRECTION:PLACE"), "{text}: {message}");
        }
        assert!(plane("left:50%", &frame).is_err_and(|message| message.contains("patient")));
        frame.anatomical = true;
        assert_eq!(plane("left:50%", &frame), Ok(([1.0, 0.0, 0.0], 0.0)));
    }
}
