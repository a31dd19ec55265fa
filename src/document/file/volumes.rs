//! Reads the volume, the labels and the crop box of a scene file.

use super::*;
use crate::look::first_look::{Kind, Values};
use relume_scene::MOST_GROUPS;

impl Text<'_> {
    pub(super) fn crop(&self, crop: &At<CropFile>, volume: &Volume) -> Result<[DVec3; 2], SceneError> {
        let last = volume.geometry.dims.map(|n| count(n) - 1.0);
        let corner = |places: &[PlaceFile; 3]| -> Result<[f64; 3], SceneError> {
            let mut corner = [0.0; 3];
            for axis in 0..3 {
                corner[axis] = match &places[axis] {
                    PlaceFile::Voxel(index) => *index,
                    PlaceFile::Part(text) => {
                        let part = text.strip_suffix('%').and_then(|part| part.trim().parse::<f64>().ok());
                        let part = part.filter(|part| (0.0..=100.0).contains(part)).ok_or_else(|| {
                            let message = format!("crop: {text:?} is no place along an axis; write a voxel index, or a part from \"0%\" to \"100%\"");
                            self.invalid(crop, message)
                        })?;
                        part / 100.0 * last[axis]
                    }
                };
            }
            Ok(corner)
        };
        let [min, max] = [corner(&crop.get_ref().min)?, corner(&crop.get_ref().max)?];
        for axis in 0..3 {
            // Only an axis of one voxel may have equal indices.
            let apart = min[axis] < max[axis] || last[axis] <= 0.0;
            if !(0.0 <= min[axis] && apart && min[axis] <= max[axis] && max[axis] <= last[axis]) {
                let message = format!(
                    "crop from {min:?} to {max:?}; on axis {} it must be two different voxel indices from 0 to {}, the lower one first",
                    ["x", "y", "z"][axis],
                    last[axis]
                );
                return Err(self.invalid(crop, message));
            }
        }
        Ok([DVec3::from_array(min), DVec3::from_array(max)])
    }

    /// The volume, and its grid before the scene changes spacing, origin or direction.
    pub(super) fn volume(
        &self,
        file: &VolumeFile,
        given: Option<Given>,
        base: &Path,
        options: &SceneOptions,
        progress: &dyn Progress,
    ) -> Result<(Arc<Volume>, Geometry), SceneError> {
        let fail = |source| SceneError::Volume { scene: self.name.clone(), source };
        let path = options.volume.clone().or_else(|| file.file.as_ref().map(|path| base.join(path)));
        let stated = if options.volume.is_some() { None } else { file.raw_layout(self)? };
        let layout = options.raw.clone().or(stated);
        let selection = file.selection(options);
        let is_ready = given.as_ref().is_some_and(|given| given.is_ready);
        let is_of_file = given.is_none();
        let mut volume = match (given, path, &file.phantom) {
            (Some(given), ..) => given.volumes.volume,
            (None, Some(path), _) => {
                Arc::new(relume_volume::open_by(&path, layout.as_ref(), &selection, progress).map_err(fail)?)
            }
            (None, None, Some(phantom)) => {
                let kind: Phantom =
                    phantom.get_ref().parse().map_err(|error| self.invalid(phantom, format!("{error}")))?;
                selection.only(phantom.get_ref()).map_err(fail)?;
                if options.raw.is_some() {
                    let message = format!(
                        "the layout of headerless voxels is for a file, and the volume of this scene is the phantom {:?}",
                        phantom.get_ref()
                    );
                    return Err(self.invalid(phantom, message));
                }
                Arc::new(Volume::phantom(kind, file.dims.map(|dims| dims.map(NonZeroUsize::get))).map_err(fail)?)
            }
            (None, None, None) => return Err(SceneError::NoVolume { scene: self.name.clone() }),
        };
        if let Some(blocks) = file.blocks(options).filter(|_| !is_ready) {
            let is_bare = file.file.is_none() && file.phantom.is_none();
            let are_labels = file.are_labels || is_bare && is_segmentation(&volume);
            if are_labels && !volume.has_labels {
                let mut labels = volume.downsample_labels(blocks).map_err(fail)?;
                labels.notes.push(format!("{}: blocks of labels keep their most frequent label", volume.source));
                volume = Arc::new(labels);
            } else {
                volume = Arc::new(volume.downsample(blocks).map_err(fail)?);
            }
        }
        if let Some(above) = file.largest_part_above.as_ref().filter(|_| !is_ready) {
            let value = self.number("volume.largest_part_above", above, &(f64::MIN..=f64::MAX))?;
            let kept = Arc::make_mut(&mut volume).keep_largest_part_above(value, progress);
            kept.map_err(|error| match error {
                VolumeError::NothingAbove { .. } => {
                    self.invalid(above, format!("volume.largest_part_above: {error}; write a smaller value"))
                }
                error => fail(error),
            })?;
        }
        if let Some(specks) = file.without_specks.as_ref().filter(|_| !is_ready) {
            let SpecksFile { above, voxels } = *specks.get_ref();
            if !above.is_finite() {
                let message = format!("volume.without_specks: above = {above}; it must be a finite number");
                return Err(self.invalid(specks, message));
            }
            match Arc::make_mut(&mut volume).remove_specks_above(above, voxels, progress) {
                // Nothing is above the value, so no speck is.
                Ok(_) | Err(VolumeError::NothingAbove { .. }) => {}
                Err(error) => return Err(fail(error)),
            }
        }
        let selection = Selection { asks: false, ..selection.or(&volume.selection) };
        if (is_of_file || is_ready) && selection != volume.selection {
            Arc::make_mut(&mut volume).selection = selection;
        }
        let stored = volume.geometry;
        if let Some((lengths, unit)) = options.spacing.filter(|_| !is_ready) {
            // Voxels are averaged blocks, as for the key `spacing` in a session.
            let sides = DVec3::from_array(file.blocks(options).unwrap_or([1; 3]).map(count));
            let spaced = Arc::unwrap_or_clone(volume).with_spacing(DVec3::from_array(lengths) * sides);
            let mut spaced = spaced.map_err(fail)?;
            spaced.unit = unit.or(spaced.unit);
            volume = Arc::new(spaced);
        }
        if let Some(unit) = file.unit.as_ref().filter(|_| options.spacing.is_none_or(|(_, unit)| unit.is_none())) {
            let known = Unit::named(unit.get_ref());
            let known = known.ok_or_else(|| self.invalid(unit, "volume.unit: the units are cm, mm, µm, nm and Å"))?;
            if volume.unit != Some(known) {
                Arc::make_mut(&mut volume).unit = Some(known);
            }
        }
        if let Some(spacing) = file.spacing.as_ref().filter(|_| options.spacing.is_none()) {
            let stated = DVec3::from_array(*spacing.get_ref());
            if stated != volume.geometry.spacing || volume.assumed_spacing.is_some() {
                let changed = Arc::unwrap_or_clone(volume).with_spacing(stated);
                volume = Arc::new(changed.map_err(|error| self.invalid(spacing, error.to_string()))?);
            }
        }
        let Geometry { dims, spacing, origin, direction } = volume.geometry;
        let grid = |origin, direction| Geometry::new(&volume.source, dims, spacing, origin, direction);
        let geometry = match (&file.origin, &file.direction) {
            (None, None) => volume.geometry,
            (moved, turned) => {
                let origin = match moved {
                    Some(moved) => self.vector("volume.origin", moved)?,
                    None => origin,
                };
                let turned_to = turned.as_ref().map_or(direction, |axes| DMat3::from_cols_array(axes.get_ref()));
                grid(origin, turned_to).map_err(|error| match turned {
                    Some(turned) => self.invalid(turned, error.to_string()),
                    None => fail(error),
                })?
            }
        };
        // The anatomical axes of the volume's file do not apply to a direction of the scene.
        let anatomical = volume.anatomical && file.direction.is_none();
        if geometry != volume.geometry || anatomical != volume.anatomical {
            let volume = Arc::make_mut(&mut volume);
            (volume.geometry, volume.anatomical) = (geometry, anatomical);
        }
        Ok((volume, stored))
    }

    /// Refuses further fields that nothing depends on, and too many groups of terms.
    pub(super) fn check_fields(&self, file: &Root, scene: &Scene) -> Result<(), SceneError> {
        let groups = scene.groups();
        for (name, stated) in &file.volumes {
            let by = groups.iter().flat_map(|group| group.factors.by).any(|factor| factor.field == *name);
            let is_second = |shape: &Shape| shape.second == Second::Field(name.clone());
            let is_factor = by || groups.iter().filter_map(|group| group.factors.shape).any(is_second);
            if stated.get_ref().transfer.is_none() && !is_factor {
                let message = format!(
                    "volumes.{name} has no effect; show it by a `transfer`, or name it in a factor of another field: by = {{ {name} = [[0, 0], [1, 1]] }}"
                );
                return Err(self.invalid(stated, message));
            }
        }
        match file.volumes.values().next() {
            Some(stated) if groups.len() > MOST_GROUPS => {
                let message = format!(
                    "the fields have {} groups of terms with equal factors; the limit is {MOST_GROUPS}, because each is looked up apart",
                    groups.len()
                );
                Err(self.invalid(stated, message))
            }
            _ => Ok(()),
        }
    }

    /// The further fields of a scene: volumes on the grid of `first` or on grids of their own, with what they show. Those that are `given`
    /// are not read.
    pub(super) fn further(
        &self,
        file: &Root,
        (first, stored, given): (&Volume, &Geometry, &[(String, Arc<Volume>)]),
        materials: &[Material],
        base: &Path,
        options: &SceneOptions,
        progress: &dyn Progress,
    ) -> Result<Vec<Field>, SceneError> {
        if let Some((name, stated)) = file.volumes.iter().nth(FIELDS - 1) {
            let message = format!(
                "volumes.{name}: the scene has {} fields; the limit is {FIELDS}, whose values share a texel",
                file.volumes.len() + 1
            );
            return Err(self.invalid(stated, message));
        }
        let of = |(name, stated): (&String, &At<FurtherFile>)| {
            let fail = |source| SceneError::Volume { scene: self.name.clone(), source };
            let FurtherFile { file: path, phantom, component, time, array, series, only, transform, transfer } =
                stated.get_ref();
            if name == FIRST_FIELD || name == file.first_field() {
                let message = format!("volumes.{name}: the first volume has this name; give this one another name");
                return Err(self.invalid(stated, message));
            }
            let mut terms = Vec::new();
            if let Some(transfer) = transfer {
                let (shown, all) = self.transfer(transfer.get_ref(), materials, (&file.fields_beside(name), base))?;
                if !all.is_empty() || shown.iter().any(by_gradient) {
                    let message = format!("volumes.{name}.transfer: only the first field has factors by the gradient");
                    return Err(self.invalid(transfer, message));
                }
                terms = shown;
            }
            if let Some((_, known)) = given.iter().find(|(of, _)| of == name) {
                return Ok(Field::new(name.clone(), Arc::clone(known), terms));
            }
            let of_volume = options.volume.clone().or_else(|| file.volume.file.as_ref().map(|path| base.join(path)));
            let path = path.as_ref().map(|path| base.join(path)).or_else(|| of_volume.filter(|_| phantom.is_none()));
            // Of the same file, as the first is read; of another, as it says.
            let same = stated.get_ref().file.is_none();
            let of_first = if same {
                first.selection.clone()
            } else {
                Selection { memory: first.selection.memory, ..Selection::default() }
            };
            let selection = Selection {
                component: *component,
                time: time.or(of_first.time),
                array: array.clone().or_else(|| of_first.array.clone()),
                series: series.clone().or_else(|| of_first.series.clone()),
                ..of_first
            };
            let mut volume = match (path, phantom) {
                (Some(path), _) => {
                    let layout = options.raw.clone().or(file.volume.raw_layout(self)?).filter(|_| same);
                    relume_volume::open_by(&path, layout.as_ref(), &selection, progress).map_err(fail)?
                }
                (None, Some(phantom)) => {
                    let kind: Phantom =
                        phantom.get_ref().parse().map_err(|error| self.invalid(phantom, format!("{error}")))?;
                    let blocks = file.volume.blocks(options).unwrap_or([1; 3]);
                    let dims = std::array::from_fn(|axis| stored.dims[axis] * blocks[axis]);
                    Volume::phantom(kind, Some(dims)).map_err(fail)?
                }
                (None, None) => {
                    let message = format!(
                        "volumes.{name}: the volume has no file of which this could be another component; state its `file`"
                    );
                    return Err(self.invalid(stated, message));
                }
            };
            volume.require_voxels("one of several fields").map_err(fail)?;
            if let Some(only) = only {
                volume = volume.mask_of(only.get_ref()).map_err(fail)?;
            }
            if let Some(blocks) = file.volume.blocks(options) {
                volume = volume.downsample(blocks).map_err(fail)?;
            }
            let fits = volume.geometry.dims == stored.dims;
            let lies = phantom.is_some() || volume.geometry.lies_on(stored);
            // A file without a place of its own is on the grid that it fits.
            if transform.is_some() || !(fits && (lies || volume.assumed_spacing.is_some())) {
                if let (Some(ours), Some(theirs)) = (first.unit, volume.unit)
                    && ours != theirs
                {
                    let message = format!(
                        "volumes.{name}: {} is in {theirs}, and the volume in {ours}; give both the same unit",
                        volume.source
                    );
                    return Err(self.invalid(stated, message));
                }
                if let Some(transform) = transform {
                    volume.geometry = self.moved(&volume, transform, base)?;
                }
                let note = match place_in(&volume.geometry, &first.geometry) {
                    Place::Inside => None,
                    Place::Partly => Some("reaches beyond the box of the volume; what lies there is not shown"),
                    Place::Outside => Some(
                        "lies outside the box of the volume: nothing of it is shown. Are both of the same place, such as one patient?",
                    ),
                };
                volume.notes.extend(note.map(|note| format!("{}: volumes.{name} {note}", volume.source)));
                if volume.anatomical != first.anatomical && transform.is_none() && phantom.is_none() {
                    let [with, without] = if volume.anatomical {
                        [&*volume.source, &*first.source]
                    } else {
                        [&*first.source, &*volume.source]
                    };
                    let note = format!(
                        "{with} has the axes of a patient, and {without} has none: are both of the same place?"
                    );
                    volume.notes.push(note);
                }
                return Ok(Field::new(name.clone(), Arc::new(volume), terms));
            }
            if !lies {
                volume.notes.push(format!(
                    "{}: volumes.{name} differs from the volume in spacing, origin or direction; it is assigned voxel by voxel to its grid",
                    volume.source
                ));
            }
            (volume.geometry, volume.anatomical) = (first.geometry, first.anatomical);
            Ok(Field::new(name.clone(), Arc::new(volume), terms))
        };
        file.volumes.iter().map(of).collect()
    }

    /// The grid of `volume`, moved from its world to that of the scene.
    fn moved(&self, volume: &Volume, stated: &At<TransformFile>, base: &Path) -> Result<Geometry, SceneError> {
        let rows = match stated.get_ref() {
            TransformFile::Numbers(rows) => *rows,
            TransformFile::File(path) => {
                transform::read(&base.join(path)).map_err(|message| self.invalid(stated, message))?
            }
        };
        let row = |i: usize| DVec3::new(rows[4 * i], rows[4 * i + 1], rows[4 * i + 2]);
        let matrix = DMat3::from_cols(row(0), row(1), row(2)).transpose();
        let shift = DVec3::new(rows[3], rows[7], rows[11]);
        // In relation to the lengths of its columns.
        let size = matrix.x_axis.length() * matrix.y_axis.length() * matrix.z_axis.length();
        let volume_of = matrix.determinant().abs();
        if !(rows.iter().all(|number| number.is_finite()) && volume_of > 1e-9 * size) {
            let message = format!(
                "the transform is singular: it leaves {} no volume (its determinant is {}); write 12 finite numbers by rows, of which the first three of each are a rotation times scales",
                volume.source,
                readable(matrix.determinant())
            );
            return Err(self.invalid(stated, message));
        }
        let Geometry { dims, spacing, origin, direction } = volume.geometry;
        let axes = matrix * direction;
        let lengths = DVec3::from_array(DVec3::AXES.map(|axis| (axes * axis).length()));
        let turned = axes * DMat3::from_diagonal(lengths.recip());
        Geometry::new(&volume.source, dims, spacing * lengths, matrix * origin + shift, turned).map_err(|error| {
            let message = format!("the transform of {} leaves no grid with right angles: {error}", volume.source);
            self.invalid(stated, message)
        })
    }

    /// The volume, and the label map on its grid with the `declared` labels.
    pub(super) fn label_volume(
        &self,
        file: &VolumeFile,
        volume: Arc<Volume>,
        LabelMap { given, are_ready, grid: stored, declared }: LabelMap<'_>,
        base: &Path,
        options: &SceneOptions,
        progress: &dyn Progress,
    ) -> Result<(Arc<Volume>, Option<Labels>), SceneError> {
        if let Some(labels) = given.as_ref().filter(|_| are_ready) {
            let fail = |source| SceneError::Labels { scene: self.name.clone(), source };
            let declared = declared.of_map(labels).map_err(fail)?;
            return Ok((volume, Some(Labels { volume: Arc::clone(labels), declared })));
        }
        let stated = file.labels.as_ref().map(|path| base.join(path)).filter(|_| options.volume.is_none());
        let is_frog = file.phantom.as_ref().is_some_and(|phantom| phantom.get_ref() == Phantom::Frog.name());
        let of_phantom = file.phantom_labels.as_ref().filter(|wanted| *wanted.get_ref());
        if let Some(wanted) = of_phantom.filter(|_| !is_frog) {
            return Err(self.invalid(wanted, "volume.phantom_labels: only the phantom \"frog\" has labels"));
        }
        let fail = |source| SceneError::Labels { scene: self.name.clone(), source };
        let named = |mut labels: Arc<Volume>| {
            if let Some(names) = file.label_names(base, options) {
                Arc::make_mut(&mut labels).name_labels(&names).map_err(fail)?;
            }
            Ok(labels)
        };
        let is_of_phantom = of_phantom.is_some() && options.volume.is_none();
        let mut labels = match (given, options.labels.clone().or(stated)) {
            (Some(labels), _) => labels,
            (None, Some(path)) => Arc::new(relume_volume::open(&path, &Selection::default(), progress).map_err(fail)?),
            (None, None) if is_of_phantom => {
                Arc::new(Volume::frog_labels(file.dims.map(|dims| dims.map(NonZeroUsize::get))).map_err(fail)?)
            }
            (None, None) if file.are_labels => {
                volume.require_voxels("a label map").map_err(fail)?;
                // Its notes are those of the volume.
                let labels = named(Arc::new(Volume { notes: Vec::new(), ..Volume::clone(&volume) }))?;
                let declared = declared.of_map(&labels).map_err(fail)?;
                let volume = ranked(volume, &declared).map_err(fail)?;
                return Ok((volume, Some(Labels { volume: labels, declared })));
            }
            (None, None) => {
                let mut volume = volume;
                if let Some(names) = &options.label_names {
                    Arc::make_mut(&mut volume).notes.push(format!(
                        "{}: there is no label map, so the names in {} are not used",
                        self.name,
                        names.display()
                    ));
                }
                return Ok((volume, None));
            }
        };
        if labels.blocks != [1; 3] {
            let problem = "labels cannot be averaged: write downsample into the scene's [volume], where it takes the \
                           most frequent label of a block, not into the sidecar of the labels";
            return Err(fail(VolumeError::Layout { source_name: labels.source.clone(), problem: problem.to_owned() }));
        }
        let blocks = file.blocks(options).unwrap_or([1; 3]);
        let whole = whole_grid(stored, blocks);
        // Only anatomical files state places that mean anything.
        if labels.anatomical
            && !labels.geometry.lies_on(&whole)
            && let Some(laid) = labels.labels_laid_into(&whole).map_err(fail)?
        {
            labels = Arc::new(laid);
        }
        let both_placed = labels.anatomical && volume.anatomical;
        let same_box = labels.assumed_spacing.is_none()
            && volume.assumed_spacing.is_none()
            && labels.geometry.dims != whole.dims
            && labels.geometry.fills_box_of(&whole);
        if !labels.geometry.lies_on(&whole) && (both_placed || same_box) {
            if !both_placed {
                let filling = Geometry::filling(labels.geometry.dims, &whole);
                Arc::make_mut(&mut labels).geometry = filling;
            }
            if let Some(laid) = labels.labels_resampled_to(&whole).map_err(fail)? {
                labels = Arc::new(laid);
            }
        }
        if blocks != [1; 3] {
            labels = Arc::new(labels.downsample_labels(blocks).map_err(fail)?);
        }
        if labels.geometry.dims != stored.dims {
            return Err(SceneError::LabelGrid {
                labels: labels.source.clone(),
                theirs: labels.geometry.dims,
                volume: volume.source.clone(),
                ours: stored.dims,
            });
        }
        if !labels.geometry.lies_on(stored) {
            let note = format!(
                "{}: the labels differ from the volume {} in spacing, origin or direction; they are assigned voxel by voxel to its grid",
                labels.source, volume.source
            );
            Arc::make_mut(&mut labels).notes.push(note);
        }
        let labels = named(labels)?;
        let declared = declared.of_map(&labels).map_err(fail)?;
        Ok((volume, Some(Labels { volume: labels, declared })))
    }
}

