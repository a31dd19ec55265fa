//! Sessions: the opened scene file with the changes made in the viewer, as a scene file.
//!
//! `relume render` renders the picture of the window from it, and `relume view` continues with it.

use std::collections::BTreeSet;
use std::io;
use std::path::{Component, Path, PathBuf, absolute};

use glam::DVec2;
use toml_edit::{Array, DocumentMut, InlineTable, Item, Table, TableLike, TomlError, Value, value};

use super::design::{self, Side};
use super::{Definition, Dial, LightState, Mixing, SceneFile, Source, State};
use crate::output::{OutputError, write_atomically};
use relume_colour::palette::{Palette, Solution};
use relume_colour::spectrum::{Layers, Spectrum, ThinFilm, ThinFilmAngle};
use relume_scene::key::{self, Key};
use relume_scene::{
    Aim, Camera, Clip, ClipPlane, FIELDS, Fields, Form, Keep, Painting, Projection, Scene, Second, Shape, Term,
};
use relume_volume::{ByteOrder, is_built_in};

/// Why a session cannot be saved.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SessionError {
    /// The scene's text cannot be parsed for changes.
    #[error("the text of the scene {name} cannot be edited")]
    Text {
        /// The scene.
        name: String,
        /// The cause.
        source: TomlError,
    },
    /// A path is not UTF-8, so a scene cannot contain it.
    #[error("a session cannot contain the path {}, which is not UTF-8; open the file under another name", path.display())]
    Name {
        /// The path.
        path: PathBuf,
    },
    /// The absolute path of a folder cannot be found.
    #[error("cannot find the absolute path of {}", path.display())]
    Where {
        /// The path.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// A phantom was downsampled, which a scene cannot state.
    #[error("a downsampled phantom cannot be saved as a session; write its smaller dims into the scene")]
    Downsampled,
    /// The transfer function has more curves than a scene can state.
    #[error("the transfer function has {0} curves, but a scene file can have only one; remove the others")]
    Curves(usize),
    /// A key has a value that is not a table.
    #[error("`{name}` of the scene is not a table")]
    NoTable {
        /// The key.
        name: &'static str,
    },
    /// The file cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
}

impl SessionError {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Text { .. } => "session-text-invalid",
            Self::Name { .. } => "session-path-not-text",
            Self::Where { .. } => "session-folder-missing",
            Self::Downsampled => "session-phantom-downsampled",
            Self::Curves(_) => "session-curves-too-many",
            Self::NoTable { .. } => "session-key-not-table",
            Self::Output(error) => error.code(),
        }
    }
}

/// Writes `state` to `path`. `opened` is the scene as it was opened from `source`.
///
/// # Errors
///
/// [`SessionError`]; `path` is then unchanged.
pub fn save(path: &Path, source: &Source, opened: &SceneFile, state: &State) -> Result<(), SessionError> {
    let text = text(path, source, opened, state)?;
    Ok(write_atomically(path, |file| file.write_all(text.as_bytes()))?)
}

