//! The film of a node of the tree of blocks, composited from the films of nodes below it.

use super::Film;
use crate::Node;

/// The film of `node`: `part(node)` if there is one, else the composite of both sides. `low_first` has the side in front of
/// each cut. Operations and their order follow from the tree alone; of the films, one a level is in memory.
///
/// `None` if a leaf has no film, or if films differ in size, components or kind of transmittance.
///
/// # Errors
///
/// Those of `part`.
pub fn composited<E>(
    node: Node,
    low_first: &[bool],
    part: &mut dyn FnMut(Node) -> Result<Option<Film<f32>>, E>,
) -> Result<Option<Film<f32>>, E> {
    if let Some(film) = part(node)? {
        return Ok(Some(film));
    }
    let Some([low, high]) = node.sides() else { return Ok(None) };
    let [front, back] = if low_first.get(node.cut) == Some(&true) { [low, high] } else { [high, low] };
    let front = composited(front, low_first, part)?;
    let back = composited(back, low_first, part)?;
    Ok(front.zip(back).and_then(|(front, back)| front.over(&back)))
}