/// True if a factor on a term is one by the gradient.
fn by_gradient(term: &Term) -> bool {
    !term.gradient.is_empty() || term.shape.as_ref().is_some_and(|shape| shape.second == Second::Gradient)
}

/// A label map before it is read.
pub(super) struct LabelMap<'a> {
    /// The map, if it is in memory.
    pub(super) given: Option<Arc<Volume>>,
    /// True if it is on the grid of the volume, with its names.
    pub(super) are_ready: bool,
    /// The grid of the volume, before the scene changes it.
    pub(super) grid: &'a Geometry,
    /// The labels that the scene declares.
    pub(super) declared: Declared,
}

/// Whether the values of a volume without a scene are labels, which have no mean.
pub(crate) fn is_segmentation(volume: &Volume) -> bool {
    let values = volume.statistics().ok().map(|statistics| Values::of(volume, &statistics));
    volume.bricks.is_none() && values.is_some_and(|values| matches!(values.kind, Kind::Labels(_)))
}

/// Values that shading can tell apart in place of the `declared` labels of a volume: their ranks, if 16 bits do not hold them.
fn ranked(volume: Arc<Volume>, declared: &[LabelEntry]) -> Result<Arc<Volume>, VolumeError> {
    /// Largest label that is a value of its own.
    const LARGEST: i64 = 65_535;
    if declared.last().is_none_or(|last| last.label <= LARGEST) {
        return Ok(volume);
    }
    let labels: Vec<i64> = declared.iter().map(|entry| entry.label).collect();
    let mut ranked = volume.ranks_of_labels(&labels)?;
    ranked.notes.push(format!(
        "{}: labels are shown exactly; as values of the scene they have their ranks, 1 for the smallest",
        ranked.source
    ));
    Ok(Arc::new(ranked))
}