/// Returns the text that [`save`] writes.
///
/// # Errors
///
/// [`SessionError`].
pub fn text(path: &Path, source: &Source, opened: &SceneFile, state: &State) -> Result<String, SessionError> {
    let unreadable = |source| SessionError::Text { name: opened.scene.name.clone(), source };
    let mut document: DocumentMut = opened.text.parse().map_err(unreadable)?;
    let [base, folder] = [&*opened.base, path.parent().unwrap_or(Path::new(""))].map(place);
    let (base, folder) = (base?, folder?);
    // A scene that Relume made names no other files than its volume and labels, unless a definition does.
    let is_made = source.bare_volume().is_some() && !source.options.definitions.iter().any(names_files);
    let base = if is_made { folder.clone() } else { base };
    if base == folder {
        document.remove("base");
    } else {
        document.insert("base", value(from(&base, &folder)?));
    }
    volume(&mut document, source, &base)?;
    if !source.options.beside.is_empty() && opened.scene.volume().selection.time.is_none() {
        // The time is that of a series beside the first volume, which has it.
        table(&mut document, "volume")?.remove("time");
    }
    let (scene, then) = (&state.scene, &opened.scene);
    if scene.camera != then.camera {
        document.insert("camera", Item::Table(camera(scene)));
    }
    for (path, now) in changed(key::SCENE, scene, then).filter(|(path, _)| !path.starts_with("camera.")) {
        let (table, name) = match path.split_once('.') {
            None => (document.as_table_mut() as &mut dyn TableLike, path),
            Some((part, name)) => (table(&mut document, part)?, name),
        };
        put(table, name, now);
    }
    if scene.transfer != then.transfer {
        let own = table(&mut document, "transfer")?;
        terms(own, [&scene.transfer.terms, &then.transfer.terms], scene)?;
        match &scene.transfer.gradient_opacity {
            none if none.is_empty() => own.remove("gradient_opacity"),
            factor => own.insert("gradient_opacity", value(points(factor))),
        };
    }
    further(&mut document, scene, then)?;
    if scene.hidden != then.hidden {
        document.insert("hidden", value(fields_of(scene.hidden, &scene.fields)));
    }
    labels(&mut document, scene, then)?;
    let palette = state.palette.as_ref().filter(|_| state.palette != design::stated(opened));
    let open = palette.map_or_else(Vec::new, |palette| design::open(scene, palette));
    spectra(&mut document, scene, then, &open)?;
    if let Some(palette) = palette {
        let text: DocumentMut = design::text(scene, palette).parse().map_err(unreadable)?;
        document.insert("palette", Item::Table(without_places(text.as_table())));
    }
    if scene.crop != then.crop {
        document.remove("crop");
        if let Some([min, max]) = scene.crop {
            let mut crop = Table::new();
            crop.insert("min", value(numbers(min.to_array())));
            crop.insert("max", value(numbers(max.to_array())));
            document.insert("crop", Item::Table(crop));
        }
    }
    if scene.clip != then.clip {
        document.remove("clip");
        if scene.clip != Clip::default() {
            document.insert("clip", Item::Table(clip(&scene.clip, &scene.fields)));
        }
    }
    if let Some(dial) = document.get_mut("dial").and_then(Item::as_table_like_mut) {
        // Its former name.
        if let Some(presets) = dial.remove("situations") {
            dial.insert("presets", presets);
        }
    }
    if state.dial != opened.dial {
        dial(table(&mut document, "dial")?, &state.dial);
    }
    document.remove("mix");
    let dark = dark(&document);
    // The index of the preset does not matter, only its light.
    let light = LightState { preset: None, ..state.light.clone() };
    if light != LightState::stated(scene.lights.len()) || !dark.is_empty() {
        document.insert("mix", Item::Table(mix(&light, &state.dial, scene, &dark)));
    }
    Ok(document.to_string())
}

/// The text of the scene file `scene` with the open spectra of its palette as in `solution`, to be saved as `path`.
///
/// # Errors
///
/// [`SessionError`].
pub fn solved_text(path: &Path, scene: &Path, text: &str, solution: &Solution) -> Result<String, SessionError> {
    let unreadable = |source| SessionError::Text { name: scene.display().to_string(), source };
    let mut document: DocumentMut = text.parse().map_err(unreadable)?;
    let stated = document.get("base").and_then(Item::as_str).unwrap_or_default();
    let base = scene.parent().unwrap_or(Path::new("")).join(stated);
    let (base, folder) = (place(&base)?, place(path.parent().unwrap_or(Path::new("")))?);
    if base == folder {
        document.remove("base");
    } else {
        document.insert("base", value(from(&base, &folder)?));
    }
    let palette = &solution.palette;
    for (row, found) in palette.materials.iter().zip(&solution.materials).filter(|(row, _)| row.spectrum.is_none()) {
        if row.name == design::BACKGROUND {
            document.insert("background", samples(found.spectrum()));
        } else {
            set(&mut document, "materials", &row.name, "reflectance", samples(found.spectrum()))?;
        }
    }
    for (column, found) in palette.lights.iter().zip(&solution.lights).filter(|(column, _)| column.spectrum.is_none()) {
        for (key, item) in placed_like(&document, &column.name, palette) {
            set(&mut document, "lights", &column.name, key, item)?;
        }
        set(&mut document, "lights", &column.name, "spectrum", samples(found.spectrum()))?;
    }
    Ok(document.to_string())
}

/// For a light that the scene lacks: where the first light of the palette that it has shines from, so that their pictures
/// differ in colours alone.
fn placed_like(document: &DocumentMut, name: &str, palette: &Palette) -> Vec<(&'static str, Item)> {
    let lights = document.get("lights").and_then(Item::as_table_like);
    let has = |name: &str| lights?.get(name)?.as_table_like();
    let model = palette.lights.iter().find_map(|light| has(&light.name)).filter(|_| has(name).is_none());
    let keys = ["kind", "direction", "position", "shadows"];
    keys.into_iter().filter_map(|key| Some((key, model?.get(key)?.clone()))).collect()
}

