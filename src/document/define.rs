//! `-D key=value`: applies definitions to a scene's text, and attributes errors to the definitions that cause them.

use toml::de::{DeTable, DeValue};
use toml::{Table, Value};

use relume_scene::FIRST_FIELD;

/// A change of one value of a scene file.
#[derive(Clone, Debug, PartialEq)]
pub struct Definition {
    /// The definition as its user gave it, for messages; the command line writes its flag here.
    pub given: String,
    /// `key.path=value`.
    pub text: String,
}

impl Definition {
    /// The definition `text`, given as it is.
    #[must_use]
    pub fn new(text: &str) -> Self {
        Self { given: text.to_owned(), text: text.to_owned() }
    }
}

/// Applies `key.path=value` to `table`; returns the definition with indices in place of names. Numbers in the path index
/// lists, and so do names of tables in them ([`index_in`]). A value that is not valid TOML is a string.
pub(super) fn define(table: &mut Table, definition: &str) -> Result<String, String> {
    let (path, stated) = definition.split_once('=').ok_or("write key=value, for example lights.key.intensity=2")?;
    let value = format!("v={stated}")
        .parse::<Table>()
        .ok()
        // A line break would start another key.
        .filter(|table| table.len() == 1)
        .and_then(|mut table| table.remove("v"))
        .unwrap_or_else(|| Value::String(stated.trim().to_owned()));
    let keys: Vec<&str> = path.split('.').map(str::trim).collect();
    if keys.contains(&"") {
        return Err("a part of the key is empty".to_owned());
    }
    let keys = of_field(table, keys)?;
    let keys: Vec<&str> = keys.iter().map(String::as_str).collect();
    let mut resolved = Vec::new();
    let (first, rest) = keys.split_first().ok_or("a part of the key is empty")?;
    let place = table.entry(*first).or_insert_with(|| Value::Table(Table::new()));
    put(place, rest, &value, &mut resolved)?;
    resolved.insert(0, (*first).to_owned());
    Ok(format!("{}={stated}", resolved.join(".")))
}

/// Stands for each entry of a table or list in a key.
pub(super) const EACH: &str = "*";

/// Sets the value at the path `keys` below `place`, and adds that path to `resolved`, with indices in place of names.
fn put(place: &mut Value, keys: &[&str], value: &Value, resolved: &mut Vec<String>) -> Result<(), String> {
    let Some((key, rest)) = keys.split_first() else {
        *place = value.clone();
        return Ok(());
    };
    if *key == EACH {
        let mut each: Vec<&mut Value> = match place {
            Value::Table(table) => table.iter_mut().map(|(_, entry)| entry).collect(),
            Value::Array(array) => array.iter_mut().collect(),
            _ => Vec::new(),
        };
        if each.is_empty() {
            return Err("there is nothing for * to stand for".to_owned());
        }
        let mut below = Vec::new();
        for entry in &mut each {
            below.clear();
            put(entry, rest, value, &mut below)?;
        }
        resolved.push(EACH.to_owned());
        resolved.append(&mut below);
        return Ok(());
    }
    match place {
        Value::Table(table) => {
            resolved.push((*key).to_owned());
            put(table.entry(*key).or_insert_with(|| Value::Table(Table::new())), rest, value, resolved)
        }
        Value::Array(array) => {
            let index = index_in(array, key)?;
            resolved.push(index.to_string());
            put(&mut array[index], rest, value, resolved)
        }
        _ => Err(format!("there is no key {key:?}: the value before it is neither a table nor a list")),
    }
}

/// The path `keys` of a scene, where `volumes.NAME` is the first field, whose transfer function stands by itself, or a further one in any case of
/// its letters.
fn of_field(table: &Table, keys: Vec<&str>) -> Result<Vec<String>, String> {
    let owned = |keys: &[&str]| keys.iter().map(|key| (*key).to_owned()).collect::<Vec<_>>();
    let ["volumes", name, rest @ ..] = &*keys else { return Ok(owned(&keys)) };
    let first = table.get("volume").and_then(|volume| volume.get("name")?.as_str()).unwrap_or(FIRST_FIELD);
    let further = table.get("volumes").and_then(Value::as_table).into_iter().flatten();
    let all: Vec<&str> = std::iter::once(first).chain(further.map(|(name, _)| name.as_str())).collect();
    match place_among(&all, name) {
        // A whole table is a further field.
        Some(0) if rest.is_empty() => Ok(owned(&keys)),
        Some(0) if rest.first() == Some(&"transfer") => Ok(owned(rest)),
        Some(0) => Ok(owned(&[&["volume"], rest].concat())),
        Some(place) => Ok(owned(&[&["volumes", all[place]], rest].concat())),
        // A change of a transfer function defines no volume.
        None if matches!(rest, ["transfer", "range" | "by", ..]) => {
            Err(format!("there is no {name:?}; there are: {}", all.join(", ")))
        }
        None => Ok(owned(&keys)),
    }
}