/// The grid whose blocks of voxels are the voxels of `stored`, without incomplete blocks.
fn whole_grid(stored: &Geometry, blocks: [usize; 3]) -> Geometry {
    let sides = DVec3::from_array(blocks.map(count));
    let spacing = stored.spacing / sides;
    Geometry {
        dims: std::array::from_fn(|axis| stored.dims[axis] * blocks[axis]),
        spacing,
        origin: stored.origin - stored.direction * (spacing * (sides - 1.0) / 2.0),
        direction: stored.direction,
    }
}

impl VolumeFile {
    /// Table of the names of labels, or the name of a built-in one.
    fn label_names(&self, base: &Path, options: &SceneOptions) -> Option<PathBuf> {
        let of_scene = |path: &PathBuf| if relume_volume::is_built_in(path) { path.clone() } else { base.join(path) };
        options.label_names.clone().or_else(|| self.label_names.as_ref().map(of_scene))
    }

    /// Layout of a headerless file, if the scene states a voxel type.
    pub(super) fn raw_layout(&self, text: &Text<'_>) -> Result<Option<RawLayout>, SceneError> {
        let Some(name) = &self.r#type else {
            return Ok(None);
        };
        let voxel_type = name.get_ref().parse().map_err(|error: VolumeError| text.invalid(name, error.to_string()))?;
        let Some(dims) = self.dims else {
            return Err(text.invalid(name, "headerless voxels need `dims` as well as a `type`"));
        };
        let plain = RawLayout::new(dims.map(NonZeroUsize::get), voxel_type);
        Ok(Some(RawLayout {
            slices: self.slices.clone(),
            byte_order: self.byte_order,
            header_bytes: self.header_bytes,
            spacing: self.spacing.as_ref().map_or(plain.spacing, |spacing| *spacing.get_ref()),
            origin: self.origin.as_ref().map_or(plain.origin, |origin| *origin.get_ref()),
            direction: self.direction.as_ref().map_or(plain.direction, |direction| *direction.get_ref()),
            ..plain
        }))
    }

    /// Choice of a volume from a file of several.
    pub(super) fn selection(&self, options: &SceneOptions) -> Selection {
        let stated = Selection {
            component: self.component,
            time: self.time,
            array: self.array.clone(),
            series: self.series.clone(),
            level: self.level,
            axes: self.axes.clone(),
            resample: self.resample,
            ..Selection::default()
        };
        if options.volume.is_some() || options.selection.asks {
            options.selection.clone()
        } else {
            options.selection.or(&stated)
        }
    }

    /// Size of the averaged blocks of voxels; for a phantom only if the command line states it.
    pub(super) fn blocks(&self, options: &SceneOptions) -> Option<[usize; 3]> {
        let is_file = options.volume.is_some() || self.phantom.is_none();
        let stated = self.downsample.map(|blocks| blocks.map(NonZeroUsize::get)).filter(|_| is_file);
        options.downsample.or(stated)
    }
}

/// Place of a grid relative to another one's box.
enum Place {
    Inside,
    Partly,
    Outside,
}

/// Place of the box of `grid` in that of `frame`, within half a voxel of it. A box beside an edge of the other one may count as partly
/// inside.
fn place_in(grid: &Geometry, frame: &Geometry) -> Place {
    let last = |geometry: &Geometry| DVec3::from_array(geometry.dims.map(count)) - 1.0;
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for bits in 0..8_usize {
        let corner =
            DVec3::from_array(std::array::from_fn(|axis| if bits >> axis & 1 == 0 { 0.0 } else { last(grid)[axis] }));
        let index = frame.direction.inverse() * (grid.world_from_index(corner) - frame.origin) / frame.spacing;
        (low, high) = (low.min(index), high.max(index));
    }
    let (first, end) = (DVec3::splat(-0.5), last(frame) + 0.5);
    if low.cmpgt(end).any() || high.cmplt(first).any() {
        Place::Outside
    } else if low.cmplt(first).any() || high.cmpgt(end).any() {
        Place::Partly
    } else {
        Place::Inside
    }
}