/// Whether a definition may name a file.
fn names_files(definition: &Definition) -> bool {
    let key = definition.text.split(['.', '=']).next().unwrap_or_default().trim();
    ![
        "accuracy",
        "blending",
        "camera",
        "clip",
        "crop",
        "display",
        "hidden",
        "lighting",
        "mix",
        "overlap",
        "scattering",
        "shading",
        "shadows",
        "transfer",
    ]
    .contains(&key)
}

fn clip(Clip { planes, keep, cap }: &Clip, fields: &Fields) -> Table {
    let mut table = Table::new();
    let plane = |plane: &ClipPlane| {
        let mut row = InlineTable::new();
        row.insert("point", Value::from(numbers(plane.point.to_array())));
        row.insert("normal", Value::from(numbers(plane.normal.to_array())));
        if !plane.on {
            row.insert("on", false.into());
        }
        if !plane.cuts_all() {
            row.insert("volumes", Value::from(fields_of(plane.fields, fields)));
        }
        row
    };
    table.insert("planes", value(planes.iter().map(plane).collect::<Array>()));
    if *keep == Keep::Any {
        table.insert("keep", value("any"));
    }
    if !cap {
        table.insert("cap", value(false));
    }
    table
}

/// The names of the `chosen` fields.
fn fields_of(chosen: [bool; FIELDS], fields: &Fields) -> Array {
    names(fields.iter().zip(chosen).filter(|(_, chosen)| *chosen).map(|(field, _)| field.name.as_str()))
}

/// `path` as a scene in `folder` names it: relative if it lies in the folder, so that both can be moved together, and
/// absolute otherwise.
fn from(path: &Path, folder: &Path) -> Result<String, SessionError> {
    let path = place(path)?;
    let steps = path.strip_prefix(folder).ok().filter(|rest| !rest.as_os_str().is_empty());
    let steps: Option<Vec<_>> = steps.map(|rest| rest.components().collect());
    match steps.filter(|steps| steps.iter().all(|step| matches!(step, Component::Normal(_)))) {
        // A slash separates folders on every system.
        Some(steps) => {
            let names: Result<Vec<&str>, _> = steps.iter().map(|step| utf8(Path::new(step))).collect();
            Ok(names?.join("/"))
        }
        None => Ok(utf8(&path)?.to_owned()),
    }
}

/// Absolute path of the folder `path`, independent of the working directory.
fn place(path: &Path) -> Result<PathBuf, SessionError> {
    let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
    absolute(path).map_err(|source| SessionError::Where { path: path.to_owned(), source })
}

fn utf8(path: &Path) -> Result<&str, SessionError> {
    path.to_str().ok_or_else(|| SessionError::Name { path: path.to_owned() })
}

/// Returns the table `name`; inserts an empty one if it is missing.
fn table<'a>(document: &'a mut DocumentMut, name: &'static str) -> Result<&'a mut dyn TableLike, SessionError> {
    let item = document.entry(name).or_insert(Item::Table(Table::new()));
    item.as_table_like_mut().ok_or(SessionError::NoTable { name })
}