/// Index of `name` among `all`, or of the only one that differs in the case of its letters.
pub(super) fn alike_among(all: &[&str], name: &str) -> Option<usize> {
    all.iter().position(|one| *one == name).or_else(|| {
        let mut alike = (0..all.len()).filter(|&index| all[index].to_lowercase() == name.to_lowercase());
        alike.next().filter(|_| alike.next().is_none())
    })
}

/// Index of the field `name` among `all` fields ([`alike_among`]); the usual name of the first is that of the first.
pub(super) fn place_among(all: &[&str], name: &str) -> Option<usize> {
    alike_among(all, name).or_else(|| (name == FIRST_FIELD && !all.is_empty()).then_some(0))
}

/// Index of `key` in a list: the number, or the table whose `name` or `material` it is.
fn index_in(array: &[Value], key: &str) -> Result<usize, String> {
    if let Some(index) = key.parse().ok().filter(|&index: &usize| index < array.len()) {
        return Ok(index);
    }
    let name = |entry: &Value| Some(entry.get("name").or_else(|| entry.get("material"))?.as_str()?.to_owned());
    let names: Vec<Option<String>> = array.iter().map(name).collect();
    let called: Vec<usize> = (0..names.len()).filter(|&index| names[index].as_deref() == Some(key)).collect();
    match (&called[..], array.len()) {
        (&[index], _) => Ok(index),
        (&[], 0) => Err(format!("there is no {key:?} in an empty list")),
        (&[], length) => {
            let named: Vec<String> = names.into_iter().flatten().collect();
            let or_names = if named.is_empty() { String::new() } else { format!(", or {}", named.join(", ")) };
            Err(format!("there is no {key:?} in this list, whose indices are 0 to {}{or_names}", length - 1))
        }
        (several, _) => {
            let indices: Vec<String> = several.iter().map(usize::to_string).collect();
            Err(format!("{key:?} occurs several times in this list; use an index: {}", indices.join(", ")))
        }
    }
}

/// Last of `definitions` whose key equals `path`, contains it or lies within it.
pub(super) fn responsible<'a>(definitions: &'a [Definition], path: &[String]) -> Option<&'a Definition> {
    definitions.iter().rev().find(|definition| {
        let keys = definition.text.split('=').next().unwrap_or_default().split('.').map(str::trim);
        !path.is_empty() && keys.zip(path).all(|(key, part)| key == part || key == EACH)
    })
}

/// Path of the innermost key whose key or value contains the byte `byte` of `text`; empty where there is none.
pub(super) fn path_at(text: &str, byte: usize) -> Vec<String> {
    let mut found = Vec::new();
    visit(text, &mut |path, spans| {
        if path.len() > found.len() && spans.iter().any(|span| span.contains(&byte)) {
            found = path.to_vec();
        }
    });
    found
}

/// Byte at which the value of the key `path` starts in `text`.
pub(super) fn byte_of(text: &str, path: &[String]) -> Option<usize> {
    let mut found = None;
    visit(text, &mut |key, spans| {
        if key == path {
            found = spans.last().map(|span| span.start);
        }
    });
    found
}

/// Callback for each key with the spans of the key and its value, and for each list element with the span of its value.
type Visitor<'a> = dyn FnMut(&[String], &[std::ops::Range<usize>]) + 'a;

fn visit(text: &str, visitor: &mut Visitor<'_>) {
    if let Ok(table) = DeTable::parse(text) {
        visit_table(table.get_ref(), &mut Vec::new(), visitor);
    }
}

fn visit_table(table: &DeTable<'_>, path: &mut Vec<String>, visitor: &mut Visitor<'_>) {
    for (key, value) in table {
        path.push(key.get_ref().to_string());
        visitor(path, &[key.span(), value.span()]);
        visit_value(value.get_ref(), path, visitor);
        path.pop();
    }
}