/// Writes the command line's changes of the volume; its relative paths start at the folder `base`.
fn volume(document: &mut DocumentMut, source: &Source, base: &Path) -> Result<(), SessionError> {
    let options = &source.options;
    let volume = source.bare_volume().or(options.volume.as_deref());
    let table = table(document, "volume")?;
    if let Some(path) = volume {
        for key in ["phantom", "labels", "phantom_labels", "dims", "type", "byte_order", "header_bytes", "slices"] {
            table.remove(key);
        }
        table.insert("file", value(from(path, base)?));
    }
    if let Some(layout) = &options.raw {
        table.insert("type", value(layout.voxel_type.to_string()));
        table.insert("dims", value(whole(layout.dims)));
        table.insert("byte_order", value(if layout.byte_order == ByteOrder::Big { "big" } else { "little" }));
        table.insert("header_bytes", value(i64::try_from(layout.header_bytes).unwrap_or(i64::MAX)));
        if !table.contains_key("spacing") {
            table.insert("spacing", value(numbers(layout.spacing)));
        }
    }
    // Those of a scene are for its own volume; a look at the volume has chosen for it.
    let has_look = source.bare_volume().is_some() || source.path.is_none();
    if volume.is_some() && !has_look || options.selection.asks {
        for key in ["component", "time", "array", "series", "level", "axes", "resample"] {
            table.remove(key);
        }
    }
    let selection = &options.selection;
    let chosen = [("component", selection.component), ("time", selection.time), ("level", selection.level)];
    for (key, number) in chosen {
        if let Some(number) = number {
            table.insert(key, value(i64::try_from(number).unwrap_or(i64::MAX)));
        }
    }
    if let Some(array) = &options.selection.array {
        table.insert("array", value(array));
    }
    if let Some(series) = &options.selection.series {
        table.insert("series", value(series));
    }
    if let Some(axes) = &options.selection.axes {
        table.insert("axes", value(axes));
    }
    if options.selection.resample {
        table.insert("resample", value(true));
    }
    if let Some(labels) = &options.labels {
        table.insert("labels", value(from(labels, base)?));
    }
    if let Some(names) = &options.label_names {
        let name = if is_built_in(names) { utf8(names)?.to_owned() } else { from(names, base)? };
        table.insert("label_names", value(name));
    }
    if let Some((lengths, unit)) = options.spacing {
        // The key is the spacing of averaged blocks.
        let stated = table.get("downsample").and_then(|item| item.as_array());
        let stated = |axis: usize| {
            stated.and_then(|blocks| blocks.get(axis)?.as_integer()).and_then(|it| usize::try_from(it).ok())
        };
        let block = |axis: usize| options.downsample.map(|blocks| blocks[axis]).or(stated(axis)).unwrap_or(1);
        let spacing = [0, 1, 2].map(|axis| lengths[axis] * relume_base::number::count(block(axis)));
        table.insert("spacing", value(numbers(spacing)));
        if let Some(unit) = unit {
            table.insert("unit", value(unit.to_string()));
        }
    }
    if let Some(blocks) = options.downsample {
        if table.contains_key("phantom") {
            return Err(SessionError::Downsampled);
        }
        table.insert("downsample", value(whole(blocks)));
    }
    Ok(())
}

fn whole(numbers: [usize; 3]) -> Array {
    numbers.into_iter().map(|number| i64::try_from(number).unwrap_or(i64::MAX)).collect()
}

fn numbers<const N: usize>(numbers: [f64; N]) -> Array {
    numbers.into_iter().collect()
}

fn names<'a>(names: impl Iterator<Item = &'a str>) -> Array {
    names.collect()
}

/// `file` with this camera, in its scene and its text.
///
/// # Errors
///
/// [`SessionError::Text`].
pub fn with_camera(file: &SceneFile, seen: Camera) -> Result<SceneFile, SessionError> {
    let unreadable = |source| SessionError::Text { name: file.scene.name.clone(), source };
    let mut document: DocumentMut = file.text.parse().map_err(unreadable)?;
    let mut file = file.clone();
    file.scene.camera = seen;
    document.insert("camera", Item::Table(camera(&file.scene)));
    file.text = document.to_string().into();
    Ok(file)
}

fn camera(scene: &Scene) -> Table {
    let (mut table, camera) = (Table::new(), &scene.camera);
    if matches!(camera.projection, Projection::Orthographic { .. }) {
        table.insert("projection", value("orthographic"));
    }
    let keys = key::SCENE.iter().filter(|key| key.path.starts_with("camera."));
    for (key, now) in keys.filter_map(|key| Some((key, key.get(scene)?))) {
        table.insert(key.name(), item(now));
    }
    match camera.aim {
        Aim::LookAt { position, target } => {
            table.insert("position", value(numbers(position.to_array())));
            table.insert("target", value(numbers(target.to_array())));
        }
        Aim::Orbit { fill, front, around, .. } => {
            let pairs = fill.pairs();
            let fill = match pairs {
                [[_, fraction]] => value(*fraction),
                _ => value(pairs.iter().map(|&pair| numbers(pair)).collect::<Array>()),
            };
            table.insert("fill", fill);
            table.insert("front", value(numbers(front.to_array())));
            if let Some(around) = around {
                table.insert(
                    "around",
                    value(around.map(|corner| numbers(corner.to_array())).into_iter().collect::<Array>()),
                );
            }
        }
    }
    table.insert("up", value(numbers(camera.up.to_array())));
    table
}

/// Sets `key` of `table`, or removes it.
fn put(table: &mut dyn TableLike, key: &str, item: Item) {
    if item.is_none() {
        table.remove(key);
    } else {
        table.insert(key, item);
    }
}

/// The `keys` of `new` that differ from `old`, and their values.
fn changed<T>(keys: &'static [Key<T>], new: &T, old: &T) -> impl Iterator<Item = (&'static str, Item)> {
    let differ = keys.iter().filter(|key| key.get(new) != key.get(old));
    differ.map(|key| (key.path, key.get(new).map_or(Item::None, item)))
}

/// The value of a scalar key.
fn item(stated: key::Value<'_>) -> Item {
    match stated {
        // A whole number is written as one.
        key::Value::Number(number) => match number.to_string().parse::<i64>() {
            Ok(whole) => value(whole),
            Err(_) => value(number),
        },
        key::Value::Name(name) => value(name),
        key::Value::Switch(on) => value(on),
    }
}

/// Copies a table without its positions in the source text, so that it is written where it is inserted.
fn without_places(table: &Table) -> Table {
    let mut copy = Table::new();
    for (key, item) in table {
        let item = item.as_table().map_or_else(|| item.clone(), |inner| Item::Table(without_places(inner)));
        copy.insert(key, item);
    }
    copy
}

fn samples(spectrum: &Spectrum) -> Item {
    let mut table = InlineTable::new();
    table.insert("samples", numbers(*spectrum.samples()).into());
    value(table)
}

/// A film as the scene file states it.
fn film(film: &ThinFilm) -> Item {
    let Layers { index, thickness_nm, above, below } = film.layers();
    let mut table = InlineTable::new();
    for (key, number) in [("index", index), ("thickness", thickness_nm), ("above", above), ("below", below)] {
        table.insert(key, number.into());
    }
    let angle = match film.angle() {
        ThinFilmAngle::Facing => "facing",
        ThinFilmAngle::Lobe => "lobe",
    };
    table.insert("angle", angle.into());
    value(table)
}

/// Sets `key` of the member `name` of `list`, which is added if there is none.
fn set(document: &mut DocumentMut, list: &'static str, name: &str, key: &str, item: Item) -> Result<(), SessionError> {
    let members = table(document, list)?;
    if members.get(name).is_none() {
        members.insert(name, Item::Table(Table::new()));
    }
    let member = members.get_mut(name).and_then(Item::as_table_like_mut).ok_or(SessionError::NoTable { name: list })?;
    put(member, key, item);
    Ok(())
}

/// Writes changed spectra, the `open` spectra of the palette, and changed films and scalar keys of materials and lights. Spectra are samples. A spectrum in the scene takes precedence over its palette.
fn spectra(
    document: &mut DocumentMut,
    now: &Scene,
    then: &Scene,
    open: &[(Side, &str, &Spectrum)],
) -> Result<(), SessionError> {
    let mut set = |list, name: &str, key: &str, item| set(document, list, name, key, item);
    for &(side, name, spectrum) in open.iter().filter(|(_, name, _)| *name != design::BACKGROUND) {
        match side {
            Side::Material => set("materials", name, "reflectance", samples(spectrum))?,
            Side::Light => set("lights", name, "spectrum", samples(spectrum))?,
        }
    }
    for (new, old) in now.materials.iter().zip(&then.materials).filter(|(new, old)| new.reflectance != old.reflectance)
    {
        set("materials", &old.name, "reflectance", samples(new.reflectance.spectrum()))?;
    }
    for (new, old) in now.materials.iter().zip(&then.materials).filter(|(new, old)| new.film != old.film) {
        set("materials", &old.name, "film", new.film.as_ref().map_or(Item::None, film))?;
    }
    for (new, old) in now.lights.iter().zip(&then.lights).filter(|(new, old)| new.spectrum != old.spectrum) {
        set("lights", &old.name, "spectrum", samples(new.spectrum.spectrum()))?;
    }
    for (new, old) in now.materials.iter().zip(&then.materials) {
        changed(key::MATERIAL, new, old).try_for_each(|(key, item)| set("materials", &old.name, key, item))?;
    }
    for (new, old) in now.lights.iter().zip(&then.lights) {
        changed(key::LIGHT, new, old).try_for_each(|(key, item)| set("lights", &old.name, key, item))?;
    }
    let found = open.iter().any(|(_, name, _)| *name == design::BACKGROUND);
    if let Some(background) = now.background.as_ref().filter(|_| found || now.background != then.background) {
        document.insert("background", samples(background.spectrum()));
    }
    Ok(())
}