fn visit_value(value: &DeValue<'_>, path: &mut Vec<String>, visitor: &mut Visitor<'_>) {
    match value {
        DeValue::Table(table) => visit_table(table, path, visitor),
        DeValue::Array(array) => {
            for (index, element) in array.iter().enumerate() {
                path.push(index.to_string());
                visitor(path, &[element.span()]);
                visit_value(element.get_ref(), path, visitor);
                path.pop();
            }
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "version = 1\n[camera]\nfov = 30\n[[transfer.intervals]]\nrange = [1, 2]\n";

    #[test]
    fn a_byte_of_a_text_belongs_to_the_innermost_key() {
        let at = |needle: &str| path_at(TEXT, TEXT.find(needle).unwrap_or_default()).join(".");
        assert_eq!(at("30"), "camera.fov");
        assert_eq!(at("[camera]"), "camera");
        assert_eq!(at("range"), "transfer.intervals.0.range");
        assert_eq!(at("2]"), "transfer.intervals.0.range.1");
        assert_eq!(path_at("not = ", 3), Vec::<String>::new());
    }

    #[test]
    fn a_key_is_found_where_it_stands() {
        let path = ["camera", "fov"].map(str::to_owned);
        assert_eq!(byte_of(TEXT, &path), TEXT.find("30"));
        assert_eq!(byte_of(TEXT, &["nothing".to_owned()]), None);
    }

    #[test]
    fn an_entry_of_a_list_is_found_by_its_index_or_its_material() {
        let intervals = "[[transfer.intervals]]\nmaterial = \"skin\"\n[[transfer.intervals]]\nmaterial = \"bone\"\n";
        let defined = |text: &str, key: &str| {
            let mut table: Table = text.parse().unwrap_or_default();
            let resolved = define(&mut table, &format!("transfer.intervals.{key}.opacity=0.3"))?;
            let opacity = |index: usize| table["transfer"]["intervals"][index].get("opacity").and_then(Value::as_float);
            Ok::<_, String>((resolved, [0, 1].map(opacity)))
        };
        for key in ["1", "bone"] {
            let expected = ("transfer.intervals.1.opacity=0.3".to_owned(), [None, Some(0.3)]);
            assert_eq!(defined(intervals, key), Ok(expected), "{key}");
        }
        let unknown = defined(intervals, "bones").err().unwrap_or_default();
        assert!(unknown.contains("0 to 1, or skin, bone"), "{unknown}");
        let twice = defined(&intervals.replace("skin", "bone"), "bone").err().unwrap_or_default();
        assert!(twice.contains("use an index: 0, 1"), "{twice}");
    }

    #[test]
    fn the_first_field_is_called_as_the_others() {
        let defined = |text: &str, definition: &str| {
            let mut table: Table = text.parse().unwrap_or_default();
            define(&mut table, definition)
        };
        let named = "[volume]\nname = \"ct\"\n";
        assert_eq!(defined(named, "volumes.ct.transfer.range=[1, 2]"), Ok("transfer.range=[1, 2]".to_owned()));
        assert_eq!(defined(named, "volumes.ct.time=3"), Ok("volume.time=3".to_owned()));
        assert_eq!(defined("", "volumes.volume.time=3"), Ok("volume.time=3".to_owned()));
        assert_eq!(defined(named, "volumes.pet.time=3"), Ok("volumes.pet.time=3".to_owned()));
        assert_eq!(defined(named, "volumes.CT.time=3"), Ok("volume.time=3".to_owned()));
        let two = format!("{named}[volumes.pet]\n");
        assert_eq!(defined(&two, "volumes.Pet.time=3"), Ok("volumes.pet.time=3".to_owned()));
        assert_eq!(
            defined(&two, "volumes.spect.transfer.range=[1, 2]"),
            Err("there is no \"spect\"; there are: ct, pet".to_owned())
        );
    }

    #[test]
    fn a_star_is_each_entry() {
        let mut table: Table = "[lights.a]\n[lights.b]\nshadows = false\n".parse().unwrap_or_default();
        assert_eq!(define(&mut table, "lights.*.shadows=true"), Ok("lights.*.shadows=true".to_owned()));
        let set = |name: &str| table["lights"][name].get("shadows").and_then(Value::as_bool);
        assert_eq!(["a", "b"].map(set), [Some(true); 2]);
        assert!(define(&mut table, "materials.*.xray=true").is_err_and(|why| why.contains('*')));
    }

    #[test]
    fn definitions_answer_for_what_is_below_and_above_them() {
        let definitions = ["camera.fov=3", "lights.a.kind=x", "lights.a.kind=y"].map(Definition::new);
        let who = |path: &str| {
            let path: Vec<String> = path.split('.').map(str::to_owned).collect();
            responsible(&definitions, &path).map_or("", |definition| &definition.text)
        };
        assert_eq!(who("camera.fov"), "camera.fov=3");
        assert_eq!(who("lights.a"), "lights.a.kind=y");
        assert_eq!(who("lights.a.kind.0"), "lights.a.kind=y");
        assert_eq!(who("lights.b"), "");
    }
}