/// Writes what further fields show, where it changed.
fn further(document: &mut DocumentMut, scene: &Scene, then: &Scene) -> Result<(), SessionError> {
    for (now, before) in scene.fields.further().iter().zip(then.fields.further()).filter(|(a, b)| a.terms != b.terms) {
        let field = table(document, "volumes")?.get_mut(&now.name).and_then(Item::as_table_like_mut);
        if let Some(own) = field.and_then(|field| field.get_mut("transfer")?.as_table_like_mut()) {
            terms(own, [&now.terms, &before.terms], scene)?;
        }
    }
    Ok(())
}

/// Writes the intervals, and curves that have changed; keeps those that have not, unless they were removed.
fn terms(table: &mut dyn TableLike, [now, then]: [&[Term]; 2], scene: &Scene) -> Result<(), SessionError> {
    let found = now.iter().map(|term| (term.as_interval(), term));
    let curves = found.clone().filter(|(interval, _)| interval.is_none()).count();
    if curves > 1 {
        return Err(SessionError::Curves(curves));
    }
    // The terms have its values.
    let is_stretched = table.remove("range").is_some();
    if curves == 0 {
        for key in ["opacity", "absorption", "material"] {
            table.remove(key);
        }
    }
    let is_curve = |term: &&Term| term.as_interval().is_none();
    if let Some(curve) =
        now.iter().find(is_curve).filter(|curve| is_stretched || then.iter().find(is_curve) != Some(*curve))
    {
        table.insert("opacity", value(points(&curve.opacity)));
        if !curve.absorption.is_empty() {
            table.insert("absorption", value(points(&curve.absorption)));
        }
        let materials = curve.material.0.iter().map(|&(at, material)| {
            let name = scene.materials.get(material).map_or("", |it| &it.name);
            Value::Array([Value::from(at), Value::from(name)].into_iter().collect())
        });
        table.insert("material", value(materials.collect::<Array>()));
    }
    if curves == now.len() && !table.contains_key("intervals") {
        return Ok(());
    }
    let mut intervals = Array::new();
    let has_by = table.contains_key("by");
    for (interval, term) in found.filter_map(|(interval, term)| Some((interval?, term))) {
        let mut row = InlineTable::new();
        row.insert("material", scene.materials.get(interval.material).map_or("", |it| &it.name).into());
        row.insert("range", numbers(interval.range).into());
        row.insert("ramp", interval.ramp.into());
        row.insert("opacity", interval.opacity.into());
        if interval.absorption > 0.0 {
            row.insert("absorption", interval.absorption.into());
        }
        if !term.gradient.is_empty() {
            row.insert("gradient", points(&term.gradient).into());
        }
        // Without one of its own, an interval has that of all.
        if !term.by.is_empty() || has_by {
            let factors = term.by.iter().map(|factor| (factor.field.as_str(), Value::Array(points(&factor.points))));
            row.insert("by", Value::InlineTable(factors.collect()));
        }
        if let Some(of_term) = &term.shape {
            row.insert("shape", Value::InlineTable(shape(of_term)));
        }
        let mut row = Value::InlineTable(row);
        row.decor_mut().set_prefix("\n    ");
        intervals.push_formatted(row);
    }
    intervals.set_trailing("\n");
    table.insert("intervals", value(intervals));
    Ok(())
}

/// A shape as files state it.
fn shape(Shape { second, form }: &Shape) -> InlineTable {
    let mut table = InlineTable::new();
    table.insert(
        "by",
        match second {
            Second::Gradient => "gradient".into(),
            Second::Field(name) => name.into(),
        },
    );
    match form {
        Form::Polygon { corners, soft } => {
            table.insert("polygon", corners.iter().map(|&corner| Value::Array(numbers(corner))).collect());
            table.insert("soft", (*soft).into());
        }
        Form::Ratio(ratio) => {
            table.insert("ratio", points(ratio).into());
        }
        Form::Painted(Painting { file, values, second, .. }) => {
            table.insert("image", file.into());
            table.insert("values", numbers(*values).into());
            table.insert("second", numbers(*second).into());
        }
    }
    table
}

/// Points of a factor or a curve, as files state them.
fn points(factor: &[(f64, f64)]) -> Array {
    factor.iter().map(|&(magnitude, factor)| Value::Array(numbers([magnitude, factor]))).collect()
}

fn labels(document: &mut DocumentMut, scene: &Scene, opened: &Scene) -> Result<(), SessionError> {
    let (Some(now), Some(then)) = (&scene.labels, &opened.labels) else { return Ok(()) };
    for entry in now.declared.iter().filter(|entry| !then.declared.contains(entry)) {
        let labels = table(document, "labels")?;
        let is_it = |key: &str| key.trim().parse() == Ok(entry.label);
        let key = labels.iter().map(|(key, _)| key.to_owned()).find(|key| is_it(key));
        // A label of `labels.others` gets an entry of its own.
        let key = key.unwrap_or_else(|| {
            let key = entry.label.to_string();
            let mut own = Table::new();
            own.insert("name", value(&entry.name));
            labels.insert(&key, Item::Table(own));
            key
        });
        let Some(label) = labels.get_mut(&key).and_then(Item::as_table_like_mut) else { continue };
        label.insert("material", value(scene.materials.get(entry.material).map_or("", |it| &it.name)));
        label.insert("opacity", value(entry.opacity));
        if entry.absorption <= 0.0 {
            label.remove("absorption");
        }
    }
    Ok(())
}

fn dial(table: &mut dyn TableLike, dial: &Dial) {
    table.insert("normalise", value(dial.normalise));
    table.insert("master", value(dial.master));
    let off = dial.nodes.iter().filter(|node| !node.on).map(|node| node.light.as_str());
    table.insert("off", value(names(off)));
    let nodes = dial.nodes.iter().map(|node| (node.light.as_str(), Value::Array(point(node.place))));
    table.insert("nodes", value(nodes.collect::<InlineTable>()));
    let presets = dial.presets.iter().map(|preset| {
        let mut row = InlineTable::new();
        row.insert("name", preset.name.as_str().into());
        row.insert("caption", preset.caption.as_str().into());
        // A position even on a node, because nodes move.
        row.insert("hand", point(preset.hand).into());
        row.insert("off", names(preset.off.iter().map(String::as_str)).into());
        if !preset.on.is_empty() {
            row.insert("on", names(preset.on.iter().map(String::as_str)).into());
        }
        row
    });
    table.insert("presets", value(presets.collect::<Array>()));
}

fn point(place: DVec2) -> Array {
    numbers(place.to_array())
}

/// Lights with intensity 0 in the text.
fn dark(document: &DocumentMut) -> BTreeSet<String> {
    let lights = document.get("lights").and_then(Item::as_table_like);
    let is_dark = |light: &Item| {
        let intensity = light.as_table_like().and_then(|light| light.get("intensity"));
        intensity.is_some_and(|it| it.as_float() == Some(0.0) || it.as_integer() == Some(0))
    };
    let dark = lights.into_iter().flat_map(TableLike::iter).filter(|(_, light)| is_dark(light));
    dark.map(|(name, _)| name.to_owned()).collect()
}

fn mix(light: &LightState, dial: &Dial, scene: &Scene, dark: &BTreeSet<String>) -> Table {
    let mut table = Table::new();
    let of_lights = || scene.lights.iter().map(|light| light.name.as_str()).zip(&light.sliders);
    table.insert("by", value(if light.mixing == Mixing::Dial { "dial" } else { "sliders" }));
    let under = dial.nodes.iter().find(|node| node.place == light.hand);
    table.insert("hand", under.map_or_else(|| value(point(light.hand)), |node| value(&node.light)));
    // Lights that are not listed have a weight of 1, so that they can be renamed and removed.
    let moved = of_lights().filter(|(_, slider)| slider.weight.to_bits() != 1.0_f64.to_bits());
    let weights: InlineTable = moved.map(|(name, slider)| (name, Value::from(slider.weight))).collect();
    if !weights.is_empty() {
        table.insert("weights", value(weights));
    }
    table.insert("off", value(names(of_lights().filter(|(_, slider)| !slider.on).map(|(name, _)| name))));
    let lit = of_lights().filter(|(name, slider)| slider.on && dark.contains(*name)).map(|(name, _)| name);
    table.insert("on", value(names(lit)));
    if let Some(solo) = light.solo.and_then(|solo| scene.lights.get(solo)) {
        table.insert("solo", value(&solo.name));
    }
    table.insert("normalise", value(light.normalise));
    table.insert("master", value(light.master));
    table
}
